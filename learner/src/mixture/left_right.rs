//! Left–right hidden Markov models: states are passed in order, none left out.

use std::ops::Range;

use nalgebra::DMatrix;

use crate::mixture::view::WEIGHT_FLOOR;

/// Probability of staying in each state, from how long the states last: two samples at least.
#[must_use]
pub(crate) fn stays(responsibilities: &DMatrix<f64>, sequences: usize) -> Vec<f64> {
    let stay = |sum: f64| 1.0 - (sequences as f64 / sum.max(WEIGHT_FLOOR)).min(0.5);
    responsibilities.column_iter().map(|weights| stay(weights.sum())).collect()
}

/// Forward–backward in logarithms, and the re-estimated probabilities of staying
/// [Rabiner 1989, eq. 19–27, 37–40]. A demonstration starts in the first state. Returns the
/// log-likelihood of all samples.
pub(crate) fn expectation(
    densities: &DMatrix<f64>,
    sequences: &[Range<usize>],
    stays: &mut [f64],
    responsibilities: &mut DMatrix<f64>,
) -> f64 {
    let states = stays.len();
    // The last state is never left.
    let stay: Vec<f64> =
        (0..states).map(|k| if k + 1 == states { 0.0 } else { stays[k].ln() }).collect();
    let go: Vec<f64> = stays.iter().map(|stay| (1.0 - stay).ln()).collect();
    let (mut stayed, mut went) = (vec![0.0; states], vec![0.0; states]);
    let mut total = 0.0;
    for range in sequences {
        let count = range.len();
        let density = |t: usize, k: usize| densities[(range.start + t, k)];
        let mut forward = DMatrix::from_element(count, states, f64::NEG_INFINITY);
        forward[(0, 0)] = density(0, 0);
        for t in 1..count {
            for k in 0..states {
                let from_before =
                    if k > 0 { forward[(t - 1, k - 1)] + go[k - 1] } else { f64::NEG_INFINITY };
                forward[(t, k)] =
                    log_add(forward[(t - 1, k)] + stay[k], from_before) + density(t, k);
            }
        }
        let mut backward = DMatrix::zeros(count, states);
        for t in (0..count - 1).rev() {
            for k in 0..states {
                let remain = stay[k] + density(t + 1, k) + backward[(t + 1, k)];
                backward[(t, k)] = if k + 1 < states {
                    let leave = go[k] + density(t + 1, k + 1) + backward[(t + 1, k + 1)];
                    log_add(remain, leave)
                } else {
                    remain
                };
            }
        }
        let likelihood = forward.row(count - 1).iter().copied().fold(f64::NEG_INFINITY, log_add);
        total += likelihood;
        for t in 0..count {
            for k in 0..states {
                let here = forward[(t, k)] - likelihood;
                responsibilities[(range.start + t, k)] = (here + backward[(t, k)]).exp();
                if t + 1 < count && k + 1 < states {
                    let remain = here + stay[k] + density(t + 1, k) + backward[(t + 1, k)];
                    stayed[k] += remain.exp();
                    let leave = here + go[k] + density(t + 1, k + 1) + backward[(t + 1, k + 1)];
                    went[k] += leave.exp();
                }
            }
        }
    }
    for ((stay, stayed), went) in stays.iter_mut().zip(stayed).zip(went) {
        if stayed + went > WEIGHT_FLOOR {
            *stay = stayed / (stayed + went);
        }
    }
    total
}

/// ln(eᵃ + eᵇ).
fn log_add(a: f64, b: f64) -> f64 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if low == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}
