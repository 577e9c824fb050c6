//! From a document to the description of a serial chain: what the chain needs is judged, and all faults
//! are found in one run.

use std::path::Path;

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

use crate::description::{
    ChainDescription, CollisionGeometry, CollisionShape, JointDescription, JointKind, JointModel,
};
use crate::document::{Document, Inertial, Joint, JointType, Link, Origin, Owner, Shape};
use crate::error::{BranchJoint, UrdfError, UrdfErrorKind as Kind, UrdfFault};
use crate::inertia::SpatialInertia;
use crate::limits::{self, Lacking};
use crate::placement::Placement;
use crate::ranges::{ANGLE_MAX_RAD, INERTIA_MAX_KG_M2, LENGTH_MAX_M, MASS_MAX_KG, bounded};
use crate::selection::{Interface, Selection};
use crate::tree::{Motion, Tree};

/// Fewest movable joints of a chain.
pub const JOINTS_MIN: usize = 2;
/// Most movable joints of a chain.
pub const JOINTS_MAX: usize = 8;

/// Smallest principal moment accepted, as a factor of the largest: room for rounded figures.
const PRINCIPAL_MOMENT_MIN: f64 = -1e-9;

/// Number of movable joints of the selected chain, to choose the `N` of
/// [`crate::Chain`] at run time: from [`JOINTS_MIN`] to [`JOINTS_MAX`].
///
/// # Errors
///
/// [`UrdfError`] with all that is wrong with the file or the selection, and when the number is out of
/// range.
pub fn count_joints(
    file: impl AsRef<Path>,
    selection: impl Into<Selection>,
) -> Result<usize, UrdfError> {
    Document::read(file)?.count_joints(&selection.into())
}

impl Document {
    /// As [`count_joints`].
    ///
    /// # Errors
    ///
    /// As [`count_joints`].
    pub fn count_joints(&self, selection: &Selection) -> Result<usize, UrdfError> {
        let of = |faults| UrdfError::of(&self.file, faults);
        let (chain, mut faults) = fold(self, selection).map_err(of)?;
        let found = chain.joints.len();
        if !(JOINTS_MIN..=JOINTS_MAX).contains(&found) {
            let (tool_link, min, max) = (selection.tool_link.clone(), JOINTS_MIN, JOINTS_MAX);
            faults.push(UrdfFault::new(Kind::JointCountRange { tool_link, min, max, found }));
        }
        if faults.is_empty() { Ok(found) } else { Err(of(faults)) }
    }
}

/// Where a link is fixed: the joint that moves it (none: the base) and its placement in that frame.
#[derive(Clone, Copy)]
struct Anchor {
    joint: Option<usize>,
    placement: Placement,
}

/// Folds a document into the selected chain.
///
/// # Errors
/// All that is wrong with what the chain needs.
pub(crate) fn describe(
    document: &Document,
    selection: &Selection,
) -> Result<ChainDescription, Vec<UrdfFault>> {
    let (chain, faults) = fold(document, selection)?;
    if faults.is_empty() { Ok(chain) } else { Err(faults) }
}

/// All that is wrong with what the chain needs.
pub(crate) fn faults_of(document: &Document, selection: &Selection) -> Vec<UrdfFault> {
    fold(document, selection).map_or_else(|faults| faults, |(_, faults)| faults)
}

/// The chain, and all that is wrong with what it needs.
///
/// # Errors
/// What keeps the file from being a tree, or the selection from being a chain of it.
fn fold(
    document: &Document,
    selection: &Selection,
) -> Result<(ChainDescription, Vec<UrdfFault>), Vec<UrdfFault>> {
    let (tree, faults) = Tree::new(document, selection)?;
    let chain = ChainDescription {
        root_link: tree.root.to_owned(),
        tool_link: selection.tool_link.clone(),
        joints: Vec::new(),
        links: Vec::new(),
        link_placements: Vec::new(),
        tool: Placement::IDENTITY,
        collision_shapes: Vec::new(),
    };
    let (lacking, branches, unstated) = (Lacking::default(), Vec::new(), Vec::new());
    let mut fold = Fold { tree, selection, chain, faults, lacking, branches, unstated };
    fold.walk();
    fold.judge_whole();
    fold.faults.sort_by_key(|fault| fault.line.unwrap_or(usize::MAX));
    Ok((fold.chain, fold.faults))
}

/// A chain that is being put together.
struct Fold<'a> {
    tree: Tree<'a>,
    selection: &'a Selection,
    chain: ChainDescription,
    faults: Vec<UrdfFault>,
    lacking: Lacking,
    /// Joints beside the path, with their indices in the document.
    branches: Vec<(usize, BranchJoint)>,
    /// For each joint: whether it moves more than frames, and the file says nothing of their mass.
    unstated: Vec<bool>,
}

impl Fold<'_> {
    /// Visits each link below the base once, depth first, as it has one parent.
    fn walk(&mut self) {
        let base = Anchor { joint: None, placement: Placement::IDENTITY };
        let mut open = vec![(self.tree.root, base)];
        while let Some((name, anchor)) = open.pop() {
            self.add_link(name, &anchor);
            // In reverse, so that links come in the order of the file.
            let children: Vec<_> = self.tree.children(name).rev().collect();
            for (index, joint) in children {
                let child = self.add_joint(index, joint, &anchor);
                open.push((joint.child.as_str(), child));
            }
        }
    }

    /// Adds what is fixed to a link to the joint that moves it.
    fn add_link(&mut self, name: &str, anchor: &Anchor) {
        if name == self.selection.tool_link {
            let offset = self.selection.tool_offset.as_ref().map(Placement::of);
            self.chain.tool = anchor.placement.compose(&offset.unwrap_or(Placement::IDENTITY));
        }
        let Some(joint) = anchor.joint else { return };
        let (index, link) = self.tree.link(name);
        let owner = Owner::Link(index);
        self.tree.faults_of(owner, &["inertial"], &mut self.faults);
        if let Some(inertial) = &link.inertial {
            let body = &mut self.chain.joints[joint].model.inertia;
            match link_inertia(link, inertial) {
                Ok(inertia) => *body = body.plus(&inertia.moved(&anchor.placement)),
                Err(kind) => self.faults.push(UrdfFault::at(link.line, kind)),
            }
        }
        let is_unread = self.tree.is_faulty(owner, "inertial");
        self.unstated[joint] |= link.has_body && link.inertial.is_none() && !is_unread;
        if !self.selection.ignores_shapes {
            self.tree.faults_of(owner, &["collision"], &mut self.faults);
            self.add_shapes(link, joint, anchor);
        }
        self.chain.links.push((link.name.clone(), joint));
        self.chain.link_placements.push(anchor.placement);
    }

    fn add_shapes(&mut self, link: &Link, joint: usize, anchor: &Anchor) {
        for collision in &link.collisions {
            let placed = placement("link", &link.name, &collision.origin);
            match placed.and_then(|placed| Ok((placed, geometry(link, &collision.shape)?))) {
                Ok((placement, geometry)) => self.chain.collision_shapes.push(CollisionShape {
                    link: self.chain.links.len(),
                    joint,
                    placement: anchor.placement.compose(&placement),
                    geometry,
                }),
                Err(kind) => self.faults.push(UrdfFault::at(link.line, kind)),
            }
        }
    }

    /// Adds a joint; returns where its child link is fixed.
    fn add_joint(&mut self, index: usize, joint: &Joint, anchor: &Anchor) -> Anchor {
        let is_on_path = self.tree.path.contains(&index);
        let is_needed = is_on_path || anchor.joint.is_some();
        let mut at_zero = *anchor;
        if is_needed {
            self.tree.faults_of(Owner::Joint(index), &["origin", "mimic"], &mut self.faults);
            match placement("joint", &joint.name, &joint.origin) {
                Ok(origin) => at_zero.placement = anchor.placement.compose(&origin),
                Err(kind) => self.faults.push(UrdfFault::at(joint.line, kind)),
            }
        }
        match self.tree.motion(index) {
            Motion::Held(position) => self.hold(index, joint, position, is_needed, at_zero),
            // The path is walked from the base, so joints come in its order.
            Motion::Free(kind) if is_on_path => self.move_by(index, joint, kind, &at_zero),
            Motion::Follows(master) if is_on_path => {
                let named = |mimic: &crate::document::Mimic| mimic.joint.clone();
                let master = master.map_or_else(
                    || joint.mimic.as_ref().map_or_else(String::new, named),
                    |master| self.tree.document.joints[master].name.clone(),
                );
                let joint_name = joint.name.clone();
                self.faults
                    .push(UrdfFault::at(joint.line, Kind::Follows { joint: joint_name, master }));
                at_zero
            }
            Motion::Unsupported if is_on_path => {
                let (joint_name, found) = (joint.name.clone(), joint.type_name());
                let kind = Kind::UnsupportedJoint { joint: joint_name, found };
                self.faults.push(UrdfFault::at(joint.line, kind));
                at_zero
            }
            Motion::Follows(Some(master)) if !self.tree.path.contains(&master) => at_zero,
            _ => {
                let position = limits::nearest_to_zero(joint);
                let (joint, found) = (joint.name.clone(), joint.type_name());
                self.branches.push((index, BranchJoint { joint, found, position }));
                at_zero
            }
        }
    }

    /// Where the child link of a fixed or held joint is.
    fn hold(
        &mut self,
        index: usize,
        joint: &Joint,
        position: f64,
        is_needed: bool,
        mut at_zero: Anchor,
    ) -> Anchor {
        let asked = self.selection.held_joints.get(&joint.name);
        if let Some(&found) = asked
            && let Some([lower, upper]) = limits::range_outside(joint, found)
        {
            let joint_name = joint.name.clone();
            let kind = Kind::HeldOutside { joint: joint_name, lower, upper, found };
            self.faults.push(UrdfFault::at(joint.line, kind));
        }
        if !is_needed || position == 0.0 {
            return at_zero;
        }
        self.tree.faults_of(Owner::Joint(index), &["axis"], &mut self.faults);
        match unit_axis(joint) {
            Ok(axis) => {
                at_zero.placement = at_zero.placement.compose(&displacement(joint, axis, position));
            }
            Err(kind) => self.faults.push(UrdfFault::at(joint.line, kind)),
        }
        at_zero
    }

    /// Adds a joint whose URDF frame is at `at_zero` at q = 0; returns where that frame is in the joint's own.
    fn move_by(
        &mut self,
        index: usize,
        joint: &Joint,
        kind: JointKind,
        at_zero: &Anchor,
    ) -> Anchor {
        self.tree.faults_of(Owner::Joint(index), &["axis"], &mut self.faults);
        let axis = unit_axis(joint).unwrap_or_else(|kind| {
            self.faults.push(UrdfFault::at(joint.line, kind));
            DVec3::Z
        });
        let given = self.selection.limits.get(&joint.name).copied().unwrap_or_default();
        let needs_effort = self.selection.interface == Interface::Effort;
        if given.position.is_none()
            || given.velocity.is_none()
            || (given.effort.is_none() && needs_effort)
        {
            let parts = ["limit", "safety_controller"];
            self.tree.faults_of(Owner::Joint(index), &parts, &mut self.faults);
        }
        let is_unread = self.tree.is_faulty(Owner::Joint(index), "limit");
        let judged = limits::limits(joint, &given, needs_effort, is_unread, &mut self.lacking);
        let limits = judged.unwrap_or_else(|(line, kind)| {
            self.faults.push(UrdfFault::at(line, kind));
            limits::UNKNOWN
        });
        let rotation = joint_frame(axis);
        let axis = Placement { rotation, position: DVec3::ZERO };
        let placement = at_zero.placement.compose(&axis);
        let model = JointModel { kind, placement, inertia: SpatialInertia::ZERO };
        self.chain.joints.push(JointDescription { name: joint.name.clone(), limits, model });
        self.unstated.push(false);
        let back = Placement { rotation: rotation.transpose(), ..axis };
        Anchor { joint: Some(self.chain.joints.len() - 1), placement: back }
    }

    /// What can be said once every link and joint was visited.
    fn judge_whole(&mut self) {
        if !self.branches.is_empty() {
            let (root_link, tool_link) = (self.tree.root.to_owned(), self.chain.tool_link.clone());
            self.branches.sort_by_key(|(index, _)| *index);
            let joints = self.branches.drain(..).map(|(_, joint)| joint).collect();
            self.faults.push(UrdfFault::new(Kind::MovableBranch { joints, root_link, tool_link }));
        }
        if let Some(kind) = std::mem::take(&mut self.lacking).fault() {
            self.faults.push(UrdfFault::new(kind));
        }
        let names: Vec<_> = self.chain.joints.iter().map(|joint| joint.name.clone()).collect();
        for joint in self.selection.limits.keys().filter(|joint| !names.contains(joint)) {
            let (joint, expected) = (joint.clone(), names.clone());
            self.faults.push(UrdfFault::new(Kind::UnknownLimitedJoint { joint, expected }));
        }
        if self.selection.interface == Interface::Effort {
            self.judge_masses();
        }
    }

    /// A torque accelerates masses: beyond each joint there is one, and none is left out.
    fn judge_masses(&mut self) {
        let (mut beyond, mut bodies) = (0.0, Vec::new());
        for (i, joint) in self.chain.joints.iter().enumerate().rev() {
            beyond += joint.model.inertia.mass;
            let is_massless = joint.model.inertia.mass == 0.0;
            if beyond == 0.0 || (is_massless && self.unstated[i]) {
                let links = self.chain.links.iter().filter(|(_, of)| *of == i);
                bodies.push((joint.name.clone(), links.map(|(name, _)| name.clone()).collect()));
            }
        }
        bodies.reverse();
        if !bodies.is_empty() {
            self.faults.push(UrdfFault::new(Kind::NoMass { bodies }));
        }
    }
}

/// The motion of a joint's child link from zero to a position.
fn displacement(joint: &Joint, axis: DVec3, position: f64) -> Placement {
    match joint.joint_type {
        JointType::Prismatic => Placement { rotation: DMat3::IDENTITY, position: axis * position },
        _ => Placement { rotation: DMat3::from_axis_angle(axis, position), position: DVec3::ZERO },
    }
}

fn unit_axis(joint: &Joint) -> Result<DVec3, Kind> {
    bounded("joint", &joint.name, "axis xyz", &joint.axis, LENGTH_MAX_M)?;
    let axis = DVec3::from_array(joint.axis);
    axis.try_normalize().ok_or_else(|| Kind::ZeroAxis { joint: joint.name.clone() })
}

/// The orientation of the joint frame in the URDF's frame: z along `axis`, the identity for +z.
fn joint_frame(axis: DVec3) -> DMat3 {
    let (x, y) = axis.any_orthonormal_pair();
    DMat3::from_cols(x, y, axis)
}

/// Inertia of a link in its own frame.
fn link_inertia(link: &Link, inertial: &Inertial) -> Result<SpatialInertia, Kind> {
    let (mass, rows) = (inertial.mass, &inertial.inertia);
    bounded("link", &link.name, "mass", &[mass], MASS_MAX_KG)?;
    if mass < 0.0 {
        return Err(Kind::NegativeMass { link: link.name.clone(), found: mass });
    }
    bounded("link", &link.name, "inertia", rows.as_flattened(), INERTIA_MAX_KG_M2)?;
    let moments = Matrix3::from(*rows).symmetric_eigenvalues();
    if moments.min() < PRINCIPAL_MOMENT_MIN * moments.amax() {
        return Err(Kind::NegativeInertia { link: link.name.clone(), found: moments.min() });
    }
    let Placement { rotation, position } = placement("link", &link.name, &inertial.origin)?;
    let tensor = rotation * DMat3::from_cols_array_2d(rows) * rotation.transpose();
    Ok(SpatialInertia::from_centre(mass, position, tensor))
}

fn geometry(link: &Link, shape: &Shape) -> Result<CollisionGeometry, Kind> {
    let dimension = |dimension, found: f64| {
        bounded("link", &link.name, "collision geometry", &[found], LENGTH_MAX_M)?;
        if found > 0.0 {
            Ok(found)
        } else {
            Err(Kind::DimensionNotPositive { link: link.name.clone(), dimension, found })
        }
    };
    Ok(match *shape {
        Shape::Cylinder { radius, length } => CollisionGeometry::Cylinder {
            radius: dimension("radius", radius)?,
            length: dimension("length", length)?,
        },
        Shape::Capsule { radius, length } => CollisionGeometry::Capsule {
            radius: dimension("radius", radius)?,
            length: dimension("length", length)?,
        },
        Shape::Sphere { radius } => {
            CollisionGeometry::Sphere { radius: dimension("radius", radius)? }
        }
        Shape::Box { size: [x, y, z] } => CollisionGeometry::Box {
            size: DVec3::new(dimension("size", x)?, dimension("size", y)?, dimension("size", z)?),
        },
        Shape::Mesh { .. } => CollisionGeometry::Mesh,
    })
}

/// The placement of an `<origin>` within its bounds.
fn placement(element: &'static str, name: &str, origin: &Origin) -> Result<Placement, Kind> {
    bounded(element, name, "origin xyz", &origin.xyz, LENGTH_MAX_M)?;
    bounded(element, name, "origin rpy", &origin.rpy, ANGLE_MAX_RAD)?;
    Ok(origin.placement())
}
