//! How large demonstrations are, and in which units they are fitted.

use glam::DQuat;

use crate::canonical::path::Path;
use crate::demonstration::diagonal;
use crate::skill::Scale;

/// ŷ = s y for positions and rotations of these spans.
pub(crate) fn scales(scale: &Scale, position_m: f64, rotation_rad: f64) -> [f64; 2] {
    [
        scale.span / position_m.max(scale.position_span_min_m),
        scale.span / rotation_rad.max(scale.orientation_span_min_rad),
    ]
}

/// Diagonal of the bounding box of all points along these axes. Those of a frame rotate with the
/// demonstrations: so the span does not depend on how the robot's base frame lies.
pub(crate) fn span<'a>(paths: impl Iterator<Item = &'a Path> + Clone, axes: DQuat) -> f64 {
    let along = axes.conjugate();
    diagonal(paths.flat_map(|path| &path.points).map(|point| along * *point))
}
