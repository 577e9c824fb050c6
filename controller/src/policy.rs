//! The policy of a robot: the task's leaves on its tool, and the tree of all others.

use core::cell::Cell;
use core::ops::Range;

use glam::DVec3;
use nalgebra::SVector;
use tprmp_model::controller_config::{
    Collision, ControllerConfig, ExemptObstacle, Exemption, Fallback, Fallbacks, PostureLeaf,
};
use tprmp_rmpflow::leaves::{
    self, ApproachFunnel, Body, JointLimits, JointSpeedLimits, Obstacle, Part, PoseAttractor,
    Proximity, SelfCollision, Shape, Tick,
};
use tprmp_rmpflow::natural::{Natural, ResolveError};
use tprmp_rmpflow::policy::{PolicyState, SkillInertia, SkillPolicy, SkillValue, SpeedGovernor};
use tprmp_rmpflow::tree::{Resolved, Tree, TreeState};
use tprmp_robot::{
    CONTROL_POINT_CAPACITY, Chain, ControlPoint, ControlPoints, Kinematics, SelfPairs,
    forward_kinematics_with_velocity, point_motion, point_position,
};
use tprmp_spatial::{MovingPose, PointMotion, Pose, Twist};

use crate::inputs::external::ExternalCommand;
use crate::motion::limits::working_range;

/// The policy of a robot: immutable.
#[derive(Debug)]
pub struct RobotPolicy<const N: usize> {
    chain: Chain<N>,
    /// At least one; the first is the task.
    skills: Vec<SkillLeaf>,
    attractor: Option<PoseAttractor>,
    approach: Option<ApproachFunnel>,
    lift: Option<PoseAttractor>,
    points: Vec<AvoidingPoint>,
    parts: Vec<LinkPart>,
    tree: Tree<N>,
    /// The tree with the posture to which the arm retreats, for faulty frames and for requests.
    retreats: [Option<Tree<N>>; 2],
}

/// A learned skill as a leaf on the tool.
#[derive(Debug)]
struct SkillLeaf {
    policy: SkillPolicy,
    /// Which of the scene's frames are its own, in its order.
    frames: Range<usize>,
    inertia: SkillInertia,
    governor: SpeedGovernor,
}

/// What a skill needs between ticks.
#[derive(Debug, Default)]
struct SkillState {
    state: PolicyState,
    /// Of the last evaluation, if it was followed.
    value: Option<SkillValue>,
}

#[derive(Debug)]
struct AvoidingPoint {
    point: ControlPoint,
    /// Clearances from which on it keeps clear of kinds of obstacles \[m\].
    exempt: Vec<(ExemptObstacle, f64)>,
}

/// The control points of a link, and a ball around them.
#[derive(Debug)]
struct LinkPart {
    points: Range<usize>,
    joint: usize,
    /// Centre in that joint's frame \[m\].
    centre: DVec3,
    radius: f64,
}

impl LinkPart {
    /// The parts of control points, of which those of a link follow one another.
    fn of(points: &[ControlPoint]) -> Vec<Self> {
        let mut first = 0;
        let runs = points.chunk_by(|a, b| a.link == b.link);
        runs.map(|run| {
            let points = first..first + run.len();
            first = points.end;
            let corner = |f: fn(DVec3, DVec3) -> DVec3| {
                run.iter().map(|point| point.centre).reduce(f).unwrap_or(DVec3::NAN)
            };
            let centre = 0.5 * (corner(DVec3::min) + corner(DVec3::max));
            let reach = |point: &ControlPoint| point.centre.distance(centre) + point.radius;
            let radius = run.iter().map(reach).fold(0.0, f64::max);
            Self { points, joint: run[0].joint, centre, radius }
        })
        .collect()
    }
}

/// A point that may come near an obstacle does so at its goal; elsewhere it keeps clear within this fraction
/// of the distance to its goal besides, so that it can come down on its goal steeply, 30° or more.
const GOAL_FRACTION: f64 = 0.5;

/// What the policy needs between ticks, and where it puts its intermediate results.
#[derive(Debug)]
pub struct Workspace<const N: usize> {
    /// Kinematics of the last evaluation.
    pub kinematics: Kinematics<N>,
    skills: Vec<SkillState>,
    tree: TreeState<N>,
    part_centres: Vec<DVec3>,
    centres: OnDemand<DVec3>,
    motions: OnDemand<PointMotion<N>>,
}

/// A value for each control point, computed when it is first asked for.
#[derive(Debug)]
struct OnDemand<T: Copy> {
    /// A bit for each value that is there.
    known: Cell<u64>,
    values: Box<[Cell<T>]>,
}

impl<T: Copy> OnDemand<T> {
    fn new(count: usize, undefined: T) -> Self {
        const { assert!(CONTROL_POINT_CAPACITY <= u64::BITS as usize, "a bit for each point") };
        Self { known: Cell::new(0), values: vec![Cell::new(undefined); count].into() }
    }

    fn forget(&mut self) {
        self.known.set(0);
    }

    #[inline]
    fn get(&self, i: usize, compute: impl FnOnce() -> T) -> T {
        let (bit, known) = (1 << i, self.known.get());
        if known & bit == 0 {
            self.known.set(known | bit);
            self.values[i].set(compute());
        }
        self.values[i].get()
    }
}

/// The control points of the arm in its present posture; where a point is and how it moves is computed
/// when it is first asked for.
struct Links<'a, const N: usize> {
    policy: &'a RobotPolicy<N>,
    kinematics: &'a Kinematics<N>,
    part_centres: &'a [DVec3],
    centres: &'a OnDemand<DVec3>,
    motions: &'a OnDemand<PointMotion<N>>,
    tool: &'a Pose,
    tool_goal: &'a Pose,
}

impl<const N: usize> Body<N> for Links<'_, N> {
    fn count(&self) -> usize {
        self.policy.points.len()
    }

    fn part_count(&self) -> usize {
        self.part_centres.len()
    }

    fn part(&self, k: usize) -> Part {
        let LinkPart { points, radius, .. } = &self.policy.parts[k];
        Part { position: self.part_centres[k], radius: *radius, points: points.clone() }
    }

    fn ball(&self, i: usize) -> (DVec3, f64) {
        let ControlPoint { joint, centre, radius, .. } = self.policy.points[i].point;
        (self.centres.get(i, || point_position(self.kinematics, joint, centre)), radius)
    }

    fn motion(&self, i: usize) -> PointMotion<N> {
        self.motions.get(i, || {
            let ControlPoint { joint, centre, .. } = self.policy.points[i].point;
            point_motion(&self.policy.chain, self.kinematics, joint, centre)
        })
    }

    fn acts_within(&self, i: usize, shape: &Shape) -> f64 {
        let kind = match shape {
            Shape::Sphere { .. } => ExemptObstacle::Sphere,
            Shape::Capsule { .. } => ExemptObstacle::Capsule,
            Shape::Box { .. } => ExemptObstacle::Box,
            Shape::HalfSpace => ExemptObstacle::HalfSpace,
        };
        let exempt = self.policy.points[i].exempt.iter();
        let within = exempt
            .filter(|(of, _)| *of == kind)
            .map(|(_, within)| *within)
            .fold(f64::INFINITY, f64::min);
        if within <= 0.0 || within == f64::INFINITY {
            return within;
        }
        // Near only where the task asks for it: it must be able to brake elsewhere.
        let left = self.at_goal(i).map_or(0.0, |goal| (goal - self.ball(i).0).length());
        within + left * GOAL_FRACTION
    }

    /// Known of the points that move with the tool.
    fn at_goal(&self, i: usize) -> Option<DVec3> {
        if self.policy.points[i].point.joint + 1 != N {
            return None;
        }
        let from_tool = self.tool.orientation.conjugate() * (self.ball(i).0 - self.tool.position);
        Some(self.tool_goal.transform_point(from_tool))
    }
}

/// What the tool should do.
#[derive(Debug, Clone, Copy)]
pub enum Task {
    /// Follow the skill.
    Skill,
    /// Go to a pose.
    Reach(Pose),
}

/// Why the arm retreats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Retreat {
    /// Frames or obstacles are faulty.
    Frames,
    /// Somebody asked for a hold, or has not asked for a start.
    Request,
}

/// The task parameters of a tick.
#[derive(Debug, Clone, Copy)]
pub struct TaskParameters<'a> {
    /// The frames of all skills, one skill after the other.
    pub frames: &'a [MovingPose],
    /// Which of them the goal of the first skill is fixed to.
    pub goal_frame: usize,
    /// What to keep away from.
    pub obstacles: &'a [Obstacle],
    /// What is commanded from outside; `None` for a controller that does not listen.
    pub external: Option<&'a ExternalCommand>,
    /// Time since the last tick \[s\].
    pub dt_s: f64,
}

/// What the tree decided, and how near obstacles are.
#[derive(Debug, Clone, Copy)]
pub struct Decision<const N: usize> {
    /// q̈ \[rad/s² or m/s²\].
    pub acceleration: SVector<f64, N>,
    /// Pose of the tool.
    pub tool: Pose,
    /// Goal of the first skill as the frames are now.
    pub goal: Pose,
    /// V of the skills \[J\].
    pub energy: f64,
    /// Of obstacles, and of the arm itself.
    pub proximity: Proximity,
}

/// The leaves on the tool in a tick.
struct ToolLeaves<const N: usize> {
    /// Pulled back to the root.
    root: Natural<N>,
    /// What falls as the tool nears the end of its task.
    energy: f64,
    /// V of the skills \[J\].
    learned_energy: f64,
    /// Goal of the first skill.
    goal: Pose,
}

impl<const N: usize> Workspace<N> {
    /// Forgets the phases of the skills: they go on from where the tool is.
    pub fn restart(&mut self) {
        for skill in &mut self.skills {
            skill.state.restart();
            skill.value = None;
        }
    }

    /// Lets the skills that were evaluated last go on for `dt_s` with the joint accelerations that the arm
    /// gets \[rad/s² or m/s²\], limits included. Where the tool only reaches for a pose nothing goes on.
    pub fn advance(&mut self, acceleration: &SVector<f64, N>, dt_s: f64) {
        let tool = self.kinematics.tool_acceleration(acceleration);
        for skill in &mut self.skills {
            if let Some(value) = skill.value.take() {
                skill.state.advance(&value, &tool, dt_s);
            }
        }
    }
}

impl<const N: usize> RobotPolicy<N> {
    /// Builds the policy. Allocates: at start-up only.
    ///
    /// * `skills`  the first is the task; the others act beside it, and there are as many of them as
    ///   `config.additional_skills`
    ///
    /// # Panics
    /// When there are not.
    #[must_use]
    pub fn new(
        chain: Chain<N>,
        skills: Vec<SkillPolicy>,
        control_points: &ControlPoints,
        config: &ControllerConfig,
    ) -> Self {
        assert_eq!(skills.len(), 1 + config.additional_skills.len(), "a leaf for each skill");
        let mut first = 0;
        let leaves = core::iter::once(&config.skill).chain(&config.additional_skills);
        let skills = skills.into_iter().zip(leaves).map(|(policy, leaf)| {
            let frames = first..first + policy.frame_count();
            first = frames.end;
            let (inertia, governor) = (leaf.inertia(), leaf.governor);
            SkillLeaf { policy, frames, inertia, governor }
        });
        let skills = skills.collect();
        let avoids = config.collision.is_some();
        let points = control_points.as_slice().iter().map(|point| {
            let link = &chain.moving_links()[point.link].0;
            let exempt = config.collision.iter().flat_map(|collision| &collision.exempt);
            let of_link = |e: &&Exemption| e.link == *link;
            let from_axis = point.centre.x.hypot(point.centre.y);
            let within = |e: &Exemption| e.extent.acts_within(from_axis).map(|w| (e.obstacle, w));
            AvoidingPoint {
                point: *point,
                exempt: exempt.filter(of_link).filter_map(within).collect(),
            }
        });
        let points =
            if avoids || config.self_collision.is_some() { points.collect() } else { vec![] };
        let parts = LinkPart::of(&control_points.as_slice()[..points.len()]);
        Self {
            parts,
            points,
            tree: tree(&chain, control_points, config, config.posture.as_ref()),
            retreats: {
                let Fallbacks { frames, request, .. } = &config.supervision.fallback;
                [frames, request].map(|fallback| match fallback {
                    Fallback::Retreat(posture) => {
                        Some(tree(&chain, control_points, config, Some(posture)))
                    }
                    Fallback::Hold | Fallback::GravityOnly => None,
                })
            },
            chain,
            skills,
            attractor: config.goal_attractor,
            approach: config.approach,
            lift: config.lift.map(|lift| lift.attractor),
        }
    }

    /// A fresh workspace. Allocates: at start-up only.
    #[must_use]
    pub fn workspace(&self) -> Workspace<N> {
        let count = self.points.len();
        Workspace {
            kinematics: Kinematics::new(),
            skills: self.skills.iter().map(|_| SkillState::default()).collect(),
            tree: TreeState::default(),
            part_centres: vec![DVec3::NAN; self.parts.len()],
            centres: OnDemand::new(count, DVec3::NAN),
            motions: OnDemand::new(count, PointMotion::UNDEFINED),
        }
    }

    /// The robot.
    #[must_use]
    pub fn chain(&self) -> &Chain<N> {
        &self.chain
    }

    /// What bounds the velocities that the first skill asks for.
    pub fn governor(&mut self) -> &mut SpeedGovernor {
        &mut self.skills[0].governor
    }

    /// Whether the first skill acts on the orientation too.
    #[must_use]
    pub fn has_orientation(&self) -> bool {
        self.skills[0].policy.has_orientation()
    }

    /// What the learned skills want of the tool, within their speeds: M ẍ = f on \[linear; angular\],
    /// and V \[J\]. They keep what they were evaluated to.
    fn learned(
        &self,
        frames: &[MovingPose],
        tool: &Pose,
        velocity: &Twist,
        states: &mut [SkillState],
    ) -> (Natural<6>, f64) {
        let (mut sum, mut energy) = (Natural::zero(), 0.0);
        for (leaf, skill) in self.skills.iter().zip(states) {
            // Too few frames give what is not finite, which is refused in the end.
            let own = frames.get(leaf.frames.clone()).unwrap_or_default();
            let state = &mut skill.state;
            let mut value = leaf.policy.evaluate(&leaf.inertia, own, tool, velocity, state);
            value.natural = leaf.governor.govern(&value.natural, velocity, state.acts_alone());
            sum.add(&value.natural);
            energy += value.energy;
            skill.value = Some(value);
        }
        (sum, energy)
    }

    /// The leaves on the tool: the skills with a goal attractor, or the lift; beside them an external
    /// command and the approach funnel.
    fn tool_leaves(
        &self,
        task: &Task,
        parameters: &TaskParameters<'_>,
        kinematics: &Kinematics<N>,
        skills: &mut [SkillState],
    ) -> ToolLeaves<N> {
        let (tool, velocity) = (kinematics.tool_pose(), kinematics.tool_velocity);
        let frames = parameters.frames;
        let goal_frame = frames.get(parameters.goal_frame);
        let (mut leaf, learned_energy) = self.learned(frames, &tool, &velocity, skills);
        let own = frames.get(self.skills[0].frames.clone()).unwrap_or_default();
        let goal = self.skills[0].policy.goal(own, &mut skills[0].state);
        let energy = match (task, &self.lift) {
            (Task::Reach(goal), Some(lift)) => {
                skills.iter_mut().for_each(|skill| skill.value = None);
                leaf = lift.evaluate(&tool, &velocity, goal);
                (tool.position - goal.position).length()
            }
            _ => {
                if let (Some(attractor), Some(frame)) = (&self.attractor, goal_frame) {
                    let moving = frame.compose(&frame.pose.inverse().compose(&goal));
                    leaf.add(&attractor.towards(&tool, &velocity, &moving));
                }
                learned_energy
            }
        };
        if let Some(desired) = parameters.external.and_then(|external| external.leaf(&velocity)) {
            leaf.add(&desired);
        }
        let mut root = Natural::<N>::zero();
        let drift = kinematics.tool_drift;
        root.add_pullback(&leaf, &kinematics.tool_jacobian, &drift.into());
        if let (Task::Skill, Some(funnel), Some(frame)) = (task, &self.approach, goal_frame) {
            let clearance = funnel.clearance(tool.position, velocity.linear, goal.position, frame);
            let motion = PointMotion {
                position: tool.position,
                velocity: velocity.linear,
                jacobian: kinematics.tool_jacobian.fixed_rows::<3>(0).into_owned(),
                drift: drift.linear.into(),
            };
            funnel.leaf.add(&clearance, &motion, &mut root);
        }
        ToolLeaves { root, energy, learned_energy, goal }
    }

    /// Evaluates the policy  [thesis algorithm 4.1]: pushforward, leaves, pullback, resolve.
    ///
    /// * `q`, `qd`  joint positions and velocities, N
    ///
    /// Hot path: no allocation.
    ///
    /// # Errors
    /// When the root cannot be resolved: the caller stops the arm.
    pub fn evaluate(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        task: &Task,
        parameters: &TaskParameters<'_>,
        workspace: &mut Workspace<N>,
    ) -> Result<Decision<N>, ResolveError> {
        forward_kinematics_with_velocity(&self.chain, q, qd, &mut workspace.kinematics);
        let kinematics = &workspace.kinematics;
        let tool = kinematics.tool_pose();
        let leaves = self.tool_leaves(task, parameters, kinematics, &mut workspace.skills);
        let ToolLeaves { root, energy, learned_energy, goal } = leaves;
        let tool_goal = match task {
            Task::Skill => goal,
            Task::Reach(pose) => *pose,
        };
        let task = leaves::Task { natural: root, energy };
        let resolved =
            self.resolve(&self.tree, task, &tool_goal, (q, qd), parameters, workspace)?;
        // What an external command moves into an obstacle is no reason for the skills to go on.
        let commanded = parameters.external.is_some_and(ExternalCommand::is_active);
        let obstructed_fraction = resolved.proximity.obstructed_fraction;
        let held = if commanded { 0.0 } else { obstructed_fraction };
        workspace.skills.iter_mut().for_each(|skill| skill.state.set_obstructed(held));
        Ok(Decision {
            acceleration: resolved.acceleration,
            tool,
            goal,
            energy: learned_energy,
            proximity: Proximity {
                obstructed_fraction,
                clearance_min_m: resolved
                    .proximity
                    .clearance_min_m
                    .min(resolved.self_clearance_min_m),
            },
        })
    }

    /// The acceleration towards the posture to which the arm retreats \[rad/s² or m/s²\], around the obstacles
    /// that are known; `None` where it does not retreat. Hot path: no allocation.
    ///
    /// # Errors
    /// When the root cannot be resolved: the caller stops the arm.
    pub fn retreat(
        &self,
        retreat: Retreat,
        (q, qd): (&SVector<f64, N>, &SVector<f64, N>),
        parameters: &TaskParameters<'_>,
        workspace: &mut Workspace<N>,
    ) -> Result<Option<SVector<f64, N>>, ResolveError> {
        let Some(tree) = &self.retreats[retreat as usize] else { return Ok(None) };
        forward_kinematics_with_velocity(&self.chain, q, qd, &mut workspace.kinematics);
        let tool = workspace.kinematics.tool_pose();
        let task = leaves::Task { natural: Natural::zero(), energy: 0.0 };
        let resolved = self.resolve(tree, task, &tool, (q, qd), parameters, workspace)?;
        Ok(Some(resolved.acceleration))
    }

    /// Adds the leaves beside the task, and resolves.
    fn resolve(
        &self,
        tree: &Tree<N>,
        task: leaves::Task<N>,
        tool_goal: &Pose,
        (q, qd): (&SVector<f64, N>, &SVector<f64, N>),
        parameters: &TaskParameters<'_>,
        workspace: &mut Workspace<N>,
    ) -> Result<Resolved<N>, ResolveError> {
        let kinematics = &workspace.kinematics;
        let tool = kinematics.tool_pose();
        workspace.centres.forget();
        workspace.motions.forget();
        for (centre, part) in workspace.part_centres.iter_mut().zip(&self.parts) {
            *centre = point_position(kinematics, part.joint, part.centre);
        }
        let links = Links {
            policy: self,
            kinematics,
            part_centres: &workspace.part_centres,
            centres: &workspace.centres,
            motions: &workspace.motions,
            tool: &tool,
            tool_goal,
        };
        let tick = Tick {
            task,
            position: *q,
            velocity: *qd,
            body: &links,
            obstacles: parameters.obstacles,
            dt_s: parameters.dt_s,
        };
        tree.evaluate(&tick, &mut workspace.tree)
    }
}

/// The leaves beside the task, from the configuration.
fn tree<const N: usize>(
    chain: &Chain<N>,
    points: &ControlPoints,
    config: &ControllerConfig,
    posture: Option<&PostureLeaf>,
) -> Tree<N> {
    let robot = &config.robot;
    let [lower, upper] = working_range(chain, robot);
    let acceleration_max = SVector::<f64, N>::from_column_slice(&robot.acceleration_max);
    Tree {
        joint_damping: config.joint_damping,
        joint_limits: config.joint_limits.map(|leaf| JointLimits { lower, upper, leaf }),
        joint_speed_limits: config.joint_speeds.map(|leaf| JointSpeedLimits {
            speed_max: chain.velocity_max() * robot.velocity_fraction,
            leaf,
        }),
        posture: posture.map(PostureLeaf::leaf),
        self_collision: config.self_collision.as_ref().map(|own| SelfCollision {
            leaf: own.avoidance,
            margin_m: own.margin_m,
            pairs: part_pairs(points, &SelfPairs::new(chain, points, &own.exempt)),
        }),
        avoidance: config.collision.as_ref().map(Collision::leaf),
        obstacle_jerk_max: config.collision.as_ref().map(|c| acceleration_max / c.ramp_time_s),
    }
}

/// Which links keep clear of each other: of two links either all pairs of points are watched or none.
fn part_pairs(points: &ControlPoints, pairs: &SelfPairs) -> Box<[(usize, usize)]> {
    let parts = LinkPart::of(points.as_slice());
    let part = |i: usize| parts.iter().position(|part| part.points.contains(&i));
    let mut found: Vec<_> =
        pairs.watched.iter().filter_map(|&(i, j)| Some((part(i)?, part(j)?))).collect();
    found.dedup();
    found.into()
}
