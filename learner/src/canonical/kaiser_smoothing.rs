//! Smoothing by the mean over a Kaiser window, as the thesis' own code does it: each sample
//! becomes the weighted mean of its neighbours, of which those before it are smoothed already.
//!
//! ```text
//! w_j = I₀(β √(1 − (2j/(n − 1) − 1)²)),  j = 0 … n − 1          [Kaiser 1974]
//! ```
//!
//! At the ends the window is cut off, not padded. It has two samples at least: a shorter window is the
//! mean of a sample and the smoothed one before it.

use glam::DVec3;
use tprmp_spatial::Pose;

use crate::canonical::means::mean_orientation;
use crate::skill::KaiserSmoothing;

/// Smooths poses that are `sampling_time_s` apart.
#[must_use]
pub fn kaiser_smoothing(
    poses: &[Pose],
    sampling_time_s: f64,
    settings: KaiserSmoothing,
) -> Vec<Pose> {
    let most = poses.len().max(1) as f64;
    let half = (0.5 * settings.window_s / sampling_time_s).round().clamp(1.0, most) as usize;
    let window = kaiser(2 * half, settings.shape);
    let mut smoothed = poses.to_vec();
    for i in 0..poses.len() {
        let (first, end) = (i.saturating_sub(half), (i + half).min(poses.len()));
        let window_poses = &smoothed[first..end];
        let weights = &window[first + half - i..end + half - i];
        let sum: f64 = weights.iter().sum();
        let position: DVec3 =
            window_poses.iter().zip(weights).map(|(pose, weight)| pose.position * *weight).sum();
        let orientations: Vec<_> = window_poses.iter().map(|pose| pose.orientation).collect();
        let rotates = orientations.iter().any(|q| *q != orientations[0]);
        let orientation =
            if rotates { mean_orientation(&orientations, weights) } else { orientations[0] };
        smoothed[i] = Pose { position: position / sum, orientation };
    }
    smoothed
}

/// The Kaiser window of `count` > 1 samples, not normalised.
fn kaiser(count: usize, shape: f64) -> Vec<f64> {
    let weight = |j: usize| {
        let x = 2.0 * j as f64 / (count - 1) as f64 - 1.0;
        bessel_i0(shape * (1.0 - x * x).max(0.0).sqrt())
    };
    (0..count).map(weight).collect()
}

/// The modified Bessel function I₀ by its power series Σ (x²/4)ᵏ/(k!)².
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut term, mut sum, mut k) = (1.0, 1.0, 1.0);
    while term > f64::EPSILON * sum {
        term *= quarter / (k * k);
        sum += term;
        k += 1.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    const SETTINGS: KaiserSmoothing = KaiserSmoothing { window_s: 0.3, shape: 14.0 };

    fn at(x: f64, angle: f64) -> Pose {
        Pose { position: DVec3::new(x, -x, 0.0), orientation: DQuat::from_rotation_z(angle) }
    }

    #[test]
    fn the_bessel_function_is_that_of_the_tables() {
        // Abramowitz and Stegun, table 9.8 and 9.11 (scaled by e⁻ˣ).
        for (x, value) in [(0.0, 1.0), (1.0, 1.266_065_877_752_008_4), (5.0, 27.239_871_823_604_44)]
        {
            assert!((bessel_i0(x) / value - 1.0).abs() < 1e-14, "{x}");
        }
        assert!((bessel_i0(14.0) * (-14.0_f64).exp() - 0.107_6).abs() < 1e-4);
    }

    #[test]
    fn the_window_is_symmetric_and_narrow() {
        let window = kaiser(30, 14.0);
        assert!((0..30).all(|j| (window[j] - window[29 - j]).abs() < 1e-9 * window[14]));
        assert!(window[0] / window[14] < 1e-4 && (window[0] - 1.0).abs() < 1e-12);
        assert!(window.windows(2).take(14).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn any_window_is_cut_to_the_poses() {
        let some: Vec<Pose> = (0..20).map(|i| at(0.1 * f64::from(i), 0.0)).collect();
        for (window_s, dt) in [(1e9, 0.01), (0.3, 1e-200), (1e-9, 0.01), (0.3, 1e9)] {
            let smooth = kaiser_smoothing(&some, dt, KaiserSmoothing { window_s, shape: 14.0 });
            assert!(smooth.iter().all(|pose| pose.position.is_finite()), "{window_s} {dt}");
        }
        assert!(kaiser_smoothing(&[], 0.01, SETTINGS).is_empty());
    }

    #[test]
    fn rest_stays_and_noise_shrinks() {
        let still = vec![at(0.7, 0.3); 40];
        for pose in kaiser_smoothing(&still, 0.01, SETTINGS) {
            assert!((pose.position - still[0].position).length() < 1e-12);
            assert!(pose.rotation_from(&still[0]).length() < 1e-12);
        }
        let noisy: Vec<Pose> =
            (0..60).map(|i| at(if i % 2 == 0 { 0.01 } else { -0.01 }, 0.0)).collect();
        let smooth = kaiser_smoothing(&noisy, 0.01, SETTINGS);
        assert!(smooth[20..40].iter().all(|pose| pose.position.length() < 0.002));
    }

    #[test]
    fn motion_at_constant_speed_lags_by_less_than_half_the_window() {
        let moving: Vec<Pose> =
            (0..200).map(|i| at(0.01 * f64::from(i), 0.005 * f64::from(i))).collect();
        let smooth = kaiser_smoothing(&moving, 0.01, SETTINGS);
        for (pose, raw) in smooth.iter().zip(&moving).take(170).skip(30) {
            let lag = raw.position.x - pose.position.x;
            assert!((0.0..0.15).contains(&lag), "{lag}");
            assert!(pose.rotation_from(raw).length() < 0.075);
        }
        // All lag alike in the middle.
        let lag = |i: usize| moving[i].position.x - smooth[i].position.x;
        assert!((lag(80) - lag(120)).abs() < 1e-6, "{} {}", lag(80), lag(120));
    }
}
