//! A frame with its motion.

use glam::{DQuat, DVec3};

use crate::jet::{Jet, Vec3};
use crate::pose::Pose;
use crate::vectors::{SpatialAcceleration, Twist};

/// X, V and A of a frame, all expressed in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovingPose {
    /// X_WF.
    pub pose: Pose,
    /// V_WF.
    pub velocity: Twist,
    /// A_WF.
    pub acceleration: SpatialAcceleration,
}

impl MovingPose {
    /// A frame at rest.
    #[must_use]
    #[inline]
    pub fn at_rest(pose: Pose) -> Self {
        Self { pose, velocity: Twist::ZERO, acceleration: SpatialAcceleration::ZERO }
    }

    /// The motion of a point fixed to the frame, `r` from its origin, expressed in the world \[m\]:
    /// p + r,  v + ω × r,  a + α × r + ω × (ω × r).
    #[must_use]
    #[inline]
    pub fn fixed_point(&self, r: DVec3) -> Vec3<Jet> {
        let rotating = self.fixed_direction(r);
        Vec3::moving(
            self.pose.position + r,
            self.velocity.linear + rotating.first(),
            self.acceleration.linear + rotating.second(),
        )
    }

    /// The motion of a direction d fixed to the frame, expressed in the world:
    /// d,  ω × d,  α × d + ω × (ω × d).
    #[must_use]
    #[inline]
    pub fn fixed_direction(&self, direction: DVec3) -> Vec3<Jet> {
        let (w, alpha) = (self.velocity.angular, self.acceleration.angular);
        let first = w.cross(direction);
        Vec3::moving(direction, first, alpha.cross(direction) + w.cross(first))
    }

    /// The motion of a frame G fixed to this one: X_WG = X_WF X_FG, and V_WG, A_WG at its origin.
    #[must_use]
    #[inline]
    pub fn compose(&self, x_fg: &Pose) -> Self {
        let origin = self.fixed_point(self.pose.orientation * x_fg.position);
        Self {
            pose: self.pose.compose(x_fg),
            velocity: Twist { linear: origin.first(), ..self.velocity },
            acceleration: SpatialAcceleration { linear: origin.second(), ..self.acceleration },
        }
    }
}

impl Pose {
    /// The pose after `dt_s` \[s\] with a constant velocity, expressed in A:
    /// p + v dt and exp(ω dt) q.
    #[must_use]
    #[inline]
    pub fn advanced(&self, velocity: &Twist, dt_s: f64) -> Self {
        let rotation = DQuat::from_scaled_axis(velocity.angular * dt_s);
        Self {
            position: self.position + velocity.linear * dt_s,
            orientation: (rotation * self.orientation).normalize(),
        }
    }
}
