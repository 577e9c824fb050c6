//! The collision shapes of a URDF's links, as triangles and spheres in the links' frames.

use std::path::Path;

use glam::{DAffine3, DVec3};
use tprmp_robot::document::{DocumentFault, Joint, JointType, Origin, Owner, Shape};
use tprmp_robot::{Document, Selection, UrdfFault};

use crate::error::CoverError;
use crate::mesh::{self, MeshFault};
use crate::packages::Packages;
use crate::primitives;
use crate::spheres::Sphere;
use crate::triangle::Triangle;
use crate::{MissingMesh, primitives::EXCESS};

/// What has to be covered of a link.
#[derive(Debug, Default)]
pub(crate) struct LinkShapes {
    pub(crate) link: String,
    pub(crate) meshes: usize,
    pub(crate) primitives: usize,
    pub(crate) missing: Vec<MissingMesh>,
    pub(crate) triangles: Vec<Triangle>,
    /// Balls, which cover themselves.
    pub(crate) spheres: Vec<Sphere>,
    /// Around these balls: not to be covered, but to be seen and met.
    pub(crate) balls: Vec<Triangle>,
    /// The triangles of round primitives lie outside them by so much at most \[m\].
    pub(crate) excess: f64,
}

/// Reads a URDF.
pub(crate) fn read(file: &Path) -> Result<Document, CoverError> {
    Document::read(file).map_err(|error| not_usable(file, &error.faults))
}

fn not_usable<'a>(file: &Path, faults: impl IntoIterator<Item = &'a UrdfFault>) -> CoverError {
    let texts: Vec<_> = faults.into_iter().map(ToString::to_string).collect();
    CoverError::Urdf { file: file.to_owned(), text: texts.join("\n") }
}

/// A robot description.
pub(crate) struct Description<'d> {
    pub(crate) document: &'d Document,
}

impl Description<'_> {
    /// Refuses shapes of these links, and joints, that could not be read: they are missing from the document.
    pub(crate) fn check_shapes(&self, names: &[&str]) -> Result<(), CoverError> {
        let Document { file, links, faults, .. } = self.document;
        let matters = |fault: &&DocumentFault| match fault.owner {
            Owner::Link(link) => {
                fault.part == "collision" && names.contains(&links[link].name.as_str())
            }
            Owner::Joint(_) => true,
        };
        let faults: Vec<_> = faults.iter().filter(matters).map(|fault| &fault.fault).collect();
        if faults.is_empty() { Ok(()) } else { Err(not_usable(file, faults)) }
    }

    /// The links that move, in the order of the file: those with a joint between them and the base that is
    /// movable and not held.
    pub(crate) fn moving_links(
        &self,
        selection: Option<&Selection>,
    ) -> Result<Vec<&str>, CoverError> {
        let Document { file, links, .. } = self.document;
        let (base, tool) =
            (base(selection), selection.map(|selection| selection.tool_link.as_str()));
        for name in base.into_iter().chain(tool) {
            if links.iter().all(|link| link.name != name) {
                let found = links.iter().map(|link| link.name.clone()).collect();
                return Err(CoverError::UnknownLink {
                    file: file.clone(),
                    link: name.to_owned(),
                    found,
                });
            }
        }
        let held = selection.map(|selection| &selection.held_joints);
        // With a tool the joints beside the path to it stand still.
        let on_path = tool.and_then(|tool| self.above(tool, base));
        let moves = |joint: &&Joint| {
            joint.is_movable()
                && !held.is_some_and(|held| held.contains_key(&joint.name))
                && on_path
                    .as_ref()
                    .is_none_or(|path| path.iter().any(|other| other.name == joint.name))
        };
        let names = links.iter().map(|link| link.name.as_str());
        Ok(names
            .filter(|link| self.above(link, base).is_some_and(|path| path.iter().any(moves)))
            .collect())
    }

    /// The joints from a link up to the base; `None` when the base is not above it, or the joints go round.
    fn above<'a>(&'a self, link: &'a str, base: Option<&str>) -> Option<Vec<&'a Joint>> {
        let (mut path, mut at) = (Vec::new(), link);
        while Some(at) != base {
            match self.document.joints.iter().find(|joint| joint.child == at) {
                Some(joint) if path.len() < self.document.joints.len() => {
                    path.push(joint);
                    at = &joint.parent;
                }
                None if base.is_none() => break,
                _ => return None,
            }
        }
        Some(path)
    }

    /// Where a link is in the base, all joints in the middle of their ranges.
    pub(crate) fn placement(&self, link: &str, selection: Option<&Selection>) -> DAffine3 {
        let path = self.above(link, base(selection)).unwrap_or_default();
        path.iter().rev().fold(DAffine3::IDENTITY, |place, joint| {
            let [lower, upper] =
                [joint.limit.lower, joint.limit.upper].map(Option::unwrap_or_default);
            let middle = 0.5 * (lower + upper);
            let axis = DVec3::from_array(joint.axis).normalize_or(DVec3::Z);
            let motion = match joint.joint_type {
                _ if !middle.is_finite() => DAffine3::IDENTITY,
                JointType::Revolute => DAffine3::from_axis_angle(axis, middle),
                JointType::Prismatic => DAffine3::from_translation(axis * middle),
                _ => DAffine3::IDENTITY,
            };
            place * placement(&joint.origin) * motion
        })
    }

    /// The collision shapes of a link, of its meshes their convex hulls where those are asked for.
    pub(crate) fn shapes(&self, link: &str, packages: &Packages, hulls: bool) -> LinkShapes {
        let mut shapes = LinkShapes { link: link.to_owned(), ..LinkShapes::default() };
        let folder = self.document.file.parent().unwrap_or(Path::new(""));
        let of_link = self.document.links.iter().filter(|other| other.name == link);
        let collisions = of_link.flat_map(|link| &link.collisions);
        for collision in collisions {
            let placement = placement(&collision.origin);
            let mut add = |triangles: Vec<Triangle>, radius: f64| {
                let moved = triangles
                    .iter()
                    .map(|triangle| triangle.map(|corner| placement.transform_point3(corner)));
                shapes.triangles.extend(moved);
                shapes.excess = shapes.excess.max(radius * EXCESS);
            };
            match &collision.shape {
                Shape::Box { size } => add(primitives::cuboid(DVec3::from_array(*size)), 0.0),
                Shape::Cylinder { radius, length } => {
                    add(primitives::cylinder(*radius, *length), *radius);
                }
                Shape::Capsule { radius, length } => {
                    add(primitives::capsule(*radius, *length), *radius);
                }
                Shape::Sphere { radius } => {
                    let centre = placement.translation;
                    let around = primitives::ball(*radius).into_iter();
                    shapes.balls.extend(around.map(|t| t.map(|corner| corner + centre)));
                    shapes.spheres.push(Sphere { centre, radius: *radius });
                }
                Shape::Mesh { filename, scale } => {
                    shapes.meshes += 1;
                    let placed = placement * DAffine3::from_scale(DVec3::from_array(*scale));
                    let loaded = match scale.contains(&0.0) {
                        true => Err(MeshFault::ScaleZero {
                            found: scale.map(|s| s.to_string()).join(" "),
                        }),
                        false => load(packages, folder, filename, &placed),
                    };
                    match loaded {
                        Ok(triangles) if hulls => {
                            shapes.triangles.extend(mesh::hull(&triangles).unwrap_or(triangles));
                        }
                        Ok(triangles) => shapes.triangles.extend(triangles),
                        Err(fault) => {
                            shapes.missing.push(MissingMesh { filename: filename.clone(), fault });
                        }
                    }
                    continue;
                }
            }
            shapes.primitives += 1;
        }
        shapes
    }
}

fn load(
    packages: &Packages,
    folder: &Path,
    name: &str,
    placed: &DAffine3,
) -> Result<Vec<Triangle>, MeshFault> {
    let triangles = mesh::load(&packages.resolve(folder, name)?)?;
    let triangles =
        triangles.iter().map(|triangle| triangle.map(|corner| placed.transform_point3(corner)));
    mesh::checked(triangles.collect())
}

fn base(selection: Option<&Selection>) -> Option<&str> {
    selection.and_then(|selection| selection.base_link.as_deref())
}

fn placement(origin: &Origin) -> DAffine3 {
    DAffine3::from_mat3_translation(origin.rotation(), DVec3::from_array(origin.xyz))
}
