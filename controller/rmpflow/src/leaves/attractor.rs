//! An attractor on poses.

use nalgebra::{Matrix3, Vector3, Vector6};
use tprmp_spatial::rotation::orientation_chart;
use tprmp_spatial::{MovingPose, Pose, Twist};

use crate::leaves::range::{Report, not_negative, positive};
use crate::natural::Natural;

/// Pulls a pose to a goal: a spring whose force saturates, and damping.
///
/// M = diag(m I, j I), Φ = m k s (√(|e|² + s²) − s) in position and ½ j k |r|² in the orientation
/// chart at the goal, B = d M. The pull saturates at m k s, so that a far goal gives a steady
/// speed k s/d.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
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
    /// Reports parameters outside their ranges.
    pub fn check(&self, report: &mut Report<'_>) {
        positive("linear_inertia_kg", self.linear_inertia_kg, report);
        not_negative("angular_inertia_kg_m2", self.angular_inertia_kg_m2, report);
        positive("stiffness_1_s2", self.stiffness_1_s2, report);
        positive("damping_1_s", self.damping_1_s, report);
        positive("saturation_m", self.saturation_m, report);
    }

    /// The leaf on \[linear; angular\] of a pose that moves with `velocity`, towards a goal at rest.
    #[must_use]
    pub fn evaluate(&self, pose: &Pose, velocity: &Twist, goal: &Pose) -> Natural<6> {
        let away = pose.position - goal.position;
        let soft = (away.length_squared() + self.saturation_m * self.saturation_m).sqrt();
        let pull = away * (self.stiffness_1_s2 * self.saturation_m / soft);
        let force = (-pull - velocity.linear * self.damping_1_s) * self.linear_inertia_kg;
        let chart = orientation_chart(goal.orientation, pose.orientation, velocity.angular);
        let jacobian = Matrix3::from(chart.jacobian);
        let desired = Vector3::from(
            -chart.rotation * self.stiffness_1_s2 - chart.velocity * self.damping_1_s,
        );
        let torque = (desired + jacobian * Vector3::from(chart.bias)) * self.angular_inertia_kg_m2;
        let mut natural = Natural::<6>::zero();
        natural.force.fixed_rows_mut::<3>(0).copy_from(&force.into());
        natural.force.fixed_rows_mut::<3>(3).copy_from(&jacobian.tr_mul(&torque));
        let linear_metric = Matrix3::identity() * self.linear_inertia_kg;
        natural.metric.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear_metric);
        let angular_metric = jacobian.tr_mul(&jacobian) * self.angular_inertia_kg_m2;
        natural.metric.fixed_view_mut::<3, 3>(3, 3).copy_from(&angular_metric);
        natural
    }

    /// The leaf towards a goal that moves: spring and damping act on the motion relative to it, and
    /// the goal's acceleration is added, so that a pose on the goal stays there.
    #[must_use]
    pub fn towards(&self, pose: &Pose, velocity: &Twist, goal: &MovingPose) -> Natural<6> {
        let mut natural = self.evaluate(pose, &(*velocity - goal.velocity), &goal.pose);
        natural.force += natural.metric * Vector6::from(goal.acceleration);
        natural
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use tprmp_spatial::SpatialAcceleration;

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
        let resolved = |velocity: &Twist| {
            let acceleration = attractor.towards(&pose, velocity, &goal).resolve().unwrap();
            SpatialAcceleration::from(acceleration)
        };
        let error = resolved(&goal.velocity) - goal.acceleration;
        assert!(error.linear.length() < 1e-12 && error.angular.length() < 1e-12, "{error:?}");
        // A pose at rest lags behind.
        let still = resolved(&Twist::ZERO);
        let lag = still.linear - goal.acceleration.linear;
        assert!((lag - goal.velocity.linear * 9.0).length() < 1e-12, "{still:?}");
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
        let at_goal = attractor.evaluate(&goal, &Twist::ZERO, &goal);
        assert!(at_goal.force.norm() < 1e-12);
        let far = Pose { position: goal.position + DVec3::X * 10.0, ..goal };
        let pulled = attractor.evaluate(&far, &Twist::ZERO, &goal);
        let pull = pulled.resolve().unwrap();
        assert!((pull[0] + 40.0 * 0.05).abs() < 1e-3 && pull.fixed_rows::<5>(1).norm() < 1e-9);
        let rotated = Pose {
            orientation: DQuat::from_scaled_axis(DVec3::new(0.0, 0.3, 0.0)) * goal.orientation,
            ..goal
        };
        let pulled = attractor.evaluate(&rotated, &Twist::ZERO, &goal);
        let alpha = pulled.resolve().unwrap();
        assert!((alpha[4] + 40.0 * 0.3).abs() < 1e-9, "{alpha}");
    }
}
