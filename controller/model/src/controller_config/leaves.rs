//! The leaves of the tree as they are configured.

use glam::DVec3;
use serde::Deserialize;
use tprmp_rmpflow::leaves::{
    self, ApproachFunnel, CollisionAvoidance, JointDamping, PoseAttractor, Side, VelocityFollower,
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
    /// The points this near to the axis of the joint that moves the link, which can hardly give way \[m\].
    NearAxis(f64),
    /// Nothing once the clearance, margin taken off, is below this; above it nobody minds \[m\]. Of
    /// points that move with the tool that is so at their goal; elsewhere they keep half the distance to it
    /// besides.
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

/// How a clearance is kept.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Avoidance {
    /// Within this clearance the leaf speaks \[m\].
    pub activation_distance_m: f64,
    /// Clearance below which the leaf no longer grows \[m\].
    pub clearance_min_m: f64,
    /// Inertia of the leaf \[kg\].
    pub inertia_kg: f64,
    /// Fraction of the inertia that speaks at any velocity.
    pub rest_fraction: f64,
    /// Approach speed that counts as fast \[m/s\].
    pub approach_speed_m_s: f64,
    /// Strength of the repulsion \[m²/s²\].
    pub repulsion_m2_s2: f64,
    /// Damping of the approach \[1/s\].
    pub damping_1_s: f64,
}

/// Collision avoidance.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Collision {
    /// Clearance that is added to every link's radius \[m\].
    pub margin_m: f64,
    /// How the clearance between links and obstacles is kept.
    pub avoidance: Avoidance,
    /// How links are led around obstacles, `None` where they shall wait.
    #[serde(deserialize_with = "Option::deserialize")]
    pub steering: Option<Steering>,
    /// What obstacles add to a joint's acceleration takes at least this long to grow to
    /// `robot.acceleration_max` \[s\].
    pub ramp_time_s: f64,
    /// Pairs that need not keep apart, e.g. the tool and the table it picks from.
    pub exempt: Vec<Exemption>,
}

/// How links are led around obstacles.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Steering {
    /// Clearance within which it acts \[m\].
    pub range_m: f64,
    /// How much faster than it pressed on the obstacle a link goes aside.
    pub gain: f64,
    /// Damping of the policy that is steered \[1/s\].
    pub response_1_s: f64,
    /// Speed of approach that is permitted for each metre of clearance \[1/s\].
    pub approach_1_s: f64,
    /// Largest speed that is steered with \[m/s\].
    pub speed_max_m_s: f64,
    /// Where to go when the task tells no side.
    pub side: SteeringSide,
}

/// Where a link may go around an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub enum SteeringSide {
    /// Left or right in the xy plane.
    Plane,
    /// To any side; towards this direction when the task tells none.
    Space([f64; 3]),
}

/// Clearance of the arm from itself.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SelfCollision {
    /// Clearance that is added between two links \[m\].
    pub margin_m: f64,
    /// How it is kept.
    pub avoidance: Avoidance,
    /// Pairs of links that need not keep apart, besides neighbours and those that touch in any
    /// posture.
    pub exempt: Vec<(String, String)>,
}

/// How joints are kept inside their position limits.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointLimitLeaf {
    /// Within this distance from a limit the leaf speaks \[rad or m\].
    pub activation_distance: f64,
    /// Distance below which the leaf no longer grows \[rad or m\].
    pub distance_min: f64,
    /// Inertia of the leaf \[kg m² or kg\].
    pub inertia: f64,
    /// Fraction of the inertia that speaks at any velocity.
    pub rest_fraction: f64,
    /// Speed towards the limit that counts as fast \[rad/s or m/s\].
    pub approach_speed: f64,
    /// Strength of the repulsion \[rad²/s² or m²/s²\].
    pub repulsion: f64,
    /// Damping of the approach \[1/s\].
    pub damping_1_s: f64,
}

/// How joints are kept below their speed limits.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointSpeedLeaf {
    /// Fraction of the permitted speed from which on the leaf speaks.
    pub free_fraction: f64,
    /// Inertia of the leaf \[kg m² or kg\].
    pub inertia: f64,
    /// Damping \[1/s\].
    pub damping_1_s: f64,
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

/// The speeds within which a skill is followed.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Governor {
    /// Largest speed that is asked for \[m/s\].
    pub linear_max_m_s: f64,
    /// Largest angular speed that is asked for \[rad/s\].
    pub angular_max_rad_s: f64,
    /// Damping of the skill \[1/s\].
    pub response_1_s: f64,
}

/// The funnel through which the tool approaches the goal.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Approach {
    /// Direction out of the funnel, in the skill's goal frame; any length but zero.
    pub axis: [f64; 3],
    /// Height of the funnel's rim above its bottom \[m\].
    pub depth_m: f64,
    /// Half-width of the funnel's hole \[m\].
    pub width_m: f64,
    /// How the clearance from the funnel's surface is kept.
    pub avoidance: Avoidance,
}

/// Damping in joint space.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointDampingLeaf {
    /// Inertia \[kg m² or kg\].
    pub inertia: f64,
    /// Damping \[1/s\].
    pub damping_1_s: f64,
}

/// How strongly the skill speaks against other leaves.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkillLeaf {
    /// Inertia of the position at the goal \[kg\].
    pub linear_inertia_kg: f64,
    /// Inertia of the orientation at the goal \[kg m²\].
    pub angular_inertia_kg_m2: f64,
    /// The speeds within which it is followed.
    pub governor: Governor,
}

/// Draws the tool to a pose.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attractor {
    /// Linear inertia \[kg\].
    pub linear_inertia_kg: f64,
    /// Angular inertia \[kg m²\].
    pub angular_inertia_kg_m2: f64,
    /// Stiffness \[1/s²\].
    pub stiffness_1_s2: f64,
    /// Damping \[1/s\].
    pub damping_1_s: f64,
    /// Distance at which the pull saturates \[m\].
    pub saturation_m: f64,
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
    /// What draws it there.
    pub attractor: Attractor,
}

/// What the velocity of the tool is worth that somebody outside commands: a joystick, a hand-guiding
/// device, another planner.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct External {
    /// Inertia with which the commanded velocity counts beside the skill's \[kg\].
    pub linear_inertia_kg: f64,
    /// The same for turning \[kg m²\].
    pub angular_inertia_kg_m2: f64,
    /// How fast the tool tends to it \[1/s\].
    pub response_1_s: f64,
    /// Faster commands are shortened to this \[m/s\].
    pub linear_max_m_s: f64,
    /// The same for turning \[rad/s\].
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
}

impl Avoidance {
    /// The leaf.
    #[must_use]
    pub fn leaf(&self) -> CollisionAvoidance {
        CollisionAvoidance {
            activation_distance_m: self.activation_distance_m,
            clearance_min_m: self.clearance_min_m,
            inertia_kg: self.inertia_kg,
            rest_fraction: self.rest_fraction,
            approach_speed_m_s: self.approach_speed_m_s,
            repulsion_m2_s2: self.repulsion_m2_s2,
            damping_1_s: self.damping_1_s,
        }
    }
}

impl Collision {
    /// The leaf and the steering.
    #[must_use]
    pub fn leaf(&self) -> leaves::Avoidance {
        let steering = self.steering.map(|steering| leaves::Steering {
            range_m: steering.range_m,
            gain: steering.gain,
            response_1_s: steering.response_1_s,
            approach_1_s: steering.approach_1_s,
            speed_max_m_s: steering.speed_max_m_s,
            side: match steering.side {
                SteeringSide::Plane => Side::Plane,
                SteeringSide::Space(direction) => Side::Space(direction.into()),
            },
        });
        leaves::Avoidance { leaf: self.avoidance.leaf(), steering, margin_m: self.margin_m }
    }
}

impl JointLimitLeaf {
    /// The leaf on the distance from a limit: lengths are angles where the joint turns.
    #[must_use]
    pub fn leaf(&self) -> CollisionAvoidance {
        CollisionAvoidance {
            activation_distance_m: self.activation_distance,
            clearance_min_m: self.distance_min,
            inertia_kg: self.inertia,
            rest_fraction: self.rest_fraction,
            approach_speed_m_s: self.approach_speed,
            repulsion_m2_s2: self.repulsion,
            damping_1_s: self.damping_1_s,
        }
    }
}

impl Governor {
    /// The governor.
    #[must_use]
    pub fn governor(&self) -> SpeedGovernor {
        SpeedGovernor {
            linear_max_m_s: self.linear_max_m_s,
            angular_max_rad_s: self.angular_max_rad_s,
            response_1_s: self.response_1_s,
        }
    }
}

impl Approach {
    /// The leaf.
    #[must_use]
    pub fn leaf(&self) -> ApproachFunnel {
        ApproachFunnel {
            axis: DVec3::from(self.axis).normalize(),
            depth_m: self.depth_m,
            width_m: self.width_m,
            leaf: self.avoidance.leaf(),
        }
    }
}

impl Attractor {
    /// The leaf.
    #[must_use]
    pub fn leaf(&self) -> PoseAttractor {
        PoseAttractor {
            linear_inertia_kg: self.linear_inertia_kg,
            angular_inertia_kg_m2: self.angular_inertia_kg_m2,
            stiffness_1_s2: self.stiffness_1_s2,
            damping_1_s: self.damping_1_s,
            saturation_m: self.saturation_m,
        }
    }
}

impl JointDampingLeaf {
    /// The leaf.
    #[must_use]
    pub fn leaf(&self) -> JointDamping {
        JointDamping { inertia: self.inertia, damping_1_s: self.damping_1_s }
    }
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
}

impl Avoidance {
    fn check(&self, check: &mut Check) {
        check.positive("activation_distance_m", self.activation_distance_m);
        check.positive("clearance_min_m", self.clearance_min_m);
        let is_less = self.clearance_min_m < self.activation_distance_m;
        let expected = "less than activation_distance_m beside it";
        check.require(is_less, "clearance_min_m", expected, &self.clearance_min_m);
        check.positive("inertia_kg", self.inertia_kg);
        check.not_negative("rest_fraction", self.rest_fraction);
        check.positive("approach_speed_m_s", self.approach_speed_m_s);
        check.not_negative("repulsion_m2_s2", self.repulsion_m2_s2);
        check.not_negative("damping_1_s", self.damping_1_s);
    }
}

impl Collision {
    pub(super) fn check(&self, check: &mut Check) {
        check.within("avoidance", |check| self.avoidance.check(check));
        check.not_negative("margin_m", self.margin_m);
        check.positive("ramp_time_s", self.ramp_time_s);
        for (i, exemption) in self.exempt.iter().enumerate() {
            check.within(&format!("exempt[{i}]"), |check| match exemption.extent {
                Extent::Whole => {}
                Extent::NearAxis(distance) => check.positive("extent, NearAxis", distance),
                Extent::Above(clearance) => {
                    let is_more = clearance > self.avoidance.clearance_min_m;
                    let expected = "more than collision.avoidance.clearance_min_m";
                    check.require(is_more, "extent, Above", expected, &clearance);
                }
            });
        }
        if let Some(steering) = &self.steering {
            check.within("steering", |check| steering.check(check));
        }
    }
}

impl Steering {
    fn check(&self, check: &mut Check) {
        check.positive("range_m", self.range_m);
        check.not_negative("gain", self.gain);
        check.positive("response_1_s", self.response_1_s);
        check.not_negative("approach_1_s", self.approach_1_s);
        check.positive("speed_max_m_s", self.speed_max_m_s);
        if let SteeringSide::Space(direction) = &self.side {
            check.direction("side", direction);
        }
    }
}

impl SelfCollision {
    pub(super) fn check(&self, check: &mut Check) {
        check.within("avoidance", |check| self.avoidance.check(check));
        check.not_negative("margin_m", self.margin_m);
    }
}

impl JointLimitLeaf {
    pub(super) fn check(&self, check: &mut Check) {
        check.positive("activation_distance", self.activation_distance);
        check.positive("distance_min", self.distance_min);
        let is_less = self.distance_min < self.activation_distance;
        let expected = "less than activation_distance beside it";
        check.require(is_less, "distance_min", expected, &self.distance_min);
        check.positive("inertia", self.inertia);
        check.not_negative("rest_fraction", self.rest_fraction);
        check.positive("approach_speed", self.approach_speed);
        check.not_negative("repulsion", self.repulsion);
        check.not_negative("damping_1_s", self.damping_1_s);
    }
}

impl JointSpeedLeaf {
    pub(super) fn check(&self, check: &mut Check) {
        let holds = self.free_fraction > 0.0 && self.free_fraction < 1.0;
        let expected = "a fraction above 0 and below 1";
        check.require(holds, "free_fraction", expected, &self.free_fraction);
        check.positive("inertia", self.inertia);
        check.not_negative("damping_1_s", self.damping_1_s);
    }
}

impl PostureLeaf {
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

impl Approach {
    pub(super) fn check(&self, check: &mut Check) {
        check.direction("axis", &self.axis);
        check.positive("depth_m", self.depth_m);
        check.positive("width_m", self.width_m);
        check.within("avoidance", |check| self.avoidance.check(check));
    }
}

impl JointDampingLeaf {
    pub(super) fn check(&self, check: &mut Check) {
        check.not_negative("inertia", self.inertia);
        check.not_negative("damping_1_s", self.damping_1_s);
    }
}

impl SkillLeaf {
    pub(super) fn check(&self, check: &mut Check) {
        check.positive("linear_inertia_kg", self.linear_inertia_kg);
        check.positive("angular_inertia_kg_m2", self.angular_inertia_kg_m2);
        check.positive("governor.linear_max_m_s", self.governor.linear_max_m_s);
        check.positive("governor.angular_max_rad_s", self.governor.angular_max_rad_s);
        check.positive("governor.response_1_s", self.governor.response_1_s);
    }
}

impl Attractor {
    pub(super) fn check(&self, check: &mut Check) {
        check.positive("linear_inertia_kg", self.linear_inertia_kg);
        check.not_negative("angular_inertia_kg_m2", self.angular_inertia_kg_m2);
        check.positive("stiffness_1_s2", self.stiffness_1_s2);
        check.positive("damping_1_s", self.damping_1_s);
        check.positive("saturation_m", self.saturation_m);
    }
}

impl Lift {
    pub(super) fn check(&self, check: &mut Check) {
        check.positive("grip_distance_m", self.grip_distance_m);
        check.positive("grip_angle_rad", self.grip_angle_rad);
        check.positive("height_m", self.height_m);
        check.within("attractor", |check| self.attractor.check(check));
    }
}

impl External {
    pub(super) fn check(&self, check: &mut Check) {
        check.positive("linear_inertia_kg", self.linear_inertia_kg);
        check.positive("angular_inertia_kg_m2", self.angular_inertia_kg_m2);
        check.positive("response_1_s", self.response_1_s);
        check.positive("linear_max_m_s", self.linear_max_m_s);
        check.positive("angular_max_rad_s", self.angular_max_rad_s);
        check.positive("fade_s", self.fade_s);
        check.time("age_max_ns", self.age_max_ns);
    }
}
