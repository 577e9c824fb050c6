//! The hard loop. One function owns its course: wait, read, check, evaluate, limit, publish, record.
//!
//! In steady state a cycle allocates nothing, takes no lock, logs nothing and makes no system call
//! but its sleep. A publisher or subscriber that appears costs allocations once: iceoryx2 connects
//! to it in the slack after publishing, or in the first exchange.

use core::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;

use glam::DVec3;
use nalgebra::SVector;
use tprmp_messages::{
    CommandMode, ControllerPorts, ControllerStatus, GripperState, JOINT_CAPACITY, JointCommand,
    LifeCycle, Reason, RobotState, Sample, TaskFrames,
};
use tprmp_model::controller_config::{ControllerConfig, Trigger};

use crate::allocation;
use crate::inputs::{JointState, Scene, check_state, jumps, within_position_limits};
use crate::limits::JointLimits;
use crate::monitor::Board;
use crate::policy::{Policy, TaskParameters, Workspace};
use crate::realtime::{monotonic_ns, sleep_until};
use crate::task::{Course, Remaining};
use crate::telemetry::{Telemetry, TickTimes};
use crate::tracking::{Reference, braking, torques};

/// Pause between two looks for a new state \[ns\].
const POLL_NS: u64 = 20_000;
/// Pause between two looks for the first state and frames \[ns\].
const CONNECT_POLL_NS: u64 = 1_000_000;
/// In lockstep, a stop waits this long for the publisher's next state \[ns\].
const LAST_STATE_NS: u64 = 200_000_000;
/// With `until_done`, the task has to stay done for so long \[ns\].
const DONE_NS: u64 = 1_000_000_000;
/// A reference slower than this is at rest [rad/s or m/s].
const REFERENCE_REST: f64 = 1e-9;
/// A measured arm slower than this is at rest [rad/s or m/s].
const MEASURED_REST: f64 = 1e-2;
/// In lockstep, a publisher that is silent for so long has left [ns].
const LOCKSTEP_PATIENCE_NS: u64 = 30_000_000_000;
/// Most time one tick integrates over, whatever was missed \[s\].
const STEP_MAX_S: f64 = 0.02;

/// What paces the loop, and which clock it believes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// `CLOCK_MONOTONIC`, woken as configured.
    RealTime(Trigger),
    /// One tick a state, on the clock of the states: exact whatever the machine's load.
    Lockstep,
}

/// How a run ended.
#[derive(Debug, Clone, Copy)]
pub struct Ending {
    /// Where the task stood before the stop.
    pub life_cycle: LifeCycle,
    /// Heap allocations inside the loop.
    pub allocations: u64,
}

/// The loop and all it needs, allocated before it starts.
#[derive(Debug)]
pub struct Cycle<const N: usize> {
    policy: Policy<N>,
    workspace: Workspace<N>,
    limits: JointLimits<N>,
    config: ControllerConfig,
    gravity_m_s2: DVec3,
    pace: Pace,
    until_done: bool,
    state: Option<Sample<RobotState>>,
    frames: Option<Sample<TaskFrames>>,
    scene: Scene,
    scene_check: Result<(), Reason>,
    sequence_went_back: bool,

    course: Course,
    reference: Option<Reference<N>>,
    last_measured: Option<(JointState<N>, u64)>,
    holding: bool,
    /// Whether the arm was out of sight: it may be elsewhere than the reference.
    lost: bool,
    fade_s: f64,
    overruns_in_a_row: u32,
    progress: Progress,

    command: JointCommand,
    status: ControllerStatus,
    telemetry: Telemetry,
    board: Arc<Board>,
    /// Dropped last: a sample that is still held would keep its shared memory in use.
    ports: ControllerPorts,
}

/// What a tick knows about the task.
#[derive(Debug, Clone, Copy)]
struct Progress {
    life_cycle: LifeCycle,
    remaining: Remaining,
    energy: f64,
    done_since_ns: Option<u64>,
}

/// Why and when the loop woke up.
#[derive(Debug, Clone, Copy)]
struct Wake {
    /// On the loop's clock \[ns\].
    now_ns: u64,
    /// On `CLOCK_MONOTONIC` \[ns\].
    woke_ns: u64,
    /// By then the command has to be out, on `CLOCK_MONOTONIC` \[ns\].
    deadline_ns: u64,
    /// How late \[ns\].
    late_ns: u64,
    /// Periods that passed without a tick.
    skipped: u64,
}

impl<const N: usize> Cycle<N> {
    /// Puts a loop together. Allocates: at start-up only.
    #[must_use]
    pub fn new(
        policy: Policy<N>,
        scene: Scene,
        config: ControllerConfig,
        pace: Pace,
        until_done: bool,
        ports: ControllerPorts,
    ) -> Self {
        let command = JointCommand { joint_count: N as u32, ..Default::default() };
        Self {
            limits: JointLimits::new(policy.chain(), &config.robot),
            workspace: Workspace::new(),
            gravity_m_s2: config.robot.gravity_m_s2.into(),
            course: Course::new(config.lift, config.done, policy.turns()),
            policy,
            config,
            pace,
            until_done,
            ports,
            state: None,
            frames: None,
            scene,
            scene_check: Err(Reason::FrameMissing),
            sequence_went_back: false,
            reference: None,
            last_measured: None,
            holding: true,
            lost: true,
            fade_s: 0.0,
            overruns_in_a_row: 0,
            progress: Progress {
                life_cycle: LifeCycle::Waiting,
                remaining: Remaining { distance_m: f64::INFINITY, angle_rad: f64::INFINITY },
                energy: 0.0,
                done_since_ns: None,
            },
            command,
            status: ControllerStatus::default(),
            telemetry: Telemetry::new(),
            board: Arc::default(),
        }
    }

    /// What the loop measured.
    #[must_use]
    pub fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    /// Where the loop writes what it is doing, for a thread that tells the user.
    #[must_use]
    pub fn board(&self) -> Arc<Board> {
        Arc::clone(&self.board)
    }

    /// Runs until `stop` is set, or the task is done where that was asked for; then brings the
    /// arm to rest and publishes a last command.
    pub fn run(&mut self, stop: &AtomicBool) -> Ending {
        if self.connect(stop) {
            allocation::count_this_thread(true);
            self.run_connected(stop);
            allocation::count_this_thread(false);
        }
        Ending { life_cycle: self.progress.life_cycle, allocations: allocation::counted() }
    }

    fn run_connected(&mut self, stop: &AtomicBool) {
        let start_ns = monotonic_ns();
        let mut scheduled_ns = start_ns;
        let mut last_ns = None;
        let mut stopping_since_ns = None;
        while let Some(wake) = self.wait(&mut scheduled_ns, stop) {
            let dt = self.elapsed_s(last_ns, wake.now_ns);
            last_ns = Some(wake.now_ns);
            self.read();

            let done_ns =
                self.progress.done_since_ns.map(|since| wake.now_ns.saturating_sub(since));
            if stop.load(Ordering::Relaxed)
                || (self.until_done && done_ns.is_some_and(|ns| ns >= DONE_NS))
            {
                stopping_since_ns.get_or_insert(wake.now_ns);
            }
            let measured = self.measure(wake.now_ns);
            let permitted = match (stopping_since_ns, measured) {
                (Some(_), _) => Err(Reason::StopRequested),
                (None, Err(reason)) => Err(reason),
                (None, Ok(state)) => self.permit(&state, wake.now_ns).map(|()| state),
            };
            let followed = permitted.and_then(|state| self.follow_policy(&state, dt, wake.now_ns));
            let (mode, reason) = match followed {
                Ok(()) => (CommandMode::Track, Reason::None),
                Err(reason) => (self.brake(measured.ok(), dt), reason),
            };
            let stopped = stopping_since_ns
                .is_some_and(|since| self.at_rest(measured.ok(), since, wake.now_ns));
            let mode = if stopped { CommandMode::Stop } else { mode };
            self.publish_command(mode, reason, wake.now_ns);
            self.record(&wake, reason);
            if stopped {
                return;
            }
        }
        // The publisher has left before the arm was at rest: the last word is to brake.
        self.publish_command(CommandMode::Stop, Reason::StopRequested, self.command.time_ns);
    }

    /// Waits for the first state and frames, so that all connections stand before the loop
    /// starts. `false` when a stop came first.
    fn connect(&mut self, stop: &AtomicBool) -> bool {
        while !stop.load(Ordering::Relaxed) {
            // Only looks: a lockstep publisher's first state must get its tick in the loop.
            let state = self.ports.state.receive();
            let frames = self.ports.frames.receive();
            let connected =
                self.ports.command.update_connections() & self.ports.status.update_connections();
            self.state = state.or(self.state.take());
            self.frames = frames.or(self.frames.take());
            if let (Some(state), Some(_)) = (&self.state, &self.frames)
                && connected
            {
                let gripper = GripperState::from_wire(state.gripper_state).unwrap_or_default();
                self.course.begin(gripper);
                self.take_in_frames();
                return true;
            }
            let missing =
                if self.state.is_some() { Reason::FrameMissing } else { Reason::StateStale };
            self.publish_status(missing, monotonic_ns(), &NO_TIMES);
            sleep_until(monotonic_ns() + CONNECT_POLL_NS);
        }
        false
    }

    fn wait(&mut self, scheduled_ns: &mut u64, stop: &AtomicBool) -> Option<Wake> {
        match self.pace {
            Pace::RealTime(Trigger::Periodic) => Some(self.wait_for_schedule(scheduled_ns)),
            Pace::RealTime(Trigger::OnState) | Pace::Lockstep => self.wait_for_state(stop),
        }
    }

    /// Sleeps until the next period. A late schedule skips what it missed and is never caught up
    /// with a burst.
    fn wait_for_schedule(&self, scheduled_ns: &mut u64) -> Wake {
        let period = self.config.cycle.period_ns;
        *scheduled_ns += period;
        sleep_until(*scheduled_ns);
        let woke_ns = monotonic_ns();
        let late_ns = woke_ns.saturating_sub(*scheduled_ns);
        let skipped = late_ns / period;
        *scheduled_ns += skipped * period;
        let deadline_ns = *scheduled_ns + period;
        Wake { now_ns: woke_ns, woke_ns, deadline_ns, late_ns, skipped }
    }

    /// Polls for a new state. On the machine's clock it also wakes when the state gets too old;
    /// in lockstep a stop ends the wait, or a publisher that has left: `None`.
    fn wait_for_state(&mut self, stop: &AtomicBool) -> Option<Wake> {
        let since_ns = monotonic_ns();
        loop {
            // The first state was received while connecting: it counts as new.
            let first = self.telemetry.ticks == 0;
            let received = self.receive_state();
            let woke_ns = monotonic_ns();
            let lockstep = self.pace == Pace::Lockstep;
            let waited_ns = woke_ns - since_ns;
            // While it brakes without a state, the arm is led period by period.
            let cycle = &self.config.cycle;
            let longest_ns = if self.lost { cycle.period_ns } else { cycle.state_age_max_ns };
            if received || first || (!lockstep && waited_ns > longest_ns) {
                let state_ns = self.state.as_ref().map_or(0, |s| s.time_ns);
                let now_ns = if lockstep { state_ns } else { woke_ns };
                let deadline_ns = woke_ns + self.config.cycle.period_ns;
                return Some(Wake { now_ns, woke_ns, deadline_ns, late_ns: 0, skipped: 0 });
            }
            let stopping = stop.load(Ordering::Relaxed);
            let patience_ns = if stopping { LAST_STATE_NS } else { LOCKSTEP_PATIENCE_NS };
            if lockstep && waited_ns > patience_ns {
                return None;
            }
            sleep_until(woke_ns + POLL_NS);
        }
    }

    fn elapsed_s(&self, last_ns: Option<u64>, now_ns: u64) -> f64 {
        let period_s = self.config.cycle.period_ns as f64 * 1e-9;
        match last_ns {
            Some(last_ns) => (now_ns.saturating_sub(last_ns) as f64 * 1e-9).clamp(1e-6, STEP_MAX_S),
            None => period_s,
        }
    }

    /// Takes in the newest messages, as views into shared memory.
    fn read(&mut self) {
        if self.pace == Pace::RealTime(Trigger::Periodic) {
            self.receive_state();
        }
        if let Some(frames) = self.ports.frames.receive() {
            self.frames = Some(frames);
            self.take_in_frames();
        }
    }

    fn receive_state(&mut self) -> bool {
        let Some(state) = self.ports.state.receive() else { return false };
        let last = self.state.as_ref().map_or(0, |s| s.sequence);
        self.sequence_went_back |= state.sequence <= last;
        self.state = Some(state);
        true
    }

    fn take_in_frames(&mut self) {
        if let Some(frames) = &self.frames {
            self.scene_check = self.scene.update(frames, &self.config.frame_observer);
        }
    }

    /// The joints as measured, where the newest state can be believed. Done in every tick: what
    /// brakes the arm must see where it is.
    ///
    /// A position that jumps is not believed at once: it is in the next state, if that agrees.
    fn measure(&mut self, now_ns: u64) -> Result<JointState<N>, Reason> {
        let state = self.state.as_ref().ok_or(Reason::StateStale)?;
        // A stamp from the future is as wrong as an old one.
        if now_ns.abs_diff(state.time_ns) > self.config.cycle.state_age_max_ns {
            return Err(Reason::StateStale);
        }
        let joints = check_state(state, self.policy.chain())?;
        let (before, before_ns) =
            self.last_measured.replace((joints, state.time_ns)).unwrap_or((joints, state.time_ns));
        let elapsed_s = state.time_ns.abs_diff(before_ns) as f64 * 1e-9;
        if jumps(&before, &joints, elapsed_s, self.policy.chain()) {
            return Err(Reason::StateUnbelievable);
        }
        Ok(joints)
    }

    /// Whether the policy may be followed from this state.
    fn permit(&mut self, state: &JointState<N>, now_ns: u64) -> Result<(), Reason> {
        if core::mem::take(&mut self.sequence_went_back) {
            self.lost = true;
            return Err(Reason::SequenceWentBack);
        }
        if !within_position_limits(state, self.policy.chain()) {
            return Err(Reason::JointLimit);
        }
        self.scene_check?;
        let frames = self.frames.as_ref().ok_or(Reason::FrameMissing)?;
        if now_ns.abs_diff(frames.time_ns) > self.config.cycle.frames_age_max_ns {
            return Err(Reason::FramesStale);
        }
        if self.overruns_in_a_row >= self.config.cycle.overruns_in_a_row_max {
            return Err(Reason::Overrun);
        }
        Ok(())
    }

    /// Evaluates the policy, limits its acceleration and prepares the command.
    fn follow_policy(&mut self, state: &JointState<N>, dt: f64, now_ns: u64) -> Result<(), Reason> {
        let gripper = self.state.as_ref().map_or(0, |s| s.gripper_state);
        let gripper = GripperState::from_wire(gripper).ok_or(Reason::GripperUnknown)?;
        let parameters = TaskParameters {
            frames: self.scene.frames(),
            goal_frame: self.scene.goal_frame(),
            obstacles: self.scene.obstacles(),
        };
        if self.holding {
            self.workspace.restart();
        }
        let decision = self
            .policy
            .evaluate(
                &state.position,
                &state.velocity,
                &self.course.task(),
                &parameters,
                &mut self.workspace,
            )
            .map_err(|_| Reason::ResolveFailed)?;
        // After a start or a stop: from the measured state, faded in.
        if core::mem::take(&mut self.holding) {
            self.reference = None;
            self.fade_s = 0.0;
        }
        self.lost = false;
        let mut reference = self.reference.unwrap_or(Reference::at(state, &self.limits));
        let stop = &self.config.stop;
        let fade = (self.fade_s / stop.fade_in_s).min(1.0);
        self.fade_s += dt;
        let brake = braking(&reference.velocity, &self.limits, stop.deceleration_share, dt);
        let wanted = decision.acceleration * fade + brake * (1.0 - fade);
        let acceleration =
            self.limits.acceleration(&wanted, &reference.position, &reference.velocity, dt);
        reference.integrate(&acceleration, dt);
        self.workspace.advance(&acceleration, dt);
        self.prepare(state, &reference, &acceleration)?;
        let impedance = &self.config.impedance;
        reference.follow(state, &self.limits, impedance.reference_time_constant_s, dt);
        self.reference = Some(reference);

        let (life_cycle, remaining) =
            self.course.advance(gripper, &decision.tool, &decision.goal, dt);
        let done_since_ns =
            (life_cycle == LifeCycle::Done).then(|| self.progress.done_since_ns.unwrap_or(now_ns));
        self.progress = Progress { life_cycle, remaining, energy: decision.energy, done_since_ns };
        Ok(())
    }

    /// Decelerates the reference to rest and holds it there, by feedback from the measured state.
    /// Without one there is no feedback, and once the reference is at rest the robot has to brake.
    fn brake(&mut self, measured: Option<JointState<N>>, dt: f64) -> CommandMode {
        self.holding = true;
        let seen_again = self.lost.then_some(measured).flatten();
        self.lost = measured.is_none();
        let start = match seen_again {
            Some(state) => Some(Reference::at(&state, &self.limits)),
            None => self.reference.or(measured.map(|state| Reference::at(&state, &self.limits))),
        };
        let Some(mut reference) = start else { return CommandMode::Stop };
        let share = self.config.stop.deceleration_share;
        let wanted = braking(&reference.velocity, &self.limits, share, dt);
        let acceleration =
            self.limits.acceleration(&wanted, &reference.position, &reference.velocity, dt);
        reference.integrate(&acceleration, dt);
        self.reference = Some(reference);
        let blind = JointState { position: reference.position, velocity: reference.velocity };
        let prepared = self.prepare(&measured.unwrap_or(blind), &reference, &acceleration);
        let at_rest = reference.velocity.amax() < REFERENCE_REST;
        if prepared.is_err() || (measured.is_none() && at_rest) {
            CommandMode::Stop
        } else {
            CommandMode::Hold
        }
    }

    /// Computes the torques and fills the command. Nothing that is not finite gets into it.
    fn prepare(
        &mut self,
        state: &JointState<N>,
        reference: &Reference<N>,
        acceleration: &SVector<f64, N>,
    ) -> Result<(), Reason> {
        let torques = torques(
            self.policy.chain(),
            &self.limits,
            &self.config.impedance,
            self.gravity_m_s2,
            state,
            reference,
            acceleration,
        );
        let parts = [
            (&reference.position, &mut self.command.position),
            (&reference.velocity, &mut self.command.velocity),
            (acceleration, &mut self.command.acceleration),
            (&torques.motion, &mut self.command.torque),
            (&torques.gravity, &mut self.command.gravity_torque),
        ];
        if !parts.iter().all(|(from, _)| from.iter().all(|v| v.is_finite())) {
            return Err(Reason::CommandNotFinite);
        }
        for (from, to) in parts {
            to[..N].copy_from_slice(from.as_slice());
        }
        Ok(())
    }

    /// Whether reference and arm are at rest, or the longest time for it has passed.
    fn at_rest(&self, measured: Option<JointState<N>>, since_ns: u64, now_ns: u64) -> bool {
        let stopping_s = now_ns.saturating_sub(since_ns) as f64 * 1e-9;
        let reference_rests = self.reference.is_none_or(|r| r.velocity.amax() < REFERENCE_REST);
        let arm_rests = measured.is_none_or(|m| m.velocity.amax() < MEASURED_REST);
        stopping_s > self.config.stop.duration_max_s || (reference_rests && arm_rests)
    }

    fn publish_command(&mut self, mode: CommandMode, reason: Reason, now_ns: u64) {
        if mode == CommandMode::Stop {
            self.command.velocity = [0.0; JOINT_CAPACITY];
            self.command.acceleration = [0.0; JOINT_CAPACITY];
            self.command.torque = [0.0; JOINT_CAPACITY];
        }
        self.command.sequence += 1;
        self.command.state_sequence = self.state.as_ref().map_or(0, |s| s.sequence);
        self.command.time_ns = now_ns;
        self.command.expiry_ns = now_ns.saturating_add(self.config.cycle.command_lifetime_ns);
        self.command.mode = mode.to_wire();
        self.command.reason = reason.to_wire();
        self.command.gripper_command = self.course.gripper().to_wire();
        // A command that cannot be sent expires: the robot brakes.
        let _ = self.ports.command.publish(self.command);
    }

    /// Counts the tick, publishes the status and connects to whoever has appeared.
    fn record(&mut self, wake: &Wake, reason: Reason) {
        let published_ns = monotonic_ns();
        let missed = published_ns > wake.deadline_ns || wake.skipped > 0;
        let counted = missed && self.pace != Pace::Lockstep;
        self.overruns_in_a_row = if counted { self.overruns_in_a_row + 1 } else { 0 };
        // A state that was refused was not used.
        let used = self.state.as_ref().filter(|_| reason == Reason::None);
        let times = TickTimes {
            wake_up_ns: wake.late_ns,
            state_age_ns: used.map(|s| wake.now_ns.saturating_sub(s.time_ns)),
            compute_ns: published_ns - wake.woke_ns,
        };
        self.telemetry.record(&times, counted, reason);
        self.publish_status(reason, published_ns, &times);
        let _ = self.ports.command.update_connections();
        let _ = self.ports.status.update_connections();
    }

    fn publish_status(&mut self, reason: Reason, now_ns: u64, times: &TickTimes) {
        let life_cycle = match reason {
            Reason::None => self.progress.life_cycle,
            Reason::StopRequested => LifeCycle::Stopping,
            _ if self.reference.is_none() => LifeCycle::Waiting,
            _ => LifeCycle::Holding,
        };
        self.board.write(life_cycle, reason);
        self.status = ControllerStatus {
            sequence: self.status.sequence + 1,
            time_ns: now_ns,
            life_cycle: life_cycle.to_wire(),
            reason: reason.to_wire(),
            ticks: self.telemetry.ticks,
            deadline_misses: self.telemetry.deadline_misses,
            allocations: allocation::counted(),
            wake_up_ns: times.wake_up_ns,
            state_age_ns: times.state_age_ns.unwrap_or(0),
            compute_ns: times.compute_ns,
            goal_distance_m: self.progress.remaining.distance_m,
            goal_angle_rad: self.progress.remaining.angle_rad,
            energy_j: self.progress.energy,
        };
        let _ = self.ports.status.publish(self.status);
    }
}

/// Before the first tick nothing was measured.
const NO_TIMES: TickTimes = TickTimes { wake_up_ns: 0, state_age_ns: None, compute_ns: 0 };
