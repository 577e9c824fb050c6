//! Where the arm slows down: before a clearance is used up, before a point of it is too fast, and before its joints
//! take too much power.
//!
//! Each of these says how much of it is used. From a fraction on what is wanted fades, and braking takes its place, which
//! is all that is left where all of it is used: where limits conflict the arm brakes.

use nalgebra::SVector;
use tprmp_model::controller_config::PointLimits;
use tprmp_robot::{Chain, Kinematics, forward_kinematics_with_velocity};

use crate::motion::limits::JointLimits;
use crate::motion::profile::JointMotion;

/// From where so much is used the arm brakes.
const BRAKES_FROM: f64 = 0.6;

/// Nothing but braking is left at this fraction of the largest speed: the rest is for what the path does to it while
/// the joints brake.
const SPEED_FRACTION: f64 = 0.85;

/// In how many ticks each limit has slowed the arm down.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Slowed {
    /// A clearance that braking would have used up.
    pub clearance: u64,
    /// `robot.point_limits.speed_max_m_s`.
    pub point_speed: u64,
    /// `robot.point_limits.acceleration_max_m_s2`.
    pub point_acceleration: u64,
    /// `robot.point_limits.power_max_w`.
    pub power: u64,
}

/// What the arm is about to do.
#[derive(Debug, Clone, Copy)]
pub struct Ahead<'a, const N: usize> {
    /// The reference.
    pub motion: &'a JointMotion<N>,
    /// How fast the arm closes clearances \[1/s\].
    pub closing_1_s: f64,
    /// What the joints were asked for last, gravity included \[N m or N\].
    pub torque: SVector<f64, N>,
    /// How hard it brakes, a fraction of the largest acceleration.
    pub deceleration_fraction: f64,
    /// Of a tick \[s\].
    pub dt: f64,
}

/// Decides on how much of what is wanted is left.
#[derive(Debug)]
pub struct Caution<const N: usize> {
    limits: Option<PointLimits>,
    kinematics: Kinematics<N>,
    slowed: Slowed,
}

impl<const N: usize> Caution<N> {
    /// For these limits of points.
    #[must_use]
    pub fn new(limits: Option<PointLimits>) -> Self {
        Self { limits, kinematics: Kinematics::new(), slowed: Slowed::default() }
    }

    /// The limits of points, to be changed smoothly.
    pub fn limits(&mut self) -> Option<&mut PointLimits> {
        self.limits.as_mut()
    }

    /// In how many ticks it has slowed the arm down.
    #[must_use]
    pub fn slowed(&self) -> &Slowed {
        &self.slowed
    }

    /// How much of what is wanted is left beside braking, 0 to 1.
    ///
    /// * Clearance: how fast it closes, times the length of braking.
    /// * Speed: of the fastest point when the acceleration has been taken back, against the largest.
    /// * Power: ∑|τᵢ q̇ᵢ| against the largest.
    ///
    /// Hot path: no allocation.
    pub fn left(&mut self, chain: &Chain<N>, joints: &JointLimits<N>, ahead: &Ahead<'_, N>) -> f64 {
        let motion = ahead.motion;
        let length_s = motion.braking_length_s(joints, ahead.deceleration_fraction);
        let clearance = left(ahead.closing_1_s * length_s);
        self.slowed.clearance += u64::from(clearance < 1.0);
        let Some(limits) = self.limits else { return clearance };
        // q̇ᵢ + q̈ᵢ|q̈ᵢ|/2jᵢ, a tick later.
        let (a, dt) = (&motion.acceleration, ahead.dt);
        let velocity = SVector::from_fn(|i, _| {
            motion.velocity[i] + a[i] * (dt + a[i].abs() / (2.0 * joints.jerk_max[i]))
        });
        let position = motion.position + motion.velocity * dt;
        let mut fastest = self.fastest(chain, &position, &velocity);
        // A joint that its range stops no longer takes back what others do.
        let on = SVector::from_fn(|i, _| {
            let (v, a) = (velocity[i], joints.acceleration_max[i]);
            let end = if v > 0.0 { joints.position_upper[i] } else { joints.position_lower[i] };
            let stops_m = v * v / a + 2.0 * v.abs() * a / joints.jerk_max[i];
            if (end - position[i]).abs() > stops_m { v } else { 0.0 }
        });
        if on != velocity {
            fastest = fastest.max(self.fastest(chain, &position, &on));
        }
        let speed = left(fastest / (SPEED_FRACTION * limits.speed_max_m_s));
        self.slowed.point_speed += u64::from(speed < 1.0);
        let power_w = ahead.torque.component_mul(&motion.velocity).abs().sum();
        let power = left(power_w / limits.power_max_w);
        self.slowed.power += u64::from(power < 1.0);
        clearance.min(speed).min(power)
    }

    /// An acceleration of the joints, scaled so that none of a point, J q̈, is larger than the largest.
    ///
    /// Hot path: no allocation.
    pub fn scaled(
        &mut self,
        chain: &Chain<N>,
        motion: &JointMotion<N>,
        wanted: SVector<f64, N>,
    ) -> SVector<f64, N> {
        let Some(limits) = self.limits else { return wanted };
        // The velocity at q̇ = q̈ in place of its own.
        let most = self.fastest(chain, &motion.position, &wanted);
        if most <= limits.acceleration_max_m_s2 {
            return wanted;
        }
        self.slowed.point_acceleration += 1;
        wanted * (limits.acceleration_max_m_s2 / most)
    }

    /// Speed of the fastest of all joints' origins and the tool \[m/s\].
    fn fastest(
        &mut self,
        chain: &Chain<N>,
        position: &SVector<f64, N>,
        velocity: &SVector<f64, N>,
    ) -> f64 {
        forward_kinematics_with_velocity(chain, position, velocity, &mut self.kinematics);
        let joints = self.kinematics.joint_velocities().map(|twist| twist.linear.length());
        joints.fold(self.kinematics.tool_velocity.linear.length(), f64::max)
    }
}

/// How much of what is wanted is left where a fraction of what is permitted is used.
fn left(used: f64) -> f64 {
    ((1.0 - used) / (1.0 - BRAKES_FROM)).clamp(0.0, 1.0)
}
