//! The distance to a path: how far beside its tube a body is.

use glam::DVec3;

/// Distance of a point to the nearest point of a path of straight pieces \[m\].
///
/// # Panics
/// When the path is empty.
#[must_use]
pub fn distance_to_path(point: DVec3, path: &[DVec3]) -> f64 {
    let piece = |ends: &[DVec3]| {
        let along = ends[1] - ends[0];
        let fraction = (point - ends[0]).dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
        (point - ends[0] - along * fraction.clamp(0.0, 1.0)).length()
    };
    path.windows(2).map(piece).fold((point - path[0]).length(), f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_may_lie_between_two() {
        let path = [DVec3::ZERO, DVec3::X, DVec3::X, DVec3::new(1.0, 2.0, 0.0)];
        for (point, expected) in [
            (DVec3::new(0.4, 0.3, 0.0), 0.3),
            (DVec3::new(1.5, 1.3, 0.0), 0.5),
            (DVec3::new(-3.0, -4.0, 0.0), 5.0),
            (DVec3::new(1.0, 2.0, 7.0), 7.0),
        ] {
            assert!((distance_to_path(point, &path) - expected).abs() < 1e-12, "{point}");
        }
        assert_eq!(distance_to_path(DVec3::X, &path[..1]), 1.0);
    }
}
