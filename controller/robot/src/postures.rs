//! Postures that are spread evenly, the same ones each time.

use core::f64::consts::PI;

use nalgebra::SVector;

/// Square roots of primes have no common period.
const PRIMES: [f64; 8] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];

/// The `k`-th of postures that fill a box evenly, from 1: multiples of the square roots of primes, modulo 1.
/// Ends of the box are taken within ±π \[rad or m\].
#[must_use]
pub fn spread_posture<const N: usize>(
    lower: &SVector<f64, N>,
    upper: &SVector<f64, N>,
    k: usize,
) -> SVector<f64, N> {
    SVector::from_fn(|i, _| {
        let [lower, upper] = [lower[i], upper[i]].map(|end| end.clamp(-PI, PI));
        lower + (k as f64 * PRIMES[i % PRIMES.len()].sqrt()).fract() * (upper - lower)
    })
}
