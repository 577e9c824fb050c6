//! The immutable model of a serial chain.

use std::path::Path;

use glam::DVec3;
use nalgebra::SVector;

use crate::description::{
    ChainDescription, CollisionShape, JointDescription, JointKind, JointModel,
};
use crate::document::Document;
use crate::error::{UrdfError, UrdfErrorKind, UrdfFault};
use crate::payload::Payload;
use crate::placement::Placement;
use crate::selection::{PointMass, Selection};
use crate::urdf;

/// A serial chain of `N` movable joints between the root link and a tool link. Immutable.
#[derive(Debug, Clone)]
pub struct Chain<const N: usize> {
    pub(crate) joints: [JointModel; N],
    /// The tool in the last joint frame.
    pub(crate) tool: Placement,
    position_lower: SVector<f64, N>,
    position_upper: SVector<f64, N>,
    velocity_max: SVector<f64, N>,
    effort_max: SVector<f64, N>,
    root_link: String,
    tool_link: String,
    joint_names: [String; N],
    pub(crate) moving_links: Vec<(String, usize)>,
    pub(crate) link_placements: Vec<Placement>,
    collision_shapes: Vec<CollisionShape>,
}

impl<const N: usize> Chain<N> {
    /// Reads a chain: from the root of the file to a tool link, when that link is all that is
    /// given, or as a [`Selection`] says.
    ///
    /// # Errors
    ///
    /// [`UrdfError`] when the file cannot be read, is no URDF, or is not a usable chain of exactly
    /// `N` movable joints.
    pub fn from_urdf(
        file: impl AsRef<Path>,
        selection: impl Into<Selection>,
    ) -> Result<Self, UrdfError> {
        Self::from_document(&Document::read(file)?, &selection.into())
    }

    /// As [`Self::from_urdf`], of a document that was read.
    ///
    /// # Errors
    ///
    /// As [`Self::from_urdf`].
    pub fn from_document(document: &Document, selection: &Selection) -> Result<Self, UrdfError> {
        urdf::describe(document, selection)
            .and_then(|description| {
                Self::from_description(description).map_err(|kind| vec![UrdfFault::new(kind)])
            })
            .map(|chain| match &selection.payload {
                Some(body) => chain.carrying(body),
                None => chain,
            })
            .map_err(|faults| UrdfError::of(&document.file, faults))
    }

    fn carrying(mut self, body: &PointMass) -> Self {
        self.joints[N - 1].inertia = self.payload(body).with_last(self.joints[N - 1].inertia);
        self
    }

    /// A body of the tool.
    pub fn payload(&self, body: &PointMass) -> Payload {
        Payload::of(&self.tool, body)
    }

    fn from_description(description: ChainDescription) -> Result<Self, UrdfErrorKind> {
        let found = description.joints.len();
        let count = |tool_link| UrdfErrorKind::JointCount { tool_link, expected: N, found };
        let tool_link = description.tool_link;
        let joints: [JointDescription; N] =
            description.joints.try_into().map_err(|_| count(tool_link.clone()))?;
        if N == 0 {
            return Err(count(tool_link));
        }
        Ok(Self {
            position_lower: SVector::from_fn(|i, _| joints[i].limits.lower),
            position_upper: SVector::from_fn(|i, _| joints[i].limits.upper),
            velocity_max: SVector::from_fn(|i, _| joints[i].limits.velocity),
            effort_max: SVector::from_fn(|i, _| joints[i].limits.effort),
            joints: std::array::from_fn(|i| joints[i].model),
            joint_names: joints.map(|joint| joint.name),
            tool: description.tool,
            root_link: description.root_link,
            tool_link,
            moving_links: description.links,
            link_placements: description.link_placements,
            collision_shapes: description.collision_shapes,
        })
    }

    /// Name of the root link, frame `B`.
    pub fn root_link(&self) -> &str {
        &self.root_link
    }

    /// Name of the tool link, frame `E`.
    pub fn tool_link(&self) -> &str {
        &self.tool_link
    }

    /// Names of the movable joints, from the base to the tool.
    pub fn joint_names(&self) -> &[String; N] {
        &self.joint_names
    }

    /// How joint `i` moves; `None` when there is no such joint.
    pub fn joint_kind(&self, i: usize) -> Option<JointKind> {
        self.joints.get(i).map(|joint| joint.kind)
    }

    /// Links that move: their name and the index of the joint that moves them, fixed links included.
    pub fn moving_links(&self) -> &[(String, usize)] {
        &self.moving_links
    }

    /// Where `point` [m] in the frame of a moving link lies in that of the joint that moves it; `link`
    /// is an index into [`Chain::moving_links`]. `None` when there is no such link.
    pub fn in_joint_frame(&self, link: usize, point: DVec3) -> Option<DVec3> {
        self.link_placements.get(link).map(|placement| placement.transform_point(point))
    }

    /// Where `point` [m] in the tool's frame lies in that of the last joint.
    pub fn of_tool(&self, point: DVec3) -> DVec3 {
        self.tool.transform_point(point)
    }

    /// Lower position limits [rad or m]; −∞ for a continuous joint.
    pub fn position_lower(&self) -> &SVector<f64, N> {
        &self.position_lower
    }

    /// Upper position limits [rad or m]; +∞ for a continuous joint.
    pub fn position_upper(&self) -> &SVector<f64, N> {
        &self.position_upper
    }

    /// Speed limits, positive [rad/s or m/s].
    pub fn velocity_max(&self) -> &SVector<f64, N> {
        &self.velocity_max
    }

    /// Torque or force limits, positive [N m or N]; +∞ for one that is missing and not needed.
    pub fn effort_max(&self) -> &SVector<f64, N> {
        &self.effort_max
    }

    /// Collision shapes of the moving links.
    pub fn collision_shapes(&self) -> &[CollisionShape] {
        &self.collision_shapes
    }
}
