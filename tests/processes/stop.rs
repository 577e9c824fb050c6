//! How the controller ends and what it does when its inputs fail, seen from outside: a publisher
//! of this test's own feeds it over shared memory and looks at the commands.

use std::process::Child;
use std::time::{Duration, Instant};

use crate::common::{Place, file, finish, text};
use tprmp_messages::{
    CommandMode, Frame, Instance, JointCommand, Reason, RobotState, StatePublisherPorts,
    TaskFrames, name_bytes,
};

/// A point of 1 kg in the plane: it moves by the forces of the commands, or brakes.
struct Robot {
    ports: StatePublisherPorts,
    state: RobotState,
    frames: TaskFrames,
}

impl Robot {
    fn new(place: &Place) -> Self {
        let frame = |name: &str, position: [f64; 3]| Frame {
            name: name_bytes(name).unwrap(),
            valid: 1,
            position,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            ..Default::default()
        };
        let mut frames = TaskFrames { frame_count: 2, ..Default::default() };
        frames.frames[0] = frame("start", [0.0, 0.0, 0.0]);
        frames.frames[1] = frame("end", [2.0, 1.0, 0.0]);
        let ports = Instance::new(&place.instance).unwrap().open_state_publisher().unwrap();
        let state = RobotState { time_ns: 1_000_000_000, joint_count: 2, ..Default::default() };
        Self { ports, state, frames }
    }

    /// Publishes what the edits leave of frames and state, and waits for the answer in lockstep.
    fn exchange(
        &mut self,
        edit_state: impl Fn(&mut RobotState),
        edit_frames: impl Fn(&mut TaskFrames),
    ) -> JointCommand {
        self.state.sequence += 1;
        self.state.time_ns += 1_000_000;
        self.frames.sequence += 1;
        self.frames.time_ns = self.state.time_ns;
        let (mut state, mut frames) = (self.state, self.frames);
        edit_state(&mut state);
        edit_frames(&mut frames);
        assert!(self.ports.frames.publish(frames) && self.ports.state.publish(state));
        let start = Instant::now();
        loop {
            assert!(
                self.ports.state.update_connections() && self.ports.frames.update_connections()
            );
            match self.ports.command.receive() {
                Some(command) if command.state_sequence == state.sequence => {
                    let command = *command;
                    assert_finite(&command);
                    for i in 0..2 {
                        let force = command.torque[i] + command.gravity_torque[i];
                        let stop = command.mode == CommandMode::Stop.to_wire();
                        let v = &mut self.state.velocity[i];
                        *v = if stop { 0.0 } else { *v + force * 0.001 };
                        self.state.position[i] += *v * 0.001;
                    }
                    return command;
                }
                _ => std::thread::sleep(Duration::from_micros(50)),
            }
            assert!(start.elapsed() < Duration::from_secs(20), "no answer from the controller");
        }
    }

    fn good(&mut self) -> JointCommand {
        self.exchange(|_| {}, |_| {})
    }

    /// Runs until the point is on its way.
    fn run_up(&mut self) {
        let under_way = (0..5000).any(|_| {
            self.good();
            self.speed() > 0.3
        });
        assert!(under_way, "the point did not start");
    }

    /// True speed of the point [m/s].
    fn speed(&self) -> f64 {
        self.state.velocity[0].hypot(self.state.velocity[1])
    }
}

fn assert_finite(command: &JointCommand) {
    let lists = [
        command.position,
        command.velocity,
        command.acceleration,
        command.torque,
        command.gravity_torque,
    ];
    assert!(lists.iter().flatten().all(|v| v.is_finite()), "{command:?}");
}

fn start(place: &Place) -> (Robot, Child) {
    let model = place.train("planar");
    let robot = Robot::new(place);
    let config = file("config/controllers/planar.ron");
    (robot, place.controller(&config, &model, &["--lockstep"]))
}

fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    let status = std::process::Command::new("kill").args([name, &id]).status().unwrap();
    assert!(status.success());
}

/// A signal ramps the velocity down to rest in bounded time, then a last command says stop.
fn stops_on(name: &str) {
    let place = Place::new(&format!("stop{name}"));
    let (mut robot, controller) = start(&place);
    robot.run_up();
    signal(&controller, name);
    let mut last_speed = f64::INFINITY;
    let mut braking = 0;
    let last = loop {
        let before = robot.speed();
        let command = robot.good();
        if command.reason == Reason::StopRequested.to_wire() {
            assert!(before <= last_speed + 1e-3, "the speed rose while stopping");
            last_speed = before;
            braking += 1;
        }
        if command.mode == CommandMode::Stop.to_wire() {
            assert!(before < 0.02, "still moving at {before} m/s at the last command");
            break command;
        }
        assert!(braking < 1100, "not at rest after the longest stopping time");
    };
    assert!(braking > 5, "a ramp, not a jump: {braking} ticks");
    assert_eq!(last.velocity, [0.0; 8]);
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
    drop(robot);
    assert_eq!(place.leftovers(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn an_interrupt_ramps_down_to_rest() {
    stops_on("-INT");
}

#[test]
fn a_termination_ramps_down_to_rest() {
    stops_on("-TERM");
}

#[test]
fn a_second_signal_leaves_at_once() {
    let place = Place::new("second-signal");
    let (mut robot, controller) = start(&place);
    robot.run_up();
    // No state follows, so the loop still waits for one when the second signal comes.
    signal(&controller, "-INT");
    std::thread::sleep(Duration::from_millis(20));
    signal(&controller, "-INT");
    let output = finish(controller);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
}

/// Each fault stops the point in bounded time with its reason; afterwards it goes on, from rest.
#[test]
fn faulty_input_brings_the_arm_to_rest_with_a_reason_and_it_resumes() {
    type StateFault = fn(&mut RobotState);
    type FramesFault = fn(&mut TaskFrames);
    let none_state: StateFault = |_| {};
    let none_frames: FramesFault = |_| {};
    let faults: [(StateFault, FramesFault, Reason); 12] = [
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
    ];
    let place = Place::new("faults");
    let (mut robot, controller) = start(&place);
    for (state_fault, frames_fault, reason) in faults {
        robot.run_up();
        let mut top_speed = robot.speed();
        let mut modes = Vec::new();
        for tick in 0..1000 {
            let command = robot.exchange(state_fault, frames_fault);
            // A position that jumps is first of all not believed.
            let jump = tick == 0 && reason == Reason::JointLimit;
            let expected = if jump { Reason::StateUnbelievable } else { reason };
            assert_eq!(Reason::from_wire(command.reason), Some(expected));
            modes.push(command.mode);
            top_speed = top_speed.max(robot.speed());
        }
        let told = |mode: CommandMode| modes.contains(&mode.to_wire());
        assert!(told(CommandMode::Hold) && !told(CommandMode::Track), "{reason:?}");
        assert!(robot.speed() < 0.01, "{reason:?}: {} m/s after a second", robot.speed());
        assert!(top_speed < 0.6, "{reason:?}: it ran away at {top_speed} m/s");
        if reason == Reason::JointLimit {
            robot.good();
        }
        let resumed = robot.good();
        assert_eq!(resumed.reason, Reason::None.to_wire());
        let acceleration = resumed.acceleration[0].hypot(resumed.acceleration[1]);
        assert!(acceleration < 1.0, "{reason:?}: resumed with a jump of {acceleration} m/s²");
        // Back to the start, so that every fault meets the same motion.
        robot.state.position = [0.0; 8];
        robot.state.velocity = [0.0; 8];
        robot.good();
    }
    signal(&controller, "-INT");
    while robot.good().mode != CommandMode::Stop.to_wire() {}
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
}

/// Moved while it could not be seen, and seen again while frames are missing: it stays there.
#[test]
fn an_arm_that_was_moved_out_of_sight_is_not_snapped_back() {
    let place = Place::new("moved");
    let (mut robot, controller) = start(&place);
    robot.run_up();
    for _ in 0..500 {
        robot.exchange(|s| s.position[0] = f64::NAN, |_| {});
    }
    robot.state.position[0] += 1.0;
    let there = robot.state.position[0];
    for _ in 0..500 {
        let command = robot.exchange(|_| {}, |f| f.frames[1].valid = 0);
        assert_eq!(Reason::from_wire(command.reason), Some(Reason::FrameMissing));
        assert!(command.torque[0].abs() < 1.0, "{} N", command.torque[0]);
    }
    assert!((robot.state.position[0] - there).abs() < 0.01);
    signal(&controller, "-INT");
    while robot.good().mode != CommandMode::Stop.to_wire() {}
    assert!(finish(controller).status.success());
}

#[test]
fn a_second_controller_of_an_instance_is_refused() {
    let place = Place::new("second-controller");
    let (mut robot, controller) = start(&place);
    robot.good();
    let model = place.path("planar.model.ron");
    let second =
        finish(place.controller(&file("config/controllers/planar.ron"), &model, &["--lockstep"]));
    assert_eq!(second.status.code(), Some(1));
    assert!(text(&second).contains("already has a publisher"), "{}", text(&second));
    signal(&controller, "-INT");
    while robot.good().mode != CommandMode::Stop.to_wire() {}
    assert!(finish(controller).status.success());
}
