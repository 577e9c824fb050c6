//! Triangles, which all shapes become.

use glam::DVec3;

/// Most triangles of a mesh: the finest of vendors' have some 200 000.
pub(crate) const TRIANGLES_MAX: usize = 1_000_000;

/// A triangle, its corners in the frame of the mesh or of the link \[m\].
pub(crate) type Triangle = [DVec3; 3];

/// Whether a triangle has an area, of more than 5·10⁻¹³ m².
pub(crate) fn has_area([a, b, c]: &Triangle) -> bool {
    (*b - *a).cross(*c - *a).length_squared() > 1e-24
}

/// Least and largest coordinates.
pub(crate) fn ends(points: impl IntoIterator<Item = DVec3>) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points.into_iter().fold(none, |(low, high), point| (low.min(point), high.max(point)))
}
