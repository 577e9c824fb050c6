//! A leaf that keeps an axis of the tool along one of the base.

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;
use tprmp_spatial::Pose;

use crate::leaves::range::{Report, direction, positive};
use crate::natural::Natural;

/// Turns an axis of the tool to an axis of the base, and leaves the rotation about it free.
///
/// On a ∈ ℝ³, the tool's axis in the base, with b the base's,
///
/// ```text
/// M = j I,   Φ = j k (1 − aᵀb),   B = d M           ȧ = ω × a,   d/dt ȧ = α × a + ω × (ω × a)
/// ```
///
/// M is constant, so there is no curvature. The angle θ between the axes has the potential j k (1 − cos θ) and the
/// pull j k sin θ. Its other place of rest, the tool upside down, is not stable.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct KeepUpright {
    /// Axis of the tool, in its own frame.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::leaves::keys::unit_vector"))]
    pub tool_axis: DVec3,
    /// b: where it points, in the base.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::leaves::keys::unit_vector"))]
    pub base_axis: DVec3,
    /// j \[kg m²\].
    pub angular_inertia_kg_m2: f64,
    /// k \[1/s²\].
    pub stiffness_1_s2: f64,
    /// d \[1/s\].
    pub damping_1_s: f64,
}

impl KeepUpright {
    /// Reports parameters outside their ranges.
    pub fn check(&self, report: &mut Report<'_>) {
        direction("tool_axis", self.tool_axis, report);
        direction("base_axis", self.base_axis, report);
        positive("angular_inertia_kg_m2", self.angular_inertia_kg_m2, report);
        positive("stiffness_1_s2", self.stiffness_1_s2, report);
        positive("damping_1_s", self.damping_1_s, report);
    }

    /// The leaf on \[linear; angular\] of a tool that rotates with ω \[rad/s\]. Hot path: no allocation.
    #[must_use]
    pub fn evaluate(&self, tool: &Pose, omega: DVec3) -> Natural<6> {
        let axis = tool.orientation * self.tool_axis;
        let velocity = omega.cross(axis);
        let drift = omega.cross(velocity);
        let residual = self.base_axis * self.stiffness_1_s2 - velocity * self.damping_1_s - drift;
        // J = −[a]ₓ: Jᵀ f = a × f, JᵀJ = I − a aᵀ.
        let torque = axis.cross(residual) * self.angular_inertia_kg_m2;
        let outer = DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        let metric = (DMat3::IDENTITY - outer) * self.angular_inertia_kg_m2;
        let mut natural = Natural::<6>::zero();
        natural.force.fixed_rows_mut::<3>(3).copy_from(&torque.into());
        natural.metric.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::from(metric));
        natural
    }

    /// V \[J\], for a tool that rotates with ω \[rad/s\].
    #[must_use]
    pub fn energy(&self, tool: &Pose, omega: DVec3) -> f64 {
        let axis = tool.orientation * self.tool_axis;
        let potential = self.stiffness_1_s2 * (1.0 - axis.dot(self.base_axis));
        self.angular_inertia_kg_m2 * (potential + 0.5 * omega.cross(axis).length_squared())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;
    use tprmp_spatial::Twist;

    const LEAF: KeepUpright = KeepUpright {
        tool_axis: DVec3::Z,
        base_axis: DVec3::NEG_Z,
        angular_inertia_kg_m2: 0.4,
        stiffness_1_s2: 30.0,
        damping_1_s: 9.0,
    };

    fn vector(most: f64) -> impl Strategy<Value = DVec3> {
        [-most..most, -most..most, -most..most].prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn force_metric_and_damping_are_those_of_the_energy(at in vector(2.0), omega in vector(3.0)) {
            let pose = Pose { position: DVec3::ONE, orientation: DQuat::from_scaled_axis(at) };
            // ½ ωᵀMω is the kinetic energy.
            let natural = LEAF.evaluate(&pose, omega);
            let twist = nalgebra::Vector6::from(Twist { linear: DVec3::ZERO, angular: omega });
            let kinetic = LEAF.energy(&pose, omega) - LEAF.energy(&pose, DVec3::ZERO);
            prop_assert!((0.5 * twist.dot(&(natural.metric * twist)) - kinetic).abs() < 1e-12);
            // The energy changes by −d ωᵀMω along the motion that the leaf asks for.
            let alpha = natural.metric.svd(true, true).solve(&natural.force, 1e-9).unwrap();
            let alpha = DVec3::new(alpha[3], alpha[4], alpha[5]);
            let energy = |t: f64| {
                let turned = DQuat::from_scaled_axis(omega * t + alpha * (0.5 * t * t)) * pose.orientation;
                LEAF.energy(&Pose { orientation: turned, ..pose }, omega + alpha * t)
            };
            let h = 1e-5;
            let rate = (energy(h) - energy(-h)) / (2.0 * h);
            let expected = -LEAF.damping_1_s * twist.dot(&(natural.metric * twist));
            prop_assert!((rate - expected).abs() < 1e-5 * (1.0 + expected.abs()), "{rate} {expected}");
            // What turns the tool about its axis is free.
            let axis = pose.orientation * DVec3::Z;
            prop_assert!((natural.force.fixed_rows::<3>(3).dot(&axis.into())).abs() < 1e-9);
        }
    }
}
