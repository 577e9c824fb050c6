//! Chooses the map of the frames: the one in which the demonstrations lie nearest to each other.
//!
//! Further frames act where they matter: at the phase at which the demonstrations, seen from such a
//! frame, agree best against what start and goal frame see. One in which they never agree better is
//! left out of the map.

use glam::DVec3;
use tprmp_rmpflow::policy::canonical::frame_map::{
    Anchor, FrameMap, FrameMapError, FrameTransforms, PHASE_DISTANCE_MIN,
};
use tprmp_spatial::{MovingPose, Pose};

use crate::canonical::adaptation::{self, Observation};
use crate::canonical::means::{MeanFrames, mean_pose};
use crate::canonical::phase_profile::PhaseProfile;
use crate::canonical::scales::scales;
use crate::demonstration::diagonal;
use crate::skill::{FitSettings, FrameMapSettings, Skill};

/// A demonstration without its rest: its frames in the order of the skill, and its poses.
pub(crate) struct Moving<'a> {
    /// Frames, in the order of the skill.
    pub frames: Vec<Pose>,
    /// Poses of the tool.
    pub poses: &'a [Pose],
}

impl Moving<'_> {
    /// Its frames, ready to map with.
    pub(crate) fn transforms(&self, map: &FrameMap) -> FrameTransforms {
        map.transforms(&self.at_rest()).expect("a demonstration has the skill's frames")
    }

    fn at_rest(&self) -> Vec<MovingPose> {
        self.frames.iter().copied().map(MovingPose::at_rest).collect()
    }

    /// Fraction of the time, and pose, of the sample nearest to a fraction of the time.
    fn at(&self, time: f64) -> (f64, Pose) {
        let last = self.poses.len() - 1;
        let i = (time * last as f64).round() as usize;
        (i as f64 / last as f64, self.poses[i])
    }
}

/// The map in which the demonstrations lie nearest to each other: whether positions rotate with the
/// frames, and at which phases the start frame lets go and the goal frame takes over.
///
/// Not every map that does better by chance is taken: positions rotate, and the change takes the whole
/// path, unless the demonstrations show otherwise. What they show beyond it is a
/// [regression](crate::canonical::adaptation) on the goal's shift.
///
/// For each frame of the skill it also gives the figure by which it was decided whether the path passes it,
/// which start and goal frame do not have.
///
/// # Errors
/// [`FrameMapError`]: the frames do not span a map.
pub(crate) fn choose(
    skill: &Skill,
    mean: &MeanFrames,
    moving: &[Moving],
    profile: &PhaseProfile,
) -> Result<(FrameMap, Vec<Option<f64>>), FrameMapError> {
    // Along axes that rotate with the demonstrations.
    let axes = mean.goal_frame.orientation.conjugate();
    let positions = moving.iter().flat_map(|m| m.poses).map(|pose| axes * pose.position);
    let mut scales = scales(&skill.scale, diagonal(positions), 0.0);
    if !skill.manifold.has_orientation() {
        scales[1] = 0.0;
    }
    let chooser = Chooser { skill, settings: &skill.frame_map, mean, moving, profile, scales };
    let (anchors, fractions) = chooser.anchors();
    let (rotating, upright) = (chooser.best(&anchors, true)?, chooser.best(&anchors, false)?);
    // Frames that rotate and a path that does not: then positions do not follow the rotation.
    let keeps_upright = upright.1 < skill.frame_map.upright_error_fraction_max * rotating.1;
    Ok((if keeps_upright { upright.0 } else { rotating.0 }, fractions))
}

struct Chooser<'a> {
    skill: &'a Skill,
    settings: &'a FrameMapSettings,
    mean: &'a MeanFrames,
    moving: &'a [Moving<'a>],
    profile: &'a PhaseProfile,
    /// ŷ per m and per rad; 0 for rotations that are free.
    scales: [f64; 2],
}

impl Chooser<'_> {
    /// Fraction of the time at one of the compared steps.
    fn time(&self, step: usize) -> f64 {
        step as f64 / (self.settings.phases_compared - 1) as f64
    }

    /// The frames of the map: start, goal, and the further frames that matter in between.
    fn anchors(&self) -> (Vec<Anchor>, Vec<Option<f64>>) {
        let mut anchors = Vec::new();
        let mut goal = 0;
        if self.skill.has_start_frame() {
            let (frame, point) = (self.mean.start, self.mean.start.position);
            anchors.push(Anchor { index: 0, frame, point, phase: 0.0 });
            goal = 1;
        }
        let positions = self.moving.iter().flat_map(|m| m.poses).map(|pose| pose.position);
        let floor = (self.settings.agreement_floor_fraction * diagonal(positions)).powi(2);
        let others = goal + 1..goal + 1 + self.skill.other_frames.len();
        let mut fractions = vec![None; goal + 1];
        let mut between: Vec<Anchor> = Vec::new();
        for index in others {
            let found = self.anchor_between(index, goal, floor);
            fractions.push(found.map(|(fraction, _)| fraction));
            let acts =
                |(fraction, _): &(f64, Anchor)| *fraction <= self.settings.agreement_fraction_max;
            between.extend(found.filter(acts).map(|(_, anchor)| anchor));
        }
        between.sort_by(|a, b| a.phase.total_cmp(&b.phase));
        // Of frames that matter at the same time, the first one acts.
        between.dedup_by(|later, earlier| later.phase - earlier.phase < PHASE_DISTANCE_MIN);
        anchors.extend(between);
        let (frame, point) = (self.mean.goal_frame, self.mean.goal.position);
        anchors.push(Anchor { index: goal, frame, point, phase: 1.0 });
        (anchors, fractions)
    }

    /// A further frame at the phase at which the demonstrations agree best in it, and the fraction of what
    /// start and goal frame see that they lie apart there.
    fn anchor_between(&self, index: usize, goal: usize, floor: f64) -> Option<(f64, Anchor)> {
        // Mean square distance [m²] from the mean of what a frame sees.
        let variance = |index: usize, step: usize| {
            let seen = self
                .moving
                .iter()
                .map(|m| m.frames[index].inverse().compose(&m.at(self.time(step)).1).position);
            let seen: Vec<DVec3> = seen.collect();
            let mean = seen.iter().sum::<DVec3>() / seen.len() as f64;
            let squares = seen.iter().map(|p| (p - mean).length_squared());
            (squares.sum::<f64>() / seen.len() as f64 + floor, mean)
        };
        let fraction = |step: usize| {
            let others = (0..=goal).map(|other| variance(other, step).0);
            (variance(index, step).0 / others.fold(f64::INFINITY, f64::min)).sqrt()
        };
        let phase = |step: usize| self.profile.at(self.time(step))[0];
        let (step, least) = (0..self.settings.phases_compared)
            .filter(|step| (PHASE_DISTANCE_MIN..=1.0 - PHASE_DISTANCE_MIN).contains(&phase(*step)))
            .map(|step| (step, fraction(step)))
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        let poses: Vec<Pose> = self.moving.iter().map(|m| m.frames[index]).collect();
        let frame = mean_pose(&poses);
        let point = frame.position + frame.orientation * variance(index, step).1;
        Some((least, Anchor { index, frame, point, phase: phase(step) }))
    }

    /// The best map whose positions rotate with the frames or do not, and how far a demonstration lies
    /// from what the others predict in it [ŷ, rms].
    fn best(&self, anchors: &[Anchor], rotate: bool) -> Result<(FrameMap, f64), FrameMapError> {
        let goal = self.mean.goal;
        let whole = FrameMap::new(anchors, goal, rotate)?;
        let mut best = (whole, self.spread(&whole));
        let most = self.settings.change_spread_fraction_max * best.1;
        let changes = self.settings.changes_compared;
        let phase = |i: usize| 0.5 * i as f64 / (changes - 1) as f64;
        for step in 0..changes * changes {
            let mut anchors = anchors.to_vec();
            let [first, .., last] = &mut anchors[..] else { break };
            first.phase = phase(step / changes);
            last.phase = 1.0 - phase(step % changes);
            let too_fast =
                |pair: &[Anchor]| pair[1].phase - pair[0].phase < self.settings.change_phase_min;
            if anchors.windows(2).any(too_fast) {
                continue;
            }
            let map = FrameMap::new(&anchors, goal, rotate)?;
            let spread = self.spread(&map);
            if spread < best.1.min(most) {
                best = (map, spread);
            }
        }
        // First as the frames carry it, which holds wherever they are; then what is left of it.
        Ok(self.adapted(best))
    }

    /// The map with what the path adapts by, where that predicts demonstrations better.
    fn adapted(&self, (map, spread): (FrameMap, f64)) -> (FrameMap, f64) {
        // A frame in between is passed at its phase, and against one frame alone nothing shifts.
        let two = map.anchors().len() == 2 && self.skill.has_start_frame();
        let FitSettings::Canonical(settings) = &self.skill.fit else { return (map, spread) };
        if !two {
            return (map, spread);
        }
        let steps = 0..self.settings.phases_compared;
        let phases: Vec<f64> = steps.map(|step| self.profile.at(self.time(step))[0]).collect();
        let observations = self.observations(&map);
        let learned = adaptation::learn(&observations, &phases, self.scales, &settings.adaptation);
        (map.with_adaptation(learned.adaptation), learned.error)
    }

    /// The demonstrations in the canonical coordinates of a map, at equal fractions of their times.
    fn observations(&self, map: &FrameMap) -> Vec<Observation> {
        let observe = |moving: &Moving| {
            let transforms = moving.transforms(map);
            let at = |step| {
                let (time, pose) = moving.at(self.time(step));
                let y = map.inverse(&transforms, self.profile.at(time)[0], &pose);
                [y.position * self.scales[0], y.rotation * self.scales[1]]
            };
            let shift = map.goal_shift(&moving.at_rest()).expect("they are the skill's frames");
            Observation { shift, path: (0..self.settings.phases_compared).map(at).collect() }
        };
        self.moving.iter().map(observe).collect()
    }

    /// How far the demonstrations lie apart in a map [ŷ, rms].
    fn spread(&self, map: &FrameMap) -> f64 {
        let observations = self.observations(map);
        let count = observations.len() as f64;
        let variance = |i: usize, block: usize| -> f64 {
            let points = || observations.iter().map(|one| one.path[i][block]);
            let mean = points().sum::<DVec3>() / count;
            points().map(|point| (point - mean).length_squared()).sum::<f64>() / count
        };
        let steps = self.settings.phases_compared;
        let all = (0..steps).map(|i| variance(i, 0) + variance(i, 1));
        (all.sum::<f64>() / steps as f64).sqrt()
    }
}
