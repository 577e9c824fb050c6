//! A funnel around the approach to a goal.

use glam::DVec3;
use tprmp_spatial::MovingPose;
use tprmp_spatial::jet::{Jet, Real, Vec3};

use crate::leaves::barrier::{Barrier, Clearance};
use crate::leaves::range::{Report, direction, positive};

/// A funnel around the approach to a goal: away from the approach axis the tool keeps above it.
///
/// ```text
/// e = x − g,  e_⊥ = e − a (aᵀe)              a: approach axis, fixed in the goal frame
/// φ = d₀ + aᵀe − h (1 − exp(−|e_⊥|²/2w²))   ≥ 0
/// ```
///
/// φ is a clearance like any other, so that [`Barrier`] with d₀ as its activation
/// distance keeps it positive; at the goal, and above it on the axis, that leaf is inactive.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct ApproachFunnel {
    /// a, out of the funnel, in the goal frame, unit; in files of any length but zero.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::leaves::keys::unit_vector"))]
    pub axis: DVec3,
    /// h: height of the rim above the bottom \[m\].
    pub depth_m: f64,
    /// w: half-width of the hole \[m\].
    pub width_m: f64,
    /// d₀ and the leaf on φ.
    #[cfg_attr(
        feature = "serde",
        serde(rename = "avoidance", deserialize_with = "Barrier::on_length")
    )]
    pub leaf: Barrier,
}

impl ApproachFunnel {
    /// Reports parameters outside their ranges, but for those of its leaf.
    pub fn check(&self, report: &mut Report<'_>) {
        direction("axis", self.axis, report);
        positive("depth_m", self.depth_m, report);
        positive("width_m", self.width_m, report);
    }

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
        let bell = scaled.chain([fraction; 3]);
        let start = Jet::constant(self.leaf.activation_distance - self.depth_m);
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use tprmp_spatial::{Pose, SpatialAcceleration, Twist};

    const LEAF: Barrier = Barrier {
        activation_distance: 0.15,
        distance_min: 0.002,
        inertia: 0.5,
        rest_fraction: 0.1,
        approach_speed: 0.3,
        repulsion: 0.05,
        damping_1_s: 6.0,
    };

    const FUNNEL: ApproachFunnel =
        ApproachFunnel { axis: DVec3::Z, depth_m: 0.05, width_m: 0.01, leaf: LEAF };

    #[test]
    fn funnel_is_open_on_the_axis_and_closed_beside_it() {
        let frame = MovingPose::at_rest(Pose::IDENTITY);
        let goal = DVec3::new(0.1, 0.0, 0.2);
        let at = |point: DVec3| FUNNEL.clearance(point, DVec3::ZERO, goal, &frame).distance;
        assert!((at(goal) - LEAF.activation_distance).abs() < 1e-15);
        assert!(LEAF.evaluate(at(goal + DVec3::Z * 0.01), -0.1).is_none());
        let beside = at(goal + DVec3::X * 0.1);
        assert!((beside - (LEAF.activation_distance - 0.05)).abs() < 1e-9);
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
}
