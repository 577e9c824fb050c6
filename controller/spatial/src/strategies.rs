//! What properties of poses and vectors are tested on.

use glam::DVec3;
use proptest::prelude::*;

/// A vector in the cube of half the side `size` around 0.
pub fn vector(size: f64) -> impl Strategy<Value = DVec3> {
    [-size..size, -size..size, -size..size].prop_map(DVec3::from)
}
