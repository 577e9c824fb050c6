//! Paths of points.

use glam::DVec3;
use tprmp_spatial::Pose;

/// The positions of poses.
pub(crate) fn positions(poses: &[Pose]) -> Vec<DVec3> {
    poses.iter().map(|pose| pose.position).collect()
}

/// A path's point, velocity and acceleration by central differences; at rest after its end.
pub(crate) fn sampled(points: &[DVec3], step_s: f64, time_s: f64) -> [DVec3; 3] {
    let last = points.len() - 1;
    let at = (time_s / step_s).max(0.0);
    if at >= last as f64 {
        return [points[last], DVec3::ZERO, DVec3::ZERO];
    }
    let i = at as usize;
    let difference = |k: usize| {
        let (a, b, c) = (points[k.saturating_sub(1)], points[k], points[(k + 1).min(last)]);
        let between = if k == 0 || k == last { 1.0 } else { 2.0 };
        let second =
            if k == 0 || k == last { DVec3::ZERO } else { (a - 2.0 * b + c) / step_s.powi(2) };
        [b, (c - a) / (between * step_s), second]
    };
    let ([p, v, a], [q, w, b]) = (difference(i), difference(i + 1));
    let fraction = at - i as f64;
    [p.lerp(q, fraction), v.lerp(w, fraction), a.lerp(b, fraction)]
}

/// So many points of a path, two at least, at equal distances along it, both ends included.
///
/// # Panics
/// When the path is empty.
pub(crate) fn by_length(points: &[DVec3], count: usize) -> Vec<DVec3> {
    let mut lengths = vec![0.0];
    for pair in points.windows(2) {
        lengths.push(lengths[lengths.len() - 1] + (pair[1] - pair[0]).length());
    }
    let last = points.len() - 1;
    let at = |i: usize| {
        let length = lengths[last] * i as f64 / (count - 1) as f64;
        let k = lengths.partition_point(|l| *l < length).clamp(1, last.max(1));
        let (from, to) = (lengths[k - 1], lengths[k.min(last)]);
        let fraction = (length - from) / (to - from).max(f64::MIN_POSITIVE);
        points[k - 1].lerp(points[k.min(last)], fraction.clamp(0.0, 1.0))
    };
    (0..count).map(at).collect()
}

/// The point of a path at half its length.
pub(crate) fn middle(points: &[DVec3]) -> DVec3 {
    let length = |points: &[DVec3]| points.windows(2).map(|p| (p[1] - p[0]).length()).sum::<f64>();
    let half = 0.5 * length(points);
    let mut length = 0.0;
    for pair in points.windows(2) {
        length += (pair[1] - pair[0]).length();
        if length >= half {
            return pair[1];
        }
    }
    points[points.len() - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_sampled_by_its_length_whatever_its_speed() {
        let line = |xs: &[f64]| xs.iter().map(|x| DVec3::X * *x).collect::<Vec<_>>();
        let even = line(&[0.0, 1.0, 2.0, 3.0, 4.0]);
        for points in [line(&[0.0, 4.0]), line(&[0.0, 0.0, 0.1, 3.9, 4.0, 4.0, 4.0])] {
            let found = by_length(&points, 5);
            assert!(std::iter::zip(&found, &even).all(|(a, b)| (*a - *b).length() < 1e-12));
        }
        // There and back; and a body that never moves.
        assert_eq!(by_length(&line(&[0.0, 1.0, 0.0]), 5), line(&[0.0, 0.5, 1.0, 0.5, 0.0]));
        for points in [line(&[3.0]), line(&[3.0, 3.0])] {
            assert_eq!(by_length(&points, 3), line(&[3.0; 3]));
        }
    }
}
