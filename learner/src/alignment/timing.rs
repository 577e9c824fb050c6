//! The coordinate along each demonstration that does not know the clock, and the time that all have in
//! common.

use std::ops::Range;

use tprmp_drawing::quantile;

use crate::alignment::rest::Motion;
use crate::alignment::warp::{Warp, interpolated};

/// Part of a path that counts by time and not by length: where nothing moves it is regular.
const REGULARITY: f64 = 1e-3;
/// Pauses of several demonstrations are the same within this fraction of the path.
const SAME_PAUSE: f64 = 0.05;
/// Parts of the path in which paces are compared.
const CELLS: usize = 50;
/// No part takes a smaller fraction of the mean time: its logarithm has to be finite.
const PACE_MIN: f64 = 1e-3;
/// Halvings in a search: a double has no more digits.
const HALVINGS: usize = 50;
/// Most samples of an aligned demonstration: a motion has no more to tell …
const SAMPLES_MAX: f64 = 1500.0;
/// … nor one that is sampled more often \[s\]: a hand moves at no more than some ten hertz.
const SAMPLING_TIME_MIN_S: f64 = 0.01;

/// A demonstration along its path, without rests and pauses.
#[derive(Clone, Debug)]
pub(crate) struct Track {
    /// Samples of the recording that count, in order.
    active: Vec<usize>,
    /// Fraction of the path at each of them, strictly increasing from 0 to 1.
    fractions: Vec<f64>,
    /// Pauses: samples of the recording, and where on the path.
    pauses: Vec<(Range<usize>, f64)>,
    sampling_time_s: f64,
}

impl Track {
    /// The track of a motion, whose slow stretches of this length or more are pauses.
    pub(crate) fn new(motion: &Motion, pause_min_s: f64) -> Self {
        let moving = motion.moving.clone();
        let dt = motion.sampling_time_s;
        let long = |pause: &&Range<usize>| pause.len() as f64 * dt >= pause_min_s;
        let pauses: Vec<Range<usize>> = motion.pauses.iter().filter(long).cloned().collect();
        let active: Vec<usize> =
            moving.filter(|i| !pauses.iter().any(|pause| pause.contains(i))).collect();
        // What is faster than noise is length.
        let rate = |i: usize| {
            let (speed, noise) = (motion.speeds[i], motion.noise_speed);
            (speed * speed - noise * noise).max(0.0).sqrt()
        };
        let mean = active.iter().map(|i| rate(*i)).sum::<f64>() / active.len() as f64;
        let mut fractions = vec![0.0];
        for pair in active.windows(2) {
            let step = 0.5 * (rate(pair[0]) + rate(pair[1])) + REGULARITY * mean;
            fractions.push(fractions[fractions.len() - 1] + step);
        }
        let length = fractions[fractions.len() - 1];
        fractions.iter_mut().for_each(|fraction| *fraction /= length);
        let place = |pause: &Range<usize>| {
            fractions[active.partition_point(|i| *i < pause.start).min(active.len() - 1)]
        };
        let pauses = pauses.iter().map(|pause| (pause.clone(), place(pause))).collect();
        Self { active, fractions, pauses, sampling_time_s: dt }
    }

    /// The track of one who keeps time: the fraction of the time.
    pub(crate) fn by_clock(motion: &Motion) -> Self {
        let active: Vec<usize> = motion.moving.clone().collect();
        let last = (active.len() - 1) as f64;
        let fractions = (0..active.len()).map(|i| i as f64 / last).collect();
        Self { active, fractions, pauses: Vec::new(), sampling_time_s: motion.sampling_time_s }
    }

    /// Duration without pauses \[s\].
    pub(crate) fn duration_s(&self) -> f64 {
        (self.active.len() - 1) as f64 * self.sampling_time_s
    }

    /// Duration of its pauses \[s\].
    pub(crate) fn pauses_s(&self) -> f64 {
        self.pauses.iter().map(|(pause, _)| pause.len() as f64 * self.sampling_time_s).sum()
    }

    /// Place in the list of active samples at a fraction of the path.
    fn active_at(&self, fraction: f64) -> f64 {
        let last = self.fractions.len() - 1;
        let end = self.fractions.partition_point(|other| *other < fraction).clamp(1, last);
        let (a, b) = (self.fractions[end - 1], self.fractions[end]);
        (end - 1) as f64 + ((fraction - a) / (b - a)).clamp(0.0, 1.0)
    }

    /// Sample of the recording at a place in the list of active samples.
    fn recorded(&self, place: f64) -> f64 {
        let i = (place as usize).min(self.active.len() - 1);
        let next = self.active[(i + 1).min(self.active.len() - 1)] as f64;
        self.active[i] as f64 + (place - i as f64) * (next - self.active[i] as f64)
    }

    /// Sample of the recording at a fraction of the path.
    pub(crate) fn sample_at(&self, fraction: f64) -> f64 {
        self.recorded(self.active_at(fraction))
    }
}

/// A pause that all demonstrations make.
#[derive(Clone, Debug)]
struct Pause {
    /// Common time without pauses at which it begins \[s\].
    at_s: f64,
    /// How long it lasts \[s\].
    duration_s: f64,
    /// The samples of each demonstration.
    samples: Vec<Range<usize>>,
}

/// The time that all demonstrations have in common.
#[derive(Clone, Debug)]
pub(crate) struct CommonTime {
    /// Time between its samples \[s\].
    pub sampling_time_s: f64,
    /// Common times without pauses at which the next is known \[s\].
    times: Vec<f64>,
    /// For each demonstration, the sample of its recording at these times.
    samples: Vec<Vec<f64>>,
    pauses: Vec<Pause>,
    steps: usize,
    recorded_at_s: Vec<f64>,
}

impl CommonTime {
    /// The common time of demonstrations along their tracks; `warps` are maps of the common coordinate to
    /// the tracks', none when they are the same.
    pub(crate) fn new(tracks: &[Track], warps: &[Warp]) -> Self {
        let warped = |i: usize, b: f64| warps.get(i).map_or(b, |warp| warp.at(b));
        let unwarped = |i: usize, fraction: f64| {
            warps.get(i).map_or(fraction, |warp| warp.inverse_at(fraction))
        };
        // Every sample of every demonstration is a place at which the time is known.
        let mut places: Vec<f64> = tracks
            .iter()
            .enumerate()
            .flat_map(|(i, track)| track.fractions.iter().map(move |f| unwarped(i, *f)))
            .collect();
        places.sort_by(f64::total_cmp);
        places.dedup();
        let active: Vec<Vec<f64>> = tracks
            .iter()
            .enumerate()
            .map(|(i, track)| places.iter().map(|b| track.active_at(warped(i, *b))).collect())
            .collect();
        let duration_s = median(&tracks.iter().map(Track::duration_s).collect::<Vec<_>>());
        let fractions: Vec<Vec<f64>> = active
            .iter()
            .map(|places| places.iter().map(|place| place / places[places.len() - 1]).collect())
            .collect();
        let times = common_pace(&places, &fractions);
        let times: Vec<f64> = times.iter().map(|time| duration_s * time).collect();
        let samples = active
            .iter()
            .zip(tracks)
            .map(|(places, track)| places.iter().map(|place| track.recorded(*place)).collect())
            .collect();
        let at = |i: usize, fraction: f64| interpolated(&places, &times, unwarped(i, fraction));
        let pauses = common_pauses(tracks, &at, SAME_PAUSE * duration_s);
        let whole_s = duration_s + pauses.iter().map(|pause| pause.duration_s).sum::<f64>();
        let recorded_at_s: Vec<f64> = tracks.iter().map(|track| track.sampling_time_s).collect();
        let wanted_s = median(&recorded_at_s);
        let least_s = SAMPLING_TIME_MIN_S.min(duration_s / 100.0).max(whole_s / SAMPLES_MAX);
        let steps = (whole_s / wanted_s.max(least_s)).round().max(1.0) as usize;
        let sampling_time_s = whole_s / steps as f64;
        Self { sampling_time_s, times, samples, pauses, steps, recorded_at_s }
    }

    /// The samples of a demonstration's recording at the common times.
    pub(crate) fn samples(&self, demonstration: usize) -> Vec<f64> {
        let one = |step: usize| self.sample_at(demonstration, step as f64 * self.sampling_time_s);
        (0..=self.steps).map(one).collect()
    }

    fn sample_at(&self, i: usize, time_s: f64) -> f64 {
        let mut left_s = time_s;
        for pause in &self.pauses {
            if left_s <= pause.at_s {
                break;
            }
            if left_s < pause.at_s + pause.duration_s {
                let samples = &pause.samples[i];
                let part = (left_s - pause.at_s) / pause.duration_s;
                return samples.start as f64 + part * samples.len() as f64;
            }
            left_s -= pause.duration_s;
        }
        interpolated(&self.times, &self.samples[i], left_s)
    }

    /// How much of a demonstration's pauses is kept \[s\].
    pub(crate) fn kept_pauses_s(&self, demonstration: usize) -> f64 {
        let lengths = self.pauses.iter().map(|pause| pause.samples[demonstration].len());
        lengths.sum::<usize>() as f64 * self.recorded_at_s[demonstration]
    }

    /// Beginning and duration of the pauses, in common time with pauses \[s\].
    pub(crate) fn pauses(&self) -> Vec<[f64; 2]> {
        let mut before_s = 0.0;
        let mut pauses = Vec::new();
        for pause in &self.pauses {
            pauses.push([pause.at_s + before_s, pause.duration_s]);
            before_s += pause.duration_s;
        }
        pauses
    }
}

/// Time of the least jerk from rest to rest at a fraction of the path, by bisection.
fn least_jerk(fraction: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let t: f64 = 0.5 * (low + high);
        let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        if s < fraction { low = t } else { high = t }
    }
    0.5 * (low + high)
}

/// Logarithm of the time that each of [`CELLS`] equal parts of the path takes.
fn log_pace(places: &[f64], times: &[f64]) -> Vec<f64> {
    let edge = |i: usize| interpolated(places, times, i as f64 / CELLS as f64);
    (0..CELLS).map(|i| ((edge(i + 1) - edge(i)) * CELLS as f64).max(PACE_MIN).ln()).collect()
}

/// The common time at places of the path, as a fraction of the duration.
///
/// The logarithm of the pace is the mean of the demonstrations', drawn towards that of the least jerk as far
/// as they differ from each other: what one of them happened to do is nobody's intention. With the
/// variance σ² of the mean, and τ² of what all together do beyond the least jerk, both estimated from the
/// demonstrations, it keeps τ²/(τ² + σ²) of it [Stein 1956; Efron and Morris 1973].
///
/// * `fractions`  of each demonstration's duration, at these places
fn common_pace(places: &[f64], fractions: &[Vec<f64>]) -> Vec<f64> {
    let count = fractions.len() as f64;
    let mean_time: Vec<f64> = (0..places.len())
        .map(|k| fractions.iter().map(|times| times[k]).sum::<f64>() / count)
        .collect();
    let paces: Vec<Vec<f64>> = fractions.iter().map(|times| log_pace(places, times)).collect();
    let smooth: Vec<f64> = places.iter().map(|place| least_jerk(*place)).collect();
    let smooth = log_pace(places, &smooth);
    let mean: Vec<f64> =
        (0..CELLS).map(|k| paces.iter().map(|pace| pace[k]).sum::<f64>() / count).collect();
    let variance = |k: usize| {
        let squares = paces.iter().map(|pace| (pace[k] - mean[k]).powi(2)).sum::<f64>();
        squares / (count - 1.0).max(1.0) / count
    };
    let beyond = (0..CELLS).map(|k| (mean[k] - smooth[k]).powi(2) - variance(k)).sum::<f64>();
    let beyond = (beyond / CELLS as f64).max(0.0);
    // By how much the mean of the times is slowed down, in each part.
    let mean_pace = log_pace(places, &mean_time);
    let factor = |k: usize| {
        let kept = if variance(k) > 0.0 { beyond / (beyond + variance(k)) } else { 1.0 };
        smooth[k] + kept * (mean[k] - smooth[k]) - mean_pace[k]
    };
    let factors: Vec<f64> = (0..CELLS).map(factor).collect();
    let centres: Vec<f64> = (0..CELLS).map(|k| (k as f64 + 0.5) / CELLS as f64).collect();
    let mut times = vec![0.0];
    for k in 1..places.len() {
        let between = 0.5 * (places[k - 1] + places[k]);
        let factor = interpolated(&centres, &factors, between).exp();
        times.push(times[k - 1] + factor * (mean_time[k] - mean_time[k - 1]));
    }
    let whole = times[times.len() - 1];
    times.iter_mut().for_each(|time| *time /= whole);
    times
}

/// The pauses that every demonstration makes, in order. `at` gives the common time of a fraction of a
/// demonstration's path.
fn common_pauses(
    tracks: &[Track],
    at: &impl Fn(usize, f64) -> f64,
    distance_max_s: f64,
) -> Vec<Pause> {
    let timed: Vec<Vec<(f64, &Range<usize>)>> = tracks
        .iter()
        .enumerate()
        .map(|(i, track)| track.pauses.iter().map(|(pause, f)| (at(i, *f), pause)).collect())
        .collect();
    let mut next = vec![0; tracks.len()];
    let mut pauses: Vec<Pause> = Vec::new();
    for (time, _) in &timed[0] {
        let matched: Option<Vec<(usize, f64)>> = timed
            .iter()
            .zip(&next)
            .map(|(all, next)| {
                let near = all.iter().enumerate().skip(*next);
                let near = near.map(|(k, (other, _))| (k, (other - time).abs()));
                let nearest = near.min_by(|a, b| a.1.total_cmp(&b.1))?;
                (nearest.1 <= distance_max_s).then_some((nearest.0, all[nearest.0].0))
            })
            .collect();
        let Some(matched) = matched else { continue };
        for (next, (k, _)) in next.iter_mut().zip(&matched) {
            *next = k + 1;
        }
        let samples: Vec<Range<usize>> =
            timed.iter().zip(&matched).map(|(all, (k, _))| all[*k].1.clone()).collect();
        let lengths = samples.iter().zip(tracks);
        let lengths = lengths.map(|(samples, track)| samples.len() as f64 * track.sampling_time_s);
        pauses.push(Pause {
            at_s: matched.iter().map(|(_, time)| time).sum::<f64>() / matched.len() as f64,
            duration_s: median(&lengths.collect::<Vec<_>>()),
            samples,
        });
    }
    pauses
}

/// The middle value; of an even number of them the mean of both.
fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5).expect("there are demonstrations")
}
