//! From the reference motion to torques: inverse dynamics and the impedance around the reference
//! [thesis section 4.4].

use glam::DVec3;
use nalgebra::SVector;
use tprmp_model::controller_config::Impedance;
use tprmp_robot::{Chain, gravity_torques, inverse_dynamics};

use crate::inputs::estimator::JointState;
use crate::motion::limits::JointLimits;
use crate::motion::profile::JointMotion;

/// Torques of a command.
#[derive(Debug, Clone, Copy)]
pub struct Torques<const N: usize> {
    /// Without gravity \[N m or N\].
    pub motion: SVector<f64, N>,
    /// What holds the arm against gravity \[N m or N\].
    pub gravity: SVector<f64, N>,
    /// Accelerations that they are to cause, `None` where they only hold against gravity \[rad/s² or m/s²\].
    pub wanted: Option<SVector<f64, N>>,
    /// Whether the limits cut them.
    pub saturated: bool,
}

/// How a robot turns accelerations into torques.
#[derive(Debug, Clone, Copy)]
pub struct Tracking {
    /// Feedback.
    pub impedance: Impedance,
    /// In the base frame \[m/s²\].
    pub gravity_m_s2: DVec3,
}

impl Tracking {
    /// The accelerations by which the reference gives way to the measured state, with the time constant T:
    /// c = (2/(T + dt)) (q̇ − q̇_c) + (q − q_c)/(T + dt)²  \[rad/s² or m/s²\].
    ///
    /// A push moves the reference along, and saturation winds nothing up.
    #[must_use]
    pub fn yielding<const N: usize>(
        &self,
        reference: &JointMotion<N>,
        measured: &JointState<N>,
        dt: f64,
    ) -> SVector<f64, N> {
        let rate = 1.0 / (self.impedance.reference_time_constant_s + dt);
        ((measured.velocity - reference.velocity) * 2.0
            + (measured.position - reference.position) * rate)
            * rate
    }

    /// Inverse dynamics with an impedance around the reference:
    /// τ = M(q) (a + D (q̇_r − q̇) + K (q_c − q) + d) + h(q, q̇), gravity apart, the sum within the limits.
    ///
    /// * `state`  q, q̇
    /// * `yielded`  what the limits left of c, by which the reference follows the arm: it is no acceleration
    ///   that the arm is asked for, a = q̈_c − c; and q̇_r is the reference's velocity without it
    /// * `compensation`  d, what resists a push \[rad/s² or m/s²\]
    ///
    /// Hot path: no allocation.
    #[must_use]
    pub fn torques<const N: usize>(
        &self,
        (chain, limits): (&Chain<N>, &JointLimits<N>),
        state: &JointState<N>,
        reference: &JointMotion<N>,
        yielded: Option<&SVector<f64, N>>,
        compensation: &SVector<f64, N>,
    ) -> Torques<N> {
        let Self { impedance, gravity_m_s2 } = *self;
        let offset = reference.position - state.position;
        let (mut velocity, mut acceleration) = (reference.velocity, reference.acceleration);
        if let Some(yielded) = yielded {
            velocity += offset / impedance.reference_time_constant_s;
            acceleration -= yielded;
        }
        let feedback =
            (velocity - state.velocity) * impedance.damping_1_s + offset * impedance.stiffness_1_s2;
        // A reference far from the arm pulls no harder than the arm may accelerate.
        let bounded = feedback.zip_map(&limits.acceleration_max, |f, most| f.clamp(-most, most));
        let wanted = acceleration + bounded + compensation;
        let (q, qd) = (&state.position, &state.velocity);
        let total = inverse_dynamics(chain, q, qd, &wanted, gravity_m_s2);
        let Torques { gravity, .. } = self.resting((chain, limits), q);
        let permitted = limits.effort(&total);
        Torques {
            motion: permitted - gravity,
            gravity,
            wanted: Some(wanted),
            saturated: permitted != total,
        }
    }

    /// What holds the arm at `position` against gravity, and nothing beside it.
    #[must_use]
    pub fn resting<const N: usize>(
        &self,
        (chain, limits): (&Chain<N>, &JointLimits<N>),
        position: &SVector<f64, N>,
    ) -> Torques<N> {
        let gravity = limits.effort(&gravity_torques(chain, position, self.gravity_m_s2));
        Torques { motion: SVector::zeros(), gravity, wanted: None, saturated: false }
    }
}

/// How much of the largest change is gravity's, which changes with the posture only.
const GRAVITY_FRACTION: f64 = 0.2;

impl<const N: usize> Torques<N> {
    /// These torques, or what comes nearest to them after those `before` within `dt` \[s\]: the torque
    /// that holds the arm against gravity, what is beside it, and their sum change no faster than they may.
    #[must_use]
    pub fn after(mut self, before: &Self, limits: &JointLimits<N>, dt: f64) -> Self {
        let near = |wanted: &SVector<f64, N>, before: &SVector<f64, N>, fraction: f64| {
            let step = limits.effort_rate_max * (fraction * dt);
            wanted.zip_zip_map(before, &step, |w, b, step| w.clamp(b - step, b + step))
        };
        let (wanted, before_total) = (self.motion + self.gravity, before.motion + before.gravity);
        let total = near(&wanted, &before_total, 1.0 - GRAVITY_FRACTION);
        self.saturated |= total != wanted;
        self.gravity = near(&self.gravity, &before.gravity, GRAVITY_FRACTION);
        self.motion = total - self.gravity;
        self
    }
}
