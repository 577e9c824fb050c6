//! From the reference motion to torques: inverse dynamics and the impedance around the reference
//! [thesis section 4.4].

use glam::DVec3;
use nalgebra::SVector;
use tprmp_model::controller_config::{Actuators, Impedance};
use tprmp_robot::{Chain, Payload, gravity_torques_with, inverse_dynamics_with};

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

/// What the joints have beside the links, zero for servos, which care for it themselves.
#[derive(Debug, Clone, Copy)]
pub struct Drives<const N: usize> {
    /// Inertia of the rotors \[kg m² or kg\].
    pub rotor_inertia: SVector<f64, N>,
    /// Friction that does not depend on the speed \[N m or N\].
    pub coulomb_friction: SVector<f64, N>,
    /// Friction in proportion to the speed \[N m s/rad or N s/m\].
    pub viscous_friction: SVector<f64, N>,
    /// Wanted speed from which the whole of the Coulomb friction is compensated \[rad/s or m/s\].
    pub friction_speed: f64,
}

impl<const N: usize> Drives<N> {
    /// Those of a configuration.
    #[must_use]
    pub fn new(actuators: &Actuators) -> Self {
        let Actuators::Torque(drives) = actuators else {
            let none = SVector::zeros();
            return Self {
                rotor_inertia: none,
                coulomb_friction: none,
                viscous_friction: none,
                friction_speed: 1.0,
            };
        };
        Self {
            rotor_inertia: SVector::from_column_slice(&drives.rotor_inertia),
            coulomb_friction: SVector::from_column_slice(&drives.coulomb_friction),
            viscous_friction: SVector::from_column_slice(&drives.viscous_friction),
            friction_speed: drives.friction_speed,
        }
    }

    /// What friction takes from a joint that moves at the wanted velocity v \[N m or N\]:
    /// F·(v/v_F within ±1) + b v.
    ///
    /// It follows what is wanted, not what is measured, and is never more than the friction: it makes no
    /// joint move, and does not change its sign with the noise of a measurement.
    #[must_use]
    pub fn friction(&self, wanted_velocity: &SVector<f64, N>) -> SVector<f64, N> {
        SVector::from_fn(|i, _| {
            let v = wanted_velocity[i];
            let slides = (v / self.friction_speed).clamp(-1.0, 1.0);
            self.coulomb_friction[i] * slides + self.viscous_friction[i] * v
        })
    }
}

/// How a robot turns accelerations into torques.
#[derive(Debug, Clone, Copy)]
pub struct Tracking<const N: usize> {
    /// Feedback.
    pub impedance: Impedance,
    /// The joints.
    pub drives: Drives<N>,
    /// In the base frame \[m/s²\].
    pub gravity_m_s2: DVec3,
    /// What the gripper holds.
    pub payload: Payload,
}

impl<const N: usize> Tracking<N> {
    /// The accelerations by which the reference gives way to the measured state, with the time constant T:
    /// c = (2/(T + dt)) (q̇ − q̇_c) + (q − q_c)/(T + dt)²  \[rad/s² or m/s²\].
    ///
    /// A push moves the reference along, and saturation winds nothing up.
    #[must_use]
    pub fn yielding(
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

    /// The velocity that the arm is asked for: the reference's, without what it yields by, q̇_r \[rad/s or m/s\].
    #[must_use]
    pub fn wanted_velocity(
        &self,
        reference: &JointMotion<N>,
        state: &JointState<N>,
        yields: bool,
    ) -> SVector<f64, N> {
        if !yields {
            return reference.velocity;
        }
        let offset = reference.position - state.position;
        reference.velocity + offset / self.impedance.reference_time_constant_s
    }

    /// (M(q) + R) a: what links and rotors need for an acceleration \[N m or N\].
    #[must_use]
    pub fn inertial(
        &self,
        chain: &Chain<N>,
        position: &SVector<f64, N>,
        acceleration: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        let (payload, rest) = (&self.payload, &SVector::zeros());
        inverse_dynamics_with(chain, payload, position, rest, acceleration, DVec3::ZERO)
            + self.drives.rotor_inertia.component_mul(acceleration)
    }

    /// Inverse dynamics with an impedance around the reference:
    /// τ = (M(q) + R) (a + d) + B[(M(q) + R) (2ζω (q̇_r − q̇) + ω² (q_c − q))] + h(q, q̇) + f(q̇_r) + l, gravity
    /// apart, the sum within the limits.
    ///
    /// * `state`  q, q̇
    /// * `yielded`  what the limits left of c, by which the reference follows the arm: it is no acceleration
    ///   that the arm is asked for, a = q̈_c − c; and q̇_r is the reference's velocity without it
    /// * `compensation`  d, what resists a push \[rad/s² or m/s²\]
    /// * `load`  l, what cancels a load \[N m or N\]
    ///
    /// B bounds what stiffness and damping may exert by a fraction of the effort, and not by the inertia of the
    /// links: that of a wrist is so small that it would overcome no friction. f is the friction.
    ///
    /// Hot path: no allocation.
    #[must_use]
    pub fn torques(
        &self,
        (chain, limits): (&Chain<N>, &JointLimits<N>),
        state: &JointState<N>,
        reference: &JointMotion<N>,
        yielded: Option<&SVector<f64, N>>,
        compensation: &SVector<f64, N>,
        load: &SVector<f64, N>,
    ) -> Torques<N> {
        let Self { impedance, gravity_m_s2, payload, .. } = *self;
        let velocity = self.wanted_velocity(reference, state, yielded.is_some());
        let (w, z) = (impedance.natural_frequency_rad_s, impedance.damping_ratio);
        let pull = (velocity - state.velocity) * (2.0 * z * w)
            + (reference.position - state.position) * (w * w);
        let mut acceleration = reference.acceleration + compensation;
        if let Some(yielded) = yielded {
            acceleration -= yielded;
        }
        let (q, qd) = (&state.position, &state.velocity);
        let feedback = self.inertial(chain, q, &pull);
        let most = limits.effort_max * impedance.feedback_fraction;
        let bounded = feedback.zip_map(&most, |f, most| f.clamp(-most, most));
        let total = inverse_dynamics_with(chain, &payload, q, qd, &acceleration, gravity_m_s2)
            + self.drives.rotor_inertia.component_mul(&acceleration)
            + bounded
            + self.drives.friction(&velocity)
            + load;
        let Torques { gravity, .. } = self.resting((chain, limits), q);
        let permitted = limits.effort(&total);
        Torques {
            motion: permitted - gravity,
            gravity,
            wanted: Some(acceleration + pull),
            saturated: permitted != total || bounded != feedback,
        }
    }

    /// What holds the arm at `position` against gravity, and nothing beside it.
    #[must_use]
    pub fn resting(
        &self,
        (chain, limits): (&Chain<N>, &JointLimits<N>),
        position: &SVector<f64, N>,
    ) -> Torques<N> {
        let gravity = gravity_torques_with(chain, &self.payload, position, self.gravity_m_s2);
        let gravity = limits.effort(&gravity);
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SVector;
    use tprmp_model::controller_config::{self, ControllerConfig};

    const N: usize = 6;
    type Joints = SVector<f64, N>;

    /// The shipped UR5, with joints as real ones.
    fn real() -> (ControllerConfig, Chain<N>) {
        let ur5 = concat!(env!("CARGO_MANIFEST_DIR"), "/../config/controllers/ur5_pick.ron");
        let config = controller_config::read_with(ur5.as_ref(), |config| {
            let Actuators::Torque(drives) = &mut config.robot.actuators else { unreachable!() };
            drives.rotor_inertia = vec![0.1; N];
            drives.coulomb_friction = vec![1.0; N];
            drives.viscous_friction = vec![0.5; N];
        })
        .unwrap();
        let chain = Chain::from_urdf(&config.robot.urdf, config.robot.selection()).unwrap();
        (config, chain)
    }

    fn tracking(config: &ControllerConfig) -> Tracking<N> {
        Tracking {
            impedance: config.impedance,
            drives: Drives::new(&config.robot.actuators),
            gravity_m_s2: config.robot.gravity_m_s2.into(),
            payload: Payload::NONE,
        }
    }

    #[test]
    fn friction_is_compensated_along_the_wanted_motion_and_never_exceeded() {
        let (config, _) = real();
        let drives = tracking(&config).drives;
        let mut wanted = Joints::zeros();
        (wanted[0], wanted[1], wanted[2]) = (0.0005, -0.2, 0.001);
        let friction = drives.friction(&wanted);
        assert!((friction[0] - 0.50025).abs() < 1e-12, "half of it at half the speed");
        assert!((friction[1] + 1.1).abs() < 1e-12);
        assert!((friction[2] - 1.0005).abs() < 1e-12);
        assert_eq!(friction[3], 0.0, "a joint that is to rest is left to its friction");
    }

    /// A joint of a wrist, 0.1 rad from its reference, that friction holds: today's gains by frequency and
    /// damping, in the inertia of link and rotor.
    #[test]
    fn feedback_is_bounded_by_the_effort_and_not_by_the_inertia_of_the_links() {
        let (config, chain) = real();
        let (tracking, limits) = (tracking(&config), JointLimits::new(&chain, &config.robot));
        let position = Joints::from([-2.7, -1.6, 1.6, -1.6, -1.6, 0.4]);
        let state = JointState { position, velocity: Joints::zeros() };
        let none = Joints::zeros();
        let at = |offset: f64| {
            let mut reference = JointMotion::at_rest(position);
            reference.position[5] += offset;
            tracking.torques((&chain, &limits), &state, &reference, None, &none, &none)
        };
        let torque = at(0.1).motion[5];
        let stiffness = config.impedance.natural_frequency_rad_s.powi(2) * (0.1 + 1.7e-4);
        assert!((torque - 0.1 * stiffness).abs() < 0.01, "{torque}");
        let most = limits.effort_max[5] * config.impedance.feedback_fraction;
        let far = at(100.0);
        assert!((far.motion[5] - most).abs() < 1e-9 && far.saturated);
        assert!(!at(0.1).saturated);
    }

    #[test]
    fn rotors_weigh_and_a_servo_has_none() {
        let (config, chain) = real();
        let tracking = tracking(&config);
        let position = Joints::from([-2.7, -1.6, 1.6, -1.6, -1.6, 0.4]);
        let turn = Joints::from([0.0, 0.0, 0.0, 0.0, 0.0, 2.0]);
        let torque = tracking.inertial(&chain, &position, &turn)[5];
        assert!((torque - 2.0 * (0.1 + 1.72e-4)).abs() < 1e-4, "{torque}");
        let servo =
            tprmp_model::controller_config::Servo { lag_s: 0.1, reference_time_constant_s: 0.5 };
        let drives = Drives::<N>::new(&Actuators::PositionServo(servo));
        assert_eq!(drives.friction(&turn) + drives.rotor_inertia, Joints::zeros());
    }
}
