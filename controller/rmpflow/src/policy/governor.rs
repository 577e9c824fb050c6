//! A governor: keeps the velocity that a learned policy tends to within a speed.

use nalgebra::{Matrix3, Vector3, Vector6};
use tprmp_spatial::Twist;

use crate::leaves::range::{Report, positive};
use crate::natural::{Factor, Natural};

/// Scales the acceleration of a policy on a pose where the velocity it tends to is too fast.
///
/// A policy of damping d with the acceleration a tends to the velocity u = ẋ + a/d. Far from its
/// demonstrations that may be any: where the inertia of a field falls, what moves speeds up. Of the linear and the angular part each tends to s u, with the largest s ≤ 1 for
/// which neither the velocity nor its change is too fast,
///
/// ```text
/// |s u| ≤ v,  |s u − ẋ| ≤ max(v, |ẋ|)
/// a′ = d (s u − ẋ),  so  f′ = s f − (1 − s) d M ẋ        |a′| ≤ d max(v, |ẋ|)
/// ```
///
/// So what moves fast in the wrong direction brakes before it comes back. Where one part is too fast, the
/// other is slowed with it, so that the path stays the same.
///
/// Where it acts, V falls at the rate d ẋᵀM(ẋ + (1−s) u) in place of d ẋᵀMẋ: faster where the policy
/// speeds up, slower where it brakes. So that V falls there too, s stays large enough for
///
/// ```text
/// (1−s) (−ẋᵀMu) ≤ ½ ẋᵀMẋ
/// ```
///
/// what runs up a slope is braked by the whole of it. Only where an obstacle, a push or a limit acts beside the policy,
/// V is not the policy's own, and |a′| is bounded without exception. Where the governor does not act, nothing changes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct SpeedGovernor {
    /// v: largest linear speed \[m/s\].
    pub linear_max_m_s: f64,
    /// Largest angular speed \[rad/s\].
    pub angular_max_rad_s: f64,
    /// d: damping of the policy \[1/s\].
    pub response_1_s: f64,
}

/// Part of the metric's trace that is added to it, so that directions without a policy do not
/// matter.
const METRIC_DAMPING: f64 = 1e-9;

/// What the governor adds to V is at most this fraction of what the damping takes: the rest is for steps that are long.
const LOSS: f64 = 0.5;

impl SpeedGovernor {
    /// Reports parameters outside their ranges.
    pub fn check(&self, report: &mut Report<'_>) {
        positive("linear_max_m_s", self.linear_max_m_s, report);
        positive("angular_max_rad_s", self.angular_max_rad_s, report);
        positive("response_1_s", self.response_1_s, report);
    }

    /// The policy on \[linear; angular\], within the speeds.
    ///
    /// * `velocity`  ẋ of the pose
    /// * `alone`  whether nothing acts beside the policy, [`PolicyState::acts_alone`](crate::policy::PolicyState::acts_alone)
    ///
    /// Hot path: no allocation. A policy whose metric is not positive semi-definite is returned as
    /// it is.
    #[must_use]
    pub fn govern(&self, policy: &Natural<6>, velocity: &Twist, alone: bool) -> Natural<6> {
        let velocity = &Vector6::from(*velocity);
        // Fractions of u within the speed, and within the change of velocity.
        let fractions = |most: f64, first: usize| {
            let block = policy.metric.fixed_view::<3, 3>(first, first);
            let trace = block[(0, 0)] + block[(1, 1)] + block[(2, 2)];
            if trace == 0.0 {
                // Without inertia there is no policy.
                return [1.0; 2];
            }
            let damping = METRIC_DAMPING * trace + 1e-12;
            let damped =
                Matrix3::from_fn(|i, j| block[(i, j)] + if i == j { damping } else { 0.0 });
            let Some(factor) = Factor::new(&damped) else { return [1.0; 2] };
            let part = |v: &Vector6<f64>| Vector3::new(v[first], v[first + 1], v[first + 2]);
            let now = part(velocity);
            let desired = now + factor.solve(&part(&policy.force)) / self.response_1_s;
            [speed_fraction(&desired, most), change_fraction(&desired, &now, most)]
        };
        let linear = fractions(self.linear_max_m_s, 0);
        let angular = fractions(self.angular_max_rad_s, 3);
        // Both are slowed alike, and each brakes for itself.
        let both = linear[0].min(angular[0]);
        let [linear, angular] = [both.min(linear[1]), both.min(angular[1])];
        if linear >= 1.0 && angular >= 1.0 {
            return *policy;
        }
        let momentum = policy.metric * velocity;
        // (1 − s) d M u, by which the force falls.
        let mut less = Vector6::from_fn(|i, _| {
            let s = if i < 3 { linear } else { angular };
            (policy.force[i] + momentum[i] * self.response_1_s) * (1.0 - s)
        });
        let gained = -velocity.dot(&less);
        let lost = LOSS * self.response_1_s * velocity.dot(&momentum);
        if alone && gained > lost {
            less *= lost / gained;
        }
        let force = policy.force - less;
        Natural { force, metric: policy.metric }
    }
}

/// The largest s ≤ 1 with |s u| ≤ v.
fn speed_fraction(desired: &Vector3<f64>, most: f64) -> f64 {
    let squared = desired.norm_squared();
    if squared > most * most { most / squared.sqrt() } else { 1.0 }
}

/// The largest s ≤ 1 with |s u − ẋ| ≤ max(v, |ẋ|). There is one: s = 0 will do.
fn change_fraction(desired: &Vector3<f64>, now: &Vector3<f64>, most: f64) -> f64 {
    let change = most.max(now.norm());
    if (desired - now).norm_squared() <= change * change {
        return 1.0;
    }
    // s²|u|² − 2 s u·ẋ + |ẋ|² = max(v, |ẋ|)²
    let (squared, along) = (desired.norm_squared(), desired.dot(now));
    let room = squared * (change * change - now.norm_squared()).max(0.0);
    ((along + (along * along + room).sqrt()) / squared).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use nalgebra::Matrix6;
    use proptest::prelude::*;

    const GOVERNOR: SpeedGovernor =
        SpeedGovernor { linear_max_m_s: 2.0, angular_max_rad_s: 4.0, response_1_s: 8.0 };

    fn policy(linear: f64, angular: f64) -> Natural<6> {
        let metric = Matrix6::from_diagonal(&Vector6::new(2.0, 1.0, 3.0, 0.5, 0.5, 0.1));
        Natural { force: metric * Vector6::new(linear, 0.0, 0.0, 0.0, angular, 0.0), metric }
    }

    fn along(speed: f64) -> Twist {
        Twist { linear: DVec3::X * speed, angular: DVec3::ZERO }
    }

    #[test]
    fn a_slow_policy_is_left_alone_and_a_fast_one_tends_to_the_speed() {
        let velocity = Twist { linear: DVec3::X * 0.5, angular: DVec3::Y };
        let slow = policy(8.0 * 1.4, 0.0);
        assert_eq!(GOVERNOR.govern(&slow, &velocity, false), slow);
        // u = 0.5 + 100/8 = 13 m/s.
        let fast = GOVERNOR.govern(&policy(100.0, 0.0), &velocity, false).resolve().unwrap();
        assert!((velocity.linear.x + fast[0] / 8.0 - 2.0).abs() < 1e-6, "{fast}");
        // The rotation is slowed with it, so that the path stays the same.
        assert!((velocity.angular.y + fast[4] / 8.0 - 2.0 / 13.0).abs() < 1e-6, "{fast}");
        let rotating = GOVERNOR.govern(&policy(0.0, 100.0), &velocity, false).resolve().unwrap();
        assert!((velocity.angular.y + rotating[4] / 8.0 - 4.0).abs() < 1e-6, "{rotating}");
    }

    #[test]
    fn what_moves_in_the_wrong_direction_brakes_before_it_comes_back() {
        // u = 13 m/s in the other direction: the change stays within 2 m/s, or |ẋ| where that is more.
        for (speed, change) in [(-0.5, 2.0), (-1.5, 2.0), (-2.0, 2.0), (-3.0, 3.0)] {
            let velocity = along(speed);
            let acceleration = 8.0 * (13.0 - speed);
            let back =
                GOVERNOR.govern(&policy(acceleration, 0.0), &velocity, false).resolve().unwrap();
            assert!((back[0] / 8.0 - change).abs() < 1e-6, "{speed}: {back}");
        }
        // Across the motion, too.
        let velocity = along(1.6);
        let mut across = policy(-8.0 * 1.6, 0.0);
        across.force[1] = 8.0 * 5.0;
        let back = GOVERNOR.govern(&across, &velocity, false).resolve().unwrap();
        assert!((back[0].hypot(back[1]) / 8.0 - 2.0).abs() < 1e-6, "{back}");
        assert!((velocity.linear.x * 8.0 + back[0]).abs() < 1e-6 && back[1] > 0.0, "{back}");
    }

    #[test]
    fn alone_it_takes_energy_out_and_never_adds_any() {
        // V̇ = ẋᵀ(f′ − f) − d ẋᵀMẋ, for f = −∇Φ − ξ − d M ẋ.
        for (speed, pull) in [(-0.5, 100.0), (-3.0, 40.0), (1.0, 100.0), (-1.9, 1e4)] {
            let velocity = along(speed);
            let free = policy(pull - 8.0 * speed, 3.0);
            let rate = |alone: bool| {
                let governed = GOVERNOR.govern(&free, &velocity, alone);
                let twist = Vector6::from(velocity);
                twist.dot(&(governed.force - free.force)) - 8.0 * twist.dot(&(free.metric * twist))
            };
            assert!(rate(true) < 0.0, "{speed}: {}", rate(true));
            assert!(rate(true) <= rate(false), "{speed}");
        }
    }

    #[test]
    fn braking_in_one_part_leaves_the_other_alone() {
        // Pushed faster than 2 m/s, the policy stops or comes back: it goes on rotating all the same.
        let velocity = along(3.0);
        for desired in [0.1, -0.1, -1.0] {
            let free = policy(8.0 * (desired - 3.0), 8.0 * 2.0);
            let governed = GOVERNOR.govern(&free, &velocity, false).resolve().unwrap();
            assert!((governed[4] / 8.0 - 2.0).abs() < 1e-6, "{desired}: {governed}");
            assert!(governed[0] / 8.0 >= -3.0 - 1e-6, "{desired}: {governed}");
        }
    }

    proptest! {
        #[test]
        fn the_fraction_is_the_largest_that_keeps_the_change(
            u in prop::array::uniform3(-9.0..9.0f64),
            x in prop::array::uniform3(-4.0..4.0f64),
        ) {
            let (u, x, v) = (Vector3::from(u), Vector3::from(x), 2.0);
            // Across the motion the bound hardly depends on the fraction.
            prop_assume!(x.norm() < 1.99 || u.dot(&x).abs() > 0.01 * x.norm());
            let s = change_fraction(&u, &x, v);
            let keeps = |s: f64| (u * s - x).norm() <= v.max(x.norm()) + 1e-9;
            prop_assert!((0.0..=1.0).contains(&s) && keeps(s));
            prop_assert!(s == 1.0 || !keeps(s + 1e-6));
            prop_assert!((u * speed_fraction(&u, v)).norm() <= v + 1e-9);
        }
    }

    #[test]
    fn a_plane_s_policy_without_inertia_elsewhere_is_governed_too() {
        let mut plane = policy(100.0, 0.0);
        for i in 2..6 {
            plane.metric[(i, i)] = 0.0;
        }
        let governed = GOVERNOR.govern(&plane, &Twist::ZERO, false);
        assert!((governed.force[0] / governed.metric[(0, 0)] - 16.0).abs() < 1e-6);
        assert!(governed.force.iter().all(|f| f.is_finite()));
    }
}
