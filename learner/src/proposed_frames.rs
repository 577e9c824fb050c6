//! Further frames that nobody named: of all that were recorded, those that the map of the frames passes.
//!
//! The bound is the one by which a named frame is left out, `frame_map.agreement_fraction_max`. A skill has at
//! most [`FRAME_CAPACITY`] frames, so more are tried in rounds, with those that were kept before.

use tprmp_model::skill_model::FRAME_CAPACITY;

use crate::alignment::rest::DemonstrationError;
use crate::canonical::agreement::{apart, best_aligned};
use crate::canonical::{CanonicalSet, canonicalise};
use crate::demonstration::Demonstration;
use crate::demonstration::plausibility::with_others;
use crate::skill::Skill;

/// A named frame is warned of when without it the demonstrations lie nearer to each other than this fraction, in position and
/// in rotation.
const HARMFUL_FRACTION: f64 = 0.5;

/// What is proposed.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// The skill that names the frames that matter.
    pub skill: Skill,
    /// What is to be said of the others.
    pub warnings: Vec<String>,
    /// Names of all that were tried.
    tried: Vec<String>,
}

impl Proposal {
    /// What stands in the model's provenance.
    #[must_use]
    pub fn origin(&self) -> String {
        format!("Auto: {} of {:?}", self.skill.other_frames.len(), self.tried)
    }
}

/// Proposes the further frames of a skill out of those that all demonstrations hold.
///
/// # Errors
/// [`DemonstrationError`]: one does not move.
///
/// # Panics
/// When there is no demonstration.
pub fn propose(skill: &Skill, recorded: &[Demonstration]) -> Result<Proposal, DemonstrationError> {
    let (tried, mut warnings) = candidates(recorded);
    let room = FRAME_CAPACITY - skill.goal_index() - 1;
    let mut proposed = Skill { other_frames: Vec::new(), ..skill.clone() };
    let mut left = &tried[..];
    while !left.is_empty() && proposed.other_frames.len() < room {
        let count = (room - proposed.other_frames.len()).min(left.len());
        let (now, later) = left.split_at(count);
        left = later;
        proposed.other_frames.extend_from_slice(now);
        let (_, set) = best_aligned(&proposed, recorded)?;
        let first = proposed.goal_index() + 1;
        let (mut kept, mut others) = (Vec::new(), Vec::new());
        for (i, name) in proposed.other_frames.iter().enumerate() {
            if set.map.anchors().iter().any(|anchor| anchor.index == first + i) {
                kept.push(name.clone());
            } else {
                let why = why_left_out(&proposed, &set, first + i);
                others.push(format!("the frame `{name}` is not used: {why}"));
            }
        }
        proposed.other_frames = kept;
        warnings.extend(others);
    }
    for name in left {
        warnings.push(format!(
            "the frame `{name}` is not used: the skill has {FRAME_CAPACITY} frames already, the most"
        ));
    }
    without_harmful(&mut proposed, recorded, &mut warnings)?;
    Ok(Proposal { skill: proposed, warnings, tried })
}

/// Leaves out frames without which the demonstrations lie nearer to each other: one that stands still beside the goal
/// is near where it matters, and lacks what the goal frame says elsewhere.
fn without_harmful(
    proposed: &mut Skill,
    recorded: &[Demonstration],
    warnings: &mut Vec<String>,
) -> Result<(), DemonstrationError> {
    for name in proposed.other_frames.clone() {
        let (aligned, set) = best_aligned(proposed, recorded)?;
        let with = apart(proposed, &aligned.demonstrations, &set);
        let fewer = without(proposed, &name);
        let (aligned, fewer_set) = best_aligned(&fewer, recorded)?;
        let without = apart(&fewer, &aligned.demonstrations, &fewer_set);
        if (0..2).all(|block| without[block] <= with[block]) {
            warnings.push(format!("the frame `{name}` is not used: {}", farther(with, without)));
            *proposed = fewer;
        }
    }
    Ok(())
}

fn without(skill: &Skill, name: &str) -> Skill {
    let mut fewer = skill.clone();
    fewer.other_frames.retain(|other| other != name);
    fewer
}

fn farther(with: [f64; 2], without: [f64; 2]) -> String {
    format!(
        "in the map of the frames the demonstrations lie {:.1} mm and {:.1}° apart (rms) with it, and {:.1} mm and \
         {:.1}° without it",
        1e3 * with[0],
        with[1].to_degrees(),
        1e3 * without[0],
        without[1].to_degrees()
    )
}

/// Frames that the skill names and that make the demonstrations differ: a sentence each.
pub(crate) fn harmful(skill: &Skill, aligned: &[Demonstration], set: &CanonicalSet) -> Vec<String> {
    let with = apart(skill, aligned, set);
    let warning = |name: &String| {
        let fewer = without(skill, name);
        let fewer_set = canonicalise(&fewer, aligned).ok()?;
        let without = apart(&fewer, aligned, &fewer_set);
        let is_less = |block: usize| without[block] <= HARMFUL_FRACTION * with[block];
        (is_less(0) && is_less(1)).then(|| {
            format!("the frame `{name}` does harm: {}; leave it out", farther(with, without))
        })
    };
    skill.other_frames.iter().filter_map(warning).collect()
}

/// The frames beside start and goal that all demonstrations hold, and what is to be said of those that only
/// some do.
fn candidates(recorded: &[Demonstration]) -> (Vec<String>, Vec<String>) {
    let mut all: Vec<&String> = recorded.iter().flat_map(|d| d.other_frames.keys()).collect();
    all.sort();
    all.dedup();
    let (mut tried, mut warnings) = (Vec::new(), Vec::new());
    for name in all {
        let without: Vec<&Demonstration> =
            recorded.iter().filter(|d| !d.other_frames.contains_key(name)).collect();
        match without.first() {
            None => tried.push(name.clone()),
            Some(first) => warnings.push(format!(
                "the frame `{name}` is not used: {} has none of this name",
                with_others(&first.name, without.len())
            )),
        }
    }
    (tried, warnings)
}

/// Why the map does not pass a frame of the skill, by its index.
pub(crate) fn why_left_out(skill: &Skill, set: &CanonicalSet, index: usize) -> String {
    let most = skill.frame_map.agreement_fraction_max;
    match set.fractions.get(index).copied().flatten() {
        Some(fraction) if fraction <= most => "another frame acts at the same time".to_owned(),
        Some(fraction) => format!(
            "seen from it the demonstrations lie at best {fraction:.2} as far apart as seen from start \
             or goal frame, and `frame_map.agreement_fraction_max` is {most}"
        ),
        None => "it acts at no phase between start and goal".to_owned(),
    }
}
