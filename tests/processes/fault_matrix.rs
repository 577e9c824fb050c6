//! Each fault in each phase of a pick: what the arm does, how long it takes to rest, what is said, and how it
//! goes on. The tables of `controller/LIFECYCLE.md` are written from here: `TPRMP_WRITE_TABLES=1` writes them
//! anew, and a table that differs fails the test.

use std::fmt::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nalgebra::SVector;
use tprmp_controller::commands::monitor::describe;
use tprmp_controller::control::server::Shared;
use tprmp_controller::control::supervisor::{Kind, can_latch, kind};
use tprmp_controller::detail::explain;
use tprmp_controller::startup;
use tprmp_controller::timing::pacing::Pacing;
use tprmp_messages::{
    CommandMode, ControllerStatus, Frame, FrameSourcePort, GripperCommand, GripperState, Instance,
    JointCommand, LifeCycle, Obstacle, ObstacleKind, Reason, RobotMode, RobotState,
    StatePublisherPorts, TaskFrames, joint_names_hash,
};
use tprmp_model::controller_config::{self, ControllerConfig, StartFrame};
use tprmp_robot::{Chain, Kinematics, forward_kinematics};

use crate::common::{Place, file};

const PATIENCE: Duration = Duration::from_secs(60);
/// Time between two states \[ns\].
const STEP_NS: u64 = 2_000_000;
/// A fault lasts so many states: a second.
const FAULTY: usize = 500;
const HOME: [f64; 6] = [-2.74, -1.57, 1.57, -1.57, -1.57, 0.4];

/// Where a pick stands when the fault comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Waiting,
    Running,
    NearGoal,
    Lifting,
    Holding,
}

const PHASES: [Phase; 5] =
    [Phase::Waiting, Phase::Running, Phase::NearGoal, Phase::Lifting, Phase::Holding];

/// Frames that name a source are published by another one, beside the good ones.
type Apply = fn(&mut RobotState, &mut TaskFrames);

struct Fault {
    name: &'static str,
    apply: Apply,
    /// What is said while it lasts, at the end of it.
    reason: Reason,
}

const fn fault(name: &'static str, reason: Reason, apply: Apply) -> Fault {
    Fault { name, apply, reason }
}

/// The frame of the goal.
const GOAL: usize = 1;

const FAULTS: &[Fault] = &[
    fault("a position that jumps by 2 rad, to and fro", Reason::StateUnbelievable, |s, _| {
        s.position[0] += if s.sequence.is_multiple_of(2) { 2.0 } else { -2.0 };
    }),
    fault(
        "a velocity of ±5 rad/s beside what the position does",
        Reason::StateUnbelievable,
        |s, _| {
            s.velocity[2] = if s.sequence.is_multiple_of(2) { 5.0 } else { -5.0 };
        },
    ),
    fault("a position of 10⁶ rad", Reason::StateUnbelievable, |s, _| s.position[1] = 1e6),
    fault("a position that is no number", Reason::StateNotFinite, |s, _| s.position[3] = f64::NAN),
    fault("a torque that is infinite", Reason::StateNotFinite, |s, _| s.torque[0] = f64::INFINITY),
    fault("five joints in place of six", Reason::JointCount, |s, _| s.joint_count = 5),
    fault("a sequence number that stands still", Reason::SequenceStuck, |s, _| s.sequence = STUCK),
    fault("two sources that count differently", Reason::TwoSources, |s, _| {
        s.sequence += if s.sequence.is_multiple_of(2) { 2 * STUCK } else { STUCK };
    }),
    fault("200 states missing between each two", Reason::StatesLost, |s, _| s.sequence *= 200),
    fault("a time stamp that stands still", Reason::StateTimeStuck, |s, _| s.time_ns = STUCK_NS),
    fault("a protective stop of the robot", Reason::ProtectiveStop, |s, _| {
        s.robot_mode = RobotMode::ProtectiveStop.to_wire();
    }),
    fault("an emergency stop of the robot", Reason::EmergencyStop, |s, _| {
        s.robot_mode = RobotMode::EmergencyStop.to_wire();
    }),
    fault("hand guiding", Reason::HandGuiding, |s, _| {
        s.robot_mode = RobotMode::HandGuiding.to_wire();
    }),
    fault("a fault of the robot", Reason::RobotFault, |s, _| {
        s.robot_mode = RobotMode::Fault.to_wire();
    }),
    fault("the safety flag", Reason::SafetyStop, |s, _| s.safety_stop = 1),
    fault("joints in another order, by their names", Reason::JointOrder, |s, _| {
        s.joint_names_hash = joint_names_hash(&["wrist_3_joint", "shoulder_pan_joint"]);
    }),
    fault("no gripper", Reason::GripperNone, |s, _| s.gripper_state = 0),
    fault("a gripper state of 9", Reason::GripperUnknown, |s, _| s.gripper_state = 9),
    fault("the goal's frame marked invalid", Reason::FrameMissing, |_, f| f.frames[GOAL].valid = 0),
    fault("the goal's frame of another name", Reason::FrameMissing, |_, f| {
        f.frames[GOAL].name[0] = b'X';
    }),
    fault("a frame's position that is no number", Reason::FrameNotFinite, |_, f| {
        f.frames[GOAL].position[2] = f64::NAN;
    }),
    fault("a quaternion of length 1.5", Reason::QuaternionNotUnit, |_, f| {
        f.frames[GOAL].quaternion = [1.5, 0.0, 0.0, 0.0];
    }),
    fault("an obstacle of kind 99", Reason::ObstacleUnknown, |_, f| {
        f.obstacle_count = 1;
        f.obstacles[0].valid = 1;
        f.obstacles[0].kind = 99;
    }),
    fault("33 obstacles", Reason::ObstacleCount, |_, f| f.obstacle_count = 33),
    fault("nine frames", Reason::FrameCount, |_, f| f.frame_count = 9),
    fault("a frame in millimetres", Reason::FrameFar, |_, f| {
        f.frames[GOAL].position = [500.0, -200.0, 29.4];
    }),
    fault("a ball of radius 0", Reason::ObstacleSize, |_, f| {
        f.obstacle_count = 1;
        f.obstacles[0].valid = 1;
    }),
    fault("a box with a quaternion of length 1.5", Reason::ObstacleQuaternion, |_, f| {
        f.obstacle_count = 1;
        f.obstacles[0] = Obstacle {
            kind: ObstacleKind::Box.to_wire(),
            valid: 1,
            quaternion: [1.5, 0.0, 0.0, 0.0],
            size: [0.1; 3],
            ..Default::default()
        };
    }),
    fault("the goal's frame by a second source", Reason::FrameTwice, |_, f| f.source[0] = b'2'),
    fault("frames that are half a second old", Reason::FramesStale, |_, f| {
        f.time_ns -= 500_000_000;
    }),
];

/// Far above what is counted to, so that these are first new and then stand still.
const STUCK: u64 = 1_000_000;
const STUCK_NS: u64 = 1_000_000_000_000;

/// An arm that does exactly what it is commanded, in lockstep beside a controller in a thread.
struct Arm {
    ports: StatePublisherPorts,
    second: FrameSourcePort,
    state: RobotState,
    frames: TaskFrames,
    command: JointCommand,
    status: ControllerStatus,
    shared: Shared,
    controller: JoinHandle<()>,
    time_ns: u64,
    gripped: u32,
}

impl Arm {
    fn start(place: &Place, model: &str, name: &str) -> Self {
        Self::start_with(place, model, name, StartFrame::Published)
    }

    fn start_with(place: &Place, model: &str, name: &str, start_frame: StartFrame) -> Self {
        let instance = Instance::new(&format!("{}-{name}", place.instance)).unwrap();
        let config_path = file("config/controllers/ur5_pick.ron");
        let config = controller_config::read(config_path.as_ref()).unwrap();
        let chain: Chain<6> = startup::robot(config_path.as_ref(), &config).unwrap().0;
        let mut kinematics = Kinematics::new();
        forward_kinematics(&chain, &SVector::from(HOME), &mut kinematics);
        let tool = kinematics.tool_pose();
        let mut frames = TaskFrames { frame_count: 2, ..Default::default() };
        frames.frames[0] = Frame::at("ee_start", tool.position.to_array()).unwrap();
        let o = tool.orientation;
        frames.frames[0].quaternion = [o.w, o.x, o.y, o.z];
        frames.frames[GOAL] = Frame::at("object", [0.5, -0.2, 0.0294]).unwrap();
        let mut state = RobotState {
            joint_count: 6,
            gripper_state: GripperState::Open.to_wire(),
            ..Default::default()
        };
        state.position[..6].copy_from_slice(&HOME);
        let ports = instance.open_state_publisher().unwrap();
        let second = instance.open_frame_source().unwrap();
        let shared = Shared::new(Arc::new(AtomicBool::new(false)));
        let (of_loop, model) = (shared.clone(), model.to_owned());
        let controller = std::thread::spawn(move || {
            let path = config_path.as_ref();
            let edit = |config: &mut ControllerConfig| config.start_frame = start_frame;
            let loaded = startup::load_with(path, edit, &[model], false).unwrap();
            let stop = Arc::clone(&of_loop.stop);
            let cycle =
                startup::cycle::<6>(path, &loaded, Pacing::Lockstep, false, &instance, of_loop);
            cycle.unwrap().run(&stop);
        });
        let (command, status) = Default::default();
        let time_ns = 1_000_000_000;
        Self {
            ports,
            second,
            state,
            frames,
            command,
            status,
            shared,
            controller,
            time_ns,
            gripped: 0,
        }
    }

    /// One step: moves as commanded, publishes, and waits for the answer.
    fn step(&mut self, spoil: Option<Apply>) {
        let obeyed = self.command.mode != CommandMode::Stop.to_wire() && self.command.sequence > 0;
        if obeyed {
            (self.state.position, self.state.velocity) =
                (self.command.position, self.command.velocity);
        } else {
            self.state.velocity = [0.0; 8];
        }
        let grips = self.command.gripper_command == GripperCommand::Grip.to_wire();
        self.gripped = if grips { self.gripped + 1 } else { 0 };
        let sensed = if self.gripped > 10 { GripperState::Holding } else { GripperState::Open };
        self.state.gripper_state = sensed.to_wire();
        self.state.sequence += 1;
        self.frames.sequence += 1;
        self.time_ns += STEP_NS;
        (self.state.time_ns, self.frames.time_ns) = (self.time_ns, self.time_ns);
        let (mut state, mut frames) = (self.state, self.frames);
        if let Some(spoil) = spoil {
            spoil(&mut state, &mut frames);
        }
        if frames.source != self.frames.source {
            assert!(self.second.frames.publish(frames));
            frames = self.frames;
        }
        let last = self.command.sequence;
        assert!(self.ports.frames.publish(frames) && self.ports.state.publish(state));
        let start = Instant::now();
        while self.command.sequence == last {
            assert!(self.ports.state.update_connections());
            assert!(self.ports.frames.update_connections());
            if let Some(command) = self.ports.command.receive() {
                self.command = *command;
            }
            assert!(start.elapsed() < PATIENCE, "no answer from the controller");
            std::thread::yield_now();
        }
        while let Some(status) = self.ports.status.receive() {
            self.status = *status;
        }
    }

    fn mode(&self) -> CommandMode {
        CommandMode::from_wire(self.command.mode).unwrap()
    }

    fn reason(&self) -> Reason {
        Reason::from_wire(self.command.reason).unwrap()
    }

    fn speed(&self) -> f64 {
        self.command.velocity.iter().fold(0.0, |most, v| v.abs().max(most))
    }

    fn life_cycle(&self) -> LifeCycle {
        LifeCycle::from_wire(self.status.life_cycle).unwrap()
    }

    fn until(&mut self, what: &str, mut reached: impl FnMut(&Self) -> bool) {
        for _ in 0..10_000 {
            self.step(None);
            if reached(self) {
                return;
            }
        }
        panic!("{what}: {:?}, {:?}, {:?}", self.life_cycle(), self.reason(), self.status);
    }

    fn reach(&mut self, phase: Phase) {
        match phase {
            Phase::Waiting => {}
            Phase::Running => self.until("running", |arm| arm.speed() > 0.4),
            Phase::NearGoal => self.until("near the goal", |arm| arm.status.goal_distance_m < 0.02),
            Phase::Lifting => self.until("lifting", |arm| {
                arm.life_cycle() == LifeCycle::Lifting && arm.speed() > 0.1
            }),
            Phase::Holding => {
                self.until("running", |arm| arm.speed() > 0.4);
                self.shared.requests.hold();
                self.until("holding", |arm| arm.speed() == 0.0);
            }
        }
    }

    fn stop(mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        while !self.controller.is_finished() {
            self.state.sequence += 1;
            self.state.time_ns += STEP_NS;
            assert!(self.ports.state.publish(self.state));
            std::thread::sleep(Duration::from_millis(1));
        }
        self.controller.join().unwrap();
    }
}

/// What came of a fault in a phase.
struct Outcome {
    cell: String,
    latched: bool,
}

fn outcome(place: &Place, model: &str, number: usize, fault: &Fault, phase: Phase) -> Outcome {
    let context = format!("{}, {phase:?}", fault.name);
    let mut arm = Arm::start(place, model, &format!("{number}-{}", phase as usize));
    arm.reach(phase);
    let mut to_rest_s = None;
    let mut modes: Vec<CommandMode> = Vec::new();
    let mut before = arm.command;
    for tick in 0..FAULTY {
        arm.step(Some(fault.apply));
        if !modes.contains(&arm.mode()) {
            modes.push(arm.mode());
        }
        // Told to stop, the robot brakes by itself.
        if arm.speed() == 0.0 || arm.mode() == CommandMode::Stop {
            to_rest_s.get_or_insert(tick as f64 * STEP_NS as f64 * 1e-9);
        }
        // The deceleration that is permitted, and no jump of the position.
        let elapsed_s = arm.command.time_ns.saturating_sub(before.time_ns) as f64 * 1e-9;
        let elapsed_s = elapsed_s.clamp(1e-6, 0.02);
        for i in (0..6).filter(|_| before.position != [0.0; 8]) {
            let step = (arm.command.velocity[i] - before.velocity[i]).abs();
            assert!(step <= 25.0 * elapsed_s + 1e-9, "{context}: {step}");
            let step = (arm.command.position[i] - before.position[i]).abs();
            assert!(step <= 0.9 * 3.15 * elapsed_s + 1e-9, "{context}: {step}");
        }
        before = arm.command;
    }
    assert!(!modes.contains(&CommandMode::Track), "{context}: it followed its policy");
    // A first state contradicts none: it is not confirmed, or outside the joint's range.
    let first = phase == Phase::Waiting
        && matches!(arm.reason(), Reason::StateUnconfirmed | Reason::JointLimit);
    assert!(arm.reason() == fault.reason || first, "{context}: {:?}", arm.reason());
    let to_rest_s = to_rest_s.unwrap_or_else(|| panic!("{context}: it did not come to rest"));
    let latched = arm.life_cycle() == LifeCycle::Fault;
    // Without the fault: after what latches nothing moves before somebody says so.
    for _ in 0..300 {
        arm.step(None);
        assert!(!latched || arm.speed() == 0.0, "{context}: it moved before somebody looked");
    }
    if latched {
        assert_eq!(arm.life_cycle(), LifeCycle::Fault, "{context}");
        arm.shared.requests.reset();
    }
    if phase == Phase::Holding {
        arm.until("held again", |arm| arm.reason() == Reason::HoldRequested);
        arm.shared.requests.start();
    }
    arm.until(&context, |arm| arm.mode() == CommandMode::Track);
    arm.stop();
    let names: Vec<_> = modes.iter().map(|mode| format!("{mode:?}")).collect();
    let moving = matches!(phase, Phase::Running | Phase::NearGoal | Phase::Lifting);
    let cell = if moving && modes[0] == CommandMode::Stop {
        "Stop: the robot brakes".to_owned()
    } else if moving {
        format!("{}, {to_rest_s:.2} s", names.join(" → "))
    } else {
        names.join(" → ")
    };
    Outcome { cell, latched }
}

fn matrix(place: &Place) -> String {
    let model = place.train("pick");
    let next = std::sync::atomic::AtomicUsize::new(0);
    let rows = std::sync::Mutex::new(vec![String::new(); FAULTS.len()]);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(fault) = FAULTS.get(number) else { return };
                    let outcomes = PHASES.map(|phase| outcome(place, &model, number, fault, phase));
                    let after = if outcomes.iter().any(|outcome| outcome.latched) {
                        "`ctl reset`"
                    } else {
                        "by itself"
                    };
                    let cells = outcomes.map(|outcome| outcome.cell).join(" | ");
                    let row =
                        format!("| {} | {:?} | {cells} | {after} |", fault.name, fault.reason);
                    rows.lock().unwrap()[number] = row;
                }
            });
        }
    });
    let mut table = String::from(
        "| fault, for a second | reason | waiting | running | near the goal | lifting | holding | goes on |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for row in rows.into_inner().unwrap() {
        writeln!(table, "{row}").unwrap();
    }
    table
}

/// Every reason: what it is about, whether a person has to look, and what is said.
fn reasons() -> String {
    let config = controller_config::read(file("config/controllers/ur5_pick.ron").as_ref()).unwrap();
    let mut table =
        String::from("| reason | about | as shipped | what is said |\n|---|---|---|---|\n");
    for reason in Reason::ALL.iter().filter(|reason| **reason != Reason::None) {
        let latches = config.supervision.latching.contains(&format!("{reason:?}"));
        assert!(!latches || can_latch(*reason));
        let about = match kind(*reason) {
            Kind::Following => "progress",
            Kind::State => "state",
            Kind::Frames => "frames",
            Kind::Controller => "controller",
            Kind::Request => "request",
        };
        let shipped = match kind(*reason) {
            Kind::Following => "follows the policy",
            Kind::Request => "until asked",
            _ if latches => "latches",
            _ => "passes",
        };
        let said = describe(LifeCycle::Holding, *reason);
        let said = said.split_once(": ").unwrap().1;
        writeln!(table, "| {reason:?} | {about} | {shipped} | {said} |").unwrap();
    }
    table
}

/// Compares a table with that between the marks of its name, or writes it there.
fn in_document(name: &str, table: &str) {
    let path = file("controller/LIFECYCLE.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let (begin, end) = (format!("<!-- {name} -->\n"), format!("<!-- end of {name} -->"));
    let (before, rest) = text.split_once(&begin).expect("the document has the table's mark");
    let (written, after) = rest.split_once(&end).expect("the document has the table's end");
    if std::env::var("TPRMP_WRITE_TABLES").is_ok_and(|value| value == "1") {
        std::fs::write(&path, format!("{before}{begin}{table}{end}{after}")).unwrap();
        return;
    }
    assert_eq!(written, table, "{path}: `TPRMP_WRITE_TABLES=1` writes the table anew");
}

#[test]
fn every_fault_in_every_phase_ends_at_rest_with_its_reason_as_documented() {
    in_document("reasons", &reasons());
    in_document("faults", &matrix(&Place::new("matrix")));
}

#[test]
fn a_start_frame_in_another_order_is_found_before_any_motion() {
    let place = Place::new("order");
    let model = place.train("pick");
    let mut arm = Arm::start(&place, &model, "quaternion");
    for state in 0..100 {
        arm.step(Some(|_, frames| frames.frames[0].quaternion.rotate_left(1)));
        let (mode, reason, speed) = (arm.mode(), arm.reason(), arm.speed());
        let rests = mode != CommandMode::Track && speed == 0.0;
        assert!(rests, "state {state}: {mode:?}, {reason:?}, {speed} rad/s");
    }
    assert_eq!(arm.reason(), Reason::QuaternionOrder);
    arm.until("goes on", |arm| arm.mode() == CommandMode::Track);
    arm.stop();
}

/// The commands of two seconds of a motion, and a hold in it, with start frames published or not.
fn commands(arm: &mut Arm, spoil: Option<Apply>) -> Vec<[f64; 8]> {
    let command = |step| {
        match step {
            1000 => arm.shared.requests.hold(),
            1200 => arm.shared.requests.start(),
            _ => {}
        }
        arm.step(spoil);
        arm.command.position
    };
    (0..1700).map(command).collect()
}

#[test]
fn a_start_frame_at_the_tool_gives_the_commands_of_one_that_is_published_there() {
    let place = Place::new("tool");
    let model = place.train("pick");
    let mut published = Arm::start(&place, &model, "published");
    let expected = commands(&mut published, None);
    published.stop();
    let mut arm = Arm::start_with(&place, &model, "own", StartFrame::Tool);
    let goal_alone: Apply = |_, f| (f.frame_count, f.frames[0]) = (1, f.frames[GOAL]);
    let found = commands(&mut arm, Some(goal_alone));
    arm.stop();
    let moved = (0..6).map(|i| (expected[1699][i] - HOME[i]).abs()).fold(0.0, f64::max);
    assert!(moved > 0.3, "{moved}");
    for (k, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let apart = (0..6).map(|i| (found[i] - expected[i]).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-9, "state {k}: {apart}");
    }
}

#[test]
fn a_start_frame_that_is_published_all_the_same_is_compared_with_the_tool() {
    type Case = (&'static str, Apply, Reason, &'static [&'static str]);
    let place = Place::new("compared");
    let model = place.train("pick");
    let cases: [Case; 3] = [
        (
            "order",
            |_, f| f.frames[0].quaternion.rotate_left(1),
            Reason::QuaternionOrder,
            &["`ee_start`", "x y z w"],
        ),
        (
            "millimetres",
            |_, f| f.frames[0].position = f.frames[0].position.map(|x| x * 1e3),
            Reason::FrameFar,
            &["`ee_start`", "publish metres"],
        ),
        (
            "far",
            |_, f| f.frames[0].position[1] += 0.1,
            Reason::StartElsewhere,
            &["`ee_start` is 0.100 m and 0°", "start_frame: Tool"],
        ),
    ];
    for (name, spoil, reason, parts) in cases {
        let mut arm = Arm::start_with(&place, &model, name, StartFrame::Tool);
        for _ in 0..100 {
            arm.step(Some(spoil));
            assert!(arm.mode() != CommandMode::Track && arm.speed() == 0.0, "{name}");
        }
        assert_eq!(arm.reason(), reason, "{name}");
        let said = explain(&arm.shared.detail.read(reason).unwrap()).unwrap();
        assert!(parts.iter().all(|part| said.contains(part)), "{name}: {said}");
        arm.until("goes on", |arm| arm.mode() == CommandMode::Track);
        arm.stop();
    }
}

/// The elbow begins so far beyond its limit of π \[rad\].
fn elbow_beyond(place: &Place, name: &str, beyond: f64) -> Arm {
    let mut arm = Arm::start(place, &place.train("pick"), name);
    arm.state.position[2] = core::f64::consts::PI + beyond;
    arm
}

#[test]
fn a_joint_a_little_outside_its_limits_is_moved_back_slowly_and_goes_on() {
    let place = Place::new("returns");
    let mut arm = elbow_beyond(&place, "little", 0.03);
    let mut returned = 0;
    arm.until("goes on", |arm| {
        if arm.reason() == Reason::JointReturning {
            returned += 1;
            let step_s = STEP_NS as f64 * 1e-9;
            let moved =
                (0..6).map(|i| (arm.command.position[i] - arm.state.position[i]).abs() / step_s);
            assert!(moved.fold(0.0, f64::max) < 0.1);
            assert_eq!(arm.mode(), CommandMode::Hold);
        }
        arm.mode() == CommandMode::Track
    });
    assert!(returned > 50 && arm.state.position[2] < core::f64::consts::PI, "{returned}");
    arm.stop();
}

#[test]
fn a_joint_far_outside_its_limits_stays_where_it_is() {
    let place = Place::new("outside");
    let mut arm = elbow_beyond(&place, "far", 0.2);
    for _ in 0..200 {
        arm.step(None);
        assert_eq!((arm.mode(), arm.speed()), (CommandMode::Stop, 0.0));
    }
    assert_eq!(arm.reason(), Reason::JointLimit);
    arm.stop();
}

#[test]
fn at_the_goal_it_says_that_it_waits_for_the_gripper() {
    let place = Place::new("awaited");
    let model = place.train("pick");
    let mut arm = Arm::start(&place, &model, "gripper");
    let awaited = (0..10_000).any(|_| {
        arm.step(Some(|state, _| state.gripper_state = GripperState::Open.to_wire()));
        assert_ne!(arm.reason(), Reason::Unreachable);
        arm.reason() == Reason::GripperAwaited
    });
    assert!(awaited, "{:?}", arm.status);
    arm.until("lifting", |arm| arm.life_cycle() == LifeCycle::Lifting);
    arm.stop();
}
