//! A robot of a test's own: it feeds a controller over shared memory, obeys its commands, and looks
//! at them.

use std::process::{Child, Command};
use std::time::{Duration, Instant};

use tprmp_controller::timing::realtime::monotonic_ns;
use tprmp_messages::{
    CommandMode, Frame, Instance, JointCommand, Obstacle, ObstacleKind, Reason, RobotState,
    StatePublisherPorts, TaskFrames,
};

use crate::common::{Place, finish, text};

/// How long a test waits for what has to come.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time between two states \[ns\].
const STEP_NS: u64 = 1_000_000;

/// A point of 1 kg in the plane: it moves by the forces of the commands, or brakes.
pub(crate) struct Robot {
    ports: StatePublisherPorts,
    pub(crate) state: RobotState,
    pub(crate) frames: TaskFrames,
    command: JointCommand,
}

impl Robot {
    pub(crate) fn new(place: &Place) -> Self {
        let frame = |name, position| Frame::at(name, position).unwrap();
        let mut frames = TaskFrames { frame_count: 3, obstacle_count: 1, ..Default::default() };
        frames.frames[0] = frame("start", [0.0, 0.0, 0.0]);
        frames.frames[1] = frame("end", [2.0, 1.0, 0.0]);
        frames.frames[2] = frame("of-no-use", [0.0, 0.0, 1.0]);
        frames.obstacles[0] = Obstacle {
            kind: ObstacleKind::Sphere.to_wire(),
            valid: 1,
            position: [0.0, -50.0, 0.0],
            quaternion: [1.0, 0.0, 0.0, 0.0],
            size: [0.1, 0.0, 0.0],
            ..Default::default()
        };
        let ports = Instance::new(&place.instance).unwrap().open_state_publisher().unwrap();
        let state = RobotState { time_ns: 1_000_000_000, joint_count: 2, ..Default::default() };
        Self { ports, state, frames, command: JointCommand::default() }
    }

    /// In lockstep: publishes what the edits leave of frames and state, and waits for the answer.
    pub(crate) fn exchange(
        &mut self,
        edit_state: impl Fn(&mut RobotState),
        edit_frames: impl Fn(&mut TaskFrames),
    ) -> JointCommand {
        let time_ns = self.state.time_ns + STEP_NS;
        let sequence = self.publish(time_ns, edit_state, edit_frames);
        let start = Instant::now();
        loop {
            assert!(
                self.ports.state.update_connections() && self.ports.frames.update_connections()
            );
            match self.ports.command.receive() {
                Some(command) if command.state_sequence == sequence => {
                    self.command = *command;
                    assert_finite(&self.command);
                    self.obey(true);
                    return self.command;
                }
                _ => std::thread::sleep(Duration::from_micros(50)),
            }
            assert!(start.elapsed() < PATIENCE, "no answer from the controller");
        }
    }

    fn publish(
        &mut self,
        time_ns: u64,
        edit_state: impl Fn(&mut RobotState),
        edit_frames: impl Fn(&mut TaskFrames),
    ) -> u64 {
        self.state.sequence += 1;
        self.frames.sequence += 1;
        (self.state.time_ns, self.frames.time_ns) = (time_ns, time_ns);
        let (mut state, mut frames) = (self.state, self.frames);
        edit_state(&mut state);
        edit_frames(&mut frames);
        assert!(self.ports.frames.publish(frames) && self.ports.state.publish(state));
        state.sequence
    }

    /// Moves the point for one step.
    fn obey(&mut self, fresh: bool) {
        let brake = self.command.mode == CommandMode::Stop.to_wire() || !fresh;
        for i in 0..2 {
            let force = self.command.torque[i] + self.command.gravity_torque[i];
            let v = &mut self.state.velocity[i];
            *v = if brake { 0.0 } else { *v + force * 0.001 };
            self.state.position[i] += *v * 0.001;
        }
    }

    /// In lockstep: one step without a fault.
    pub(crate) fn good(&mut self) -> JointCommand {
        self.exchange(|_| {}, |_| {})
    }

    /// In lockstep: steps without a fault until the policy is followed.
    pub(crate) fn resume(&mut self) -> JointCommand {
        for _ in 0..1000 {
            let command = self.good();
            if command.mode == CommandMode::Track.to_wire() {
                return command;
            }
        }
        panic!("it does not go on: {:?}", self.command);
    }

    /// In lockstep: runs until the point moves.
    pub(crate) fn run_up(&mut self) {
        let under_way = (0..5000).any(|_| {
            self.good();
            self.speed() > 0.3
        });
        assert!(under_way, "the point did not start");
    }

    /// Against the clock: publishes a state, waits a step's time and obeys the newest command, which
    /// is returned when it is new.
    pub(crate) fn live(&mut self) -> Option<JointCommand> {
        let now_ns = monotonic_ns();
        self.publish(now_ns, |_| {}, |_| {});
        assert!(self.ports.state.update_connections() && self.ports.frames.update_connections());
        self.listen()
    }

    /// Against the clock, without publishing anything: as [`Self::live`] otherwise.
    pub(crate) fn listen(&mut self) -> Option<JointCommand> {
        std::thread::sleep(Duration::from_nanos(STEP_NS));
        let new = self.ports.command.receive().map(|command| *command);
        if let Some(command) = new {
            assert_finite(&command);
            self.command = command;
        }
        self.obey(monotonic_ns() < self.command.expiry_ns);
        new
    }

    /// Against the clock: `step`s until `wanted` says that a command is the one waited for.
    pub(crate) fn until(
        &mut self,
        what: &str,
        step: impl Fn(&mut Self) -> Option<JointCommand>,
        mut wanted: impl FnMut(&Self, &JointCommand) -> bool,
    ) -> JointCommand {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            if let Some(command) = step(self)
                && wanted(self, &command)
            {
                return command;
            }
        }
        panic!("{what}: it did not come to this");
    }

    /// Against the clock: runs until the point moves.
    pub(crate) fn run_up_live(&mut self) {
        self.until("run up", Self::live, |robot, command| {
            command.reason == Reason::None.to_wire() && robot.speed() > 0.3
        });
    }

    /// True speed of the point [m/s].
    pub(crate) fn speed(&self) -> f64 {
        self.state.velocity[0].hypot(self.state.velocity[1])
    }

    /// Puts the point to rest at the start, so that every fault meets the same motion.
    pub(crate) fn put_back(&mut self) {
        self.state.position = [0.0; 8];
        self.state.velocity = [0.0; 8];
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

/// Starts a controller of the plane beside a robot of this test. No reason latches.
pub(crate) fn start(place: &Place, options: &[&str]) -> (Robot, Child) {
    let model = place.train("planar");
    let robot = Robot::new(place);
    (robot, place.controller(&place.passing("config/controllers/planar.ron"), &model, options))
}

pub(crate) fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    let status = Command::new("kill").args([name, &id]).status().unwrap();
    assert!(status.success());
}

/// Asks a lockstep controller to stop and serves it until it has.
pub(crate) fn stop(mut robot: Robot, controller: Child) {
    signal(&controller, "-INT");
    while robot.good().mode != CommandMode::Stop.to_wire() {}
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
}

/// Asks a controller on the machine's clock to stop and serves it until it has.
pub(crate) fn stop_live(mut robot: Robot, mut controller: Child) {
    signal(&controller, "-INT");
    while controller.try_wait().unwrap().is_none() {
        robot.live();
    }
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
}
