//! Spheres that cover the collision shapes of an arm.

use glam::DVec3;

use crate::chain::Chain;
use crate::description::CollisionGeometry;

/// Most spheres an arm can have.
pub const CONTROL_POINT_CAPACITY: usize = 64;

/// Largest radius of a sphere on a cylinder or capsule, as a factor of that shape's radius: √(1 + ¼).
pub const INFLATION_MAX: f64 = 1.118_033_988_749_895;

/// A sphere fixed to a moving link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlPoint {
    /// Index into [`Chain::moving_links`], which gives the link's name.
    pub link: usize,
    /// Index of the joint that moves it: below N of the chain it was built from.
    pub joint: usize,
    /// Centre in that joint's frame [m]; the argument of [`crate::point_motion`].
    pub centre: DVec3,
    /// Radius [m].
    pub radius: f64,
}

/// All spheres of an arm, at most [`CONTROL_POINT_CAPACITY`]. Built at start-up.
///
/// Every point of every collision shape of a moving link lies in at least one sphere.
#[derive(Debug, Clone)]
pub struct ControlPoints {
    points: Vec<ControlPoint>,
}

/// Why a robot's collision shapes cannot be covered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ControlPointError {
    /// Too many spheres would be needed.
    #[error(
        "link `{link}`: expected collision shapes that {capacity} spheres can cover, found that the arm needs more from here on"
    )]
    TooMany {
        /// The link at which the capacity was reached.
        link: String,
        /// [`CONTROL_POINT_CAPACITY`].
        capacity: usize,
    },
    /// A listed sphere is on no link that moves.
    #[error("control points: expected one of the moving links {}, found `{link}`", .expected.join(", "))]
    UnknownLink {
        /// The link named.
        link: String,
        /// The links there are.
        expected: Vec<String>,
    },
    /// A listed sphere has no size or no place.
    #[error("control points, link `{link}`: expected a finite position and a radius above zero")]
    NotFinite {
        /// The link.
        link: String,
    },
    /// A collision shape is a mesh.
    #[error(
        "link `{link}`: expected collision shapes of cylinders, capsules, spheres or boxes, found a mesh; list control points in place of them, which `controller cover` finds"
    )]
    Mesh {
        /// The link.
        link: String,
    },
}

impl ControlPoints {
    /// Covers the collision shapes of the chain's moving links.
    ///
    /// Along a cylinder's axis spheres stand at equal distances d of at most one radius r, the first
    /// and last d/2 from the flat ends; their radius is √(r² + d²/4) ≤ [`INFLATION_MAX`] · r. So they
    /// stick out by at most 0.119 r at the side and by at most r beyond the ends.
    /// A capsule is covered alike, with spheres at both ends of its axis. A box is cut into cells with
    /// no edge longer than the box's shortest s, each inside a sphere of radius at most √3/2 · s.
    ///
    /// # Errors
    ///
    /// [`ControlPointError`] when there is a mesh or more than [`CONTROL_POINT_CAPACITY`] spheres are
    /// needed.
    pub fn new<const N: usize>(chain: &Chain<N>) -> Result<Self, ControlPointError> {
        let mut covered = Self { points: Vec::new() };
        for shape in chain.collision_shapes() {
            let link = &chain.moving_links()[shape.link].0;
            let mut push = |centre: DVec3, radius: f64| {
                let centre = shape.placement.transform_point(centre);
                let point = ControlPoint { link: shape.link, joint: shape.joint, centre, radius };
                covered.push(point, link)
            };
            match shape.geometry {
                CollisionGeometry::Cylinder { radius, length }
                | CollisionGeometry::Capsule { radius, length } => {
                    let cells = (length / radius).ceil();
                    let step = length / cells;
                    let inflated = radius.hypot(step / 2.0);
                    let is_flat = matches!(shape.geometry, CollisionGeometry::Cylinder { .. });
                    let (first, count) = if is_flat { (0.5, 0) } else { (0.0, 1) };
                    for k in 0..cells_usize(cells) + count {
                        push(DVec3::Z * ((k as f64 + first) * step - length / 2.0), inflated)?;
                    }
                }
                CollisionGeometry::Sphere { radius } => {
                    push(DVec3::ZERO, radius)?;
                }
                CollisionGeometry::Box { size } => {
                    let cells = (size / size.min_element()).ceil();
                    let step = size / cells;
                    let corner = (step - size) / 2.0;
                    for i in 0..cells_usize(cells.x) {
                        for j in 0..cells_usize(cells.y) {
                            for k in 0..cells_usize(cells.z) {
                                let cell = DVec3::new(i as f64, j as f64, k as f64);
                                push(corner + cell * step, step.length() / 2.0)?;
                            }
                        }
                    }
                }
                CollisionGeometry::Mesh => {
                    return Err(ControlPointError::Mesh { link: link.clone() });
                }
            }
        }
        Ok(covered)
    }

    /// Spheres that are listed: link, centre in its frame [m] and radius [m], in any order. What the
    /// collision shapes are does not matter then.
    ///
    /// # Errors
    ///
    /// [`ControlPointError`] when a sphere is on no moving link, has no size, or is one too many.
    pub fn listed<const N: usize>(
        chain: &Chain<N>,
        list: &[(String, DVec3, f64)],
    ) -> Result<Self, ControlPointError> {
        let mut listed = Self { points: Vec::new() };
        let links = chain.moving_links();
        // In the order of the chain, so that the spheres of a link are side by side.
        for (link, (name, joint)) in links.iter().enumerate() {
            for (_, centre, radius) in list.iter().filter(|(of, _, _)| of == name) {
                let place = chain.in_joint_frame(link, *centre).filter(|place| place.is_finite());
                let (Some(centre), true) = (place, radius.is_finite() && *radius > 0.0) else {
                    return Err(ControlPointError::NotFinite { link: name.clone() });
                };
                listed.push(ControlPoint { link, joint: *joint, centre, radius: *radius }, name)?;
            }
        }
        match list.iter().find(|(of, _, _)| links.iter().all(|(name, _)| name != of)) {
            None => Ok(listed),
            Some((link, _, _)) => Err(ControlPointError::UnknownLink {
                link: link.clone(),
                expected: links.iter().map(|(name, _)| name.clone()).collect(),
            }),
        }
    }

    /// The spheres.
    pub fn as_slice(&self) -> &[ControlPoint] {
        &self.points
    }

    /// Adds a sphere of the link of this name.
    fn push(&mut self, point: ControlPoint, link: &str) -> Result<(), ControlPointError> {
        let capacity = CONTROL_POINT_CAPACITY;
        if self.points.len() == capacity {
            return Err(ControlPointError::TooMany { link: link.to_owned(), capacity });
        }
        self.points.push(point);
        Ok(())
    }
}

/// A number of cells as a loop bound. More than the capacity are never needed to notice that
/// there are too many.
fn cells_usize(cells: f64) -> usize {
    cells.clamp(0.0, CONTROL_POINT_CAPACITY as f64 + 1.0) as usize
}
