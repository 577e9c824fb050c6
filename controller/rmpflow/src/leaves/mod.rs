//! Hand-made leaves: collision avoidance, a pose attractor, a follower of commanded velocities, joint
//! damping.
//!
//! All but the follower are geometric dynamical systems [Cheng et al. 2019, RMPflow, section V]: M = G + Ξ,
//! Ξ = ½ Σ ẋ_i ∂G/∂ẋ_i, f = −∇Φ − Bẋ − ξ_G, so that the stability of the whole tree holds.

pub mod avoidance;
pub mod joint_limits;
pub mod obstacle;

use glam::DVec3;
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector1, Vector3, Vector6};

pub use crate::leaves::obstacle::{Clearance, Obstacle, Shape};
use crate::natural::Natural;
use tprmp_spatial::jet::{Jet, Real, Vec3};
use tprmp_spatial::rotation::orientation_chart;
use tprmp_spatial::{MovingPose, Pose, Twist};

/// Collision avoidance on the clearance d between a control point and an obstacle.
///
/// ```text
/// w(d) = m (d₀/d − 1)² for d < d₀, else 0
/// u(ḋ) = ε + (ḋ/v₀)² for ḋ < 0, else ε       G = w u,  M = G + Ξ = w (ε + 2(ḋ/v₀)²)
/// Φ = ½ a w(d)      B = η G      ξ = ½ w′ u ḋ²   [Cheng et al. 2019, eq. 21 and 68]
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionAvoidance {
    /// d₀: farther away the leaf is silent \[m\].
    pub activation_distance_m: f64,
    /// Clearance below which the leaf no longer grows \[m\].
    pub clearance_min_m: f64,
    /// m \[kg\].
    pub inertia_kg: f64,
    /// ε: fraction of the inertia that speaks at any velocity.
    pub rest_fraction: f64,
    /// v₀: approach speed at which the inertia doubles the rest fraction's unit \[m/s\].
    pub approach_speed_m_s: f64,
    /// a: strength of the repulsive potential \[m²/s²\].
    pub repulsion_m2_s2: f64,
    /// η \[1/s\].
    pub damping_1_s: f64,
}

impl CollisionAvoidance {
    /// The leaf at clearance `distance` \[m\], changing at `rate` \[m/s\]; `None` out of range.
    #[must_use]
    pub fn evaluate(&self, distance: f64, rate: f64) -> Option<Natural<1>> {
        if distance.is_nan() || distance >= self.activation_distance_m {
            return None;
        }
        let d = distance.max(self.clearance_min_m);
        let ratio = self.activation_distance_m / d - 1.0;
        let weight = self.inertia_kg * ratio * ratio;
        let slope = -2.0 * self.inertia_kg * ratio * self.activation_distance_m / (d * d);
        let approach = rate.min(0.0) / self.approach_speed_m_s;
        let gate = self.rest_fraction + approach * approach;
        let metric = weight * (self.rest_fraction + 2.0 * approach * approach);
        let force = -0.5 * self.repulsion_m2_s2 * slope
            - self.damping_1_s * weight * gate * rate
            - 0.5 * slope * gate * rate * rate;
        Some(Natural { force: Vector1::new(force), metric: SMatrix::<f64, 1, 1>::new(metric) })
    }

    /// The leaf silent from a shorter clearance d₁ on. Its metric is as firm as before near a contact,
    /// w = m d₀² (1/d − 1/d₁)²; its potential is that of a leaf of this range, ½ a m (d₁/d − 1)², which
    /// from a shorter distance throws back no harder.
    #[must_use]
    pub fn within(&self, distance_m: f64) -> Self {
        if distance_m >= self.activation_distance_m {
            return *self;
        }
        let longer = self.activation_distance_m / distance_m;
        Self {
            activation_distance_m: distance_m,
            inertia_kg: self.inertia_kg * longer * longer,
            repulsion_m2_s2: self.repulsion_m2_s2 / (longer * longer),
            ..*self
        }
    }

    /// V = Φ + ½ G ḋ² at clearance `distance` \[m\], changing at `rate` \[m/s\]  \[J\].
    #[must_use]
    pub fn energy(&self, distance: f64, rate: f64) -> f64 {
        if distance.is_nan() || distance >= self.activation_distance_m {
            return 0.0;
        }
        let ratio = self.activation_distance_m / distance.max(self.clearance_min_m) - 1.0;
        let weight = self.inertia_kg * ratio * ratio;
        let approach = rate.min(0.0) / self.approach_speed_m_s;
        let gate = self.rest_fraction + approach * approach;
        0.5 * weight * (self.repulsion_m2_s2 + gate * rate * rate)
    }
}

/// A funnel around the approach to a goal: away from the approach axis the tool keeps above it.
///
/// ```text
/// e = x − g,  e_⊥ = e − a (aᵀe)              a: approach axis, fixed in the goal frame
/// φ = d₀ + aᵀe − h (1 − exp(−|e_⊥|²/2w²))   ≥ 0
/// ```
///
/// φ is a clearance like any other, so that [`CollisionAvoidance`] with d₀ as its activation
/// distance keeps it positive; at the goal, and above it on the axis, that leaf is silent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ApproachFunnel {
    /// a, in the goal frame, unit.
    pub axis: DVec3,
    /// h \[m\].
    pub depth_m: f64,
    /// w \[m\].
    pub width_m: f64,
    /// d₀ and the leaf on φ.
    pub leaf: CollisionAvoidance,
}

impl ApproachFunnel {
    /// φ for a tool at `point` moving with `velocity`, when the goal is at `goal` in the moving
    /// frame `frame`.
    #[must_use]
    pub fn clearance(
        &self,
        point: DVec3,
        velocity: DVec3,
        goal: DVec3,
        frame: &MovingPose,
    ) -> Clearance {
        let away = Vec3::moving(point, velocity, DVec3::ZERO)
            .minus(frame.fixed_point(goal - frame.pose.position));
        let axis = frame.fixed_direction(frame.pose.orientation * self.axis);
        let along = axis.dot(away);
        let sideways = away.minus(axis.times(along));
        let scaled = sideways.dot(sideways) * Jet::constant(-0.5 / (self.width_m * self.width_m));
        let fraction = scaled.value().exp();
        let bell = scaled.chain([fraction, fraction, fraction]);
        let start = Jet::constant(self.leaf.activation_distance_m - self.depth_m);
        let clearance = start + along + bell * Jet::constant(self.depth_m);
        let steepness = self.depth_m * fraction / (self.width_m * self.width_m);
        Clearance {
            distance: clearance.0,
            rate: clearance.1,
            normal: axis.value() - sideways.value() * steepness,
            curvature: clearance.2,
        }
    }
}

/// Draws a pose to a goal: a spring whose pull saturates, and damping.
///
/// M = diag(m I, j I), Φ = m k s (√(|e|² + s²) − s) in position and ½ j k |r|² in the orientation
/// chart at the goal, B = d M. The pull saturates at m k s, so that a far goal gives a steady
/// speed k s/d.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseAttractor {
    /// m \[kg\].
    pub linear_inertia_kg: f64,
    /// j \[kg m²\].
    pub angular_inertia_kg_m2: f64,
    /// k \[1/s²\].
    pub stiffness_1_s2: f64,
    /// d \[1/s\].
    pub damping_1_s: f64,
    /// s \[m\].
    pub saturation_m: f64,
}

impl PoseAttractor {
    /// The leaf on \[linear; angular\] of a pose moving with `linear`, `angular` towards a goal
    /// at rest.
    #[must_use]
    pub fn evaluate(&self, pose: &Pose, linear: DVec3, angular: DVec3, goal: &Pose) -> Natural<6> {
        let away = pose.position - goal.position;
        let soft = (away.length_squared() + self.saturation_m * self.saturation_m).sqrt();
        let pull = away * (self.stiffness_1_s2 * self.saturation_m / soft);
        let linear_force = (-pull - linear * self.damping_1_s) * self.linear_inertia_kg;
        let chart = orientation_chart(goal.orientation, pose.orientation, angular);
        let j = Matrix3::from_column_slice(&chart.jacobian.to_cols_array());
        let vector = |v: DVec3| Vector3::new(v.x, v.y, v.z);
        let wanted = -vector(chart.rotation) * self.stiffness_1_s2
            - vector(chart.velocity) * self.damping_1_s;
        let force = (wanted + j * vector(chart.bias)) * self.angular_inertia_kg_m2;
        let mut natural = Natural { force: Vector6::zeros(), metric: Matrix6::zeros() };
        natural.force.fixed_rows_mut::<3>(0).copy_from(&vector(linear_force));
        natural.force.fixed_rows_mut::<3>(3).copy_from(&j.tr_mul(&force));
        let linear_metric = Matrix3::identity() * self.linear_inertia_kg;
        natural.metric.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear_metric);
        let angular_metric = j.tr_mul(&j) * self.angular_inertia_kg_m2;
        natural.metric.fixed_view_mut::<3, 3>(3, 3).copy_from(&angular_metric);
        natural
    }

    /// The leaf towards a goal that moves: spring and damping act on the motion relative to it, and
    /// the goal's acceleration is asked for, so that a pose on the goal stays there.
    #[must_use]
    pub fn towards(
        &self,
        pose: &Pose,
        linear: DVec3,
        angular: DVec3,
        goal: &MovingPose,
    ) -> Natural<6> {
        let relative = (linear - goal.velocity.linear, angular - goal.velocity.angular);
        let mut natural = self.evaluate(pose, relative.0, relative.1, &goal.pose);
        let (a, b) = (goal.acceleration.linear, goal.acceleration.angular);
        natural.force += natural.metric * Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z);
        natural
    }
}

/// Follows a velocity of the tool that somebody outside wishes for.
///
/// ```text
/// M = w diag(m I, j I)        f = d M (v_c − v)        on \[linear; angular\]
/// ```
///
/// Alone it tends to v_c within 1/d; beside other leaves it gives way to them by the ratio of the
/// metrics, beside one of the same damping to the mean of both velocities weighed by them. With v_c = 0
/// it is a damping. With any other it does work on the tool, with a force of at most d M v_c on one that
/// moves along: what bounds the motion then is v_c, which is within the maxima, and the leaves beside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityFollower {
    /// m \[kg\].
    pub linear_inertia_kg: f64,
    /// j \[kg m²\].
    pub angular_inertia_kg_m2: f64,
    /// d \[1/s\].
    pub response_1_s: f64,
    /// Largest |v_c| of the origin \[m/s\].
    pub linear_max_m_s: f64,
    /// Largest |v_c| of turning \[rad/s\].
    pub angular_max_rad_s: f64,
}

impl VelocityFollower {
    /// The wished velocity within the maxima, its directions kept. What is finite stays finite.
    #[must_use]
    pub fn within(&self, wished: &Twist) -> Twist {
        let within = |v: DVec3, most: f64| {
            // Squares of the largest numbers are infinite: components that are too large come first.
            let largest = v.abs().max_element();
            if largest > most { (v / largest).normalize() * most } else { v.clamp_length_max(most) }
        };
        Twist {
            linear: within(wished.linear, self.linear_max_m_s),
            angular: within(wished.angular, self.angular_max_rad_s),
        }
    }

    /// The leaf on \[linear; angular\] of a tool moving with `velocity`.
    ///
    /// * `wished`  v_c, within the maxima
    /// * `weight`  w, 0 to 1
    #[must_use]
    pub fn evaluate(&self, velocity: &Twist, wished: &Twist, weight: f64) -> Natural<6> {
        let (m, j) = (weight * self.linear_inertia_kg, weight * self.angular_inertia_kg_m2);
        let linear = (wished.linear - velocity.linear) * (self.response_1_s * m);
        let angular = (wished.angular - velocity.angular) * (self.response_1_s * j);
        Natural {
            force: Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z),
            metric: Matrix6::from_diagonal(&Vector6::new(m, m, m, j, j, j)),
        }
    }
}

/// Damping in joint space: M = m I, f = −d m q̇. It keeps the root's metric positive definite near
/// singular configurations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointDamping {
    /// m \[kg m²\] for revolute joints, \[kg\] for prismatic ones.
    pub inertia: f64,
    /// d \[1/s\].
    pub damping_1_s: f64,
}

impl JointDamping {
    /// The leaf at joint velocity q̇ \[rad/s or m/s\].
    #[must_use]
    pub fn evaluate<const N: usize>(&self, velocity: &SVector<f64, N>) -> Natural<N> {
        Natural {
            force: velocity * (-self.damping_1_s * self.inertia),
            metric: SMatrix::identity() * self.inertia,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use tprmp_spatial::SpatialAcceleration;

    const LEAF: CollisionAvoidance = CollisionAvoidance {
        activation_distance_m: 0.15,
        clearance_min_m: 0.002,
        inertia_kg: 0.5,
        rest_fraction: 0.1,
        approach_speed_m_s: 0.3,
        repulsion_m2_s2: 0.05,
        damping_1_s: 6.0,
    };

    /// V = Φ + ½ G ḋ²; V̇ = −B ḋ² for M d̈ = f.
    #[test]
    fn collision_energy_falls_by_the_damping_alone() {
        let leaf = CollisionAvoidance { damping_1_s: 0.0, ..LEAF };
        let energy = |d: f64, rate: f64| leaf.energy(d, rate);
        let acceleration = |d: f64, rate: f64| {
            let natural = leaf.evaluate(d, rate).unwrap();
            natural.force[0] / natural.metric[0]
        };
        let (mut d, mut rate, dt) = (0.1, -0.4, 1e-5);
        let start = energy(d, rate);
        for _ in 0..10_000 {
            let a = acceleration(d + 0.5 * dt * rate, rate + 0.5 * dt * acceleration(d, rate));
            d += dt * (rate + 0.5 * dt * a);
            rate += dt * a;
            assert!(d > 0.0);
            if d > 0.13 {
                break;
            }
            assert!((energy(d, rate) - start).abs() < 1e-4 * start, "{}", energy(d, rate) / start);
        }
        let free = leaf.evaluate(0.1, -0.4).unwrap().force[0];
        let damped = LEAF.evaluate(0.1, -0.4).unwrap().force[0];
        assert!(damped > free, "damping opposes the approach");
    }

    #[test]
    fn a_shorter_range_is_as_firm_near_a_contact() {
        assert_eq!(LEAF.within(1.0), LEAF);
        let short = LEAF.within(0.2 * LEAF.activation_distance_m);
        assert!(short.evaluate(short.activation_distance_m, -0.1).is_none());
        let metric = |leaf: &CollisionAvoidance, d: f64| leaf.evaluate(d, -0.1).unwrap().metric[0];
        let near = 1e-3 * LEAF.activation_distance_m;
        let [short, long] = [&short, &LEAF]
            .map(|leaf| metric(&CollisionAvoidance { clearance_min_m: near, ..*leaf }, near));
        assert!(short < long && short > 0.98 * long, "{short} {long}");
    }

    #[test]
    fn collision_is_silent_out_of_range_and_finite_in_contact() {
        assert!(LEAF.evaluate(0.15, -1.0).is_none());
        assert!(LEAF.evaluate(f64::NAN, -1.0).is_none());
        for distance in [0.0, -0.05] {
            let natural = LEAF.evaluate(distance, 0.0).unwrap();
            assert!(natural.force[0] > 0.0 && natural.force[0].is_finite());
        }
    }

    #[test]
    fn attractor_lets_a_pose_on_a_moving_goal_go_with_it() {
        let attractor = PoseAttractor {
            linear_inertia_kg: 2.0,
            angular_inertia_kg_m2: 0.3,
            stiffness_1_s2: 20.0,
            damping_1_s: 9.0,
            saturation_m: 0.1,
        };
        let pose = Pose { position: DVec3::ONE, orientation: DQuat::from_rotation_y(0.4) };
        let goal = MovingPose {
            velocity: Twist {
                linear: DVec3::new(0.1, 0.2, -0.3),
                angular: DVec3::new(0.0, 0.4, 0.1),
            },
            acceleration: SpatialAcceleration {
                linear: DVec3::new(1.0, -2.0, 0.5),
                angular: DVec3::new(0.3, 0.2, 0.1),
            },
            ..MovingPose::at_rest(pose)
        };
        let asked = |linear: DVec3, angular: DVec3| {
            let a = attractor.towards(&pose, linear, angular, &goal).resolve().unwrap();
            [DVec3::new(a[0], a[1], a[2]), DVec3::new(a[3], a[4], a[5])]
        };
        let along = asked(goal.velocity.linear, goal.velocity.angular);
        assert!((along[0] - goal.acceleration.linear).length() < 1e-12, "{along:?}");
        assert!((along[1] - goal.acceleration.angular).length() < 1e-12, "{along:?}");
        // A pose that stands still lags behind.
        let still = asked(DVec3::ZERO, DVec3::ZERO);
        let lag = still[0] - goal.acceleration.linear;
        assert!((lag - goal.velocity.linear * 9.0).length() < 1e-12, "{still:?}");
    }

    const FUNNEL: ApproachFunnel =
        ApproachFunnel { axis: DVec3::Z, depth_m: 0.05, width_m: 0.01, leaf: LEAF };

    #[test]
    fn funnel_is_open_on_the_axis_and_closed_beside_it() {
        let frame = MovingPose::at_rest(Pose::IDENTITY);
        let goal = DVec3::new(0.1, 0.0, 0.2);
        let at = |point: DVec3| FUNNEL.clearance(point, DVec3::ZERO, goal, &frame).distance;
        assert!((at(goal) - LEAF.activation_distance_m).abs() < 1e-15);
        assert!(LEAF.evaluate(at(goal + DVec3::Z * 0.01), -0.1).is_none());
        let beside = at(goal + DVec3::X * 0.1);
        assert!((beside - (LEAF.activation_distance_m - 0.05)).abs() < 1e-9);
    }

    #[test]
    fn funnel_of_a_moving_goal_changes_as_its_rate_gradient_and_curvature_say() {
        let omega = 0.8;
        let frame = |t: f64| {
            let spin = DQuat::from_rotation_x(omega * t) * DQuat::from_rotation_y(0.2);
            MovingPose {
                velocity: Twist {
                    linear: DVec3::new(0.1, 0.2 * t, 0.0),
                    angular: DVec3::X * omega,
                },
                acceleration: SpatialAcceleration {
                    linear: DVec3::new(0.0, 0.2, 0.0),
                    angular: DVec3::ZERO,
                },
                ..MovingPose::at_rest(Pose {
                    position: DVec3::new(0.1 * t, 0.1 * t * t, 0.3),
                    orientation: spin,
                })
            }
        };
        let lever = DVec3::new(0.01, -0.02, 0.03);
        let goal = |t: f64| frame(t).pose.position + frame(t).pose.orientation * lever;
        let start = goal(0.3) + DVec3::new(0.006, -0.004, 0.02);
        let velocity = DVec3::new(0.05, -0.1, 0.2);
        let at = |t: f64| {
            let point = start + velocity * (t - 0.3);
            FUNNEL.clearance(point, velocity, goal(t), &frame(t))
        };
        let h = 1e-4;
        let (a, b, c) = (at(0.3 - h), at(0.3), at(0.3 + h));
        assert!((b.rate - (c.distance - a.distance) / (2.0 * h)).abs() < 1e-5);
        let second = (c.distance - 2.0 * b.distance + a.distance) / (h * h);
        assert!((b.curvature - second).abs() < 1e-3 * second.abs(), "{} {second}", b.curvature);
        for direction in [DVec3::X, DVec3::Y, DVec3::Z] {
            let shifted = |s: f64| {
                FUNNEL.clearance(start + direction * s, velocity, goal(0.3), &frame(0.3)).distance
            };
            let slope = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
            assert!((b.normal.dot(direction) - slope).abs() < 1e-6);
        }
    }

    const FOLLOWER: VelocityFollower = VelocityFollower {
        linear_inertia_kg: 4.0,
        angular_inertia_kg_m2: 2.0,
        response_1_s: 8.0,
        linear_max_m_s: 0.25,
        angular_max_rad_s: 1.0,
    };

    fn twist(linear: [f64; 3], angular: [f64; 3]) -> Twist {
        Twist { linear: linear.into(), angular: angular.into() }
    }

    #[test]
    fn a_follower_asks_for_nothing_at_its_velocity_and_tends_to_it_from_any_other() {
        let wished = twist([0.1, -0.05, 0.2], [0.3, 0.0, -0.4]);
        let at = FOLLOWER.evaluate(&wished, &wished, 1.0);
        assert_eq!(at.force, Vector6::zeros());
        let mut velocity = twist([-2.0, 0.3, 0.0], [0.0, 5.0, 1.0]);
        let away = |v: &Twist| {
            let (linear, angular) = (v.linear - wished.linear, v.angular - wished.angular);
            4.0 * linear.length_squared() + 2.0 * angular.length_squared()
        };
        for _ in 0..200 {
            let leaf = FOLLOWER.evaluate(&velocity, &wished, 0.3);
            assert_eq!(leaf.metric, leaf.metric.transpose());
            assert!(leaf.metric.symmetric_eigenvalues().min() > 0.0);
            let a = leaf.resolve().unwrap();
            let before = away(&velocity);
            velocity.linear += DVec3::new(a[0], a[1], a[2]) * 0.005;
            velocity.angular += DVec3::new(a[3], a[4], a[5]) * 0.005;
            // Euler's step of v̇ = d (v_c − v).
            let expected = before * (1.0 - 8.0 * 0.005) * (1.0 - 8.0 * 0.005);
            assert!((away(&velocity) - expected).abs() < 1e-9 * before, "{velocity:?}");
        }
        assert!(away(&velocity) < 1e-5);
    }

    #[test]
    fn a_follower_s_weight_is_that_of_its_metric_and_force_alike() {
        let (velocity, wished) = (twist([0.0; 3], [0.1; 3]), twist([0.2; 3], [0.0; 3]));
        let full = FOLLOWER.evaluate(&velocity, &wished, 1.0);
        let half = FOLLOWER.evaluate(&velocity, &wished, 0.5);
        assert!((half.force * 2.0 - full.force).norm() < 1e-12);
        assert_eq!(half.metric * 2.0, full.metric);
        assert_eq!(FOLLOWER.evaluate(&velocity, &wished, 0.0), Natural::zero());
        assert!((full.force[0] - 8.0 * 4.0 * 0.2).abs() < 1e-12);
        assert!((full.force[3] + 8.0 * 2.0 * 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_wish_beyond_the_maxima_keeps_its_direction_however_large() {
        for size in [1.0, 1e9, 1e200, f64::MAX] {
            let wished = twist([0.0, -0.6 * size, 0.8 * size], [size, 0.0, 0.0]);
            let within = FOLLOWER.within(&wished);
            assert!((within.linear - DVec3::new(0.0, -0.15, 0.2)).length() < 1e-12, "{within:?}");
            assert!((within.angular - DVec3::X).length() < 1e-12, "{within:?}");
        }
        // Each component is small enough, their length is not.
        let within = FOLLOWER.within(&twist([0.2; 3], [0.0; 3]));
        assert!((within.linear.length() - 0.25).abs() < 1e-12);
        let small = twist([0.1, -0.2, 0.0], [0.5, -0.5, 0.5]);
        assert_eq!(FOLLOWER.within(&small), small);
    }

    #[test]
    fn attractor_holds_its_goal_and_saturates_far_away() {
        let attractor = PoseAttractor {
            linear_inertia_kg: 2.0,
            angular_inertia_kg_m2: 0.1,
            stiffness_1_s2: 40.0,
            damping_1_s: 12.0,
            saturation_m: 0.05,
        };
        let goal = Pose {
            position: DVec3::new(0.4, 0.1, 0.3),
            orientation: DQuat::from_scaled_axis(DVec3::new(1.0, 2.0, 0.5)),
        };
        let at_goal = attractor.evaluate(&goal, DVec3::ZERO, DVec3::ZERO, &goal);
        assert!(at_goal.force.norm() < 1e-12);
        let far = Pose { position: goal.position + DVec3::X * 10.0, ..goal };
        let pulled = attractor.evaluate(&far, DVec3::ZERO, DVec3::ZERO, &goal);
        let pull = pulled.resolve().unwrap();
        assert!((pull[0] + 40.0 * 0.05).abs() < 1e-3 && pull.fixed_rows::<5>(1).norm() < 1e-9);
        let turned = Pose {
            orientation: DQuat::from_scaled_axis(DVec3::new(0.0, 0.3, 0.0)) * goal.orientation,
            ..goal
        };
        let turning = attractor.evaluate(&turned, DVec3::ZERO, DVec3::ZERO, &goal);
        let alpha = turning.resolve().unwrap();
        assert!((alpha[4] + 40.0 * 0.3).abs() < 1e-9, "{alpha}");
    }
}
