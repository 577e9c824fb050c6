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
    pub fn from_rotation(position: DVec3, rotation: &DMat3) -> Self {
        Self { position, orientation: DQuat::from_mat3(rotation) }
    }

    /// X_AC = X_AB X_BC.
    #[must_use]
    pub fn compose(&self, other: &Self) -> Self {
        Self {
            position: self.position + self.orientation * other.position,
            orientation: self.orientation * other.orientation,
        }
    }

    /// X_BA from X_AB.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let orientation = self.orientation.conjugate();
        Self { position: -(orientation * self.position), orientation }
    }

    /// p_A of a point from its p_B \[m\].
    #[must_use]
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.position + self.orientation * point
    }

    /// Rotation vector of `self` relative to `other`, expressed in the common base \[rad\].
    #[must_use]
    pub fn rotation_from(&self, other: &Self) -> DVec3 {
        rotation_vector(self.orientation * other.orientation.conjugate())
    }

    /// The pose at `fraction` of the way from `self` to `other`: positions on the straight line,
    /// orientations on the geodesic.
    #[must_use]
    pub fn interpolate(&self, other: &Self, fraction: f64) -> Self {
        let rotation = DQuat::from_scaled_axis(other.rotation_from(self) * fraction);
        Self {
            position: self.position.lerp(other.position, fraction),
            orientation: rotation * self.orientation,
        }
    }

    /// Whether every number of it is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.orientation.is_finite()
    }
}

impl From<Pose> for Isometry3<f64> {
    fn from(pose: Pose) -> Self {
        let translation = Translation3::from(nalgebra::Vector3::from(pose.position));
        let quaternion = nalgebra::Quaternion::from(pose.orientation);
        Self::from_parts(translation, UnitQuaternion::new_unchecked(quaternion))
    }
}

impl From<Isometry3<f64>> for Pose {
    fn from(isometry: Isometry3<f64>) -> Self {
        Self {
            position: isometry.translation.vector.into(),
            orientation: (*isometry.rotation.quaternion()).into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(axis: [f64; 3], position: [f64; 3]) -> Pose {
        Pose {
            position: position.into(),
            orientation: DQuat::from_scaled_axis(DVec3::from_array(axis)),
        }
    }

    /// The oracle is nalgebra's isometry.
    #[test]
    fn composition_inverse_and_points_are_those_of_an_isometry() {
        let a = pose([0.3, -1.1, 0.4], [0.5, -0.2, 1.0]);
        let b = pose([-2.0, 0.1, 0.7], [-1.0, 0.3, 0.2]);
        let (ia, ib) = (Isometry3::from(a), Isometry3::from(b));
        let close = |mine: Pose, theirs: Isometry3<f64>| {
            let theirs = Pose::from(theirs);
            assert!((mine.position - theirs.position).length() < 1e-14);
            assert!(mine.rotation_from(&theirs).length() < 1e-14);
        };
        close(a.compose(&b), ia * ib);
        close(a.inverse(), ia.inverse());
        close(a.interpolate(&b, 0.3), ia.lerp_slerp(&ib, 0.3));
        let point = DVec3::new(0.1, 0.2, -0.3);
        let theirs: DVec3 =
            (ia * nalgebra::Point3::from(nalgebra::Vector3::from(point))).coords.into();
        assert!((a.transform_point(point) - theirs).length() < 1e-14);
    }
}
