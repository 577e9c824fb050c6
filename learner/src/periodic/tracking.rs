//! Where of a round a recording is: a path through the places of the round, by dynamic programming.

use crate::periodic::recurrence::PLACES;
use crate::periodic::trace::{Feature, Trace};

/// A place that is farther counts as so far: an approach or a retreat is no part of a round, however far.
const FAR: f64 = 0.5;
/// Cost of going on by another number of places than one.
const UNEVEN: f64 = 0.003;
/// A place within this distance is on the round, …
const ON: f64 = 0.15;
/// … or within so many times the distance that is usual, but no less than this.
const USUAL: [f64; 2] = [4.0, 0.05];
/// A round counts as complete when no more than this fraction is missing.
const MISSING: f64 = 0.03;
/// Places over which the way along a round is smooth.
const WIDTH: f64 = 6.0;

/// The part of a recording that goes round.
pub(super) struct Track {
    /// Rounds up to each step, rising.
    rounds: Vec<f64>,
    /// Sample of the recording at each step, with its fraction.
    samples: Vec<f64>,
    /// Feature at each step.
    features: Vec<Feature>,
    last_sample: f64,
}

/// A complete round of a recording.
#[derive(Clone, Debug)]
pub(super) struct Lap {
    /// Which recording.
    pub recording: usize,
    /// The place at which it begins.
    pub first: usize,
    /// Sample of the recording, with its fraction, at each place from the first to the first again.
    pub samples: Vec<f64>,
}

impl Track {
    /// The longest stretch that follows a round of a length. `usual` is how far from it rounds are; none at first.
    pub(super) fn new(trace: &Trace, round: &[Feature], length: f64, usual: Option<f64>) -> Self {
        let step = length / PLACES as f64;
        let count = (trace.length() / step) as usize + 1;
        let features = trace.steps(0.0, step, count);
        let samples: Vec<f64> = (0..count).map(|k| trace.sample(k as f64 * step)).collect();
        let places = places(&features, round);
        let fitted: Vec<(f64, f64)> = features
            .iter()
            .zip(&places)
            .map(|(feature, place)| beside(feature, round, *place))
            .collect();
        let on = usual.map_or(ON, |usual| (USUAL[0] * usual).clamp(USUAL[1], ON));
        let stretch = longest(&fitted, on);
        let rounds: Vec<f64> =
            fitted[stretch.clone()].iter().map(|(place, _)| place / PLACES as f64).collect();
        Self {
            rounds: rising(&rounds),
            samples: samples[stretch.clone()].to_vec(),
            features: features[stretch].to_vec(),
            last_sample: samples[samples.len() - 1],
        }
    }

    /// How far it is from a round, at the median.
    pub(super) fn distance(&self, round: &[Feature]) -> Option<f64> {
        let mut apart: Vec<f64> =
            self.steps().map(|(place, feature)| (feature - round[place]).norm()).collect();
        apart.sort_by(f64::total_cmp);
        apart.get(apart.len() / 2).copied()
    }

    /// Place and feature of each step.
    pub(super) fn steps(&self) -> impl Iterator<Item = (usize, &Feature)> {
        let place = |rounds: &f64| (rounds.rem_euclid(1.0) * PLACES as f64) as usize % PLACES;
        self.rounds.iter().map(place).zip(&self.features)
    }

    /// The complete rounds, as many as there are, from the middle of what goes round.
    pub(super) fn laps(&self, recording: usize) -> Vec<Lap> {
        let (Some(first), Some(last)) = (self.rounds.first(), self.rounds.last()) else {
            return Vec::new();
        };
        let count = (last - first + MISSING).floor();
        let spare = (last - first - count).max(0.0);
        let begin = ((first + 0.5 * spare) * PLACES as f64).round();
        let lap = |round: usize| {
            let first = begin + (round * PLACES) as f64;
            let at = |j: usize| self.sample((first + j as f64) / PLACES as f64);
            Lap {
                recording,
                first: first.rem_euclid(PLACES as f64) as usize,
                samples: (0..=PLACES).map(at).collect(),
            }
        };
        (0..count.max(0.0) as usize).map(lap).collect()
    }

    /// The sample after so many rounds; beyond its ends it goes on as it did there.
    fn sample(&self, rounds: f64) -> f64 {
        let after = self.rounds.partition_point(|r| *r <= rounds);
        let i = after.clamp(1, self.rounds.len() - 1) - 1;
        let way = self.rounds[i + 1] - self.rounds[i];
        let fraction = (rounds - self.rounds[i]) / way;
        let at = self.samples[i] + fraction * (self.samples[i + 1] - self.samples[i]);
        at.clamp(0.0, self.last_sample)
    }
}

/// The place of each step, counted on from round to round.
fn places(features: &[Feature], round: &[Feature]) -> Vec<i64> {
    let cost =
        |feature: &Feature, place: usize| (feature - round[place]).norm_squared().min(FAR * FAR);
    let mut costs: Vec<f64> = (0..PLACES).map(|place| cost(&features[0], place)).collect();
    let mut steps: Vec<Vec<u8>> = Vec::with_capacity(features.len());
    for feature in &features[1..] {
        let before = costs.clone();
        let mut step = vec![0; PLACES];
        for place in 0..PLACES {
            let from = |by: usize| before[(place + PLACES - by) % PLACES];
            let all = [from(0) + UNEVEN, from(1), from(2) + UNEVEN];
            let best = (0..3).min_by(|i, j| all[*i].total_cmp(&all[*j])).unwrap_or(1);
            step[place] = best as u8;
            costs[place] = all[best] + cost(feature, place);
        }
        steps.push(step);
    }
    let least = (0..PLACES).min_by(|i, j| costs[*i].total_cmp(&costs[*j])).unwrap_or(0);
    let mut at = least as i64;
    let mut places = vec![at];
    for step in steps.iter().rev() {
        at -= i64::from(step[at.rem_euclid(PLACES as i64) as usize]);
        places.push(at);
    }
    places.reverse();
    places
}

/// The place between its neighbours, and how far the feature is from it.
fn beside(feature: &Feature, round: &[Feature], place: i64) -> (f64, f64) {
    let at = |place: i64| &round[place.rem_euclid(PLACES as i64) as usize];
    let side = |from: i64| {
        let way = at(from + 1) - at(from);
        let along = (feature - at(from)).dot(&way) / way.norm_squared().max(f64::MIN_POSITIVE);
        let along = along.clamp(0.0, 1.0);
        (from as f64 + along, (feature - at(from) - way * along).norm())
    };
    let (before, after) = (side(place - 1), side(place));
    if before.1 < after.1 { before } else { after }
}

/// The steps near the round that follow each other and go on farthest.
fn longest(fitted: &[(f64, f64)], on: f64) -> std::ops::Range<usize> {
    let (mut best, mut begin) = (0..0, 0);
    let way = |range: &std::ops::Range<usize>| {
        if range.is_empty() { 0.0 } else { fitted[range.end - 1].0 - fitted[range.start].0 }
    };
    for end in 0..=fitted.len() {
        if end < fitted.len() && fitted[end].1 < on {
            continue;
        }
        if way(&(begin..end)) > way(&best) {
            best = begin..end;
        }
        begin = end + 1;
    }
    best
}

/// Rounds that rise, as smooth as they go on evenly.
fn rising(rounds: &[f64]) -> Vec<f64> {
    let even = |i: usize| i as f64 / PLACES as f64;
    let reach = (3.0 * WIDTH) as usize;
    let smooth = |i: usize| {
        let (mut sum, mut weights) = (0.0, 0.0);
        // As far to both sides, so that the ends are not drawn inwards.
        let reach = reach.min(i).min(rounds.len() - 1 - i);
        for (j, own) in rounds.iter().enumerate().take(i + reach + 1).skip(i - reach) {
            let weight = (-0.5 * ((j as f64 - i as f64) / WIDTH).powi(2)).exp();
            sum += weight * (own - even(j));
            weights += weight;
        }
        even(i) + sum / weights
    };
    let mut all: Vec<f64> = (0..rounds.len()).map(smooth).collect();
    let least = 0.05 / PLACES as f64;
    for i in 1..all.len() {
        all[i] = all[i].max(all[i - 1] + least);
    }
    all
}
