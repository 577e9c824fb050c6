//! Makes the rollouts, and measures them: as the thesis did, and against the true goal.

use glam::DVec3;
use rayon::prelude::*;
use tprmp_learner::canonical::kaiser_smoothing::kaiser_smoothing;
use tprmp_learner::certify::policy::Body;
use tprmp_learner::skill::KaiserSmoothing;
use tprmp_spatial::{Pose, Twist};

use crate::case::{Case, Extent};
use crate::conditions::{Ball, GoalMotion, STEP_S};
use crate::dataset::SkillSet;
use crate::experiment::{Experiment, PolicyKind, Setting, Space};
use crate::measures::{Measures, distance_to_path, mean_square};
use crate::metric::{resampled, thesis_tracking};
use crate::models::{Models, SkillFiles};
use crate::path::positions;
use crate::progress::progress;
use crate::results::{AFTER_PUSH_S, Row, finite};
use crate::world::RunOutcome;

/// How the thesis smooths demonstrations.
const PUBLISHED_SMOOTHING: KaiserSmoothing = KaiserSmoothing { window_s: 0.3, shape: 14.0 };
/// The thesis' own conditions: the goal stops within this distance of the policy's own, at a scale of one [m] …
const PUBLISHED_STOPS_M: f64 = 0.2;
/// … a rollout takes at most so long [s]; twice that with an obstacle, unbounded when it tracks.
const PUBLISHED_DURATION_S: f64 = 10.0;
/// Room between goal or start and an obstacle that makes a case feasible, at a scale of one [m].
const FEASIBLE_ROOM_M: f64 = 0.05;

/// The skills and models of a run.
pub(crate) struct Bench<'a> {
    pub(crate) dataset: String,
    pub(crate) skills: &'a [SkillSet],
    pub(crate) models: &'a Models,
    pub(crate) files: &'a SkillFiles,
    pub(crate) extent: Extent,
    pub(crate) seed: u64,
}

impl Bench<'_> {
    /// Gaussians of a learned policy where their number is not varied.
    pub(crate) fn count(&self, set: &SkillSet, policy: PolicyKind) -> usize {
        self.files.count(set.space(), policy)
    }

    /// Makes the rollouts, on all cores. A policy that could not be trained gives a row that says that
    /// the goal was not reached.
    pub(crate) fn run(&self, cases: &[Case]) -> Vec<Row> {
        let bar = progress("rollouts", cases.len());
        cases
            .par_iter()
            .inspect(|_| bar.inc(1))
            .map(|case| match self.follow(case) {
                Some(outcome) => self.row(case, &outcome),
                None => self.empty_row(case),
            })
            .collect()
    }

    /// What the thesis' code measures, under its own conditions: tracking starts where and as fast as the
    /// demonstration does once it is smoothed, and a rollout ends when the body is slow. With an obstacle, 1 or 0: whether the body
    /// passes near the policy's own goal, however fast and whatever it touches.
    fn thesis_metric(&self, case: &Case) -> Option<f64> {
        let set = &self.skills[case.skill];
        let demonstration = case.demonstration();
        let dt = set.demonstrations[demonstration].sampling_time_s;
        let mut case = case.clone();
        let conditions = &mut case.conditions;
        conditions.own_goal = true;
        if conditions.goal_motion != GoalMotion::default() {
            conditions.goal_motion.stops_within_m = PUBLISHED_STOPS_M * conditions.scale;
        }
        if case.experiment.tracks() {
            let smoothed = kaiser_smoothing(set.motion(demonstration), dt, PUBLISHED_SMOOTHING);
            let linear = (smoothed[1].position - smoothed[0].position) / dt;
            let velocity = Twist { linear, ..Twist::ZERO };
            conditions.start = Body { velocity, ..Body::at_rest(smoothed[0]) };
            let outcome = self.follow(&case)?;
            let points = resampled(&positions(&smoothed), dt, STEP_S);
            let path = positions(&outcome.path[..outcome.stopped_at]);
            return finite(thesis_tracking(&path, &points));
        }
        let obstructed = conditions.ball.is_some();
        conditions.duration_s = if obstructed { 2.0 } else { 1.0 } * PUBLISHED_DURATION_S;
        let outcome = self.follow(&case)?;
        if obstructed {
            return Some(if outcome.touched { 1.0 } else { 0.0 });
        }
        finite(outcome.own_goal_error_m)
    }

    /// One rollout; `None` when its policy could not be trained.
    pub(crate) fn follow(&self, case: &Case) -> Option<RunOutcome> {
        let set = &self.skills[case.skill];
        let prepared = self.prepare(set, case.compared, case.demonstration())?;
        Some(prepared.follow(&case.conditions))
    }

    /// A row in which nothing is measured yet.
    pub(crate) fn new_row(
        &self,
        set: &SkillSet,
        policy: PolicyKind,
        experiment: Experiment,
        setting: Setting,
    ) -> Row {
        Row {
            dataset: self.dataset.clone(),
            skill: set.name.clone(),
            setting: setting.words(set.scale()),
            x: setting.x(),
            scale: set.scale(),
            seed: self.seed,
            ..Row::new(experiment, policy)
        }
    }

    fn empty_row(&self, case: &Case) -> Row {
        let conditions = &case.conditions;
        let (ball, room_m) = (conditions.ball, FEASIBLE_ROOM_M * conditions.scale);
        Row {
            components: case.compared.components,
            instance: case.instance,
            feasible: ball.is_none_or(|ball| ball.leaves_room(conditions, room_m)),
            ..self.new_row(
                &self.skills[case.skill],
                case.compared.policy,
                case.experiment,
                case.setting,
            )
        }
    }

    fn row(&self, case: &Case, outcome: &RunOutcome) -> Row {
        let set = &self.skills[case.skill];
        let turns = set.manifold.has_orientation();
        let degrees = outcome.goal_error_rad.to_degrees();
        let [metres_max, degrees_max] = case.experiment.tolerance(set.scale());
        let mut row = Row {
            goal_error_m: finite(outcome.goal_error_m),
            thesis_metric: self.thesis_metric(case),
            reached: outcome.goal_error_m <= metres_max && degrees <= degrees_max,
            collided: outcome.collided(),
            clearance_min_m: outcome.clearance_min_m.and_then(finite),
            acceleration_max_m_s2: finite(outcome.acceleration_max_m_s2),
            goal_error_deg: if turns { finite(degrees) } else { None },
            energy_rise_max: finite(outcome.energy_rise_max),
            ..self.empty_row(case)
        };
        if case.experiment.tracks() {
            track(&mut row, set, case, outcome);
        }
        if case.experiment.disturbs() {
            row.tube_distances = tube_distances(set, case, outcome);
        }
        row
    }
}

/// Compares a rollout with the demonstration that it should repeat.
fn track(row: &mut Row, set: &SkillSet, case: &Case, outcome: &RunOutcome) {
    let turns = set.manifold.has_orientation();
    let dt = set.demonstrations[case.instance].sampling_time_s;
    let moving = set.motion(case.instance);
    let points = resampled(&positions(moving), dt, STEP_S);
    let path = positions(&outcome.path);
    let mse = mean_square(&path, &points);
    row.time_aligned_mse_m2 = finite(mse);
    let square = |(i, pose): (usize, &Pose)| {
        let at = (i as f64 * dt / STEP_S).round() as usize;
        outcome.path[at.min(outcome.path.len() - 1)].rotation_from(pose).length_squared()
    };
    let sum: f64 = moving.iter().enumerate().map(square).sum();
    let rms_deg = if turns { (sum / moving.len() as f64).sqrt().to_degrees() } else { 0.0 };
    row.tracking_rms = mse.is_finite().then_some([mse.sqrt(), rms_deg]);
    let planar = set.space() == Space::Planar;
    let converged = outcome.goal_error_m.is_finite();
    row.measures = converged.then(|| Measures::of(&path, &points, STEP_S, planar));
}

/// Distances to the path of the demonstration after the push, or after the obstacle, as fractions of the skill's
/// size; a body that came to rest stays. `None` when it diverged, or never passed.
fn tube_distances(
    set: &SkillSet,
    case: &Case,
    outcome: &RunOutcome,
) -> Option<[f64; AFTER_PUSH_S.len()]> {
    if !outcome.goal_error_m.is_finite() {
        return None;
    }
    let demonstrated = positions(set.motion(case.demonstration()));
    let since = match (case.conditions.push, &case.conditions.ball) {
        (Some(push), _) => (push.during_s[1] / STEP_S).round() as usize,
        (None, Some(ball)) => passed(&positions(&outcome.path), &demonstrated, ball)?,
        (None, None) => return None,
    };
    Some(AFTER_PUSH_S.map(|after_s| {
        let step = since + (after_s / STEP_S).round() as usize;
        let body = outcome.path[step.min(outcome.path.len() - 1)].position;
        distance_to_path(body, &demonstrated) / set.size_m()
    }))
}

/// The first step from which on a body is nearest to a part of the demonstrated path that lies behind the ball.
fn passed(path: &[DVec3], demonstrated: &[DVec3], ball: &Ball) -> Option<usize> {
    let inside = |p: &DVec3| p.distance(ball.center) < ball.radius_m;
    let behind = demonstrated.iter().rposition(inside)? + 1;
    let nearest = |body: &DVec3| {
        let distances = demonstrated.iter().map(|p| p.distance_squared(*body));
        distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i)
    };
    let before = path.iter().rposition(|body| nearest(body) < behind).map_or(0, |last| last + 1);
    (before < path.len()).then_some(before)
}
