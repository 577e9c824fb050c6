//! Pushes: what moves the arm beside its command, and how fast it may.
//!
//! Computed torques make every joint accelerate as asked; what is measured beyond that is a
//! push. A light wrist gives way to a push of some newtons with hundreds of rad/s², faster than any
//! impedance that is weighed by the inertia of its links would brake it.

use nalgebra::SVector;
use tprmp_model::controller_config::Disturbance;

/// States farther apart say nothing about the acceleration in between \[s\].
const GAP_MAX_S: f64 = 0.02;

/// Observer of the joint accelerations that were not asked for.
#[derive(Debug, Clone, Copy)]
pub struct DisturbanceObserver<const N: usize> {
    settings: Disturbance,
    /// Filtered disturbance \[rad/s² or m/s²\].
    estimate: SVector<f64, N>,
    /// Velocity and time of the last state \[ns\].
    last: Option<(SVector<f64, N>, u64)>,
    /// ∫ of the asked accelerations since then, and over what time.
    asked: SVector<f64, N>,
    asked_s: f64,
    /// Whether more was asked since then than the efforts allow: then what was missing is nobody's push.
    saturated: bool,
    /// What came of the last state, until it was looked at \[s\].
    fresh_s: Option<f64>,
}

impl<const N: usize> DisturbanceObserver<N> {
    /// Nothing was measured yet.
    #[must_use]
    pub fn new(settings: Disturbance) -> Self {
        Self {
            settings,
            estimate: SVector::zeros(),
            last: None,
            asked: SVector::zeros(),
            asked_s: 0.0,
            saturated: false,
            fresh_s: None,
        }
    }

    /// Updates with a measured velocity \[rad/s or m/s\]; the same state again changes nothing.
    ///
    /// d += (Δq̇/Δt − mean of what was asked − d) Δt/(Δt + T)
    pub fn observe(&mut self, velocity: &SVector<f64, N>, time_ns: u64) {
        let Some((before, before_ns)) = self.last else {
            self.last = Some((*velocity, time_ns));
            return;
        };
        if time_ns == before_ns {
            return;
        }
        let elapsed_s = time_ns.saturating_sub(before_ns) as f64 * 1e-9;
        let believed = elapsed_s > 0.0 && elapsed_s < GAP_MAX_S && self.asked_s > 0.0;
        let mut fresh_s = None;
        if !believed {
            self.estimate = SVector::zeros();
        } else if !self.saturated {
            let beside = (velocity - before) / elapsed_s - self.asked / self.asked_s;
            let fraction = elapsed_s / (elapsed_s + self.settings.time_constant_s);
            self.estimate += (beside - self.estimate) * fraction;
            fresh_s = Some(elapsed_s);
        }
        *self = Self { estimate: self.estimate, fresh_s, ..Self::new(self.settings) };
        self.last = Some((*velocity, time_ns));
    }

    /// The arm is not measured any more.
    pub fn forget(&mut self) {
        *self = Self::new(self.settings);
    }

    /// The disturbance \[rad/s² or m/s²\].
    #[must_use]
    pub fn estimate(&self) -> &SVector<f64, N> {
        &self.estimate
    }

    /// The disturbance \[rad/s² or m/s²\] and the time between the states that show it \[s\], once for each
    /// state that can be believed.
    pub fn take_fresh(&mut self) -> Option<(SVector<f64, N>, f64)> {
        self.fresh_s.take().map(|elapsed_s| (self.estimate, elapsed_s))
    }

    /// Records the accelerations that the torques of this tick, `dt` \[s\], are to cause.
    pub fn asked(&mut self, acceleration: &SVector<f64, N>, saturated: bool, dt: f64) {
        self.asked += acceleration * dt;
        self.asked_s += dt;
        self.saturated |= saturated;
    }

    /// What is to be added to the asked accelerations, so that within the horizon h no disturbance
    /// drives a joint beyond the speed v a push may cause, or beyond the reference where that is
    /// faster:
    ///
    /// ```text
    /// d′ = d within (−v′ − q̇)/h … (v″ − q̇)/h,   d′ − d is added        v″ = max(v, q̇_c), v′ = max(v, −q̇_c)
    /// ```
    ///
    /// Below that the arm yields as its impedance does.
    #[must_use]
    pub fn compensation(
        &self,
        velocity: &SVector<f64, N>,
        reference_velocity: &SVector<f64, N>,
        velocity_max: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        SVector::from_fn(|i, _| {
            let yields = self.settings.speed_fraction * velocity_max[i];
            let room = |bound: f64| (bound - velocity[i]) / self.settings.horizon_s;
            let upper = room(yields.max(reference_velocity[i]));
            let lower = room((-yields).min(reference_velocity[i]));
            self.estimate[i].clamp(lower, upper) - self.estimate[i]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    const SETTINGS: Disturbance =
        Disturbance { speed_fraction: 0.15, horizon_s: 0.01, time_constant_s: 0.002, load: None };

    /// A joint that rests is pushed with `push` \[rad/s²\] for 0.2 s; commands act `delay` ticks of 1 ms
    /// late, and states come every 2 ms. Gives the largest speed and that at the end.
    fn pushed(push: f64, delay: usize, guarded: bool) -> (f64, f64) {
        let mut observer = DisturbanceObserver::<1>::new(SETTINGS);
        let (mut speed, mut most) = (0.0, 0.0_f64);
        let mut underway = std::collections::VecDeque::from(vec![0.0; delay]);
        let mut measured = Vector1::new(0.0);
        for tick in 0..400_u64 {
            if tick.is_multiple_of(2) {
                measured = Vector1::new(speed);
                observer.observe(&measured, 1 + tick * 1_000_000);
            }
            let added = observer.compensation(&measured, &Vector1::new(0.0), &Vector1::new(3.0))
                - measured * 20.0;
            let asked = if guarded { added } else { -measured * 20.0 };
            observer.asked(&asked, false, 1e-3);
            underway.push_back(asked[0]);
            let acts = underway.pop_front().unwrap();
            speed += 1e-3 * (acts + if tick < 200 { push } else { 0.0 });
            most = most.max(speed.abs());
        }
        (most, speed)
    }

    #[test]
    fn a_push_moves_a_light_joint_no_faster_than_permitted_even_when_commands_are_late() {
        assert!(pushed(400.0, 0, false).0 > 3.0, "without it the limit is exceeded");
        for delay in 0..3 {
            let (most, end) = pushed(400.0, delay, true);
            assert!(most < 2.4, "{delay}: {most}");
            assert!(end.abs() < 0.1, "{delay}: {end}");
        }
    }

    #[test]
    fn a_gentle_push_is_left_to_the_impedance() {
        assert!((pushed(5.0, 0, true).0 - pushed(5.0, 0, false).0).abs() < 1e-9);
    }

    #[test]
    fn a_lack_of_torque_and_a_gap_are_no_pushes() {
        let mut observer = DisturbanceObserver::<1>::new(SETTINGS);
        let none = Vector1::new(0.0);
        observer.observe(&none, 1);
        observer.asked(&Vector1::new(1000.0), true, 2e-3);
        observer.observe(&none, 2_000_001);
        assert_eq!(observer.estimate, none);
        observer.asked(&none, false, 2e-3);
        observer.observe(&Vector1::new(1.0), 500_000_000);
        assert_eq!(observer.estimate, none);
    }
}
