//! The shared-memory messages of tprmp and the services that carry them.
//!
//! Five publish-subscribe services an instance, each with one publisher, frames with up to
//! [`FRAME_SOURCES_MAX`], and up to eight subscribers. A slow reader never blocks the writer: it gets the newest messages, one of most services. Of states the
//! controller gets the newest [`STATE_BUFFER`], and of states and statuses an observer [`OBSERVER_BUFFER`].
//!
//! | service                          | message              | from              | to         |
//! |----------------------------------|----------------------|-------------------|------------|
//! | `<instance>/robot_state/v1`      | [`RobotState`]       | state publisher   | controller |
//! | `<instance>/task_frames/v1`      | [`TaskFrames`]       | its sources       | controller |
//! | `<instance>/joint_command/v1`    | [`JointCommand`]     | controller        | robot      |
//! | `<instance>/controller_status/v1`| [`ControllerStatus`] | controller        | anyone     |
//! | `<instance>/tool_command/v1`     | [`ToolCommand`]      | teleoperation, …  | controller |
//!
//! The last one exists only while it is commanded, or a controller listens. Beside them,
//! `<instance>/control/v1` carries a [`ControlRequest`] to the controller and its [`ControlAnswer`] back.
//!
//! Conventions: SI units, quaternions `w, x, y, z`, poses and velocities expressed in the robot's
//! base frame `B`, times on `CLOCK_MONOTONIC` in nanoseconds (a lockstep publisher may use its own
//! simulated clock: no consumer assumes a rate or an epoch).
//!
//! iceoryx2 compares only type name, size and alignment when a service is opened: the version
//! stands in the type name, padding is explicit and asserted by the macros of `layout.rs`, which write the tables
//! that `controller layout` prints.
//!
//! A state publisher (`examples/state_publisher.rs` is one that moves):
//!
//! ```
//! use tprmp_messages::{Action, Bounds, Frame, Instance, StatePublisher, TaskFrames, monotonic_ns};
//!
//! let instance = Instance::new("readme-example")?;
//! let mut robot = StatePublisher::open(&instance, &["x_joint", "y_joint"], Bounds::default())?;
//! let mut frames = TaskFrames { frame_count: 1, ..Default::default() };
//! frames.frames[0] = Frame::at("end", [2.0, 1.0, 0.0])?;
//! for _ in 0..3 {
//!     let now_ns = monotonic_ns();
//!     robot.state.position[0] = 0.1; // as measured
//!     robot.publish(now_ns, &mut frames)?;
//!     match robot.command(now_ns) {
//!         Action::Obey(_) => println!("apply {:?} N m", robot.guard().command().torque),
//!         Action::Brake(_) => println!("brake"),
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bounds;
mod checks;
mod control;
mod error;
mod files;
pub mod guard;
mod layout;
mod messages;
mod ports;
mod publisher;
mod services;
mod shared_memory;
mod sources;
mod stop;

pub use bounds::{
    FRAME_SOURCES_MAX, ICEORYX2_VERSION, OBSERVER_BUFFER, SERVICES, STATE_BUFFER, ServiceBounds,
    ServiceLayout,
};
pub use checks::{
    FRAME_DISTANCE_MAX_M, NUMBER_MAX, NameFault, QUATERNION_TOLERANCE, is_usable, joint_names_hash,
    name_bytes, name_str, quaternion_length,
};
pub use control::{
    ControlAnswer, ControlClient, ControlRequest, ControlServer, ControlVerb, TEXT_CAPACITY,
    control_text,
};
pub use error::ServiceError;
pub use files::{Cleaned, PREFIX, ROOT};
pub use guard::{Action, Bounds, Cause, CommandFault, CommandGuard, Counts, JointBounds, Setpoint};
pub use layout::{EnumLayout, FieldLayout, MessageLayout, Scalar, ValueLayout};
pub use messages::{
    CommandMode, ControllerStatus, FRAME_CAPACITY, Frame, GripperCommand, GripperState,
    JOINT_CAPACITY, JointCommand, LifeCycle, NAME_CAPACITY, OBSTACLE_CAPACITY, Obstacle,
    ObstacleKind, Reason, RobotMode, RobotState, TaskFrames, ToolCommand,
};
pub use ports::{
    ControllerPorts, FrameSourcePort, FramesPort, ObserverPorts, Publisher, Sample,
    StatePublisherPorts, StatusPort, Subscriber, ToolCommandPort,
};
pub use publisher::{StatePublisher, monotonic_ns};
pub use services::Instance;
pub use shared_memory::{SHARED_MEMORY_MIN_BYTES, SharedMemoryFault, free_shared_memory_bytes};
pub use sources::{Claim, FrameSources, PublishedFrames, source_text};
pub use stop::stop_flag;

/// Every message, those within others first.
pub const MESSAGES: &[MessageLayout] = &[
    RobotState::LAYOUT,
    Frame::LAYOUT,
    Obstacle::LAYOUT,
    TaskFrames::LAYOUT,
    JointCommand::LAYOUT,
    ToolCommand::LAYOUT,
    ControllerStatus::LAYOUT,
    ControlRequest::LAYOUT,
    ControlAnswer::LAYOUT,
];

/// Every enum in a message.
pub const ENUMS: &[EnumLayout] = &[
    GripperState::LAYOUT,
    RobotMode::LAYOUT,
    GripperCommand::LAYOUT,
    CommandMode::LAYOUT,
    LifeCycle::LAYOUT,
    Reason::LAYOUT,
    ObstacleKind::LAYOUT,
    ControlVerb::LAYOUT,
];

/// Numbers that publishers in other languages need, by their names.
pub const CONSTANTS: &[(&str, usize)] = &[
    ("JOINT_CAPACITY", JOINT_CAPACITY),
    ("FRAME_CAPACITY", FRAME_CAPACITY),
    ("OBSTACLE_CAPACITY", OBSTACLE_CAPACITY),
    ("NAME_CAPACITY", NAME_CAPACITY),
    ("TEXT_CAPACITY", TEXT_CAPACITY),
    ("FRAME_SOURCES_MAX", FRAME_SOURCES_MAX),
    ("STATE_BUFFER", STATE_BUFFER),
    ("OBSERVER_BUFFER", OBSERVER_BUFFER),
];
