//! Whatever a publisher sends, at whatever rate: no published field ever steps farther than its limit allows.
//!
//! A robot that does exactly what it is commanded publishes its state, and about every third message is
//! spoilt: false positions and velocities, other clocks, sequence numbers that stand still, go back or leap,
//! duplicates, bursts, silence, numbers that are none, a robot that is suddenly elsewhere. In real-time pacing
//! at rates that are not the loop's, and in lockstep.
//!
//! `TPRMP_HOSTILE_MESSAGES` sets how many messages each stream has; `make hostile` runs 100 000 each.

use std::time::{Duration, Instant};

use tprmp_controller::motion::limits::JointLimits;
use tprmp_controller::startup;
use tprmp_controller::timing::pacing::Pacing;
use tprmp_controller::timing::realtime::monotonic_ns;
use tprmp_messages::{
    CommandMode, GripperState, Instance, JointCommand, Reason, RobotMode, RobotState,
    StatePublisherPorts, TaskFrames,
};
use tprmp_model::controller_config::{self, Trigger};
use tprmp_robot::Chain;

use crate::common::{Controller, PLANE, POSES, Setting, answer, file};

const MS: u64 = 1_000_000;
/// Messages of a stream.
const MESSAGES: u64 = 1_500;

/// A stream of numbers.
struct Random(u64);

impl Random {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        (self.0 >> 33) % most
    }

    /// Between −1 and 1.
    fn sign(&mut self) -> f64 {
        self.below(2_000_001) as f64 * 1e-6 - 1.0
    }
}

/// The greatest values and changes of a command's fields.
struct Bounds {
    joints: usize,
    ends: [Vec<f64>; 2],
    return_max: f64,
    velocity: Vec<f64>,
    acceleration: Vec<f64>,
    jerk: Vec<f64>,
    effort: Vec<f64>,
    effort_rate: Vec<f64>,
}

impl Bounds {
    fn of<const N: usize>(setting: &Setting) -> Self {
        let path = file(setting.config);
        let config = controller_config::read(&path).unwrap();
        let (chain, _): (Chain<N>, _) = startup::robot(&path, &config).unwrap();
        let limits = JointLimits::new(&chain, &config.robot);
        let list = |values: &nalgebra::SVector<f64, N>| values.as_slice().to_vec();
        Self {
            joints: N,
            ends: [list(&limits.position_end[0]), list(&limits.position_end[1])],
            return_max: limits.return_max,
            velocity: list(&limits.velocity_max),
            acceleration: list(&limits.acceleration_max),
            jerk: list(&limits.jerk_max),
            effort: list(&limits.effort_max),
            effort_rate: list(&limits.effort_rate_max),
        }
    }

    /// That a command is inside its limits and continues the one before.
    fn hold(&self, before: Option<&JointCommand>, now: &JointCommand, context: &str) {
        let fields = |command: &JointCommand| {
            [
                command.position,
                command.velocity,
                command.acceleration,
                command.torque,
                command.gravity_torque,
            ]
        };
        let finite = |field: &[f64; 8]| field.iter().all(|value| value.is_finite());
        assert!(fields(now).iter().all(finite), "{context}: {now:?}");
        assert!(
            CommandMode::from_wire(now.mode).is_some() && Reason::from_wire(now.reason).is_some()
        );
        let slack = 1.0 + 1e-6;
        for i in 0..self.joints {
            let effort = now.torque[i] + now.gravity_torque[i];
            // An arm that is measured a little outside is held there, and moved back.
            let follows = now.mode == CommandMode::Track.to_wire();
            let outside = if follows { 0.0 } else { self.return_max * slack };
            let range = self.ends[0][i] - outside..=self.ends[1][i] + outside;
            let inside = range.contains(&now.position[i])
                && now.velocity[i].abs() <= self.velocity[i] * slack
                && now.acceleration[i].abs() <= self.acceleration[i] * slack
                && effort.abs() <= self.effort[i] * slack;
            assert!(inside, "{context}, joint {i}: {now:?}");
        }
        // Before the first state nothing can be continued.
        let Some(before) = before.filter(|before| before.position != [0.0; 8]) else { return };
        // The loop takes no step for shorter than a microsecond.
        let elapsed_s = (now.time_ns.saturating_sub(before.time_ns) as f64 * 1e-9)
            .max(1e-6 * (now.sequence - before.sequence) as f64);
        let names = ["position", "velocity", "acceleration", "torque", "gravity torque"];
        let rates =
            [&self.velocity, &self.acceleration, &self.jerk, &self.effort_rate, &self.effort_rate];
        let (last, now_fields) = (fields(before), fields(now));
        for (k, name) in names.into_iter().enumerate() {
            for i in 0..self.joints {
                let step = (now_fields[k][i] - last[k][i]).abs();
                let most = rates[k][i] * elapsed_s * slack + 1e-9;
                assert!(
                    step <= most,
                    "{context}: the {name} of joint {i} steps by {step}, at most {most} in {elapsed_s} s\n\
                     {before:?}\n{now:?}"
                );
            }
        }
    }
}

/// A robot that obeys, and a publisher that does not tell the truth.
struct Hostile {
    random: Random,
    ports: StatePublisherPorts,
    truth: RobotState,
    frames: TaskFrames,
    /// Added to each state for some time: a false state that is told again and again.
    offset: [f64; 8],
    offset_left: u64,
    last_sent: RobotState,
    command: Option<JointCommand>,
    tracked: u64,
    bounds: Bounds,
    context: String,
}

impl Hostile {
    fn new(setting: &Setting, bounds: Bounds, instance: &Instance, seed: u64) -> Self {
        Self {
            random: Random(seed),
            ports: instance.open_state_publisher().unwrap(),
            truth: setting.state(),
            frames: setting.frames(),
            offset: [0.0; 8],
            offset_left: 0,
            last_sent: setting.state(),
            command: None,
            tracked: 0,
            bounds,
            context: format!("{}, seed {seed}", instance.name()),
        }
    }

    /// Reads the newest command, and checks it.
    fn listen(&mut self) {
        assert!(self.ports.state.update_connections() && self.ports.frames.update_connections());
        if let Some(command) = self.ports.command.receive() {
            self.take(*command);
        }
    }

    fn take(&mut self, command: JointCommand) {
        self.bounds.hold(self.command.as_ref(), &command, &self.context);
        self.tracked += u64::from(command.mode == CommandMode::Track.to_wire());
        self.command = Some(command);
    }

    /// Moves the robot to where it is commanded.
    fn obey(&mut self, now_ns: u64) {
        let stop = CommandMode::Stop.to_wire();
        let obeyed =
            self.command.filter(|command| command.mode != stop && now_ns <= command.expiry_ns);
        match obeyed {
            Some(command) => {
                (self.truth.position, self.truth.velocity) = (command.position, command.velocity);
            }
            None => self.truth.velocity = [0.0; 8],
        }
        let elsewhere = self.random.below(2_000) == 0;
        if elsewhere {
            for i in 0..self.bounds.joints {
                let [lower, upper] = [self.bounds.ends[0][i], self.bounds.ends[1][i]];
                self.truth.position[i] =
                    (self.truth.position[i] + self.random.sign() * 2.0).clamp(lower, upper);
            }
        }
    }

    /// Sends the next state, at times a spoilt one, and frames.
    fn send(&mut self, now_ns: u64, hostile: bool) {
        self.truth.sequence += 1;
        self.frames.sequence += 1;
        (self.truth.time_ns, self.frames.time_ns) = (now_ns, now_ns);
        let mut state = self.truth;
        let mut frames = self.frames;
        // Now and then a single one, now and then one after the other, and times in which it gets up to speed.
        let one_in = [1_000, 100, 3][(self.truth.sequence / 250 % 3) as usize];
        if hostile && self.random.below(one_in) == 0 {
            self.spoil(&mut state, &mut frames, now_ns);
        }
        if hostile && self.offset_left > 0 {
            self.offset_left -= 1;
            (0..8).for_each(|i| state.position[i] += self.offset[i]);
        }
        assert!(self.ports.frames.publish(frames) && self.ports.state.publish(state));
        self.last_sent = state;
    }

    fn spoil(&mut self, state: &mut RobotState, frames: &mut TaskFrames, now_ns: u64) {
        let random = &mut self.random;
        let i = random.below(self.bounds.joints as u64) as usize;
        let x = random.sign();
        match random.below(24) {
            0 => state.position[i] += 2.0 * x,
            1 => state.position[i] += 0.02 * x,
            2 => state.position[i] = 10_f64.powf(12.0 * x),
            3 => state.velocity[i] += 6.0 * x,
            4 => state.velocity[i] += 0.3 * x,
            5 => state.velocity = [0.0; 8],
            6 => state.position[i] = f64::NAN,
            7 => state.velocity[i] = f64::INFINITY,
            8 => state.torque[i] = f64::NAN,
            9 => state.time_ns = now_ns.wrapping_add((x * 1e8) as i64 as u64),
            10 => state.time_ns = [0, u64::MAX, 1, now_ns / 1000][i % 4],
            11 => state.sequence = state.sequence.saturating_sub(1 + random.below(20)),
            12 => state.sequence += random.below(500),
            13 => *state = self.last_sent,
            14 => state.joint_count = random.below(10) as u32,
            15 => state.gripper_state = random.below(5) as u32,
            16 => state.robot_mode = random.below(RobotMode::ALL.len() as u64 + 2) as u32,
            17 => state.safety_stop = 1,
            18 => frames.frames[1].valid = 0,
            19 => frames.frames[1].position[i % 3] += x,
            20 => frames.frames[1].linear_velocity[i % 3] = 10_f64.powf(300.0 * x),
            21 => frames.time_ns = now_ns.wrapping_add((x * 1e9) as i64 as u64),
            22 => {
                self.offset[i] = if random.below(2) == 0 { 2.0 * x } else { 0.05 * x };
                self.offset_left = random.below(150);
            }
            _ => state.gripper_state = GripperState::Holding.to_wire(),
        }
    }
}

fn messages() -> u64 {
    let asked = std::env::var("TPRMP_HOSTILE_MESSAGES");
    asked.map_or(MESSAGES, |text| text.parse().expect("TPRMP_HOSTILE_MESSAGES: a whole number"))
}

fn edit(config: &mut controller_config::ControllerConfig) {
    config.supervision.latching.clear();
    config.real_time.fifo_priority = None;
    config.real_time.lock_memory = false;
    config.real_time.cpu_latency_max_us = None;
}

/// A stream on the clock: `rate` states a second, in bursts of `burst`.
fn in_real_time<const N: usize>(setting: &Setting, name: &str, rate: u64, burst: u64, seed: u64) {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    let mut robot = Hostile::new(setting, Bounds::of::<N>(setting), &instance, seed);
    let controller =
        Controller::start(setting, &instance, Pacing::RealTime(Trigger::Periodic), edit);
    let period_ns = 1_000_000_000 * burst / rate;
    let mut due_ns = monotonic_ns();
    let mut step = |robot: &mut Hostile, hostile: bool| {
        let silent = hostile && robot.random.below(400) == 0;
        due_ns = monotonic_ns().min(due_ns + period_ns).max(due_ns);
        due_ns += period_ns * if silent { 1 + 120 * MS / period_ns } else { 0 };
        while monotonic_ns() < due_ns {
            robot.listen();
            std::thread::sleep(Duration::from_micros(150));
        }
        robot.listen();
        robot.obey(monotonic_ns());
        (0..burst).for_each(|_| robot.send(monotonic_ns(), hostile));
        due_ns += period_ns;
    };
    let mut sent = 0;
    while sent < messages() {
        step(&mut robot, true);
        sent += burst;
    }
    // Told the truth again, it goes on. Where the machine is busy, little was followed before.
    let enough = (robot.tracked + 10).max(101);
    let start = Instant::now();
    while robot.tracked < enough {
        step(&mut robot, false);
        assert!(start.elapsed() < Duration::from_secs(60), "{}: it does not go on", robot.context);
    }
    let outcome = controller.stop(|| {
        robot.obey(monotonic_ns());
        robot.send(monotonic_ns(), false);
        robot.listen();
    });
    assert_eq!(outcome.run.allocations, 0, "{}", robot.context);
    assert!(outcome.ticks > robot.tracked, "{}", robot.context);
}

/// A stream in lockstep, each state answered before the next.
fn in_lockstep<const N: usize>(setting: &Setting, name: &str, seed: u64) {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    let mut robot = Hostile::new(setting, Bounds::of::<N>(setting), &instance, seed);
    let controller = Controller::start(setting, &instance, Pacing::Lockstep, edit);
    let mut time_ns = 1_000 * MS;
    let mut step = |robot: &mut Hostile, hostile: bool| {
        time_ns += [1, 2, 4, 20][robot.random.below(4) as usize] * MS;
        robot.obey(time_ns);
        robot.send(time_ns, hostile);
        let command = answer(&robot.ports, robot.last_sent.sequence);
        robot.take(command);
    };
    (0..messages()).for_each(|_| step(&mut robot, true));
    let tracked = robot.tracked;
    (0..2_000).for_each(|_| step(&mut robot, false));
    assert!(robot.tracked > tracked + 10, "{}: it does not go on", robot.context);
    let outcome = controller.stop(|| {
        time_ns += MS;
        robot.obey(time_ns);
        robot.send(time_ns, false);
        robot.listen();
    });
    assert_eq!(outcome.run.allocations, 0, "{}", robot.context);
}

#[test]
fn an_arm_is_not_thrown_by_any_stream_of_states() {
    std::thread::scope(|scope| {
        for (k, (rate, burst)) in
            [(50, 1), (125, 1), (250, 1), (500, 1), (1000, 1), (3000, 1), (1000, 5)]
                .into_iter()
                .enumerate()
        {
            let name = format!("hostile-arm-{rate}-{burst}");
            scope.spawn(move || in_real_time::<6>(&POSES, &name, rate, burst, 1 + k as u64));
        }
        scope.spawn(|| in_lockstep::<6>(&POSES, "hostile-arm-lockstep", 11));
    });
}

#[test]
fn a_point_is_not_thrown_by_any_stream_of_states() {
    std::thread::scope(|scope| {
        for (k, (rate, burst)) in [(125, 1), (500, 1), (3000, 3)].into_iter().enumerate() {
            let name = format!("hostile-point-{rate}-{burst}");
            scope.spawn(move || in_real_time::<2>(&PLANE, &name, rate, burst, 21 + k as u64));
        }
        scope.spawn(|| in_lockstep::<2>(&PLANE, "hostile-point-lockstep", 31));
    });
}
