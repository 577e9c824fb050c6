//! Whether the shapes of two links touch: the shapes themselves, not their spheres.

use std::collections::HashMap;

use glam::DVec3;
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::partitioning::BvhNode;
use parry3d_f64::query::{Ray, RayCast, intersection_test};
use parry3d_f64::shape::TriMesh;

use crate::triangle::Triangle;

/// Corners that are nearer are one corner \[m\].
const CORNER_M: f64 = 1e-6;
/// Crossings of a ray that are nearer are one: an edge that two triangles share, or a face from both sides \[m\].
const CROSSING_M: f64 = 1e-9;
/// So many of the six rays have to agree, as for the depth of a sphere.
const MAJORITY: usize = 4;
/// Three lines, each taken both ways. No face or edge of a usual shape lies along one of them.
const LINES: [Vector; 3] = [
    Vector::new(0.8137, 0.4241, 0.3977),
    Vector::new(-0.3719, 0.8731, 0.3152),
    Vector::new(-0.2863, -0.4517, 0.8450),
];

/// The shapes of the links of a cover, in its order.
pub struct LinkMeshes(Vec<Option<LinkMesh>>);

/// The shapes of one link.
struct LinkMesh {
    mesh: TriMesh,
    /// A point of each part that hangs together \[m\].
    points: Vec<Vector>,
}

impl LinkMeshes {
    /// Of links with these triangles \[m\].
    pub(crate) fn of<'a>(links: impl Iterator<Item = &'a [[DVec3; 3]]>) -> Self {
        Self(links.map(LinkMesh::new).collect())
    }

    /// Whether the shapes of two links, indices of the cover's links, touch where their frames are so in the
    /// base: their surfaces meet, or a part of one lies inside the other. `false` where one has no shape.
    #[must_use]
    pub fn touch(
        &self,
        (a, at_a): (usize, &tprmp_spatial::Pose),
        (b, at_b): (usize, &tprmp_spatial::Pose),
    ) -> bool {
        let mesh = |link: usize| self.0.get(link).and_then(Option::as_ref);
        let (Some(one), Some(other)) = (mesh(a), mesh(b)) else { return false };
        let (at_one, at_other) = (pose(at_a), pose(at_b));
        let found = intersection_test(&at_one, &one.mesh, &at_other, &other.mesh);
        found.map_or(true, |found| found.intersecting)
            || one.holds_part_of(&at_one, other, &at_other)
            || other.holds_part_of(&at_other, one, &at_one)
    }
}

impl LinkMesh {
    fn new(triangles: &[Triangle]) -> Option<Self> {
        let (points, corners) = parts(triangles);
        let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        let mesh = TriMesh::new(corners, indices.collect()).ok()?;
        Some(Self { mesh, points })
    }

    /// Whether a part of another link lies inside this one, of two whose surfaces do not meet.
    fn holds_part_of(&self, at: &Pose, other: &Self, at_other: &Pose) -> bool {
        let to_here = |point: &Vector| at.inverse_transform_point(at_other.transform_point(*point));
        other.points.iter().any(|point| self.encloses(to_here(point)))
    }

    /// Whether most rays from a point call it inside: by the winding number, which overlapping shapes keep, or by
    /// an odd number of crossings, which faces turned the wrong way around keep. So the mesh may be open.
    fn encloses(&self, point: Vector) -> bool {
        if !self.mesh.bvh().root_aabb().contains_local_point(point) {
            return false;
        }
        let (mut winding, mut odd) = (0, 0);
        for direction in LINES.into_iter().flat_map(|line| [line, -line]) {
            let crossings = self.crossings(point, direction);
            winding += usize::from(crossings.iter().map(|(_, sign)| sign).sum::<i32>() != 0);
            odd += crossings.len() % 2;
        }
        winding >= MAJORITY || odd >= MAJORITY
    }

    /// How far along a ray it crosses triangles, and +1 where it leaves, −1 where it enters. Ascending.
    fn crossings(&self, from: Vector, direction: Vector) -> Vec<(f64, i32)> {
        let ray = Ray::new(from, direction);
        let is_near = |node: &BvhNode| node.aabb().intersects_local_ray(&ray, f64::MAX);
        let crossing = |triangle: u32| {
            let triangle = self.mesh.triangle(triangle);
            let (u, v) = (triangle.b - triangle.a, triangle.c - triangle.a);
            let normal = u.cross(v);
            let along = normal.dot(direction);
            let to = triangle.a - from;
            let across = to.cross(direction);
            let (s, t) = (across.dot(v) / along, -across.dot(u) / along);
            let distance = normal.dot(to) / along;
            // What is not finite, of a triangle along the ray, is in no range.
            (s >= 0.0 && t >= 0.0 && s + t <= 1.0 && distance >= 0.0)
                .then_some((distance, if along > 0.0 { 1 } else { -1 }))
        };
        let mut found: Vec<_> = self.mesh.bvh().leaves(is_near).filter_map(crossing).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.dedup_by(|a, b| (a.0 - b.0).abs() < CROSSING_M);
        found
    }
}

/// A point of each part that hangs together \[m\], and the corners of all triangles, those of a part that is inside
/// out turned around.
fn parts(triangles: &[Triangle]) -> (Vec<Vector>, Vec<Vector>) {
    let part_of = part_of_each(triangles);
    // Of each part a point and its volume, as seen from there.
    let mut parts: HashMap<usize, (DVec3, f64)> = HashMap::new();
    let mut points = Vec::new();
    for (triangle, part) in triangles.iter().zip(&part_of) {
        let (from, volume) = parts.entry(*part).or_insert_with(|| {
            let middle = triangle.iter().sum::<DVec3>() / 3.0;
            points.push(vector(middle));
            (middle, 0.0)
        });
        let [a, b, c] = triangle.map(|corner| corner - *from);
        *volume += a.dot(b.cross(c));
    }
    let turned = triangles.iter().zip(&part_of).flat_map(|(&[a, b, c], part)| {
        let is_inside_out = parts.get(part).is_some_and(|(_, volume)| *volume < 0.0);
        (if is_inside_out { [a, c, b] } else { [a, b, c] }).map(vector)
    });
    (points, turned.collect())
}

/// For each triangle the part that it belongs to: triangles with a corner in common are of one.
fn part_of_each(triangles: &[Triangle]) -> Vec<usize> {
    fn root(above: &mut [usize], mut at: usize) -> usize {
        while above[at] != at {
            above[at] = above[above[at]];
            at = above[at];
        }
        at
    }
    let mut above: Vec<usize> = (0..triangles.len()).collect();
    let mut first: HashMap<[i64; 3], usize> = HashMap::new();
    for (i, triangle) in triangles.iter().enumerate() {
        for corner in triangle {
            let place = (*corner / CORNER_M).round().as_i64vec3().to_array();
            let other = *first.entry(place).or_insert(i);
            let (a, b) = (root(&mut above, i), root(&mut above, other));
            above[a.max(b)] = a.min(b);
        }
    }
    (0..triangles.len()).map(|i| root(&mut above, i)).collect()
}

fn vector(at: DVec3) -> Vector {
    Vector::new(at.x, at.y, at.z)
}

fn pose(at: &tprmp_spatial::Pose) -> Pose {
    let (p, q) = (at.position, at.orientation);
    Pose::from_parts(Vector::new(p.x, p.y, p.z), Rotation::from_xyzw(q.x, q.y, q.z, q.w))
}
