//! Mean square of the distance in time.

use glam::DVec3;

/// Mean square distance of points at the same times, over the demonstration's duration \[m²\]; a path
/// that has ended stays where it is.
///
/// # Panics
/// When one of them is empty.
#[must_use]
pub fn mean_square(path: &[DVec3], demonstration: &[DVec3]) -> f64 {
    let at = |i: usize| path[i.min(path.len() - 1)];
    let square = |(i, d): (usize, &DVec3)| (at(i) - *d).length_squared();
    demonstration.iter().enumerate().map(square).sum::<f64>() / demonstration.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_late_counts() {
        let line = |xs: &[f64]| xs.iter().map(|x| DVec3::X * *x).collect::<Vec<_>>();
        let demonstration = line(&[0.0, 1.0, 2.0]);
        for (path, expected) in [
            (line(&[0.0, 1.0, 2.0, 9.0]), 0.0),
            (line(&[0.0, 0.0, 1.0]), 2.0 / 3.0),
            (line(&[0.0]), 5.0 / 3.0),
        ] {
            assert!((mean_square(&path, &demonstration) - expected).abs() < 1e-12);
        }
    }
}
