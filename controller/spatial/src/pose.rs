//! Poses: elements of SE(3).

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use crate::rotation::rotation_vector;

/// X_AB: position \[m\] and orientation (unit quaternion) of frame B in frame A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// p_AB: origin of B \[m\].
    pub position: DVec3,
    /// R_AB.
    pub orientation: DQuat,
}

impl Pose {
    /// B is A.
    pub const IDENTITY: Self = Self { position: DVec3::ZERO, orientation: DQuat::IDENTITY };
    /// No pose at all: equal to none, not even to itself.
    pub const UNDEFINED: Self = Self { position: DVec3::NAN, orientation: DQuat::NAN };

    /// X_AB from p_AB and the columns of R_AB.
    #[must_use]
    #[inline]
    pub fn from_rotation(position: DVec3, rotation: &DMat3) -> Self {
        Self { position, orientation: DQuat::from_mat3(rotation) }
    }

    /// X_AC = X_AB X_BC:  p = p_AB + R_AB p_BC,  R = R_AB R_BC.
    #[must_use]
    #[inline]
    pub fn compose(&self, other: &Self) -> Self {
        Self {
            position: self.position + self.orientation * other.position,
            orientation: self.orientation * other.orientation,
        }
    }

    /// X_BA from X_AB:  p = −R_ABᵀ p_AB,  R = R_ABᵀ.
    #[must_use]
    #[inline]
    pub fn inverse(&self) -> Self {
        let orientation = self.orientation.conjugate();
        Self { position: -(orientation * self.position), orientation }
    }

    /// p_A of a point from its p_B \[m\]:  p_A = p_AB + R_AB p_B.
    #[must_use]
    #[inline]
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.position + self.orientation * point
    }

    /// log(q₂ q₁⁻¹) with q₂ of `self` and q₁ of `other`: the rotation vector from `other` to `self`,
    /// expressed in A \[rad\].
    #[must_use]
    #[inline]
    pub fn rotation_from(&self, other: &Self) -> DVec3 {
        rotation_vector(self.orientation * other.orientation.conjugate())
    }

    /// The pose at `fraction` of the path from `self` to `other`: positions on the straight line,
    /// orientations on the geodesic.
    ///
    /// p = p₁ + t (p₂ − p₁),  q = exp(t log(q₂ q₁⁻¹)) q₁
    #[must_use]
    #[inline]
    pub fn interpolate(&self, other: &Self, fraction: f64) -> Self {
        Self {
            position: self.position.lerp(other.position, fraction),
            orientation: self.orientation.slerp(other.orientation, fraction),
        }
    }

    /// Whether every number of it is finite.
    #[must_use]
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.orientation.is_finite()
    }
}

impl From<Pose> for Isometry3<f64> {
    #[inline]
    fn from(pose: Pose) -> Self {
        let translation = Translation3::from(nalgebra::Vector3::from(pose.position));
        let quaternion = nalgebra::Quaternion::from(pose.orientation);
        Self::from_parts(translation, UnitQuaternion::new_unchecked(quaternion))
    }
}

impl From<Isometry3<f64>> for Pose {
    #[inline]
    fn from(isometry: Isometry3<f64>) -> Self {
        Self {
            position: isometry.translation.vector.into(),
            orientation: (*isometry.rotation.quaternion()).into(),
        }
    }
}
