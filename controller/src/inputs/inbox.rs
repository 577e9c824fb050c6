//! The newest messages, and how far they are believed.

use tprmp_messages::{
    ControllerPorts, GripperState, Reason, RobotState, Sample, Subscriber, TaskFrames,
};
use tprmp_model::controller_config::{ControllerConfig, FrameObserver};
use tprmp_robot::Chain;

use crate::inputs::external::ExternalCommand;
use crate::inputs::scene::Scene;
use crate::inputs::state::{JointState, check_state, jumps};
use crate::peers::Peers;

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
    sequence_went_back: bool,
    last_measured: Option<(JointState<N>, u64)>,
    frame_observer: FrameObserver,
    state_age_max_ns: u64,
    frames_age_max_ns: u64,
}

impl<const N: usize> Inbox<N> {
    /// Nothing has arrived yet.
    #[must_use]
    pub fn new(scene: Scene, config: &ControllerConfig) -> Self {
        Self {
            state: None,
            frames: None,
            scene,
            external: config.external.as_ref().map(ExternalCommand::new),
            scene_check: Err(Reason::FrameMissing),
            sequence_went_back: false,
            last_measured: None,
            frame_observer: config.frame_observer,
            state_age_max_ns: config.cycle.state_age_max_ns,
            frames_age_max_ns: config.cycle.frames_age_max_ns,
        }
    }

    /// Looks for the first state and frames, and connects to whoever is there.
    ///
    /// # Errors
    /// What is still missing.
    pub fn connect(&mut self, ports: &ControllerPorts) -> Result<(), Reason> {
        let (state, frames) = (ports.state.receive(), ports.frames.receive());
        let connected = ports.update_connections();
        self.state = state.or(self.state.take());
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

    /// Receives the newest state; whether there was one.
    pub fn receive_state(&mut self, peers: &mut Peers) -> bool {
        let Some(state) = peers.exchange(|ports| ports.state.receive()) else { return false };
        self.sequence_went_back |= state.sequence <= self.state_sequence();
        self.state = Some(state);
        true
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

    fn update_scene(&mut self) {
        if let Some(frames) = &self.frames {
            self.scene_check = self.scene.update(frames, &self.frame_observer);
        }
    }

    /// The joints as measured, where the newest state can be believed at the time `now_ns` \[ns\], and
    /// when they were \[ns\].
    ///
    /// A position that jumps is not believed at once: it is in the next state, if that agrees.
    ///
    /// # Errors
    /// Why it cannot be believed.
    pub fn measure(
        &mut self,
        chain: &Chain<N>,
        now_ns: u64,
    ) -> Result<(JointState<N>, u64), Reason> {
        let state = self.state.as_ref().ok_or(Reason::StateStale)?;
        // A stamp from the future is as wrong as an old one.
        if now_ns.abs_diff(state.time_ns) > self.state_age_max_ns {
            return Err(Reason::StateStale);
        }
        let now = (check_state(state, chain)?, state.time_ns);
        let before = self.last_measured.replace(now).unwrap_or(now);
        let elapsed_s = now.1.abs_diff(before.1) as f64 * 1e-9;
        if jumps(&before.0, &now.0, elapsed_s, chain) {
            return Err(Reason::StateUnbelievable);
        }
        Ok(now)
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

    /// Whether the sequence of the states went back since this was asked the last time.
    pub fn take_sequence_went_back(&mut self) -> bool {
        core::mem::take(&mut self.sequence_went_back)
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
