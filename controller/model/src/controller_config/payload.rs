//! What the tool carries: all the time, or while the gripper holds it.

use serde::Deserialize;
use tprmp_robot::PointMass;

use crate::controller_config::check::Check;

/// What the tool carries all the time, beside what the URDF says.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Centre of mass in the tool's frame \[m\].
    pub centre_m: [f64; 3],
}

/// What counts while the gripper says that it holds something.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gripped {
    /// Mass; 0 where it is not known \[kg\].
    pub mass_kg: f64,
    /// Centre of mass in the tool's frame \[m\].
    pub centre_m: [f64; 3],
    /// Spheres that cover it: they keep clear of obstacles as the arm's own do, and may come as near to them as
    /// `robot.tool_link` may by `collision.exempt`. `[]` where only its mass counts.
    pub spheres: Vec<Sphere>,
    /// The obstacle whose centre is nearest to that of the object, and nearer than this, is the object: it is none
    /// while the gripper holds. 0 where the object is not published \[m\].
    pub obstacle_within_m: f64,
}

/// A sphere in the tool's frame.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sphere {
    /// Centre \[m\].
    pub position_m: [f64; 3],
    /// Radius \[m\].
    pub radius_m: f64,
}

impl Payload {
    /// As a body of the robot.
    #[must_use]
    pub fn body(&self) -> PointMass {
        PointMass { mass: self.mass_kg, centre: self.centre_m.into() }
    }

    pub(super) fn check(&self, check: &mut Check) {
        check.positive("mass_kg", self.mass_kg);
        finite("centre_m", &self.centre_m, check);
    }
}

impl Gripped {
    /// As a body of the robot.
    #[must_use]
    pub fn body(&self) -> PointMass {
        PointMass { mass: self.mass_kg, centre: self.centre_m.into() }
    }

    pub(super) fn check(&self, check: &mut Check) {
        check.not_negative("mass_kg", self.mass_kg);
        finite("centre_m", &self.centre_m, check);
        check.not_negative("obstacle_within_m", self.obstacle_within_m);
        for (i, sphere) in self.spheres.iter().enumerate() {
            finite(&format!("spheres[{i}].position_m"), &sphere.position_m, check);
            check.positive(&format!("spheres[{i}].radius_m"), sphere.radius_m);
        }
    }
}

fn finite(key: &str, position: &[f64; 3], check: &mut Check) {
    let is_finite = position.iter().all(|number| number.is_finite());
    check.require(is_finite, key, "three finite numbers", position);
}
