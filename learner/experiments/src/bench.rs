//! Makes the rollouts, and measures them: as the thesis did, and against the true goal.

use rayon::prelude::*;
use tprmp_learner::canonical::kaiser_smoothing::kaiser_smoothing;
use tprmp_learner::certify::policy::{Body, MotionPolicy};
use tprmp_learner::skill::KaiserSmoothing;
use tprmp_spatial::{Pose, Twist};

use crate::baselines::dmp::Dmp;
use crate::baselines::lqr::Lqr;
use crate::baselines::pd::Pd;
use crate::case::{Case, Extent};
use crate::conditions::{GoalMotion, STEP_S};
use crate::dataset::SkillSet;
use crate::experiment::{Experiment, PolicyKind, Setting, Space};
use crate::metric::{resampled, thesis_tracking, time_aligned_mse_m2};
use crate::models::{Models, SkillFiles};
use crate::path::{mean_duration_s, positions};
use crate::progress::progress;
use crate::results::{Row, finite};
use crate::world::{RunOutcome, run};

/// How the thesis smooths demonstrations.
const PUBLISHED_SMOOTHING: KaiserSmoothing = KaiserSmoothing { window_s: 0.3, shape: 14.0 };
/// The thesis' own conditions: the goal stops within this distance of the policy's own [m] …
const PUBLISHED_STOPS_M: f64 = 0.2;
/// … a rollout takes at most so long [s]; twice that with an obstacle, unbounded when it tracks.
const PUBLISHED_DURATION_S: f64 = 10.0;
/// Room between goal or start and an obstacle that makes a case feasible [m].
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
            conditions.goal_motion.stops_within_m = PUBLISHED_STOPS_M;
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
        let demonstration = case.demonstration();
        let points = || positions(set.motion(demonstration));
        let dt = set.demonstrations[demonstration].sampling_time_s;
        let conditions = &case.conditions;
        let go = |policy: &mut dyn MotionPolicy| run(policy, conditions);
        let policy = case.compared.policy;
        Some(match policy {
            PolicyKind::Canonical | PolicyKind::Thesis => {
                let trained = self.models.get(policy, case.compared.components, &set.name)?;
                go(&mut trained.policy.instance())
            }
            PolicyKind::Pd => go(&mut Pd::new(points(), dt, false)),
            PolicyKind::PdPublished => go(&mut Pd::new(points(), dt, true)),
            PolicyKind::Dmp => {
                let dmp = Dmp::learn(&set.demonstrations);
                let goal_frame = conditions.frames[1];
                let offset = goal_frame.compose(&conditions.grasp).position - goal_frame.position;
                go(&mut dmp.instance(conditions.start.pose.position, offset))
            }
            PolicyKind::TpgmmLqr => go(&mut self.regulator(set)?.instance()),
        })
    }

    /// The regulator of a planar skill.
    pub(crate) fn regulator(&self, set: &SkillSet) -> Option<Lqr> {
        let count = self.count(set, PolicyKind::Thesis);
        let model = &self.models.get(PolicyKind::Thesis, count, &set.name)?.model;
        let duration_s = mean_duration_s(&set.demonstrations);
        let skill = self.files.of(Space::Planar, PolicyKind::Thesis)?;
        Some(Lqr::new(model, skill.mixture.covariance_scale, duration_s))
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
            setting: setting.to_string(),
            x: setting.x(),
            seed: self.seed,
            ..Row::new(experiment, policy)
        }
    }

    fn empty_row(&self, case: &Case) -> Row {
        let conditions = &case.conditions;
        let ball = conditions.ball;
        Row {
            components: case.compared.components,
            instance: case.instance,
            feasible: ball.is_none_or(|ball| ball.leaves_room(conditions, FEASIBLE_ROOM_M)),
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
        let [metres_max, degrees_max] = case.experiment.tolerance();
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
            let dt = set.demonstrations[case.instance].sampling_time_s;
            let moving = set.motion(case.instance);
            let points = resampled(&positions(moving), dt, STEP_S);
            let mse = time_aligned_mse_m2(&positions(&outcome.path), &points);
            row.time_aligned_mse_m2 = finite(mse);
            let square = |(i, pose): (usize, &Pose)| {
                let at = (i as f64 * dt / STEP_S).round() as usize;
                outcome.path[at.min(outcome.path.len() - 1)].rotation_from(pose).length_squared()
            };
            let sum: f64 = moving.iter().enumerate().map(square).sum();
            let rms_deg = if turns { (sum / moving.len() as f64).sqrt().to_degrees() } else { 0.0 };
            row.tracking_rms = mse.is_finite().then_some([mse.sqrt(), rms_deg]);
        }
        row
    }
}
