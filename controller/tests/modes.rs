//! Which mode of a skill is taken where there are several.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use nalgebra::SVector;
use tprmp_controller::policy::{RobotPolicy, Task, TaskParameters, Workspace};
use tprmp_controller::skill_leaf::Choice;
use tprmp_controller::startup;
use tprmp_model::controller_config::ControllerConfig;
use tprmp_model::skill_model::{PolicyModel, SkillModel};
use tprmp_rmpflow::leaves::Obstacle;
use tprmp_rmpflow::policy::{PolicyState, SkillPolicy};
use tprmp_spatial::{MovingPose, Pose};

fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The same skill, in the middle displaced along y \[m\].
fn bent(model: &SkillModel, by_m: f64) -> SkillPolicy {
    let mut model = model.clone();
    let PolicyModel::Canonical { position, .. } = &mut model.policy else { panic!("canonical") };
    for component in &mut position.components {
        let phase = component.mean[component.mean.len() - 1];
        component.mean[1] += by_m * (std::f64::consts::PI * phase).sin().max(0.0).powi(2);
    }
    model.policy().unwrap()
}

/// The policy of a robot for a skill of two modes, the second one displaced; and both modes.
fn two_modes<const N: usize>(
    config: &str,
    model: &str,
    by_m: f64,
    edit: impl FnOnce(&mut ControllerConfig),
) -> (RobotPolicy<N>, [SkillPolicy; 2]) {
    let (config, model) = (file(config), file(model));
    let mut loaded = startup::load_with(&config, edit, &[&model], false).unwrap();
    let learned = &loaded.skills[0].model;
    let modes = [bent(learned, 0.0), bent(learned, by_m)];
    loaded.skills[0].modes = modes.to_vec();
    let (chain, points) = startup::robot::<N>(&config, &loaded.config).unwrap();
    (RobotPolicy::new(chain, loaded.policies(), &points, &loaded.config), modes)
}

fn choice<const N: usize>(
    policy: &RobotPolicy<N>,
    workspace: &mut Workspace<N>,
    q: &SVector<f64, N>,
    frames: &[MovingPose],
    obstacles: &[Obstacle],
) -> Choice {
    let parameters =
        TaskParameters { frames, goal_frame: 1, obstacles, external: None, dt_s: 0.001 };
    let rest = SVector::zeros();
    let decision = policy.evaluate(q, &rest, &Task::Skill, &parameters, workspace).unwrap();
    assert!(decision.acceleration.iter().all(|a| a.is_finite()));
    workspace.choice().unwrap()
}

fn ball(at: DVec3) -> Obstacle {
    Obstacle::sphere(at, 0.1, DVec3::ZERO)
}

/// Start and goal frame in the plane.
fn frames() -> [MovingPose; 2] {
    let at = |x: f64, y: f64| Pose { position: DVec3::new(x, y, 0.0), ..Pose::IDENTITY };
    [at(-0.9, 0.1), at(0.9, -0.1)].map(MovingPose::at_rest)
}

fn planar(edit: impl FnOnce(&mut ControllerConfig)) -> (RobotPolicy<2>, [SkillPolicy; 2]) {
    let (config, model) =
        ("config/controllers/planar.ron", "learner/tests/golden/canonical_plane.ron");
    two_modes(config, model, 0.6, edit)
}

fn place(mode: &SkillPolicy, fraction: f64) -> DVec3 {
    mode.on_path(&frames(), fraction, &mut PolicyState::default()).position
}

#[test]
fn the_nearest_mode_is_taken_and_kept_until_the_skill_starts_anew() {
    let (policy, modes) = planar(|_| {});
    let mut workspace = policy.workspace();
    let at = |mode: usize| {
        let place = place(&modes[mode], 0.5);
        SVector::from([place.x, place.y])
    };
    assert!((at(0) - at(1)).norm() > 0.3);
    for mode in [0, 1] {
        let decided = choice(&policy, &mut workspace, &at(mode), &frames(), &[]);
        assert_eq!((decided.mode, decided.modes), (mode, 2));
        assert!(decided.prospect.is_reachable() && decided.prospect.is_free());
        assert!(decided.prospect.distance_m < 0.01, "{decided:?}");
        let elsewhere = choice(&policy, &mut workspace, &at(1 - mode), &frames(), &[]);
        assert_eq!(elsewhere, decided, "decided once");
        workspace.restart();
    }
}

#[test]
fn a_mode_that_is_free_is_taken_before_one_that_is_near() {
    let (policy, modes) = planar(|_| {});
    let start = SVector::from([-0.9, 0.1]);
    for blocked in [0, 1] {
        let obstacle = ball(place(&modes[blocked], 0.5));
        let decided = choice(&policy, &mut policy.workspace(), &start, &frames(), &[obstacle]);
        assert_eq!((decided.out_of_reach, decided.blocked), (0, 1), "{decided:?}");
        assert_eq!(decided.mode, 1 - blocked);
        assert!(decided.prospect.is_free() && decided.prospect.clearance_m > 0.05);
    }
    // Neither is free: the one that is obstructed less.
    let beside = place(&modes[1], 0.5) + DVec3::new(0.0, 0.08, 0.0);
    let obstacles = [ball(place(&modes[0], 0.5)), ball(beside)];
    let decided = choice(&policy, &mut policy.workspace(), &start, &frames(), &obstacles);
    assert!(decided.mode == 1 && !decided.prospect.is_free(), "{decided:?}");
    // What has been passed is in nobody's way.
    let later = place(&modes[0], 0.9);
    let behind = [ball(place(&modes[0], 0.2))];
    let at = SVector::from([later.x, later.y]);
    let decided = choice(&policy, &mut policy.workspace(), &at, &frames(), &behind);
    assert!(decided.prospect.is_free(), "{decided:?}");
}

#[test]
fn a_mode_that_the_arm_cannot_follow_is_taken_last() {
    let (_, modes) = planar(|_| {});
    let high = place(&modes[1], 0.5);
    // The second mode leads beyond the working range of the second joint.
    let (policy, _) = planar(|config| {
        let range = config.robot.working_range.entry("y_joint".into()).or_insert([-1.0, 1.0]);
        range[1] = high.y - 0.1;
    });
    let q = SVector::from([high.x, high.y - 0.11]);
    let decided = choice(&policy, &mut policy.workspace(), &q, &frames(), &[]);
    assert!(decided.mode == 0 && decided.prospect.is_reachable(), "{decided:?}");
}

#[test]
fn an_arm_follows_both_modes_in_thought_and_none_to_where_it_does_not_reach() {
    let (config, model) =
        ("config/controllers/ur5_pick.ron", "learner/tests/golden/canonical_poses.ron");
    let (policy, modes) = two_modes::<6>(config, model, 0.3, |_| {});
    let q = SVector::from([-3.3, -1.45, 1.65, -1.77, -1.57, 0.0]);
    let mut kinematics = tprmp_robot::Kinematics::new();
    tprmp_robot::forward_kinematics(policy.chain(), &q, &mut kinematics);
    let start = kinematics.tool_pose();
    // The skill was demonstrated with a tool that is rotated in its frames.
    let rotated = |angle: f64| start.orientation * DQuat::from_rotation_x(-angle);
    let first = Pose { orientation: rotated(2.0), ..start };
    let goal = |x: f64| Pose { position: DVec3::new(x, -0.3, 0.1), orientation: rotated(2.5) };
    let decide = |x: f64, obstacles: &[Obstacle]| {
        let frames = [first, goal(x)].map(MovingPose::at_rest);
        let middle = [0, 1].map(|mode: usize| {
            modes[mode].on_path(&frames, 0.5, &mut PolicyState::default()).position
        });
        let decided = choice(&policy, &mut policy.workspace(), &q, &frames, obstacles);
        (decided, middle)
    };
    let (decided, middle) = decide(0.45, &[]);
    assert!(decided.prospect.is_reachable(), "{decided:?}");
    for blocked in [0, 1] {
        let obstacle = Obstacle::sphere(middle[blocked], 0.02, DVec3::ZERO);
        let (decided, _) = decide(0.45, &[obstacle]);
        assert_eq!(decided.mode, 1 - blocked, "{decided:?}");
        assert!(decided.prospect.is_reachable() && decided.prospect.is_free(), "{decided:?}");
    }
    let (decided, _) = decide(3.0, &[]);
    assert!(!decided.prospect.is_reachable() && decided.prospect.beside[0] > 1.0, "{decided:?}");
}
