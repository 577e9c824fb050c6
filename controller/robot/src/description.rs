//! What is read of a robot: joints, links and collision shapes of a chain of any length.

use glam::DVec3;
use tprmp_spatial::Pose;

use crate::inertia::SpatialInertia;
use crate::placement::Placement;

/// How a joint moves. A continuous joint is a revolute one with infinite position limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Rotates about z of its joint frame [rad].
    Revolute,
    /// Slides along z of its joint frame [m].
    Prismatic,
}

/// What the algorithms need of one joint and of the body it moves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointModel {
    pub(crate) kind: JointKind,
    /// This joint frame at q = 0 in the joint frame before it (the base for the first).
    pub(crate) placement: Placement,
    /// All links fixed to this joint's moving side, in this joint frame.
    pub(crate) inertia: SpatialInertia,
}

/// Limits of one joint as read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointLimits {
    pub(crate) lower: f64,
    pub(crate) upper: f64,
    pub(crate) velocity: f64,
    pub(crate) effort: f64,
}

/// One movable joint as read.
#[derive(Debug)]
pub(crate) struct JointDescription {
    pub(crate) name: String,
    pub(crate) model: JointModel,
    pub(crate) limits: JointLimits,
}

/// A chain of any length, as read from the file.
#[derive(Debug)]
pub(crate) struct ChainDescription {
    pub(crate) root_link: String,
    pub(crate) tool_link: String,
    pub(crate) joints: Vec<JointDescription>,
    pub(crate) links: Vec<(String, usize)>,
    /// Each link in the frame of its joint.
    pub(crate) link_placements: Vec<Placement>,
    pub(crate) tool: Placement,
    pub(crate) collision_shapes: Vec<CollisionShape>,
}

/// A collision primitive, centred at its pose. Lengths in m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CollisionGeometry {
    /// Axis along z, flat ends.
    Cylinder {
        /// Radius [m].
        radius: f64,
        /// Length [m].
        length: f64,
    },
    /// Axis along z, round ends beyond `length`.
    Capsule {
        /// Radius [m].
        radius: f64,
        /// Length without the round ends [m].
        length: f64,
    },
    /// Sphere.
    Sphere {
        /// Radius [m].
        radius: f64,
    },
    /// Box.
    Box {
        /// Full edge lengths [m].
        size: DVec3,
    },
    /// A mesh: read so that the kinematics of such a robot can be used, but it cannot be covered by
    /// spheres.
    Mesh,
}

/// A collision primitive fixed to a moving link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionShape {
    /// Index into [`Chain::moving_links`].
    pub link: usize,
    /// Index of the joint that moves it.
    pub joint: usize,
    /// Centre and axes in that joint's frame.
    pub(crate) placement: Placement,
    /// Shape.
    pub geometry: CollisionGeometry,
}

impl CollisionShape {
    /// Its centre [m] and axes in the frame of the joint that moves it.
    pub fn pose(&self) -> Pose {
        self.placement.pose()
    }
}
