//! A smooth path, and what is done to its ends.

use glam::DVec3;

/// A path with its first two derivatives, one entry a sample. Unit u is m or rad.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Points \[u\].
    pub points: Vec<DVec3>,
    /// Velocities [u/s].
    pub velocities: Vec<DVec3>,
    /// Accelerations [u/s²].
    pub accelerations: Vec<DVec3>,
}

impl Path {
    /// Lets a path that begins in motion begin at rest, as the policy does, and catch up: v₀ t exp(−bt)
    /// is taken from it, with b = `rate_1_s`. It falls behind by v₀/(e b) at most.
    pub fn start_from_rest(&mut self, rate_1_s: f64, sampling_time_s: f64) {
        let velocity = self.velocities[0];
        for i in 0..self.points.len() {
            let t = i as f64 * sampling_time_s;
            let left = (-rate_1_s * t).exp();
            self.points[i] -= velocity * (t * left);
            self.velocities[i] -= velocity * ((1.0 - rate_1_s * t) * left);
            self.accelerations[i] -= velocity * (rate_1_s * (rate_1_s * t - 2.0) * left);
        }
    }

    /// Lets a path end exactly at the goal: what is missing is faded in over its whole length, with no
    /// change of velocity or acceleration at either end.
    pub fn end_at(&mut self, goal: DVec3, sampling_time_s: f64) {
        let last = self.points.len() - 1;
        let missing = goal - self.points[last];
        let duration_s = last as f64 * sampling_time_s;
        for i in 0..=last {
            let t = i as f64 / last as f64;
            // The quintic blend and its derivatives.
            let blend = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
            let rate = 30.0 * t * t * (1.0 - t) * (1.0 - t) / duration_s;
            let second = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / (duration_s * duration_s);
            self.points[i] += missing * blend;
            self.velocities[i] += missing * rate;
            self.accelerations[i] += missing * second;
        }
        self.points[last] = goal;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canonical::savitzky_golay::smooth;

    #[test]
    fn a_path_ends_at_the_goal_and_stays_consistent() {
        let dt = 0.01;
        let samples: Vec<_> = (0..200)
            .map(|i| DVec3::new((f64::from(i) * dt).sin(), (f64::from(i) * dt).cos(), 0.1))
            .collect();
        let mut path = smooth(&samples, dt, 0.2, 3);
        let goal = samples[199] + DVec3::new(0.02, -0.01, 0.03);
        path.end_at(goal, dt);
        assert_eq!(path.points[199], goal);
        for i in 20..180 {
            let rate = (path.points[i + 1] - path.points[i - 1]) / (2.0 * dt);
            let second = (path.velocities[i + 1] - path.velocities[i - 1]) / (2.0 * dt);
            assert!((rate - path.velocities[i]).length() < 1e-4);
            assert!((second - path.accelerations[i]).length() < 1e-2);
        }
    }

    #[test]
    fn a_path_that_begins_in_motion_begins_at_rest_and_is_caught_up_with() {
        let dt = 0.01;
        let velocity = DVec3::new(0.3, -0.1, 0.2);
        let mut path = Path {
            points: (0..200).map(|i| velocity * (f64::from(i) * dt)).collect(),
            velocities: vec![velocity; 200],
            accelerations: vec![DVec3::ZERO; 200],
        };
        let recorded = path.points.clone();
        path.start_from_rest(12.0, dt);
        assert_eq!((path.points[0], path.velocities[0]), (DVec3::ZERO, DVec3::ZERO));
        let behind: Vec<f64> =
            path.points.iter().zip(&recorded).map(|(a, b)| (*a - *b).length()).collect();
        let most = behind.iter().copied().fold(0.0, f64::max);
        assert!((most - velocity.length() / (12.0 * std::f64::consts::E)).abs() < 1e-4);
        assert!(behind[100] < 1e-4 * velocity.length());
        for i in 1..199 {
            let rate = (path.points[i + 1] - path.points[i - 1]) / (2.0 * dt);
            let second = (path.velocities[i + 1] - path.velocities[i - 1]) / (2.0 * dt);
            assert!((rate - path.velocities[i]).length() < 2e-2 * velocity.length());
            assert!((second - path.accelerations[i]).length() < 0.4 * velocity.length());
        }
    }
}
