//! The newest messages, and how far they are believed.

use tprmp_messages::{
    ControllerPorts, GripperState, Reason, RobotMode, RobotState, STATE_BUFFER, Sample, Subscriber,
    TaskFrames,
};
use tprmp_model::controller_config::{ControllerConfig, FrameObserver, Loop};
use tprmp_robot::Chain;

use crate::inputs::estimator::{JointState, StateEstimator};
use crate::inputs::external::ExternalCommand;
use crate::inputs::scene::Scene;
use crate::peers::Peers;
use crate::timing::realtime::monotonic_ns;

/// The newest messages, as views into shared memory, and what their checks gave.
#[derive(Debug)]
pub struct Inbox<const N: usize> {
    state: Option<Sample<RobotState>>,
    frames: Option<Sample<TaskFrames>>,
    /// The frames and obstacles that were believed last.
    pub scene: Scene,
    /// What is commanded from outside; `None` for a controller that does not listen.
    pub external: Option<ExternalCommand>,
    scene_check: Result<(), Reason>,
    estimator: StateEstimator<N>,
    /// In lockstep states are received when they were measured.
    lockstep: bool,
    frame_observer: FrameObserver,
    frames_age_max_ns: u64,
}

impl<const N: usize> Inbox<N> {
    /// Nothing has arrived yet.
    #[must_use]
    pub fn new(scene: Scene, chain: &Chain<N>, config: &ControllerConfig, lockstep: bool) -> Self {
        let Loop { state_age_max_ns, states_lost_in_a_row_max, .. } = config.cycle;
        Self {
            state: None,
            frames: None,
            scene,
            external: config.external.as_ref().map(ExternalCommand::new),
            scene_check: Err(Reason::FrameMissing),
            estimator: StateEstimator::new(
                *chain.velocity_max(),
                state_age_max_ns,
                states_lost_in_a_row_max.into(),
            ),
            lockstep,
            frame_observer: config.frame_observer,
            frames_age_max_ns: config.cycle.frames_age_max_ns,
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
            self.state = Some(state);
        }
        let frames = ports.frames.receive();
        let connected = ports.update_connections();
        self.frames = frames.or(self.frames.take());
        match (&self.state, &self.frames) {
            (None, _) => Err(Reason::StateStale),
            (Some(_), Some(_)) if connected => {
                self.update_scene();
                Ok(())
            }
            _ => Err(Reason::FrameMissing),
        }
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
        if let Some(frames) = peers.exchange(|ports| ports.frames.receive()) {
            self.frames = Some(frames);
            self.update_scene();
        }
        if let Some(external) = &mut self.external {
            let newest =
                |ports: &ControllerPorts| ports.tool_command.as_ref().and_then(Subscriber::receive);
            if let Some(command) = peers.exchange(newest) {
                external.update(&command, now_ns);
            }
        }
    }

    /// Reads the newest frames again, for a scene that needs others.
    pub fn update_scene(&mut self) {
        if let Some(frames) = &self.frames {
            self.scene_check = self.scene.update(frames, &self.frame_observer);
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
        let frames = self.frames.as_ref().ok_or(Reason::FrameMissing)?;
        if now_ns.abs_diff(frames.time_ns) > self.frames_age_max_ns {
            return Err(Reason::FramesStale);
        }
        Ok(())
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
