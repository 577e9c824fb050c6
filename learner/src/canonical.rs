//! Canonical coordinates: the space in which all demonstrations share their frames.
//!
//! The canonical frames are the means of the demonstrations' frames; the goal is the mean final
//! pose of the tool relative to the goal frame. Each demonstration is pulled back through the map
//! of its own frames ([`tprmp_rmpflow::frame_map`]), then smoothed. Rest before and after the motion
//! is cut: a field of the state alone cannot wait, and would take it for a place to stay.

use glam::{DQuat, DVec3};
use tprmp_rmpflow::frame_map::{
    Canonical, CanonicalFrames, Displacement, FrameMap, FrameMotion, Pose,
};

use crate::demonstration::{Demonstration, POINTS_MIN};
use crate::error::LearnerError;
use crate::orientation::mean_orientation;
use crate::savitzky_golay::{Path, smooth};
use crate::skill::{Scale, Smoothing};

/// Largest angle between a demonstrated orientation and the goal's [rad]: the chart ends at π.
const ANGLE_MAX_RAD: f64 = 0.95 * std::f64::consts::PI;
/// Least determinant of a demonstration's frame map along the way from start to goal.
const DETERMINANT_MIN: f64 = 0.2;
/// Points of the way at which it is looked at.
const DETERMINANT_POINTS: u32 = 50;
/// Positions follow the turn of the frames unless the demonstrations then lie so much farther apart
/// that their spread is this share of it or less when positions do not turn. Below 1: it takes
/// frames that were shown turned, and a way that was shown not to turn.
const UPRIGHT_SHARE: f64 = 0.75;
/// Points of a path at which demonstrations are compared.
const SPREAD_POINTS: usize = 50;
/// Frames are fixed to each other when they move less than this [m] …
const FIXED_M: f64 = 1e-9;
/// … and turn less than this [rad].
const FIXED_RAD: f64 = 1e-9;
/// Least distance between the canonical start frame and the goal [m].
const AXIS_MIN_M: f64 = 1e-3;

/// Demonstrations in canonical coordinates.
#[derive(Clone, Debug)]
pub struct CanonicalSet {
    /// The map of the frames.
    pub map: FrameMap,
    /// s in ŷ = s y, of the positions [1/m] and of the rotations [1/rad].
    pub scales: [f64; 2],
    /// One a demonstration, in their order.
    pub demonstrations: Vec<CanonicalDemonstration>,
}

/// A demonstration in canonical coordinates.
#[derive(Clone, Debug)]
pub struct CanonicalDemonstration {
    /// Its frames, ready to map with.
    pub displacement: Displacement,
    /// Samples at rest that were cut at its start.
    pub rest: usize,
    /// Positions [m].
    pub position: Path,
    /// Rotation vectors at the goal [rad]; all zero for skills without an orientation.
    pub rotation: Path,
}

/// Brings demonstrations into canonical coordinates.
///
/// # Errors
/// [`LearnerError::Demonstration`]: start and goal coincide, the frames of a demonstration differ
/// so much from the others' that their map folds, or it turns by almost 180° or more against the
/// goal.
pub fn canonicalise(
    demonstrations: &[Demonstration],
    smoothing: &Smoothing,
    scale: &Scale,
) -> Result<CanonicalSet, LearnerError> {
    let frames = canonical_frames(demonstrations);
    let fail =
        |name: &str, problem: String| LearnerError::Demonstration { name: name.into(), problem };
    let distance = (frames.goal.position - frames.start.position).length();
    let no_axis = || {
        let problem = format!(
            "start frame and goal are only {distance:.6} m apart in the mean of the \
             demonstrations; the way from one to the other is what the skill is laid along"
        );
        fail(&demonstrations[0].name, problem)
    };
    if distance < AXIS_MIN_M {
        return Err(no_axis());
    }
    let turning = FrameMap::new(frames).map_err(|_| no_axis())?;
    let upright = FrameMap::new(CanonicalFrames { positions_turn: false, ..frames })
        .map_err(|_| no_axis())?;
    // Frames that turn and a way that does not: then positions do not follow the turn.
    let map = if spread(&upright, demonstrations) < UPRIGHT_SHARE * spread(&turning, demonstrations)
    {
        upright
    } else {
        turning
    };
    let mut set: Vec<CanonicalDemonstration> = Vec::with_capacity(demonstrations.len());
    for demonstration in demonstrations {
        let displacement = displacement(&map, &demonstration.start, &demonstration.goal_frame);
        if least_determinant(&map, &displacement) < DETERMINANT_MIN {
            let problem = "its start and goal frame lie so differently from the other \
                           demonstrations' that the space between them would fold; show start \
                           and goal in similar places";
            return Err(fail(&demonstration.name, problem.into()));
        }
        let mut phase = 0.0;
        let mut positions = Vec::with_capacity(demonstration.poses.len());
        let mut rotations = Vec::with_capacity(demonstration.poses.len());
        for (i, pose) in demonstration.poses.iter().enumerate() {
            let mut point = map.inverse(&displacement, pose, &mut phase);
            if !demonstration.manifold.has_orientation() {
                point.rotation = DVec3::ZERO;
            }
            let angle = point.rotation.length();
            if angle > ANGLE_MAX_RAD {
                let problem = format!(
                    "sample {i} is turned by {:.0}° against the goal; at most {:.0}° can be learned",
                    angle.to_degrees(),
                    ANGLE_MAX_RAD.to_degrees()
                );
                return Err(fail(&demonstration.name, problem));
            }
            positions.push(point.position);
            rotations.push(point.rotation);
        }
        let smoothed = |samples: &[DVec3]| {
            smooth(samples, demonstration.sampling_time_s, smoothing.window_s, smoothing.degree)
        };
        let (position, rotation) = (smoothed(&positions), smoothed(&rotations));
        set.push(CanonicalDemonstration { displacement, rest: 0, position, rotation });
    }
    let positions = span(set.iter().map(|d| &d.position), frames.goal_frame.orientation);
    let rotations = span(set.iter().map(|d| &d.rotation), DQuat::IDENTITY);
    let scales = [
        scale.span / positions.max(scale.position_span_min_m),
        scale.span / rotations.max(scale.orientation_span_min_rad),
    ];
    for (canonical, demonstration) in set.iter_mut().zip(demonstrations) {
        canonical.cut_rest(scales, smoothing.rest_speed_share);
        end_at(&mut canonical.position, frames.goal.position, demonstration.sampling_time_s);
        end_at(&mut canonical.rotation, DVec3::ZERO, demonstration.sampling_time_s);
    }
    Ok(CanonicalSet { map, scales, demonstrations: set })
}

/// Diagonal of the bounding box of all points along these axes. Those of a frame turn with the
/// demonstrations: so the span does not depend on how the robot's base frame lies.
fn span<'a>(paths: impl Iterator<Item = &'a Path> + Clone, axes: DQuat) -> f64 {
    let along = axes.conjugate();
    let points = || paths.clone().flat_map(|path| path.points.iter().map(|point| along * *point));
    let low = points().reduce(DVec3::min).unwrap_or_default();
    let high = points().reduce(DVec3::max).unwrap_or_default();
    (high - low).length()
}

impl CanonicalDemonstration {
    /// Cuts the samples before the first and after the last that is faster than a share of the
    /// largest speed, in normalised coordinates.
    fn cut_rest(&mut self, scales: [f64; 2], share: f64) {
        let pairs = self.position.velocities.iter().zip(&self.rotation.velocities);
        let speeds: Vec<f64> = pairs
            .map(|(p, r)| (*p * scales[0]).length().hypot((*r * scales[1]).length()))
            .collect();
        let least = share * speeds.iter().copied().fold(0.0, f64::max);
        let moves = |speed: &f64| *speed >= least;
        let first = speeds.iter().position(moves).unwrap_or(0);
        let last = speeds.iter().rposition(moves).unwrap_or(speeds.len() - 1);
        if last - first + 1 >= POINTS_MIN {
            self.rest = first;
            for path in [&mut self.position, &mut self.rotation] {
                for samples in [&mut path.points, &mut path.velocities, &mut path.accelerations] {
                    samples.truncate(last + 1);
                    samples.drain(..first);
                }
            }
        }
    }
}

/// How far the demonstrations lie apart in the canonical coordinates of a map [m, rms], at equal
/// shares of their lengths.
fn spread(map: &FrameMap, demonstrations: &[Demonstration]) -> f64 {
    let paths: Vec<Vec<DVec3>> = demonstrations
        .iter()
        .map(|demonstration| {
            let displacement = displacement(map, &demonstration.start, &demonstration.goal_frame);
            let mut phase = 0.0;
            let points: Vec<DVec3> = demonstration
                .poses
                .iter()
                .map(|pose| map.inverse(&displacement, pose, &mut phase).position)
                .collect();
            at_equal_lengths(&points)
        })
        .collect();
    let count = paths.len() as f64;
    let variance = |i: usize| -> f64 {
        let mean = paths.iter().map(|p| p[i]).sum::<DVec3>() / count;
        paths.iter().map(|p| (p[i] - mean).length_squared()).sum::<f64>() / count
    };
    ((0..SPREAD_POINTS).map(variance).sum::<f64>() / SPREAD_POINTS as f64).sqrt()
}

/// [`SPREAD_POINTS`] points of a path, at equal steps of its length.
fn at_equal_lengths(points: &[DVec3]) -> Vec<DVec3> {
    let mut lengths = vec![0.0];
    for pair in points.windows(2) {
        lengths.push(lengths[lengths.len() - 1] + (pair[1] - pair[0]).length());
    }
    let whole = lengths[lengths.len() - 1];
    (0..SPREAD_POINTS)
        .map(|i| {
            let at = whole * i as f64 / (SPREAD_POINTS - 1) as f64;
            let k = lengths.partition_point(|l| *l < at).clamp(1, points.len() - 1);
            let step = lengths[k] - lengths[k - 1];
            let share = if step > 0.0 { (at - lengths[k - 1]) / step } else { 0.0 };
            points[k - 1].lerp(points[k], share.clamp(0.0, 1.0))
        })
        .collect()
}

/// The frames at rest at these poses.
fn displacement(map: &FrameMap, start: &Pose, goal_frame: &Pose) -> Displacement {
    map.displace(&FrameMotion::at_rest(*start), &FrameMotion::at_rest(*goal_frame))
}

/// Least determinant of the map of these frames on the straight way from start to goal.
fn least_determinant(map: &FrameMap, displacement: &Displacement) -> f64 {
    let (start, goal) = (map.canonical().start.position, map.canonical().goal.position);
    let determinant = |i| {
        let mut phase = f64::from(i) / f64::from(DETERMINANT_POINTS);
        let position = start.lerp(goal, phase);
        let pose = map.forward(displacement, &Canonical { position, rotation: DVec3::ZERO });
        map.map(displacement, &pose, DVec3::ZERO, DVec3::ZERO, &mut phase).determinant
    };
    (0..=DETERMINANT_POINTS).map(determinant).fold(f64::INFINITY, f64::min)
}

/// The start of a skill that has no start frame: where the tool is on average at first, seen from
/// the goal frame.
#[must_use]
pub fn mean_start(demonstrations: &[Demonstration]) -> Pose {
    let seen = |d: &Demonstration| {
        d.goal_frame.inverse().compose(d.poses.first().expect("a demonstration has points"))
    };
    mean_pose(&demonstrations.iter().map(seen).collect::<Vec<_>>())
}

/// Mean frames and goal of the demonstrations.
///
/// # Panics
/// When there is no demonstration.
#[must_use]
pub fn canonical_frames(demonstrations: &[Demonstration]) -> CanonicalFrames {
    let poses = |f: &dyn Fn(&Demonstration) -> Pose| -> Vec<Pose> {
        demonstrations.iter().map(f).collect()
    };
    let goal_frame = mean_pose(&poses(&|d| d.goal_frame));
    let between = poses(&|d| d.goal_frame.inverse().compose(&d.start));
    let fixed = between.iter().all(|pose| {
        (pose.position - between[0].position).length() < FIXED_M
            && pose.rotation_from(&between[0]).length() < FIXED_RAD
    });
    // Frames that are fixed to each other are so in canonical coordinates.
    let start =
        if fixed { goal_frame.compose(&between[0]) } else { mean_pose(&poses(&|d| d.start)) };
    let grasp = mean_pose(&poses(&|d| {
        d.goal_frame.inverse().compose(d.poses.last().expect("a demonstration has points"))
    }));
    let mut goal = goal_frame.compose(&grasp);
    goal.orientation = if demonstrations[0].manifold.has_orientation() {
        goal.orientation.normalize()
    } else {
        goal_frame.orientation
    };
    CanonicalFrames { start, goal_frame, goal, positions_turn: true }
}

/// The mean of poses.
pub(crate) fn mean_pose(poses: &[Pose]) -> Pose {
    let orientations: Vec<_> = poses.iter().map(|p| p.orientation).collect();
    let position = poses.iter().map(|p| p.position).sum::<DVec3>() / poses.len() as f64;
    let weights = vec![1.0; poses.len()];
    Pose { position, orientation: mean_orientation(&orientations, &weights) }
}

/// Lets a path end exactly at the goal: what is missing is faded in over its whole length, with no
/// change of velocity or acceleration at either end.
fn end_at(path: &mut Path, goal: DVec3, sampling_time_s: f64) {
    let last = path.points.len() - 1;
    let missing = goal - path.points[last];
    let duration_s = last as f64 * sampling_time_s;
    for i in 0..=last {
        let t = i as f64 / last as f64;
        // The quintic blend and its derivatives.
        let blend = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        let rate = 30.0 * t * t * (1.0 - t) * (1.0 - t) / duration_s;
        let bend = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / (duration_s * duration_s);
        path.points[i] += missing * blend;
        path.velocities[i] += missing * rate;
        path.accelerations[i] += missing * bend;
    }
    path.points[last] = goal;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_ends_at_the_goal_and_stays_consistent() {
        let dt = 0.01;
        let samples: Vec<_> = (0..200)
            .map(|i| DVec3::new((f64::from(i) * dt).sin(), (f64::from(i) * dt).cos(), 0.1))
            .collect();
        let mut path = smooth(&samples, dt, 0.2, 3);
        let goal = samples[199] + DVec3::new(0.02, -0.01, 0.03);
        end_at(&mut path, goal, dt);
        assert_eq!(path.points[199], goal);
        for i in 20..180 {
            let rate = (path.points[i + 1] - path.points[i - 1]) / (2.0 * dt);
            let bend = (path.velocities[i + 1] - path.velocities[i - 1]) / (2.0 * dt);
            assert!((rate - path.velocities[i]).length() < 1e-4);
            assert!((bend - path.accelerations[i]).length() < 1e-2);
        }
    }
}
