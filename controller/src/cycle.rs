//! The hard loop. One function owns its control flow: wait, read, check, evaluate, limit, publish,
//! record.
//!
//! In steady state a cycle allocates nothing, takes no lock, logs nothing and makes no system call
//! but its sleep. A new peer costs allocations once: it is connected to in the slack after
//! publishing, or before the loop spins towards its schedule. Where it appears in between, the next
//! exchange of messages connects to it. All of it is counted apart.

use core::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;

use tprmp_messages::{
    CommandMode, ControllerPorts, GripperCommand, GripperState, LifeCycle, Reason,
};
use tprmp_model::controller_config::{ControllerConfig, Fallback, Trigger};

use crate::control::journal::Entry;
use crate::control::requests::Setting;
use crate::control::server::{Exchange, Replacement, Shared};
use crate::control::supervisor::{Kind, Supervisor, kind};
use crate::detail::{About, Detail};
use crate::inputs::estimator::JointState;
use crate::inputs::external::ExternalCommand;
use crate::inputs::frozen::{Asked, FrozenPositions};
use crate::inputs::inbox::Inbox;
use crate::motion::generator::{MotionGenerator, Setpoint};
use crate::motion::limits::JointLimits;
use crate::outbox::Outbox;
use crate::peers::Peers;
use crate::policy::{Decision, Retreat, RobotPolicy, TaskParameters, Workspace};
use crate::task::rounds::RoundCounter;
use crate::task::stall::{Progress, StallDetector};
use crate::task::state::{Remaining, TaskState};
use crate::telemetry::{RunOutcome, Telemetry, TickRecord, TickTimes};
use crate::timing::loop_timing::LoopTiming;
use crate::timing::pacing::{Pacing, Wake};
use crate::timing::realtime::{PageFaults, monotonic_ns, sleep_until};

/// Pause between two looks for the first state and frames \[ns\].
const CONNECT_POLL_NS: u64 = 1_000_000;
/// Time constant with which a changed setting takes effect \[s\].
const SETTING_TIME_S: f64 = 0.3;
/// With `until_done`, the task has to stay done for so long \[ns\].
const DONE_NS: u64 = 1_000_000_000;

/// The loop and all it needs, allocated before it starts.
#[derive(Debug)]
pub struct Cycle<const N: usize> {
    policy: RobotPolicy<N>,
    workspace: Workspace<N>,
    task: TaskState,
    stall: StallDetector,
    rounds: RoundCounter,
    motion: MotionGenerator<N>,
    /// Why the arm is being brought to rest. The policy is not followed before it rests.
    braking_for: Option<Reason>,
    /// Whether that lasts, or the arm has only to come to rest.
    lasts: bool,
    /// Whether states arrive whose time does not grow.
    time_stands: bool,
    frozen: FrozenPositions<N>,
    /// What was seen beside the newest reason.
    detail: Detail,
    supervisor: Supervisor,
    shared: Shared,
    exchange: Option<Exchange<N>>,
    /// What the controller before this one was doing, where it did not end by itself.
    last_entry: Option<Entry>,
    stopping_since_ns: Option<u64>,
    until_done: bool,
    timing: LoopTiming,
    telemetry: Telemetry,
    inbox: Inbox<N>,
    outbox: Outbox,
    /// Dropped last: a sample that is still held would keep its shared memory in use.
    peers: Peers,
}

/// When the parts of a tick were over \[ns\].
struct Milestones {
    read_ns: u64,
    evaluated_ns: u64,
}

impl<const N: usize> Cycle<N> {
    /// Puts a loop together. Allocates: at start-up only.
    #[must_use]
    pub fn new(
        new: Replacement<N>,
        config: &ControllerConfig,
        pacing: Pacing,
        until_done: bool,
        ports: ControllerPorts,
        shared: Shared,
    ) -> Self {
        let Replacement { policy, workspace, scene } = new;
        let limits = JointLimits::new(policy.chain(), &config.robot);
        let mut task = TaskState::new(config.lift, config.done, policy.moved());
        task.set_skill(policy.moved(), policy.is_periodic());
        Self {
            workspace,
            task,
            stall: StallDetector::default(),
            rounds: RoundCounter::default(),
            motion: MotionGenerator::new(limits, config).gripping(policy.chain(), config),
            braking_for: None,
            lasts: false,
            time_stands: false,
            frozen: FrozenPositions::new(config.robot.actuators.lag_s()),
            detail: Detail::default(),
            supervisor: Supervisor::new(&config.supervision),
            exchange: None,
            last_entry: None,
            stopping_since_ns: None,
            until_done,
            timing: LoopTiming::new(config.cycle.clone(), pacing),
            telemetry: Telemetry::new(),
            inbox: Inbox::new(scene, policy.chain(), config, pacing == Pacing::Lockstep),
            outbox: Outbox::new(
                N,
                &config.cycle,
                pacing == Pacing::Lockstep,
                Arc::clone(&shared.status),
            ),
            shared,
            peers: Peers::new(ports),
            policy,
        }
    }

    /// Whether nobody has looked yet at the end of the controller before this one.
    #[must_use]
    pub fn follows_a_crash(&self) -> bool {
        self.supervisor.follows_a_crash()
    }

    /// What the loop measured.
    #[must_use]
    pub fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    /// The controller before this one did not end by itself, and was doing this; somebody has looked, or not.
    #[must_use]
    pub fn after(mut self, last: Entry, looked: bool) -> Self {
        if !looked {
            self.supervisor.fail(Reason::EndedUnexpectedly);
        }
        self.last_entry = Some(last);
        self
    }

    /// Takes new policies from here, at the beginning of a tick.
    #[must_use]
    pub fn exchanging(mut self, exchange: Exchange<N>) -> Self {
        self.exchange = Some(exchange);
        self
    }

    /// Runs until `stop` is set, or the task is done where that was asked for; then brings the
    /// arm to rest and publishes a last command.
    pub fn run(&mut self, stop: &AtomicBool) -> RunOutcome {
        self.peers.begin();
        let mut page_faults = None;
        if self.connect(stop) {
            let before = PageFaults::of_this_thread();
            self.peers.begin();
            self.run_connected(stop);
            let after = PageFaults::of_this_thread();
            page_faults = before.zip(after).map(|(before, after)| after.since(&before));
        }
        RunOutcome {
            life_cycle: self.task.life_cycle(),
            states_lost: self.inbox.states_lost(),
            mode: self.shared.status.mode(),
            rounds: self.rounds.report(),
            slowed: *self.motion.slowed(),
            allocations: self.peers.allocations(),
            connections: self.peers.connections(),
            page_faults,
        }
    }

    fn run_connected(&mut self, stop: &AtomicBool) {
        self.timing.begin(monotonic_ns());
        while let Some(wake) = self.wait(stop) {
            let now_ns = wake.now_ns;
            let dt = self.timing.step_s(now_ns);
            self.read(now_ns);
            let read_ns = monotonic_ns();

            self.take_requests(dt, now_ns);
            self.check_gap(&wake);
            self.check_stop(stop, now_ns);
            let measured = self.measure(now_ns);
            self.hold(measured.as_ref().ok(), now_ns, dt);
            let followed = self
                .permit(measured, now_ns, dt)
                .and_then(|state| self.follow_policy(&state, dt, now_ns));
            let (mode, reason) = match followed {
                Ok(reason) => (CommandMode::Track, reason),
                Err(reason) => {
                    self.note(self.detail_of(reason, measured.as_ref().ok(), now_ns));
                    (self.brake(measured.ok(), reason, dt), reason)
                }
            };
            let stopped = self.has_stopped(measured.ok(), now_ns);
            let mode = if stopped { CommandMode::Stop } else { mode };
            let evaluated_ns = monotonic_ns();

            self.publish_command(mode, reason, now_ns);
            self.record(&wake, &Milestones { read_ns, evaluated_ns }, reason);
            if stopped {
                return;
            }
        }
        // The publisher has left before the arm was at rest: the last command is to brake.
        let time_ns = self.outbox.command_time_ns();
        self.publish_command(CommandMode::Stop, Reason::StopRequested, time_ns);
    }

    /// Waits for the first state and frames, so that all connections stand before the loop
    /// starts. `false` when a stop came first.
    fn connect(&mut self, stop: &AtomicBool) -> bool {
        while !stop.load(Ordering::Relaxed) {
            // Only looks: a lockstep publisher's first state must get its tick in the loop.
            let Err(missing) = self.inbox.connect(self.peers.ports()) else {
                let gripper = self.inbox.gripper().unwrap_or_default();
                self.task.begin(gripper, self.last_entry.as_ref());
                return true;
            };
            let now_ns = monotonic_ns();
            self.note(self.inbox.detail(missing, now_ns));
            self.publish_status(missing, now_ns, &TickTimes::default());
            sleep_until(monotonic_ns() + CONNECT_POLL_NS);
        }
        false
    }

    /// Waits for the next tick; `None` when the loop has to end.
    fn wait(&mut self, stop: &AtomicBool) -> Option<Wake> {
        let Self { timing, inbox, peers, .. } = self;
        let pacing = timing.pacing();
        if pacing == Pacing::RealTime(Trigger::Periodic) {
            return Some(timing.wait_for_schedule(|| peers.connect_to_new()));
        }
        let blind = self.motion.is_stale();
        let wake = timing.wait_for_state(stop, blind, || inbox.receive_state(peers))?;
        let time_ns = inbox.state_time_ns().filter(|_| pacing == Pacing::Lockstep);
        Some(time_ns.map_or(wake, |time_ns| wake.at_state(time_ns)))
    }

    /// Receives the newest messages, as views into shared memory.
    fn read(&mut self, now_ns: u64) {
        if self.timing.pacing() == Pacing::RealTime(Trigger::Periodic) {
            self.inbox.receive_state(&mut self.peers);
        }
        self.inbox.receive_frames_and_command(&mut self.peers, now_ns);
    }

    /// Counts the periods that passed without a tick. When the last command has expired meanwhile,
    /// the robot has braked on its own: the arm is not where the reference is.
    fn check_gap(&mut self, wake: &Wake) {
        if self.timing.pacing() == Pacing::Lockstep {
            return;
        }
        self.timing.overruns.begin(wake.skipped);
        if self.outbox.has_expired(wake.now_ns) {
            self.motion.robot_brakes();
            self.braking_for = Some(Reason::CommandExpired);
        }
    }

    /// Takes what was asked for from outside since the last tick.
    fn take_requests(&mut self, dt: f64, now_ns: u64) {
        if self.supervisor.take(&self.shared.requests) {
            self.frozen.forget();
        }
        let fraction = dt / (dt + SETTING_TIME_S);
        for setting in Setting::ALL {
            let Some(target) = self.shared.requests.setting(setting) else { continue };
            let value = match setting {
                Setting::LinearMax => &mut self.policy.governor().linear_max_m_s,
                Setting::AngularMax => &mut self.policy.governor().angular_max_rad_s,
                Setting::NaturalFrequency => &mut self.motion.impedance().natural_frequency_rad_s,
                Setting::DampingRatio => &mut self.motion.impedance().damping_ratio,
                Setting::PointSpeedMax => {
                    let Some(limits) = self.motion.point_limits() else { continue };
                    &mut limits.speed_max_m_s
                }
            };
            *value += (target - *value) * fraction;
        }
        let Self { policy, workspace, task, inbox, exchange, .. } = self;
        if let Some(exchange) = exchange {
            exchange.take(|new| {
                *new.policy.governor() = *policy.governor();
                new.scene.keep_obstacles(&inbox.scene);
                core::mem::swap(policy, &mut new.policy);
                core::mem::swap(workspace, &mut new.workspace);
                core::mem::swap(&mut inbox.scene, &mut new.scene);
                inbox.update_scene(now_ns);
                task.set_skill(policy.moved(), policy.is_periodic());
                task.interrupt();
            });
        }
    }

    /// Begins to stop when that was asked for, or the task has been done for long enough.
    fn check_stop(&mut self, stop: &AtomicBool, now_ns: u64) {
        let done = self.until_done && self.task.done_for_ns(now_ns) >= DONE_NS;
        if done || stop.load(Ordering::Relaxed) {
            self.stopping_since_ns.get_or_insert(now_ns);
        }
    }

    /// The joints as measured, where the newest state can be believed. Done in every tick: what
    /// brakes the arm must see where it is.
    fn measure(&mut self, now_ns: u64) -> Result<JointState<N>, Reason> {
        let measured = self.inbox.measured(now_ns);
        self.time_stands = matches!(measured, Err(Reason::StateTimeStuck));
        let (joints, time_ns) = measured?;
        self.motion.observe(&joints, time_ns);
        let asked = self.outbox.commanded().map(|(position, velocity)| Asked {
            position,
            velocity,
            missing: self.motion.missing_acceleration(),
        });
        self.frozen.update(&joints.position, time_ns, asked)?;
        Ok(joints)
    }

    /// What the gripper holds counts: its mass, its shape, and that it is no obstacle.
    fn hold(&mut self, measured: Option<&JointState<N>>, now_ns: u64, dt: f64) {
        let Self { motion, policy, workspace, inbox, .. } = self;
        let holds = inbox.gripper() == Ok(GripperState::Holding);
        motion.hold(holds, dt);
        workspace.hold(holds);
        if let Some(state) = measured {
            inbox.hold(holds, || policy.tool_pose(&state.position, workspace), now_ns);
        }
    }

    /// What was seen beside this reason, which the arm is brought to rest for.
    fn detail_of(&self, reason: Reason, measured: Option<&JointState<N>>, now_ns: u64) -> Detail {
        match (reason, measured, self.frozen.found()) {
            (Reason::PositionsFrozen, _, Some(found)) => *found,
            (Reason::JointLimit | Reason::JointReturning, Some(state), _) => {
                let [lower, upper] = &self.motion.limits().position_end;
                let position = state.position.as_slice();
                Detail::beyond(reason, position, lower.as_slice(), upper.as_slice())
            }
            (Reason::QuaternionOrder | Reason::StartElsewhere, ..) => self.detail,
            _ => self.inbox.detail(reason, now_ns),
        }
    }

    /// Keeps a detail for other threads, and gives its reason. One with nothing to add replaces none of the same reason: what it was
    /// about may have passed, while the arm still comes to rest.
    fn note(&mut self, detail: Detail) -> Reason {
        let same = detail.reason == self.detail.reason;
        if same && (detail.about == About::Nothing || self.supervisor.check_fault().is_err()) {
            return detail.reason;
        }
        self.detail = detail;
        self.telemetry.note(&detail);
        let Inbox { scene, .. } = &self.inbox;
        self.shared.detail.write(&detail, scene.needed(), self.inbox.found_frames());
        detail.reason
    }

    /// The state from which the policy may be followed, or why it may not.
    fn permit(
        &mut self,
        measured: Result<JointState<N>, Reason>,
        now_ns: u64,
        dt: f64,
    ) -> Result<JointState<N>, Reason> {
        self.lasts = true;
        let robot_permits = self.inbox.robot_permits();
        if robot_permits.is_err() {
            self.motion.robot_brakes();
        }
        if self.stopping_since_ns.is_some() {
            return Err(Reason::StopRequested);
        }
        self.supervisor.check_fault()?;
        robot_permits?;
        let state = measured?;
        if !self.motion.limits().permit_return(&state.position) {
            return Err(Reason::JointLimit);
        }
        self.inbox.check_scene(now_ns)?;
        if self.timing.overruns.stop() {
            return Err(Reason::Overrun);
        }
        self.task.check_gripper(self.inbox.gripper()?, dt)?;
        self.supervisor.check_request()?;
        if !self.motion.is_inside(&state) {
            return Err(Reason::JointReturning);
        }
        // Whatever has gone wrong: first to rest, then on.
        self.lasts = false;
        if !self.motion.may_follow(&state) {
            return Err(self.braking_for.unwrap_or(Reason::ArmElsewhere));
        }
        self.braking_for = None;
        Ok(state)
    }

    /// Evaluates the policy, limits its acceleration and prepares the command. Gives why the task
    /// makes no progress, if it does not.
    fn follow_policy(
        &mut self,
        state: &JointState<N>,
        dt: f64,
        now_ns: u64,
    ) -> Result<Reason, Reason> {
        self.lasts = true;
        let gripper = self.inbox.gripper()?;
        if self.motion.is_holding() {
            self.workspace.restart();
        }
        if let Some(external) = &mut self.inbox.external {
            if self.motion.is_holding() {
                external.restart();
            }
            external.advance(now_ns, dt);
        }
        // Where the arm will be, at the time at which the frames are seen.
        let ahead = self.motion.ahead(state);
        let (q, qd) = (&ahead.position, &ahead.velocity);
        if self.inbox.awaits_start() {
            let tool = self.policy.tool_pose(q, &mut self.workspace);
            self.inbox.start_at(&tool, now_ns).map_err(|detail| self.note(detail))?;
        }
        let parameters = self.inbox.parameters(dt);
        let decision = self
            .policy
            .evaluate(q, qd, &self.task.task(), &parameters, &mut self.workspace)
            .map_err(|_| Reason::ResolveFailed)?;
        if self.motion.is_holding()
            && let Some(detail) = self.inbox.order_of_start(&decision.tool)
        {
            return Err(self.note(detail));
        }
        let chain = self.policy.chain();
        let setpoint = {
            let closing_1_s = decision.proximity.closing_1_s;
            self.motion.follow(chain, state, &decision.acceleration, closing_1_s, dt)?
        };
        self.workspace.advance(&setpoint.asked, dt);
        self.shared.status.write_choice(self.workspace.choice().as_ref());
        self.outbox.set(&setpoint);
        let (life_cycle, remaining) =
            self.task.advance(gripper, &decision.tool, &decision.goal, now_ns, dt);
        self.outbox.set_remaining(&remaining, decision.energy);
        self.rounds.update(decision.rounds, remaining.distance_m, dt);
        let gripping = self.task.gripper() == GripperCommand::Grip;
        self.shared.task.store(gripping, self.task.lift_goal());
        Ok(self.detect_stall(state, life_cycle, &remaining, &decision, dt))
    }

    fn detect_stall(
        &mut self,
        state: &JointState<N>,
        life_cycle: LifeCycle,
        remaining: &Remaining,
        decision: &Decision<N>,
        dt: f64,
    ) -> Reason {
        let goal_frame = &self.inbox.scene.frames()[self.inbox.scene.goal_frame()];
        let from_frame = decision.goal.position - goal_frame.pose.position;
        let progress = Progress {
            speed: state.velocity.amax(),
            distance_m: remaining.distance_m,
            rounds: decision.rounds,
            energy: decision.energy,
            goal_speed_m_s: goal_frame.fixed_point(from_frame).first().length(),
            awaits_gripper: self.task.awaits_gripper(),
        };
        let commanded = self.inbox.external.as_ref().is_some_and(ExternalCommand::is_active);
        self.stall.update(life_cycle, &progress, &decision.proximity, commanded, dt)
    }

    /// Prepares a command that brings the arm to rest for this reason and holds it there, or lets the robot
    /// brake.
    fn brake(&mut self, measured: Option<JointState<N>>, reason: Reason, dt: f64) -> CommandMode {
        self.braking_for = Some(reason);
        self.task.interrupt();
        // What the arm has only to come to rest from has been looked at, or has passed.
        if self.lasts {
            self.supervisor.fail(reason);
        }
        // What was fed back so far was wrong: the robot brakes on its own, at once. In lockstep it does where no time
        // passes, in which the arm could be brought to rest.
        let misled = matches!(
            reason,
            Reason::VelocityUnbelievable | Reason::PositionsFrozen | Reason::JointOrder
        );
        let stands = self.time_stands && self.timing.pacing() == Pacing::Lockstep;
        if misled && self.lasts {
            self.motion.was_misled();
        } else if stands {
            self.motion.robot_brakes();
        }
        // Whether the arm makes progress is judged anew once it goes on.
        self.stall = StallDetector::default();
        let returns = reason == Reason::JointReturning;
        let fallback = if returns { None } else { self.fall_back(measured, reason, dt) };
        if let Some(setpoint) = fallback {
            self.outbox.set(&setpoint);
            return CommandMode::Hold;
        }
        match self.motion.brake(self.policy.chain(), measured, returns, dt) {
            Some((setpoint, mode)) => {
                self.outbox.set(&setpoint);
                mode
            }
            None => CommandMode::Stop,
        }
    }

    /// What the arm does in place of holding, once it was brought to rest, while the reason lasts.
    fn fall_back(
        &mut self,
        measured: Option<JointState<N>>,
        reason: Reason,
        dt: f64,
    ) -> Option<Setpoint<N>> {
        let state = measured.filter(|_| self.lasts && self.motion.may_leave_rest())?;
        // Where somebody asked for a hold, or nobody for a start, or no obstacles are known, it does not go anywhere
        // else for the sake of its frames.
        let frames = kind(reason) == Kind::Frames;
        if frames && (self.supervisor.check_request().is_err() || !self.inbox.scene.is_known()) {
            return None;
        }
        let retreat = match (self.supervisor.fallback(reason), kind(reason)) {
            (Fallback::Hold, _) => return None,
            (Fallback::GravityOnly, _) => {
                return self.motion.give_way(self.policy.chain(), &state, dt);
            }
            (Fallback::Retreat(_), Kind::Frames) => Retreat::Frames,
            (Fallback::Retreat(_), _) => Retreat::Request,
        };
        let Self { policy, workspace, motion, inbox, .. } = self;
        let parameters = TaskParameters { external: None, ..inbox.parameters(dt) };
        let at = (&state.position, &state.velocity);
        let resolved = policy.retreat(retreat, at, &parameters, workspace).ok()??;
        let closing_1_s = resolved.proximity.closing_1_s;
        motion.retreat(policy.chain(), &state, &resolved.acceleration, closing_1_s, dt)
    }

    /// Whether a stop was asked for and the arm rests, or the longest time for it has passed.
    fn has_stopped(&self, measured: Option<JointState<N>>, now_ns: u64) -> bool {
        self.stopping_since_ns.is_some_and(|since_ns| {
            let stopping_s = now_ns.saturating_sub(since_ns) as f64 * 1e-9;
            self.motion.has_stopped(measured, stopping_s)
        })
    }

    fn publish_command(&mut self, mode: CommandMode, reason: Reason, now_ns: u64) {
        let Self { task, inbox, outbox, peers, .. } = self;
        let turns = inbox.turns();
        let answered = (inbox.state_sequence(), turns.as_slice());
        outbox.publish_command(peers, (mode, reason), task.gripper(), answered, now_ns);
    }

    /// Counts the tick, publishes the status and connects to new peers.
    fn record(&mut self, wake: &Wake, milestones: &Milestones, reason: Reason) {
        let Milestones { read_ns, evaluated_ns } = *milestones;
        let published_ns = monotonic_ns();
        let timed = self.timing.pacing() != Pacing::Lockstep;
        // A state that was refused was not used.
        let used_ns = self.inbox.state_time_ns().filter(|_| kind(reason) == Kind::Following);
        let tick = TickRecord {
            time_ns: published_ns,
            times: TickTimes {
                wake_up_ns: wake.late_ns,
                state_age_ns: used_ns.map(|time_ns| wake.now_ns.saturating_sub(time_ns)),
                receiving_ns: read_ns - wake.woke_ns,
                evaluation_ns: evaluated_ns - read_ns,
                publishing_ns: published_ns - evaluated_ns,
            },
            missed: timed && (published_ns > wake.deadline_ns || wake.skipped > 0),
            skipped: if timed { wake.skipped } else { 0 },
            reason,
        };
        self.timing.overruns.end(tick.missed, self.motion.is_settled());
        self.telemetry.record(&tick);
        self.publish_status(reason, published_ns, &tick.times);
        self.peers.connect_to_new();
    }

    fn publish_status(&mut self, reason: Reason, now_ns: u64, times: &TickTimes) {
        let (task, is_new) = (self.task.life_cycle(), self.motion.is_new());
        let life_cycle = self.supervisor.life_cycle(reason, task, is_new);
        let Self { outbox, peers, telemetry, inbox, .. } = self;
        let measured = (times, inbox.states_lost());
        outbox.publish_status(peers, (life_cycle, reason), telemetry, measured, now_ns);
    }
}
