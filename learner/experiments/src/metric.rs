//! What an experiment measures: the thesis' figures, to be comparable, and the honest ones.

use glam::DVec3;

/// The thesis stops a rollout that has got under way when it is slower than this, at a scale of one [m/s] …
pub(crate) const STOP_SPEED_M_S: f64 = 0.05;
/// … for so many steps.
pub(crate) const STOP_STEPS: usize = 10;

/// The thesis' tracking figure, which it calls a mean square error: the mean distance of each pose to
/// the nearest demonstrated point, and of what of the demonstration comes behind the point nearest to
/// the last pose, to that pose. Not squared, blind to time and direction.
///
/// # Panics
/// When one of them is empty.
pub(crate) fn thesis_tracking(path: &[DVec3], demonstration: &[DVec3]) -> f64 {
    let nearest = |p: &DVec3| {
        let distances = demonstration.iter().map(|d| (*p - *d).length());
        distances.enumerate().fold((0, f64::INFINITY), |a, b| if b.1 < a.1 { b } else { a })
    };
    let sum: f64 = path.iter().map(|p| nearest(p).1).sum();
    let last = path[path.len() - 1];
    let reached = nearest(&last).0;
    let left: f64 = demonstration[reached..].iter().map(|d| (last - *d).length()).sum();
    (sum + left) / (path.len() + demonstration.len() - reached) as f64
}

/// Points of a path at even times `step_s`, which were sampled every `sampling_time_s`.
pub(crate) fn resampled(points: &[DVec3], sampling_time_s: f64, step_s: f64) -> Vec<DVec3> {
    let last = points.len() - 1;
    let count = (last as f64 * sampling_time_s / step_s).round() as usize;
    (0..=count)
        .map(|i| {
            let at = (i as f64 * step_s / sampling_time_s).min(last as f64);
            let k = (at as usize).min(last.saturating_sub(1));
            points[k].lerp(points[(k + 1).min(last)], at - k as f64)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_drawing::quantile;

    fn line(xs: &[f64]) -> Vec<DVec3> {
        xs.iter().map(|x| DVec3::new(*x, 0.0, 0.0)).collect()
    }

    #[test]
    fn the_thesis_figure_is_a_mean_of_distances() {
        let demonstration = line(&[0.0, 1.0, 2.0, 3.0]);
        assert_eq!(thesis_tracking(&demonstration, &demonstration), 0.0);
        // Three poses 0.5 aside, and the points 2 and 3 seen from the last one at (2, 0.5).
        let path: Vec<_> = line(&[0.0, 1.0, 2.0]).iter().map(|p| *p + DVec3::Y * 0.5).collect();
        let expected = (3.0 * 0.5 + 0.5 + 1.25_f64.sqrt()) / 5.0;
        assert!((thesis_tracking(&path, &demonstration) - expected).abs() < 1e-12);
        // Blind to direction: backwards, it ends at the first point, and all of it is left over.
        let back = line(&[3.0, 2.0, 1.0, 0.0]);
        assert!((thesis_tracking(&back, &demonstration) - 6.0 / 8.0).abs() < 1e-12);
    }

    #[test]
    fn paths_are_resampled_and_quantiles_interpolate() {
        let points = resampled(&line(&[0.0, 2.0, 4.0]), 0.02, 0.01);
        assert_eq!(points, line(&[0.0, 1.0, 2.0, 3.0, 4.0]));
        assert_eq!(quantile(&[4.0, 1.0, 2.0, 3.0], 0.5), Some(2.5));
        assert_eq!(quantile(&[f64::NAN, 1.0, 2.0], 1.0), Some(f64::INFINITY));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
