//! When a demonstration moves, rests and pauses.

use std::ops::Range;

use glam::{DQuat, DVec3};
use tprmp_spatial::Pose;

use crate::canonical::means::mean_goal;
use crate::canonical::path::Path;
use crate::canonical::savitzky_golay::smooth;
use crate::canonical::scales::{scales, span};
use crate::demonstration::{Demonstration, POINTS_MIN};
use crate::skill::{Scale, Smoothing};

/// A demonstration that moves less than this has no path to learn [m, or rad]: far below what any
/// robot repeats, far above rounding.
const MOTION_MIN: f64 = 1e-4;
/// So many times as fast as noise alone is on average, and it is motion: of three or six coordinates
/// with normal noise, one in a thousand is.
const NOISE_FACTOR: f64 = 2.5;
/// Median of the magnitude of normal noise, in standard deviations.
const MEDIAN_OF_NORMAL: f64 = 0.6745;
/// Where a demonstration begins and ends is its mean over so long \[s\].
const END_S: f64 = 0.2;

/// A demonstration cannot be brought into canonical coordinates, or cannot be learned from.
#[derive(Debug, thiserror::Error)]
#[error("demonstration `{name}`: {problem}")]
pub struct DemonstrationError {
    /// Its file name.
    pub name: String,
    /// What is wrong.
    pub problem: String,
}

/// How a demonstration moves, seen from its goal, in normalised coordinates.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Time between samples \[s\].
    pub sampling_time_s: f64,
    /// Samples between its rests.
    pub moving: Range<usize>,
    /// Stretches in between in which it rests, however short.
    pub pauses: Vec<Range<usize>>,
    /// Speed at each sample, smoothed [ŷ/s].
    pub speeds: Vec<f64>,
    /// Root of the mean square of the speed that the noise of a recording alone has [ŷ/s].
    pub noise_speed: f64,
    /// ŷ a metre, and a radian.
    pub scales: [f64; 2],
}

/// The samples of each demonstration between its rests (see [`motions`]).
///
/// # Errors
/// [`DemonstrationError`]: one does not move.
pub fn moving_ranges(
    demonstrations: &[Demonstration],
    smoothing: &Smoothing,
    scale: &Scale,
) -> Result<Vec<Range<usize>>, DemonstrationError> {
    Ok(motions(demonstrations, smoothing, scale)?.into_iter().map(|motion| motion.moving).collect())
}

/// How each demonstration moves. Samples before the first and after the last that is faster than rest are
/// no part of it. Rest is slower than a fraction of the largest speed, or than noise alone can be. The
/// speed is that seen from the goal frame, in normalised coordinates. It has to be fast from sample to
/// sample, which tells when exactly a motion begins, and fast when smoothed: noise is no motion.
///
/// # Errors
/// [`DemonstrationError`]: one does not move.
pub fn motions(
    demonstrations: &[Demonstration],
    smoothing: &Smoothing,
    scale: &Scale,
) -> Result<Vec<Motion>, DemonstrationError> {
    let grasp = mean_goal(demonstrations);
    let seen: Vec<Seen> = demonstrations.iter().map(|d| Seen::new(d, &grasp, smoothing)).collect();
    let of = |block: usize| span(seen.iter().map(|one| &one.smooth[block]), DQuat::IDENTITY);
    let scales = scales(scale, of(0), of(1));
    let motion = |(seen, demonstration): (&Seen, &Demonstration)| {
        if seen.span() < MOTION_MIN {
            let (name, problem) = (demonstration.name.clone(), "it does not move".into());
            return Err(DemonstrationError { name, problem });
        }
        Ok(seen.motion(demonstration.sampling_time_s, scales, smoothing))
    };
    seen.iter().zip(demonstrations).map(motion).collect()
}

/// Positions and rotation vectors of a demonstration at the mean goal, as recorded and smoothed.
struct Seen {
    sampled: [Vec<DVec3>; 2],
    smooth: [Path; 2],
    /// Coordinates of a position, and of a rotation.
    dimensions: [usize; 2],
}

impl Seen {
    fn new(d: &Demonstration, grasp: &Pose, smoothing: &Smoothing) -> Self {
        let goal = d.goal_frame.compose(grasp);
        let rotates = d.manifold.has_orientation();
        let seen = |pose: &Pose| {
            let pose = goal.inverse().compose(pose);
            let rotation = if rotates { pose.rotation_from(&Pose::IDENTITY) } else { DVec3::ZERO };
            (pose.position, rotation)
        };
        let (positions, rotations): (Vec<DVec3>, Vec<DVec3>) = d.poses.iter().map(seen).unzip();
        let sampled = [positions, rotations];
        let smooth = [0, 1].map(|block| {
            smooth(&sampled[block], d.sampling_time_s, smoothing.window_s, smoothing.degree)
        });
        let dimensions = [d.manifold.position_dimension(), if rotates { 3 } else { 0 }];
        Self { sampled, smooth, dimensions }
    }

    /// How far it moves, in the larger of both blocks [m, or rad].
    fn span(&self) -> f64 {
        let own = |path: &Path| span(std::iter::once(path), DQuat::IDENTITY);
        self.smooth.iter().map(own).fold(0.0, f64::max)
    }

    fn motion(&self, dt: f64, scales: [f64; 2], smoothing: &Smoothing) -> Motion {
        let size =
            |(p, r): (DVec3, DVec3)| (p * scales[0]).length().hypot((r * scales[1]).length());
        let [positions, rotations] = &self.smooth;
        let pairs = positions.velocities.iter().zip(&rotations.velocities);
        let speeds: Vec<f64> = pairs.map(|(p, r)| size((*p, *r))).collect();
        let steps: Vec<f64> = self.sampled[0]
            .windows(2)
            .zip(self.sampled[1].windows(2))
            .map(|(p, r)| size((p[1] - p[0], r[1] - r[0])))
            .collect();
        let count = speeds.len();
        let noise = self.noise(dt, scales, smoothing);
        let [kept, velocity] = response(count, dt, smoothing.window_s, smoothing.degree);
        let noise_speed = noise * velocity;
        let fastest = |speeds: &[f64]| speeds.iter().copied().fold(0.0, f64::max);
        let fraction = smoothing.rest_speed_fraction;
        let strict = [fraction * fastest(&speeds), fraction * fastest(&steps)];
        let rest_speed = strict[0].max(NOISE_FACTOR * noise_speed);
        let radius = NOISE_FACTOR * noise * kept.sqrt();
        let place = |i: usize| [positions.points[i] * scales[0], rotations.points[i] * scales[1]];
        let apart =
            |a: [DVec3; 2], b: [DVec3; 2]| (a[0] - b[0]).length().hypot((a[1] - b[1]).length());
        // Slower than any motion, or as slow as noise and no farther from the end than noise.
        let window = ((END_S / dt) as usize).clamp(1, count);
        let mean = |samples: Range<usize>| {
            let n = samples.len() as f64;
            let sum = samples.map(place).fold([DVec3::ZERO; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
            sum.map(|s| s / n)
        };
        let (start, end) = (mean(0..window), mean(count - window..count));
        let rests = |i: usize, step: Option<usize>, from: [DVec3; 2]| {
            speeds[i] < strict[0]
                || step.is_some_and(|step| steps[step] < strict[1])
                || speeds[i] < rest_speed && apart(place(i), from) < radius
        };
        let first =
            (0..count).take_while(|i| rests(*i, (*i < count - 1).then_some(*i), start)).count();
        let last = (0..count).rev().take_while(|i| rests(*i, i.checked_sub(1), end)).count();
        let (first, last) = (first.min(count - 1), count - 1 - last.min(count - 1));
        let long = last >= first + POINTS_MIN - 1;
        let mut moving = if long { first..last + 1 } else { 0..count };
        // Sampled steps tell when exactly it stops, smoothed speeds see through noise.
        let stands = |i: usize| i > 0 && i + 1 < count && steps[i - 1].max(steps[i]) < strict[1];
        let slow = runs(count, |i| moving.contains(&i) && (speeds[i] < rest_speed || stands(i)));
        let still = |run: &Range<usize>| {
            let (begins, ends) = (place(run.start), place(run.end - 1));
            let strictly = run.clone().all(|i| speeds[i] < strict[0] || stands(i));
            let inside = run.start > moving.start && run.end < moving.end;
            inside && (strictly || apart(begins, ends) < 2.0 * radius)
        };
        let mut pauses: Vec<Range<usize>> = slow.into_iter().filter(still).collect();
        // What noise has cut off from the rest at an end: soon after it, and in the same place.
        while let Some(pause) = pauses.first().cloned()
            && pause.start - moving.start <= window
            && apart(place(pause.start), start) < 2.0 * radius
            && moving.end - pause.end >= POINTS_MIN
        {
            moving.start = pause.end - 1;
            pauses.remove(0);
        }
        while let Some(pause) = pauses.last().cloned()
            && moving.end - pause.end <= window
            && apart(place(pause.end - 1), end) < 2.0 * radius
            && pause.start.saturating_sub(moving.start) >= POINTS_MIN
        {
            moving.end = pause.start + 1;
            pauses.pop();
        }
        Motion { sampling_time_s: dt, moving, pauses, speeds, noise_speed, scales }
    }

    /// Noise of the recording, root of the mean square in all coordinates \[ŷ\]: what smoothing took off.
    fn noise(&self, dt: f64, scales: [f64; 2], smoothing: &Smoothing) -> f64 {
        let count = self.sampled[0].len();
        let [kept, _] = response(count, dt, smoothing.window_s, smoothing.degree);
        let of = |block: usize| {
            let dimension = self.dimensions[block];
            let pairs = self.sampled[block].iter().zip(&self.smooth[block].points);
            let left = pairs.flat_map(|(raw, smooth)| {
                (*raw - *smooth).abs().to_array().into_iter().take(dimension)
            });
            let mut left: Vec<f64> = left.collect();
            if left.is_empty() {
                return 0.0;
            }
            let middle = left.len() / 2;
            let median = *left.select_nth_unstable_by(middle, f64::total_cmp).1;
            let deviation = median / MEDIAN_OF_NORMAL / (1.0 - kept).max(0.1).sqrt();
            deviation * scales[block] * (dimension as f64).sqrt()
        };
        of(0).hypot(of(1))
    }
}

/// What smoothing makes of noise of 1: what a sample has of itself afterwards, and the root of the sum of
/// squares of its part in velocities [1/s].
fn response(count: usize, dt: f64, window_s: f64, degree: usize) -> [f64; 2] {
    let mut impulse = vec![DVec3::ZERO; count];
    impulse[count / 2] = DVec3::X;
    let path = smooth(&impulse, dt, window_s, degree);
    let squares: f64 = path.velocities.iter().map(|v| v.x * v.x).sum();
    [path.points[count / 2].x, squares.sqrt()]
}

/// Runs of neighbours for which something holds.
pub(crate) fn runs(count: usize, holds: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for i in (0..count).filter(|i| holds(*i)) {
        match runs.last_mut() {
            Some(run) if run.end == i => run.end = i + 1,
            _ => runs.push(i..i + 1),
        }
    }
    runs
}
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rest_is_cut_to_the_sample_and_noise_is_no_motion() {
        let recorded = |noise: f64| {
            let sample = |i: i32| {
                let t = f64::from(i.clamp(30, 330) - 30) / 300.0;
                let chance = (f64::from(i) * 12.9898).sin() * noise;
                let position = DVec3::new(0.4 * t + chance, 0.1 * t, 0.0);
                Pose { position, orientation: DQuat::IDENTITY }
            };
            Demonstration {
                name: "a".into(),
                sha256: String::new(),
                skill: "line".into(),
                manifold: tprmp_model::skill_model::Manifold::R2,
                sampling_time_s: 0.005,
                start: Pose::IDENTITY,
                goal_frame: Pose::IDENTITY,
                other_frames: std::collections::BTreeMap::new(),
                remarks: tprmp_model::skill_model::Remarks::default(),
                poses: (0..400).map(sample).collect(),
                gripper: None,
            }
        };
        let smoothing = Smoothing { window_s: 0.4, degree: 3, rest_speed_fraction: 0.01 };
        let scale = Scale { span: 2.75, position_span_min_m: 0.1, orientation_span_min_rad: 1.0 };
        let ranges = moving_ranges(&[recorded(0.0)], &smoothing, &scale).unwrap();
        assert_eq!((ranges[0].start, ranges[0].end, ranges.len()), (30, 331, 1));
        // Some noise: the smoothed speed tells.
        let noisy = moving_ranges(&[recorded(2e-5)], &smoothing, &scale).unwrap();
        assert!(noisy[0].start.abs_diff(30) <= 40 && noisy[0].end.abs_diff(331) <= 40, "{noisy:?}");
        let still = Demonstration { poses: vec![Pose::IDENTITY; 50], ..recorded(0.0) };
        let error = moving_ranges(&[still], &smoothing, &scale).unwrap_err().to_string();
        assert!(error.contains("does not move"), "{error}");
    }
}
