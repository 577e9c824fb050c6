//! A joint without an end that the robot reports in [−π, π): over real ports, in lockstep with an arm behind a
//! guard that does what it is commanded.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};
use tprmp_controller::timing::pacing::Pacing;
use tprmp_messages::{
    Action, Bounds, CommandGuard, CommandMode, Instance, JointBounds, JointCommand, Reason,
    TaskFrames,
};
use tprmp_model::controller_config::ControllerConfig;

use crate::common::{Controller, POSES, answer, file};

const MS: u64 = 1_000_000;
const TICKS: u64 = 4000;
/// The first states confirm each other: nothing is commanded before.
const CONFIRMING: u64 = 2;
/// Unlike each other, so that the joint passes its end within steps of all lengths \[ns\].
const STEPS_NS: [u64; 5] = [MS, 3 * MS, 2 * MS, 500_000, 7 * MS];

/// The arm with a first joint that has no end, free to go where it likes.
fn continuous(config: &mut ControllerConfig, name: &str) {
    let text = std::fs::read_to_string(file("config/robots/ur5.urdf")).unwrap();
    let joint = "name=\"shoulder_pan_joint\" type=\"";
    assert!(text.contains(&format!("{joint}revolute")));
    let text = text.replace(&format!("{joint}revolute"), &format!("{joint}continuous"));
    let path = std::env::temp_dir().join(format!("{name}.urdf"));
    std::fs::write(&path, text).unwrap();
    config.robot.urdf = path;
    config.robot.working_range.clear();
}

/// The skill's frames and the first joint, rotated about the base's axis so far \[rad\].
fn rotated(angle: f64) -> TaskFrames {
    let mut frames = POSES.frames();
    let rotation = DQuat::from_rotation_z(angle);
    for frame in &mut frames.frames[..2] {
        frame.position = (rotation * DVec3::from(frame.position)).to_array();
        let DQuat { x, y, z, w } = rotation;
        frame.quaternion = [w, x, y, z];
    }
    frames
}

/// In [−π, π).
fn within_a_turn(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// Commands of a run from this posture of the first joint \[rad\], with the position that was reported before each.
fn run(
    name: &str,
    first: f64,
    angle: f64,
    reports_within_a_turn: bool,
) -> Vec<(JointCommand, f64)> {
    let name = format!("{name}-{}", std::process::id());
    let instance = Instance::new(&name).unwrap();
    let ports = instance.open_state_publisher().unwrap();
    let controller =
        Controller::start(&POSES, &instance, Pacing::Lockstep, |config| continuous(config, &name));
    let mut bounds = JointBounds::same(3.2, 40.0, 20.0);
    bounds.continuous[0] = reports_within_a_turn;
    let mut guard = CommandGuard::new(6, Bounds { joints: Some(bounds), ..Bounds::default() });
    let report = |q: f64| if reports_within_a_turn { within_a_turn(q) } else { q };
    let (mut state, mut frames) = (POSES.state(), rotated(angle));
    state.position[0] = first;
    let mut time_ns = 1000 * MS;
    let mut commands = Vec::new();
    for tick in 0..TICKS + CONFIRMING {
        state.sequence += 1;
        frames.sequence += 1;
        time_ns += STEPS_NS[tick as usize % STEPS_NS.len()];
        (state.time_ns, frames.time_ns) = (time_ns, time_ns);
        state.position[0] = report(state.position[0]);
        assert!(ports.frames.publish(frames) && ports.state.publish(state));
        let command = answer(&ports, state.sequence);
        if tick < CONFIRMING {
            continue;
        }
        let action = guard.judge(time_ns, Some(&command), &state);
        assert!(matches!(action, Action::Obey(_)), "tick {tick}: {:?}", guard.last_fault());
        commands.push((command, state.position[0]));
        (state.position, state.velocity) = (command.position, command.velocity);
    }
    let outcome = controller.stop(|| {
        state.sequence += 1;
        state.time_ns += MS;
        state.position[0] = report(state.position[0]);
        assert!(ports.state.publish(state));
    });
    std::fs::remove_file(std::env::temp_dir().join(format!("{name}.urdf"))).unwrap();
    assert_eq!(outcome.run.allocations, 0);
    commands
}

#[test]
fn it_passes_pi_in_both_directions_as_if_it_were_reported_without_leaps() {
    for (name, first, angle) in [("turn-up", PI - 0.3, PI), ("turn-down", 0.3 - PI, 0.0)] {
        let without = run(&format!("{name}-without"), first, angle, false);
        let within = run(&format!("{name}-within"), first, angle, true);
        let (mut leaps, mut turns) = (0, 0.0);
        for (tick, pair) in within.windows(2).enumerate() {
            let [(before, _), (command, reported)] = pair else { unreachable!() };
            let (expected, _) = &without[tick + 1];
            assert_eq!(command.mode, CommandMode::Track.to_wire(), "tick {tick}");
            assert_ne!(command.reason, Reason::StateUnbelievable.to_wire(), "tick {tick}");
            // In the turn in which the joint was reported.
            assert!((command.position[0] - reported).abs() < 0.1, "tick {tick}");
            let step = command.position[0] - before.position[0];
            if step.abs() > PI {
                leaps += 1;
                turns -= step.signum();
            }
            assert!((step - TAU * (step / TAU).round()).abs() < 0.03, "tick {tick}: {step}");
            let beside = command.position[0] + TAU * turns - expected.position[0];
            assert!(beside.abs() < 1e-6, "tick {tick}: {beside}");
            for i in 0..6 {
                assert!((command.velocity[i] - expected.velocity[i]).abs() < 1e-6, "tick {tick}");
            }
        }
        println!("{name}: {leaps} leaps, {turns} turns, {:?}", without.last().unwrap().0.position);
        assert!(leaps >= 1, "{name} does not pass its end");
        assert_eq!(turns, if angle > 0.0 { 1.0 } else { -1.0 });
    }
}
