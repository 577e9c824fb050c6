//! When a demonstration moves, and how far.

use glam::{DQuat, DVec3};
use tprmp_spatial::Pose;

use crate::canonical::means::mean_goal;
use crate::canonical::path::Path;
use crate::canonical::savitzky_golay::smooth;
use crate::demonstration::{Demonstration, POINTS_MIN, diagonal};
use crate::skill::{Scale, Smoothing};

/// A demonstration that moves less than this has no path to learn [m, or rad]: far below what any
/// robot repeats, far above rounding.
const MOTION_MIN: f64 = 1e-4;

/// A demonstration cannot be brought into canonical coordinates, or cannot be learned from.
#[derive(Debug, thiserror::Error)]
#[error("demonstration `{name}`: {problem}")]
pub struct DemonstrationError {
    /// Its file name.
    pub name: String,
    /// What is wrong.
    pub problem: String,
}

/// ŷ = s y for positions and rotations of these spans.
pub(crate) fn scales(scale: &Scale, position_m: f64, rotation_rad: f64) -> [f64; 2] {
    [
        scale.span / position_m.max(scale.position_span_min_m),
        scale.span / rotation_rad.max(scale.orientation_span_min_rad),
    ]
}

/// Diagonal of the bounding box of all points along these axes. Those of a frame rotate with the
/// demonstrations: so the span does not depend on how the robot's base frame lies.
pub(crate) fn span<'a>(paths: impl Iterator<Item = &'a Path> + Clone, axes: DQuat) -> f64 {
    let along = axes.conjugate();
    diagonal(paths.flat_map(|path| &path.points).map(|point| along * *point))
}

/// The samples of each demonstration between its rests: those before the first and after the last that
/// is faster than a fraction of the largest speed are cut. The speed is that seen from the goal frame, in
/// normalised coordinates. It has to be fast from sample to sample, which tells when exactly a motion
/// begins, and fast when smoothed: noise is no motion.
///
/// # Errors
/// [`DemonstrationError`]: one does not move.
pub fn moving_ranges(
    demonstrations: &[Demonstration],
    smoothing: &Smoothing,
    scale: &Scale,
) -> Result<Vec<std::ops::Range<usize>>, DemonstrationError> {
    let grasp = mean_goal(demonstrations);
    let (poses, paths): (Vec<[Vec<DVec3>; 2]>, Vec<[Path; 2]>) = demonstrations
        .iter()
        .map(|d| {
            let goal = d.goal_frame.compose(&grasp).inverse();
            let poses: Vec<Pose> = d.poses.iter().map(|pose| goal.compose(pose)).collect();
            let rotates = d.manifold.has_orientation();
            let rotation = |pose: &Pose| {
                if rotates { pose.rotation_from(&Pose::IDENTITY) } else { DVec3::ZERO }
            };
            let positions: Vec<DVec3> = poses.iter().map(|pose| pose.position).collect();
            let rotations: Vec<DVec3> = poses.iter().map(rotation).collect();
            let window = smoothing.window_s;
            let sampled = [positions, rotations];
            let smoothed = [0, 1]
                .map(|block| smooth(&sampled[block], d.sampling_time_s, window, smoothing.degree));
            (sampled, smoothed)
        })
        .unzip();
    let of = |block: usize| span(paths.iter().map(|paths| &paths[block]), DQuat::IDENTITY);
    let scales = scales(scale, of(0), of(1));
    let fast = |speeds: &[f64]| {
        let least = smoothing.rest_speed_fraction * speeds.iter().copied().fold(0.0, f64::max);
        let moves = |speed: &f64| *speed >= least;
        let first = speeds.iter().position(moves).unwrap_or(0);
        (first, speeds.iter().rposition(moves).unwrap_or(speeds.len() - 1))
    };
    let range = |(i, (poses, paths)): (usize, (&[Vec<DVec3>; 2], &[Path; 2]))| {
        let own = |path: &Path| span(std::iter::once(path), DQuat::IDENTITY);
        if paths.iter().map(own).fold(0.0, f64::max) < MOTION_MIN {
            let (name, problem) = (demonstrations[i].name.clone(), "it does not move".into());
            return Err(DemonstrationError { name, problem });
        }
        let pairs = paths[0].velocities.iter().zip(&paths[1].velocities);
        let size =
            |(p, r): (DVec3, DVec3)| (p * scales[0]).length().hypot((r * scales[1]).length());
        let speeds: Vec<f64> = pairs.map(|(p, r)| size((*p, *r))).collect();
        let steps: Vec<f64> = poses[0]
            .windows(2)
            .zip(poses[1].windows(2))
            .map(|(p, r)| size((p[1] - p[0], r[1] - r[0])))
            .collect();
        let (smooth, sampled) = (fast(&speeds), fast(&steps));
        let (first, last) = (smooth.0.max(sampled.0), smooth.1.min(sampled.1 + 1));
        let long = last >= first + POINTS_MIN - 1;
        Ok(if long { first..last + 1 } else { 0..speeds.len() })
    };
    poses.iter().zip(&paths).enumerate().map(range).collect()
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
                poses: (0..400).map(sample).collect(),
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
