//! Policies on part of a pose: position and one angle, or the orientation alone.
//!
//! Such a policy is one on poses, evaluated at the pose x̂ = π(x) that keeps of x what the policy moves, and pulled back
//! through π. All x̂ are of one family: of R³×S¹ the poses that are turned from a reference about z alone, of S³
//! those at the origin. The policy, too, was learned on this family, and its frames are projected onto families of their own.
//!
//! ```text
//! q q̄⁻¹ = (w, x, y, z),   θ = 2 atan2(z, w),   R̂ = exp(θ e_z) q̄                R³×S¹
//! θ̇ = jᵀω,   j = (α, β, 1),   α = (wy + zx)/n,   β = (zy − wx)/n,   n = w² + z²
//! ```
//!
//! So twist and acceleration of x̂ are A v and A a + b with b = Ȧ v, and the leaf is pulled back as any other one. A
//! potential of x̂ is one of x: all of the policy's proof holds. What π forgets is moved by nothing here: the tilt of a tool, for
//! R³×S¹, is for the arm or another leaf to keep. Where the tool is tilted by 180°, θ is not defined, and nothing
//! that comes out is finite.

use glam::{DQuat, DVec3};
use nalgebra::{Matrix6, Vector6};
use tprmp_spatial::{MovingPose, Pose, Twist};

use crate::natural::Natural;
use crate::policy::value::{FRAME_CAPACITY, SkillValue};

/// What of poses a policy moves.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a policy has one, and it lies close together")]
pub enum Restriction {
    /// R³×S¹: the position, and the angle about z of the world.
    Yaw {
        /// The tool where that angle is zero, whatever its tilt.
        tool: DQuat,
        /// The same of each frame.
        frames: [DQuat; FRAME_CAPACITY],
    },
    /// S³: the orientation.
    Rotation,
}

/// A tool as a restricted policy sees it.
pub(super) struct Projected {
    /// x̂ and its twist.
    pub pose: Pose,
    pub velocity: Twist,
    /// A.
    jacobian: Matrix6<f64>,
    /// b.
    drift: Vector6<f64>,
}

/// An angle about z with its derivatives.
struct Yaw {
    /// θ \[rad\].
    angle: f64,
    /// j.
    jacobian: DVec3,
    /// j̇ᵀω \[rad/s²\].
    drift: f64,
}

impl Yaw {
    /// Of an orientation against a reference, with its angular velocity in the world \[rad/s\].
    fn of(orientation: DQuat, reference: DQuat, omega: DVec3) -> Self {
        let q = orientation * reference.conjugate();
        // q̇ = ½ ω q.
        let rate = DQuat::from_xyzw(omega.x, omega.y, omega.z, 0.0) * q * 0.5;
        let n = q.w * q.w + q.z * q.z;
        let n_rate = 2.0 * (q.w * rate.w + q.z * rate.z);
        let (alpha, beta) = ((q.w * q.y + q.z * q.x) / n, (q.z * q.y - q.w * q.x) / n);
        let first = rate.w * q.y + q.w * rate.y + rate.z * q.x + q.z * rate.x;
        let second = rate.z * q.y + q.z * rate.y - rate.w * q.x - q.w * rate.x;
        Self {
            angle: 2.0 * q.z.atan2(q.w),
            jacobian: DVec3::new(alpha, beta, 1.0),
            drift: ((first - alpha * n_rate) * omega.x + (second - beta * n_rate) * omega.y) / n,
        }
    }

    fn orientation(&self, reference: DQuat) -> DQuat {
        DQuat::from_rotation_z(self.angle) * reference
    }
}

/// An orientation as if it were turned from a reference about z alone: R̂ of R³×S¹.
#[must_use]
pub fn upright(orientation: DQuat, reference: DQuat) -> DQuat {
    Yaw::of(orientation, reference, DVec3::ZERO).orientation(reference)
}

impl Restriction {
    /// A frame as the policy sees it; `index` is its place among the policy's frames.
    fn frame(&self, index: usize, frame: &MovingPose) -> MovingPose {
        match self {
            Self::Yaw { frames, .. } => {
                let mut seen = *frame;
                let (reference, omega) = (frames[index], frame.velocity.angular);
                let yaw = Yaw::of(frame.pose.orientation, reference, omega);
                seen.pose.orientation = yaw.orientation(reference);
                seen.velocity.angular = DVec3::Z * yaw.jacobian.dot(omega);
                let acceleration = yaw.jacobian.dot(frame.acceleration.angular) + yaw.drift;
                seen.acceleration.angular = DVec3::Z * acceleration;
                seen
            }
            Self::Rotation => {
                let mut seen = *frame;
                seen.pose.position = DVec3::ZERO;
                seen.velocity.linear = DVec3::ZERO;
                seen.acceleration.linear = DVec3::ZERO;
                seen
            }
        }
    }

    /// The frames as the policy sees them, at most [`FRAME_CAPACITY`], the others at rest at the origin.
    pub(super) fn frames(&self, frames: &[MovingPose]) -> [MovingPose; FRAME_CAPACITY] {
        let mut seen = [MovingPose::at_rest(Pose::IDENTITY); FRAME_CAPACITY];
        for (i, (seen, frame)) in seen.iter_mut().zip(frames).enumerate() {
            *seen = self.frame(i, frame);
        }
        seen
    }

    /// The tool as the policy sees it.
    pub(super) fn tool(&self, pose: &Pose, velocity: &Twist) -> Projected {
        let mut jacobian = Matrix6::identity();
        let mut drift = Vector6::zeros();
        let (mut seen, mut twist) = (*pose, *velocity);
        match self {
            Self::Yaw { tool, .. } => {
                let yaw = Yaw::of(pose.orientation, *tool, velocity.angular);
                seen.orientation = yaw.orientation(*tool);
                twist.angular = DVec3::Z * yaw.jacobian.dot(velocity.angular);
                for (i, entry) in yaw.jacobian.to_array().into_iter().enumerate() {
                    for row in 3..5 {
                        jacobian[(row, 3 + i)] = 0.0;
                    }
                    jacobian[(5, 3 + i)] = entry;
                }
                drift[5] = yaw.drift;
            }
            Self::Rotation => {
                (seen.position, twist.linear) = (DVec3::ZERO, DVec3::ZERO);
                jacobian.fixed_view_mut::<3, 3>(0, 0).fill(0.0);
            }
        }
        Projected { pose: seen, velocity: twist, jacobian, drift }
    }

    /// Of all poses that the policy does not tell from this one, the nearest to the tool.
    pub(crate) fn nearest(&self, pose: &Pose, tool: &Pose) -> Pose {
        match self {
            Self::Yaw { tool: reference, .. } => {
                let angle = |q| Yaw::of(q, *reference, DVec3::ZERO).angle;
                let turned = angle(pose.orientation) - angle(tool.orientation);
                let orientation = DQuat::from_rotation_z(turned) * tool.orientation;
                Pose { orientation, ..*pose }
            }
            Self::Rotation => Pose { position: tool.position, ..*pose },
        }
    }
}

impl Projected {
    /// Pulls what the policy is evaluated to at x̂ back to x.
    pub(super) fn pulled_back(&self, value: &SkillValue) -> SkillValue {
        let mut natural = Natural::zero();
        natural.add_pullback(&value.natural, &self.jacobian, &self.drift);
        let mut phase = value.phase;
        // s̈ = free − couplingᵀ (A a + b)
        phase.free -= phase.coupling.dot(&self.drift);
        phase.coupling = self.jacobian.transpose() * phase.coupling;
        SkillValue { natural, energy: value.energy, phase }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tprmp_spatial::SpatialAcceleration;

    fn vector(most: f64) -> impl Strategy<Value = DVec3> {
        [-most..most, -most..most, -most..most].prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn the_seen_twist_and_acceleration_are_derivatives_of_the_seen_pose(
            reference in vector(3.0),
            tilt in vector(1.0),
            velocity in vector(2.0),
            acceleration in vector(4.0),
        ) {
            let tool = DQuat::from_scaled_axis(reference);
            let restriction = Restriction::Yaw { tool, frames: [tool; FRAME_CAPACITY] };
            let at = DQuat::from_scaled_axis(tilt) * tool;
            // ω of exp(vt + ½at²) q differs from v + at by a third of v × a t²/4: not to second order at t = 0.
            let body = |t: f64| MovingPose {
                pose: Pose {
                    orientation: DQuat::from_scaled_axis(velocity * t + acceleration * (0.5 * t * t)) * at,
                    ..Pose::IDENTITY
                },
                velocity: Twist { linear: DVec3::X, angular: velocity + acceleration * t },
                acceleration: SpatialAcceleration { linear: DVec3::Y, angular: acceleration },
            };
            let now = body(0.0);
            let seen = restriction.tool(&now.pose, &now.velocity);
            let frame = restriction.frame(0, &now);
            let h = 1e-5;
            let angle = |t: f64| Yaw::of(body(t).pose.orientation, tool, DVec3::ZERO).angle;
            let rate = |t: f64| restriction.frame(0, &body(t)).velocity.angular.z;
            let wrapped = |d: f64| (d + core::f64::consts::PI).rem_euclid(core::f64::consts::TAU) - core::f64::consts::PI;
            prop_assert!((wrapped(angle(h) - angle(-h)) / (2.0 * h) - seen.velocity.angular.z).abs() < 1e-6);
            prop_assert!(((rate(h) - rate(-h)) / (2.0 * h) - frame.acceleration.angular.z).abs() < 1e-5);
            prop_assert_eq!(seen.velocity, frame.velocity);
            let a = seen.jacobian * Vector6::from(now.acceleration) + seen.drift;
            prop_assert!((a - Vector6::from(frame.acceleration)).norm() < 1e-12);
            // Twice projected is once projected, and the nearest pose is told from none of its family.
            prop_assert!(upright(seen.pose.orientation, tool).angle_between(seen.pose.orientation) < 1e-6);
            let nearest = restriction.nearest(&seen.pose, &now.pose).orientation;
            prop_assert!(nearest.angle_between(at) < 1e-6);
        }
    }
}
