//! Skills of a few centimetres, and what was not made for them: pushes of a person, obstacles over the goal.

use std::path::Path;

use glam::DVec3;
use tprmp_experiments::conditions::{Ball, Conditions, GoalMotion, Push};
use tprmp_experiments::world::{RunOutcome, run};
use tprmp_learner::canonical::mean_goal;
use tprmp_learner::certify::policy::{Body, LearnedPolicy};
use tprmp_learner::demonstration::{Demonstration, read_folder};
use tprmp_learner::skill::Skill;
use tprmp_learner::train::learn;
use tprmp_model::controller_config;
use tprmp_model::skill_model::Manifold;

const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");
/// The span of the small skill \[m\].
const SPAN_M: f64 = 0.05;
/// What a person pushes with \[N\], for a second.
const PUSH_N: f64 = 90.0;

/// The shipped planar demonstrations, made small.
fn small() -> (Skill, Vec<Demonstration>) {
    let skill = Skill::read(&Path::new(CONFIG).join("skills/planar.ron")).unwrap();
    let folder = Path::new(CONFIG).join("demonstrations/planar");
    let mut demonstrations =
        read_folder(&folder, "planar", Manifold::R2, "start", "end", &[]).unwrap();
    let first = &demonstrations[0];
    let factor = SPAN_M / first.start.position.distance(first.goal_frame.position);
    for demonstration in &mut demonstrations {
        demonstration.start.position *= factor;
        demonstration.goal_frame.position *= factor;
        demonstration.poses.iter_mut().for_each(|pose| pose.position *= factor);
    }
    (skill, demonstrations)
}

fn outcome(push: Option<Push>, ball: Option<f64>) -> (RunOutcome, Vec<DVec3>) {
    let (skill, demonstrations) = small();
    let model = learn(&skill, &demonstrations, 1, &mut |_| {}).unwrap().model;
    assert!(model.certificate.holds(), "{:?}", model.certificate.failures);
    let config =
        controller_config::read(&Path::new(CONFIG).join("controllers/planar.ron")).unwrap();
    let policy =
        LearnedPolicy::with(&model, config.skill.inertia(), Some(config.skill.governor)).unwrap();
    let first = &demonstrations[0];
    let ball = ball.map(|radius_m| Ball {
        center: first.goal_frame.position,
        radius_m,
        avoidance: config.collision.as_ref().unwrap().leaf(),
    });
    let conditions = Conditions {
        manifold: Manifold::R2,
        frames: vec![first.start, first.goal_frame],
        grasp: mean_goal(&demonstrations),
        start: Body::at_rest(first.poses[0]),
        own_goal: false,
        step_s: 0.001,
        duration_s: 20.0,
        goal_motion: GoalMotion::default(),
        push,
        ball,
        scale: 1.0,
    };
    let path = first.poses.iter().map(|pose| pose.position).collect();
    (run(&mut policy.instance(), &conditions), path)
}

fn farthest(outcome: &RunOutcome, path: &[DVec3]) -> f64 {
    let from = |p: DVec3| path.iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
    outcome.path.iter().map(|pose| from(pose.position)).fold(0.0, f64::max)
}

#[test]
fn a_push_of_a_person_leads_no_farther_than_damping_lets_it_and_back() {
    let push = Push { force_n: PUSH_N, during_s: [0.5, 1.5], as_published: false };
    let (outcome, path) = outcome(Some(push), None);
    let most = farthest(&outcome, &path);
    assert!(outcome.goal_error_m < 1e-3, "{} m from the goal, {most} m away", outcome.goal_error_m);
    assert!(most < 1.0, "{most} m away");
}

#[test]
fn an_obstacle_over_the_goal_is_waited_at() {
    // The larger ones cover the start, too.
    for radius_m in [0.005, 0.02, 0.1, 0.4] {
        let (outcome, path) = outcome(None, Some(radius_m));
        let most = farthest(&outcome, &path);
        assert!(most < SPAN_M, "{most} m beside the path, at a ball of {radius_m} m");
    }
}
