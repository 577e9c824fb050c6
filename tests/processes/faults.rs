//! What the controller does when its inputs fail, observed from outside: a publisher of the test's own
//! feeds it over shared memory and looks at the commands.

use tprmp_messages::{CommandMode, JointCommand, Reason, RobotState, TaskFrames};

use crate::common::Place;
use crate::robot::{Robot, signal, start, stop, stop_live};

/// Each fault stops the point in bounded time with its reason; afterwards it goes on, from rest.
#[test]
fn faulty_input_brings_the_arm_to_rest_with_a_reason_and_it_resumes() {
    type StateFault = fn(&mut RobotState);
    type FramesFault = fn(&mut TaskFrames);
    let none_state: StateFault = |_| {};
    let none_frames: FramesFault = |_| {};
    let faults: [(StateFault, FramesFault, Reason); 20] = [
        (|s| s.velocity[1] = 1e6, none_frames, Reason::StateUnbelievable),
        (|s| s.gripper_state = 9, none_frames, Reason::GripperUnknown),
        (none_state, |f| f.time_ns += 500_000_000, Reason::FramesStale),
        (|s| s.position[1] = -99.0, none_frames, Reason::JointLimit),
        (|s| s.position[1] = f64::NAN, none_frames, Reason::StateNotFinite),
        (|s| s.velocity[0] = f64::INFINITY, none_frames, Reason::StateNotFinite),
        (|s| s.joint_count = 6, none_frames, Reason::JointCount),
        (|s| s.position[0] = 99.0, none_frames, Reason::JointLimit),
        (none_state, |f| f.frames[1].valid = 0, Reason::FrameMissing),
        (none_state, |f| f.frames[1].position[0] = f64::NAN, Reason::FrameNotFinite),
        (
            none_state,
            |f| f.frames[0].quaternion = [0.5; 4].map(|v| v * 1.5),
            Reason::QuaternionNotUnit,
        ),
        (none_state, |f| f.time_ns -= 500_000_000, Reason::FramesStale),
        (|s| s.torque[1] = f64::NEG_INFINITY, none_frames, Reason::StateNotFinite),
        (none_state, |f| f.frames[1].name[0] = b'x', Reason::FrameMissing),
        (none_state, |f| f.frame_count = 1, Reason::FrameMissing),
        (none_state, |f| f.frames[2].angular_velocity[1] = f64::NAN, Reason::FrameNotFinite),
        (none_state, |f| f.frames[1].quaternion[3] = f64::NAN, Reason::FrameNotFinite),
        (none_state, |f| f.obstacles[0].linear_velocity[0] = f64::INFINITY, Reason::FrameNotFinite),
        (none_state, |f| f.obstacles[0].kind = 99, Reason::ObstacleUnknown),
        (none_state, |f| f.obstacle_count = 99, Reason::ObstacleCount),
    ];
    let place = Place::new("faults");
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    for (state_fault, frames_fault, reason) in faults {
        robot.run_up();
        let mut top_speed = robot.speed();
        let mut modes = Vec::new();
        for tick in 0..1000 {
            let command = robot.exchange(state_fault, frames_fault);
            // A position that jumps is first of all not believed, for 50 ms.
            let jump = tick < 50 && reason == Reason::JointLimit;
            let expected = if jump { Reason::StateUnbelievable } else { reason };
            assert_eq!(Reason::from_wire(command.reason), Some(expected));
            modes.push(command.mode);
            top_speed = top_speed.max(robot.speed());
        }
        let commanded = |mode: CommandMode| modes.contains(&mode.to_wire());
        assert!(commanded(CommandMode::Hold) && !commanded(CommandMode::Track), "{reason:?}");
        assert!(robot.speed() < 0.01, "{reason:?}: {} m/s after a second", robot.speed());
        assert!(top_speed < 0.6, "{reason:?}: it ran away at {top_speed} m/s");
        let resumed = robot.resume();
        assert_eq!(resumed.reason, Reason::None.to_wire());
        let acceleration = resumed.acceleration[0].hypot(resumed.acceleration[1]);
        assert!(acceleration < 1.0, "{reason:?}: resumed with a jump of {acceleration} m/s²");
        robot.put_back();
        robot.resume();
    }
    stop(robot, controller);
}

/// Moved while it was not measured, and measured again while frames are missing: it stays there.
#[test]
fn an_arm_that_was_moved_unmeasured_is_not_snapped_back() {
    let place = Place::new("moved");
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.run_up();
    for _ in 0..500 {
        robot.exchange(|s| s.position[0] = f64::NAN, |_| {});
    }
    robot.state.position[0] += 1.0;
    let there = robot.state.position[0];
    for tick in 0..500 {
        let command = robot.exchange(|_| {}, |f| f.frames[1].valid = 0);
        let unconfirmed = tick < 50;
        let expected = if unconfirmed { Reason::StateUnbelievable } else { Reason::FrameMissing };
        assert_eq!(Reason::from_wire(command.reason), Some(expected));
        assert!(command.torque[0].abs() < 1.0, "{} N", command.torque[0]);
    }
    assert!((robot.state.position[0] - there).abs() < 0.01);
    stop(robot, controller);
}

/// A fault of a single state is enough: to rest first, with the reason, and only then on.
#[test]
fn one_faulty_message_brings_the_arm_to_rest_before_it_goes_on() {
    let place = Place::new("one-fault");
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.run_up();
    let first = robot.exchange(|s| s.velocity[0] = f64::NAN, |_| {});
    comes_to_rest_and_goes_on(&mut robot, first, Reason::StateNotFinite);
    stop(robot, controller);
}

/// A publisher that was started again counts from one.
#[test]
fn a_sequence_that_goes_back_brings_the_arm_to_rest_before_it_goes_on() {
    let place = Place::new("sequence");
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.run_up();
    robot.state.sequence = 0;
    let first = robot.good();
    comes_to_rest_and_goes_on(&mut robot, first, Reason::SequenceWentBack);
    stop(robot, controller);
}

fn comes_to_rest_and_goes_on(robot: &mut Robot, first: JointCommand, reason: Reason) {
    let speed = |command: &JointCommand| command.velocity[0].hypot(command.velocity[1]);
    let mut command = first;
    let mut moving = robot.state.velocity;
    let mut ticks = 0;
    while command.reason != Reason::None.to_wire() {
        assert_eq!(Reason::from_wire(command.reason), Some(reason));
        let before = speed(&command);
        moving = robot.state.velocity;
        command = robot.good();
        assert!(speed(&command) <= before + 1e-3, "the speed rose while it brakes");
        ticks += 1;
        assert!(ticks < 1000, "not at rest within a second");
    }
    assert!(ticks > 5, "a ramp, not a jump: {ticks} ticks");
    assert!(robot.speed() < 0.05, "it goes on at {} m/s", robot.speed());
    for (i, v) in moving.into_iter().enumerate().take(2) {
        let jump = command.position[i] - robot.state.position[i];
        assert!(jump.abs() < 1e-3, "it goes on from elsewhere: {jump} m");
        // What is left of the motion may be braked, but nothing is sped up at once.
        let a = command.acceleration[i];
        assert!(a.abs() < 1.0 || a * v < 0.0, "{a} m/s² at {v} m/s");
    }
    robot.run_up();
}

/// No state arrives any more: the arm is brought to rest blindly, then the robot has to brake. When
/// states come again, from another place, it goes on from there.
#[test]
fn a_stale_state_brings_the_arm_to_rest_and_it_resumes_from_where_it_is_measured() {
    for trigger in ["periodic", "on-state"] {
        let place = Place::new(&format!("stale-{trigger}"));
        let (mut robot, controller) = start(&place, &["--trigger", trigger]);
        robot.run_up_live();
        let stale = Reason::StateStale.to_wire();
        let mut speed = f64::INFINITY;
        robot.until("blind stop", Robot::listen, |_, command| {
            if command.reason == stale {
                let now = command.velocity[0].hypot(command.velocity[1]);
                assert!(now <= speed + 1e-9, "the speed rose while it brakes");
                speed = now;
            }
            command.reason == stale && command.mode == CommandMode::Stop.to_wire()
        });
        robot.state.position[0] += 0.3;
        let measured = robot.state.position[0];
        let resumed = robot.until("resume", Robot::live, |_, command| {
            command.mode == CommandMode::Track.to_wire()
        });
        assert!(
            (resumed.position[0] - measured).abs() < 0.02,
            "{} m",
            resumed.position[0] - measured
        );
        let speed = resumed.velocity[0].hypot(resumed.velocity[1]);
        assert!(speed < 0.1, "it goes on at {speed} m/s");
        stop_live(robot, controller);
    }
}

/// The controller stands still for longer than its commands live: the late tick is counted once with
/// all periods that it skipped, no burst makes up for them, and the arm is brought to rest with the
/// reason before it goes on.
#[test]
fn a_controller_that_was_held_up_says_so_and_does_not_catch_up() {
    for (trigger, held_ms) in [("periodic", 200), ("on-state", 200)] {
        let place = Place::new(&format!("held-up-{trigger}"));
        let (mut robot, controller) = start(&place, &["--trigger", trigger]);
        robot.run_up_live();
        signal(&controller, "-STOP");
        let last = (0..held_ms).filter_map(|_| robot.live()).last();
        assert!(robot.speed() < 1e-9, "expired commands are not obeyed");
        let last_sequence = last.map_or(0, |command| command.sequence);
        signal(&controller, "-CONT");
        let overrun = Reason::Overrun.to_wire();
        let first = robot.until("overrun", Robot::live, |_, command| {
            command.sequence > last_sequence && command.reason == overrun
        });
        // No burst: one tick a period, whatever was missed.
        let mut before = first;
        let resumed = robot.until("resume", Robot::live, |_, command| {
            let ticks = command.sequence - before.sequence;
            let periods = (command.time_ns - before.time_ns).div_ceil(1_000_000);
            if trigger == "periodic" {
                assert!(ticks <= periods + 1, "{ticks} ticks in {periods} periods");
            }
            before = *command;
            command.mode == CommandMode::Track.to_wire()
        });
        for i in 0..2 {
            let jump = resumed.position[i] - robot.state.position[i];
            assert!(jump.abs() < 0.02, "it goes on from elsewhere: {jump} m");
        }
        stop_live(robot, controller);
        let summary = crate::common::json(&place.path("controller.json"));
        let number = |key: &str| summary[key].as_u64().unwrap();
        assert!(number("skipped_periods") >= 100, "{summary}");
        assert!(number("deadline_misses") >= 1, "{summary}");
        // At rest, it waits for ticks in time.
        assert!(summary["ticks_by_reason"]["Overrun"].as_u64().unwrap() >= 49, "{summary}");
        let worst = &summary["worst_ticks"][0];
        assert!(worst["wake_up_us"].as_f64().unwrap() > 1e5, "{worst}");
        assert!(worst["skipped_periods"].as_u64().unwrap() >= 100, "{worst}");
    }
}

/// The same positions again and again with new stamps and numbers, while the point moves.
#[test]
fn positions_that_stand_still_in_motion_are_found_within_50_ms_and_told_with_the_joint() {
    let place = Place::new("frozen");
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.run_up();
    let position = robot.state.position;
    let freeze = |state: &mut RobotState| {
        (state.position, state.velocity) = (position, [0.0; 8]);
    };
    let found = (0..60).find(|_| {
        let command = robot.exchange(freeze, |_| {});
        command.reason == Reason::PositionsFrozen.to_wire()
    });
    assert!(found.is_some_and(|ms| ms <= 50), "{found:?}");
    stop(robot, controller);
    let summary = crate::common::json(&place.path("controller.json"));
    let said = summary["seen_by_reason"]["PositionsFrozen"].as_str().unwrap();
    let joints = [("joint 1 `x_joint`", position[0]), ("joint 2 `y_joint`", position[1])];
    let named = |(joint, at)| said.starts_with(&format!("{joint} stays at {at:.5} "));
    assert!(joints.into_iter().any(named), "{said}, {position:?}");
}
