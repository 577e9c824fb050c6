//! A field that goes round: on the universal cover of the circle of phases.
//!
//! The K components of one round appear again as copies at s_k + r, one in each round r that matters, with
//! potentials that are lower by r D:
//!
//! ```text
//! μ_{k,r} = (μ_k, s_k + r)     φ⁰_{k,r} = φ⁰_k − r D     g, S, M as of k
//! Φ(y, s + 1) = Φ(y, s) − D    M(s + 1) = M(s)
//! ```
//!
//! So all accelerations are periodic, and the potential falls by D each round, as on a spiral ramp: V = Φ + ½ żᵀMż
//! falls for ever. The phase itself is kept in [0, 1); only copies that have a weight there are needed.

use nalgebra::SVector;

use crate::policy::canonical::field::Component;

/// By how much the potentials of a skill that goes round fall in a round, for an inertia of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cycle {
    /// Position, orientation \[m²/s², rad²/s²\].
    pub fall_per_round: [f64; 2],
}

/// A component as it is in another round.
///
/// * `length`  of a round in the last coordinate
/// * `fall`  D \[J\]
#[must_use]
pub fn in_round<const N: usize>(
    component: &Component<N>,
    round: i32,
    length: f64,
    fall: f64,
) -> Component<N> {
    let rounds = f64::from(round);
    let mut mean: SVector<f64, N> = component.mean;
    mean[N - 1] += rounds * length;
    Component { mean, potential: component.potential - rounds * fall, ..*component }
}
