//! The motion of a point of a mechanism.

use glam::DVec3;
use nalgebra::{ArrayStorage, SMatrix, Vector3};

/// The motion of a point fixed to a body with N coordinates q, expressed in the world:
/// ẋ = J q̇ and ẍ = J q̈ + J̇q̇.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointMotion<const N: usize> {
    /// x \[m\].
    pub position: DVec3,
    /// ẋ \[m/s\].
    pub velocity: DVec3,
    /// J, 3×N \[m/rad or 1\].
    pub jacobian: SMatrix<f64, 3, N>,
    /// J̇q̇ \[m/s²\].
    pub drift: Vector3<f64>,
}

impl<const N: usize> PointMotion<N> {
    /// Not yet known: every number is NaN.
    pub const UNDEFINED: Self = Self {
        position: DVec3::NAN,
        velocity: DVec3::NAN,
        jacobian: SMatrix::from_array_storage(ArrayStorage([[f64::NAN; 3]; N])),
        drift: Vector3::new(f64::NAN, f64::NAN, f64::NAN),
    };
}
