//! Moving obstacles of simple shape, and the clearance of a ball from them.

use glam::{DQuat, DVec3};
use tprmp_spatial::{Pose, Twist};

use crate::leaves::barrier::Clearance;

/// Shape of an obstacle in its own frame, centred at the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Radius \[m\].
        radius: f64,
    },
    /// All points within a radius of a stretch of the z axis.
    Capsule {
        /// Radius \[m\].
        radius: f64,
        /// Half the length of the stretch, without the round ends \[m\].
        half_length: f64,
    },
    /// A box.
    Box {
        /// Half its edges \[m\].
        half_size: DVec3,
    },
    /// All points below the xy plane: its outward normal is the z axis.
    HalfSpace,
}

/// A moving obstacle. Its velocities are taken as constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstacle {
    /// Shape.
    pub shape: Shape,
    /// Its centre and axes; the origin of a half-space lies on its plane.
    pub pose: Pose,
    /// How they move.
    pub velocity: Twist,
}

/// Distance of a point from a shape, in the shape's frame.
struct Distance {
    /// Negative inside.
    distance: f64,
    /// ∂d/∂x.
    normal: DVec3,
    /// Distance from the centre of curvature \[m\], and the directions in which the surface of equal
    /// distance is curved there: d's second derivative is (P − nnᵀ)/`reach`.
    reach: f64,
    curved: DVec3,
}

impl Shape {
    /// The signed distance and its first two derivatives.
    #[inline]
    fn distance(&self, point: DVec3) -> Distance {
        let from = |away: DVec3, radius: f64, curved: DVec3| {
            let reach = away.length().max(1e-9);
            Distance { distance: reach - radius, normal: away / reach, reach, curved }
        };
        match *self {
            Self::Sphere { radius } => from(point, radius, DVec3::ONE),
            Self::Capsule { radius, half_length } => {
                let along = point.z.clamp(-half_length, half_length);
                let beside = point.z.abs() < half_length;
                let curved = if beside { DVec3::new(1.0, 1.0, 0.0) } else { DVec3::ONE };
                from(point - DVec3::Z * along, radius, curved)
            }
            Self::Box { half_size } => {
                let beyond = point.abs() - half_size;
                if beyond.max_element() > 0.0 {
                    let nearest = point.clamp(-half_size, half_size);
                    let curved = DVec3::select(beyond.cmpgt(DVec3::ZERO), DVec3::ONE, DVec3::ZERO);
                    return from(point - nearest, 0.0, curved);
                }
                // Inside: out through the nearest face.
                let face = DVec3::select(
                    beyond.cmpeq(DVec3::splat(beyond.max_element())),
                    DVec3::ONE,
                    DVec3::ZERO,
                );
                let normal = (face * point.signum()).normalize();
                let distance = beyond.max_element();
                Distance { distance, normal, reach: f64::INFINITY, curved: DVec3::ZERO }
            }
            Self::HalfSpace => Distance {
                distance: point.z,
                normal: DVec3::Z,
                reach: f64::INFINITY,
                curved: DVec3::ZERO,
            },
        }
    }
}

impl Obstacle {
    /// A ball.
    #[must_use]
    pub fn sphere(centre: DVec3, radius: f64, velocity: DVec3) -> Self {
        Self {
            shape: Shape::Sphere { radius },
            pose: Pose { position: centre, orientation: DQuat::IDENTITY },
            velocity: Twist { linear: velocity, angular: DVec3::ZERO },
        }
    }

    /// Velocity of the obstacle's material at `point` \[m/s\].
    #[must_use]
    pub fn velocity_at(&self, point: DVec3) -> DVec3 {
        self.velocity.shifted(point - self.pose.position).linear
    }

    /// Distance of a ball of `radius` at `point` from the surface \[m\]: the first thing that
    /// [`Obstacle::clearance`] gives.
    #[must_use]
    #[inline]
    pub fn distance(&self, point: DVec3, radius: f64) -> f64 {
        self.shape.distance(self.in_own_axes(point - self.pose.position)).distance - radius
    }

    /// A vector in the world, in the obstacle's axes. A ball has none.
    #[inline]
    fn in_own_axes(&self, vector: DVec3) -> DVec3 {
        match self.shape {
            Shape::Sphere { .. } => vector,
            _ => self.pose.orientation.conjugate() * vector,
        }
    }

    /// A vector in the obstacle's axes, in the world.
    #[inline]
    fn in_world(&self, vector: DVec3) -> DVec3 {
        match self.shape {
            Shape::Sphere { .. } => vector,
            _ => self.pose.orientation * vector,
        }
    }

    /// Clearance of a ball of `radius` at `point`, moving with `velocity`.
    ///
    /// With r = x − c in the world, seen from the obstacle's frame, and w = ẋ − v − ω × r:
    ///
    /// ```text
    /// ḋ = nᵀw,   d̈ = nᵀẍ − nᵀ(2 ω × w + ω × (ω × r)) + wᵀ(P − nnᵀ)w / |x − centre of curvature|
    /// ```
    #[must_use]
    pub fn clearance(&self, point: DVec3, velocity: DVec3, radius: f64) -> Clearance {
        let arm = point - self.pose.position;
        let d = self.shape.distance(self.in_own_axes(arm));
        let normal = self.in_world(d.normal);
        let omega = self.velocity.angular;
        let relative = velocity - self.velocity_at(point);
        let rate = normal.dot(relative);
        let own = self.in_own_axes(relative);
        let bending = ((own * d.curved).length_squared() - rate * rate) / d.reach;
        let rotating = normal.dot(2.0 * omega.cross(relative) + omega.cross(omega.cross(arm)));
        Clearance {
            distance: d.distance - radius,
            rate,
            normal,
            curvature: if d.reach.is_infinite() { -rotating } else { bending - rotating },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tprmp_spatial::strategies::vector;

    fn shapes() -> [Shape; 4] {
        [
            Shape::Sphere { radius: 0.06 },
            Shape::Capsule { radius: 0.05, half_length: 0.2 },
            Shape::Box { half_size: DVec3::new(0.1, 0.2, 0.05) },
            Shape::HalfSpace,
        ]
    }

    fn moved(obstacle: &Obstacle, t: f64) -> Obstacle {
        Obstacle { pose: obstacle.pose.advanced(&obstacle.velocity, t), ..*obstacle }
    }

    proptest! {
        /// Rate, normal and curvature are the derivatives of the distance, of a rotating obstacle
        /// too; the surface's kinks are where two sides are equally near.
        #[test]
        fn clearance_changes_as_its_rate_normal_and_curvature_say(
            shape in 0_usize..4,
            position in vector(0.3), rotation in vector(2.0),
            linear in vector(0.4), angular in vector(0.8),
            point in vector(0.6), velocity in vector(0.5), acceleration in vector(1.0),
        ) {
            let obstacle = Obstacle {
                shape: shapes()[shape],
                pose: Pose { position, orientation: DQuat::from_scaled_axis(rotation) },
                velocity: Twist { linear, angular },
            };
            let at = |t: f64| {
                moved(&obstacle, t).clearance(
                    point + velocity * t + acceleration * (0.5 * t * t),
                    velocity + acceleration * t,
                    0.02,
                )
            };
            let h = 1e-4;
            let (a, b, c) = (at(-h), at(0.0), at(h));
            prop_assume!(b.distance > 0.01);
            prop_assume!((b.normal - a.normal).length() < 0.1);
            // Not across the line where face and edge meet: there the curvature jumps.
            let (far_before, far_after) = (at(-2.0 * h), at(2.0 * h));
            let left = far_before.distance - 2.0 * a.distance + b.distance;
            let right = far_after.distance - 2.0 * c.distance + b.distance;
            prop_assume!((left - right).abs() < 1e-2 * h * h + 0.05 * left.abs());
            prop_assert!((b.rate - (c.distance - a.distance) / (2.0 * h)).abs() < 1e-5);
            let second = (c.distance - 2.0 * b.distance + a.distance) / (h * h);
            let expected = b.normal.dot(acceleration) + b.curvature;
            prop_assert!((expected - second).abs() < 1e-3 * (1.0 + expected.abs()), "{} {}", expected, second);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let beside = |s: f64| obstacle.distance(point + axis * s, 0.02);
                let slope = (beside(1e-6) - beside(-1e-6)) / 2e-6;
                prop_assert!((slope - b.normal.dot(axis)).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn distances_of_known_points() {
        let at = |shape: Shape, p: [f64; 3]| {
            Obstacle { shape, ..Obstacle::sphere(DVec3::ZERO, 1.0, DVec3::ZERO) }
                .distance(p.into(), 0.01)
        };
        let [sphere, capsule, cuboid, plane] = shapes();
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(at(sphere, [0.0, 0.1, 0.0]), 0.03);
        near(at(capsule, [0.1, 0.0, 0.15]), 0.04);
        near(at(capsule, [0.0, 0.0, -0.3]), 0.04);
        near(at(cuboid, [0.2, 0.0, 0.0]), 0.09);
        near(at(cuboid, [0.13, 0.24, 0.0]), 0.04);
        near(at(cuboid, [0.0, 0.0, 0.03]), -0.03);
        near(at(plane, [5.0, 1.0, -0.2]), -0.21);
        let tilted = Obstacle {
            shape: plane,
            pose: Pose {
                position: DVec3::Z * 0.1,
                orientation: DQuat::from_rotation_arc(DVec3::Z, DVec3::X),
            },
            velocity: Twist::ZERO,
        };
        near(tilted.distance(DVec3::new(0.5, 3.0, 1.0), 0.1), 0.4);
    }
}
