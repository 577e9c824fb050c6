//! The controller's configuration: which robot, how the loop runs, which leaves, which limits.
//!
//! Every key is required and none is invented: a missing or unknown key is an error that names the
//! file, the key and what was expected. That goes for keys that may be `None` too, which serde would
//! take for it when they are missing, unless it is told how to read them. Paths are relative to the file.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use glam::DVec3;
use serde::Deserialize;
use tprmp_robot::Selection;

mod leaves;

pub use leaves::{
    Approach, Attractor, Avoidance, Collision, ExemptObstacle, Exemption, Extent, External,
    Governor, JointDampingLeaf, JointLimitLeaf, JointSpeedLeaf, Lift, PostureLeaf, SelfCollision,
    SkillLeaf, Steering, SteeringSide,
};

/// Why a configuration was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("configuration `{path}` cannot be read: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file is not RON, or a key is missing, unknown or of another type.
    #[error("configuration `{path}`, {position}: {problem}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line and column.
        position: String,
        /// What the parser says: it names the key.
        problem: String,
    },
    /// A value is outside its range.
    #[error("configuration `{path}`, key `{key}`: expected {expected}, found {found}")]
    Value {
        /// The file.
        path: PathBuf,
        /// The key.
        key: String,
        /// What was expected.
        expected: &'static str,
        /// What was found.
        found: String,
    },
}

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
    /// Link that the skill moves.
    pub tool_link: String,
    /// Joints that are held at zero, as if they were fixed: those of a gripper, for example.
    pub held_joints: Vec<String>,
    /// Names of the joints from base to tool: the order of every list and message.
    pub joints: Vec<String>,
    /// Spheres that cover the links; `None` derives them from the collision shapes of the URDF,
    /// which must not be meshes then.
    #[serde(deserialize_with = "Option::deserialize")]
    pub control_points: Option<Vec<ControlPoint>>,
    /// Gravity in the base frame \[m/s²\].
    pub gravity_m_s2: [f64; 3],
    /// Largest joint accelerations \[rad/s² or m/s²\].
    pub acceleration_max: Vec<f64>,
    /// Fraction of the URDF's velocity limit that may be used.
    pub velocity_fraction: f64,
    /// Fraction of the URDF's effort limit that may be used.
    pub effort_fraction: f64,
    /// Distance kept from the URDF's position limits \[rad or m\].
    pub position_margin: f64,
    /// Least and greatest position of joints that are to use less than the URDF permits
    /// \[rad or m\]: what keeps an arm from turning its elbow or its shoulder over. Outside, a joint
    /// may only come back.
    pub working_range: BTreeMap<String, [f64; 2]>,
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
    /// The status is published once in so many ticks, and when it changes; in lockstep always.
    pub status_every_ticks: u32,
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

/// The impedance with which the policy's acceleration is tracked  [thesis section 4.4].
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Impedance {
    /// Stiffness towards the integrated position \[1/s²\].
    pub stiffness_1_s2: f64,
    /// Damping towards the integrated velocity \[1/s\].
    pub damping_1_s: f64,
    /// Time in which the integrated state gives way to the measured one \[s\].
    pub reference_time_constant_s: f64,
}

/// How fast a push may move the joints. A joint that is disturbed resists once the push would drive it
/// beyond this speed; up to there the impedance gives way.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disturbance {
    /// Fraction of the permitted speed that a push may cause.
    pub speed_fraction: f64,
    /// How far the disturbance is thought to go on \[s\].
    pub horizon_s: f64,
    /// Time constant of the observer, about the time from a command to the state that shows it \[s\].
    pub time_constant_s: f64,
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

/// Something that the system has to grant to the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Grant {
    /// A real-time priority.
    FifoPriority,
    /// A core of its own.
    Cpu,
    /// Memory that stays where it is.
    LockMemory,
    /// Cores that do not sleep deeply.
    CpuLatency,
}

/// Real-time set-up. Where the system refuses something, the controller says so; it goes on without,
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
    pub required: Vec<Grant>,
}

impl RealTime {
    /// Whether this is asked for at all.
    #[must_use]
    pub fn asks_for(&self, grant: Grant) -> bool {
        match grant {
            Grant::FifoPriority => self.fifo_priority.is_some(),
            Grant::Cpu => self.cpu.is_some(),
            Grant::LockMemory => self.lock_memory,
            Grant::CpuLatency => self.cpu_latency_max_us.is_some(),
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
    /// Accelerations of frames.
    pub frame_observer: FrameObserver,
    /// The leaf of the skill that is the task.
    pub skill: SkillLeaf,
    /// Leaves of skills beside it, one for each further model.
    pub additional_skills: Vec<SkillLeaf>,
    /// Draws the tool to the goal of the task beside the skills; `None` leaves that to them.
    #[serde(deserialize_with = "Option::deserialize")]
    pub goal_attractor: Option<Attractor>,
    /// Joint damping.
    pub joint_damping: JointDampingLeaf,
    /// Position limits of the joints as a leaf; `None` leaves them to the final limits alone.
    #[serde(deserialize_with = "Option::deserialize")]
    pub joint_limits: Option<JointLimitLeaf>,
    /// Speed limits of the joints as a leaf; `None` leaves them to the final limits alone.
    #[serde(deserialize_with = "Option::deserialize")]
    pub joint_speeds: Option<JointSpeedLeaf>,
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
    pub approach: Option<Approach>,
    /// What follows once the gripper holds, `None` for a skill without a gripper.
    #[serde(deserialize_with = "Option::deserialize")]
    pub lift: Option<Lift>,
    /// What velocities of the tool that somebody outside commands are worth; `None` does not listen.
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
    /// Real-time set-up.
    pub real_time: RealTime,
}

impl Robot {
    /// Which chain of the URDF it is.
    #[must_use]
    pub fn selection(&self) -> Selection {
        Selection {
            base_link: self.base_link.clone(),
            tool_link: self.tool_link.clone(),
            held_joints: self.held_joints.clone(),
        }
    }
}

/// Reads and validates a configuration.
///
/// # Errors
/// [`ConfigError`], each naming the file, the key and what was expected.
pub fn read(path: &Path) -> Result<ControllerConfig, ConfigError> {
    read_with(path, |_| {})
}

/// Reads a configuration, lets `edit` change it and validates what comes out.
///
/// # Errors
/// As [`read`].
pub fn read_with(
    path: &Path,
    edit: impl FnOnce(&mut ControllerConfig),
) -> Result<ControllerConfig, ConfigError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| ConfigError::Read { path: path.into(), source })?;
    parse(&text, path, edit)
}

/// `path` as seen from `folder`, each `..` taken back where a folder stands before it.
fn relative_to(folder: &Path, path: &Path) -> PathBuf {
    let mut joined = folder.to_path_buf();
    for part in path.components() {
        let in_folder = matches!(joined.components().next_back(), Some(Component::Normal(_)));
        match part {
            Component::ParentDir if in_folder => {
                joined.pop();
            }
            part => joined.push(part),
        }
    }
    joined
}

fn parse(
    text: &str,
    path: &Path,
    edit: impl FnOnce(&mut ControllerConfig),
) -> Result<ControllerConfig, ConfigError> {
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    let mut config: ControllerConfig =
        options.from_str(text).map_err(|error| ConfigError::Syntax {
            path: path.into(),
            position: error.span.to_string(),
            problem: error.code.to_string(),
        })?;
    edit(&mut config);
    config.validate(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    config.robot.urdf = relative_to(folder, &config.robot.urdf);
    Ok(config)
}

/// Collects the first value that is outside its range.
struct Check<'a> {
    path: &'a Path,
    result: Result<(), ConfigError>,
}

impl Check<'_> {
    fn fail(&mut self, key: &str, expected: &'static str, found: &dyn std::fmt::Debug) {
        if self.result.is_ok() {
            self.result = Err(ConfigError::Value {
                path: self.path.into(),
                key: key.into(),
                expected,
                found: format!("{found:?}"),
            });
        }
    }

    fn positive(&mut self, key: &str, value: f64) {
        if !(value.is_finite() && value > 0.0) {
            self.fail(key, "a finite number above zero", &value);
        }
    }

    fn not_negative(&mut self, key: &str, value: f64) {
        if !(value.is_finite() && value >= 0.0) {
            self.fail(key, "a finite number of at least zero", &value);
        }
    }

    fn avoidance(&mut self, group: &str, leaf: &Avoidance) {
        let key = |name: &str| format!("{group}.{name}");
        self.positive(&key("activation_distance_m"), leaf.activation_distance_m);
        self.positive(&key("clearance_min_m"), leaf.clearance_min_m);
        if leaf.clearance_min_m >= leaf.activation_distance_m {
            let expected = "less than activation_distance_m beside it";
            self.fail(&key("clearance_min_m"), expected, &leaf.clearance_min_m);
        }
        self.positive(&key("inertia_kg"), leaf.inertia_kg);
        self.not_negative(&key("rest_fraction"), leaf.rest_fraction);
        self.positive(&key("approach_speed_m_s"), leaf.approach_speed_m_s);
        self.not_negative(&key("repulsion_m2_s2"), leaf.repulsion_m2_s2);
        self.not_negative(&key("damping_1_s"), leaf.damping_1_s);
    }

    fn skill(&mut self, group: &str, leaf: &SkillLeaf) {
        let key = |name: &str| format!("{group}.{name}");
        self.positive(&key("linear_inertia_kg"), leaf.linear_inertia_kg);
        self.positive(&key("angular_inertia_kg_m2"), leaf.angular_inertia_kg_m2);
        self.positive(&key("governor.linear_max_m_s"), leaf.governor.linear_max_m_s);
        self.positive(&key("governor.angular_max_rad_s"), leaf.governor.angular_max_rad_s);
        self.positive(&key("governor.response_1_s"), leaf.governor.response_1_s);
    }

    fn attractor(&mut self, group: &str, leaf: &Attractor) {
        let key = |name: &str| format!("{group}.{name}");
        self.positive(&key("linear_inertia_kg"), leaf.linear_inertia_kg);
        self.not_negative(&key("angular_inertia_kg_m2"), leaf.angular_inertia_kg_m2);
        self.positive(&key("stiffness_1_s2"), leaf.stiffness_1_s2);
        self.positive(&key("damping_1_s"), leaf.damping_1_s);
        self.positive(&key("saturation_m"), leaf.saturation_m);
    }

    fn fraction(&mut self, key: &str, value: f64) {
        if !(value > 0.0 && value <= 1.0) {
            self.fail(key, "a fraction above 0 and at most 1", &value);
        }
    }

    fn time(&mut self, key: &str, value: u64) {
        if !(1_000..=10_000_000_000).contains(&value) {
            self.fail(key, "1000 to 10000000000 nanoseconds", &value);
        }
    }
}

impl ControllerConfig {
    fn validate(&self, path: &Path) -> Result<(), ConfigError> {
        let mut check = Check { path, result: Ok(()) };
        let robot = &self.robot;
        let count = robot.joints.len();
        if !(2..=8).contains(&count) {
            check.fail("robot.joints", "2 to 8 names", &robot.joints);
        }
        if robot.acceleration_max.len() != count {
            check.fail(
                "robot.acceleration_max",
                "one number for each joint",
                &robot.acceleration_max,
            );
        }
        for limit in &robot.acceleration_max {
            check.positive("robot.acceleration_max", *limit);
        }
        if !robot.gravity_m_s2.iter().all(|g| g.is_finite()) {
            check.fail("robot.gravity_m_s2", "three finite numbers", &robot.gravity_m_s2);
        }
        check.fraction("robot.velocity_fraction", robot.velocity_fraction);
        check.fraction("robot.effort_fraction", robot.effort_fraction);
        check.not_negative("robot.position_margin", robot.position_margin);
        for (joint, range) in &robot.working_range {
            if !robot.joints.contains(joint) {
                check.fail("robot.working_range", "names from robot.joints", joint);
            }
            if !(range[0] < range[1] && range.iter().all(|end| end.is_finite())) {
                check.fail("robot.working_range", "a lower end below the upper one", range);
            }
        }
        check.time("loop.period_ns", self.cycle.period_ns);
        if self.cycle.period_ns > 20_000_000 {
            check.fail("loop.period_ns", "at most 20000000 nanoseconds", &self.cycle.period_ns);
        }
        if self.cycle.spin_ns > self.cycle.period_ns / 5 * 4 {
            let expected = "at most four fifths of loop.period_ns: a real-time thread that does not \
                            sleep is stopped by the kernel";
            check.fail("loop.spin_ns", expected, &self.cycle.spin_ns);
        }
        if self.cycle.status_every_ticks == 0 {
            check.fail("loop.status_every_ticks", "at least 1", &0);
        }
        check.time("loop.state_age_max_ns", self.cycle.state_age_max_ns);
        check.time("loop.frames_age_max_ns", self.cycle.frames_age_max_ns);
        check.time("loop.command_lifetime_ns", self.cycle.command_lifetime_ns);
        if self.cycle.overruns_in_a_row_max == 0 {
            check.fail("loop.overruns_in_a_row_max", "at least 1", &0);
        }
        let observer = &self.frame_observer;
        check.positive("frame_observer.time_constant_s", observer.time_constant_s);
        check.not_negative(
            "frame_observer.linear_acceleration_max_m_s2",
            observer.linear_acceleration_max_m_s2,
        );
        check.not_negative(
            "frame_observer.angular_acceleration_max_rad_s2",
            observer.angular_acceleration_max_rad_s2,
        );
        check.skill("skill", &self.skill);
        for (i, skill) in self.additional_skills.iter().enumerate() {
            check.skill(&format!("additional_skills[{i}]"), skill);
        }
        check.not_negative("joint_damping.inertia", self.joint_damping.inertia);
        check.not_negative("joint_damping.damping_1_s", self.joint_damping.damping_1_s);
        if let Some(limits) = &self.joint_limits {
            check.positive("joint_limits.activation_distance", limits.activation_distance);
            check.positive("joint_limits.distance_min", limits.distance_min);
            if limits.distance_min >= limits.activation_distance {
                let expected = "less than activation_distance beside it";
                check.fail("joint_limits.distance_min", expected, &limits.distance_min);
            }
            check.positive("joint_limits.inertia", limits.inertia);
            check.not_negative("joint_limits.rest_fraction", limits.rest_fraction);
            check.positive("joint_limits.approach_speed", limits.approach_speed);
            check.not_negative("joint_limits.repulsion", limits.repulsion);
            check.not_negative("joint_limits.damping_1_s", limits.damping_1_s);
        }
        if let Some(speeds) = &self.joint_speeds {
            if !(speeds.free_fraction > 0.0 && speeds.free_fraction < 1.0) {
                let expected = "a fraction above 0 and below 1";
                check.fail("joint_speeds.free_fraction", expected, &speeds.free_fraction);
            }
            check.positive("joint_speeds.inertia", speeds.inertia);
            check.not_negative("joint_speeds.damping_1_s", speeds.damping_1_s);
        }
        if let Some(posture) = &self.posture {
            if posture.position.len() != count || !posture.position.iter().all(|q| q.is_finite()) {
                let expected = "one finite number for each joint";
                check.fail("posture.position", expected, &posture.position);
            }
            check.not_negative("posture.inertia", posture.inertia);
            check.not_negative("posture.stiffness_1_s2", posture.stiffness_1_s2);
            check.not_negative("posture.damping_1_s", posture.damping_1_s);
            check.positive("posture.saturation", posture.saturation);
        }
        if let Some(collision) = &self.collision {
            check.avoidance("collision.avoidance", &collision.avoidance);
            check.not_negative("collision.margin_m", collision.margin_m);
            check.positive("collision.ramp_time_s", collision.ramp_time_s);
            for exemption in &collision.exempt {
                match exemption.extent {
                    Extent::Whole => {}
                    Extent::NearAxis(distance) => {
                        check.positive("collision.exempt, NearAxis", distance);
                    }
                    Extent::Above(clearance) => {
                        if clearance.is_nan() || clearance <= collision.avoidance.clearance_min_m {
                            let expected = "more than collision.avoidance.clearance_min_m";
                            check.fail("collision.exempt, Above", expected, &clearance);
                        }
                    }
                }
            }
            if let Some(steering) = &collision.steering {
                check.positive("collision.steering.range_m", steering.range_m);
                check.not_negative("collision.steering.gain", steering.gain);
                check.positive("collision.steering.response_1_s", steering.response_1_s);
                check.not_negative("collision.steering.approach_1_s", steering.approach_1_s);
                check.positive("collision.steering.speed_max_m_s", steering.speed_max_m_s);
                if let SteeringSide::Space(direction) = steering.side {
                    let length = DVec3::from(direction).length();
                    if !(length.is_finite() && length > 0.0) {
                        let expected = "three finite numbers, not all zero";
                        check.fail("collision.steering.side", expected, &direction);
                    }
                }
            }
        }
        if let Some(pairs) = &self.self_collision {
            check.avoidance("self_collision.avoidance", &pairs.avoidance);
            check.not_negative("self_collision.margin_m", pairs.margin_m);
        }
        if let Some(approach) = &self.approach {
            let length = DVec3::from(approach.axis).length();
            if !(length.is_finite() && length > 0.0) {
                check.fail("approach.axis", "three finite numbers, not all zero", &approach.axis);
            }
            check.positive("approach.depth_m", approach.depth_m);
            check.positive("approach.width_m", approach.width_m);
            check.avoidance("approach.avoidance", &approach.avoidance);
        }
        if let Some(attractor) = &self.goal_attractor {
            check.attractor("goal_attractor", attractor);
        }
        if let Some(lift) = &self.lift {
            check.positive("lift.grip_distance_m", lift.grip_distance_m);
            check.positive("lift.grip_angle_rad", lift.grip_angle_rad);
            check.positive("lift.height_m", lift.height_m);
            check.attractor("lift.attractor", &lift.attractor);
        }
        if let Some(external) = &self.external {
            check.positive("external.linear_inertia_kg", external.linear_inertia_kg);
            check.positive("external.angular_inertia_kg_m2", external.angular_inertia_kg_m2);
            check.positive("external.response_1_s", external.response_1_s);
            check.positive("external.linear_max_m_s", external.linear_max_m_s);
            check.positive("external.angular_max_rad_s", external.angular_max_rad_s);
            check.positive("external.fade_s", external.fade_s);
            check.time("external.age_max_ns", external.age_max_ns);
        }
        check.positive("done.distance_m", self.done.distance_m);
        check.positive("done.angle_rad", self.done.angle_rad);
        check.not_negative("impedance.stiffness_1_s2", self.impedance.stiffness_1_s2);
        check.not_negative("impedance.damping_1_s", self.impedance.damping_1_s);
        check.positive(
            "impedance.reference_time_constant_s",
            self.impedance.reference_time_constant_s,
        );
        if let Some(disturbance) = &self.disturbance {
            check.fraction("disturbance.speed_fraction", disturbance.speed_fraction);
            check.positive("disturbance.horizon_s", disturbance.horizon_s);
            check.positive("disturbance.time_constant_s", disturbance.time_constant_s);
        }
        check.fraction("stop.deceleration_fraction", self.stop.deceleration_fraction);
        check.positive("stop.duration_max_s", self.stop.duration_max_s);
        check.positive("stop.fade_in_s", self.stop.fade_in_s);
        if let Some(priority) = self.real_time.fifo_priority
            && !(1..=99).contains(&priority)
        {
            check.fail("real_time.fifo_priority", "None, or 1 to 99", &priority);
        }
        for grant in &self.real_time.required {
            if !self.real_time.asks_for(*grant) {
                let expected = "only what the keys beside it ask for";
                check.fail("real_time.required", expected, grant);
            }
        }
        check.result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped() -> (PathBuf, String) {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/controllers/ur5_pick.ron");
        let text = std::fs::read_to_string(&path).unwrap();
        (path, text)
    }

    fn error_of(edit: impl Fn(&str) -> String) -> String {
        let (path, text) = shipped();
        let edited = edit(&text);
        assert_ne!(edited, text, "the edit must hit");
        parse(&edited, &path, |_| {}).unwrap_err().to_string()
    }

    #[test]
    fn every_shipped_controller_configuration_is_valid() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/controllers");
        let mut count = 0;
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            let config = read(&entry.path()).unwrap();
            assert!(config.robot.urdf.exists(), "{}", config.robot.urdf.display());
            count += 1;
        }
        assert!(count >= 2);
    }

    #[test]
    fn paths_are_relative_to_the_file() {
        let urdf = Path::new("../robots/ur5.urdf");
        let joined = |folder: &str| relative_to(Path::new(folder), urdf);
        assert_eq!(joined("config/controllers"), Path::new("config/robots/ur5.urdf"));
        assert_eq!(joined(""), urdf);
        assert_eq!(joined(".."), Path::new("../../robots/ur5.urdf"));
        assert_eq!(relative_to(Path::new("a"), Path::new("/b")), Path::new("/b"));
    }

    #[test]
    fn a_missing_key_is_named() {
        let error = error_of(|t| t.replace("fade_in_s:", "// fade_in_s:"));
        assert!(error.contains("ur5_pick.ron") && error.contains("fade_in_s"), "{error}");
    }

    #[test]
    fn an_unknown_key_is_named_with_what_was_expected() {
        let error = error_of(|t| t.replace("fade_in_s:", "fade_in_ms:"));
        assert!(error.contains("fade_in_ms") && error.contains("fade_in_s"), "{error}");
    }

    /// The text without a key and its value.
    fn without(text: &str, key: &str) -> String {
        let at = text.find(&format!(" {key}: ")).unwrap() + 1;
        let mut depth = 0;
        let end = text[at..].find(|c: char| {
            depth +=
                i32::from(matches!(c, '(' | '[' | '{')) - i32::from(matches!(c, ')' | ']' | '}'));
            c == ',' && depth == 0
        });
        format!("{}{}", &text[..at], &text[at + end.unwrap() + 1..])
    }

    #[test]
    fn a_missing_key_is_an_error_where_none_is_a_value_too() {
        for key in [
            "base_link",
            "control_points",
            "goal_attractor",
            "joint_limits",
            "joint_speeds",
            "posture",
            "collision",
            "steering",
            "self_collision",
            "approach",
            "lift",
            "external",
            "disturbance",
            "fifo_priority",
            "cpu",
            "cpu_latency_max_us",
        ] {
            let error = error_of(|text| without(text, key));
            assert!(error.contains(key) && error.contains("missing"), "{key}: {error}");
        }
    }

    #[test]
    fn a_value_outside_its_range_is_named_with_the_range() {
        let error = error_of(|t| t.replace("velocity_fraction: ", "velocity_fraction: 1"));
        assert!(
            error.contains("robot.velocity_fraction") && error.contains("at most 1"),
            "{error}"
        );
        let error = error_of(|t| t.replace("period_ns: 1_000_000", "period_ns: 0"));
        assert!(error.contains("loop.period_ns"), "{error}");
        let error = error_of(|t| t.replace("spin_ns: 0", "spin_ns: 800_001"));
        assert!(error.contains("loop.spin_ns") && error.contains("four fifths"), "{error}");
        let error = error_of(|t| t.replace("required: []", "required: [Cpu]"));
        assert!(error.contains("real_time.required") && error.contains("Cpu"), "{error}");
        let error = error_of(|t| t.replace("acceleration_max: [", "acceleration_max: [1.0, "));
        assert!(error.contains("one number for each joint"), "{error}");
        let refused = [
            ("linear_max_m_s: 1.5", "linear_max_m_s: 0.0", "skill.governor.linear_max_m_s"),
            ("activation_distance: 0.2", "activation_distance: 0.001", "joint_limits.distance_min"),
            ("free_fraction: 0.7", "free_fraction: 1.0", "joint_speeds.free_fraction"),
            (
                "posture: None",
                "posture: Some((position: [0.0], inertia: 0.1, stiffness_1_s2: 1.0, \
              damping_1_s: 2.0, saturation: 0.5))",
                "posture.position",
            ),
            ("Space((0.0, 0.0, 1.0))", "Space((0.0, 0.0, 0.0))", "collision.steering.side"),
            ("ramp_time_s: 0.02", "ramp_time_s: -1.0", "collision.ramp_time_s"),
            ("extent: NearAxis(0.15)", "extent: NearAxis(-0.15)", "collision.exempt, NearAxis"),
            ("extent: Above(0.015)", "extent: Above(0.005)", "collision.exempt, Above"),
            ("margin_m: 0.0,", "margin_m: -0.005,", "self_collision.margin_m"),
            (
                "additional_skills: []",
                "additional_skills: [(linear_inertia_kg: 1.0, angular_inertia_kg_m2: 0.0, governor: \
                 (linear_max_m_s: 1.0, angular_max_rad_s: 1.0, response_1_s: 8.0))]",
                "additional_skills[0].angular_inertia_kg_m2",
            ),
            (
                "goal_attractor: None",
                "goal_attractor: Some((linear_inertia_kg: 1.0, angular_inertia_kg_m2: 0.1, \
                 stiffness_1_s2: 9.0, damping_1_s: 6.0, saturation_m: 0.0))",
                "goal_attractor.saturation_m",
            ),
            ("linear_max_m_s: 0.25", "linear_max_m_s: inf", "external.linear_max_m_s"),
            ("angular_max_rad_s: 1.0", "angular_max_rad_s: 0.0", "external.angular_max_rad_s"),
            ("linear_inertia_kg: 4.0", "linear_inertia_kg: -4.0", "external.linear_inertia_kg"),
            (
                "angular_inertia_kg_m2: 2.0",
                "angular_inertia_kg_m2: NaN",
                "external.angular_inertia_kg_m2",
            ),
            ("fade_s: 0.05", "fade_s: 0.0", "external.fade_s"),
            ("age_max_ns: 150_000_000", "age_max_ns: 0", "external.age_max_ns"),
            ("\"elbow_joint\": (", "\"elbow\": (", "robot.working_range"),
            ("\"elbow_joint\": (0.1", "\"elbow_joint\": (3.0", "robot.working_range"),
        ];
        for (from, to, key) in refused {
            let error = error_of(|t| t.replace(from, to));
            assert!(error.contains(key), "{key}: {error}");
        }
    }

    #[test]
    fn commands_from_outside_are_optional_but_the_key_is_not() {
        let (path, text) = shipped();
        let config = parse(&text, &path, |_| {}).unwrap();
        assert!(config.external.is_some());
        let (before, rest) = text.split_once("    external: (").unwrap();
        let (_, after) = rest.split_once("    ),").unwrap();
        let without = format!("{before}    external: None,{after}");
        assert!(parse(&without, &path, |_| {}).unwrap().external.is_none());
        let missing = parse(&format!("{before}{after}"), &path, |_| {}).unwrap_err().to_string();
        assert!(missing.contains("external"), "{missing}");
    }

    #[test]
    fn what_an_edit_leaves_is_validated_too() {
        let path = shipped().0;
        let config = read_with(&path, |c| c.cycle.period_ns = 250_000).unwrap();
        assert_eq!(config.cycle.period_ns, 250_000);
        let error = read_with(&path, |c| c.real_time.fifo_priority = Some(100)).unwrap_err();
        assert!(error.to_string().contains("real_time.fifo_priority"), "{error}");
    }

    #[test]
    fn a_truncated_file_is_an_error_with_a_position() {
        let error = error_of(|t| t[..t.len() / 2].to_string());
        assert!(error.contains("ur5_pick.ron"), "{error}");
    }
}
