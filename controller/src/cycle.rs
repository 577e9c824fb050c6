//! The hard loop. One function owns its course: wait, read, check, evaluate, limit, publish, record.
//!
//! In steady state a cycle allocates nothing, takes no lock, logs nothing and makes no system call
//! but its sleep. A peer that appears costs allocations once: it is connected to in the slack after
//! publishing, or before the loop spins towards its schedule. Where it appears in between, the next
//! exchange of messages connects to it. All of it is counted apart.

use core::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;

use tprmp_messages::{
    CommandMode, ControllerPorts, ControllerStatus, GripperState, JOINT_CAPACITY, JointCommand,
    LifeCycle, Reason, RobotState, Sample, Subscriber, TaskFrames,
};
use tprmp_model::controller_config::{ControllerConfig, Trigger};

use crate::commands::monitor::Board;
use crate::inputs::external::ExternalCommand;
use crate::inputs::scene::Scene;
use crate::inputs::state::{JointState, check_state, jumps, within_position_limits};
use crate::motion::limits::JointLimits;
use crate::motion::{Motion, Setpoint};
use crate::policy::{Policy, TaskParameters, Workspace};
use crate::task::standstill::{Headway, Standstill};
use crate::task::{Course, Remaining};
use crate::telemetry::{Connections, Telemetry, Tick, TickTimes};
use crate::timing::allocation;
use crate::timing::overruns::Overruns;
use crate::timing::pacing::{Arrivals, POLL_NS, Pace, Schedule, Wake};
use crate::timing::realtime::{PageFaults, monotonic_ns, sleep_until, spin_until};

/// Pause between two looks for the first state and frames \[ns\].
const CONNECT_POLL_NS: u64 = 1_000_000;
/// In lockstep, a stop waits this long for the publisher's next state \[ns\].
const LAST_STATE_NS: u64 = 200_000_000;
/// With `until_done`, the task has to stay done for so long \[ns\].
const DONE_NS: u64 = 1_000_000_000;
/// In lockstep, a publisher that is silent for so long has left [ns].
const LOCKSTEP_PATIENCE_NS: u64 = 30_000_000_000;
/// Most time one tick integrates over, whatever was missed \[s\].
const STEP_MAX_S: f64 = 0.02;

/// How a run ended.
#[derive(Debug, Clone, Copy)]
pub struct Ending {
    /// Where the task stood before the stop.
    pub life_cycle: LifeCycle,
    /// Heap allocations inside the loop, without those that connected a peer.
    pub allocations: u64,
    /// Page faults inside the loop, `None` where the system does not tell.
    pub page_faults: Option<PageFaults>,
}

/// The loop and all it needs, allocated before it starts.
#[derive(Debug)]
pub struct Cycle<const N: usize> {
    policy: Policy<N>,
    workspace: Workspace<N>,
    standstill: Standstill,
    config: ControllerConfig,
    pace: Pace,
    until_done: bool,
    schedule: Schedule,
    arrivals: Arrivals,
    overruns: Overruns,

    state: Option<Sample<RobotState>>,
    frames: Option<Sample<TaskFrames>>,
    scene: Scene,
    scene_check: Result<(), Reason>,
    sequence_went_back: bool,
    /// `None` for a controller that listens to nobody outside.
    external: Option<ExternalCommand>,
    last_measured: Option<(JointState<N>, u64)>,

    course: Course,
    motion: Motion<N>,
    /// Why the arm is being brought to rest. The policy is not followed before it rests.
    braking_for: Option<Reason>,
    progress: Progress,

    command: JointCommand,
    status: ControllerStatus,
    telemetry: Telemetry,
    board: Arc<Board>,
    allocations_before: u64,
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
        let limits = JointLimits::new(policy.chain(), &config.robot);
        let cycle = &config.cycle;
        Self {
            workspace: policy.workspace(),
            standstill: Standstill::default(),
            schedule: Schedule::new(cycle.period_ns, 0),
            arrivals: Arrivals::new(cycle.period_ns, cycle.spin_ns, 0),
            overruns: Overruns::new(cycle.overruns_in_a_row_max),
            motion: Motion::new(limits, &config),
            course: Course::new(config.lift, config.done, policy.has_orientation()),
            external: config.external.as_ref().map(ExternalCommand::new),
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
            last_measured: None,
            braking_for: None,
            progress: Progress {
                life_cycle: LifeCycle::Waiting,
                remaining: Remaining { distance_m: f64::INFINITY, angle_rad: f64::INFINITY },
                energy: 0.0,
                done_since_ns: None,
            },
            command: JointCommand { joint_count: N as u32, ..Default::default() },
            status: ControllerStatus::default(),
            telemetry: Telemetry::new(),
            board: Arc::default(),
            allocations_before: 0,
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
        self.allocations_before = allocation::counted();
        let mut page_faults = None;
        if self.connect(stop) {
            let before = PageFaults::of_this_thread();
            self.allocations_before = allocation::counted();
            self.telemetry.connections = Connections::default();
            self.run_connected(stop);
            let after = PageFaults::of_this_thread();
            page_faults = before.zip(after).map(|(before, after)| after.since(&before));
        }
        Ending {
            life_cycle: self.progress.life_cycle,
            allocations: self.allocations(),
            page_faults,
        }
    }

    fn run_connected(&mut self, stop: &AtomicBool) {
        let start_ns = monotonic_ns();
        let cycle = &self.config.cycle;
        self.schedule = Schedule::new(cycle.period_ns, start_ns);
        self.arrivals = Arrivals::new(cycle.period_ns, cycle.spin_ns, start_ns);
        let mut last_ns = None;
        let mut stopping_since_ns = None;
        while let Some(wake) = self.wait(stop) {
            let dt = self.elapsed_s(last_ns, wake.now_ns);
            last_ns = Some(wake.now_ns);
            self.read(wake.now_ns);
            let read_ns = monotonic_ns();
            self.notice_a_gap(&wake);

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
                Ok(reason) => (CommandMode::Track, reason),
                Err(reason) => {
                    self.braking_for = Some(reason);
                    // Whether the arm gets on is seen anew once it goes on.
                    self.standstill = Standstill::default();
                    (self.brake(measured.ok(), dt), reason)
                }
            };
            let stopped = stopping_since_ns
                .is_some_and(|since| self.has_stopped(measured.ok(), since, wake.now_ns));
            let mode = if stopped { CommandMode::Stop } else { mode };
            let evaluated_ns = monotonic_ns();
            self.publish_command(mode, reason, wake.now_ns);
            self.record(&wake, read_ns, evaluated_ns, reason, measured.ok());
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
            let connected = self.ports.update_connections();
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
            self.publish_status(missing, monotonic_ns(), &TickTimes::default());
            sleep_until(monotonic_ns() + CONNECT_POLL_NS);
        }
        false
    }

    fn wait(&mut self, stop: &AtomicBool) -> Option<Wake> {
        match self.pace {
            Pace::RealTime(Trigger::Periodic) => Some(self.wait_for_schedule()),
            Pace::RealTime(Trigger::OnState) | Pace::Lockstep => self.wait_for_state(stop),
        }
    }

    /// Sleeps until the next period; where it spins at its end, first connects to whoever appeared
    /// meanwhile.
    fn wait_for_schedule(&mut self) -> Wake {
        let due_ns = self.schedule.due_ns();
        let spin_ns = self.config.cycle.spin_ns;
        sleep_until(due_ns.saturating_sub(spin_ns));
        if spin_ns > 0 {
            self.connect_to_newcomers();
            spin_until(due_ns);
        }
        self.schedule.woke(monotonic_ns())
    }

    /// Looks for a new state, with pauses where it need not spin. On the machine's clock it also
    /// wakes when the state gets too old; in lockstep a stop ends the wait, or a publisher that has
    /// left: `None`.
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
            let longest_ns =
                if self.motion.is_lost() { cycle.period_ns } else { cycle.state_age_max_ns };
            if received || first {
                let wake = self.arrivals.arrived(woke_ns);
                let state_ns = self.state.as_ref().map_or(0, |s| s.time_ns);
                return Some(if lockstep { wake.at_state(state_ns) } else { wake });
            }
            if !lockstep && waited_ns > longest_ns {
                return Some(self.arrivals.missed(woke_ns));
            }
            let stopping = stop.load(Ordering::Relaxed);
            let patience_ns = if stopping { LAST_STATE_NS } else { LOCKSTEP_PATIENCE_NS };
            if lockstep && waited_ns > patience_ns {
                return None;
            }
            if self.arrivals.spins(woke_ns) {
                core::hint::spin_loop();
            } else {
                sleep_until(woke_ns + POLL_NS);
            }
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
    fn read(&mut self, now_ns: u64) {
        if self.pace == Pace::RealTime(Trigger::Periodic) {
            self.receive_state();
        }
        if let Some(frames) = self.exchange(|ports| ports.frames.receive()) {
            self.frames = Some(frames);
            self.take_in_frames();
        }
        if self.external.is_some() {
            let command =
                self.exchange(|ports| ports.tool_command.as_ref().and_then(Subscriber::receive));
            if let (Some(external), Some(command)) = (&mut self.external, command) {
                external.take_in(&command, now_ns);
            }
        }
    }

    fn receive_state(&mut self) -> bool {
        let Some(state) = self.exchange(|ports| ports.state.receive()) else { return false };
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

    /// Looks at the periods that passed without a tick. When the last command has expired meanwhile,
    /// the robot has braked on its own: the arm is not where it was led.
    fn notice_a_gap(&mut self, wake: &Wake) {
        if self.pace == Pace::Lockstep {
            return;
        }
        self.overruns.begin(wake.skipped);
        if self.command.sequence > 0 && wake.now_ns > self.command.expiry_ns {
            self.motion.lose_sight();
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
        self.motion.observe(&joints, state.time_ns);
        Ok(joints)
    }

    /// Whether the policy may be followed from this state.
    fn permit(&mut self, state: &JointState<N>, now_ns: u64) -> Result<(), Reason> {
        if core::mem::take(&mut self.sequence_went_back) {
            self.motion.lose_sight();
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
        if self.overruns.stop() {
            return Err(Reason::Overrun);
        }
        // Whatever has gone wrong: first to rest, then on.
        self.braking_for = self.braking_for.filter(|_| !self.motion.reference_rests());
        self.braking_for.map_or(Ok(()), Err)
    }

    /// Evaluates the policy, limits its acceleration and prepares the command. Tells why the task does
    /// not get on, if it does not.
    fn follow_policy(
        &mut self,
        state: &JointState<N>,
        dt: f64,
        now_ns: u64,
    ) -> Result<Reason, Reason> {
        let gripper = self.state.as_ref().map_or(0, |s| s.gripper_state);
        let gripper = GripperState::from_wire(gripper).ok_or(Reason::GripperUnknown)?;
        if self.motion.is_holding() {
            self.workspace.restart();
        }
        if let Some(external) = &mut self.external {
            if self.motion.is_holding() {
                external.restart();
            }
            external.advance(now_ns, dt);
        }
        let parameters = TaskParameters {
            frames: self.scene.frames(),
            goal_frame: self.scene.goal_frame(),
            obstacles: self.scene.obstacles(),
            external: self.external.as_ref(),
            dt_s: dt,
        };
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
        let setpoint =
            self.motion.follow(self.policy.chain(), state, &decision.acceleration, dt)?;
        self.workspace.advance(&setpoint.acceleration, dt);
        self.prepare(&setpoint);

        let (life_cycle, remaining) =
            self.course.advance(gripper, &decision.tool, &decision.goal, dt);
        let done_since_ns =
            (life_cycle == LifeCycle::Done).then(|| self.progress.done_since_ns.unwrap_or(now_ns));
        self.progress = Progress { life_cycle, remaining, energy: decision.energy, done_since_ns };
        let goal_frame = &self.scene.frames()[self.scene.goal_frame()];
        let headway = Headway {
            speed: state.velocity.amax(),
            distance_m: remaining.distance_m,
            energy: decision.energy,
            goal_speed_m_s: goal_frame
                .fixed_point(decision.goal.position - goal_frame.pose.position)
                .first()
                .length(),
        };
        let led = self.external.as_ref().is_some_and(ExternalCommand::leads);
        Ok(self.standstill.advance(life_cycle, &headway, &decision.surroundings, led, dt))
    }

    /// Prepares a command that leads the arm to rest and holds it there; where that cannot be done
    /// any more, the robot has to brake.
    fn brake(&mut self, measured: Option<JointState<N>>, dt: f64) -> CommandMode {
        match self.motion.brake(self.policy.chain(), measured, dt) {
            Some(setpoint) => {
                self.prepare(&setpoint);
                CommandMode::Hold
            }
            None => CommandMode::Stop,
        }
    }

    fn prepare(&mut self, setpoint: &Setpoint<N>) {
        for (from, to) in [
            (&setpoint.position, &mut self.command.position),
            (&setpoint.velocity, &mut self.command.velocity),
            (&setpoint.acceleration, &mut self.command.acceleration),
            (&setpoint.torques.motion, &mut self.command.torque),
            (&setpoint.torques.gravity, &mut self.command.gravity_torque),
        ] {
            to[..N].copy_from_slice(from.as_slice());
        }
    }

    /// Whether reference and arm are at rest, or the longest time for it has passed.
    fn has_stopped(&self, measured: Option<JointState<N>>, since_ns: u64, now_ns: u64) -> bool {
        let stopping_s = now_ns.saturating_sub(since_ns) as f64 * 1e-9;
        stopping_s > self.config.stop.duration_max_s || self.motion.rests(measured)
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
        let command = self.command;
        // A command that cannot be sent expires: the robot brakes.
        let _ = self.exchange(|ports| ports.command.publish(command));
    }

    /// Counts the tick, publishes the status and connects to whoever has appeared.
    fn record(
        &mut self,
        wake: &Wake,
        read_ns: u64,
        evaluated_ns: u64,
        reason: Reason,
        measured: Option<JointState<N>>,
    ) {
        let published_ns = monotonic_ns();
        let timed = self.pace != Pace::Lockstep;
        // A state that was refused was not used.
        let used = self.state.as_ref().filter(|_| follows_policy(reason));
        let tick = Tick {
            time_ns: published_ns,
            times: TickTimes {
                wake_up_ns: wake.late_ns,
                state_age_ns: used.map(|s| wake.now_ns.saturating_sub(s.time_ns)),
                receiving_ns: read_ns - wake.woke_ns,
                evaluation_ns: evaluated_ns - read_ns,
                publishing_ns: published_ns - evaluated_ns,
            },
            missed: timed && (published_ns > wake.deadline_ns || wake.skipped > 0),
            skipped: if timed { wake.skipped } else { 0 },
            reason,
        };
        self.overruns.end(tick.missed, self.motion.rests(measured));
        self.telemetry.record(&tick);
        self.publish_status(reason, published_ns, &tick.times);
        self.connect_to_newcomers();
    }

    fn publish_status(&mut self, reason: Reason, now_ns: u64, times: &TickTimes) {
        let life_cycle = match reason {
            _ if follows_policy(reason) => self.progress.life_cycle,
            Reason::StopRequested => LifeCycle::Stopping,
            _ if self.motion.is_new() => LifeCycle::Waiting,
            _ => LifeCycle::Holding,
        };
        self.board.write(life_cycle, reason);
        let ticks = self.telemetry.ticks;
        let changed = (self.status.life_cycle, self.status.reason)
            != (life_cycle.to_wire(), reason.to_wire());
        let every = u64::from(self.config.cycle.status_every_ticks);
        if self.pace != Pace::Lockstep && !changed && !ticks.is_multiple_of(every) {
            return;
        }
        self.status = ControllerStatus {
            sequence: self.status.sequence + 1,
            time_ns: now_ns,
            life_cycle: life_cycle.to_wire(),
            reason: reason.to_wire(),
            ticks,
            deadline_misses: self.telemetry.deadline_misses,
            skipped_periods: self.telemetry.skipped_periods,
            allocations: self.allocations(),
            connections: self.telemetry.connections.count,
            period_ns: self.config.cycle.period_ns,
            wake_up_ns: times.wake_up_ns,
            state_age_ns: times.state_age_ns.unwrap_or(0),
            receiving_ns: times.receiving_ns,
            evaluation_ns: times.evaluation_ns,
            publishing_ns: times.publishing_ns,
            goal_distance_m: self.progress.remaining.distance_m,
            goal_angle_rad: self.progress.remaining.angle_rad,
            energy_j: self.progress.energy,
        };
        let status = self.status;
        let _ = self.exchange(|ports| ports.status.publish(status));
    }

    fn connect_to_newcomers(&mut self) {
        // One that fails is tried again, in the next slack.
        let _ = self.exchange(ControllerPorts::update_connections);
    }

    /// Exchanges messages with peers. What allocates in it is a connection to one that appeared:
    /// nothing else in iceoryx2 0.9.3 does, which the tests of this crate hold on to.
    fn exchange<T>(&mut self, work: impl FnOnce(&ControllerPorts) -> T) -> T {
        let (before, since_ns) = (allocation::counted(), monotonic_ns());
        let result = work(&self.ports);
        let allocations = allocation::counted() - before;
        if allocations > 0 {
            self.telemetry.connected(allocations, monotonic_ns() - since_ns);
        }
        result
    }

    /// Heap allocations inside the loop so far, without those that connected a peer.
    fn allocations(&self) -> u64 {
        let all = allocation::counted() - self.allocations_before;
        all.saturating_sub(self.telemetry.connections.allocations)
    }
}

/// Whether the policy was followed, however far it leads.
fn follows_policy(reason: Reason) -> bool {
    matches!(reason, Reason::None | Reason::Blocked | Reason::Unreachable)
}
