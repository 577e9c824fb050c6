//! The newest messages, and how far they are believed.

use glam::DQuat;
use nalgebra::SVector;
use tprmp_messages::{
    ControllerPorts, FrameSources, GripperState, NAME_CAPACITY, Reason, RobotMode, RobotState,
    STATE_BUFFER, Sample, Subscriber, joint_names_hash,
};
use tprmp_model::controller_config::{ControllerConfig, FrameObserver, Loop};
use tprmp_robot::Chain;
use tprmp_spatial::Pose;

use crate::detail::{About, Detail};
use crate::inputs::estimator::{JointState, StateEstimator};
use crate::inputs::external::ExternalCommand;
use crate::inputs::gripped::GrippedObstacle;
use crate::inputs::offender;
use crate::inputs::scene::{Scene, pose};
use crate::inputs::turns::ContinuousJoints;
use crate::peers::Peers;
use crate::policy::TaskParameters;
use crate::timing::realtime::monotonic_ns;

/// The tool begins at its start frame where it is nearer than this \[m\] …
const START_NEAR_M: f64 = 0.02;
/// … turned from it by more than this as the quaternion is given \[rad\] …
const START_TURNED_RAD: f64 = 0.5;
/// … and by less than this in the other order \[rad\].
const START_ALIKE_RAD: f64 = 0.05;
/// A publisher in lockstep waits for the answer to its first state: a state that stays the only one for so long
/// has one that does \[ns\].
const UNANSWERED_NS: u64 = 60_000_000;
/// So many states that came without an answer are those of a publisher that does not wait.
const UNANSWERED_MAX: u32 = 3;

/// The states that came before the first command.
#[derive(Debug, Clone, Copy, Default)]
struct FirstStates {
    sequence: u64,
    received_ns: u64,
    count: u32,
}

impl FirstStates {
    /// A state was received at the time `now_ns` \[ns\].
    fn received(&mut self, sequence: u64, now_ns: u64) {
        if self.count == 0 || self.sequence != sequence {
            *self = Self { sequence, received_ns: now_ns, count: self.count.saturating_add(1) };
        }
    }

    /// Whether the publisher waits for an answer, at the time `now_ns` \[ns\].
    ///
    /// # Errors
    /// When that is not known yet, or it does not.
    fn wait_for_answers(&mut self, now_ns: u64) -> Result<(), Reason> {
        let alone = now_ns.saturating_sub(self.received_ns) >= UNANSWERED_NS;
        match self.count {
            0 => Err(Reason::StateStale),
            _ if alone => {
                self.count = 1;
                Ok(())
            }
            count if count > UNANSWERED_MAX => Err(Reason::PublisherNotInLockstep),
            _ => Err(Reason::StateUnconfirmed),
        }
    }
}

/// The newest messages, as views into shared memory, and what their checks gave.
#[derive(Debug)]
pub struct Inbox<const N: usize> {
    state: Option<Sample<RobotState>>,
    frames: FrameSources,
    /// The frames and obstacles that were believed last.
    pub scene: Scene,
    /// What is commanded from outside; `None` for a controller that does not listen.
    pub external: Option<ExternalCommand>,
    scene_check: Result<(), Reason>,
    first: FirstStates,
    estimator: StateEstimator<N>,
    /// In lockstep states are received when they were measured.
    lockstep: bool,
    frame_observer: FrameObserver,
    gripped: Option<GrippedObstacle>,
}

impl<const N: usize> Inbox<N> {
    /// Nothing has arrived yet.
    #[must_use]
    pub fn new(scene: Scene, chain: &Chain<N>, config: &ControllerConfig, lockstep: bool) -> Self {
        let Loop { state_age_max_ns, states_lost_in_a_row_max, .. } = config.cycle;
        Self {
            state: None,
            frames: FrameSources::new(config.cycle.frames_age_max_ns),
            scene,
            external: config.external.as_ref().map(ExternalCommand::new),
            scene_check: Err(Reason::FrameMissing),
            first: FirstStates::default(),
            estimator: StateEstimator::new(
                *chain.velocity_max(),
                state_age_max_ns,
                states_lost_in_a_row_max.into(),
            )
            .of_joints(joint_names_hash(chain.joint_names()))
            .counting(ContinuousJoints::of(chain)),
            lockstep,
            frame_observer: config.frame_observer,
            gripped: config.gripped.as_ref().map(|gripped| {
                GrippedObstacle::new(gripped.centre_m.into(), gripped.obstacle_within_m)
            }),
        }
    }

    /// Looks for the first state and frames, and connects to whoever is there.
    ///
    /// # Errors
    /// What is still missing.
    pub fn connect(&mut self, ports: &ControllerPorts) -> Result<(), Reason> {
        if let Some(state) = ports.state.receive() {
            let now_ns = if self.lockstep { state.time_ns } else { monotonic_ns() };
            self.estimator.update(&state, now_ns);
            self.first.received(state.sequence, monotonic_ns());
            self.state = Some(state);
        }
        if self.lockstep {
            self.first.wait_for_answers(monotonic_ns())?;
        }
        let connected = ports.update_connections();
        let time_ns = self.state_time_ns().filter(|_| self.lockstep);
        let now_ns = time_ns.unwrap_or_else(monotonic_ns);
        self.frames.receive(&ports.frames, now_ns);
        if self.state.is_none() {
            return Err(Reason::StateStale);
        }
        if !connected || self.frames.at(now_ns).messages().next().is_none() {
            return Err(Reason::FrameMissing);
        }
        self.update_scene(now_ns);
        Ok(())
    }

    /// Receives all new states and judges each of them; whether there was one.
    pub fn receive_state(&mut self, peers: &mut Peers) -> bool {
        let Self { state, estimator, lockstep, .. } = self;
        peers.exchange(|ports| {
            let mut received = false;
            // As many as are kept: a publisher that is faster than this loop cannot hold it up.
            for _ in 0..STATE_BUFFER {
                let Some(next) = ports.state.receive() else { break };
                let now_ns = if *lockstep { next.time_ns } else { monotonic_ns() };
                estimator.update(&next, now_ns);
                *state = Some(next);
                received = true;
            }
            received
        })
    }

    /// Receives the newest frames and command from outside at the time `now_ns` \[ns\].
    pub fn receive_frames_and_command(&mut self, peers: &mut Peers, now_ns: u64) {
        let Self { frames, .. } = self;
        if peers.exchange(|ports| frames.receive(&ports.frames, now_ns)) {
            self.update_scene(now_ns);
        }
        if let Some(external) = &mut self.external {
            let newest =
                |ports: &ControllerPorts| ports.tool_command.as_ref().and_then(Subscriber::receive);
            if let Some(command) = peers.exchange(newest) {
                external.update(&command, now_ns);
            }
        }
    }

    /// Reads the newest frames again at the time `now_ns` \[ns\], for a scene that needs others.
    pub fn update_scene(&mut self, now_ns: u64) {
        self.scene_check = self.scene.update(&self.frames.at(now_ns), &self.frame_observer);
    }

    /// Whether the gripper `holds` something at the tool, at the time `now_ns` \[ns\]: then that is no obstacle.
    pub fn hold(&mut self, holds: bool, tool: impl FnOnce() -> Pose, now_ns: u64) {
        let Some(gripped) = &mut self.gripped else { return };
        if !holds {
            if gripped.release() {
                self.update_scene(now_ns);
            }
            return;
        }
        let centre = tool().transform_point(gripped.centre_m);
        if let Some(index) = gripped.find(self.scene.obstacles(), centre) {
            self.scene.leave_out(index);
        }
    }

    /// The task parameters of a tick of `dt` \[s\], as the newest messages have them.
    #[must_use]
    pub fn parameters(&self, dt: f64) -> TaskParameters<'_> {
        TaskParameters {
            frames: self.scene.frames(),
            goal_frame: self.scene.goal_frame(),
            obstacles: self.scene.obstacles(),
            external: self.external.as_ref(),
            dt_s: dt,
        }
    }

    /// The joints as measured, where the newest state can be believed at the time `now_ns` \[ns\], and
    /// when they were \[ns\].
    ///
    /// # Errors
    /// Why it cannot be believed.
    pub fn measured(&self, now_ns: u64) -> Result<(JointState<N>, u64), Reason> {
        self.estimator.measured(now_ns)
    }

    /// Whole turns by which the positions that are believed exceed those that were reported.
    #[must_use]
    pub fn turns(&self) -> SVector<f64, N> {
        self.estimator.turns()
    }

    /// What was seen beside this reason at the time `now_ns` \[ns\], as far as messages say.
    #[must_use]
    pub fn detail(&self, reason: Reason, now_ns: u64) -> Detail {
        if reason == Reason::PublisherNotInLockstep {
            let count = f64::from(self.first.count);
            return Detail::new(reason, About::Unanswered, count, [1.0, 0.0]);
        }
        if let Some(detail) = self.estimator.detail(now_ns).filter(|d| d.reason == reason) {
            return detail;
        }
        match &self.state {
            _ if reason == Reason::FramesStale || self.scene_check == Err(reason) => {
                offender::of_scene(&self.frames.at(now_ns), self.scene.needed(), reason)
            }
            Some(state) => offender::of_state(state, N, reason),
            None => Detail::plain(reason),
        }
    }

    /// Where the task's start frame lies at this tool but for the order of its quaternion: what was seen.
    #[must_use]
    pub fn order_of_start(&self, tool: &Pose) -> Option<Detail> {
        let start = self.scene.frames().first()?.pose;
        Some(order_of_start(&start, tool)?.named(&self.scene.names()[0]))
    }

    /// Whether a start frame waits for the skill to start at the tool.
    #[must_use]
    pub fn awaits_start(&self) -> bool {
        self.scene.awaits_start(self.estimator.publishers())
    }

    /// Lets the skill start at this tool, where start frames need not be published, at the time `now_ns` \[ns\].
    ///
    /// # Errors
    /// Where a start frame is published all the same, and the tool is elsewhere: what was seen.
    pub fn start_at(&mut self, tool: &Pose, now_ns: u64) -> Result<(), Detail> {
        let published = self.frames.at(now_ns);
        for frame in self.scene.published_starts(&published) {
            let start = pose(frame);
            if let Some(found) = order_of_start(&start, tool).or_else(|| elsewhere(&start, tool)) {
                return Err(found.named(&frame.name));
            }
        }
        self.scene.start_at(tool, self.estimator.publishers());
        Ok(())
    }

    /// Names of the frames that were published last.
    pub fn found_frames(&self) -> impl Iterator<Item = &[u8; NAME_CAPACITY]> {
        let messages = self.frames.at(0).messages();
        messages.flat_map(|message| message.listed().unwrap_or(&[])).map(|frame| &frame.name)
    }

    /// How many states are missing between those that arrived.
    #[must_use]
    pub fn states_lost(&self) -> u64 {
        self.estimator.lost()
    }

    /// Whether frames and obstacles can be believed at the time `now_ns` \[ns\].
    ///
    /// # Errors
    /// Why not.
    pub fn check_scene(&self, now_ns: u64) -> Result<(), Reason> {
        self.scene_check?;
        match self.frames.at(now_ns).stale(self.scene.needed()) {
            Some(_) => Err(Reason::FramesStale),
            None => Ok(()),
        }
    }

    /// Whether the robot itself permits motion; without a state it does.
    ///
    /// # Errors
    /// Why it does not.
    pub fn robot_permits(&self) -> Result<(), Reason> {
        let Some(state) = &self.state else { return Ok(()) };
        match RobotMode::from_wire(state.robot_mode) {
            Some(RobotMode::Running) if state.safety_stop == 0 => Ok(()),
            Some(RobotMode::Running) => Err(Reason::SafetyStop),
            Some(RobotMode::ProtectiveStop) => Err(Reason::ProtectiveStop),
            Some(RobotMode::EmergencyStop) => Err(Reason::EmergencyStop),
            Some(RobotMode::HandGuiding) => Err(Reason::HandGuiding),
            Some(RobotMode::Fault) | None => Err(Reason::RobotFault),
        }
    }

    /// What the gripper senses; [`GripperState::None`] without a state.
    ///
    /// # Errors
    /// When it is none of the states that there are.
    pub fn gripper(&self) -> Result<GripperState, Reason> {
        let gripper = self.state.as_ref().map_or(0, |state| state.gripper_state);
        GripperState::from_wire(gripper).ok_or(Reason::GripperUnknown)
    }

    /// Sequence number of the newest state, 0 without one.
    #[must_use]
    pub fn state_sequence(&self) -> u64 {
        self.state.as_ref().map_or(0, |state| state.sequence)
    }

    /// When the newest state was measured, `None` without one \[ns\].
    #[must_use]
    pub fn state_time_ns(&self) -> Option<u64> {
        self.state.as_ref().map(|state| state.time_ns)
    }
}

/// Where a start frame lies at the tool but for the order of its quaternion: what was seen.
fn order_of_start(start: &Pose, tool: &Pose) -> Option<Detail> {
    let near = (start.position - tool.position).length() < START_NEAR_M;
    let o = start.orientation;
    // As if w x y z had been published as x y z w.
    let other = DQuat::from_xyzw(o.w, o.x, o.y, o.z);
    let [given, other] = [o, other].map(|o| tool.orientation.angle_between(o));
    let swapped = near && given > START_TURNED_RAD && other < START_ALIKE_RAD;
    let reason = Reason::QuaternionOrder;
    swapped.then(|| Detail::new(reason, About::FrameOrder, given, [other, 0.0]))
}

/// Where a start frame is not at the tool: what was seen.
fn elsewhere(start: &Pose, tool: &Pose) -> Option<Detail> {
    let distance_m = (start.position - tool.position).length();
    let turned = tool.orientation.angle_between(start.orientation);
    let is_elsewhere = distance_m > START_NEAR_M || turned > START_TURNED_RAD;
    let about = About::StartElsewhere;
    is_elsewhere.then(|| Detail::new(Reason::StartElsewhere, about, distance_m, [turned, 0.0]))
}
