//! An ideal arm, which is where it is commanded to be, its meshes and what they touch.

use glam::{DAffine3, DMat3, DVec3};
use nalgebra::SVector;
use parry3d_f64::math::{Pose as Isometry, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::{Ball, TriMesh};
use tprmp_cover::Cover;
use tprmp_robot::{Chain, Kinematics, forward_kinematics, point_position};

/// A link's mesh, in the frame of the joint that moves it.
struct Link {
    name: String,
    joint: usize,
    mesh: TriMesh,
    corners: Vec<DVec3>,
    /// Spheres around it: where these are apart, so are the meshes.
    spheres: Vec<(DVec3, f64)>,
}

/// The meshes of an arm of N joints.
pub(crate) struct Meshes {
    links: Vec<Link>,
    /// Pairs that touch in the posture they begin in: shapes that overlap by design.
    by_design: Vec<(usize, usize)>,
}

impl Meshes {
    /// The meshes of a cover.
    pub(crate) fn new<const N: usize>(
        chain: &Chain<N>,
        cover: &Cover,
        home: &SVector<f64, N>,
    ) -> Self {
        let links =
            cover.links.iter().filter(|link| !link.triangles.is_empty()).filter_map(|link| {
                let index = chain.moving_links().iter().position(|(name, _)| *name == link.link)?;
                let place = |point: DVec3| chain.in_joint_frame(index, point).unwrap_or(point);
                let corners: Vec<DVec3> =
                    link.triangles.iter().flatten().map(|at| place(*at)).collect();
                let triangles =
                    (0..link.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
                let vertices = corners.iter().map(|at| Vector::new(at.x, at.y, at.z)).collect();
                Some(Link {
                    name: link.link.clone(),
                    joint: chain.moving_links()[index].1,
                    mesh: TriMesh::new(vertices, triangles.collect()).ok()?,
                    corners,
                    spheres: link.spheres.iter().map(|s| (place(s.centre), s.radius)).collect(),
                })
            });
        let mut meshes = Self { links: links.collect(), by_design: Vec::new() };
        let mut kinematics = Kinematics::new();
        forward_kinematics(chain, home, &mut kinematics);
        meshes.by_design = meshes.touching_pairs(&kinematics);
        meshes
    }

    /// Links that touch each other, the ball or the plane z = `table_m` \[m\], but for those next to each other
    /// and those that begin so.
    pub(crate) fn contacts<const N: usize>(
        &self,
        kinematics: &Kinematics<N>,
        ball: (DVec3, f64),
        table_m: f64,
    ) -> Vec<String> {
        let mut found: Vec<String> = self
            .touching_pairs(kinematics)
            .into_iter()
            .filter(|pair| !self.by_design.contains(pair))
            .map(|(a, b)| format!("{} and {}", self.links[a].name, self.links[b].name))
            .collect();
        for link in &self.links {
            let at = placement(kinematics, link.joint);
            let near = |(centre, radius): &(DVec3, f64)| {
                at.transform_point3(*centre).distance(ball.0) <= radius + ball.1
            };
            if link.spheres.iter().any(near) {
                let sphere = Ball::new(ball.1);
                let centre = Isometry::from_parts(vector(ball.0), Default::default());
                if query::intersection_test(&isometry(&at), &link.mesh, &centre, &sphere)
                    .map_or(true, |found| found.intersecting)
                {
                    found.push(format!("{} and the ball", link.name));
                }
            }
            // What the arm stands on with its first two links is no table to them.
            let low = |corner: &DVec3| at.transform_point3(*corner).z < table_m;
            if link.joint > 1 && link.corners.iter().any(low) {
                found.push(format!("{} and the table", link.name));
            }
        }
        found
    }

    fn touching_pairs<const N: usize>(&self, kinematics: &Kinematics<N>) -> Vec<(usize, usize)> {
        let places: Vec<DAffine3> =
            self.links.iter().map(|link| placement(kinematics, link.joint)).collect();
        let mut found = Vec::new();
        for (a, one) in self.links.iter().enumerate() {
            for (b, other) in self.links.iter().enumerate().skip(a + 1) {
                if one.joint.abs_diff(other.joint) <= 1 {
                    continue;
                }
                let near = one.spheres.iter().any(|(centre, radius)| {
                    let centre = places[a].transform_point3(*centre);
                    other.spheres.iter().any(|(at, r)| {
                        places[b].transform_point3(*at).distance(centre) <= r + radius
                    })
                });
                let touch = || {
                    let [x, y] = [isometry(&places[a]), isometry(&places[b])];
                    query::intersection_test(&x, &one.mesh, &y, &other.mesh)
                        .map_or(true, |found| found.intersecting)
                };
                if near && touch() {
                    found.push((a, b));
                }
            }
        }
        found
    }
}

/// Where the frame of a joint is in the base.
fn placement<const N: usize>(kinematics: &Kinematics<N>, joint: usize) -> DAffine3 {
    let origin = point_position(kinematics, joint, DVec3::ZERO);
    let axis = |axis| point_position(kinematics, joint, axis) - origin;
    DAffine3::from_mat3_translation(
        DMat3::from_cols(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z)),
        origin,
    )
}

fn vector(at: DVec3) -> Vector {
    Vector::new(at.x, at.y, at.z)
}

fn isometry(at: &DAffine3) -> Isometry {
    let (_, q, p) = at.to_scale_rotation_translation();
    Isometry::from_parts(vector(p), parry3d_f64::math::Rotation::from_xyzw(q.x, q.y, q.z, q.w))
}
