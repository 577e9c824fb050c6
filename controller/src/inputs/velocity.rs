//! Whether measured velocities are those of the measured positions.

use nalgebra::SVector;
use tprmp_messages::Reason;

use crate::detail::{About, Detail};

/// The sum of what positions change by, and of that beside their velocities, fades with this time constant \[s\] …
const DRIFT_FADE_S: f64 = 0.25;
/// … and the latter may be what the largest speed covers in this time \[s\].
const DRIFT_MAX_S: f64 = 0.02;
/// A velocity that explains less than a twentieth of the way that its joint has gone, a way of at least so much
/// \[rad or m\] …
const UNEXPLAINED_MIN: f64 = 0.012;
const UNEXPLAINED_FRACTION: f64 = 0.95;
/// A single state counts for no more: one jump is no velocity \[rad or m\].
const JUMP_MAX: f64 = 0.004;
/// … for so long is none, or has another sign or unit: longer than a velocity lags by, 30 ms \[s\].
const UNEXPLAINED_S: f64 = 0.04;

/// Watches the velocities of N joints.
#[derive(Debug, Clone, Copy)]
pub struct VelocityWatch<const N: usize> {
    /// Σ Δq − q̇ Δt, fading \[rad or m\].
    drift: SVector<f64, N>,
    /// The same without jumps, and Σ Δq without them, fading \[rad or m\].
    unexplained: SVector<f64, N>,
    moved: SVector<f64, N>,
    /// For how long each velocity explains nothing of it \[s\].
    unexplained_s: SVector<f64, N>,
}

impl<const N: usize> Default for VelocityWatch<N> {
    /// Nothing has moved.
    fn default() -> Self {
        let zeros = SVector::zeros();
        Self { drift: zeros, unexplained: zeros, moved: zeros, unexplained_s: zeros }
    }
}

impl<const N: usize> VelocityWatch<N> {
    /// Updates with what the positions have changed by, and with what of it is beside the velocities, in a time \[s\].
    pub fn update(&mut self, moved: &SVector<f64, N>, beside: &SVector<f64, N>, elapsed_s: f64) {
        let kept = (-elapsed_s / DRIFT_FADE_S).exp();
        self.drift = self.drift * kept + beside;
        let jumpless = beside.map(|beside| beside.clamp(-JUMP_MAX, JUMP_MAX));
        self.unexplained = self.unexplained * kept + jumpless;
        self.moved = self.moved * kept + (moved - beside) + jumpless;
        for i in 0..N {
            let (beside, moved) = (self.unexplained[i].abs(), self.moved[i].abs());
            let unexplained = moved >= UNEXPLAINED_MIN && beside >= UNEXPLAINED_FRACTION * moved;
            let so_far_s = self.unexplained_s[i];
            self.unexplained_s[i] = if unexplained { so_far_s + elapsed_s } else { 0.0 };
        }
    }

    /// The first joint whose velocity is not that of its positions, where joints have these largest speeds
    /// \[rad/s or m/s\].
    #[must_use]
    pub fn find(&self, speed_max: &SVector<f64, N>) -> Option<Detail> {
        let drift_max = speed_max * DRIFT_MAX_S;
        let i = (0..N).find(|&i| {
            self.drift[i].abs() > drift_max[i] || self.unexplained_s[i] >= UNEXPLAINED_S
        })?;
        let most = [UNEXPLAINED_MIN.min(drift_max[i]), 0.0];
        let reason = Reason::VelocityUnbelievable;
        Some(Detail::new(reason, About::Drift, self.drift[i], most).at(i))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    const STEP_S: f64 = 2e-3;

    /// How far a joint has gone when its velocity is found not to be that of its positions, within 10 s.
    fn found_at(position: impl Fn(f64) -> f64, velocity: impl Fn(f64) -> f64) -> Option<f64> {
        let mut watch = VelocityWatch::<1>::default();
        (1..5000_u32).find_map(|k| {
            let [last, now] = [k - 1, k].map(|k| f64::from(k) * STEP_S);
            let moved = position(now) - position(last);
            let explained = 0.5 * (velocity(last) + velocity(now)) * STEP_S;
            watch.update(&Vector1::new(moved), &Vector1::new(moved - explained), STEP_S);
            watch.find(&Vector1::new(6.0)).map(|_| position(now).abs())
        })
    }

    #[test]
    fn a_velocity_that_explains_nothing_is_found_within_centimetres() {
        let position = |t: f64| 0.5 * 2.0 * t * t;
        for factor in [0.0, -1.0, 57.3] {
            let at = found_at(position, |t| factor * 2.0 * t);
            assert!(at.is_some_and(|at| at < 0.05), "{factor}: {at:?}");
        }
    }

    #[test]
    fn one_jump_of_a_position_is_no_velocity() {
        let position = |t: f64| if t < 1.0 { 0.0 } else { 0.1 };
        assert_eq!(found_at(position, |_| 0.0), None);
    }

    #[test]
    fn a_velocity_that_lags_is_believed_to_and_fro() {
        for (size, rate) in [(0.02, 20.0), (0.2, 5.0), (0.5, 2.0), (1.0, 0.5)] {
            let position = |t: f64| size * (1.0 - (rate * t).cos());
            let velocity = |t: f64| {
                let late = t - 0.03;
                if late < 0.0 { 0.0 } else { size * rate * (rate * late).sin() }
            };
            assert_eq!(found_at(position, velocity), None, "{size} rad, {rate} rad/s");
        }
    }
}
