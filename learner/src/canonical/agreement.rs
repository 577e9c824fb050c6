//! How well demonstrations agree: as each frame sees them, in the map of all frames, and with what the
//! others predict.

use glam::{DQuat, DVec3};
use tprmp_model::skill_model::lost_agreement;
use tprmp_rmpflow::policy::canonical::frame_map::Canonical;
use tprmp_spatial::Pose;

use crate::alignment::consistency::{ends_like_the_others, names, number};
use crate::alignment::groups::{Groups, groups};
use crate::alignment::rest::DemonstrationError;
use crate::alignment::{Aligned, Prepared};
use crate::canonical::coordinates::{CanonicalDemonstration, CanonicalSet, canonicalise};
use crate::canonical::means::mean_pose;
use crate::demonstration::{Demonstration, largest_span_m, plausibility};
use crate::skill::{AlignmentMethod, Skill};

/// Fractions of the common time at which agreement is looked at, the ends included.
pub const STEPS: usize = 41;
/// Two paths lie apart by this fraction of the span …
const WAYS_FRACTION: f64 = 0.04;
/// … or this angle \[rad\] …
const WAYS_RAD: f64 = 0.35;
/// … and one demonstration from all others by this fraction …
const WAYS_FRACTION_OF_ONE: f64 = 0.15;
/// … or this angle \[rad\] …
const WAYS_RAD_OF_ONE: f64 = 0.7;
/// … at so many places.
const WAYS_STEPS: usize = 4;

/// Root of the mean square distance of demonstrations from their mean [m, rad], at [`STEPS`] fractions of
/// the common time.
#[derive(Clone, Debug)]
pub struct Agreement {
    /// For each frame of the skill.
    pub frames: Vec<Vec<[f64; 2]>>,
    /// In canonical coordinates, which the map of all frames gives.
    pub map: Vec<[f64; 2]>,
}

impl Agreement {
    /// How aligned demonstrations agree.
    #[must_use]
    pub fn new(skill: &Skill, demonstrations: &[Demonstration], set: &CanonicalSet) -> Self {
        let rotates = skill.manifold.has_orientation();
        let seen_from = |p: usize, step: usize| -> [f64; 2] {
            let seen: Vec<Pose> = demonstrations
                .iter()
                .map(|d| {
                    skill.frames(d)[p].inverse().compose(&d.poses[sample(d.poses.len(), step)])
                })
                .collect();
            spread(&seen, rotates)
        };
        let in_map = |step: usize| -> [f64; 2] {
            let seen: Vec<Pose> = set
                .demonstrations
                .iter()
                .map(|d| pose(d, sample(d.position.points.len(), step)))
                .collect();
            spread(&seen, rotates)
        };
        let frames = skill.frames(&demonstrations[0]).len();
        Self {
            frames: (0..frames)
                .map(|p| (0..STEPS).map(|step| seen_from(p, step)).collect())
                .collect(),
            map: (0..STEPS).map(in_map).collect(),
        }
    }

    /// Where the map of the frames loses what a frame sees: a sentence each.
    #[must_use]
    pub fn warnings(&self, skill: &Skill, demonstrations: &[Demonstration]) -> Vec<String> {
        let span_m = largest_span_m(demonstrations).max(skill.scale.position_span_min_m);
        let names = skill.named_frames(&demonstrations[0]).map(|(name, _)| name);
        let frames = names.zip(self.frames.iter().map(Vec::as_slice));
        lost_agreement(frames, &self.map, span_m)
    }
}

/// The alignment under which the demonstrations agree best, and their canonical coordinates: the skill's
/// alignment, or, where people kept time better than their paths tell, the clock.
///
/// # Errors
/// [`DemonstrationError`]: a demonstration does not move, or cannot be brought into canonical coordinates.
///
/// # Panics
/// When there is no demonstration, or one lacks a frame of the skill.
pub fn best_aligned(
    skill: &Skill,
    recorded: &[Demonstration],
) -> Result<(Aligned, CanonicalSet), DemonstrationError> {
    let prepared = Prepared::new(skill, recorded)?;
    let of = |method| -> Result<_, DemonstrationError> {
        let aligned = prepared.aligned(method);
        let set = canonicalise(skill, &aligned.demonstrations)?;
        Ok((aligned, set))
    };
    let chosen = of(skill.alignment.method)?;
    if skill.alignment.method != AlignmentMethod::Joint || recorded.len() < 2 {
        return Ok(chosen);
    }
    let by_clock = of(AlignmentMethod::Clock)?;
    let apart = |(aligned, set): &(Aligned, CanonicalSet)| {
        let apart = apart(skill, &aligned.demonstrations, set);
        (apart[0] * set.scales[0]).hypot(apart[1] * set.scales[1])
    };
    Ok(if apart(&by_clock) < apart(&chosen) { by_clock } else { chosen })
}

/// How far aligned demonstrations lie apart in the map of all frames: root of the mean square [m, rad].
pub(crate) fn apart(skill: &Skill, aligned: &[Demonstration], set: &CanonicalSet) -> [f64; 2] {
    let map = Agreement::new(skill, aligned, set).map;
    [0, 1].map(|b| (map.iter().map(|at| at[b] * at[b]).sum::<f64>() / map.len() as f64).sqrt())
}

fn percent(step: usize) -> f64 {
    100.0 * step as f64 / (STEPS - 1) as f64
}

/// Sample of a path at a step.
fn sample(count: usize, step: usize) -> usize {
    (step as f64 / (STEPS - 1) as f64 * (count - 1) as f64).round() as usize
}

/// A canonical sample as a pose.
fn pose(d: &CanonicalDemonstration, i: usize) -> Pose {
    let orientation = DQuat::from_scaled_axis(d.rotation.points[i]);
    Pose { position: d.position.points[i], orientation }
}

fn spread(poses: &[Pose], rotates: bool) -> [f64; 2] {
    let mean = mean_pose(poses);
    let count = poses.len() as f64;
    let metres: f64 = poses.iter().map(|p| (p.position - mean.position).length_squared()).sum();
    let radians: f64 = poses.iter().map(|p| p.rotation_from(&mean).length_squared()).sum();
    [(metres / count).sqrt(), if rotates { (radians / count).sqrt() } else { 0.0 }]
}

/// How far each demonstration is from what the others predict, the mean of their canonical paths, through its
/// frames: root of the mean square [m, rad]. Nothing is predicted of the only one.
#[must_use]
pub fn predicted(
    skill: &Skill,
    demonstrations: &[Demonstration],
    set: &CanonicalSet,
) -> Vec<[f64; 2]> {
    let count = set.demonstrations.len();
    if count < 2 {
        return vec![[0.0; 2]; count];
    }
    let rotates = skill.manifold.has_orientation();
    let of = |i: usize| -> [f64; 2] {
        let (mut metres, mut radians) = (0.0, 0.0);
        let poses = &demonstrations[i].poses;
        for (k, pose) in poses.iter().enumerate() {
            let others = set.demonstrations.iter().enumerate().filter(|(j, _)| *j != i);
            let (mut position, mut rotation) = (DVec3::ZERO, DVec3::ZERO);
            for (_, other) in others {
                let last = (other.position.points.len() - 1) as f64;
                let at = (k as f64 / (poses.len() - 1) as f64 * last).round() as usize;
                position += other.position.points[at] / (count - 1) as f64;
                rotation += other.rotation.points[at] / (count - 1) as f64;
            }
            let own = &set.demonstrations[i];
            let y = Canonical { position, rotation };
            let there = set.map.forward(&own.transforms, own.phases[k][0], &y);
            metres += (there.position - pose.position).length_squared();
            radians += there.rotation_from(pose).length_squared();
        }
        let n = poses.len() as f64;
        [(metres / n).sqrt(), if rotates { (radians / n).sqrt() } else { 0.0 }]
    };
    (0..count).map(of).collect()
}

/// Groups of demonstrations that take other paths between common ends.
#[derive(Clone, Debug)]
pub struct Paths {
    /// For each demonstration, its group.
    pub labels: Vec<usize>,
    /// Which, from and to which fraction of the time, and how far apart.
    pub told: String,
}

/// Where along the time demonstrations lie in groups.
struct Place {
    step: usize,
    groups: Groups,
}

/// The demonstrations in groups that take other paths between common ends.
///
/// Those that may be bad, that end elsewhere or are implausible, make no groups: they are of the one that they are
/// nearest to. One demonstration against the others has to be farther from them than a group.
#[must_use]
pub fn paths(skill: &Skill, demonstrations: &[Demonstration], set: &CanonicalSet) -> Option<Paths> {
    let good: Vec<usize> = (0..demonstrations.len())
        .filter(|i| ends_like_the_others(skill, demonstrations, *i))
        .filter(|i| plausibility::warnings(&demonstrations[*i..=*i]).is_empty())
        .collect();
    // Where many end elsewhere, that says nothing about one.
    let some: Vec<usize> = if 3 * good.len() < 2 * demonstrations.len() {
        (0..demonstrations.len()).collect()
    } else {
        good.clone()
    };
    let span_m = skill.scale.span / set.scales[0];
    let blocks = [
        (0, WAYS_FRACTION * span_m, WAYS_FRACTION_OF_ONE * span_m),
        (1, WAYS_RAD, WAYS_RAD_OF_ONE),
    ];
    blocks.into_iter().find_map(|(block, least, least_of_one)| {
        let apart = |g: &Groups| g.distance > if g.smallest() > 1 { least } else { least_of_one };
        let places: Vec<Place> = (0..STEPS)
            .filter_map(|step| {
                let groups = groups_at(&points(set, &some, step, block)).filter(apart)?;
                Some(Place { step, groups })
            })
            .collect();
        let found = same_everywhere(&places)?;
        let all: Vec<usize> = (0..demonstrations.len()).collect();
        let groups = found.groups.joined(&some, &points(set, &all, found.step, block));
        let is_bad = |label: usize| {
            let members = groups.members(label);
            members.len() == 1 && !good.contains(&members[0])
        };
        if (0..groups.count()).any(is_bad) {
            return None;
        }
        let most = places.iter().map(|place| place.groups.distance).fold(0.0, f64::max);
        let apart = if block == 0 {
            format!("{:.0} mm", 1e3 * most)
        } else {
            format!("{:.0}°", most.to_degrees())
        };
        let told = format!(
            "between {:.0} and {:.0} % of the time the demonstrations take {} paths, {apart} apart: {}",
            percent(places[0].step),
            percent(places[places.len() - 1].step),
            number(groups.count()),
            names(demonstrations, &groups),
        );
        Some(Paths { labels: groups.labels, told })
    })
}

/// The finest groups at many places that those at all others agree with: finer or coarser ones.
fn same_everywhere(places: &[Place]) -> Option<&Place> {
    let mut order: Vec<&Place> = places.iter().collect();
    order.sort_by_key(|place| std::cmp::Reverse(place.groups.count()));
    order.into_iter().find(|place| {
        let groups = &place.groups;
        let same = places.iter().filter(|other| other.groups.labels == groups.labels).count();
        let agrees =
            |other: &Place| groups.finer_than(&other.groups) || other.groups.finer_than(groups);
        same >= WAYS_STEPS && places.iter().all(agrees)
    })
}

/// Where some of the demonstrations are at a step.
fn points(set: &CanonicalSet, some: &[usize], step: usize, block: usize) -> Vec<Vec<f64>> {
    let point = |i: &usize| {
        let d = &set.demonstrations[*i];
        let path = if block == 0 { &d.position } else { &d.rotation };
        path.points[sample(path.points.len(), step)].to_array().to_vec()
    };
    some.iter().map(point).collect()
}

/// Groups of points; two or three points that are none may be a group each.
fn groups_at(points: &[Vec<f64>]) -> Option<Groups> {
    groups(points).or_else(|| (2..=3).contains(&points.len()).then(|| Groups::of_one_each(points)))
}
