//! How far points spread.

use glam::DVec3;

/// Diagonal of the bounding box of points along the coordinate axes \[m\]; without any, 0.
pub fn diagonal(points: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let low = points.clone().reduce(DVec3::min).unwrap_or_default();
    let high = points.reduce(DVec3::max).unwrap_or_default();
    (high - low).length()
}
