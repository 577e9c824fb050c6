//! Smoothing and differentiation by Savitzky and Golay: in a window around each sample a
//! polynomial is fitted by least squares, and it and its derivatives are read off at the sample.
//! At both ends the polynomial of the outermost window is read off outside its centre, so that
//! nothing is padded and polynomials up to the degree are reproduced exactly everywhere.

use glam::DVec3;
use nalgebra::DMatrix;

use crate::canonical::path::Path;

/// Smooths samples that are `sampling_time_s` apart with a window of about `window_s` and
/// polynomials of a degree. The window has an odd number of samples, enough for the degree and no
/// more than there are.
///
/// # Panics
/// When there are no more samples than the degree.
#[must_use]
pub fn smooth(samples: &[DVec3], sampling_time_s: f64, window_s: f64, degree: usize) -> Path {
    let n = samples.len();
    assert!(n > degree + 1, "a polynomial needs more samples than its degree");
    let half_min = degree / 2 + 1;
    let half_max = (n - 1) / 2;
    let wanted = (0.5 * window_s / sampling_time_s).round() as usize;
    let half = wanted.max(half_min).min(half_max);
    let fit = polynomial_fit(half, degree);
    let unit_s = half as f64 * sampling_time_s;
    let mut path = Path {
        points: Vec::with_capacity(n),
        velocities: Vec::with_capacity(n),
        accelerations: Vec::with_capacity(n),
    };
    for i in 0..n {
        let centre = i.clamp(half, n - 1 - half);
        let window = &samples[centre - half..=centre + half];
        let tau = (i as f64 - centre as f64) / half as f64;
        let (mut point, mut velocity, mut acceleration) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for power in (0..=degree).rev() {
            // Horner's scheme for the polynomial and its derivatives at τ.
            let coefficient: DVec3 =
                window.iter().enumerate().map(|(j, sample)| *sample * fit[(power, j)]).sum();
            acceleration = acceleration * tau + velocity * 2.0;
            velocity = velocity * tau + point;
            point = point * tau + coefficient;
        }
        path.points.push(point);
        path.velocities.push(velocity / unit_s);
        path.accelerations.push(acceleration / (unit_s * unit_s));
    }
    path
}

/// The matrix from 2 half + 1 samples at −1 … 1 to the coefficients of the fitted polynomial.
fn polynomial_fit(half: usize, degree: usize) -> DMatrix<f64> {
    let at = |j: usize| (j as f64 - half as f64) / half as f64;
    let powers = DMatrix::from_fn(2 * half + 1, degree + 1, |j, p| at(j).powi(p as i32));
    powers.svd(true, true).pseudo_inverse(1e-12).expect("both factors were asked for")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_are_reproduced_with_their_derivatives_up_to_the_ends() {
        let dt = 0.02;
        let cubic = |t: f64| {
            (
                DVec3::new(1.0 - t + 2.0 * t * t - 0.7 * t.powi(3), t.powi(3), 0.4),
                DVec3::new(-1.0 + 4.0 * t - 2.1 * t * t, 3.0 * t * t, 0.0),
                DVec3::new(4.0 - 4.2 * t, 6.0 * t, 0.0),
            )
        };
        for (n, window_s) in [(100, 0.4), (10, 0.4), (11, 5.0), (60, 0.001)] {
            let samples: Vec<_> = (0..n).map(|i| cubic(f64::from(i) * dt).0).collect();
            let path = smooth(&samples, dt, window_s, 3);
            for i in 0..n as usize {
                let (point, velocity, acceleration) = cubic(i as f64 * dt);
                assert!((path.points[i] - point).length() < 1e-12);
                assert!((path.velocities[i] - velocity).length() < 1e-9);
                assert!((path.accelerations[i] - acceleration).length() < 1e-7);
            }
        }
    }

    #[test]
    fn noise_is_reduced() {
        // Alternating noise, the highest frequency there is.
        let samples: Vec<_> =
            (0..201).map(|i| DVec3::X * if i % 2 == 0 { 1e-3 } else { -1e-3 }).collect();
        let path = smooth(&samples, 0.01, 0.4, 3);
        assert!(path.points[50..150].iter().all(|p| p.length() < 1e-4));
    }
}
