//! Starts on a grid over the workspace.

use glam::DVec3;
use rayon::prelude::*;
use tprmp_learner::certify::policy::Body;
use tprmp_spatial::Pose;

use crate::bench::Bench;
use crate::conditions::Conditions;
use crate::dataset::SkillSet;
use crate::experiment::{Compared, Experiment, PolicyKind, Setting, Space};
use crate::progress::progress;
use crate::results::{Row, finite};

/// The workspace: the box around the demonstrations, each side larger by this fraction.
const ENLARGED_FRACTION: f64 = 0.3;
/// The goal is reached within 2 mm for 50 mm of the skill's size.
pub(crate) const REACHED_FRACTION: f64 = 2.0 / 50.0;

impl Bench<'_> {
    /// How many starts of a grid end at the goal, of all planar skills and policies, on all cores.
    pub(crate) fn grid_starts(&self) -> Vec<Row> {
        let planar = self.skills.iter().filter(|set| set.space() == Space::Planar);
        let work: Vec<(&SkillSet, PolicyKind)> =
            planar.flat_map(|set| PolicyKind::ALL.map(|policy| (set, policy))).collect();
        let bar = progress("grid", work.len());
        work.par_iter()
            .inspect(|_| bar.inc(1))
            .filter_map(|(set, policy)| self.grid_of(set, *policy))
            .collect()
    }

    /// `None` when the policy could not be trained.
    fn grid_of(&self, set: &SkillSet, policy: PolicyKind) -> Option<Row> {
        let learned = PolicyKind::LEARNED.contains(&policy);
        let components = if learned { self.count(set, policy) } else { 0 };
        let prepared = self.prepare(set, Compared { policy, components }, 0)?;
        let still = Conditions::demonstrated(set, 0);
        let error_m = |position: &DVec3| {
            let pose = Pose { position: *position, ..still.start.pose };
            let start = Body::at_rest(pose);
            prepared.follow(&Conditions { start, ..still.clone() }).goal_error_m
        };
        let starts = grid(set.bounds(), self.extent.grid);
        let errors: Vec<f64> = starts.par_iter().map(error_m).collect();
        let within_m = REACHED_FRACTION * set.size_m();
        let reached = errors.iter().filter(|error| **error <= within_m).count();
        let setting = Setting::Grid(self.extent.grid);
        Some(Row {
            components,
            goal_error_m: finite(errors.iter().copied().fold(0.0, f64::max)),
            reached: reached == errors.len(),
            starts_reached: Some([reached as u32, errors.len() as u32]),
            ..self.new_row(set, policy, Experiment::GridStarts, setting)
        })
    }
}

/// The points of a grid with so many a side, two at least, over the enlarged box with these corners.
fn grid([low, high]: [DVec3; 2], side: usize) -> Vec<DVec3> {
    let margin = 0.5 * ENLARGED_FRACTION * (high - low);
    let at = |i: usize| {
        let fraction = |k: usize| k as f64 / (side - 1) as f64;
        let fractions = DVec3::new(fraction(i % side), fraction(i / side), 0.0);
        low - margin + (high - low + 2.0 * margin) * fractions
    };
    (0..side * side).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_spans_the_enlarged_box() {
        let corners = [DVec3::new(-1.0, 2.0, 0.0), DVec3::new(1.0, 3.0, 0.0)];
        let points = grid(corners, 35);
        assert_eq!(points.len(), 35 * 35);
        let [low, high] = crate::scale::bounds(points.iter().copied());
        assert!((low - DVec3::new(-1.3, 1.85, 0.0)).length() < 1e-12, "{low}");
        assert!((high - DVec3::new(1.3, 3.15, 0.0)).length() < 1e-12, "{high}");
        let step = points[1] - points[0];
        assert!((step - DVec3::X * (2.6 / 34.0)).length() < 1e-12, "{step}");
        assert!((points[35] - points[0] - DVec3::Y * (1.3 / 34.0)).length() < 1e-12);
    }
}
