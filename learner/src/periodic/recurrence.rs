//! The period: after which length a recording comes again.

use crate::periodic::trace::{Feature, Trace};

/// Steps of the longest recording at which it is compared with itself.
const STEPS: f64 = 1600.0;
/// Of all pairs that lie a lag apart, so many have to be near each other: an approach and a retreat are not.
const NEAR: f64 = 0.35;
/// A lag is compared by at least this fraction of it.
const OVERLAP: f64 = 0.3;
/// Before this fraction of the largest distance was reached, a motion has not gone away yet.
const AWAY: f64 = 0.5;
/// A motion comes again where it is nearer to itself than this fraction of the largest distance …
const AGAIN: f64 = 0.35;
/// … and no farther than so many times the least one, or this much more: the shortest such lag is the period.
const SHORTEST: [f64; 2] = [1.5, 0.04];
/// Places of a round.
pub(super) const PLACES: usize = 200;

/// A recording that comes again.
pub(super) struct Recurrence {
    /// Length of a round.
    pub length: f64,
    /// How near it comes to itself.
    distance: f64,
    /// A round, at equal steps of its length.
    pub round: Vec<Feature>,
}

impl Recurrence {
    /// How the recording comes again; `None` when it does not.
    pub(super) fn of(trace: &Trace) -> Option<Self> {
        let step = trace.length() / STEPS;
        if !(step > 0.0 && step.is_finite()) {
            return None;
        }
        let (features, _) = trace.steps(step);
        let lags = (features.len() as f64 / (1.0 + OVERLAP)) as usize;
        let distances: Vec<f64> = (0..lags).map(|lag| distance(&features, lag)).collect();
        let most = distances.iter().copied().fold(0.0, f64::max);
        let away = distances.iter().position(|d| *d > AWAY * most)?;
        let best = distances[away..].iter().copied().fold(f64::INFINITY, f64::min);
        let bound = (SHORTEST[0] * best).max(best + SHORTEST[1] * most).min(AGAIN * most);
        let first = away + distances[away..].iter().position(|d| *d <= bound)?;
        // The lowest of this hollow.
        let hollow = distances[first..].iter().take_while(|d| **d <= bound).count();
        let lag = (first..first + hollow).min_by(|i, j| distances[*i].total_cmp(&distances[*j]))?;
        // A hollow at the end has not been passed.
        if lag + 2 >= lags || lag < PLACES / 20 {
            return None;
        }
        let round = closed(&features, lag);
        Some(Self { length: lag as f64 * step, distance: distances[lag], round })
    }

    /// Those that come nearer to themselves before others.
    pub(super) fn nearest_first(&self, other: &Self) -> std::cmp::Ordering {
        self.distance.total_cmp(&other.distance)
    }
}

/// How far a recording is from itself a lag later, where it is near.
fn distance(features: &[Feature], lag: usize) -> f64 {
    let pairs = features.iter().zip(&features[lag..]);
    let mut apart: Vec<f64> = pairs.step_by(3).map(|(a, b)| (a - b).norm()).collect();
    let near = (apart.len() as f64 * NEAR) as usize;
    *apart.select_nth_unstable_by(near, f64::total_cmp).1
}

/// The round that ends nearest to where it begins, going on alike, closed.
fn closed(features: &[Feature], lag: usize) -> Vec<Feature> {
    let beside = (lag / 10).max(1);
    let begins = 0..features.len() - lag;
    let apart = |i: usize| -> f64 {
        let around = i.saturating_sub(beside)..(i + beside).min(features.len() - lag);
        let count = around.len() as f64;
        around.map(|i| (features[i] - features[i + lag]).norm()).sum::<f64>() / count
    };
    let begin = begins.min_by(|i, j| apart(*i).total_cmp(&apart(*j))).unwrap_or(0);
    let missing = features[begin + lag] - features[begin];
    let place = |j: usize| {
        let along = j as f64 / PLACES as f64;
        let at = begin as f64 + along * lag as f64;
        let i = at as usize;
        let here = features[i].lerp(&features[(i + 1).min(features.len() - 1)], at - i as f64);
        here - missing * (along - 0.5)
    };
    (0..PLACES).map(place).collect()
}
