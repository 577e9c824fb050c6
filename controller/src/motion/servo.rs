//! A servo with a lag: where the arm will be, seen from where it is.

use nalgebra::SVector;

use crate::inputs::estimator::JointState;
use crate::motion::profile::JointMotion;

/// A servo's motion as it should be: T q̇ = q_c − q, of a position servo and, T q̈ = q̇_c − q̇, of a velocity servo
/// alike; from one set point to the next q_c is interpolated.
///
/// What the arm has beside it was done by others. So the arm will be, once the servo has caught up, at
/// q + (q_c − q_m), as fast as q̇ + (q̇_c − q̇_m): where the policy acts, and where the reference yields to. An arm
/// that does as its servo should is where it was told to be, and one that is held or pushed is as far beside
/// as it is now.
#[derive(Debug, Clone, Copy)]
pub struct ServoModel<const N: usize> {
    lag_s: f64,
    /// `None` before the first command.
    now: Option<Lagged<N>>,
}

/// A set point, and where the servo is.
#[derive(Debug, Clone, Copy)]
struct Lagged<const N: usize> {
    set_point: SVector<f64, N>,
    position: SVector<f64, N>,
    velocity: SVector<f64, N>,
}

impl<const N: usize> ServoModel<N> {
    /// Of a servo with this lag, `None` for one that has none \[s\].
    #[must_use]
    pub fn new(lag_s: f64) -> Option<Self> {
        (lag_s > 0.0).then_some(Self { lag_s, now: None })
    }

    /// Goes on for `dt` \[s\] to a set point, at a constant rate r:
    /// q_m = q_c − r T + (q_m − q_c⁻ + r T) e^(−dt/T).
    pub fn advance(&mut self, set_point: &JointMotion<N>, dt: f64) {
        let before = self.now.unwrap_or(Lagged {
            set_point: set_point.position,
            position: set_point.position,
            velocity: set_point.velocity,
        });
        let left = (-dt / self.lag_s).exp();
        let behind = (set_point.position - before.set_point) * (self.lag_s / dt);
        self.now = Some(Lagged {
            set_point: set_point.position,
            position: set_point.position - behind
                + (before.position - before.set_point + behind) * left,
            velocity: set_point.velocity + (before.velocity - set_point.velocity) * left,
        });
    }

    /// Where the arm will be, within `ends` \[rad or m\], and how fast.
    #[must_use]
    pub fn ahead(
        &self,
        state: &JointState<N>,
        set_point: &JointMotion<N>,
        ends: &[SVector<f64, N>; 2],
    ) -> JointState<N> {
        let Some(now) = &self.now else { return *state };
        JointState {
            position: (state.position + set_point.position - now.position).zip_zip_map(
                &ends[0],
                &ends[1],
                f64::clamp,
            ),
            velocity: state.velocity + set_point.velocity - now.velocity,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    const ENDS: [Vector1<f64>; 2] = [Vector1::new(-9.0), Vector1::new(9.0)];

    /// A set point that moves as fast as `speed` \[rad/s\] for 1 s, and a servo with a lag of `lag_s` \[s\] that
    /// is held `beside` \[rad\]. Gives where it is thought to be less where it was told to be.
    fn beside(speed: f64, lag_s: f64, beside: f64) -> f64 {
        let dt = 0.002;
        let mut model = ServoModel::<1>::new(0.1).unwrap();
        let mut set_point = JointMotion::at_rest(Vector1::zeros());
        let mut position = 0.0;
        for _ in 0..500 {
            set_point.velocity = Vector1::new(speed);
            set_point.position += set_point.velocity * dt;
            model.advance(&set_point, dt);
            for part in 1..=10 {
                let wanted = set_point.position[0] - speed * dt * f64::from(10 - part) / 10.0;
                position += (wanted - position) * (1.0 - (-dt / 10.0 / lag_s).exp());
            }
        }
        let state =
            JointState { position: Vector1::new(position + beside), velocity: Vector1::new(speed) };
        model.ahead(&state, &set_point, &ENDS).position[0] - set_point.position[0]
    }

    #[test]
    fn a_servo_that_lags_as_it_should_is_thought_where_it_was_told_to_be() {
        assert!(beside(0.5, 0.1, 0.0).abs() < 1e-4);
        assert!((beside(0.5, 0.15, 0.0) + 0.5 * 0.05).abs() < 1e-3, "what the lag is wrong by");
    }

    #[test]
    fn a_servo_that_is_held_is_thought_as_far_beside() {
        assert!((beside(0.5, 0.1, 0.03) - 0.03).abs() < 1e-4);
        let state = JointState { position: Vector1::new(1.0), velocity: Vector1::zeros() };
        let none = ServoModel::<1>::new(0.1).unwrap();
        let ahead = none.ahead(&state, &JointMotion::at_rest(Vector1::zeros()), &ENDS);
        assert_eq!(ahead.position, state.position, "before a first command");
        assert!(ServoModel::<1>::new(0.0).is_none());
    }

    #[test]
    fn ticks_of_no_length_and_long_ones_stay_finite() {
        let mut model = ServoModel::<1>::new(0.01).unwrap();
        let mut set_point = JointMotion::at_rest(Vector1::zeros());
        for dt in [1e-6, 0.02, 1e-9, 0.02] {
            set_point.position += Vector1::new(3.0 * dt);
            model.advance(&set_point, dt);
            let state = JointState { position: set_point.position, velocity: Vector1::zeros() };
            let ahead = model.ahead(&state, &set_point, &ENDS);
            assert!((ahead.position - set_point.position).amax() < 0.1);
        }
    }
}
