//! The shared-memory messages of tprmp and the services that carry them.
//!
//! Four publish-subscribe services an instance, each with one publisher, up to eight subscribers
//! and only the newest message kept, so that a reader always gets the newest and a slow reader
//! never holds the writer up:
//!
//! | service                          | message              | from              | to         |
//! |----------------------------------|----------------------|-------------------|------------|
//! | `<instance>/robot_state/v1`      | [`RobotState`]       | state publisher   | controller |
//! | `<instance>/task_frames/v1`      | [`TaskFrames`]       | state publisher   | controller |
//! | `<instance>/joint_command/v1`    | [`JointCommand`]     | controller        | robot      |
//! | `<instance>/controller_status/v1`| [`ControllerStatus`] | controller        | anyone     |
//!
//! Conventions: SI units, quaternions `w, x, y, z`, poses and velocities expressed in the robot's
//! base frame `B`, times on `CLOCK_MONOTONIC` in nanoseconds (a lockstep publisher may use its own
//! simulated clock: no consumer assumes a rate or an epoch).
//!
//! iceoryx2 compares only type name, size and alignment when a service is opened: the version
//! stands in the type name, padding is explicit and every offset is asserted in [`layout`].

mod layout;
mod messages;
mod services;

pub use layout::{FieldLayout, LAYOUT};
pub use messages::{
    CommandMode, ControllerStatus, FRAME_CAPACITY, Frame, GripperCommand, GripperState,
    JOINT_CAPACITY, JointCommand, LifeCycle, NAME_CAPACITY, OBSTACLE_CAPACITY, Obstacle,
    ObstacleKind, Reason, RobotState, TaskFrames, name_bytes, name_str,
};
pub use services::{
    ControllerPorts, Instance, Publisher, SHARED_MEMORY_MIN_BYTES, Sample, ServiceError,
    StatePublisherPorts, Subscriber, free_shared_memory_bytes,
};
