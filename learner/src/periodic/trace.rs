//! A recording along the length of its path, seen from its frame: rests have no length, and the pace none either.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::SVector;
use tprmp_spatial::Pose;

use crate::canonical::path::Path;
use crate::canonical::savitzky_golay::smooth;
use crate::demonstration::Demonstration;
use crate::skill::Skill;

/// A pose as numbers that never jump: position, and the columns of the rotation, in units of how large the motion is.
pub(super) type Feature = SVector<f64, 12>;

/// Slower than this fraction of the fast samples' speed is rest.
const REST_FRACTION: f64 = 0.05;
/// The speed that so many of the samples do not reach is that of the fast ones.
const FAST: f64 = 0.95;

/// A window of smoothing is too long where half of it gives a motion that is so far away, root of the mean square.
const LOST: f64 = 0.02;
/// A window has no fewer samples.
const WINDOW_SAMPLES_MIN: f64 = 8.0;

/// A recording seen from its frame, smoothed, along its length.
pub(super) struct Trace {
    /// Smoothed.
    features: Vec<Feature>,
    /// Length up to each sample.
    lengths: Vec<f64>,
}

/// Units of the features: 1/m, 1/rad.
#[derive(Clone, Copy)]
pub(super) struct Units(pub(super) [f64; 2]);

/// The poses of a demonstration seen from its frame.
pub(super) fn seen(demonstration: &Demonstration) -> Vec<Pose> {
    let frame = demonstration.goal_frame.inverse();
    let rotates = demonstration.manifold.has_orientation();
    let one = |pose: &Pose| {
        let pose = frame.compose(pose);
        if rotates { pose } else { Pose { orientation: DQuat::IDENTITY, ..pose } }
    };
    demonstration.poses.iter().map(one).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

impl Units {
    /// Those in which half of all poses lie within half a unit of their middle.
    pub(super) fn new(skill: &Skill, recordings: &[Vec<Pose>], orientation: DQuat) -> Self {
        let all = || recordings.iter().flatten();
        let middle: [f64; 3] =
            std::array::from_fn(|i| median(all().map(|pose| pose.position[i]).collect()));
        let middle = Pose { position: DVec3::from_array(middle), orientation };
        let metres = median(all().map(|p| (p.position - middle.position).length()).collect());
        let radians = median(all().map(|p| p.rotation_from(&middle).length()).collect());
        Self([
            0.5 / metres.max(0.25 * skill.scale.position_span_min_m),
            0.5 / radians.max(0.5 * skill.scale.orientation_span_min_rad),
        ])
    }

    fn parts(self, pose: &Pose) -> [DVec3; 4] {
        let Self([position, rotation]) = self;
        let axes =
            DMat3::from_quat(pose.orientation) * (rotation * std::f64::consts::FRAC_1_SQRT_2);
        [pose.position * position, axes.x_axis, axes.y_axis, axes.z_axis]
    }
}

impl Trace {
    pub(super) fn new(skill: &Skill, poses: &[Pose], sampling_time_s: f64, units: Units) -> Self {
        let parts: Vec<[DVec3; 4]> = poses.iter().map(|pose| units.parts(pose)).collect();
        let paths = smoothed(skill, &parts, sampling_time_s);
        let joined = |of: &dyn Fn(usize) -> DVec3| Feature::from_fn(|i, _| of(i / 3)[i % 3]);
        let count = poses.len();
        let features = (0..count).map(|i| joined(&|part| paths[part].points[i])).collect();
        let speeds: Vec<f64> =
            (0..count).map(|i| joined(&|part| paths[part].velocities[i]).norm()).collect();
        let mut sorted = speeds.clone();
        sorted.sort_by(f64::total_cmp);
        let rest = REST_FRACTION * sorted[((count - 1) as f64 * FAST) as usize];
        let mut lengths = vec![0.0];
        for pair in speeds.windows(2) {
            let speed = 0.5 * (pair[0] + pair[1]);
            let step = if speed > rest { speed * sampling_time_s } else { 0.0 };
            lengths.push(lengths[lengths.len() - 1] + step);
        }
        Self { features, lengths }
    }

    pub(super) fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    /// Features at equal steps of the length.
    pub(super) fn steps(&self, from: f64, step: f64, count: usize) -> Vec<Feature> {
        (0..count).map(|k| self.at(from + k as f64 * step)).collect()
    }

    /// The feature at a length.
    pub(super) fn at(&self, length: f64) -> Feature {
        let sample = self.sample(length);
        let i = (sample as usize).min(self.features.len() - 2);
        self.features[i].lerp(&self.features[i + 1], sample - i as f64)
    }

    /// The sample, with its fraction, at a length.
    pub(super) fn sample(&self, length: f64) -> f64 {
        let after = self.lengths.partition_point(|own| *own <= length);
        let i = after.clamp(1, self.lengths.len() - 1) - 1;
        let way = self.lengths[i + 1] - self.lengths[i];
        let fraction = if way > 0.0 { (length - self.lengths[i]) / way } else { 0.0 };
        i as f64 + fraction.clamp(0.0, 1.0)
    }

    /// The same recording, displaced.
    pub(super) fn moved(&self, by: &Feature) -> Self {
        let features = self.features.iter().map(|feature| feature + by).collect();
        Self { features, lengths: self.lengths.clone() }
    }

    /// The middle of its features, one by one.
    pub(super) fn middle(&self) -> Feature {
        Feature::from_fn(|i, _| median(self.features.iter().map(|feature| feature[i]).collect()))
    }
}

/// Smooths by a window that is shorter where the motion is faster than the skill file's: half of it must not show much
/// that it does not. The noise is averaged by either.
fn smoothed(skill: &Skill, parts: &[[DVec3; 4]], sampling_time_s: f64) -> [Path; 4] {
    let by = |window_s: f64| -> [Path; 4] {
        std::array::from_fn(|part| {
            let samples: Vec<DVec3> = parts.iter().map(|parts| parts[part]).collect();
            smooth(&samples, sampling_time_s, window_s, skill.smoothing.degree)
        })
    };
    let mut window_s = skill.smoothing.window_s;
    let mut paths = by(window_s);
    while window_s > WINDOW_SAMPLES_MIN * sampling_time_s {
        let half = by(0.5 * window_s);
        let apart = |i: usize| -> f64 {
            let both = paths.iter().zip(&half);
            both.map(|(a, b)| (a.points[i] - b.points[i]).length_squared()).sum()
        };
        let mean = (0..parts.len()).map(apart).sum::<f64>() / parts.len() as f64;
        if mean.sqrt() < LOST {
            break;
        }
        (window_s, paths) = (0.5 * window_s, half);
    }
    paths
}
