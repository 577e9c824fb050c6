//! The guard of commands beside a controller; and that the one in Rust and the one in Python judge the
//! same stream alike.

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tprmp_messages::{
    Action, Bounds, Cause, CommandGuard, CommandMode, Frame, GripperCommand, Instance, JointBounds,
    JointCommand, RobotState, Setpoint, StatePublisherPorts, TaskFrames,
};

use crate::common::{Place, file, finish, program, root, run, text};
use crate::robot::signal;

/// How long a command may take to come.
const PATIENCE: Duration = Duration::from_secs(60);

const CASES: usize = 8;
const TICKS: usize = 1000;

/// Numbers from a seed (splitmix64).
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Less than `end`.
    fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    /// From −1 to 1.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 * (2.0 / (1_u64 << 53) as f64) - 1.0
    }
}

/// Spoils one field of a command.
fn spoil(command: &mut JointCommand, draw: &mut Draw) {
    let joint = draw.below(8);
    let bits = draw.next();
    match draw.below(19) {
        0 => command.sequence = 1,
        1 => command.sequence = bits,
        2 => command.state_sequence = bits,
        3 => command.state_sequence = command.state_sequence.saturating_sub(bits % 300),
        4 => command.time_ns += bits % 3_000_000,
        5 => command.time_ns -= bits % 200_000_000,
        6 => command.time_ns = bits,
        7 => command.expiry_ns = bits,
        8 => command.expiry_ns = u64::MAX,
        9 => command.mode = bits as u32,
        10 => command.mode = CommandMode::Stop.to_wire(),
        11 => command.gripper_command = bits as u32,
        12 => command.joint_count = bits as u32 % 10,
        13 => command.reason = bits as u32,
        14 => command.position[joint] += 0.2 * draw.unit(),
        15 => command.velocity[joint] += 0.2 * draw.unit(),
        16 => command.velocity[joint] = f64::from_bits(bits),
        17 => command.position[joint] += TAU * (bits % 5) as f64 - 2.0 * TAU,
        _ => {
            let lists = [&mut command.acceleration, &mut command.torque, &mut command.position];
            for list in lists {
                list[joint] = f64::NAN;
            }
        }
    }
}

fn words(command: &JointCommand) -> Vec<u64> {
    let c = command;
    let numbers = [c.position, c.velocity, c.acceleration, c.torque, c.gravity_torque];
    let head = [c.sequence, c.state_sequence, c.time_ns, c.expiry_ns];
    let kinds = [c.mode, c.gripper_command, c.joint_count, c.reason].map(u64::from);
    let numbers = numbers.as_flattened().iter().map(|number| number.to_bits());
    head.into_iter().chain(kinds).chain(numbers).collect()
}

fn bits(numbers: &[f64]) -> Vec<u64> {
    numbers.iter().map(|number| number.to_bits()).collect()
}

/// One robot under a hostile stream: what came, and what was decided.
fn case(draw: &mut Draw, torque: bool, seen: &mut [u64]) -> (Value, u64) {
    let joints = 1 + draw.below(8);
    let bounds = (!torque).then(|| JointBounds {
        speed_max: core::array::from_fn(|_| 2.0 + draw.unit()),
        acceleration_max: core::array::from_fn(|_| 20.0 + 5.0 * draw.unit()),
        deceleration: core::array::from_fn(|_| 10.0 + 5.0 * draw.unit()),
        continuous: core::array::from_fn(|_| draw.below(2) == 0),
    });
    let mut guard = CommandGuard::new(joints, Bounds { joints: bounds, ..Bounds::default() });
    let mut state = RobotState { joint_count: joints as u32, ..Default::default() };
    let (mut now_ns, mut sequence, mut obeyed) = (1_000_000_000_u64, 0, 0);
    let mut ticks = Vec::new();
    for _ in 0..TICKS {
        now_ns += [1_000_000, 1_000_000, 1_000_000, 2_000_000, 0, 30_000_000][draw.below(6)];
        now_ns += if draw.below(50) == 0 { 150_000_000 } else { 0 };
        state.sequence += 1;
        let mut command = JointCommand {
            sequence,
            state_sequence: state.sequence,
            time_ns: now_ns,
            expiry_ns: now_ns + 50_000_000,
            mode: CommandMode::Track.to_wire(),
            gripper_command: draw.below(2) as u32,
            joint_count: joints as u32,
            ..Default::default()
        };
        for joint in 0..joints {
            let phase = now_ns as f64 * 1e-9 + joint as f64;
            command.position[joint] = 0.5 * phase.sin();
            command.velocity[joint] = 0.5 * phase.cos();
            state.position[joint] = command.position[joint] + 0.01 * draw.unit();
            state.velocity[joint] = command.velocity[joint];
        }
        state.position[0] = if draw.below(100) == 0 { f64::NAN } else { state.position[0] };
        if draw.below(20) == 0 {
            // Reported in another turn.
            state.position[draw.below(joints)] -= TAU;
        }
        if draw.below(4) == 0 {
            spoil(&mut command, draw);
        }
        let new = (draw.below(8) > 0).then_some(&command);
        sequence += 1;
        let action = guard.judge(now_ns, new, &state);
        let setpoint = action.setpoint();
        let fault = guard.last_fault().map(|f| {
            let numbers = (f.found.to_bits(), f.expected.to_bits());
            json!([f.cause.name(), f.sequence, f.joint, numbers.0, numbers.1])
        });
        obeyed += u64::from(matches!(action, Action::Obey(_)));
        ticks.push(json!({
            "now_ns": now_ns,
            "state": [state.sequence, bits(&state.position), bits(&state.velocity)],
            "command": new.map(words),
            "obey": matches!(action, Action::Obey(_)),
            "position": bits(&setpoint.position[..joints]),
            "velocity": bits(&setpoint.velocity[..joints]),
            "grips": guard.gripper() == GripperCommand::Grip,
            "fault": fault,
        }));
    }
    for (cause, count) in guard.counts().found() {
        seen[cause as usize] += count;
    }
    let counts = guard.counts().found().map(|(cause, count)| (cause.name().into(), count.into()));
    let counts: serde_json::Map<_, _> = counts.collect();
    let bounds = bounds.map(|b| {
        let continuous: Vec<_> = (0..joints).filter(|&joint| b.continuous[joint]).collect();
        json!([b.speed_max, b.acceleration_max, b.deceleration, continuous])
    });
    (json!({"joints": joints, "bounds": bounds, "counts": counts, "ticks": ticks}), obeyed)
}

#[test]
fn rust_and_python_give_the_same_verdicts_on_a_hostile_stream() {
    let place = Place::new("guard");
    let mut draw = Draw(20_261_127);
    let (mut seen, mut obeyed) = ([0; Cause::ALL.len()], 0);
    let cases: Vec<Value> = (0..CASES)
        .map(|i| {
            let (case, count) = case(&mut draw, i % 2 == 0, &mut seen);
            obeyed += count;
            case
        })
        .collect();
    for cause in Cause::ALL {
        assert!(seen[*cause as usize] > 5, "{cause:?} is hardly in the stream: {seen:?}");
    }
    let all = (CASES * TICKS) as u64;
    assert!((all / 4..all * 9 / 10).contains(&obeyed), "{obeyed} of {all} ticks obey");
    let stream = place.path("stream.json");
    std::fs::write(&stream, Value::from(cases).to_string()).unwrap();
    let output = run(program("python")
        .arg(root().join("sim-bridge/tests/replay_guard.py"))
        .arg(&stream)
        .env("PYTHONPATH", root().join("sim-bridge")));
    assert!(output.status.success(), "{}", text(&output));
    assert!(text(&output).contains(&format!("{all} ticks")), "{}", text(&output));
}

/// In lockstep: publishes a state of the plane and gives the command that answers it.
fn exchange(ports: &StatePublisherPorts, state: &mut RobotState) -> JointCommand {
    let mut frames = TaskFrames { frame_count: 2, ..Default::default() };
    frames.frames[0] = Frame::at("start", [0.0, 0.0, 0.0]).unwrap();
    frames.frames[1] = Frame::at("end", [2.0, 1.0, 0.0]).unwrap();
    state.sequence += 1;
    state.time_ns += 1_000_000;
    (frames.sequence, frames.time_ns) = (state.sequence, state.time_ns);
    assert!(ports.frames.publish(frames) && ports.state.publish(*state));
    let start = Instant::now();
    loop {
        assert!(ports.state.update_connections() && ports.frames.update_connections());
        match ports.command.receive() {
            Some(command) if command.state_sequence == state.sequence => return *command,
            _ => std::thread::sleep(Duration::from_micros(50)),
        }
        assert!(start.elapsed() < PATIENCE, "no answer from the controller");
    }
}

/// A robot with a position interface refuses commands in full motion, brakes to rest, and obeys again once
/// what is commanded is where it is: the controller need not know. Where it stands still for long, the controller
/// finds that it does, and tries once more.
#[test]
fn a_position_robot_that_refused_commands_comes_to_its_goal_all_the_same() {
    for refused in [40, 300] {
        comes_to_its_goal_after(refused);
    }
}

/// Refuses so many commands in a row.
fn comes_to_its_goal_after(refused: usize) {
    let place = Place::new("guard-position");
    let model = place.train("planar");
    let ports = Instance::new(&place.instance).unwrap().open_state_publisher().unwrap();
    let controller =
        place.controller(&file("config/controllers/planar.ron"), &model, &["--lockstep"]);
    let joints = Some(JointBounds::same(5.0, 60.0, 30.0));
    let mut guard = CommandGuard::new(2, Bounds { joints, ..Bounds::default() });
    let mut state = RobotState { time_ns: 1_000_000_000, joint_count: 2, ..Default::default() };
    let (mut refused_at, mut braked) = (None, 0);
    for tick in 0..20_000 {
        let mut command = exchange(&ports, &mut state);
        let speed = state.velocity[0].hypot(state.velocity[1]);
        if refused_at.is_none() && speed > 0.5 {
            refused_at = Some(tick);
        }
        if refused_at.is_some_and(|at| tick < at + refused) {
            command.torque[0] = f64::NAN;
        }
        let action = guard.judge(state.time_ns, Some(&command), &state);
        let Setpoint { position, velocity } = *action.setpoint();
        braked += u64::from(refused_at.is_some() && matches!(action, Action::Brake(_)));
        (state.position, state.velocity) = (position, velocity);
        if (position[0] - 2.0).hypot(position[1] - 1.0) < 0.003 {
            break;
        }
    }
    let [x, y, ..] = state.position;
    assert!((x - 2.0).hypot(y - 1.0) < 0.003, "it stands at {x}, {y}: {:?}", guard.last_fault());
    if refused < 50 {
        assert_eq!(guard.counts().of(Cause::NotFinite), refused as u64);
        // It takes up the controller's motion without having to wait for it.
        assert_eq!(braked, refused as u64, "{:?}", guard.last_fault());
    }
    signal(&controller, "-INT");
    while exchange(&ports, &mut state).mode != CommandMode::Stop.to_wire() {}
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
}
