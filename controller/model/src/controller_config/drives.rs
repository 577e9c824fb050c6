//! How the joints are driven: rotors, friction and servos, the impedance around the reference, and what
//! resists pushes and loads.

use serde::Deserialize;

use crate::controller_config::check::Check;

/// What the robot makes of a command.
#[derive(Debug, Clone, Deserialize)]
pub enum Actuators {
    /// Its joints exert the commanded torques at once.
    Torque(JointDrives),
    /// Its joints are kept at the commanded positions.
    PositionServo(Servo),
    /// Its joints are kept at the commanded velocities.
    VelocityServo(Servo),
}

/// What joints have beside the links that they move, a number for each.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointDrives {
    /// Inertia of the rotors, times the square of the gears' ratios \[kg m² or kg\].
    pub rotor_inertia: Vec<f64>,
    /// Friction that does not depend on the speed \[N m or N\].
    pub coulomb_friction: Vec<f64>,
    /// Friction in proportion to the speed \[N m s/rad or N s/m\].
    pub viscous_friction: Vec<f64>,
    /// Speed of the wanted motion from which the whole of the Coulomb friction is compensated; below, in
    /// proportion \[rad/s or m/s\].
    pub friction_speed: f64,
}

/// A servo that follows its set point behind a lag of first order: T q̇ = q_c − q.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Servo {
    /// T; 0 for a servo that is where it was told to be \[s\].
    pub lag_s: f64,
    /// In place of `impedance.reference_time_constant_s`: a servo does not give way to a push, and what its lag is
    /// not known by moves the reference, in proportion to 1 over the square of this \[s\].
    pub reference_time_constant_s: f64,
}

/// The impedance with which the policy's acceleration is tracked  [thesis section 4.4].
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Impedance {
    /// ω of a joint around the integrated position: the stiffness is ω² times the inertia of links and
    /// rotors \[rad/s\].
    pub natural_frequency_rad_s: f64,
    /// ζ: the damping is 2ζω times that inertia.
    pub damping_ratio: f64,
    /// Largest torque of stiffness and damping, as a fraction of the effort that may be used.
    pub feedback_fraction: f64,
    /// Time constant with which the integrated state approaches the measured one \[s\].
    pub reference_time_constant_s: f64,
}

/// How fast a push may move the joints. A joint that is disturbed resists once the push would drive it
/// beyond this speed; up to there the impedance yields.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disturbance {
    /// Fraction of the permitted speed that a push may cause.
    pub speed_fraction: f64,
    /// How far the disturbance is thought to go on \[s\].
    pub horizon_s: f64,
    /// Time constant of the observer, about the time from a command to the state that shows it \[s\].
    pub time_constant_s: f64,
    /// Torques that last: of masses that the description does not have, and of friction that nobody
    /// measured; `None` leaves them.
    #[serde(deserialize_with = "Option::deserialize")]
    pub load: Option<Load>,
}

/// An integral of the disturbance that lasts.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Load {
    /// Time constant for a joint that moves: pushes are shorter \[s\].
    pub time_constant_s: f64,
    /// Time constant for a joint that friction keeps from a wanted motion \[s\].
    pub stuck_time_constant_s: f64,
    /// A joint that is slower is stuck \[rad/s or m/s\].
    pub stuck_speed: f64,
    /// Largest torque, as a fraction of the effort that may be used.
    pub effort_fraction: f64,
}

impl Actuators {
    /// The lag of a servo; 0 where there is none \[s\].
    #[must_use]
    pub fn lag_s(&self) -> f64 {
        self.servo().map_or(0.0, |servo| servo.lag_s)
    }

    /// The servo, where there is one.
    #[must_use]
    pub fn servo(&self) -> Option<&Servo> {
        match self {
            Self::Torque(_) => None,
            Self::PositionServo(servo) | Self::VelocityServo(servo) => Some(servo),
        }
    }

    pub(super) fn check(&self, joints: usize, check: &mut Check) {
        match self {
            Self::Torque(drives) => drives.check(joints, check),
            Self::PositionServo(servo) | Self::VelocityServo(servo) => servo.check(check),
        }
    }
}

impl Servo {
    fn check(&self, check: &mut Check) {
        let lag = &self.lag_s;
        check.require((0.0..=0.5).contains(lag), "lag_s", "0 to 0.5 seconds", lag);
        check_reference(self.reference_time_constant_s, check);
    }
}

/// The longest step of the loop is 0.02 s: below a fourth of it the reference would oscillate.
fn check_reference(time_s: f64, check: &mut Check) {
    let expected = "at least 0.005 seconds";
    check.require((0.005..=1e6).contains(&time_s), "reference_time_constant_s", expected, &time_s);
}

impl JointDrives {
    fn check(&self, joints: usize, check: &mut Check) {
        for (key, values) in [
            ("rotor_inertia", &self.rotor_inertia),
            ("coulomb_friction", &self.coulomb_friction),
            ("viscous_friction", &self.viscous_friction),
        ] {
            check.require(values.len() == joints, key, "one number for each joint", values);
            values.iter().for_each(|value| check.not_negative(key, *value));
        }
        check.positive("friction_speed", self.friction_speed);
    }
}

impl Impedance {
    pub(super) fn check(&self, check: &mut Check) {
        check.not_negative("natural_frequency_rad_s", self.natural_frequency_rad_s);
        check.not_negative("damping_ratio", self.damping_ratio);
        check.fraction("feedback_fraction", self.feedback_fraction);
        check_reference(self.reference_time_constant_s, check);
    }
}

impl Disturbance {
    pub(super) fn check(&self, check: &mut Check) {
        check.fraction("speed_fraction", self.speed_fraction);
        check.positive("horizon_s", self.horizon_s);
        check.positive("time_constant_s", self.time_constant_s);
        if let Some(load) = &self.load {
            check.within("load", |check| load.check(check));
        }
    }
}

impl Load {
    fn check(&self, check: &mut Check) {
        check.positive("time_constant_s", self.time_constant_s);
        // Faster than what commands and states need to and fro it would oscillate.
        let time = &self.stuck_time_constant_s;
        check.require(
            (0.01..=1e6).contains(time),
            "stuck_time_constant_s",
            "at least 0.01 seconds",
            time,
        );
        check.positive("stuck_speed", self.stuck_speed);
        check.fraction("effort_fraction", self.effort_fraction);
    }
}
