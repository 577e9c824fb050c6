//! The live simulator: steps the physics, publishes states, obeys commands.
//!
//! Real time: one step every period of `CLOCK_MONOTONIC`, on an absolute schedule. A step that
//! begins more than half a period late moves the schedule instead of being caught up with, and is
//! counted as a slip. States carry their scheduled time.
//!
//! Lockstep: a simulated clock. Every state waits for the command that answers it and for that
//! tick's status, so that the same seed and controller give the same commands byte for byte.
//!
//! Order of one step: the state at time t is published; at the step's deadline the newest command
//! is obeyed for the step from t to t + dt.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use tprmp_files::{Existing, errln, make_folder, try_out, write};
use tprmp_messages::{
    Action, Bounds, CommandGuard, CommandMode, ControllerStatus, Frame, Instance, JOINT_CAPACITY,
    JointCommand, LifeCycle, Obstacle, ObstacleKind, Reason, RobotState, StatePublisherPorts,
    TaskFrames, joint_names_hash, name_bytes, stop_flag,
};

use crate::clock::{monotonic_ns, sleep_until};
use crate::episode::FrameAt;
use crate::error::SimError;
use crate::log::{Bridge, Extremes, Mode, Outcome, Row, STEPS_A_ROW, Timing, counted, save};
use crate::scene::Scene;
use crate::world::{Drive, World, force};

/// Time of the first state in lockstep \[ns\].
const LOCKSTEP_EPOCH_NS: u64 = 1_000_000_000;
/// How long the first command may take \[ns\].
const FIRST_COMMAND_NS: u64 = 60_000_000_000;
/// How long any other command may take in lockstep \[ns\].
const ANSWER_NS: u64 = 10_000_000_000;
/// In lockstep, so long is looked without a pause, then with one of `POLL_NS` \[ns\].
const SPIN_NS: u64 = 100_000;
const POLL_NS: u64 = 20_000;
/// A task has to stay done for so long \[s\].
const DONE_S: f64 = 1.0;
/// A controller that leaves by itself is given so long for it, once the task is done \[s\].
const LEAVE_S: f64 = 0.5;
const NO_ROTATION: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

/// What the command line asks for.
#[derive(Debug)]
pub(crate) struct Options {
    pub(crate) seed: u64,
    pub(crate) out: PathBuf,
    pub(crate) instance: String,
    pub(crate) lockstep: bool,
    pub(crate) push: bool,
    pub(crate) record_commands: Option<PathBuf>,
    /// What becomes of another run's files.
    pub(crate) existing: Existing,
}

/// Runs one episode and writes its log; gives how it ended.
pub(crate) fn run(scene: &Scene, options: &Options) -> Result<Outcome, SimError> {
    let world = World::new(scene, options.seed, options.push)?;
    let mut run = Run::new(scene, options, world)?;
    // Before any file is touched: an instance that cannot be is no reason to replace another run's.
    let instance = Instance::new(&options.instance)?;
    let ports = instance.open_state_publisher()?;
    let stop = stop_flag().map_err(SimError::Signals)?;
    // Before anything moves: a run that cannot be written down would be lost.
    if let Some(path) = &options.record_commands {
        if let Some(folder) = path.parent() {
            make_folder(folder)?;
        }
        try_out(path, options.existing)?;
    }
    run.save(scene, options, Outcome::Interrupted, options.existing)?;
    errln!(
        "planar-sim: seed {}, instance `{}`: publishing at {} Hz, waiting for a controller",
        options.seed,
        options.instance,
        scene.physics.rate_hz
    );
    let ended =
        if options.lockstep { run.lockstep(&ports, &stop) } else { run.real_time(&ports, &stop) };
    drop(ports);
    // What was seen until an error is written down, too; the files are this run's by now.
    let outcome = *ended.as_ref().unwrap_or(&Outcome::Interrupted);
    let saved = run.save(scene, options, outcome, Existing::Replace);
    let recorded = match (&options.record_commands, &run.recorded) {
        (Some(path), Some(recorded)) => write(path, recorded, options.existing),
        _ => Ok(()),
    };
    ended?;
    saved?;
    recorded?;
    run.print(outcome, &options.out);
    Ok(outcome)
}

/// One run: the loop's state.
struct Run {
    world: World,
    dt_ns: u64,
    steps_max: u64,
    /// The time limit is its end.
    goes_round: bool,
    instance: String,
    mode: Mode,
    state: RobotState,
    frames: TaskFrames,
    /// The newest command, whatever it is.
    command: JointCommand,
    /// Which of them are obeyed.
    guard: CommandGuard,
    status: Option<ControllerStatus>,
    /// What the controller was at before it began to stop.
    life_cycle: LifeCycle,
    done_s: f64,
    steps: u64,
    rows: Vec<Row>,
    recorded: Option<Vec<u8>>,
    timing: Timing,
    extremes: Extremes,
}

impl Run {
    fn new(scene: &Scene, options: &Options, world: World) -> Result<Self, SimError> {
        let name = |key: &str, name: &str| {
            name_bytes(name).map_err(|fault| {
                SimError::key(&scene.file, key, format!("{fault}, found `{name}`"))
            })
        };
        let frame = |name| Frame { name, valid: 1, quaternion: NO_ROTATION, ..Default::default() };
        let mut frames = TaskFrames { frame_count: 2, obstacle_count: 1, ..Default::default() };
        let start = world.episode.start();
        frames.frames[0] = Frame {
            position: start.position_m.extend(0.0).into(),
            quaternion: start.quaternion_wxyz(),
            ..frame(name("task.start_frame", &scene.task.start_frame)?)
        };
        frames.frames[1] = frame(name("task.goal_frame", &scene.task.goal_frame)?);
        frames.obstacles[0] = Obstacle {
            kind: ObstacleKind::Sphere.to_wire(),
            valid: 1,
            quaternion: NO_ROTATION,
            size: [world.episode.obstacle.radius_m, 0.0, 0.0],
            ..Default::default()
        };
        let extremes = Extremes {
            clearance_min_m: world.clearance_m(),
            effort_fraction_max: 0.0,
            velocity_fraction_max: 0.0,
        };
        let physics = &scene.physics;
        let steps_max = (physics.time_limit_s * f64::from(physics.rate_hz)).ceil() as u64;
        let record = options.record_commands.is_some() && options.lockstep;
        let joint_names_hash = joint_names_hash(world.joint_names());
        Ok(Self {
            world,
            dt_ns: 1_000_000_000 / u64::from(physics.rate_hz),
            steps_max,
            goes_round: scene.task.goes_round,
            instance: options.instance.clone(),
            mode: if options.lockstep { Mode::Lockstep } else { Mode::RealTime },
            state: RobotState { joint_count: 2, joint_names_hash, ..Default::default() },
            frames,
            command: JointCommand::default(),
            guard: CommandGuard::new(2, Bounds::default()),
            status: None,
            life_cycle: LifeCycle::Waiting,
            done_s: 0.0,
            steps: 0,
            rows: Vec::with_capacity((steps_max / STEPS_A_ROW) as usize + 2),
            recorded: record
                .then(|| Vec::with_capacity((steps_max as usize + 1) * size_of::<JointCommand>())),
            timing: Timing::default(),
            extremes,
        })
    }

    /// Steps against `CLOCK_MONOTONIC` until the run is over.
    fn real_time(
        &mut self,
        ports: &StatePublisherPorts,
        stop: &AtomicBool,
    ) -> Result<Outcome, SimError> {
        let opened_ns = monotonic_ns();
        let mut deadline_ns = opened_ns;
        let mut first_ns = None;
        let outcome = loop {
            self.publish(ports, deadline_ns)?;
            if let Some(status) = ports.status.receive() {
                self.status = Some(*status);
            }
            if let Some(outcome) = self.judge(stop) {
                break outcome;
            }
            deadline_ns += self.dt_ns;
            let late_ns = sleep_until(deadline_ns);
            if late_ns > self.dt_ns / 2 {
                deadline_ns += late_ns;
                self.count_slip(late_ns);
            }
            let new = ports.command.receive().map(|command| *command);
            self.command = new.unwrap_or(self.command);
            let drive = self.drive(monotonic_ns(), new.as_ref());
            if !self.world.moving {
                self.world.moving = drive != Drive::Brake;
                if self.world.moving {
                    first_ns = Some(deadline_ns);
                } else if deadline_ns - opened_ns > FIRST_COMMAND_NS {
                    return Err(self.no_controller(FIRST_COMMAND_NS));
                } else {
                    connect(ports);
                }
            }
            self.step(drive);
        };
        self.timing.wall_s = first_ns.map_or(0.0, |first| seconds(monotonic_ns() - first));
        Ok(outcome)
    }

    /// Steps a simulated clock, one command a state, until the run is over.
    fn lockstep(
        &mut self,
        ports: &StatePublisherPorts,
        stop: &AtomicBool,
    ) -> Result<Outcome, SimError> {
        self.world.moving = true;
        let mut first_ns = None;
        let outcome = loop {
            let time_ns = LOCKSTEP_EPOCH_NS + self.steps * self.dt_ns;
            self.publish(ports, time_ns)?;
            if !self.wait_for_answer(ports, stop, first_ns.is_none()) {
                if stop.load(Ordering::Relaxed) {
                    break Outcome::Interrupted;
                }
                if first_ns.is_none() {
                    return Err(self.no_controller(FIRST_COMMAND_NS));
                }
                break Outcome::ControllerLost;
            }
            first_ns.get_or_insert_with(monotonic_ns);
            // In lockstep the controller's clock is that of the states.
            if self.command.time_ns != time_ns && !self.stop_requested() {
                return Err(SimError::NotInLockstep(self.instance.clone()));
            }
            if let Some(recorded) = &mut self.recorded {
                append_bytes(recorded, &self.command);
            }
            if let Some(outcome) = self.judge(stop) {
                break outcome;
            }
            let answer = self.command;
            let drive = self.drive(time_ns, Some(&answer));
            self.step(drive);
        };
        self.timing.wall_s = first_ns.map_or(0.0, |first| seconds(monotonic_ns() - first));
        Ok(outcome)
    }

    /// Polls for the command that answers the newest state, then for the status of that tick.
    /// `false` when it did not come in time, or a signal did.
    fn wait_for_answer(
        &mut self,
        ports: &StatePublisherPorts,
        stop: &AtomicBool,
        first: bool,
    ) -> bool {
        let begun_ns = monotonic_ns();
        let limit_ns = if first { FIRST_COMMAND_NS } else { ANSWER_NS };
        let mut answered = false;
        loop {
            if let Some(command) = ports.command.receive() {
                self.command = *command;
                answered = command.state_sequence == self.state.sequence;
            }
            if let Some(status) = ports.status.receive() {
                self.status = Some(*status);
            }
            // One status a command; the last one, which leaves, has none in every case.
            let reported = self.stop_requested()
                || self.status.is_some_and(|status| status.ticks >= self.command.sequence);
            if answered && reported {
                return true;
            }
            let now_ns = monotonic_ns();
            let waited_ns = now_ns - begun_ns;
            if waited_ns > limit_ns || stop.load(Ordering::Relaxed) {
                return false;
            }
            if first {
                connect(ports);
            }
            if waited_ns > SPIN_NS {
                sleep_until(now_ns + POLL_NS);
            }
        }
    }

    /// Publishes frames and state as they are, with this time.
    fn publish(&mut self, ports: &StatePublisherPorts, time_ns: u64) -> Result<(), SimError> {
        let world = &self.world;
        let sequence = self.state.sequence + 1;
        self.state.sequence = sequence;
        self.state.time_ns = time_ns;
        self.state.position[..2].copy_from_slice(world.position().as_ref());
        self.state.velocity[..2].copy_from_slice(world.velocity().as_ref());
        self.state.torque[..2].copy_from_slice(world.force.as_slice());
        self.frames.sequence = sequence;
        self.frames.time_ns = time_ns;
        let goal = world.episode.goal.at(world.time_s());
        let obstacle = world.episode.obstacle.at(world.time_s());
        // While the scenario's clock stands still, so does what it moves.
        let rate = if world.moving { 1.0 } else { 0.0 };
        fill_frame(&mut self.frames.frames[1], &goal, rate);
        self.frames.obstacles[0].position = obstacle.position_m.extend(0.0).into();
        self.frames.obstacles[0].linear_velocity =
            (obstacle.velocity_m_s * rate).extend(0.0).into();
        // The frames first: whoever sees the state finds frames at least as new.
        if ports.frames.publish(self.frames) && ports.state.publish(self.state) {
            Ok(())
        } else {
            Err(SimError::Publish)
        }
    }

    /// Whether the run is over.
    fn judge(&mut self, stop: &AtomicBool) -> Option<Outcome> {
        let life_cycle = self.status.and_then(|s| LifeCycle::from_wire(s.life_cycle));
        let life_cycle = life_cycle.unwrap_or_default();
        if life_cycle != LifeCycle::Stopping {
            self.life_cycle = life_cycle;
        }
        let dt_s = seconds(self.dt_ns);
        self.done_s = if life_cycle == LifeCycle::Done { self.done_s + dt_s } else { 0.0 };
        if stop.load(Ordering::Relaxed) {
            return Some(Outcome::Interrupted);
        }
        if self.stop_requested() {
            let done = self.life_cycle == LifeCycle::Done;
            return Some(if done { Outcome::Done } else { Outcome::ControllerStopped });
        }
        if self.done_s > DONE_S + LEAVE_S {
            return Some(Outcome::Done);
        }
        let over = self.world.moving && self.steps >= self.steps_max;
        over.then_some(if self.goes_round { Outcome::Done } else { Outcome::Timeout })
    }

    /// Whether the newest command says that the controller leaves.
    fn stop_requested(&self) -> bool {
        self.command.mode == CommandMode::Stop.to_wire()
            && self.command.reason == Reason::StopRequested.to_wire()
    }

    /// What moves the point from `now_ns` \[ns\] on, given the command that has come, if one has.
    fn drive(&mut self, now_ns: u64, new: Option<&JointCommand>) -> Drive {
        match self.guard.judge(now_ns, new, &self.state) {
            Action::Obey(_) => force(self.guard.command()),
            Action::Brake(_) => Drive::Brake,
        }
    }

    /// Steps the physics and writes down what was before.
    fn step(&mut self, drive: Drive) {
        let (position, velocity) = (self.world.position(), self.world.velocity());
        let (time_s, clearance_m) = (self.world.time_s(), self.world.clearance_m());
        let clamped = self.world.step(drive);
        if !self.world.moving {
            return;
        }
        let force = self.world.force;
        self.timing.clamped_steps += u64::from(clamped);
        self.timing.braked_steps += u64::from(drive == Drive::Brake);
        let extremes = &mut self.extremes;
        extremes.clearance_min_m = extremes.clearance_min_m.min(clearance_m);
        for i in 0..2 {
            let effort = force[i].abs() / self.world.effort_max()[i];
            let speed = velocity[i].abs() / self.world.velocity_max()[i];
            extremes.effort_fraction_max = extremes.effort_fraction_max.max(effort);
            extremes.velocity_fraction_max = extremes.velocity_fraction_max.max(speed);
        }
        if self.steps.is_multiple_of(STEPS_A_ROW) {
            let goal = self.world.episode.goal.at(time_s).pose;
            let obstacle = self.world.episode.obstacle.at(time_s).position_m;
            let braked = drive == Drive::Brake;
            self.rows.push(Row {
                time_s,
                x_m: position.x,
                y_m: position.y,
                vx_m_s: velocity.x,
                vy_m_s: velocity.y,
                force_x_n: force[0],
                force_y_n: force[1],
                goal_x_m: goal.position_m.x,
                goal_y_m: goal.position_m.y,
                goal_angle_rad: goal.angle_rad,
                obstacle_x_m: obstacle.x,
                obstacle_y_m: obstacle.y,
                clearance_m,
                mode: if braked { -1.0 } else { f64::from(self.command.mode) },
                reason: f64::from(self.command.reason),
                life_cycle: self.status.map_or(-1.0, |s| f64::from(s.life_cycle)),
            });
        }
        self.steps += 1;
    }

    fn count_slip(&mut self, late_ns: u64) {
        if self.world.moving {
            self.timing.slips += 1;
            self.timing.slip_total_s += seconds(late_ns);
            self.timing.slip_max_s = self.timing.slip_max_s.max(seconds(late_ns));
        }
    }

    fn no_controller(&self, waited_ns: u64) -> SimError {
        SimError::NoController {
            waited_s: waited_ns / 1_000_000_000,
            instance: self.instance.clone(),
            lockstep: if self.mode == Mode::Lockstep { ", with --lockstep" } else { "" },
        }
    }

    fn save(
        &mut self,
        scene: &Scene,
        options: &Options,
        outcome: Outcome,
        existing: Existing,
    ) -> Result<(), SimError> {
        self.timing.simulated_s = self.world.time_s();
        let world = &self.world;
        let bridge = Bridge {
            schema: Bridge::schema(),
            scene: scene.file.display().to_string(),
            instance: options.instance.clone(),
            mode: self.mode,
            outcome,
            point_radius_m: world.point_radius_m,
            effort_max_n: (*world.effort_max()).into(),
            velocity_max_m_s: (*world.velocity_max()).into(),
            episode: world.episode.clone(),
            timing: self.timing,
            command_faults: command_faults(&self.guard),
            extremes: self.extremes,
        };
        save(&options.out, &self.rows, &bridge, existing)
    }

    fn print(&self, outcome: Outcome, out: &Path) {
        let timing = &self.timing;
        errln!(
            "planar-sim: {outcome:?} after {:.2} s in {:.2} s; {} slips, together {:.1} ms; {} \
             braked steps; wrote {}",
            timing.simulated_s,
            timing.wall_s,
            timing.slips,
            1e3 * timing.slip_total_s,
            timing.braked_steps,
            out.display()
        );
        if let Some(fault) = self.guard.last_fault() {
            let counts = counted(&command_faults(&self.guard));
            errln!("planar-sim: commands with a fault: {counts}; the last one: {fault}");
        }
    }
}

/// How many commands had each fault, by its name.
fn command_faults(guard: &CommandGuard) -> BTreeMap<String, u64> {
    guard.counts().found().map(|(cause, count)| (cause.name().to_owned(), count)).collect()
}

/// Sends the last frames and state to a controller that has appeared since: the frames first, so
/// that whoever sees the state finds frames.
fn connect(ports: &StatePublisherPorts) {
    // What fails now is tried again at the next look.
    let _ = ports.frames.update_connections();
    let _ = ports.state.update_connections();
}

fn fill_frame(frame: &mut Frame, at: &FrameAt, rate: f64) {
    frame.position = at.pose.position_m.extend(0.0).into();
    frame.quaternion = at.pose.quaternion_wxyz();
    frame.linear_velocity = (at.velocity_m_s * rate).extend(0.0).into();
    frame.angular_velocity = [0.0, 0.0, at.angular_velocity_rad_s * rate];
}

/// The bytes of a command as they lie in shared memory: its fields in order, without padding.
fn append_bytes(bytes: &mut Vec<u8>, command: &JointCommand) {
    let c = command;
    for word in [c.sequence, c.state_sequence, c.time_ns, c.expiry_ns] {
        bytes.extend_from_slice(&word.to_ne_bytes());
    }
    for word in [c.mode, c.gripper_command, c.joint_count, c.reason] {
        bytes.extend_from_slice(&word.to_ne_bytes());
    }
    let arrays: [&[f64; JOINT_CAPACITY]; 5] =
        [&c.position, &c.velocity, &c.acceleration, &c.torque, &c.gravity_torque];
    for number in arrays.into_iter().flatten() {
        bytes.extend_from_slice(&number.to_ne_bytes());
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recorded_bytes_are_those_in_shared_memory() {
        let mut command = JointCommand { sequence: 5, mode: 2, reason: 9, ..Default::default() };
        command.velocity[1] = 0.25;
        command.gravity_torque[7] = -1.5;
        let mut bytes = Vec::new();
        append_bytes(&mut bytes, &command);
        assert_eq!(bytes.len(), size_of::<JointCommand>());
        let field = |name: &str, skip: usize| {
            let of =
                |f: &&tprmp_messages::FieldLayout| f.message == "JointCommand" && f.field == name;
            let offset = JointCommand::LAYOUT.fields.iter().find(of).unwrap().offset + skip;
            u64::from_ne_bytes(bytes[offset..offset + 8].try_into().unwrap())
        };
        assert_eq!(field("sequence", 0), 5);
        assert_eq!(f64::from_bits(field("velocity", 8)), 0.25);
        assert_eq!(f64::from_bits(field("gravity_torque", 56)), -1.5);
        let offset =
            |name| JointCommand::LAYOUT.fields.iter().find(|f| f.field == name).unwrap().offset;
        assert_eq!(bytes[offset("reason")], 9);
    }
}
