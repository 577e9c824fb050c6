//! Several skills at once, and a goal attractor beside them: what the tree makes of them.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use nalgebra::SVector;
use tprmp_controller::policy::{RobotPolicy, Task, TaskParameters, Workspace};
use tprmp_controller::startup::{self, Loaded};
use tprmp_model::controller_config::{ControllerConfig, Moves, ToolOffset};
use tprmp_rmpflow::leaves::PoseAttractor;
use tprmp_robot::{Chain, ControlPoints};
use tprmp_spatial::{MovingPose, Pose};

const N: usize = 2;

fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The planar robot with as many copies of one model as `beside` makes, and what `edit` changes.
fn policy(beside: &[f64], edit: impl FnOnce(&mut ControllerConfig)) -> RobotPolicy<N> {
    let config = file("config/controllers/planar.ron");
    let models = vec![file("learner/tests/golden/canonical_plane.ron"); 1 + beside.len()];
    let edit = |config: &mut ControllerConfig| {
        config.collision = None;
        config.joint_limits = None;
        config.joint_speeds = None;
        for inertia in beside {
            let mut leaf = config.skill;
            leaf.linear_inertia_kg = *inertia;
            config.additional_skills.push(leaf);
        }
        edit(config);
    };
    let loaded = startup::load_with(&config, edit, &models, false).unwrap();
    let (chain, points) = startup::robot::<N>(&config, &loaded.config).unwrap();
    RobotPolicy::new(chain, loaded.policies(), &points, &loaded.config)
}

/// Start and goal frame of the skill, the goal displaced.
fn frames(displacement: DVec3) -> [MovingPose; 2] {
    let at = |position: DVec3| MovingPose::at_rest(Pose { position, ..Pose::IDENTITY });
    [at(DVec3::new(-0.9, 0.1, 0.0)), at(DVec3::new(0.9, -0.1, 0.0) + displacement)]
}

fn acceleration(
    policy: &RobotPolicy<N>,
    frames: &[MovingPose],
    workspace: &mut Workspace<N>,
) -> SVector<f64, N> {
    let parameters =
        TaskParameters { frames, goal_frame: 1, obstacles: &[], external: None, dt_s: 0.001 };
    let (q, qd) = (SVector::from([-0.3, 0.4]), SVector::from([0.5, -0.2]));
    policy.evaluate(&q, &qd, &Task::Skill, &parameters, workspace).unwrap().acceleration
}

fn asked(policy: &RobotPolicy<N>, frames: &[MovingPose]) -> SVector<f64, N> {
    acceleration(policy, frames, &mut policy.workspace())
}

#[test]
fn a_skill_beside_itself_changes_nothing() {
    let demonstrated = frames(DVec3::ZERO);
    let alone = asked(&policy(&[], |_| {}), &demonstrated);
    let twice = asked(&policy(&[3.0], |_| {}), &[demonstrated, demonstrated].concat());
    assert!(alone.norm() > 0.1 && (twice - alone).norm() < 1e-9, "{alone} {twice}");
}

#[test]
fn two_skills_on_frames_of_their_own_are_weighed_by_their_metrics() {
    let (here, there) = (frames(DVec3::ZERO), frames(DVec3::new(0.2, 0.5, 0.0)));
    let alone = policy(&[], |_| {});
    let [first, second] = [&here, &there].map(|frames| asked(&alone, frames));
    let both = |inertia: f64| asked(&policy(&[inertia], |_| {}), &[here, there].concat());
    // From the first alone to the second alone, as the second grows heavier.
    let apart = (first - second).norm();
    for (inertia, near_first, near_second) in
        [(1e-6, true, false), (1.0, false, false), (1e6, false, true)]
    {
        let asked = both(inertia);
        assert_eq!((asked - first).norm() < 1e-3 * apart, near_first, "{inertia}: {asked}");
        assert_eq!((asked - second).norm() < 1e-3 * apart, near_second, "{inertia}: {asked}");
    }
}

#[test]
fn each_skill_keeps_a_phase_of_its_own() {
    let (here, there) = (frames(DVec3::ZERO), frames(DVec3::new(0.2, 0.5, 0.0)));
    let policy = policy(&[1.0], |_| {});
    let mut workspace = policy.workspace();
    let all = [here, there].concat();
    let first = acceleration(&policy, &all, &mut workspace);
    assert_eq!(acceleration(&policy, &all, &mut workspace), first, "until they go on");
    for _ in 0..50 {
        let a = acceleration(&policy, &all, &mut workspace);
        workspace.advance(&a, 0.01);
    }
    let later = acceleration(&policy, &all, &mut workspace);
    assert!((later - first).norm() > 1e-3, "{later} {first}");
    workspace.restart();
    assert_eq!(acceleration(&policy, &all, &mut workspace), first);
}

#[test]
fn a_goal_attractor_draws_beside_the_skill() {
    let demonstrated = frames(DVec3::ZERO);
    let attractor = |linear_inertia_kg: f64| PoseAttractor {
        linear_inertia_kg,
        angular_inertia_kg_m2: 0.0,
        stiffness_1_s2: 4.0,
        damping_1_s: 4.0,
        saturation_m: 0.5,
    };
    let alone = asked(&policy(&[], |_| {}), &demonstrated);
    let with = |inertia: f64| {
        asked(
            &policy(&[], |config| config.goal_attractor = Some(attractor(inertia))),
            &demonstrated,
        )
    };
    let heavy = with(1e6);
    let (q, qd) = (DVec3::new(-0.3, 0.4, 0.0), DVec3::new(0.5, -0.2, 0.0));
    let policy = policy(&[], |_| {});
    let parameters = TaskParameters {
        frames: &demonstrated,
        goal_frame: 1,
        obstacles: &[],
        external: None,
        dt_s: 0.001,
    };
    let at = [SVector::from([q.x, q.y]), SVector::from([qd.x, qd.y])];
    let decision = policy
        .evaluate(&at[0], &at[1], &Task::Skill, &parameters, &mut policy.workspace())
        .unwrap();
    let away = decision.tool.position - decision.goal.position;
    let pull = away * (4.0 * 0.5 / (away.length_squared() + 0.25).sqrt());
    let expected = -pull - qd * 4.0;
    assert!((heavy - SVector::from([expected.x, expected.y])).norm() < 1e-3, "{heavy}");
    let light = with(0.2);
    assert!((light - alone).norm() > 1e-3 && (light - heavy).norm() < (alone - heavy).norm());
}

#[test]
fn models_are_as_many_as_leaves_for_them() {
    let config = file("config/controllers/planar.ron");
    let model = file("learner/tests/golden/canonical_plane.ron");
    for models in [vec![], vec![model.clone(), model]] {
        let error = startup::load(&config, &models, false).unwrap_err().to_string();
        let found = format!("found it {} times", models.len());
        assert!(error.contains("additional_skills") && error.contains(&found), "{error}");
    }
}

/// A SCARA, which cannot tilt its tool, with a skill on poses.
fn scara(moves: Moves) -> (PathBuf, Loaded, Chain<4>, ControlPoints) {
    let path = file("config/controllers/scara.ron");
    let model = file("learner/tests/golden/canonical_poses.ron");
    let edit = |config: &mut ControllerConfig| {
        config.skill.moves = moves;
        config.robot.tool_offset = Some(ToolOffset {
            frame: "suction_tip".into(),
            position_m: [0.0; 3],
            quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
        });
        config.keep_upright = None;
    };
    let loaded = startup::load_with(&path, edit, &[model], true).unwrap();
    let (chain, points) = startup::robot::<4>(&path, &loaded.config).unwrap();
    (path, loaded, chain, points)
}

#[test]
fn an_arm_that_cannot_turn_its_tool_does_the_position_of_a_skill_on_poses() {
    let (path, loaded, chain, _) = scara(Moves::Whole);
    let refused = startup::check_freedom(&path, &chain, &loaded).unwrap_err().to_string();
    assert!(refused.contains("`skill.moves: Position`"), "{refused}");

    let (path, loaded, chain, points) = scara(Moves::Position);
    startup::check_freedom(&path, &chain, &loaded).unwrap();
    let policy = RobotPolicy::new(chain, loaded.policies(), &points, &loaded.config);
    assert_eq!(policy.moved().as_slice(), [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    let mut workspace = policy.workspace();
    let (mut q, mut qd) = (SVector::from([0.5, 1.0, -0.1, 0.3]), SVector::<f64, 4>::zeros());
    let start = policy.tool_pose(&q, &mut workspace);
    let there = SVector::from([-0.3, 1.3, -0.05, 0.0]);
    let goal = Pose {
        // However the goal is tilted.
        orientation: DQuat::from_rotation_x(0.4),
        ..policy.tool_pose(&there, &mut workspace)
    };
    let frames = [start, goal].map(MovingPose::at_rest);
    let parameters = TaskParameters {
        frames: &frames,
        goal_frame: 1,
        obstacles: &[],
        external: None,
        dt_s: 0.002,
    };
    let mut last = f64::INFINITY;
    for _ in 0..5000 {
        let decision = policy.evaluate(&q, &qd, &Task::Skill, &parameters, &mut workspace).unwrap();
        workspace.advance(&decision.acceleration, 0.002);
        qd += decision.acceleration * 0.002;
        q += qd * 0.002;
        last = policy.tool_pose(&q, &mut workspace).position.distance(decision.goal.position);
    }
    assert!(last < 1e-3, "{last} m from its goal");
}
