//! Skills on part of a pose, learned from recorded poses, on arms in lockstep that do exactly what they are commanded.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use nalgebra::SVector;
use tprmp_controller::control::server::Shared;
use tprmp_controller::startup;
use tprmp_controller::timing::pacing::Pacing;
use tprmp_messages::{
    CommandMode, ControllerStatus, Frame, GripperState, Instance, JointCommand, LifeCycle, Reason,
    RobotState, TaskFrames,
};
use tprmp_model::controller_config::{ControllerConfig, StartFrame};
use tprmp_rmpflow::leaves::KeepUpright;
use tprmp_robot::{Chain, Kinematics, forward_kinematics};
use tprmp_spatial::Pose;

use crate::common::{Place, file, program, run, text};

/// Time between two states \[ns\].
const STEP_NS: u64 = 2_000_000;
const PATIENCE: Duration = Duration::from_secs(60);

fn pose_of<const N: usize>(chain: &Chain<N>, position: &[f64]) -> Pose {
    let mut kinematics = Kinematics::new();
    forward_kinematics(chain, &SVector::from_column_slice(&position[..N]), &mut kinematics);
    kinematics.tool_pose()
}

/// Where the tool begins and ends after `seconds`, with this frame of the goal alone, which nobody else publishes.
fn follow<const N: usize>(
    (config, model): (&str, &str),
    edit: impl FnOnce(&mut ControllerConfig),
    start: [f64; N],
    object: &Pose,
    seconds: f64,
) -> [Pose; 2] {
    static RUNS: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
    let run = RUNS.fetch_add(1, Ordering::Relaxed);
    let instance = Instance::new(&format!("parts-{}-{run}", std::process::id())).unwrap();
    let path = std::path::PathBuf::from(file(config));
    let loaded = startup::load_with(&path, edit, &[model], false).unwrap();
    let chain: Chain<N> = startup::robot(&path, &loaded.config).unwrap().0;
    let ports = instance.open_state_publisher().unwrap();
    let shared = Shared::new(Arc::new(AtomicBool::new(false)));
    let stop = Arc::clone(&shared.stop);
    let controller = std::thread::spawn(move || {
        let cycle =
            startup::cycle::<N>(&path, &loaded, Pacing::Lockstep, false, &instance, shared.clone());
        cycle.unwrap().run(&shared.stop);
    });
    let mut frames = TaskFrames { frame_count: 1, ..Default::default() };
    frames.frames[0] = Frame::at("object", object.position.to_array()).unwrap();
    let o = object.orientation;
    frames.frames[0].quaternion = [o.w, o.x, o.y, o.z];
    let mut state = RobotState {
        joint_count: N as u32,
        gripper_state: GripperState::Open.to_wire(),
        ..Default::default()
    };
    state.position[..N].copy_from_slice(&start);
    let (mut command, mut status) = (JointCommand::default(), ControllerStatus::default());
    let steps = (seconds * 1e9) as u64 / STEP_NS;
    for step in 1..=steps {
        if command.sequence > 0 && command.mode != CommandMode::Stop.to_wire() {
            (state.position, state.velocity) = (command.position, command.velocity);
        }
        (state.sequence, frames.sequence) = (step, step);
        (state.time_ns, frames.time_ns) = (step * STEP_NS, step * STEP_NS);
        assert!(ports.frames.publish(frames) && ports.state.publish(state));
        let (last, begun) = (command.sequence, Instant::now());
        while command.sequence == last {
            assert!(ports.state.update_connections() && ports.frames.update_connections());
            command = ports.command.receive().map_or(command, |command| *command);
            assert!(begun.elapsed() < PATIENCE, "no answer from the controller");
            std::thread::yield_now();
        }
        while let Some(newest) = ports.status.receive() {
            status = *newest;
        }
        let reason = Reason::from_wire(command.reason).unwrap();
        let expected = [Reason::None, Reason::StateUnconfirmed, Reason::FrameMissing];
        assert!(expected.contains(&reason) || reason == Reason::Unreachable, "{step}: {reason:?}");
    }
    assert_eq!(LifeCycle::from_wire(status.life_cycle), Some(LifeCycle::Done), "{status:?}");
    stop.store(true, Ordering::Relaxed);
    while !controller.is_finished() {
        state.sequence += 1;
        state.time_ns += STEP_NS;
        assert!(ports.state.publish(state));
        std::thread::sleep(Duration::from_millis(1));
    }
    controller.join().unwrap();
    [pose_of(&chain, &start), pose_of(&chain, &state.position)]
}

/// A tool that points down, turned about the vertical.
fn down(yaw: f64) -> DQuat {
    DQuat::from_rotation_z(yaw) * DQuat::from_rotation_x(core::f64::consts::PI)
}

#[test]
fn a_scara_sets_down_on_places_that_are_turned_by_up_to_120_degrees() {
    let model = Place::new("scara").train("place");
    let places = [(0.4, 0.2, 0.2, -120.0), (0.35, 0.3, 0.22, 120.0), (0.45, 0.1, 0.18, 45.0)];
    for (x, y, z, degrees) in places {
        let yaw = f64::to_radians(degrees);
        let object =
            Pose { position: DVec3::new(x, y, z), orientation: DQuat::from_rotation_z(yaw) };
        let files = ("config/controllers/scara.ron", model.as_str());
        let [begin, end] = follow(files, |_| {}, [-1.1, 1.2, -0.05, 0.3], &object, 8.0);
        assert!((begin.position - object.position).length() > 0.2, "{begin:?}");
        let distance = (end.position - object.position).length();
        let angle = end.orientation.angle_between(down(yaw)).to_degrees();
        assert!(distance < 1e-3 && angle < 0.2, "{degrees}°: {distance} m, {angle}°");
    }
}

#[test]
fn an_arm_of_six_joints_keeps_the_tool_upright_where_the_skill_leaves_its_tilt() {
    let place = Place::new("upright");
    let model = on_manifold(&place, "R3xS1", "suction_tip");
    let config = "config/controllers/ur5_pick.ron";
    let edit = |config: &mut ControllerConfig| {
        config.start_frame = StartFrame::Tool;
        (config.lift, config.approach) = (None, None);
        config.keep_upright = Some(KeepUpright {
            tool_axis: DVec3::Z,
            base_axis: DVec3::NEG_Z,
            angular_inertia_kg_m2: 0.5,
            stiffness_1_s2: 30.0,
            damping_1_s: 10.0,
        });
    };
    let yaw = f64::to_radians(70.0);
    let object =
        Pose { position: DVec3::new(0.45, -0.2, 0.2), orientation: DQuat::from_rotation_z(yaw) };
    // The tool begins tilted by 20°.
    let home = [-2.74, -1.57, 1.57, -1.22, -1.57, 0.4];
    let [begin, end] = follow((config, model.as_str()), edit, home, &object, 10.0);
    let tilt = |pose: &Pose| (pose.orientation * DVec3::Z).angle_between(DVec3::NEG_Z).to_degrees();
    assert!(tilt(&begin) > 15.0 && tilt(&end) < 0.2, "{}° {}°", tilt(&begin), tilt(&end));
    let distance = (end.position - object.position).length();
    let angle = end.orientation.angle_between(down(yaw)).to_degrees();
    assert!(distance < 1e-3 && angle < 0.3, "{distance} m, {angle}°");

    let output = run(program("controller").args(["check", &file(config), "--model", &model]));
    let said = text(&output);
    assert!(output.status.success() && said.contains("`keep_upright` keeps it"), "{said}");
}

/// The model of the shipped demonstrations of `place`, of a tool on another manifold.
fn on_manifold(place: &Place, manifold: &str, tool: &str) -> String {
    let demonstrations = format!("\"{}/", file("config/demonstrations"));
    let skill = place.edited(
        "config/skills/place.ron",
        &[
            ("manifold: R3xS1,", &format!("manifold: {manifold},")),
            ("\"gripper_tip\"", &format!("\"{tool}\"")),
            ("\"../demonstrations/", &demonstrations),
        ],
    );
    place.train_file(&skill, &[])
}

#[test]
fn a_skill_on_orientations_alone_turns_the_tool_wherever_it_is() {
    let place = Place::new("orientations");
    let model = on_manifold(&place, "S3", "suction_tip");
    let edit = |config: &mut ControllerConfig| {
        config.start_frame = StartFrame::Tool;
        (config.lift, config.approach) = (None, None);
    };
    let (pictures, folder) = (place.path("pictures"), file("config/demonstrations/place"));
    let arguments = ["plot", &model, "--demonstrations", &folder, "--out", &pictures];
    let output = run(program("learner").args(arguments));
    assert!(output.status.success(), "{}", text(&output));
    let drawn = std::fs::read_to_string(place.folder.join("pictures/orientation.svg")).unwrap();
    assert!(drawn.contains("<path") || drawn.contains("<polyline"));
    let home = [-2.74, -1.57, 1.57, -1.57, -1.57, 0.4];
    for yaw in [-1.2, 0.8] {
        // As far from the tool as no arm reaches: where it is does not matter.
        let object =
            Pose { position: DVec3::new(9.0, 0.0, 0.0), orientation: DQuat::from_rotation_z(yaw) };
        let files = ("config/controllers/ur5_pick.ron", model.as_str());
        let [begin, end] = follow(files, edit, home, &object, 8.0);
        let apart = |pose: &Pose| pose.orientation.angle_between(down(yaw)).to_degrees();
        assert!(apart(&begin) > 20.0 && apart(&end) < 0.2, "{}° {}°", apart(&begin), apart(&end));
    }
}

#[test]
fn an_arm_that_cannot_do_a_skill_is_told_what_it_can_do_before_anything_moves() {
    let place = Place::new("freedom");
    let model = on_manifold(&place, "R3xS3", "gripper_tip");
    let config = file("config/controllers/scara.ron");
    for arguments in [
        vec!["check", config.as_str(), "--model", &model],
        vec!["run", &config, "--model", &model, "--instance", &place.instance],
    ] {
        let output = run(program("controller").args(&arguments));
        let said = text(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        for part in [
            "place.model.ron",
            "key `manifold`",
            "R3xS3",
            "4 joints move the tool along x, y, z and rotate it about z of the base: skills on R2, R3, R3xS1",
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }
    }
}

#[test]
fn recorded_poses_serve_skills_on_parts_of_them_and_a_tilted_tool_is_refused() {
    let place = Place::new("recorded");
    on_manifold(&place, "R3", "gripper_tip");
    let folder = place.folder.join("tilted");
    std::fs::create_dir(&folder).unwrap();
    let demonstration = |name: &str| {
        std::fs::read_to_string(file(&format!("config/demonstrations/place/{name}"))).unwrap()
    };
    std::fs::write(folder.join("01.json"), demonstration("01.json")).unwrap();
    let text_of = demonstration("02.json");
    let (head, samples) = text_of.split_once("\"samples\": [\n").unwrap();
    let (first, rest) = samples.split_once('\n').unwrap();
    let tilted = "[0.4, -0.2, 0.3, 1.0, 0.0, 0.0, 0.0],";
    assert_ne!(first, tilted);
    std::fs::write(folder.join("02.json"), format!("{head}\"samples\": [\n{tilted}\n{rest}"))
        .unwrap();
    let skill =
        place.edited("config/skills/place.ron", &[("\"../demonstrations/place\"", "\"tilted\"")]);
    let output = run(program("learner").args(["train", &skill, "--out", &place.path("none.ron")]));
    let said = text(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    for part in ["02.json", "samples[0]", "at most 45°", "R3xS3"] {
        assert!(said.contains(part), "{part}: {said}");
    }
}
