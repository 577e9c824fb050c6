//! The ports of an instance: what sends, what receives, and who has which of them.

use core::fmt::Debug;

use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;

use crate::files::Files;
use crate::messages::{ControllerStatus, JointCommand, RobotState, TaskFrames, ToolCommand};

/// A sample received from shared memory, without a copy.
pub type Sample<M> = iceoryx2::sample::Sample<ipc::Service, M, ()>;

/// Sends messages of type `M`.
#[derive(Debug)]
pub struct Publisher<M: Debug + ZeroCopySend + 'static>(
    pub(crate) iceoryx2::port::publisher::Publisher<ipc::Service, M, ()>,
);

impl<M: Debug + ZeroCopySend + Copy + 'static> Publisher<M> {
    /// Writes one message into shared memory and hands it to every subscriber; `false` when
    /// iceoryx2 refused. No allocation and no system call once connections stand.
    #[must_use]
    pub fn publish(&self, message: M) -> bool {
        match self.0.loan_uninit() {
            Ok(sample) => sample.write_payload(message).send().is_ok(),
            Err(_) => false,
        }
    }

    /// Connects to new subscribers: costs allocations, so it is called in the slack of
    /// a cycle. `false` when a connection failed.
    #[must_use]
    pub fn update_connections(&self) -> bool {
        self.0.update_connections().is_ok()
    }
}

/// Receives messages of type `M`: the newest of each publisher, an observer's states one after the other.
#[derive(Debug)]
pub struct Subscriber<M: Debug + ZeroCopySend + 'static>(
    pub(crate) iceoryx2::port::subscriber::Subscriber<ipc::Service, M, ()>,
);

impl<M: Debug + ZeroCopySend + 'static> Subscriber<M> {
    /// The oldest message that is kept and was not received yet, as a view into shared memory; where
    /// one is kept, it is the newest. An error of the connection counts as no message: liveness is judged
    /// by the age of the last one.
    #[must_use]
    pub fn receive(&self) -> Option<Sample<M>> {
        self.0.receive().ok().flatten()
    }

    /// Connects to a new publisher: costs allocations, so it is called in the slack of a
    /// cycle. `false` when a connection failed.
    #[must_use]
    pub fn update_connections(&self) -> bool {
        self.0.update_connections().is_ok()
    }
}

/// Fields are dropped in this order: first the node goes, then what it left behind.
#[derive(Debug)]
pub(crate) struct NodeGuard {
    pub(crate) node: Node<ipc::Service>,
    #[expect(dead_code, reason = "dropped after the node")]
    pub(crate) leftovers: Leftovers,
}

#[derive(Debug)]
pub(crate) struct Leftovers(pub(crate) Files);

impl Drop for Leftovers {
    fn drop(&mut self) {
        self.0.remove_leftovers();
    }
}

/// The controller's ports. Dropped, they leave no files behind.
#[derive(Debug)]
pub struct ControllerPorts {
    /// Newest robot state.
    pub state: Subscriber<RobotState>,
    /// Newest task frames and obstacles of each source: [`FrameSources`](crate::FrameSources) keeps them.
    pub frames: Subscriber<TaskFrames>,
    /// Joint commands.
    pub command: Publisher<JointCommand>,
    /// Status of the controller.
    pub status: Publisher<ControllerStatus>,
    /// Newest external command; `None` for a controller that does not listen.
    pub tool_command: Option<Subscriber<ToolCommand>>,
    pub(crate) node: NodeGuard,
}

impl ControllerPorts {
    /// Connects to new peers. Costs nothing when there are none. `false` when a connection
    /// failed.
    #[must_use]
    pub fn update_connections(&self) -> bool {
        self.command.update_connections()
            & self.status.update_connections()
            & self.state.update_connections()
            & self.frames.update_connections()
            & self.tool_command.as_ref().is_none_or(Subscriber::update_connections)
    }
}

/// The ports of a state publisher. Dropped, they leave no files behind.
#[derive(Debug)]
pub struct StatePublisherPorts {
    /// Robot state.
    pub state: Publisher<RobotState>,
    /// Task frames and obstacles.
    pub frames: Publisher<TaskFrames>,
    /// Newest joint command.
    pub command: Subscriber<JointCommand>,
    /// Newest status of the controller.
    pub status: Subscriber<ControllerStatus>,
    pub(crate) _node: NodeGuard,
}

/// The ports of an observer. Dropped, they leave no files behind.
#[derive(Debug)]
pub struct ObserverPorts {
    /// Robot states, each of them while no more than [`OBSERVER_BUFFER`](crate::OBSERVER_BUFFER) wait.
    pub state: Subscriber<RobotState>,
    /// Newest task frames and obstacles of each source: [`FrameSources`](crate::FrameSources) keeps them.
    pub frames: Subscriber<TaskFrames>,
    pub(crate) _node: NodeGuard,
}

/// The port of an external command. Dropped, it leaves no files behind.
#[derive(Debug)]
pub struct ToolCommandPort {
    /// Desired velocities.
    pub command: Publisher<ToolCommand>,
    pub(crate) _node: NodeGuard,
}

/// The port of a reader of the controller's status. Dropped, it leaves no files
/// behind.
#[derive(Debug)]
pub struct StatusPort {
    /// Statuses, each of them while no more than [`OBSERVER_BUFFER`](crate::OBSERVER_BUFFER) wait.
    pub status: Subscriber<ControllerStatus>,
    pub(crate) _node: NodeGuard,
}

/// The port of a source of frames and obstacles. Dropped, it leaves no files behind.
#[derive(Debug)]
pub struct FrameSourcePort {
    /// Frames and obstacles of this source.
    pub frames: Publisher<TaskFrames>,
    pub(crate) _node: NodeGuard,
}

/// The port of a reader of frames and obstacles. Dropped, it leaves no files behind.
#[derive(Debug)]
pub struct FramesPort {
    /// Newest frames and obstacles of each source.
    pub frames: Subscriber<TaskFrames>,
    pub(crate) _node: NodeGuard,
}
