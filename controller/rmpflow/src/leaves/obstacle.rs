//! Moving obstacles of simple shape, and the clearance of a ball from them.

use glam::{DQuat, DVec3};

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
    /// Centre; of a half-space, a point of its plane \[m\].
    pub position: DVec3,
    /// Orientation, unit.
    pub orientation: DQuat,
    /// Velocity of `position` \[m/s\].
    pub velocity: DVec3,
    /// Angular velocity \[rad/s\].
    pub angular_velocity: DVec3,
}

/// Clearance of a moving ball from an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// d \[m\].
    pub distance: f64,
    /// ḋ \[m/s\].
    pub rate: f64,
    /// ∂d/∂x; a unit vector where d is a distance.
    pub normal: DVec3,
    /// What d̈ is beside nᵀ times the point's acceleration \[m/s²\].
    pub curvature: f64,
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
    pub fn sphere(center: DVec3, radius: f64, velocity: DVec3) -> Self {
        Self {
            shape: Shape::Sphere { radius },
            position: center,
            orientation: DQuat::IDENTITY,
            velocity,
            angular_velocity: DVec3::ZERO,
        }
    }

    /// All below a plane through `point` with outward unit `normal`.
    #[must_use]
    pub fn half_space(point: DVec3, normal: DVec3, velocity: DVec3) -> Self {
        Self {
            shape: Shape::HalfSpace,
            position: point,
            orientation: DQuat::from_rotation_arc(DVec3::Z, normal),
            velocity,
            angular_velocity: DVec3::ZERO,
        }
    }

    /// Velocity of the obstacle's material at `point` \[m/s\].
    #[must_use]
    pub fn velocity_at(&self, point: DVec3) -> DVec3 {
        self.velocity + self.angular_velocity.cross(point - self.position)
    }

    /// Distance of a ball of `radius` at `point` from the surface \[m\]: the first thing that
    /// [`Obstacle::clearance`] says.
    #[must_use]
    #[inline]
    pub fn distance(&self, point: DVec3, radius: f64) -> f64 {
        self.shape.distance(self.in_own_axes(point - self.position)).distance - radius
    }

    /// A vector in the world, in the obstacle's axes. A ball has none: it looks the same from all sides.
    #[inline]
    fn in_own_axes(&self, vector: DVec3) -> DVec3 {
        match self.shape {
            Shape::Sphere { .. } => vector,
            _ => self.orientation.conjugate() * vector,
        }
    }

    /// A vector in the obstacle's axes, in the world.
    #[inline]
    fn in_world(&self, vector: DVec3) -> DVec3 {
        match self.shape {
            Shape::Sphere { .. } => vector,
            _ => self.orientation * vector,
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
        let arm = point - self.position;
        let d = self.shape.distance(self.in_own_axes(arm));
        let normal = self.in_world(d.normal);
        let spin = self.angular_velocity;
        let relative = velocity - self.velocity_at(point);
        let rate = normal.dot(relative);
        let own = self.in_own_axes(relative);
        let bend = ((own * d.curved).length_squared() - rate * rate) / d.reach;
        let turning = normal.dot(2.0 * spin.cross(relative) + spin.cross(spin.cross(arm)));
        Clearance {
            distance: d.distance - radius,
            rate,
            normal,
            curvature: if d.reach.is_infinite() { -turning } else { bend - turning },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shapes() -> [Shape; 4] {
        [
            Shape::Sphere { radius: 0.06 },
            Shape::Capsule { radius: 0.05, half_length: 0.2 },
            Shape::Box { half_size: DVec3::new(0.1, 0.2, 0.05) },
            Shape::HalfSpace,
        ]
    }

    fn moved(obstacle: &Obstacle, t: f64) -> Obstacle {
        Obstacle {
            position: obstacle.position + obstacle.velocity * t,
            orientation: DQuat::from_scaled_axis(obstacle.angular_velocity * t)
                * obstacle.orientation,
            ..*obstacle
        }
    }

    fn vector(size: f64) -> impl Strategy<Value = DVec3> {
        [-size..size, -size..size, -size..size].prop_map(DVec3::from)
    }

    proptest! {
        /// Rate, normal and curvature are the derivatives of the distance, of a turning obstacle
        /// too; the surface's kinks are where two sides are equally near.
        #[test]
        fn clearance_changes_as_its_rate_normal_and_curvature_say(
            shape in 0_usize..4,
            place in vector(0.3), turn in vector(2.0),
            own in vector(0.4), spin in vector(0.8),
            point in vector(0.6), velocity in vector(0.5), acceleration in vector(1.0),
        ) {
            let obstacle = Obstacle {
                shape: shapes()[shape],
                position: place,
                orientation: DQuat::from_scaled_axis(turn),
                velocity: own,
                angular_velocity: spin,
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
            let told = b.normal.dot(acceleration) + b.curvature;
            prop_assert!((told - second).abs() < 1e-3 * (1.0 + told.abs()), "{} {}", told, second);
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
        let tilted = Obstacle::half_space(DVec3::Z * 0.1, DVec3::X, DVec3::ZERO);
        near(tilted.distance(DVec3::new(0.5, 3.0, 1.0), 0.1), 0.4);
    }
}
