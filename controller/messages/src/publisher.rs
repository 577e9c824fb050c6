//! What every state publisher needs: ports, a guard, counted and stamped messages.

use rustix::time::{ClockId, clock_gettime};

use crate::checks::joint_names_hash;
use crate::error::ServiceError;
use crate::guard::{Action, Bounds, CommandGuard};
use crate::messages::{JOINT_CAPACITY, RobotState, TaskFrames};
use crate::ports::{FrameSourcePort, StatePublisherPorts};
use crate::services::Instance;

/// The present on CLOCK_MONOTONIC \[ns\]: what states, frames and commands are stamped with.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// A state publisher: whoever moves a robot asks it what to do, and tells it where the robot is.
#[derive(Debug)]
pub struct StatePublisher {
    /// What is published next: set what was measured, the rest is set already.
    pub state: RobotState,
    ports: StatePublisherPorts,
    guard: CommandGuard,
}

impl StatePublisher {
    /// Opens the ports of an instance, for a robot of these joints that obeys within these bounds.
    ///
    /// # Errors
    /// See [`ServiceError`]; more than eight joints, and a second publisher of states are some.
    pub fn open(
        instance: &Instance,
        joints: &[impl AsRef<str>],
        bounds: Bounds,
    ) -> Result<Self, ServiceError> {
        if joints.is_empty() || joints.len() > JOINT_CAPACITY {
            return Err(ServiceError::JointCount(joints.len()));
        }
        let state = RobotState {
            joint_count: joints.len() as u32,
            joint_names_hash: joint_names_hash(joints),
            ..RobotState::default()
        };
        let ports = instance.open_state_publisher()?;
        Ok(Self { state, ports, guard: CommandGuard::new(joints.len(), bounds) })
    }

    /// What the robot shall do at the time `now_ns` \[ns\]: obey the newest command, or brake.
    pub fn command(&mut self, now_ns: u64) -> Action {
        let new = self.ports.command.receive();
        self.guard.judge(now_ns, new.as_deref(), &self.state)
    }

    /// Publishes frames, then the state: whoever waits for the state finds both. Counts them and stamps them with
    /// `now_ns` \[ns\], when they were measured.
    ///
    /// # Errors
    /// [`ServiceError::NotSent`] where shared memory refuses a message.
    pub fn publish(&mut self, now_ns: u64, frames: &mut TaskFrames) -> Result<(), ServiceError> {
        (frames.sequence, frames.time_ns) = (frames.sequence + 1, now_ns);
        sent(self.ports.frames.publish(*frames))?;
        self.publish_state(now_ns)
    }

    /// Publishes the state alone, where all frames come from other sources.
    ///
    /// # Errors
    /// As [`Self::publish`].
    pub fn publish_state(&mut self, now_ns: u64) -> Result<(), ServiceError> {
        (self.state.sequence, self.state.time_ns) = (self.state.sequence + 1, now_ns);
        sent(self.ports.state.publish(self.state))
    }

    /// Which commands were obeyed, and why others were not.
    #[must_use]
    pub fn guard(&self) -> &CommandGuard {
        &self.guard
    }
}

impl FrameSourcePort {
    /// Publishes frames, counted and stamped with `now_ns` \[ns\], when they were measured.
    ///
    /// # Errors
    /// As [`StatePublisher::publish`].
    pub fn publish(&self, now_ns: u64, frames: &mut TaskFrames) -> Result<(), ServiceError> {
        (frames.sequence, frames.time_ns) = (frames.sequence + 1, now_ns);
        sent(self.frames.publish(*frames))
    }
}

fn sent(sent: bool) -> Result<(), ServiceError> {
    if sent { Ok(()) } else { Err(ServiceError::NotSent) }
}
