//! Whether the shapes of two links touch: the shapes themselves, not their spheres.

use glam::{DAffine3, DVec3};
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::query::intersection_test;
use parry3d_f64::shape::TriMesh;

use crate::Cover;

/// The shapes of the links of a [`Cover`], in its order.
pub struct LinkMeshes(Vec<Option<TriMesh>>);

impl Cover {
    /// The shapes of the links.
    #[must_use]
    pub fn meshes(&self) -> LinkMeshes {
        let mesh = |triangles: &Vec<[DVec3; 3]>| {
            let corners = triangles.iter().flatten().map(|at| Vector::new(at.x, at.y, at.z));
            let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
            TriMesh::new(corners.collect(), indices.collect()).ok()
        };
        LinkMeshes(self.links.iter().map(|link| mesh(&link.triangles)).collect())
    }
}

impl LinkMeshes {
    /// Whether the surfaces of two links, indices into [`Cover::links`], touch where their frames are so in the
    /// base. `false` where one has no shape.
    #[must_use]
    pub fn touch(&self, (a, at_a): (usize, &DAffine3), (b, at_b): (usize, &DAffine3)) -> bool {
        let mesh = |link: usize| self.0.get(link).and_then(Option::as_ref);
        let (Some(one), Some(other)) = (mesh(a), mesh(b)) else { return false };
        let found = intersection_test(&pose(at_a), one, &pose(at_b), other);
        found.map_or(true, |found| found.intersecting)
    }
}

fn pose(at: &DAffine3) -> Pose {
    let (_, q, p) = at.to_scale_rotation_translation();
    Pose::from_parts(Vector::new(p.x, p.y, p.z), Rotation::from_xyzw(q.x, q.y, q.z, q.w))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Options, Packages, cover};

    #[test]
    fn links_touch_where_their_shapes_do_and_not_where_their_spheres_do() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/ur5.urdf");
        let cover = cover(file.as_ref(), None, &Packages::default(), &Options::default()).unwrap();
        let meshes = cover.meshes();
        let index = |name| cover.links.iter().position(|link| link.link == name).unwrap();
        let [arm, tool] = [index("upper_arm_link"), index("suction_tool")];
        let apart = |m| DAffine3::from_translation(DVec3::new(0.0, m, 0.0));
        let touch = |m| meshes.touch((arm, &apart(0.0)), (tool, &apart(m)));
        assert!(touch(0.0) && !touch(0.5));
    }
}
