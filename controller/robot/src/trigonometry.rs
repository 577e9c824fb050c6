//! Sine and cosine of several angles at once.

#![allow(clippy::needless_range_loop, reason = "several arrays run side by side")]

use core::f64::consts::FRAC_2_PI;

/// Angles up to which the reduction by π/2 loses nothing \[rad\].
const ANGLE_MAX: f64 = 1e5;
/// 1.5 · 2⁵²: adding it rounds a number to a whole one, which its last bits then hold.
const ROUNDER: f64 = 6_755_399_441_055_744.0;
/// π/2 in two parts; the first has 33 bits, so that its multiples are exact.
const HALF_PI: [f64; 2] = [1.570_796_326_734_125_6, 6.077_100_506_506_192_e-11];

/// Sines and cosines of angles \[rad\], right to 2e-16.
///
/// Without branches, so that the compiler puts several angles into a register: the reduction and
/// polynomials of fdlibm's `k_sin.c` and `k_cos.c`. Angles beyond [`ANGLE_MAX`] take the slow path.
#[inline(always)]
pub(crate) fn sin_cos<const N: usize>(angles: &[f64; N]) -> ([f64; N], [f64; N]) {
    let (mut sines, mut cosines) = ([0.0; N], [0.0; N]);
    if !angles.iter().all(|angle| angle.abs() <= ANGLE_MAX) {
        for i in 0..N {
            (sines[i], cosines[i]) = angles[i].sin_cos();
        }
        return (sines, cosines);
    }
    for i in 0..N {
        let rounded = angles[i] * FRAC_2_PI + ROUNDER;
        let n = rounded - ROUNDER;
        let r = (angles[i] - n * HALF_PI[0]) - n * HALF_PI[1];
        let z = r * r;
        let sine = r + r
            * z
            * (-1.666_666_666_666_663_2e-1
                + z * (8.333_333_333_322_49e-3
                    + z * (-1.984_126_982_985_795e-4
                        + z * (2.755_731_370_707_006_8e-6
                            + z * (-2.505_076_025_340_686_3e-8 + z * 1.589_690_995_211_55e-10)))));
        let cosine = (1.0 - 0.5 * z)
            + z * z
                * (4.166_666_666_666_66e-2
                    + z * (-1.388_888_888_887_411e-3
                        + z * (2.480_158_728_947_673e-5
                            + z * (-2.755_731_435_139_066_3e-7
                                + z * (2.087_572_321_298_175e-9
                                    + z * -1.135_964_755_778_819_5e-11)))));
        // The quarter of the circle: odd ones swap both, the signs follow from the second bit.
        let quarter = rounded.to_bits();
        let odd = (quarter & 1).wrapping_neg();
        let (s, c) = (sine.to_bits(), cosine.to_bits());
        let swapped = (s ^ c) & odd;
        sines[i] = f64::from_bits(s ^ swapped ^ ((quarter & 2) << 62));
        cosines[i] = f64::from_bits(c ^ swapped ^ ((quarter.wrapping_add(1) & 2) << 62));
    }
    (sines, cosines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_those_of_the_standard_library() {
        let mut angle = -ANGLE_MAX;
        let mut step = 7.0;
        while angle < ANGLE_MAX {
            let angles = [angle, angle * 1e-3, angle * 1e-5, 0.0, -0.0, 1.0 / angle];
            let (sines, cosines) = sin_cos(&angles);
            for i in 0..angles.len() {
                let (sine, cosine) = angles[i].sin_cos();
                assert!((sines[i] - sine).abs() <= 2.3e-16, "sin {}", angles[i]);
                assert!((cosines[i] - cosine).abs() <= 2.3e-16, "cos {}", angles[i]);
            }
            angle += step;
            step = if step > 6.0 { 0.37 } else { 7.01 };
        }
    }

    #[test]
    fn around_the_quarters_of_the_circle() {
        for quarter in -9..=9 {
            for beside in [-1e-3, -1e-9, -1e-17, 0.0, 1e-17, 1e-9, 1e-3, 0.785] {
                let angle = f64::from(quarter) * core::f64::consts::FRAC_PI_2 + beside;
                let ([sine], [cosine]) = sin_cos(&[angle]);
                assert!((sine - angle.sin()).abs() <= 2.3e-16);
                assert!((cosine - angle.cos()).abs() <= 2.3e-16);
            }
        }
    }

    #[test]
    fn large_angles_take_the_slow_path_and_what_is_no_number_stays_that() {
        let angles = [1e6, 0.5, f64::NAN];
        let (sines, cosines) = sin_cos(&angles);
        assert_eq!((sines[0], cosines[1]), (1e6_f64.sin(), 0.5_f64.cos()));
        assert!(sines[2].is_nan() && cosines[2].is_nan());
    }
}
