//! Leaves as they are configured: those of `tprmp_rmpflow` themselves, with what else stands beside
//! their parameters.

use nalgebra::SVector;
use serde::Deserialize;
use tprmp_rmpflow::leaves::{
    Avoidance, Barrier, PoseAttractor, Posture, Steering, VelocityFollower,
};
use tprmp_rmpflow::policy::{SkillInertia, SpeedGovernor};

use crate::controller_config::check::Check;

/// A link and a kind of obstacle that need not keep apart, or not as far as others.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Exemption {
    /// Name of the link.
    pub link: String,
    /// Kind of obstacle.
    pub obstacle: ExemptObstacle,
    /// How much is exempt.
    pub extent: Extent,
}

/// How much of a link is exempt from keeping clear, or how near it may come.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub enum Extent {
    /// All of it.
    Whole,
    /// The points this near to the axis of the joint that moves the link, which can hardly move away \[m\].
    NearAxis(f64),
    /// What is above this clearance, margin taken off; below it nothing \[m\]. Points that move with the
    /// tool may come that near at their goal; elsewhere they keep half the distance to it besides.
    Above(f64),
}

impl Extent {
    /// Clearance within which a point at this distance from its joint's axis \[m\] keeps clear: 0 where
    /// it does not, `None` where it is not exempt \[m\].
    #[must_use]
    pub fn acts_within(&self, from_axis_m: f64) -> Option<f64> {
        match *self {
            Self::Whole => Some(0.0),
            Self::NearAxis(distance) => (from_axis_m < distance).then_some(0.0),
            Self::Above(clearance) => Some(clearance),
        }
    }
}

/// A kind of obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum ExemptObstacle {
    /// Balls.
    Sphere,
    /// Capsules.
    Capsule,
    /// Boxes.
    Box,
    /// Half-spaces.
    HalfSpace,
}

/// Collision avoidance.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Collision {
    /// Clearance that is added to every link's radius \[m\].
    pub margin_m: f64,
    /// How the clearance between links and obstacles is kept.
    #[serde(deserialize_with = "Barrier::on_length")]
    pub avoidance: Barrier,
    /// How links go around obstacles, `None` where they shall wait.
    #[serde(deserialize_with = "Option::deserialize")]
    pub steering: Option<Steering>,
    /// What obstacles add to a joint's acceleration takes at least this long to grow to
    /// `robot.acceleration_max` \[s\].
    pub ramp_time_s: f64,
    /// Pairs that need not keep apart, e.g. the tool and the table it picks from.
    pub exempt: Vec<Exemption>,
}

impl Collision {
    /// The leaf and the steering.
    #[must_use]
    pub fn leaf(&self) -> Avoidance {
        Avoidance { leaf: self.avoidance, steering: self.steering, margin_m: self.margin_m }
    }

    pub(super) fn check(&self, check: &mut Check) {
        check.leaf("avoidance", |report| self.avoidance.check(&Barrier::KEYS_ON_LENGTH, report));
        check.not_negative("margin_m", self.margin_m);
        check.positive("ramp_time_s", self.ramp_time_s);
        for (i, exemption) in self.exempt.iter().enumerate() {
            check.within(&format!("exempt[{i}]"), |check| match exemption.extent {
                Extent::Whole => {}
                Extent::NearAxis(distance) => check.positive("extent, NearAxis", distance),
                Extent::Above(clearance) => {
                    let is_more = clearance > self.avoidance.distance_min;
                    let expected = "more than collision.avoidance.clearance_min_m";
                    check.require(is_more, "extent, Above", expected, &clearance);
                }
            });
        }
        if let Some(steering) = &self.steering {
            check.leaf("steering", |report| steering.check(report));
        }
    }
}

/// Clearance of the arm from itself.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SelfCollision {
    /// Clearance that is added between two links \[m\].
    pub margin_m: f64,
    /// How it is kept.
    #[serde(deserialize_with = "Barrier::on_length")]
    pub avoidance: Barrier,
    /// Pairs of links that need not keep apart, besides neighbours and those that touch in any
    /// posture.
    pub exempt: Vec<(String, String)>,
}

impl SelfCollision {
    pub(super) fn check(&self, check: &mut Check) {
        check.leaf("avoidance", |report| self.avoidance.check(&Barrier::KEYS_ON_LENGTH, report));
        check.not_negative("margin_m", self.margin_m);
    }
}

/// The posture to which an arm returns where its task leaves it free.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PostureLeaf {
    /// Joint positions \[rad or m\].
    pub position: Vec<f64>,
    /// Inertia \[kg m² or kg\].
    pub inertia: f64,
    /// Stiffness \[1/s²\].
    pub stiffness_1_s2: f64,
    /// Damping \[1/s\].
    pub damping_1_s: f64,
    /// Distance at which the pull saturates \[rad or m\].
    pub saturation: f64,
}

impl PostureLeaf {
    /// The leaf of a robot with N joints.
    ///
    /// # Panics
    /// When there is not a position for each joint.
    #[must_use]
    pub fn leaf<const N: usize>(&self) -> Posture<N> {
        Posture {
            position: SVector::from_column_slice(&self.position),
            inertia: self.inertia,
            stiffness_1_s2: self.stiffness_1_s2,
            damping_1_s: self.damping_1_s,
            saturation: self.saturation,
        }
    }

    pub(super) fn check(&self, joints: usize, check: &mut Check) {
        let position = &self.position;
        let holds = position.len() == joints && position.iter().all(|q| q.is_finite());
        check.require(holds, "position", "one finite number for each joint", position);
        check.not_negative("inertia", self.inertia);
        check.not_negative("stiffness_1_s2", self.stiffness_1_s2);
        check.not_negative("damping_1_s", self.damping_1_s);
        check.positive("saturation", self.saturation);
    }
}

/// What a skill moves of what it was learned for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Moves {
    /// All of it.
    Whole,
    /// The position of a skill on poses: its orientation is left to the arm and to other leaves.
    Position,
}

/// The weight of a skill against other leaves, and its speed.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkillLeaf {
    /// What it moves of the tool's pose.
    pub moves: Moves,
    /// Inertia of the position at the goal \[kg\].
    pub linear_inertia_kg: f64,
    /// Inertia of the orientation at the goal \[kg m²\].
    pub angular_inertia_kg_m2: f64,
    /// The speeds within which it is followed.
    pub governor: SpeedGovernor,
}

impl SkillLeaf {
    /// The inertia.
    #[must_use]
    pub fn inertia(&self) -> SkillInertia {
        SkillInertia {
            linear_kg: self.linear_inertia_kg,
            angular_kg_m2: self.angular_inertia_kg_m2,
        }
    }

    pub(super) fn check(&self, check: &mut Check) {
        check.positive("linear_inertia_kg", self.linear_inertia_kg);
        check.positive("angular_inertia_kg_m2", self.angular_inertia_kg_m2);
        check.leaf("governor", |report| self.governor.check(report));
    }
}

/// What is done once the gripper holds the object.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lift {
    /// The gripper closes within this distance of the goal \[m\].
    pub grip_distance_m: f64,
    /// … and this angle \[rad\].
    pub grip_angle_rad: f64,
    /// How high the tool is lifted along the base's z axis \[m\].
    pub height_m: f64,
    /// What pulls it there.
    pub attractor: PoseAttractor,
}

impl Lift {
    pub(super) fn check(&self, check: &mut Check) {
        check.positive("grip_distance_m", self.grip_distance_m);
        check.positive("grip_angle_rad", self.grip_angle_rad);
        check.positive("height_m", self.height_m);
        check.leaf("attractor", |report| self.attractor.check(report));
    }
}

/// The weight of velocities of the tool that are commanded from outside: by a joystick, by hand
/// guiding, by another planner.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct External {
    /// Inertia with which the commanded velocity counts beside the skill's \[kg\].
    pub linear_inertia_kg: f64,
    /// The same for rotation \[kg m²\].
    pub angular_inertia_kg_m2: f64,
    /// How fast the tool tends to it \[1/s\].
    pub response_1_s: f64,
    /// Faster commands are shortened to this \[m/s\].
    pub linear_max_m_s: f64,
    /// The same for rotation \[rad/s\].
    pub angular_max_rad_s: f64,
    /// Time over which it gains its weight and loses it again \[s\].
    pub fade_s: f64,
    /// Older commands count no more \[ns\].
    pub age_max_ns: u64,
}

impl External {
    /// The leaf.
    #[must_use]
    pub fn leaf(&self) -> VelocityFollower {
        VelocityFollower {
            linear_inertia_kg: self.linear_inertia_kg,
            angular_inertia_kg_m2: self.angular_inertia_kg_m2,
            response_1_s: self.response_1_s,
            linear_max_m_s: self.linear_max_m_s,
            angular_max_rad_s: self.angular_max_rad_s,
        }
    }

    pub(super) fn check(&self, check: &mut Check) {
        self.leaf().check(&mut |key, expected, found| check.fail(key, expected, found));
        check.positive("fade_s", self.fade_s);
        check.time("age_max_ns", self.age_max_ns);
    }
}
