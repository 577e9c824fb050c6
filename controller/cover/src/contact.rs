//! Whether the shapes of two links touch: the shapes themselves, not their spheres.

use glam::DVec3;
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::query::intersection_test;
use parry3d_f64::shape::TriMesh;

/// The shapes of the links of a cover, in its order.
pub struct LinkMeshes(Vec<Option<TriMesh>>);

impl LinkMeshes {
    /// Of links with these triangles \[m\].
    pub(crate) fn of<'a>(links: impl Iterator<Item = &'a [[DVec3; 3]]>) -> Self {
        let mesh = |triangles: &[[DVec3; 3]]| {
            let corners = triangles.iter().flatten().map(|at| Vector::new(at.x, at.y, at.z));
            let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
            TriMesh::new(corners.collect(), indices.collect()).ok()
        };
        Self(links.map(mesh).collect())
    }

    /// Whether the surfaces of two links, indices of the cover's links, touch where their frames are so in the
    /// base. `false` where one has no shape.
    #[must_use]
    pub fn touch(
        &self,
        (a, at_a): (usize, &tprmp_spatial::Pose),
        (b, at_b): (usize, &tprmp_spatial::Pose),
    ) -> bool {
        let mesh = |link: usize| self.0.get(link).and_then(Option::as_ref);
        let (Some(one), Some(other)) = (mesh(a), mesh(b)) else { return false };
        let found = intersection_test(&pose(at_a), one, &pose(at_b), other);
        found.map_or(true, |found| found.intersecting)
    }
}

fn pose(at: &tprmp_spatial::Pose) -> Pose {
    let (p, q) = (at.position, at.orientation);
    Pose::from_parts(Vector::new(p.x, p.y, p.z), Rotation::from_xyzw(q.x, q.y, q.z, q.w))
}
