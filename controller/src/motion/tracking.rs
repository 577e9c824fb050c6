//! From the policy's acceleration to a command: the integrated reference and the impedance around
//! it  [thesis section 4.4].

use glam::DVec3;
use nalgebra::SVector;
use tprmp_model::controller_config::Impedance;
use tprmp_robot::{Chain, gravity_torques, inverse_dynamics};

use crate::inputs::state::JointState;
use crate::motion::limits::JointLimits;

/// The integrated position and velocity that a command carries.
#[derive(Debug, Clone, Copy)]
pub struct Reference<const N: usize> {
    /// q_c \[rad or m\].
    pub position: SVector<f64, N>,
    /// q̇_c \[rad/s or m/s\].
    pub velocity: SVector<f64, N>,
}

impl<const N: usize> Reference<N> {
    /// Starts from a measured state, its velocity within the limits.
    #[must_use]
    pub fn at(state: &JointState<N>, limits: &JointLimits<N>) -> Self {
        let velocity = state.velocity.zip_map(&limits.velocity_max, |v, most| v.clamp(-most, most));
        Self { position: state.position, velocity }
    }

    /// Integrates an acceleration over `dt` \[s\], semi-implicitly.
    pub fn integrate(&mut self, acceleration: &SVector<f64, N>, dt: f64) {
        self.velocity += acceleration * dt;
        self.position += self.velocity * dt;
    }

    /// Tends to the measured state with the time constant `time_constant_s`, so that a push
    /// moves the reference along and saturation winds nothing up; its velocity stays in its limits.
    pub fn follow(
        &mut self,
        measured: &JointState<N>,
        limits: &JointLimits<N>,
        time_constant_s: f64,
        dt: f64,
    ) {
        let fraction = dt / (dt + time_constant_s);
        self.position += (measured.position - self.position) * fraction;
        self.velocity += (measured.velocity - self.velocity) * fraction;
        // At rest it is zero, not ever smaller: processors are slow with subnormal numbers.
        self.velocity = self.velocity.zip_map(&limits.velocity_max, |v, most| {
            if v.abs() < VELOCITY_REST { 0.0 } else { v.clamp(-most, most) }
        });
    }
}

/// A reference that is slower does not move [rad/s or m/s].
const VELOCITY_REST: f64 = 1e-12;

/// The acceleration that brings the reference to rest: every joint arrives at zero together, the
/// hardest-braked one with `fraction` of its largest acceleration.
#[must_use]
pub fn braking<const N: usize>(
    velocity: &SVector<f64, N>,
    limits: &JointLimits<N>,
    fraction: f64,
    dt: f64,
) -> SVector<f64, N> {
    let longest = velocity
        .iter()
        .zip(limits.acceleration_max.iter())
        .map(|(v, a)| v.abs() / (a * fraction))
        .fold(dt, f64::max);
    velocity * (-1.0 / longest)
}

/// Torques of a command.
#[derive(Debug, Clone, Copy)]
pub struct Torques<const N: usize> {
    /// Without gravity \[N m or N\].
    pub motion: SVector<f64, N>,
    /// What holds the arm against gravity \[N m or N\].
    pub gravity: SVector<f64, N>,
    /// Accelerations that they are to cause \[rad/s² or m/s²\].
    pub wanted: SVector<f64, N>,
    /// Whether the limits cut them.
    pub saturated: bool,
}

/// Inverse dynamics with an impedance around the reference:
/// τ = M(q) (q̈_c + D (q̇_c − q̇) + K (q_c − q) + c) + h(q, q̇), gravity apart, the sum within the limits.
///
/// * `compensation`  c, what resists a push \[rad/s² or m/s²\]
///
/// Hot path: no allocation.
#[must_use]
#[expect(clippy::too_many_arguments, reason = "what a command consists of")]
pub fn torques<const N: usize>(
    chain: &Chain<N>,
    limits: &JointLimits<N>,
    impedance: &Impedance,
    gravity_m_s2: DVec3,
    state: &JointState<N>,
    reference: &Reference<N>,
    acceleration: &SVector<f64, N>,
    compensation: &SVector<f64, N>,
) -> Torques<N> {
    let feedback = (reference.velocity - state.velocity) * impedance.damping_1_s
        + (reference.position - state.position) * impedance.stiffness_1_s2;
    // A reference far from the arm pulls no harder than the arm may accelerate.
    let bounded = feedback.zip_map(&limits.acceleration_max, |f, most| f.clamp(-most, most));
    let wanted = acceleration + bounded + compensation;
    let total = inverse_dynamics(chain, &state.position, &state.velocity, &wanted, gravity_m_s2);
    let gravity = limits.effort(&gravity_torques(chain, &state.position, gravity_m_s2));
    let permitted = limits.effort(&total);
    Torques { motion: permitted - gravity, gravity, wanted, saturated: permitted != total }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    fn limits() -> JointLimits<2> {
        JointLimits {
            position_lower: Vector2::repeat(-3.0),
            position_upper: Vector2::repeat(3.0),
            velocity_max: Vector2::repeat(2.0),
            acceleration_max: Vector2::new(10.0, 20.0),
            effort_max: Vector2::repeat(100.0),
            position_end: [Vector2::repeat(-3.1), Vector2::repeat(3.1)],
        }
    }

    #[test]
    fn braking_ends_at_rest_in_bounded_time_on_a_straight_line() {
        let limits = limits();
        let start = Vector2::new(1.5, -1.0);
        let mut reference = Reference { position: Vector2::zeros(), velocity: start };
        let dt = 1e-3;
        let bound = (1.5 / (10.0 * 0.5) / dt) as usize + 2;
        for _ in 0..bound {
            let a = braking(&reference.velocity, &limits, 0.5, dt);
            assert!(a[0].abs() <= 5.0 + 1e-9 && a[1].abs() <= 10.0 + 1e-9);
            reference.integrate(&a, dt);
            let cross = reference.velocity[0] * start[1] - reference.velocity[1] * start[0];
            assert!(cross.abs() < 1e-9);
        }
        assert_eq!(reference.velocity, Vector2::zeros());
    }

    #[test]
    fn reference_gives_way_to_the_measured_state() {
        let measured = JointState { position: Vector2::new(0.1, 0.2), velocity: Vector2::zeros() };
        let mut reference =
            Reference { position: Vector2::zeros(), velocity: Vector2::new(0.5, 0.0) };
        for _ in 0..2000 {
            reference.follow(&measured, &limits(), 0.1, 1e-3);
        }
        assert!((reference.position - measured.position).norm() < 1e-6);
        assert!(reference.velocity.norm() < 1e-6);
        for _ in 0..2000 {
            reference.follow(&measured, &limits(), 0.1, 1e-3);
        }
        assert_eq!(reference.velocity, Vector2::zeros());
    }
}
