//! A URDF as a tree of links and joints, as it stands in the file: what is drawn, simulated or
//! transmitted is left out.
//!
//! A value that cannot be read is a fault of the document. Whether it matters depends on which chain of
//! the file is used, so that such a document can be looked at all the same: [`Document::faults`] has what
//! is missing from it.

use std::path::PathBuf;

use glam::{DMat3, DVec3};
use tprmp_spatial::Pose;
pub use urdf_rs::JointType;

use crate::error::UrdfFault;
use crate::placement::Placement;

/// The links and joints of a URDF, as they stand in the file. Whether they make up a tree is not
/// judged, nor are the numbers: they may be infinite, zero or negative.
#[derive(Debug, Clone)]
pub struct Document {
    /// The file.
    pub file: PathBuf,
    /// Links, in the order of the file.
    pub links: Vec<Link>,
    /// Joints, in the order of the file.
    pub joints: Vec<Joint>,
    /// What could not be read. Its place in the tree is empty: it has the URDF's default, or is missing.
    pub faults: Vec<DocumentFault>,
}

/// A value that could not be read.
#[derive(Debug, Clone)]
pub struct DocumentFault {
    /// The link or joint it belongs to.
    pub owner: Owner,
    /// The element of it, `inertial`, `collision`, `origin` or `limit` for one.
    pub part: &'static str,
    /// What is wrong.
    pub fault: UrdfFault,
}

/// A link or a joint, by its index in the document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Owner {
    /// Index into [`Document::links`].
    Link(usize),
    /// Index into [`Document::joints`].
    Joint(usize),
}

/// A link.
#[derive(Debug, Clone)]
pub struct Link {
    /// Its name.
    pub name: String,
    /// Line on which it begins.
    pub line: usize,
    /// Mass and inertia; `None` where the file has none.
    pub inertial: Option<Inertial>,
    /// Its collision shapes.
    pub collisions: Vec<Collision>,
    /// Whether it is drawn, or has collision shapes: more than a frame.
    pub has_body: bool,
}

/// Mass and inertia of a link.
#[derive(Debug, Clone, Copy)]
pub struct Inertial {
    /// Mass [kg].
    pub mass: f64,
    /// Centre of mass and axes of the inertia, in the link's frame.
    pub origin: Origin,
    /// Rotational inertia about the centre of mass, symmetric [kg m²].
    pub inertia: [[f64; 3]; 3],
}

/// A collision shape of a link.
#[derive(Debug, Clone)]
pub struct Collision {
    /// Its place in the link's frame.
    pub origin: Origin,
    /// What it is.
    pub shape: Shape,
}

/// A shape, centred at its origin.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
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
        size: [f64; 3],
    },
    /// A mesh in a file of its own.
    Mesh {
        /// The file, as the URDF names it: a path, `package://` or `file://`.
        filename: String,
        /// Factors of the mesh's coordinates; a negative one mirrors it.
        scale: [f64; 3],
    },
}

/// Where something is, in the frame of what it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// Position [m].
    pub xyz: [f64; 3],
    /// Rotation about x (roll), then y (pitch), then z (yaw) of the parent [rad].
    pub rpy: [f64; 3],
}

impl Origin {
    /// As a pose.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.placement().pose()
    }

    /// Its rotation.
    #[must_use]
    pub fn rotation(&self) -> DMat3 {
        let [roll, pitch, yaw] = self.rpy;
        DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll)
    }

    pub(crate) fn placement(&self) -> Placement {
        Placement { rotation: self.rotation(), position: DVec3::from_array(self.xyz) }
    }
}

impl From<urdf_rs::Pose> for Origin {
    fn from(pose: urdf_rs::Pose) -> Self {
        Self { xyz: pose.xyz.0, rpy: pose.rpy.0 }
    }
}

/// A joint.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Its name.
    pub name: String,
    /// Line on which it begins.
    pub line: usize,
    /// How it moves; see `mimic` too.
    pub joint_type: JointType,
    /// Name of its parent link.
    pub parent: String,
    /// Name of its child link.
    pub child: String,
    /// The child link's frame in the parent's, at zero.
    pub origin: Origin,
    /// Its axis, in the child link's frame; of any length.
    pub axis: [f64; 3],
    /// Its limits.
    pub limit: Limit,
    /// The soft position limits, of `<safety_controller>` [rad or m].
    pub soft_limits: Option<[f64; 2]>,
    /// The joint that it follows.
    pub mimic: Option<Mimic>,
    /// Viscous damping [N m s/rad or N s/m] and Coulomb friction [N m or N].
    pub dynamics: Option<Dynamics>,
}

impl Joint {
    /// Whether it moves at all.
    #[must_use]
    pub fn is_movable(&self) -> bool {
        self.joint_type != JointType::Fixed
    }

    /// The word of the file for how it moves, or `mimic`.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        match self.joint_type {
            _ if self.mimic.is_some() => "mimic",
            JointType::Revolute => "revolute",
            JointType::Continuous => "continuous",
            JointType::Prismatic => "prismatic",
            JointType::Fixed => "fixed",
            JointType::Floating => "floating",
            JointType::Planar => "planar",
            JointType::Spherical => "spherical",
        }
    }
}

/// Limits of a joint, each `None` where the file has none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Limit {
    /// Line of the element, where there is one.
    pub line: Option<usize>,
    /// Lower position limit [rad or m].
    pub lower: Option<f64>,
    /// Upper position limit [rad or m].
    pub upper: Option<f64>,
    /// Speed limit [rad/s or m/s].
    pub velocity: Option<f64>,
    /// Torque or force limit [N m or N].
    pub effort: Option<f64>,
}

/// A joint that follows another: q = multiplier · q_other + offset.
#[derive(Debug, Clone, PartialEq)]
pub struct Mimic {
    /// The joint it follows.
    pub joint: String,
    /// Factor.
    pub multiplier: f64,
    /// Offset [rad or m].
    pub offset: f64,
}

/// What resists a joint's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dynamics {
    /// Viscous damping [N m s/rad or N s/m].
    pub damping: f64,
    /// Coulomb friction [N m or N].
    pub friction: f64,
}
