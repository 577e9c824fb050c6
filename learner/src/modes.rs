//! Whether demonstrations show one way of doing a skill, or several: its modes.

use tprmp_model::skill_model::MODE_CAPACITY;
use tprmp_spatial::Pose;

use crate::alignment::Aligned;
use crate::alignment::consistency::ends_apart;
use crate::alignment::rest::DemonstrationError;
use crate::canonical::agreement::{Paths, best_aligned, paths};
use crate::canonical::{CanonicalSet, canonicalise};
use crate::demonstration::Demonstration;
use crate::skill::{FitSettings, ModeSettings, Skill};

/// Where frames tell the groups of more than this fraction of the demonstrations, they explain why the paths
/// differ.
const EXPLAINED_FRACTION: f64 = 0.8;

/// One way of doing a skill: its demonstrations, brought to a common time and into canonical coordinates.
#[derive(Clone, Debug)]
pub struct Mode {
    /// Which of all demonstrations, in order.
    pub members: Vec<usize>,
    /// They as recorded.
    pub recorded: Vec<Demonstration>,
    /// At their common time.
    pub aligned: Aligned,
    /// In canonical coordinates.
    pub set: CanonicalSet,
}

/// The ways in which a skill was demonstrated.
#[derive(Clone, Debug)]
pub struct Modes {
    /// The one of most demonstrations first; at least one.
    pub modes: Vec<Mode>,
    /// Why they were split: a sentence each.
    pub told: Vec<String>,
}

impl Mode {
    /// All demonstrations as one way.
    ///
    /// # Errors
    /// [`DemonstrationError`]: one does not move, or cannot be brought into canonical coordinates.
    ///
    /// # Panics
    /// When there is no demonstration, or one lacks a frame of the skill.
    pub fn of_all(
        skill: &Skill,
        demonstrations: &[Demonstration],
    ) -> Result<Self, DemonstrationError> {
        let (aligned, set) = best_aligned(skill, demonstrations)?;
        let (members, recorded) = ((0..demonstrations.len()).collect(), demonstrations.to_vec());
        Ok(Self { members, recorded, aligned, set })
    }
}

/// Splits demonstrations into modes: as long as a group falls in several that end apart in the goal frame, or that
/// take other paths between the same ends, it is split; all stay in one where the skill file says so.
///
/// # Errors
/// As [`Mode::of_all`].
///
/// # Panics
/// As [`Mode::of_all`].
pub fn split(skill: &Skill, demonstrations: &[Demonstration]) -> Result<Modes, DemonstrationError> {
    let mut open = vec![(0..demonstrations.len()).collect::<Vec<_>>()];
    let (mut modes, mut told) = (Vec::<Mode>::new(), Vec::new());
    while let Some(members) = open.pop() {
        let recorded: Vec<_> = members.iter().map(|i| demonstrations[*i].clone()).collect();
        let may_split = skill.modes == ModeSettings::Auto && members.len() > 1;
        let mut found = may_split.then(|| ends_apart(skill, &recorded)).flatten();
        let mut mode = None;
        if found.is_none() {
            let all = Mode { members: members.clone(), ..Mode::of_all(skill, &recorded)? };
            let paths = may_split.then(|| other_paths(skill, &all)).flatten();
            found = paths.map(|Paths { labels, told }| (labels, told));
            mode = Some(all);
        }
        let count = found.iter().flat_map(|(labels, _)| labels).max().map_or(1, |last| last + 1);
        match found {
            Some((labels, why)) if modes.len() + open.len() + count <= MODE_CAPACITY => {
                told.push(why);
                open.extend((0..count).rev().map(|label| {
                    let group = members.iter().zip(&labels).filter(|(_, l)| **l == label);
                    group.map(|(i, _)| *i).collect()
                }));
            }
            found => {
                if let Some((_, why)) = found {
                    told.push(format!(
                        "{why}: they stay together, as a model has at most {MODE_CAPACITY} modes; what is learned \
                         of them is their mean, which nobody demonstrated"
                    ));
                }
                let all = || Mode::of_all(skill, &recorded);
                modes.push(Mode { members, ..mode.map_or_else(all, Ok)? });
            }
        }
    }
    modes.sort_by_key(|mode| (usize::MAX - mode.members.len(), mode.members[0]));
    Ok(Modes { modes, told })
}

/// [`paths`], also where a regression of the path on the frames has blurred them.
fn other_paths(skill: &Skill, mode: &Mode) -> Option<Paths> {
    let Mode { aligned, set, .. } = mode;
    let demonstrations = &aligned.demonstrations;
    let found = paths(skill, demonstrations, set);
    if found.is_some() || set.map.adaptation().is_none() {
        return found;
    }
    let mut unadapted = skill.clone();
    if let FitSettings::Canonical(fit) = &mut unadapted.fit {
        fit.adaptation.error_fraction_max = 0.0;
    }
    let set = canonicalise(&unadapted, demonstrations).ok()?;
    let found = paths(skill, demonstrations, &set)?;
    (explained(demonstrations, &found.labels) <= EXPLAINED_FRACTION).then_some(found)
}

/// For which fraction of the demonstrations those whose goal frame lies nearest to theirs, seen from the start
/// frame, are of their group.
fn explained(demonstrations: &[Demonstration], labels: &[usize]) -> f64 {
    let shift = |d: &Demonstration| d.start.inverse().compose(&d.goal_frame);
    let shifts: Vec<Pose> = demonstrations.iter().map(shift).collect();
    let apart = |i: usize, j: usize| {
        let turned = shifts[i].rotation_from(&shifts[j]).length();
        (shifts[i].position - shifts[j].position).length() + turned
    };
    let others = |i: usize| (0..shifts.len()).filter(move |j| *j != i);
    let right = |i: usize| -> f64 {
        let least = others(i).map(|j| apart(i, j)).fold(f64::INFINITY, f64::min);
        let nearest = others(i).filter(|j| apart(i, *j) <= least);
        let (same, count) = nearest.fold((0.0, 0.0), |(same, count), j| {
            (same + f64::from(labels[j] == labels[i]), count + 1.0)
        });
        same / count
    };
    (0..shifts.len()).map(right).sum::<f64>() / shifts.len() as f64
}
