//! Dynamic time warping and the discrete Fréchet distance: one recursion over pairs of points.

use glam::DVec3;

/// Dynamic time warping distance of two paths \[m\]: the least sum of the distances of paired points, where
/// pairs go on by one point in either path or in both  [Sakoe & Chiba 1978, without weights].
///
/// ```text
/// D(i, j) = |a_i − b_j| + min(D(i−1, j), D(i, j−1), D(i−1, j−1))
/// ```
///
/// O(|a| |b|) time, O(|b|) memory.
///
/// # Panics
/// When a path is empty.
#[must_use]
pub fn dtw(a: &[DVec3], b: &[DVec3]) -> f64 {
    warped(a, b, |best, distance| best + distance)
}

/// Discrete Fréchet distance of two paths \[m\]: the least that the largest distance of paired points can be
/// [Eiter & Mannila 1994].
///
/// ```text
/// F(i, j) = max(|a_i − b_j|, min(F(i−1, j), F(i, j−1), F(i−1, j−1)))
/// ```
///
/// O(|a| |b|) time, O(|b|) memory.
///
/// # Panics
/// When a path is empty.
#[must_use]
pub fn frechet(a: &[DVec3], b: &[DVec3]) -> f64 {
    warped(a, b, f64::max)
}

/// The last value of the recursion: `add` joins the best of what came before with a distance.
fn warped(a: &[DVec3], b: &[DVec3], add: impl Fn(f64, f64) -> f64) -> f64 {
    assert!(!a.is_empty() && !b.is_empty(), "paths have points");
    let mut row = vec![f64::INFINITY; b.len()];
    for (i, p) in a.iter().enumerate() {
        // The values of the row before and of this one to the left; before the first pair there is nothing.
        let (mut diagonal, mut left) = (if i == 0 { 0.0 } else { f64::INFINITY }, f64::INFINITY);
        for (above, q) in row.iter_mut().zip(b) {
            let best = left.min(*above).min(diagonal);
            diagonal = *above;
            left = add(best, (*p - *q).length());
            *above = left;
        }
    }
    row[b.len() - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(xs: &[f64]) -> Vec<DVec3> {
        xs.iter().map(|x| DVec3::X * *x).collect()
    }

    #[test]
    fn repeated_points_cost_nothing_and_a_detour_does() {
        let demonstration = line(&[0.0, 1.0, 2.0]);
        for (path, sum, largest) in [
            (line(&[0.0, 0.0, 1.0, 1.0, 2.0, 2.0]), 0.0, 0.0),
            (line(&[0.0, 5.0, 1.0, 2.0]), 3.0 + 0.0 + 1.0, 3.0),
            (line(&[1.0]), 2.0, 1.0),
            // Backwards: no order of pairs serves.
            (line(&[2.0, 1.0, 0.0]), 4.0, 2.0),
        ] {
            assert_eq!(frechet(&path, &demonstration), largest, "{path:?}");
            assert_eq!(frechet(&demonstration, &path), largest, "{path:?}");
            assert_eq!(dtw(&path, &demonstration), dtw(&demonstration, &path), "{path:?}");
            assert!((dtw(&path, &demonstration) - sum).abs() < 1e-12, "{path:?}");
        }
    }
}
