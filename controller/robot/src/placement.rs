//! Poses with their rotation as a matrix: what the recursions multiply with.

use glam::{DMat3, DVec3};
use tprmp_spatial::Pose;

/// X_AB with R_AB as a matrix. At the public face of this crate it is a [`Pose`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placement {
    /// R_AB.
    pub(crate) rotation: DMat3,
    /// p_AB [m].
    pub(crate) position: DVec3,
}

impl Placement {
    /// B is A.
    pub(crate) const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, position: DVec3::ZERO };
    /// Not yet known.
    pub(crate) const UNDEFINED: Self = Self { rotation: DMat3::NAN, position: DVec3::NAN };

    /// X_AC = X_AB X_BC.
    #[inline(always)]
    pub(crate) fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: self.rotation * other.rotation,
            position: self.transform_point(other.position),
        }
    }

    /// p_A of a point from its p_B [m].
    #[inline(always)]
    pub(crate) fn transform_point(&self, point: DVec3) -> DVec3 {
        self.position + self.rotation * point
    }

    pub(crate) fn of(pose: &Pose) -> Self {
        Self { rotation: DMat3::from_quat(pose.orientation), position: pose.position }
    }

    pub(crate) fn pose(&self) -> Pose {
        Pose::from_rotation(self.position, &self.rotation)
    }
}
