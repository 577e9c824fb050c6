//! How large a data set is beside the thesis': by this all lengths of a protocol scale.
//!
//! Every length, speed, acceleration and force of the experiments is stated for skills of the thesis' size. On
//! other demonstrations it is multiplied by [`scale`]: a tolerance of 1 mm for drawings of 2.6 m is one of
//! 0.02 mm for those of 5 cm. Times, angles and masses stay.

use glam::DVec3;
use tprmp_drawing::quantile;
use tprmp_learner::demonstration::Demonstration;

use crate::experiment::Space;

/// Median size of the thesis' 15 planar skills, and of its pick from above [m]: to the last digit, for with
/// them the scale is one and nothing changes.
const REFERENCE_M: [f64; 2] = [2.620_375_398_003_019_6, 0.434_653_828_467_825_4];

/// Size of a skill: the mean diagonal of the boxes around its demonstrations, each in a box of its own, so that it
/// does not matter how far apart they lie [m].
pub(crate) fn size_m(demonstrations: &[Demonstration]) -> f64 {
    let diagonal = |demonstration: &Demonstration| {
        let points = demonstration.poses.iter().map(|pose| pose.position);
        let [low, high] = bounds(points);
        (high - low).length()
    };
    demonstrations.iter().map(diagonal).sum::<f64>() / demonstrations.len() as f64
}

/// The corners of the box around points.
pub(crate) fn bounds(points: impl Iterator<Item = DVec3>) -> [DVec3; 2] {
    let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    points.fold(start, |[low, high], point| [low.min(point), high.max(point)])
}

/// Median size of a data set's skills in a space over that of the thesis'; one without skills.
pub(crate) fn scale(space: Space, sizes_m: &[f64]) -> f64 {
    quantile(sizes_m, 0.5).map_or(1.0, |size_m| size_m / REFERENCE_M[space as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_goes_with_the_median_size() {
        let [planar, pick] = REFERENCE_M;
        assert_eq!(scale(Space::Planar, &[0.1, planar, 9.0]), 1.0);
        assert_eq!(scale(Space::Pick, &[pick]), 1.0);
        assert_eq!(scale(Space::Planar, &[]), 1.0);
        let small = scale(Space::Planar, &[0.02 * planar, 0.04 * planar, 0.01 * planar]);
        assert!((small - 0.02).abs() < 1e-12, "{small}");
    }
}
