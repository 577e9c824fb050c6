//! A follower of commanded velocities.

use glam::DVec3;
use nalgebra::{Matrix6, Vector6};
use tprmp_spatial::{Twist, Wrench};

use crate::leaves::range::{Report, positive};
use crate::natural::Natural;

/// Follows a velocity of the tool that is commanded from outside.
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
    /// Largest |v_c| \[m/s\].
    pub linear_max_m_s: f64,
    /// Largest |ω_c| \[rad/s\].
    pub angular_max_rad_s: f64,
}

impl VelocityFollower {
    /// Reports parameters outside their ranges.
    pub fn check(&self, report: &mut Report<'_>) {
        positive("linear_inertia_kg", self.linear_inertia_kg, report);
        positive("angular_inertia_kg_m2", self.angular_inertia_kg_m2, report);
        positive("response_1_s", self.response_1_s, report);
        positive("linear_max_m_s", self.linear_max_m_s, report);
        positive("angular_max_rad_s", self.angular_max_rad_s, report);
    }

    /// The commanded velocity within the maxima, its directions kept. What is finite stays finite.
    #[must_use]
    pub fn within(&self, commanded: &Twist) -> Twist {
        let within = |v: DVec3, most: f64| {
            // Squares of the largest numbers are infinite: components that are too large come first.
            let largest = v.abs().max_element();
            if largest > most { (v / largest).normalize() * most } else { v.clamp_length_max(most) }
        };
        Twist {
            linear: within(commanded.linear, self.linear_max_m_s),
            angular: within(commanded.angular, self.angular_max_rad_s),
        }
    }

    /// The leaf on \[linear; angular\] of a tool moving with `velocity`.
    ///
    /// * `commanded`  v_c, within the maxima
    /// * `weight`  w, 0 to 1
    #[must_use]
    pub fn evaluate(&self, velocity: &Twist, commanded: &Twist, weight: f64) -> Natural<6> {
        let (m, j) = (weight * self.linear_inertia_kg, weight * self.angular_inertia_kg_m2);
        let change = *commanded - *velocity;
        let force = Wrench {
            force: change.linear * (self.response_1_s * m),
            torque: change.angular * (self.response_1_s * j),
        };
        Natural {
            force: force.into(),
            metric: Matrix6::from_diagonal(&Vector6::new(m, m, m, j, j, j)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let commanded = twist([0.1, -0.05, 0.2], [0.3, 0.0, -0.4]);
        let at = FOLLOWER.evaluate(&commanded, &commanded, 1.0);
        assert_eq!(at.force, Vector6::zeros());
        let mut velocity = twist([-2.0, 0.3, 0.0], [0.0, 5.0, 1.0]);
        let away = |v: &Twist| {
            let (linear, angular) = (v.linear - commanded.linear, v.angular - commanded.angular);
            4.0 * linear.length_squared() + 2.0 * angular.length_squared()
        };
        for _ in 0..200 {
            let leaf = FOLLOWER.evaluate(&velocity, &commanded, 0.3);
            assert_eq!(leaf.metric, leaf.metric.transpose());
            assert!(leaf.metric.symmetric_eigenvalues().min() > 0.0);
            let acceleration = leaf.resolve().unwrap().into();
            let before = away(&velocity);
            velocity = velocity.advanced(&acceleration, 0.005);
            // Euler's step of v̇ = d (v_c − v).
            let expected = before * (1.0 - 8.0 * 0.005) * (1.0 - 8.0 * 0.005);
            assert!((away(&velocity) - expected).abs() < 1e-9 * before, "{velocity:?}");
        }
        assert!(away(&velocity) < 1e-5);
    }

    #[test]
    fn a_follower_s_weight_is_that_of_its_metric_and_force_alike() {
        let (velocity, commanded) = (twist([0.0; 3], [0.1; 3]), twist([0.2; 3], [0.0; 3]));
        let full = FOLLOWER.evaluate(&velocity, &commanded, 1.0);
        let half = FOLLOWER.evaluate(&velocity, &commanded, 0.5);
        assert!((half.force * 2.0 - full.force).norm() < 1e-12);
        assert_eq!(half.metric * 2.0, full.metric);
        assert_eq!(FOLLOWER.evaluate(&velocity, &commanded, 0.0), Natural::zero());
        assert!((full.force[0] - 8.0 * 4.0 * 0.2).abs() < 1e-12);
        assert!((full.force[3] + 8.0 * 2.0 * 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_command_beyond_the_maxima_keeps_its_direction_however_large() {
        for size in [1.0, 1e9, 1e200, f64::MAX] {
            let commanded = twist([0.0, -0.6 * size, 0.8 * size], [size, 0.0, 0.0]);
            let within = FOLLOWER.within(&commanded);
            assert!((within.linear - DVec3::new(0.0, -0.15, 0.2)).length() < 1e-12, "{within:?}");
            assert!((within.angular - DVec3::X).length() < 1e-12, "{within:?}");
        }
        // Each component is small enough, their length is not.
        let within = FOLLOWER.within(&twist([0.2; 3], [0.0; 3]));
        assert!((within.linear.length() - 0.25).abs() < 1e-12);
        let small = twist([0.1, -0.2, 0.0], [0.5, -0.5, 0.5]);
        assert_eq!(FOLLOWER.within(&small), small);
    }
}
