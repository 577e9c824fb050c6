//! Which chain of a URDF is the robot, and what is known of it beside the file.

use std::collections::BTreeMap;

use glam::DVec3;
use tprmp_spatial::Pose;

/// Which chain of a URDF is the robot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Selection {
    /// Link that is the base `B`; the root of the file when `None`. What lies above it is left out.
    pub base_link: Option<String>,
    /// Link at the end of the chain, the tool `E`.
    pub tool_link: String,
    /// Where the tool `E` is in that link's frame, when it is not the link itself.
    pub tool_offset: Option<Pose>,
    /// What the tool carries all the time beside what the file says, as if it were a part of the last link.
    pub payload: Option<PointMass>,
    /// Joints that are held, as if they were fixed, and where: those of a gripper, for example
    /// [rad or m]. What mimics one of them follows it.
    pub held_joints: BTreeMap<String, f64>,
    /// Limits in place of the file's.
    pub limits: BTreeMap<String, LimitOverride>,
    /// What the robot is commanded by, and so what has to be known of it.
    pub interface: Interface,
    /// Whether the collision shapes matter to nobody: then they are neither read nor judged.
    pub ignores_shapes: bool,
}

/// A body on the tool. What its mass is spread over does not count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointMass {
    /// Mass [kg].
    pub mass: f64,
    /// Centre of mass in the tool's frame `E` [m].
    pub centre: DVec3,
}

/// What a robot is commanded by.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Interface {
    /// Torques or forces: the masses and the effort limits have to be known.
    #[default]
    Effort,
    /// Positions or velocities: effort limits may be missing, and are infinite then.
    Motion,
}

/// Limits of a joint in place of those of the file, which are kept where it says `None`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LimitOverride {
    /// Lower and upper position limit [rad or m].
    pub position: Option<[f64; 2]>,
    /// Speed limit [rad/s or m/s].
    pub velocity: Option<f64>,
    /// Torque or force limit [N m or N].
    pub effort: Option<f64>,
}

impl From<&str> for Selection {
    /// From the root of the file to `tool_link`, no joint held, commanded by torques.
    fn from(tool_link: &str) -> Self {
        Self { tool_link: tool_link.to_owned(), ..Self::default() }
    }
}
