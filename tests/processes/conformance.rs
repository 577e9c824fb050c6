//! `controller conformance`: the shipped publishers pass, and each of those that are wrong in one thing fails at
//! its own line.

use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use tprmp_controller::conformance::table::Check;
use tprmp_controller::timing::realtime::monotonic_ns;
use tprmp_messages::{
    Bounds, CommandGuard, CommandMode, Frame, Instance, JointBounds, JointCommand, RobotState,
    StatePublisherPorts, TaskFrames, joint_names_hash,
};

use crate::common::{Place, file, finish, program, root, run, text};
use crate::robot::{Robot, signal};

fn kit(instance: &str, config: &str, options: &[&str]) -> std::process::Output {
    run(program("controller")
        .args(["conformance", &file(config), "--instance", instance, "--seconds", "1"])
        .args(options))
}

fn passes(mut publisher: Command, place: &Place, config: &str) {
    publisher.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut publisher = publisher.spawn().expect("the publisher starts");
    let output = kit(&place.instance, config, &["--move", "--yes"]);
    if publisher.try_wait().unwrap().is_none() {
        signal(&publisher, "-INT");
    }
    let published = finish(publisher);
    assert!(output.status.success(), "{}\n{}", text(&output), text(&published));
    for check in [Check::States, Check::Joints, Check::Velocity, Check::Expiry, Check::Killed] {
        assert!(line(&output, check).starts_with("passed"), "{}", text(&output));
    }
}

fn line(output: &std::process::Output, check: Check) -> String {
    let text = text(output);
    let of = |line: &&str| line.contains(&format!("  {:<18} ", check.name()));
    text.lines().rfind(of).unwrap_or_default().trim().to_owned()
}

#[test]
fn the_shipped_publishers_pass() {
    let planar = "config/controllers/planar.ron";
    let ur5 = "config/controllers/ur5_pick.ron";
    let mujoco: &[&str] = &["--simulator", "mujoco"];
    for (name, scene, config, options) in [
        ("planar-sim", "config/scenes/planar.json", planar, &[][..]),
        ("sim-bridge", "config/scenes/pick.json", ur5, &[]),
        ("sim-bridge", "config/scenes/pick.json", ur5, mujoco),
    ] {
        let place = Place::new(&format!("conforms-{name}-{}", options.len()));
        let mut publisher = program(name);
        publisher.args(["run", "--scene", &file(scene), "--seed", "1", "--force"]).args([
            "--instance",
            &place.instance,
            "--out",
            &place.path(name),
        ]);
        publisher.args(options);
        passes(publisher, &place, config);
    }
    let place = Place::new("conforms-rust");
    let mut rust = program("examples/state_publisher");
    rust.arg(&place.instance);
    passes(rust, &place, planar);
    let place = Place::new("conforms-python");
    let mut python = program("python");
    python.arg(root().join("sim-bridge/examples/state_publisher.py")).arg(&place.instance);
    passes(python, &place, planar);
}

/// What is wrong with a publisher.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Wrong {
    Nothing,
    JointCount,
    OtherNames,
    NoNumber,
    Millimetres,
    Realtime,
    Slow,
    SequenceStands,
    StampTwice,
    VelocityAtRest,
    Mode,
    OldFrames,
    FramesInMillimetres,
    ManyObstacles,
    OtherOrder,
    OtherSign,
    NoVelocity,
    NoExpiry,
    NoStop,
    StopsInMotion,
    NoNumberInMotion,
}

const CASES: &[(Wrong, Check)] = &[
    (Wrong::JointCount, Check::JointCount),
    (Wrong::OtherNames, Check::JointNames),
    (Wrong::NoNumber, Check::Numbers),
    (Wrong::Millimetres, Check::Positions),
    (Wrong::Realtime, Check::Clock),
    (Wrong::Slow, Check::Rate),
    (Wrong::SequenceStands, Check::Sequence),
    (Wrong::StampTwice, Check::Stamps),
    (Wrong::VelocityAtRest, Check::Rest),
    (Wrong::Mode, Check::Modes),
    (Wrong::OldFrames, Check::FrameClock),
    (Wrong::FramesInMillimetres, Check::FramePoses),
    (Wrong::ManyObstacles, Check::Obstacles),
    (Wrong::OtherOrder, Check::Joints),
    (Wrong::OtherSign, Check::Joints),
    (Wrong::NoVelocity, Check::Velocity),
    (Wrong::NoExpiry, Check::Expiry),
    (Wrong::NoStop, Check::Stop),
    (Wrong::StopsInMotion, Check::Modes),
    (Wrong::NoNumberInMotion, Check::Numbers),
];

/// An ideal robot in the plane with a publisher that is wrong in one thing.
struct Publisher {
    wrong: Wrong,
    ports: StatePublisherPorts,
    guard: CommandGuard,
    state: RobotState,
    last: JointCommand,
}

impl Publisher {
    fn new(instance: &str, wrong: Wrong) -> Self {
        let ports = Instance::new(instance).unwrap().open_state_publisher().unwrap();
        let joints = Some(JointBounds::same(20.0, 60.0, 30.0));
        let guard = CommandGuard::new(2, Bounds { joints, ..Bounds::default() });
        let joint_names_hash = match wrong {
            Wrong::OtherNames => joint_names_hash(&["y_joint", "x_joint"]),
            _ => joint_names_hash(&["x_joint", "y_joint"]),
        };
        let mut state = RobotState { joint_count: 2, joint_names_hash, ..Default::default() };
        state.position[..2].copy_from_slice(&[0.1, 0.2]);
        Self { wrong, ports, guard, state, last: JointCommand::default() }
    }

    fn step(&mut self) {
        let mut new = self.ports.command.receive().map(|command| *command);
        if let Some(command) = &mut new {
            self.last = *command;
            let stops = command.mode == CommandMode::Stop.to_wire();
            if self.wrong == Wrong::NoStop && stops && command.velocity[0] != 0.0 {
                command.mode = CommandMode::Track.to_wire();
            }
        }
        let now_ns = monotonic_ns();
        if self.wrong == Wrong::NoExpiry && now_ns > self.last.expiry_ns {
            self.state.velocity = self.last.velocity;
            for i in 0..2 {
                self.state.position[i] += 1e-3 * self.last.velocity[i];
            }
        } else {
            let action = self.guard.judge(now_ns, new.as_ref(), &self.state);
            let setpoint = action.setpoint();
            (self.state.position, self.state.velocity) = (setpoint.position, setpoint.velocity);
        }
        self.state.sequence += 1;
        self.state.time_ns = now_ns;
        let (state, frames) = self.published(now_ns);
        assert!(self.ports.frames.publish(frames) && self.ports.state.publish(state));
        let pause_ms = if self.wrong == Wrong::Slow { 100 } else { 1 };
        std::thread::sleep(Duration::from_millis(pause_ms));
    }

    /// What is published, with what is wrong.
    fn published(&self, now_ns: u64) -> (RobotState, TaskFrames) {
        let mut state = self.state;
        let mut frames = TaskFrames {
            frame_count: 2,
            sequence: state.sequence,
            time_ns: now_ns,
            ..Default::default()
        };
        frames.frames[0] = Frame::at("start", [0.0; 3]).unwrap();
        frames.frames[1] = Frame::at("end", [2.0, 1.0, 0.0]).unwrap();
        let [x, y] = [0, 1].map(|i| [self.state.position[i], self.state.velocity[i]]);
        match self.wrong {
            Wrong::JointCount => state.joint_count = 3,
            Wrong::NoNumber => state.torque[1] = f64::NAN,
            Wrong::Millimetres => state.position = state.position.map(|value| 1e3 * value),
            Wrong::Realtime => state.time_ns += 1_700_000_000_000_000_000,
            Wrong::SequenceStands => state.sequence = 7,
            Wrong::StampTwice => state.time_ns -= state.time_ns % 3_000_000,
            Wrong::VelocityAtRest => state.velocity[1] = 0.5,
            Wrong::Mode => state.robot_mode = 9,
            Wrong::OldFrames => frames.time_ns = 0,
            Wrong::FramesInMillimetres => frames.frames[1].position = [2000.0, 1000.0, 0.0],
            Wrong::ManyObstacles => frames.obstacle_count = 33,
            Wrong::OtherOrder => {
                // From the same posture, so that it is not seen before a motion.
                state.position[..2].copy_from_slice(&[y[0] - 0.1, x[0] + 0.1]);
                state.velocity[..2].copy_from_slice(&[y[1], x[1]]);
            }
            Wrong::OtherSign => {
                (state.position[1], state.velocity[1]) = (0.4 - y[0], -y[1]);
            }
            Wrong::NoVelocity => state.velocity = [0.0; 8],
            Wrong::StopsInMotion if (x[0] - 0.1).abs() > 0.003 => state.safety_stop = 1,
            Wrong::NoNumberInMotion if (x[0] - 0.1).abs() > 0.003 => state.torque[1] = f64::NAN,
            _ => {}
        }
        (state, frames)
    }
}

fn look(wrong: Wrong) -> std::process::Output {
    let place = Place::new(&format!("wrong-{wrong:?}"));
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let ports = std::thread::Builder::new();
        ports
            .spawn_scoped(scope, || {
                let mut publisher = Publisher::new(&place.instance, wrong);
                while !done.load(Ordering::Relaxed) {
                    publisher.step();
                }
            })
            .unwrap();
        let output = kit(&place.instance, "config/controllers/planar.ron", &["--move", "--yes"]);
        done.store(true, Ordering::Relaxed);
        output
    })
}

#[test]
fn each_wrong_publisher_fails_at_its_own_line_and_a_right_one_passes() {
    let right = look(Wrong::Nothing);
    assert!(right.status.success(), "{}", text(&right));
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                while let Some((wrong, check)) = CASES.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let output = look(*wrong);
                    assert_eq!(output.status.code(), Some(1), "{wrong:?}: {}", text(&output));
                    let failed = text(&output).matches("FAILED").count();
                    let own = line(&output, *check);
                    let its_own = own.starts_with("FAILED") && own.contains("; remedy: ");
                    assert!(its_own && failed == 1, "{wrong:?}: {}", text(&output));
                    let order = own.contains("joints in another order");
                    assert_eq!(order, *wrong == Wrong::OtherOrder, "{wrong:?}: {own}");
                }
            });
        }
    });
}

#[test]
fn without_a_publisher_or_a_confirmation_nothing_is_moved() {
    let place = Place::new("conformance-nobody");
    let nobody = kit(&place.instance, "config/controllers/planar.ron", &[]);
    assert_eq!(nobody.status.code(), Some(1));
    assert!(line(&nobody, Check::States).starts_with("FAILED"), "{}", text(&nobody));
    let place = Place::new("conformance-unconfirmed");
    let mut publisher = program("examples/state_publisher");
    publisher.arg(&place.instance).stdout(Stdio::null()).stderr(Stdio::null());
    let publisher = publisher.spawn().unwrap();
    let unconfirmed = kit(&place.instance, "config/controllers/planar.ron", &["--move"]);
    signal(&publisher, "-INT");
    finish(publisher);
    assert!(unconfirmed.status.success(), "{}", text(&unconfirmed));
    assert!(line(&unconfirmed, Check::Joints).starts_with("not tried"), "{}", text(&unconfirmed));
}

/// Ctrl-C in the middle of a motion: the robot is told to stop, whatever it does by itself.
#[test]
fn a_signal_in_a_motion_ends_it_with_stop() {
    let place = Place::new("conformance-interrupted");
    let mut publisher = Publisher::new(&place.instance, Wrong::NoExpiry);
    let mut kit = program("controller");
    kit.args(["conformance", &file("config/controllers/planar.ron"), "--move", "--yes"])
        .args(["--instance", &place.instance, "--seconds", "1"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut kit = kit.spawn().unwrap();
    while publisher.state.velocity[0].abs() < 0.005 {
        publisher.step();
    }
    signal(&kit, "-INT");
    while kit.try_wait().unwrap().is_none() {
        publisher.step();
    }
    for _ in 0..200 {
        publisher.step();
    }
    let output = finish(kit);
    assert_eq!(output.status.code(), Some(1));
    assert!(line(&output, Check::Joints).contains("interrupted by a signal"), "{}", text(&output));
    assert_eq!(publisher.last.mode, CommandMode::Stop.to_wire());
    assert_eq!(publisher.state.velocity[..2], [0.0; 2]);
}

/// Whichever side is in lockstep alone: it is said within two seconds, and nothing moves.
#[test]
fn lockstep_on_one_side_is_told() {
    let place = Place::new("lockstep-controller-only");
    let model = place.train("planar");
    let mut robot = Robot::new(&place);
    robot.state.joint_names_hash = joint_names_hash(&["x_joint", "y_joint"]);
    let config = file("config/controllers/planar.ron");
    let controller = place.controller(&config, &model, &["--lockstep"]);
    for _ in 0..3000 {
        let command = robot.live();
        assert!(command.is_none_or(|command| command.mode == CommandMode::Stop.to_wire()));
    }
    signal(&controller, "-INT");
    let said = text(&finish(controller));
    assert!(said.contains("start both sides with --lockstep, or both without"), "{said}");
    let place = Place::new("lockstep-publisher-only");
    let controller = place.controller(&config, &model, &[]);
    let simulator = run(program("planar-sim")
        .args(["run", "--scene", &file("config/scenes/planar.json"), "--seed", "1", "--lockstep"])
        .args(["--instance", &place.instance, "--out", &place.path("sim")]));
    signal(&controller, "-INT");
    finish(controller);
    assert!(!simulator.status.success());
    assert!(text(&simulator).contains("start both with --lockstep"), "{}", text(&simulator));
}
