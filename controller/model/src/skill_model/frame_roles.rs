//! Which frame of a skill speaks when, for people.

use crate::skill_model::model::{FrameMixture, PolicyModel, SkillModel};

/// The map is worse than a frame when the demonstrations lie so many times as far apart in it …
const WORSE_RATIO: f64 = 3.0;
/// … and by this fraction of the skill's span farther …
const WORSE_FRACTION: f64 = 0.02;
/// … at so many places in a row.
const WORSE_STEPS: usize = 3;

impl SkillModel {
    /// From or up to which phase a frame rules, and the figure that decided it.
    #[must_use]
    pub fn frame_role(&self, frame: &FrameMixture) -> String {
        if !self.motion.is_discrete() {
            return "rules all along".into();
        }
        let canonical = &self.canonical;
        let waypoint = canonical.waypoints.iter().find(|waypoint| waypoint.frame == frame.name);
        match (frame.agreement_fraction, waypoint) {
            (Some(fraction), Some(waypoint)) => {
                format!("acts at phase {:.2} (fraction {fraction:.2})", waypoint.phase)
            }
            (Some(fraction), None) => format!("left out (fraction {fraction:.2})"),
            (None, _) if frame.name == self.goal_frame => {
                format!("rules from phase {:.2}", canonical.goal_phase)
            }
            (None, _) => format!("rules to phase {:.2}", canonical.start_phase),
        }
    }

    /// Whether the model names this frame and its path does not pass it.
    #[must_use]
    pub fn is_left_out(&self, frame: &FrameMixture) -> bool {
        let ends = [&self.start_frame, &self.goal_frame];
        let passes = self.canonical.waypoints.iter().any(|waypoint| waypoint.frame == frame.name);
        // The product of the frames' Gaussians has no path of its own.
        let has_path = matches!(self.policy, PolicyModel::Canonical { .. });
        has_path && !passes && !ends.contains(&&frame.name)
    }

    /// Frames that the skill file named beside start and goal, as the provenance has them, and that are not given to
    /// who evaluates the model, or act nowhere.
    #[must_use]
    pub fn named_but_unused(&self) -> Vec<String> {
        let values = &self.provenance.hyper_parameters;
        let named = values.iter().find(|(key, _)| key == "other_frames");
        // A list of texts is the same in JSON and in RON; models of before may have none.
        let named = named.and_then(|(_, value)| ron::from_str::<Vec<String>>(value).ok());
        let acts = |name: &String| {
            self.frames.iter().any(|frame| frame.name == *name && !self.is_left_out(frame))
        };
        named.unwrap_or_default().into_iter().filter(|name| !acts(name)).collect()
    }

    /// [`Self::named_but_unused`] in a line; `None` when all are given.
    #[must_use]
    pub fn fewer_frames(&self) -> Option<String> {
        let unused = self.named_but_unused();
        let names: Vec<String> = unused.iter().map(|name| format!("`{name}`")).collect();
        (!names.is_empty()).then(|| {
            format!(
                "skill `{}`: the controller is given fewer frames than the skill file names: without {}",
                self.skill,
                names.join(", ")
            )
        })
    }

    /// Frames from which the demonstrations agree much better than in the map of all frames: the goal frame of
    /// such a skill takes over too late, for example. See [`lost_agreement`]; the skill's span is that of
    /// its Gaussians.
    #[must_use]
    pub fn lost_agreement(&self) -> Vec<String> {
        let axes = 0..self.manifold.position_dimension();
        let span = |axis: usize| {
            let values = || self.gaussians.iter().map(|gaussian| gaussian.mean[axis]);
            let least = values().fold(f64::INFINITY, f64::min);
            values().fold(f64::NEG_INFINITY, f64::max) - least
        };
        let span_m = axes.map(|axis| span(axis).powi(2)).sum::<f64>().sqrt();
        let frames = self.frames.iter().map(|frame| (frame.name.as_str(), &frame.agreement[..]));
        lost_agreement(frames, &self.fit.agreement, span_m)
    }
}

/// What is to be said of frames from which the demonstrations agree much better than in the map of all frames:
/// how far they lie apart [m, rad] seen from each frame and in the map, at equal fractions of the time, of
/// a skill that spans `span_m` \[m\].
#[must_use]
pub fn lost_agreement<'a>(
    frames: impl Iterator<Item = (&'a str, &'a [[f64; 2]])>,
    map: &[[f64; 2]],
    span_m: f64,
) -> Vec<String> {
    let percent = |step: usize| 100.0 * step as f64 / (map.len() - 1) as f64;
    let mut warnings = Vec::new();
    for (name, seen) in frames {
        let worse = |step: &usize| {
            let (map, frame) = (map[*step][0], seen[*step][0]);
            map > WORSE_RATIO * frame && map - frame > WORSE_FRACTION * span_m
        };
        let steps: Vec<usize> = (0..map.len().min(seen.len())).filter(worse).collect();
        let in_a_row = steps.windows(WORSE_STEPS).any(|w| w[WORSE_STEPS - 1] - w[0] < WORSE_STEPS);
        if !in_a_row {
            continue;
        }
        let (first, last) = (steps[0], steps[steps.len() - 1]);
        let most = |of: &[[f64; 2]]| steps.iter().map(|step| of[*step][0]).fold(0.0, f64::max);
        warnings.push(format!(
            "from {:.0} to {:.0} % of the time the demonstrations agree to {:.1} mm seen from `{name}`, \
             and only to {:.1} mm in the map of all frames: the skill will pass it with that error",
            percent(first),
            percent(last),
            1e3 * most(seen),
            1e3 * most(map),
        ));
    }
    warnings
}
