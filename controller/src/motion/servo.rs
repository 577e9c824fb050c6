//! A servo with a lag: where the arm will be, seen from where it is.

use nalgebra::SVector;

use crate::inputs::estimator::JointState;
use crate::motion::profile::JointMotion;

/// A servo's motion as it should be: T q̇ = q_c − q, of a position servo and, T q̈ = q̇_c − q̇, of a velocity servo
/// alike.
///
/// What the arm has beside it was done by others. So the arm will be, once the servo has caught up, at
/// q + (q_c − q_m), as fast as q̇ + (q̇_c − q̇_m): where the policy acts, and where the reference yields to. An arm
/// that does as its servo should is where it was told to be, and one that is held or pushed is as far beside
/// as it is now.
#[derive(Debug, Clone, Copy)]
pub struct ServoModel<const N: usize> {
    lag_s: f64,
    /// q_m and q̇_m, `None` before the first command.
    now: Option<(SVector<f64, N>, SVector<f64, N>)>,
}

impl<const N: usize> ServoModel<N> {
    /// Of a servo with this lag, `None` for one that has none \[s\].
    #[must_use]
    pub fn new(lag_s: f64) -> Option<Self> {
        (lag_s > 0.0).then_some(Self { lag_s, now: None })
    }

    /// Goes on for `dt` \[s\] with a set point.
    pub fn advance(&mut self, set_point: &JointMotion<N>, dt: f64) {
        let (position, _) = self.now.unwrap_or((set_point.position, SVector::zeros()));
        let fraction = -(-dt / self.lag_s).exp_m1();
        let position = position + (set_point.position - position) * fraction;
        self.now = Some((position, (set_point.position - position) / self.lag_s));
    }

    /// Where the arm will be, within `ends` \[rad or m\], and how fast.
    #[must_use]
    pub fn ahead(
        &self,
        state: &JointState<N>,
        set_point: &JointMotion<N>,
        ends: &[SVector<f64, N>; 2],
    ) -> JointState<N> {
        let Some((position, velocity)) = self.now else { return *state };
        JointState {
            position: (state.position + set_point.position - position).zip_zip_map(
                &ends[0],
                &ends[1],
                f64::clamp,
            ),
            velocity: state.velocity + set_point.velocity - velocity,
        }
    }
}
