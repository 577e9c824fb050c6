//! The period: after which length a recording comes again.

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::periodic::trace::{Feature, Trace};

/// The shortest lag that is compared, in units of the features: a motion has not gone away by then.
const LAG_MIN: f64 = 0.05;
/// Lags that are compared, from one to twice as much: how fine a period is found depends on the period alone, not on
/// how many rounds a recording has.
const LAGS_PER_OCTAVE: f64 = 400.0;
/// Pairs, spread over the recording, by which a lag is compared.
const PAIRS: usize = 400;
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
/// A recording of one round is closed where an end comes as near to its beginning as this fraction of how far it goes.
const CLOSED: f64 = 0.15;
/// Within this fraction of its length from either end a recording of one round begins and ends it.
const ENDS: f64 = 0.2;
/// What goes round is no farther from itself than most of its pairs, this fraction, or so many times that.
const ROUND: [f64; 2] = [0.65, 3.0];
/// Places of a round.
pub(super) const PLACES: usize = 200;
/// Among so many rounds, from the middle of a recording, that is looked for which closes best.
const LOOKED_AT: f64 = 20.0;

/// A recording that comes again.
pub(super) struct Recurrence {
    /// Length of a round.
    pub length: f64,
    /// How near it comes to itself.
    distance: f64,
    /// A round, at equal steps of its length.
    pub round: Vec<Feature>,
    /// By how much its position changes from a round to the next one, in units of the features.
    pub drift: DVec3,
}

impl Recurrence {
    /// How the recording comes again; `None` when it does not.
    pub(super) fn of(trace: &Trace) -> Option<Self> {
        let longest = trace.length() / (1.0 + OVERLAP);
        if !(longest > LAG_MIN && longest.is_finite()) {
            return None;
        }
        let count = ((longest / LAG_MIN).log2() * LAGS_PER_OCTAVE) as usize;
        let lags: Vec<f64> =
            (0..count).map(|i| LAG_MIN * (i as f64 / LAGS_PER_OCTAVE).exp2()).collect();
        let pairs = Pairs::new();
        let distances: Vec<f64> = lags.iter().map(|lag| pairs.distance(trace, *lag)).collect();
        let most = distances.iter().copied().fold(0.0, f64::max);
        let away = distances.iter().position(|d| *d > AWAY * most)?;
        let best = distances[away..].iter().copied().fold(f64::INFINITY, f64::min);
        let bound = (SHORTEST[0] * best).max(best + SHORTEST[1] * most).min(AGAIN * most);
        let first = away + distances[away..].iter().position(|d| *d <= bound)?;
        // The lowest of this hollow.
        let hollow = distances[first..].iter().take_while(|d| **d <= bound).count();
        let lag = (first..first + hollow).min_by(|i, j| distances[*i].total_cmp(&distances[*j]))?;
        // A hollow at the end has not been passed.
        if lag + 2 >= count {
            return None;
        }
        let (length, distance) = (lags[lag], distances[lag]);
        let round = closed(trace, length);
        Some(Self { length, distance, round, drift: pairs.drift(trace, length) })
    }

    /// The one round of a recording that ends where it began; `None` when it does not.
    pub(super) fn closed_once(trace: &Trace) -> Option<Self> {
        let step = trace.length() / (2 * PLACES) as f64;
        if !(trace.length() > LAG_MIN && step.is_finite()) {
            return None;
        }
        let features = trace.steps(0.0, step, 2 * PLACES + 1);
        let ends = (ENDS * features.len() as f64) as usize;
        let last = features.len() - 1;
        let apart = |&(i, j): &(usize, usize)| (features[j] - features[i]).norm();
        let (begin, end) = (0..ends)
            .flat_map(|i| (last - ends..=last).map(move |j| (i, j)))
            .min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
        let far = features[begin..end].iter().map(|f| (f - features[begin]).norm());
        let distance = apart(&(begin, end));
        if distance > CLOSED * far.fold(0.0, f64::max) {
            return None;
        }
        let length = (end - begin) as f64 * step;
        let round = places(trace, begin as f64 * step, length);
        Some(Self { length, distance, round, drift: DVec3::ZERO })
    }

    /// Those that come nearer to themselves before others.
    pub(super) fn nearest_first(&self, other: &Self) -> std::cmp::Ordering {
        self.distance.total_cmp(&other.distance)
    }
}

/// Where a recording is compared with itself, as fractions of where it can be. They follow no grid, with which
/// rounds could keep step.
struct Pairs(Vec<f64>);

impl Pairs {
    fn new() -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let at = |i: usize| (i as f64 + random.random_range(0.0..1.0)) / PAIRS as f64;
        Self((0..PAIRS).map(at).collect())
    }

    /// What is a lag apart.
    fn of<'a>(&'a self, trace: &'a Trace, lag: f64) -> impl Iterator<Item = Feature> + 'a {
        let room = trace.length() - lag;
        self.0.iter().map(move |at| trace.at(at * room + lag) - trace.at(at * room))
    }

    /// How far a recording is from itself a lag later, where it is near.
    fn distance(&self, trace: &Trace, lag: f64) -> f64 {
        let mut apart: Vec<f64> = self.of(trace, lag).map(|apart| apart.norm()).collect();
        let near = (apart.len() as f64 * NEAR) as usize;
        *apart.select_nth_unstable_by(near, f64::total_cmp).1
    }

    /// By how much the position changes within a lag, on an average of the pairs that go round: a lag that is a little
    /// too long or too short goes to all sides of a round.
    fn drift(&self, trace: &Trace, lag: f64) -> DVec3 {
        let mut all: Vec<Feature> = self.of(trace, lag).collect();
        all.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
        let bound = ROUND[1] * all[(ROUND[0] * all.len() as f64) as usize].norm();
        all.retain(|apart| apart.norm() <= bound);
        let mean = all.iter().sum::<Feature>() / all.len() as f64;
        DVec3::new(mean[0], mean[1], mean[2])
    }
}

/// The round that ends nearest to where it begins, going on alike, closed.
fn closed(trace: &Trace, length: f64) -> Vec<Feature> {
    let stretch = trace.length().min(LOOKED_AT * length);
    let from = 0.5 * (trace.length() - stretch);
    let step = length / PLACES as f64;
    let features = trace.steps(from, step, (stretch / step) as usize + 1);
    let beside = PLACES / 10;
    let begins = 0..features.len() - PLACES;
    let apart = |i: usize| -> f64 {
        let around = i.saturating_sub(beside)..(i + beside).min(features.len() - PLACES);
        let count = around.len() as f64;
        around.map(|i| (features[i] - features[i + PLACES]).norm()).sum::<f64>() / count
    };
    let begin = begins.min_by(|i, j| apart(*i).total_cmp(&apart(*j))).unwrap_or(0);
    places(trace, from + begin as f64 * step, length)
}

/// The places of the round that begins at a length, closed by what is missing spread over it.
fn places(trace: &Trace, begin: f64, length: f64) -> Vec<Feature> {
    let missing = trace.at(begin + length) - trace.at(begin);
    let place = |j: usize| {
        let along = j as f64 / PLACES as f64;
        trace.at(begin + along * length) - missing * (along - 0.5)
    };
    (0..PLACES).map(place).collect()
}
