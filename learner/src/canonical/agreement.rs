//! How well demonstrations agree: as each frame sees them, in the map of all frames, and with what the
//! others predict.

use glam::{DQuat, DVec3};
use tprmp_model::skill_model::lost_agreement;
use tprmp_rmpflow::policy::canonical::frame_map::Canonical;
use tprmp_spatial::Pose;

use crate::alignment::consistency::names;
use crate::alignment::groups::two_groups;
use crate::alignment::rest::DemonstrationError;
use crate::alignment::{Aligned, Prepared};
use crate::canonical::coordinates::{CanonicalDemonstration, CanonicalSet, canonicalise};
use crate::canonical::means::mean_pose;
use crate::demonstration::{Demonstration, largest_span_m};
use crate::skill::{AlignmentMethod, Skill};

/// Fractions of the common time at which agreement is looked at, the ends included.
pub const STEPS: usize = 41;
/// Two paths lie apart by this fraction of the span …
const WAYS_FRACTION: f64 = 0.04;
/// … or this angle \[rad\] …
const WAYS_RAD: f64 = 0.35;
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
        let span_m = largest_span_m(demonstrations);
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
    let apart = |(aligned, set): &(Aligned, CanonicalSet)| -> f64 {
        let map = Agreement::new(skill, &aligned.demonstrations, set).map;
        let [metres, radians] = set.scales;
        map.iter().map(|at| (at[0] * metres).powi(2) + (at[1] * radians).powi(2)).sum()
    };
    Ok(if apart(&by_clock) < apart(&chosen) { by_clock } else { chosen })
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

/// The demonstrations in two groups that take other paths between common ends: which, from and to which
/// fraction of the time, and how far apart [m or rad].
#[must_use]
pub fn two_ways(
    demonstrations: &[Demonstration],
    set: &CanonicalSet,
    span_m: f64,
) -> Option<String> {
    let groups = |step: usize, block: usize| {
        let points: Vec<Vec<f64>> = set
            .demonstrations
            .iter()
            .map(|d| {
                let path = if block == 0 { &d.position } else { &d.rotation };
                path.points[sample(path.points.len(), step)].to_array().to_vec()
            })
            .collect();
        two_groups(&points).filter(|groups| groups.smaller() >= 2)
    };
    for (block, least) in [(0, WAYS_FRACTION * span_m), (1, WAYS_RAD)] {
        let found: Vec<_> = (0..STEPS)
            .filter_map(|step| Some((step, groups(step, block)?)))
            .filter(|(_, groups)| groups.distance > least)
            .collect();
        let Some((_, first)) = found.first() else { continue };
        // The same groups, whichever comes first.
        let same = |second: &[bool]| {
            second == first.second || second.iter().zip(&first.second).all(|(a, b)| a != b)
        };
        let stable = found.iter().filter(|(_, groups)| same(&groups.second)).count();
        if stable < WAYS_STEPS || stable < found.len() {
            continue;
        }
        let most = found.iter().map(|(_, groups)| groups.distance).fold(0.0, f64::max);
        let apart = if block == 0 {
            format!("{:.0} mm", 1e3 * most)
        } else {
            format!("{:.0}°", most.to_degrees())
        };
        return Some(format!(
            "between {:.0} and {:.0} % of the time the demonstrations take two paths, {apart} apart: {} and \
             {}; what is learned is their mean, which nobody demonstrated: learn each from a folder of its own",
            percent(found[0].0),
            percent(found[found.len() - 1].0),
            names(demonstrations, &first.second, false),
            names(demonstrations, &first.second, true)
        ));
    }
    None
}
