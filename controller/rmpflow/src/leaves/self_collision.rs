//! Clearance of a body from itself.

use glam::DVec3;
use tprmp_spatial::PointMotion;

use crate::leaves::avoidance::Proximity;
use crate::leaves::barrier::{Barrier, Clearance};
use crate::leaves::body::Body;
use crate::natural::Natural;

/// Clearance between points of the robot itself.
#[derive(Debug, Clone)]
pub struct SelfCollision {
    /// How it is kept.
    pub leaf: Barrier,
    /// Added to the distance that is kept \[m\].
    pub margin_m: f64,
    /// Which parts of the body keep clear of each other: all points of one of all of the other.
    pub pairs: Box<[(usize, usize)]>,
}

impl SelfCollision {
    /// Adds the leaves of all close pairs; returns how near they are.
    pub fn add<const N: usize>(&self, body: &impl Body<N>, root: &mut Natural<N>) -> Proximity {
        let mut proximity = Proximity::NONE;
        for &(a, b) in &self.pairs {
            let (one, other) = (body.part(a), body.part(b));
            if self.is_far(one.position - other.position, one.radius + other.radius) {
                continue;
            }
            for i in one.points {
                let (position, radius) = body.ball(i);
                if self.is_far(position - other.position, radius + other.radius) {
                    continue;
                }
                for j in other.points.clone() {
                    if let Some(clearance) = self.add_pair(body, i, j, root) {
                        let Proximity { clearance_min_m, closing_1_s, .. } = &mut proximity;
                        *clearance_min_m = clearance_min_m.min(clearance.distance);
                        *closing_1_s = closing_1_s.max(clearance.closing_1_s(clearance.rate));
                    }
                }
            }
        }
        proximity
    }

    /// Whether balls whose centres are `apart` lie out of the leaf's reach.
    fn is_far(&self, apart: DVec3, radii: f64) -> bool {
        let reach = radii + self.margin_m + self.leaf.activation_distance;
        apart.length_squared() >= reach * reach
    }

    /// Adds the leaf of a pair of points; returns its clearance when it is close.
    fn add_pair<const N: usize>(
        &self,
        body: &impl Body<N>,
        i: usize,
        j: usize,
        root: &mut Natural<N>,
    ) -> Option<Clearance> {
        let ((a, radius_a), (b, radius_b)) = (body.ball(i), body.ball(j));
        if self.is_far(a - b, radius_a + radius_b) {
            return None;
        }
        let (one, other) = (body.motion(i), body.motion(j));
        let length = (a - b).length().max(1e-9);
        let normal = (a - b) / length;
        let relative = PointMotion {
            position: a - b,
            velocity: one.velocity - other.velocity,
            jacobian: one.jacobian - other.jacobian,
            drift: one.drift - other.drift,
        };
        let rate = normal.dot(relative.velocity);
        let clearance = Clearance {
            distance: length - (radius_a + radius_b + self.margin_m),
            rate,
            normal,
            curvature: (relative.velocity.length_squared() - rate * rate) / length,
        };
        self.leaf.add(&clearance, &relative, root);
        Some(clearance)
    }
}
