//! The velocity error.

use glam::DVec3;

/// Root mean square of the difference in velocity at the same times, over the demonstration's duration
/// [m/s]  [V_rms of Lemme et al. 2015]. Velocities are differences of neighbouring points, which are
/// `step_s` apart; a path that has ended is at rest. Zero for a demonstration of one point.
///
/// # Panics
/// When the path is empty.
#[must_use]
pub fn velocity_rmse(path: &[DVec3], demonstration: &[DVec3], step_s: f64) -> f64 {
    let at = |i: usize| path[i.min(path.len() - 1)];
    let square = |(i, d): (usize, &[DVec3])| (at(i + 1) - at(i) - (d[1] - d[0])).length_squared();
    let sum: f64 = demonstration.windows(2).enumerate().map(square).sum();
    let count = (demonstration.len().max(2) - 1) as f64;
    (sum / count).sqrt() / step_s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_has_ended_is_at_rest() {
        let line = |xs: &[f64]| xs.iter().map(|x| DVec3::X * *x).collect::<Vec<_>>();
        let demonstration = line(&[0.0, 1.0, 3.0]);
        assert_eq!(velocity_rmse(&line(&[5.0, 6.0, 8.0]), &demonstration, 0.1), 0.0);
        let expected = (4.0_f64 / 2.0).sqrt() / 0.1;
        assert!((velocity_rmse(&line(&[0.0, 1.0]), &demonstration, 0.1) - expected).abs() < 1e-12);
        assert_eq!(velocity_rmse(&line(&[0.0]), &line(&[0.0]), 0.1), 0.0);
    }
}
