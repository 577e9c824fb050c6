//! Smooths a round by its harmonics: it has no ends, and its derivatives are exact for what is kept.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::canonical::path::Path;
use crate::skill::Skill;

/// Where a harmonic is left by half, times the window: as the polynomials of a window do it.
const CUTOFF: f64 = 1.35;
/// So many harmonics are left, however fast a round is: its shape.
const HARMONICS_MIN: f64 = 5.0;
/// How steeply harmonics fall off.
const STEEPNESS: i32 = 8;
/// Less of a harmonic is nothing.
const NOTHING: f64 = 1e-3;

/// Closes a round, whose last two points are its ends, by what is missing spread over it, and smooths it.
///
/// * `begin`  phase at which it begins
/// * `period_s`  how long it lasts
pub(super) fn smooth_round(
    skill: &Skill,
    mut points: Vec<DVec3>,
    begin: f64,
    period_s: f64,
) -> Path {
    let (Some(end), Some(start)) = (points.pop(), points.pop()) else { unreachable!("its ends") };
    let count = points.len();
    for (i, point) in points.iter_mut().enumerate() {
        let along = (i as f64 / count as f64 - begin).rem_euclid(1.0);
        *point -= (end - start) * (along - 0.5);
    }
    let half = (CUTOFF * period_s / skill.smoothing.window_s).max(HARMONICS_MIN);
    let mean = points.iter().sum::<DVec3>() / count as f64;
    let mut path = Path {
        points: vec![mean; count],
        velocities: vec![DVec3::ZERO; count],
        accelerations: vec![DVec3::ZERO; count],
    };
    let waves: Vec<(f64, f64)> =
        (0..count).map(|i| (TAU * i as f64 / count as f64).sin_cos()).collect();
    for harmonic in 1..count.div_ceil(2) {
        let weight = 1.0 / (1.0 + (harmonic as f64 / half).powi(STEEPNESS));
        if weight < NOTHING {
            break;
        }
        let wave = |i: usize| waves[i * harmonic % count];
        let sum = |of: fn((f64, f64)) -> f64| -> DVec3 {
            let all = points.iter().enumerate().map(|(i, point)| *point * of(wave(i)));
            all.sum::<DVec3>() * (2.0 * weight / count as f64)
        };
        let (sine, cosine) = (sum(|(sin, _)| sin), sum(|(_, cos)| cos));
        let rate = TAU * harmonic as f64 / period_s;
        for i in 0..count {
            let (sin, cos) = wave(i);
            let own = sine * sin + cosine * cos;
            path.points[i] += own;
            path.velocities[i] += (sine * cos - cosine * sin) * rate;
            path.accelerations[i] -= own * (rate * rate);
        }
    }
    path
}
