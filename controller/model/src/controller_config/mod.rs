//! The controller's configuration: which robot, how the loop runs, which leaves, which limits.
//!
//! Every key is required and none has a default: a missing or unknown key is an error that names
//! the file, the key and what was expected. That holds for keys that may be `None` too. Paths are
//! relative to the file in which they stand.
//!
//! A file may name a base, `base: "base/arm_pick.ron"`: its own keys then stand in a layer above
//! the base's, and override them key by key. Lists are overridden as a whole. A base has no base.

mod check;
mod config;
mod drives;
mod error;
mod layers;
mod leaves;
mod payload;
mod read;
mod supervision;

pub use config::{
    Capability, ControlPoint, ControllerConfig, Done, FrameObserver, JointLimit, Loop, PointLimits,
    RealTime, Robot, StartFrame, Stop, ToolOffset, Trigger,
};
pub use drives::{Actuators, Disturbance, Impedance, JointDrives, Load, Servo};
pub use error::{ConfigError, Fault, Problem};
pub use leaves::{
    Collision, ExemptObstacle, Exemption, Extent, External, Lift, Moves, PostureLeaf,
    SelfCollision, SkillLeaf,
};
pub use payload::{Gripped, Payload, Sphere};
pub use read::{read, read_with};
pub use supervision::{Fallback, Fallbacks, Start, Supervision};
