//! How the controller ends and what it does when its inputs fail, seen from outside: a publisher
//! of this test's own feeds it over shared memory and looks at the commands.

use std::process::Child;
use std::time::{Duration, Instant};

use crate::common::{Place, file, finish, text};
use tprmp_messages::{
    CommandMode, Frame, Instance, JointCommand, Reason, RobotState, StatePublisherPorts,
    TaskFrames, name_bytes,
};

/// A point in the plane that does what it is told: integrates the commanded acceleration.
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
                    self.state.position = command.position;
                    self.state.velocity = command.velocity;
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
        let speed = |c: &JointCommand| c.velocity[0].hypot(c.velocity[1]);
        let under_way = (0..5000).any(|_| speed(&self.good()) > 0.3);
        assert!(under_way, "the point did not start");
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
        let command = robot.good();
        let speed = command.velocity[0].hypot(command.velocity[1]);
        if command.reason == Reason::StopRequested.to_wire() {
            assert!(speed <= last_speed + 1e-9, "the speed rose while stopping");
            last_speed = speed;
            braking += 1;
        }
        if command.mode == CommandMode::Stop.to_wire() {
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
    let faults: [(StateFault, FramesFault, Reason); 8] = [
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
        let mut at_rest = false;
        for _ in 0..1000 {
            let command = robot.exchange(state_fault, frames_fault);
            assert_eq!(Reason::from_wire(command.reason), Some(reason));
            assert_eq!(command.mode, CommandMode::Hold.to_wire());
            at_rest = command.velocity[0].hypot(command.velocity[1]) < 1e-9;
            if at_rest {
                break;
            }
        }
        assert!(at_rest, "{reason:?}: not at rest within a second");
        let resumed = robot.good();
        assert_eq!(resumed.reason, Reason::None.to_wire());
        let acceleration = resumed.acceleration[0].hypot(resumed.acceleration[1]);
        assert!(acceleration < 1.0, "{reason:?}: resumed with a jump of {acceleration} m/s²");
        // Back to the start, so that every fault meets the same motion.
        robot.state.position = [0.0; 8];
        robot.state.velocity = [0.0; 8];
    }
    signal(&controller, "-INT");
    while robot.good().mode != CommandMode::Stop.to_wire() {}
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
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
