//! From a URDF file to the description of a serial chain.

use std::collections::HashMap;
use std::path::Path;

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;
use urdf_rs::{Geometry, Joint, JointType, Link, Pose, Robot};

use crate::description::{
    ChainDescription, CollisionGeometry, CollisionShape, JointDescription, JointKind, JointLimits,
    JointModel,
};
use crate::document;
use crate::error::{UrdfError, UrdfErrorKind as Kind};
use crate::inertia::SpatialInertia;
use crate::placement::Placement;

/// Fewest movable joints of a chain.
pub const JOINTS_MIN: usize = 2;
/// Most movable joints of a chain.
pub const JOINTS_MAX: usize = 8;

/// Largest file [bytes]; descriptions of whole humanoids have some hundred thousand.
const BYTES_MAX: u64 = 4 << 20;
// Larger numbers are typing errors, or made to overflow: far beyond any arm, and products of several stay finite.
/// Largest mass of a link [kg].
const MASS_MAX_KG: f64 = 1e5;
/// Largest entry of a link's rotational inertia [kg m²].
const INERTIA_MAX_KG_M2: f64 = 1e7;
/// Largest coordinate and dimension [m].
const LENGTH_MAX_M: f64 = 1e3;
/// Largest angle of an origin [rad]: the sine of a larger one has lost its digits.
const ANGLE_MAX_RAD: f64 = 1e6;
/// Largest speed limit [rad/s or m/s].
const SPEED_LIMIT_MAX: f64 = 1e6;
/// Largest torque or force limit [N m or N].
const EFFORT_LIMIT_MAX: f64 = 1e9;
/// Position limits farther away than this are none [rad or m]; files write 1e16 for that.
const POSITION_LIMIT_MAX: f64 = 1e18;

/// Smallest principal moment accepted, as a factor of the largest: room for rounded figures.
const PRINCIPAL_MOMENT_MIN: f64 = -1e-9;

/// Number of movable joints of the selected chain, to choose the `N` of
/// [`crate::Chain`] at run time: from [`JOINTS_MIN`] to [`JOINTS_MAX`].
///
/// # Errors
///
/// [`UrdfError`] when the file cannot be read, the path has an unsupported joint, or the number is
/// out of range. Limits, inertias and shapes are left to [`crate::Chain::from_urdf`].
pub fn count_joints(
    file: impl AsRef<Path>,
    selection: impl Into<Selection>,
) -> Result<usize, UrdfError> {
    let (file, selection) = (file.as_ref(), selection.into());
    read(file)
        .and_then(|robot| count(&robot, &selection))
        .map_err(|kind| UrdfError { file: file.to_owned(), kind })
}

fn count(robot: &Robot, selection: &Selection) -> Result<usize, Kind> {
    let tree = Tree::new(robot, selection)?;
    let tool_link = &selection.tool_link;
    let mut found = 0;
    for joint in tree.path_to(tool_link)? {
        found += usize::from(tree.joint_kind(joint)?.is_some());
    }
    if (JOINTS_MIN..=JOINTS_MAX).contains(&found) {
        Ok(found)
    } else {
        let (tool_link, min, max) = (tool_link.clone(), JOINTS_MIN, JOINTS_MAX);
        Err(Kind::JointCountRange { tool_link, min, max, found })
    }
}

/// Which chain of a URDF is the robot.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// Link that is the base `B`; the root of the file when `None`. What lies above it is left out.
    pub base_link: Option<String>,
    /// Link at the end of the chain, the tool `E`.
    pub tool_link: String,
    /// Joints that are held at zero, as if they were fixed: those of a gripper, for example.
    pub held_joints: Vec<String>,
}

impl From<&str> for Selection {
    /// From the root of the file to `tool_link`, no joint held.
    fn from(tool_link: &str) -> Self {
        Self { tool_link: tool_link.to_owned(), ..Self::default() }
    }
}

/// Reads and parses the file.
pub(crate) fn read(file: &Path) -> Result<Robot, Kind> {
    let text = tprmp_files::read_text(file, BYTES_MAX).map_err(Kind::NotReadable)?;
    document::check(&text)?;
    urdf_rs::read_from_string(&text)
        .map_err(|error| Kind::NotUrdf(tprmp_files::shortened(&error.to_string())))
}

/// Where a link is fixed: the joint that moves it (none: the base) and its placement in that frame.
#[derive(Clone, Copy)]
struct Anchor {
    joint: Option<usize>,
    placement: Placement,
}

/// Checks the robot and folds it into the selected chain.
pub(crate) fn describe(robot: &Robot, selection: &Selection) -> Result<ChainDescription, Kind> {
    let tree = Tree::new(robot, selection)?;
    let tool_link = selection.tool_link.as_str();
    let path = tree.path_to(tool_link)?;
    let base = Anchor { joint: None, placement: Placement::IDENTITY };
    let mut chain = ChainDescription {
        root_link: tree.root.to_owned(),
        tool_link: tool_link.to_owned(),
        joints: Vec::new(),
        links: Vec::new(),
        link_placements: Vec::new(),
        tool: base.placement,
        collision_shapes: Vec::new(),
    };
    // Depth first from the root; each link is visited once, as it has one parent.
    let mut open = vec![(tree.root, base)];
    while let Some((name, anchor)) = open.pop() {
        add_link(&mut chain, tree.links[name], &anchor)?;
        if name == tool_link {
            chain.tool = anchor.placement;
        }
        // In reverse, so that links come in the order of the file.
        for joint in tree.children(name).rev() {
            let origin = placement("joint", &joint.name, &joint.origin)?;
            let at_zero = Anchor { placement: anchor.placement.compose(&origin), ..anchor };
            let on_path = path.iter().any(|other| other.name == joint.name);
            let child = match tree.joint_kind(joint) {
                Ok(None) => at_zero,
                // The path is walked from the root, so joints come in its order.
                Ok(Some(kind)) if on_path => add_joint(&mut chain, joint, kind, &at_zero)?,
                Err(error) if on_path => return Err(error),
                _ => {
                    return Err(Kind::MovableBranch {
                        joint: joint.name.clone(),
                        found: type_name(joint),
                        tool_link: tool_link.to_owned(),
                    });
                }
            };
            open.push((joint.child.link.as_str(), child));
        }
    }
    Ok(chain)
}

/// Adds what is fixed to a link to the joint that moves it.
fn add_link(chain: &mut ChainDescription, link: &Link, anchor: &Anchor) -> Result<(), Kind> {
    let inertia = link_inertia(link)?;
    let shapes = link_shapes(link)?;
    let Some(joint) = anchor.joint else { return Ok(()) };
    let body = &mut chain.joints[joint].model.inertia;
    *body = body.plus(&inertia.moved(&anchor.placement));
    for (placement, geometry) in shapes {
        let (link, placement) = (chain.links.len(), anchor.placement.compose(&placement));
        chain.collision_shapes.push(CollisionShape { link, joint, placement, geometry });
    }
    chain.links.push((link.name.clone(), joint));
    chain.link_placements.push(anchor.placement);
    Ok(())
}

/// Adds a joint whose URDF frame is at `at_zero` at q = 0; returns where that frame is in the joint's own.
fn add_joint(
    chain: &mut ChainDescription,
    joint: &Joint,
    kind: JointKind,
    at_zero: &Anchor,
) -> Result<Anchor, Kind> {
    let rotation = joint_frame(unit_axis(joint)?);
    let axis = Placement { rotation, position: DVec3::ZERO };
    chain.joints.push(JointDescription {
        name: joint.name.clone(),
        limits: joint_limits(joint)?,
        model: JointModel {
            kind,
            placement: at_zero.placement.compose(&axis),
            inertia: SpatialInertia::ZERO,
        },
    });
    let back = Placement { rotation: rotation.transpose(), ..axis };
    Ok(Anchor { joint: Some(chain.joints.len() - 1), placement: back })
}

/// The links and joints of a file, checked to be a tree.
struct Tree<'a> {
    robot: &'a Robot,
    links: HashMap<&'a str, &'a Link>,
    /// The parent joint of each link but the root.
    parents: HashMap<&'a str, &'a Joint>,
    /// The base.
    root: &'a str,
    held: &'a [String],
}

impl<'a> Tree<'a> {
    fn new(robot: &'a Robot, selection: &'a Selection) -> Result<Self, Kind> {
        let mut links = HashMap::new();
        for link in &robot.links {
            if links.insert(link.name.as_str(), link).is_some() {
                return Err(Kind::DuplicateName { element: "link", name: link.name.clone() });
            }
        }
        let mut names = HashMap::new();
        let mut parents = HashMap::new();
        for joint in &robot.joints {
            if names.insert(joint.name.as_str(), ()).is_some() {
                return Err(Kind::DuplicateName { element: "joint", name: joint.name.clone() });
            }
            for (role, link) in [("parent", &joint.parent.link), ("child", &joint.child.link)] {
                if !links.contains_key(link.as_str()) {
                    let (joint, link) = (joint.name.clone(), link.clone());
                    return Err(Kind::UnknownLink { joint, role, link });
                }
            }
            let child = joint.child.link.as_str();
            if let Some(first) = parents.insert(child, joint) {
                return Err(Kind::TwoParents {
                    link: child.to_owned(),
                    first: first.name.clone(),
                    second: joint.name.clone(),
                });
            }
        }
        let roots: Vec<&str> = robot
            .links
            .iter()
            .map(|link| link.name.as_str())
            .filter(|name| !parents.contains_key(name))
            .collect();
        let [root] = roots[..] else {
            return Err(Kind::RootCount { found: roots.into_iter().map(str::to_owned).collect() });
        };
        let held = &selection.held_joints;
        if let Some(joint) = held.iter().find(|name| !names.contains_key(name.as_str())) {
            let found = robot.joints.iter().map(|joint| joint.name.clone()).collect();
            return Err(Kind::UnknownHeldJoint { joint: joint.clone(), found });
        }
        let mut tree = Self { robot, links, parents, root, held };
        for link in &robot.links {
            tree.path_to(&link.name)?;
        }
        if let Some(base) = &selection.base_link {
            let link = robot.links.iter().find(|link| link.name == *base);
            tree.root = &link
                .ok_or_else(|| Kind::UnknownBaseLink {
                    base_link: base.clone(),
                    found: robot.links.iter().map(|link| link.name.clone()).collect(),
                })?
                .name;
        }
        Ok(tree)
    }

    /// How the joint moves; `None` for a fixed one or one that is held.
    fn joint_kind(&self, joint: &Joint) -> Result<Option<JointKind>, Kind> {
        if self.held.contains(&joint.name) { Ok(None) } else { joint_kind(joint) }
    }

    /// The joints from the base to `tool_link`, in that order.
    fn path_to(&self, tool_link: &str) -> Result<Vec<&'a Joint>, Kind> {
        if !self.links.contains_key(tool_link) {
            return Err(Kind::UnknownToolLink {
                tool_link: tool_link.to_owned(),
                found: self.robot.links.iter().map(|link| link.name.clone()).collect(),
            });
        }
        let mut path = Vec::new();
        let mut link = tool_link;
        while let Some(joint) = self.parents.get(link).filter(|_| link != self.root) {
            // A path without a loop has fewer joints than the file has links.
            if path.len() >= self.links.len() {
                return Err(Kind::ClosedLoop { link: link.to_owned() });
            }
            path.push(*joint);
            link = joint.parent.link.as_str();
        }
        if link != self.root {
            return Err(Kind::NotAbove {
                base_link: self.root.to_owned(),
                tool_link: tool_link.to_owned(),
            });
        }
        path.reverse();
        Ok(path)
    }

    /// The joints whose parent is `link`.
    fn children(&self, link: &str) -> impl DoubleEndedIterator<Item = &'a Joint> {
        self.robot.joints.iter().filter(move |joint| joint.parent.link == link)
    }
}

fn type_name(joint: &Joint) -> &'static str {
    match joint.joint_type {
        _ if joint.mimic.is_some() => "mimic",
        JointType::Revolute => "revolute",
        JointType::Continuous => "continuous",
        JointType::Prismatic => "prismatic",
        JointType::Fixed => "fixed",
        JointType::Floating => "floating",
        JointType::Planar => "planar",
        JointType::Spherical => "spherical",
    }
}

/// How the joint moves; `None` for a fixed one.
fn joint_kind(joint: &Joint) -> Result<Option<JointKind>, Kind> {
    match joint.joint_type {
        JointType::Fixed => Ok(None),
        JointType::Revolute | JointType::Continuous if joint.mimic.is_none() => {
            Ok(Some(JointKind::Revolute))
        }
        JointType::Prismatic if joint.mimic.is_none() => Ok(Some(JointKind::Prismatic)),
        _ => Err(Kind::UnsupportedJoint { joint: joint.name.clone(), found: type_name(joint) }),
    }
}

fn unit_axis(joint: &Joint) -> Result<DVec3, Kind> {
    bounded("joint", &joint.name, "axis xyz", &joint.axis.xyz.0, LENGTH_MAX_M)?;
    let axis = DVec3::from_array(joint.axis.xyz.0);
    axis.try_normalize().ok_or_else(|| Kind::ZeroAxis { joint: joint.name.clone() })
}

/// The orientation of the joint frame in the URDF's frame: z along `axis`, the identity for +z.
fn joint_frame(axis: DVec3) -> DMat3 {
    let (x, y) = axis.any_orthonormal_pair();
    DMat3::from_cols(x, y, axis)
}

fn joint_limits(joint: &Joint) -> Result<JointLimits, Kind> {
    let name = || joint.name.clone();
    let limit = &joint.limit;
    let numbers = [limit.lower, limit.upper, limit.velocity, limit.effort];
    for (number, most) in numbers.iter().zip([
        POSITION_LIMIT_MAX,
        POSITION_LIMIT_MAX,
        SPEED_LIMIT_MAX,
        EFFORT_LIMIT_MAX,
    ]) {
        bounded("joint", &joint.name, "limit", &[*number], most)?;
    }
    if numbers == [0.0; 4] {
        return Err(Kind::NoLimits { joint: name() });
    }
    let (speed, effort) = match joint.joint_type {
        JointType::Prismatic => ("m/s", "N"),
        _ => ("rad/s", "N m"),
    };
    for (limit, unit, found) in
        [("velocity", speed, limit.velocity), ("effort", effort, limit.effort)]
    {
        if found <= 0.0 {
            return Err(Kind::LimitNotPositive { joint: name(), limit, unit, found });
        }
    }
    let (lower, upper) = match joint.joint_type {
        JointType::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
        _ => (limit.lower, limit.upper),
    };
    if lower >= upper {
        return Err(Kind::LimitOrder { joint: name(), lower, upper });
    }
    Ok(JointLimits { lower, upper, velocity: limit.velocity, effort: limit.effort })
}

/// Inertia of a link in its own frame.
fn link_inertia(link: &Link) -> Result<SpatialInertia, Kind> {
    let mass = link.inertial.mass.value;
    bounded("link", &link.name, "mass", &[mass], MASS_MAX_KG)?;
    if mass < 0.0 {
        return Err(Kind::NegativeMass { link: link.name.clone(), found: mass });
    }
    let i = &link.inertial.inertia;
    let entries = [i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz];
    bounded("link", &link.name, "inertia", &entries, INERTIA_MAX_KG_M2)?;
    let rows = [[i.ixx, i.ixy, i.ixz], [i.ixy, i.iyy, i.iyz], [i.ixz, i.iyz, i.izz]];
    let moments = Matrix3::from(rows).symmetric_eigenvalues();
    if moments.min() < PRINCIPAL_MOMENT_MIN * moments.amax() {
        return Err(Kind::NegativeInertia { link: link.name.clone(), found: moments.min() });
    }
    let Placement { rotation, position } = placement("link", &link.name, &link.inertial.origin)?;
    let tensor = rotation * DMat3::from_cols_array_2d(&rows) * rotation.transpose();
    Ok(SpatialInertia::from_centre(mass, position, tensor))
}

/// Collision shapes of a link in its own frame.
fn link_shapes(link: &Link) -> Result<Vec<(Placement, CollisionGeometry)>, Kind> {
    let dimension = |dimension, found: f64| {
        bounded("link", &link.name, "collision geometry", &[found], LENGTH_MAX_M)?;
        if found > 0.0 {
            Ok(found)
        } else {
            Err(Kind::DimensionNotPositive { link: link.name.clone(), dimension, found })
        }
    };
    link.collision
        .iter()
        .map(|collision| {
            let placement = placement("link", &link.name, &collision.origin)?;
            let geometry = match &collision.geometry {
                Geometry::Cylinder { radius, length } => CollisionGeometry::Cylinder {
                    radius: dimension("radius", *radius)?,
                    length: dimension("length", *length)?,
                },
                Geometry::Capsule { radius, length } => CollisionGeometry::Capsule {
                    radius: dimension("radius", *radius)?,
                    length: dimension("length", *length)?,
                },
                Geometry::Sphere { radius } => {
                    CollisionGeometry::Sphere { radius: dimension("radius", *radius)? }
                }
                Geometry::Box { size } => CollisionGeometry::Box {
                    size: DVec3::new(
                        dimension("size", size[0])?,
                        dimension("size", size[1])?,
                        dimension("size", size[2])?,
                    ),
                },
                Geometry::Mesh { .. } => CollisionGeometry::Mesh,
            };
            Ok((placement, geometry))
        })
        .collect()
}

/// The placement of an `<origin>`: rotation about x (roll), then y (pitch), then z (yaw) of the parent.
fn placement(element: &'static str, name: &str, origin: &Pose) -> Result<Placement, Kind> {
    bounded(element, name, "origin xyz", &origin.xyz.0, LENGTH_MAX_M)?;
    bounded(element, name, "origin rpy", &origin.rpy.0, ANGLE_MAX_RAD)?;
    let [roll, pitch, yaw] = origin.rpy.0;
    let rotation =
        DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
    Ok(Placement { rotation, position: DVec3::from_array(origin.xyz.0) })
}

/// Refuses what is not finite, or larger than `most`.
fn bounded(
    element: &'static str,
    name: &str,
    quantity: &'static str,
    numbers: &[f64],
    most: f64,
) -> Result<(), Kind> {
    // Not a number is not at most anything.
    let beyond = numbers.iter().find(|number| !number.is_finite() || number.abs() > most);
    beyond.map_or(Ok(()), |&found| {
        let name = name.to_owned();
        Err(if found.is_finite() {
            Kind::TooLarge { element, name, quantity, most, found }
        } else {
            Kind::NotFinite { element, name, quantity, found }
        })
    })
}
