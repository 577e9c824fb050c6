//! The configuration: its values, their units and ranges. Leaves are in a file of their own.

use std::collections::BTreeMap;
use std::path::PathBuf;

use glam::DQuat;
use serde::Deserialize;
use tprmp_rmpflow::leaves::{
    ApproachFunnel, Barrier, JointDamping, KeepUpright, PoseAttractor, SpeedBarrier,
};
use tprmp_robot::{Interface, LimitOverride, Selection};
use tprmp_spatial::Pose;

use crate::controller_config::check::Check;
use crate::controller_config::drives::{Actuators, Disturbance, Impedance};
use crate::controller_config::leaves::{
    Collision, External, Lift, PostureLeaf, SelfCollision, SkillLeaf,
};
use crate::controller_config::payload::{Gripped, Payload};
use crate::controller_config::supervision::Supervision;

/// What wakes the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Trigger {
    /// An absolute schedule of its own.
    Periodic,
    /// Each new state.
    OnState,
}

/// The robot and its limits.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// URDF of the arm.
    pub urdf: PathBuf,
    /// Link in whose frame everything is expressed; `None` for the root of the URDF.
    #[serde(deserialize_with = "Option::deserialize")]
    pub base_link: Option<String>,
    /// Link that the skill moves, or that the tool is fixed to.
    pub tool_link: String,
    /// The tool that the skill moves, where the URDF has no link for it; `None` where the tool is that link.
    #[serde(deserialize_with = "Option::deserialize")]
    pub tool_offset: Option<ToolOffset>,
    /// What the tool carries all the time, beside what the URDF says; `None` where that is all.
    #[serde(deserialize_with = "Option::deserialize")]
    pub payload: Option<Payload>,
    /// Joints that are held, as if they were fixed, and where: those of a gripper, for example
    /// \[rad or m\]. What mimics one of them follows it.
    pub held_joints: BTreeMap<String, f64>,
    /// Limits of joints in place of the URDF's.
    pub limits: BTreeMap<String, JointLimit>,
    /// Names of the joints from base to tool: the order of every list and message.
    pub joints: Vec<String>,
    /// Spheres that cover the links; `None` derives them from the collision shapes of the URDF,
    /// which must not be meshes then.
    #[serde(deserialize_with = "Option::deserialize")]
    pub control_points: Option<Vec<ControlPoint>>,
    /// Links that have collision shapes and no control points, and are not kept clear on purpose.
    pub not_kept_clear: Vec<String>,
    /// Gravity in the base frame \[m/s²\].
    pub gravity_m_s2: [f64; 3],
    /// What the robot makes of a command.
    pub actuators: Actuators,
    /// Largest joint accelerations \[rad/s² or m/s²\].
    pub acceleration_max: Vec<f64>,
    /// Largest changes of the joint accelerations \[rad/s³ or m/s³\].
    pub jerk_max: Vec<f64>,
    /// Largest changes of the joint torques or forces \[N m/s or N/s\].
    pub effort_rate_max: Vec<f64>,
    /// Fraction of the URDF's velocity limit that may be used.
    pub velocity_fraction: f64,
    /// Fraction of the URDF's effort limit that may be used.
    pub effort_fraction: f64,
    /// Distance kept from the URDF's position limits; a joint that is outside by no more is moved back \[rad or m\].
    pub position_margin: f64,
    /// Least and greatest position of joints that are to use less than the URDF permits
    /// \[rad or m\]: what keeps an arm from folding its elbow or its shoulder over. Outside, a joint
    /// may only come back.
    pub working_range: BTreeMap<String, [f64; 2]>,
    /// What points of the arm keep below; `None` where nothing but the joints' limits is asked for.
    #[serde(deserialize_with = "Option::deserialize")]
    pub point_limits: Option<PointLimits>,
}

/// Limits of a joint in place of those of the URDF, which are kept where it says `None`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointLimit {
    /// Least and greatest position \[rad or m\].
    #[serde(deserialize_with = "Option::deserialize")]
    pub position: Option<[f64; 2]>,
    /// Largest speed \[rad/s or m/s\].
    #[serde(deserialize_with = "Option::deserialize")]
    pub velocity: Option<f64>,
    /// Largest torque or force \[N m or N\].
    #[serde(deserialize_with = "Option::deserialize")]
    pub effort: Option<f64>,
}

/// Limits of the tool and of the origins of all joints, the elbow's for one.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointLimits {
    /// Largest speed \[m/s\]. ISO 10218-1 has 0.25 m/s for a reduced speed.
    pub speed_max_m_s: f64,
    /// Largest acceleration by the joints', J q̈, that is asked for; braking may take more \[m/s²\].
    pub acceleration_max_m_s2: f64,
    /// Largest power of all joints, ∑|τᵢ q̇ᵢ|, what holds against gravity included \[W\].
    pub power_max_w: f64,
}

/// A tool in the frame of the link that it is fixed to.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolOffset {
    /// Name of the tool's frame: that of the skill's tool.
    pub frame: String,
    /// Its origin \[m\].
    pub position_m: [f64; 3],
    /// Its orientation, a unit quaternion.
    pub quaternion_wxyz: [f64; 4],
}

impl ToolOffset {
    /// X_LE, with L the link.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let [w, x, y, z] = self.quaternion_wxyz;
        let orientation = DQuat::from_xyzw(x, y, z, w).normalize();
        Pose { position: self.position_m.into(), orientation }
    }
}

/// A sphere on a link.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlPoint {
    /// Name of the link.
    pub link: String,
    /// Centre in the link's frame \[m\].
    pub position_m: [f64; 3],
    /// Radius \[m\].
    pub radius_m: f64,
}

/// The loop.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Loop {
    /// What wakes it.
    pub trigger: Trigger,
    /// Period of the schedule; also the deadline of a tick \[ns\].
    pub period_ns: u64,
    /// Spins so long before the schedule, or around the time at which a state is expected, instead of
    /// sleeping \[ns\].
    pub spin_ns: u64,
    /// Older states stop the arm \[ns\].
    pub state_age_max_ns: u64,
    /// Older frames stop the arm \[ns\].
    pub frames_age_max_ns: u64,
    /// A command lives this long \[ns\].
    pub command_lifetime_ns: u64,
    /// So many missed periods in a row stop the arm.
    pub overruns_in_a_row_max: u32,
    /// More states that are missing in a row, by their sequence numbers, stop the arm.
    pub states_lost_in_a_row_max: u32,
    /// The status is published once in so many ticks, and when it changes; in lockstep always.
    pub status_every_ticks: u32,
}

/// Where a skill's start frame comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum StartFrame {
    /// It is published like all others.
    Published,
    /// It is the tool's own pose when the skill starts, and stays there.
    Tool,
}

/// How the velocities of frames become accelerations.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameObserver {
    /// Time constant of the filter \[s\].
    pub time_constant_s: f64,
    /// Largest acceleration believed \[m/s²\].
    pub linear_acceleration_max_m_s2: f64,
    /// Largest angular acceleration believed \[rad/s²\].
    pub angular_acceleration_max_rad_s2: f64,
}

/// How the arm stops and starts.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// Fraction of the largest accelerations used to decelerate to rest.
    pub deceleration_fraction: f64,
    /// Longest time taken to come to rest \[s\].
    pub duration_max_s: f64,
    /// Time over which the policy is faded in after a start or a stop \[s\].
    pub fade_in_s: f64,
}

/// When the task counts as done.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Done {
    /// Distance from the goal \[m\].
    pub distance_m: f64,
    /// Angle from the goal \[rad\].
    pub angle_rad: f64,
}

/// A capability that the loop asks the system for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Capability {
    /// A real-time priority.
    FifoPriority,
    /// A core of its own.
    Cpu,
    /// Memory that stays where it is.
    LockMemory,
    /// Cores that do not sleep deeply.
    CpuLatency,
}

/// Real-time set-up. Where the system denies something, the controller says so; it goes on without,
/// unless that is required.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RealTime {
    /// SCHED_FIFO priority, 1 to 99; `None` keeps the ordinary scheduler.
    #[serde(deserialize_with = "Option::deserialize")]
    pub fifo_priority: Option<u8>,
    /// The core that the loop is kept on; `None` leaves it to the scheduler.
    #[serde(deserialize_with = "Option::deserialize")]
    pub cpu: Option<usize>,
    /// Whether memory is locked.
    pub lock_memory: bool,
    /// Longest time in which a sleeping core may wake up, held in /dev/cpu_dma_latency; `None` leaves
    /// it to the system \[µs\].
    #[serde(deserialize_with = "Option::deserialize")]
    pub cpu_latency_max_us: Option<u32>,
    /// Without these the controller does not start.
    pub required: Vec<Capability>,
}

impl RealTime {
    /// Whether this is asked for at all.
    #[must_use]
    pub fn asks_for(&self, capability: Capability) -> bool {
        match capability {
            Capability::FifoPriority => self.fifo_priority.is_some(),
            Capability::Cpu => self.cpu.is_some(),
            Capability::LockMemory => self.lock_memory,
            Capability::CpuLatency => self.cpu_latency_max_us.is_some(),
        }
    }
}

/// The whole configuration.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControllerConfig {
    /// The robot.
    pub robot: Robot,
    /// The loop.
    #[serde(rename = "loop")]
    pub cycle: Loop,
    /// Where the start frames of the skills come from.
    pub start_frame: StartFrame,
    /// Accelerations of frames.
    pub frame_observer: FrameObserver,
    /// The leaf of the skill that is the task.
    pub skill: SkillLeaf,
    /// Leaves of skills beside it, one for each further model.
    pub additional_skills: Vec<SkillLeaf>,
    /// Pulls the tool to the goal of the task beside the skills; `None` leaves that to them.
    #[serde(deserialize_with = "Option::deserialize")]
    pub goal_attractor: Option<PoseAttractor>,
    /// Keeps an axis of the tool along one of the base; `None` leaves it to the skills.
    #[serde(deserialize_with = "Option::deserialize")]
    pub keep_upright: Option<KeepUpright>,
    /// Joint damping.
    pub joint_damping: JointDamping,
    /// Position limits of the joints as a leaf; `None` leaves them to the final limits alone.
    #[serde(deserialize_with = "Option::deserialize")]
    pub joint_limits: Option<Barrier>,
    /// Speed limits of the joints as a leaf; `None` leaves them to the final limits alone.
    #[serde(deserialize_with = "Option::deserialize")]
    pub joint_speeds: Option<SpeedBarrier>,
    /// Posture, `None` where the task decides about all joints.
    #[serde(deserialize_with = "Option::deserialize")]
    pub posture: Option<PostureLeaf>,
    /// Collision avoidance, `None` without.
    #[serde(deserialize_with = "Option::deserialize")]
    pub collision: Option<Collision>,
    /// Clearance of the arm from itself, `None` without.
    #[serde(deserialize_with = "Option::deserialize")]
    pub self_collision: Option<SelfCollision>,
    /// The funnel to the goal, `None` where it may be approached from any side.
    #[serde(deserialize_with = "Option::deserialize")]
    pub approach: Option<ApproachFunnel>,
    /// What follows once the gripper holds, `None` for a skill without a gripper.
    #[serde(deserialize_with = "Option::deserialize")]
    pub lift: Option<Lift>,
    /// What the gripper holds while it says so, `None` where that does not matter.
    #[serde(deserialize_with = "Option::deserialize")]
    pub gripped: Option<Gripped>,
    /// The weight of velocities of the tool that are commanded from outside; `None` does not listen.
    #[serde(deserialize_with = "Option::deserialize")]
    pub external: Option<External>,
    /// When the task is done.
    pub done: Done,
    /// Tracking.
    pub impedance: Impedance,
    /// Resistance to pushes; `None` leaves them to the impedance alone.
    #[serde(deserialize_with = "Option::deserialize")]
    pub disturbance: Option<Disturbance>,
    /// Stops and starts.
    pub stop: Stop,
    /// Who has to say that the arm may move.
    pub supervision: Supervision,
    /// Real-time set-up.
    pub real_time: RealTime,
}

impl Robot {
    /// Which chain of the URDF it is, and what is known of it beside.
    #[must_use]
    pub fn selection(&self) -> Selection {
        let limits = self.limits.iter().map(|(joint, limit)| {
            let JointLimit { position, velocity, effort } = *limit;
            (joint.clone(), LimitOverride { position, velocity, effort })
        });
        Selection {
            base_link: self.base_link.clone(),
            tool_link: self.tool_link.clone(),
            tool_offset: self.tool_offset.as_ref().map(ToolOffset::pose),
            payload: self.payload.as_ref().map(Payload::body),
            held_joints: self.held_joints.clone(),
            limits: limits.collect(),
            interface: match self.actuators {
                Actuators::Torque(_) => Interface::Effort,
                Actuators::PositionServo(_) | Actuators::VelocityServo(_) => Interface::Motion,
            },
            ignores_shapes: self.control_points.is_some(),
        }
    }
}

impl Robot {
    /// Name of the frame that the skill moves.
    #[must_use]
    pub fn tool_frame(&self) -> &str {
        self.tool_offset.as_ref().map_or(&self.tool_link, |offset| &offset.frame)
    }
}

impl ControllerConfig {
    /// As [`Robot::selection`]; where nothing is kept clear of anything, nor do the shapes matter.
    #[must_use]
    pub fn selection(&self) -> Selection {
        let mut selection = self.robot.selection();
        selection.ignores_shapes |= self.collision.is_none() && self.self_collision.is_none();
        selection
    }
}

impl ControllerConfig {
    /// Checks every value against its range.
    pub(super) fn check(&self, check: &mut Check) {
        let joints = self.robot.joints.len();
        check.within("robot", |check| self.robot.check(check));
        check.within("loop", |check| self.cycle.check(check));
        check.within("frame_observer", |check| self.frame_observer.check(check));
        check.within("skill", |check| self.skill.check(check));
        for (i, skill) in self.additional_skills.iter().enumerate() {
            check.within(&format!("additional_skills[{i}]"), |check| skill.check(check));
        }
        if let Some(attractor) = &self.goal_attractor {
            check.leaf("goal_attractor", |report| attractor.check(report));
        }
        if let Some(upright) = &self.keep_upright {
            check.leaf("keep_upright", |report| upright.check(report));
        }
        check.leaf("joint_damping", |report| self.joint_damping.check(report));
        if let Some(barrier) = &self.joint_limits {
            check.leaf("joint_limits", |report| barrier.check(&Barrier::KEYS, report));
        }
        if let Some(barrier) = &self.joint_speeds {
            check.leaf("joint_speeds", |report| barrier.check(report));
        }
        optional(check, "posture", &self.posture, |posture, check| posture.check(joints, check));
        optional(check, "collision", &self.collision, Collision::check);
        optional(check, "self_collision", &self.self_collision, SelfCollision::check);
        if let Some(funnel) = &self.approach {
            check.leaf("approach", |report| funnel.check(report));
            let keys = &Barrier::KEYS_ON_LENGTH;
            check.leaf("approach.avoidance", |report| funnel.leaf.check(keys, report));
        }
        optional(check, "lift", &self.lift, Lift::check);
        optional(check, "gripped", &self.gripped, Gripped::check);
        optional(check, "external", &self.external, External::check);
        check.positive("done.distance_m", self.done.distance_m);
        check.positive("done.angle_rad", self.done.angle_rad);
        check.within("impedance", |check| self.impedance.check(check));
        optional(check, "disturbance", &self.disturbance, Disturbance::check);
        check.fraction("stop.deceleration_fraction", self.stop.deceleration_fraction);
        check.positive("stop.duration_max_s", self.stop.duration_max_s);
        check.positive("stop.fade_in_s", self.stop.fade_in_s);
        check.within("supervision", |check| self.supervision.check(joints, check));
        check.within("real_time", |check| self.real_time.check(check));
    }
}

fn optional<T>(
    check: &mut Check,
    key: &str,
    value: &Option<T>,
    of_value: impl FnOnce(&T, &mut Check),
) {
    if let Some(value) = value {
        check.within(key, |check| of_value(value, check));
    }
}

impl Robot {
    fn check(&self, check: &mut Check) {
        let count = self.joints.len();
        check.require((2..=8).contains(&count), "joints", "2 to 8 names", &self.joints);
        for (key, limits) in [
            ("acceleration_max", &self.acceleration_max),
            ("jerk_max", &self.jerk_max),
            ("effort_rate_max", &self.effort_rate_max),
        ] {
            check.require(limits.len() == count, key, "one number for each joint", limits);
            limits.iter().for_each(|limit| check.positive(key, *limit));
        }
        let gravity = &self.gravity_m_s2;
        let is_finite = gravity.iter().all(|g| g.is_finite());
        check.require(is_finite, "gravity_m_s2", "three finite numbers", gravity);
        check.within("actuators", |check| self.actuators.check(count, check));
        check.fraction("velocity_fraction", self.velocity_fraction);
        check.fraction("effort_fraction", self.effort_fraction);
        check.not_negative("position_margin", self.position_margin);
        for (joint, limit) in &self.limits {
            check.within(&format!("limits[\"{joint}\"]"), |check| limit.check(check));
        }
        for (joint, position) in &self.held_joints {
            let key = format!("held_joints[\"{joint}\"]");
            check.require(position.is_finite(), &key, "a finite number", position);
        }
        if let Some(offset) = &self.tool_offset {
            let is_finite = offset.position_m.iter().all(|number| number.is_finite());
            check.require(is_finite, "tool_offset.position_m", "three finite numbers", offset);
            let length = offset.quaternion_wxyz.iter().map(|q| q * q).sum::<f64>().sqrt();
            let is_unit = (length - 1.0).abs() < 1e-3;
            check.require(
                is_unit,
                "tool_offset.quaternion_wxyz",
                "a quaternion of length 1",
                offset,
            );
        }
        optional(check, "payload", &self.payload, Payload::check);
        if let Some(points) = &self.point_limits {
            check.positive("point_limits.speed_max_m_s", points.speed_max_m_s);
            check.positive("point_limits.acceleration_max_m_s2", points.acceleration_max_m_s2);
            check.positive("point_limits.power_max_w", points.power_max_w);
        }
        for (joint, range) in &self.working_range {
            let is_known = self.joints.contains(joint);
            check.require(is_known, "working_range", "names from robot.joints", joint);
            let rises = range[0] < range[1] && range.iter().all(|end| end.is_finite());
            check.require(rises, "working_range", "a lower end below the upper one", range);
        }
    }
}

impl JointLimit {
    fn check(&self, check: &mut Check) {
        if let Some(range) = &self.position {
            let rises = range[0] < range[1] && range.iter().all(|end| end.is_finite());
            check.require(rises, "position", "a lower end below the upper one", range);
        }
        for (key, limit) in [("velocity", self.velocity), ("effort", self.effort)] {
            if let Some(limit) = limit {
                check.positive(key, limit);
            }
        }
    }
}

impl Loop {
    fn check(&self, check: &mut Check) {
        let period = &self.period_ns;
        check.time("period_ns", *period);
        check.require(*period <= 20_000_000, "period_ns", "at most 20000000 nanoseconds", period);
        let expected = "at most four fifths of loop.period_ns: a real-time thread that does not \
                        sleep is stopped by the kernel";
        check.require(self.spin_ns <= period / 5 * 4, "spin_ns", expected, &self.spin_ns);
        for (key, count) in [
            ("status_every_ticks", self.status_every_ticks),
            ("overruns_in_a_row_max", self.overruns_in_a_row_max),
        ] {
            check.require(count > 0, key, "at least 1", &count);
        }
        check.time("state_age_max_ns", self.state_age_max_ns);
        check.time("frames_age_max_ns", self.frames_age_max_ns);
        check.time("command_lifetime_ns", self.command_lifetime_ns);
    }
}

impl FrameObserver {
    fn check(&self, check: &mut Check) {
        check.positive("time_constant_s", self.time_constant_s);
        check.not_negative("linear_acceleration_max_m_s2", self.linear_acceleration_max_m_s2);
        check.not_negative("angular_acceleration_max_rad_s2", self.angular_acceleration_max_rad_s2);
    }
}

impl RealTime {
    fn check(&self, check: &mut Check) {
        let priority = &self.fifo_priority;
        let is_one = priority.is_none_or(|priority| (1..=99).contains(&priority));
        check.require(is_one, "fifo_priority", "None, or 1 to 99", priority);
        for capability in &self.required {
            let expected = "only what the keys beside it ask for";
            check.require(self.asks_for(*capability), "required", expected, capability);
        }
    }
}
