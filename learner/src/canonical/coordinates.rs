//! Canonical coordinates: the space in which all demonstrations share their frames.
//!
//! The canonical frames are the means of the demonstrations' frames; the goal is the mean final
//! pose of the tool relative to the goal frame. Rest before and after the motion is cut; in between
//! the phase of a demonstration is its time as a fraction, at rest at either end. Each demonstration is
//! pulled back through the map of its own frames ([`tprmp_rmpflow::policy::canonical::frame_map`]), then smoothed.
//!
//! Further frames act where they matter: at the phase at which the demonstrations, seen from such a
//! frame, agree best against what start and goal frame see. One in which they never agree better is
//! left out of the map.

use glam::{DQuat, DVec3};
use tprmp_rmpflow::policy::canonical::frame_map::{
    Anchor, Canonical, FrameMap, FrameMapError, FrameTransforms, PHASE_DISTANCE_MIN,
};
use tprmp_spatial::{MovingPose, Pose};

use crate::canonical::adaptation::Seen;
use crate::canonical::kaiser_smoothing::kaiser_smoothing;
use crate::canonical::means::mean_orientation;
use crate::canonical::phase_profile::PhaseProfile;
use crate::canonical::savitzky_golay::{Path, smooth};
use crate::demonstration::{Demonstration, POINTS_MIN};
use crate::skill::{FitSettings, Scale, Skill, Smoothing};

/// Largest angle between a demonstrated orientation and the goal's [rad]: the chart ends at π.
const ANGLE_MAX_RAD: f64 = 0.95 * std::f64::consts::PI;
/// Positions follow the turn of the frames unless the demonstrations foretell each other so much better
/// when they do not: then the error is this fraction of it or less. Below 1: it takes frames that were
/// shown turned, and a way that was shown not to turn.
const UPRIGHT_FRACTION: f64 = 0.9;
/// The change from the start to the goal frame takes the whole way unless the demonstrations lie this
/// fraction as far apart, or less, when it begins later or ends earlier …
const CHANGE_FRACTION: f64 = 0.8;
/// … at one of so many phases of the first and of the second half …
const CHANGES_COMPARED: usize = 11;
/// … over no less than this fraction of the way: the faster it is, the more the frames' motion is felt.
const CHANGE_MIN: f64 = 0.25;
/// Phases at which demonstrations are compared.
const PHASES_COMPARED: usize = 50;
/// A further frame acts where the demonstrations seen from it lie this fraction or less as far apart as
/// seen from start and goal frame …
const AGREEMENT_FRACTION: f64 = 0.5;
/// … counting differences below this fraction of the demonstrations' span as none.
const AGREEMENT_FLOOR: f64 = 0.005;
/// Frames are fixed to each other when they move less than this [m] …
const FIXED_M: f64 = 1e-9;
/// … and turn less than this [rad].
const FIXED_RAD: f64 = 1e-9;
/// A demonstration that begins in motion is followed from rest: it is caught up with at this multiple
/// of the policy's damping. Slower is behind for longer, faster is more acceleration at the start.
const CATCH_UP: f64 = 1.5;
/// A demonstration that moves less than this has no way to learn [m, or rad of its turn].
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

/// Demonstrations in canonical coordinates.
#[derive(Clone, Debug)]
pub struct CanonicalSet {
    /// The map of the frames.
    pub map: FrameMap,
    /// How the phase runs.
    pub profile: PhaseProfile,
    /// The start frame in canonical coordinates.
    pub start: Pose,
    /// s in ŷ = s y, of the positions [1/m] and of the rotations [1/rad].
    pub scales: [f64; 2],
    /// One a demonstration, in their order.
    pub demonstrations: Vec<CanonicalDemonstration>,
}

/// A demonstration in canonical coordinates.
#[derive(Clone, Debug)]
pub struct CanonicalDemonstration {
    /// Its frames, ready to map with.
    pub transforms: FrameTransforms,
    /// Samples at rest that were cut at its start.
    pub rest: usize,
    /// Fraction of the duration at which each sample is taken.
    pub times: Vec<f64>,
    /// Phase of each sample, with its first two derivatives in time [1, 1/s, 1/s²].
    pub phases: Vec<[f64; 3]>,
    /// Positions [m].
    pub position: Path,
    /// Rotation vectors at the goal [rad]; all zero for skills without an orientation.
    pub rotation: Path,
}

/// Brings demonstrations into canonical coordinates.
///
/// # Errors
/// [`DemonstrationError`]: it does not move, or turns by almost 180° or more against the
/// goal.
///
/// # Panics
/// When there is no demonstration, or one lacks a frame of the skill.
pub fn canonicalise(
    skill: &Skill,
    demonstrations: &[Demonstration],
) -> Result<CanonicalSet, DemonstrationError> {
    let (smoothing, scale) = (&skill.smoothing, &skill.scale);
    let fail = |name: &str, problem: String| DemonstrationError { name: name.into(), problem };
    let mean = mean_frames(demonstrations);
    let moving = moving_ranges(demonstrations, smoothing, scale)?;
    let shown: Vec<Shown> = demonstrations
        .iter()
        .zip(&moving)
        .map(|(demonstration, range)| Shown {
            frames: skill.frames(demonstration),
            poses: &demonstration.poses[range.clone()],
        })
        .collect();
    let durations = demonstrations
        .iter()
        .zip(&moving)
        .map(|(demonstration, range)| (range.len() - 1) as f64 * demonstration.sampling_time_s);
    let profile =
        PhaseProfile::of(&skill.fit, durations.sum::<f64>() / demonstrations.len() as f64);
    let anchors = anchors(skill, &mean, &shown, &profile);
    let map = frame_map(skill, &mean, &anchors, &shown, &profile)
        .map_err(|error| fail(&demonstrations[0].name, format!("{error:?}")))?;
    let mut set: Vec<CanonicalDemonstration> = Vec::with_capacity(demonstrations.len());
    for ((demonstration, range), shown) in demonstrations.iter().zip(&moving).zip(&shown) {
        let transforms = shown.displacement(&map);
        let (count, sampling_time_s) = (shown.poses.len(), demonstration.sampling_time_s);
        let times: Vec<f64> = (0..count).map(|i| i as f64 / (count - 1) as f64).collect();
        let phases: Vec<_> = {
            let duration_s = (count - 1) as f64 * sampling_time_s;
            let of = |time: f64| {
                let [phase, rate, bend] = profile.at(time);
                [phase, rate / duration_s, bend / (duration_s * duration_s)]
            };
            times.iter().map(|time| of(*time)).collect()
        };
        let mut positions = Vec::with_capacity(count);
        let mut rotations = Vec::with_capacity(count);
        for (i, (pose, [phase, ..])) in shown.poses.iter().zip(&phases).enumerate() {
            let mut point = map.inverse(&transforms, *phase, pose);
            if !demonstration.manifold.has_orientation() {
                point.rotation = DVec3::ZERO;
            }
            let angle = point.rotation.length();
            if angle > ANGLE_MAX_RAD {
                let problem = format!(
                    "sample {} is turned by {:.0}° against the goal; at most {:.0}° can be learned",
                    range.start + i,
                    angle.to_degrees(),
                    ANGLE_MAX_RAD.to_degrees()
                );
                return Err(fail(&demonstration.name, problem));
            }
            positions.push(point.position);
            rotations.push(point.rotation);
        }
        let smoothed = |samples: &[DVec3]| {
            smooth(samples, sampling_time_s, smoothing.window_s, smoothing.degree)
        };
        let (mut position, mut rotation) = (smoothed(&positions), smoothed(&rotations));
        if let FitSettings::Canonical(settings) = &skill.fit {
            for path in [&mut position, &mut rotation] {
                start_from_rest(path, CATCH_UP * settings.damping_1_s, sampling_time_s);
            }
        }
        end_at(&mut position, mean.goal.position, sampling_time_s);
        end_at(&mut rotation, DVec3::ZERO, sampling_time_s);
        let rest = range.start;
        set.push(CanonicalDemonstration { transforms, rest, times, phases, position, rotation });
    }
    let scales = scales(
        scale,
        span(set.iter().map(|d| &d.position), mean.goal_frame.orientation),
        span(set.iter().map(|d| &d.rotation), DQuat::IDENTITY),
    );
    Ok(CanonicalSet { map, profile, start: mean.start, scales, demonstrations: set })
}

/// ŷ = s y for positions and rotations of these spans.
fn scales(scale: &Scale, position_m: f64, rotation_rad: f64) -> [f64; 2] {
    [
        scale.span / position_m.max(scale.position_span_min_m),
        scale.span / rotation_rad.max(scale.orientation_span_min_rad),
    ]
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
    let mean = mean_frames(demonstrations);
    let grasp = mean.goal_frame.inverse().compose(&mean.goal);
    let (poses, paths): (Vec<[Vec<DVec3>; 2]>, Vec<[Path; 2]>) = demonstrations
        .iter()
        .map(|d| {
            let goal = d.goal_frame.compose(&grasp).inverse();
            let poses: Vec<Pose> = d.poses.iter().map(|pose| goal.compose(pose)).collect();
            let turns = d.manifold.has_orientation();
            let rotation = |pose: &Pose| {
                if turns { pose.rotation_from(&Pose::IDENTITY) } else { DVec3::ZERO }
            };
            let positions: Vec<DVec3> = poses.iter().map(|pose| pose.position).collect();
            let rotations: Vec<DVec3> = poses.iter().map(rotation).collect();
            let window = smoothing.window_s;
            let seen = [positions, rotations];
            let smoothed = [0, 1]
                .map(|block| smooth(&seen[block], d.sampling_time_s, window, smoothing.degree));
            (seen, smoothed)
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

/// A demonstration without its rest: its frames in the order of the skill, and its poses.
struct Shown<'a> {
    frames: Vec<Pose>,
    poses: &'a [Pose],
}

impl Shown<'_> {
    fn displacement(&self, map: &FrameMap) -> FrameTransforms {
        map.transforms(&self.at_rest()).expect("a demonstration has the skill's frames")
    }

    fn at_rest(&self) -> Vec<MovingPose> {
        self.frames.iter().copied().map(MovingPose::at_rest).collect()
    }

    /// Fraction of the time, and pose, nearest to one of [`PHASES_COMPARED`] equal steps.
    fn at(&self, step: usize) -> (f64, Pose) {
        let last = self.poses.len() - 1;
        let time = fraction(step);
        let i = (time * last as f64).round() as usize;
        (i as f64 / last as f64, self.poses[i])
    }
}

/// The frames of the map: start, goal, and the further frames that matter in between.
fn anchors(
    skill: &Skill,
    mean: &MeanFrames,
    shown: &[Shown],
    profile: &PhaseProfile,
) -> Vec<Anchor> {
    let single = skill.start_frame == skill.goal_frame;
    let goal = usize::from(!single);
    let mut anchors = Vec::new();
    if !single {
        let (frame, point) = (mean.start, mean.start.position);
        anchors.push(Anchor { index: 0, frame, point, phase: 0.0 });
    }
    let positions = || shown.iter().flat_map(|s| s.poses).map(|pose| pose.position);
    let low = positions().reduce(DVec3::min).unwrap_or_default();
    let high = positions().reduce(DVec3::max).unwrap_or_default();
    let floor = (AGREEMENT_FLOOR * (high - low).length()).powi(2);
    // Mean square distance from the mean of what a frame sees.
    let variance = |index: usize, step: usize| {
        let seen: Vec<DVec3> = shown
            .iter()
            .map(|s| s.frames[index].inverse().compose(&s.at(step).1).position)
            .collect();
        let mean = seen.iter().sum::<DVec3>() / seen.len() as f64;
        let squares = seen.iter().map(|p| (p - mean).length_squared());
        (squares.sum::<f64>() / seen.len() as f64 + floor, mean)
    };
    let mut ways: Vec<Anchor> = Vec::new();
    for index in goal + 1..goal + 1 + skill.other_frames.len() {
        let fraction = |step: usize| {
            let others = (0..=goal).map(|other| variance(other, step).0);
            (variance(index, step).0 / others.fold(f64::INFINITY, f64::min)).sqrt()
        };
        let steps = (0..PHASES_COMPARED).filter(|step| {
            let phase = profile.at(*step as f64 / (PHASES_COMPARED - 1) as f64)[0];
            (PHASE_DISTANCE_MIN..=1.0 - PHASE_DISTANCE_MIN).contains(&phase)
        });
        let best = steps.map(|step| (step, fraction(step))).min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((step, _)) = best.filter(|(_, fraction)| *fraction <= AGREEMENT_FRACTION) {
            let poses: Vec<Pose> = shown.iter().map(|s| s.frames[index]).collect();
            let frame = mean_pose(&poses);
            let point = frame.position + frame.orientation * variance(index, step).1;
            let phase = profile.at(step as f64 / (PHASES_COMPARED - 1) as f64)[0];
            ways.push(Anchor { index, frame, point, phase });
        }
    }
    ways.sort_by(|a, b| a.phase.total_cmp(&b.phase));
    // Of frames that matter at the same time, the first one acts.
    ways.dedup_by(|later, earlier| later.phase - earlier.phase < PHASE_DISTANCE_MIN);
    anchors.extend(ways);
    let (frame, point) = (mean.goal_frame, mean.goal.position);
    anchors.push(Anchor { index: goal, frame, point, phase: 1.0 });
    anchors
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

/// The map in which the demonstrations lie nearest to each other: whether positions turn with the
/// frames, and at which phases the start frame lets go and the goal frame takes over.
///
/// Not every map that does better by chance is taken: positions turn, and the change takes the whole
/// way, unless the demonstrations show otherwise. What they show beyond it, the way bends by (see
/// [`crate::canonical::adaptation`]).
fn frame_map(
    skill: &Skill,
    mean: &MeanFrames,
    anchors: &[Anchor],
    shown: &[Shown],
    profile: &PhaseProfile,
) -> Result<FrameMap, FrameMapError> {
    // Along axes that turn with the demonstrations.
    let axes = mean.goal_frame.orientation.conjugate();
    let positions = || shown.iter().flat_map(|s| s.poses).map(|pose| axes * pose.position);
    let low = positions().reduce(DVec3::min).unwrap_or_default();
    let high = positions().reduce(DVec3::max).unwrap_or_default();
    let scales = scales(&skill.scale, (high - low).length(), 0.0);
    let turns = skill.manifold.has_orientation();
    let scales = [scales[0], if turns { scales[1] } else { 0.0 }];
    let apart = |map: &FrameMap| spread(&seen(map, shown, profile, scales));
    // A frame in between is passed at its phase, and to one frame nothing shifts: there nothing bends.
    let two = anchors.len() == 2 && skill.start_frame != skill.goal_frame;
    let adapts = two && matches!(skill.fit, FitSettings::Canonical(_));
    // With what the way bends by, and how far a demonstration lies from what the others foretell.
    let learned = |map: FrameMap| -> (FrameMap, f64) {
        if !adapts {
            return (map, apart(&map));
        }
        let phases: Vec<f64> =
            (0..PHASES_COMPARED).map(|step| profile.at(fraction(step))[0]).collect();
        let learned = crate::canonical::adaptation::learn(
            &seen(&map, shown, profile, scales),
            &phases,
            scales,
        );
        (map.with_adaptation(learned.adaptation), learned.error)
    };
    let best = |turn: bool| -> Result<(FrameMap, f64), FrameMapError> {
        let whole = FrameMap::new(anchors, mean.goal, turn)?;
        let mut best = (whole, apart(&whole));
        let most = CHANGE_FRACTION * best.1;
        let phase = |i: usize| 0.5 * i as f64 / (CHANGES_COMPARED - 1) as f64;
        for step in 0..CHANGES_COMPARED * CHANGES_COMPARED {
            let mut anchors = anchors.to_vec();
            let [first, .., last] = &mut anchors[..] else { break };
            first.phase = phase(step / CHANGES_COMPARED);
            last.phase = 1.0 - phase(step % CHANGES_COMPARED);
            if anchors.windows(2).any(|pair| pair[1].phase - pair[0].phase < CHANGE_MIN) {
                continue;
            }
            let map = FrameMap::new(&anchors, mean.goal, turn)?;
            let apart = apart(&map);
            if apart < best.1.min(most) {
                best = (map, apart);
            }
        }
        // First as the frames carry it, which holds wherever they are; then what is left of it.
        Ok(learned(best.0))
    };
    let (turning, upright) = (best(true)?, best(false)?);
    // Frames that turn and a way that does not: then positions do not follow the turn.
    Ok(if upright.1 < UPRIGHT_FRACTION * turning.1 { upright.0 } else { turning.0 })
}

/// The fraction of the time of one of [`PHASES_COMPARED`] equal steps.
fn fraction(step: usize) -> f64 {
    step as f64 / (PHASES_COMPARED - 1) as f64
}

/// The demonstrations in the canonical coordinates of a map, at equal fractions of their times.
fn seen(map: &FrameMap, shown: &[Shown], profile: &PhaseProfile, scales: [f64; 2]) -> Vec<Seen> {
    let one = |shown: &Shown| {
        let transforms = shown.displacement(map);
        let at = |step| {
            let (time, pose) = shown.at(step);
            let y = map.inverse(&transforms, profile.at(time)[0], &pose);
            [y.position * scales[0], y.rotation * scales[1]]
        };
        let shift = map.goal_shift(&shown.at_rest()).expect("they are the skill's frames");
        Seen { shift, path: (0..PHASES_COMPARED).map(at).collect() }
    };
    shown.iter().map(one).collect()
}

/// How far the demonstrations lie apart [ŷ, rms].
fn spread(seen: &[Seen]) -> f64 {
    let count = seen.len() as f64;
    let variance = |i: usize, block: usize| -> f64 {
        let mean = seen.iter().map(|one| one.path[i][block]).sum::<DVec3>() / count;
        seen.iter().map(|one| (one.path[i][block] - mean).length_squared()).sum::<f64>() / count
    };
    let all = (0..PHASES_COMPARED).map(|i| variance(i, 0) + variance(i, 1));
    (all.sum::<f64>() / PHASES_COMPARED as f64).sqrt()
}

/// A demonstration without its rests in canonical coordinates, for its frames.
#[must_use]
pub fn canonical_path(
    map: &FrameMap,
    transforms: &FrameTransforms,
    profile: &PhaseProfile,
    poses: &[Pose],
) -> Vec<Canonical> {
    let last = (poses.len() - 1) as f64;
    let at = |(i, pose)| map.inverse(transforms, profile.at(i as f64 / last)[0], pose);
    poses.iter().enumerate().map(at).collect()
}

/// Demonstrations as they are learned from: smoothed by a running mean where the fit asks for it, and
/// with a start frame that is fixed to the goal frame for skills that have no other.
pub fn prepared(skill: &Skill, demonstrations: &[Demonstration]) -> Vec<Demonstration> {
    let mut demonstrations = demonstrations.to_vec();
    if let Some(settings) = skill.fit.kaiser_smoothing() {
        for demonstration in &mut demonstrations {
            let (poses, dt) = (&demonstration.poses, demonstration.sampling_time_s);
            demonstration.poses = kaiser_smoothing(poses, dt, settings);
        }
    }
    if skill.start_frame == skill.goal_frame {
        let start = mean_start(&demonstrations);
        for demonstration in &mut demonstrations {
            demonstration.start = demonstration.goal_frame.compose(&start);
        }
    }
    demonstrations
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

/// Frames and goal in the mean of the demonstrations.
struct MeanFrames {
    start: Pose,
    goal_frame: Pose,
    goal: Pose,
}

fn mean_frames(demonstrations: &[Demonstration]) -> MeanFrames {
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
    MeanFrames { start, goal_frame, goal }
}

/// The mean goal, seen from the goal frame.
pub fn mean_goal(demonstrations: &[Demonstration]) -> Pose {
    let mean = mean_frames(demonstrations);
    mean.goal_frame.inverse().compose(&mean.goal)
}

/// The mean of poses.
pub fn mean_pose(poses: &[Pose]) -> Pose {
    let orientations: Vec<_> = poses.iter().map(|p| p.orientation).collect();
    let position = poses.iter().map(|p| p.position).sum::<DVec3>() / poses.len() as f64;
    let weights = vec![1.0; poses.len()];
    Pose { position, orientation: mean_orientation(&orientations, &weights) }
}

/// Lets a path that begins in motion begin at rest, as the policy does, and catch up: v₀ t exp(−ωt) is
/// taken from it, with ω = `rate_1_s`. It falls behind by v₀/(e ω) at most.
fn start_from_rest(path: &mut Path, rate_1_s: f64, sampling_time_s: f64) {
    let velocity = path.velocities[0];
    for i in 0..path.points.len() {
        let t = i as f64 * sampling_time_s;
        let left = (-rate_1_s * t).exp();
        path.points[i] -= velocity * (t * left);
        path.velocities[i] -= velocity * ((1.0 - rate_1_s * t) * left);
        path.accelerations[i] -= velocity * (rate_1_s * (rate_1_s * t - 2.0) * left);
    }
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

    #[test]
    fn a_path_that_begins_in_motion_begins_at_rest_and_is_caught_up_with() {
        let dt = 0.01;
        let velocity = DVec3::new(0.3, -0.1, 0.2);
        let mut path = Path {
            points: (0..200).map(|i| velocity * (f64::from(i) * dt)).collect(),
            velocities: vec![velocity; 200],
            accelerations: vec![DVec3::ZERO; 200],
        };
        let shown = path.points.clone();
        start_from_rest(&mut path, 12.0, dt);
        assert_eq!((path.points[0], path.velocities[0]), (DVec3::ZERO, DVec3::ZERO));
        let behind: Vec<f64> =
            path.points.iter().zip(&shown).map(|(a, b)| (*a - *b).length()).collect();
        let most = behind.iter().copied().fold(0.0, f64::max);
        assert!((most - velocity.length() / (12.0 * std::f64::consts::E)).abs() < 1e-4);
        assert!(behind[100] < 1e-4 * velocity.length());
        for i in 1..199 {
            let rate = (path.points[i + 1] - path.points[i - 1]) / (2.0 * dt);
            let bend = (path.velocities[i + 1] - path.velocities[i - 1]) / (2.0 * dt);
            assert!((rate - path.velocities[i]).length() < 2e-2 * velocity.length());
            assert!((bend - path.accelerations[i]).length() < 0.4 * velocity.length());
        }
    }

    #[test]
    fn rest_is_cut_to_the_sample_and_noise_is_no_motion() {
        let shown = |noise: f64| {
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
        let ranges = moving_ranges(&[shown(0.0)], &smoothing, &scale).unwrap();
        assert_eq!((ranges[0].start, ranges[0].end, ranges.len()), (30, 331, 1));
        // Some noise: the smoothed speed tells.
        let noisy = moving_ranges(&[shown(2e-5)], &smoothing, &scale).unwrap();
        assert!(noisy[0].start.abs_diff(30) <= 40 && noisy[0].end.abs_diff(331) <= 40, "{noisy:?}");
        let still = Demonstration { poses: vec![Pose::IDENTITY; 50], ..shown(0.0) };
        let error = moving_ranges(&[still], &smoothing, &scale).unwrap_err().to_string();
        assert!(error.contains("does not move"), "{error}");
    }
}
