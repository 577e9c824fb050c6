//! The policy of a robot: the task's leaves on its tool, and the tree of all others.

use nalgebra::{SVector, Vector6};
use tprmp_model::controller_config::{
    Collision, ControllerConfig, Fallback, Fallbacks, PostureLeaf,
};
use tprmp_rmpflow::leaves::{
    self, ApproachFunnel, JointLimits, JointSpeedLimits, KeepUpright, Obstacle, PoseAttractor,
    Proximity, SelfCollision, Tick,
};
use tprmp_rmpflow::natural::{Natural, ResolveError};
use tprmp_rmpflow::policy::{SkillPolicy, SpeedGovernor};
use tprmp_rmpflow::tree::{Resolved, Tree, TreeState};
use tprmp_robot::{
    Chain, ControlPoints, Kinematics, SelfPairs, forward_kinematics,
    forward_kinematics_with_velocity,
};
use tprmp_spatial::{MovingPose, PointMotion, Pose, Twist};

use crate::arm::{Arm, PointPlaces, part_pairs};
use crate::inputs::external::ExternalCommand;
use crate::motion::limits::working_range;
use crate::skill_leaf::{Choice, Posture, SkillLeaf, SkillState};

/// The policy of a robot: immutable.
#[derive(Debug)]
pub struct RobotPolicy<const N: usize> {
    arm: Arm<N>,
    /// At least one; the first is the task.
    skills: Vec<SkillLeaf>,
    attractor: Option<PoseAttractor>,
    upright: Option<KeepUpright>,
    approach: Option<ApproachFunnel>,
    lift: Option<PoseAttractor>,
    tree: Tree<N>,
    /// The tree with the posture to which the arm retreats, for faulty frames and for requests.
    retreats: [Option<Tree<N>>; 2],
}

/// What the policy needs between ticks, and where it puts its intermediate results.
#[derive(Debug)]
pub struct Workspace<const N: usize> {
    /// Kinematics of the last evaluation.
    pub kinematics: Kinematics<N>,
    skills: Vec<SkillState>,
    tree: TreeState<N>,
    places: PointPlaces<N>,
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
    /// Goal of the first skill as the frames are now; of one that goes round, where it should be.
    pub goal: Pose,
    /// How far a first skill that goes round has come since its start \[rounds\]; `None` for one that goes to a goal.
    pub rounds: Option<f64>,
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
        self.skills.iter_mut().for_each(SkillState::restart);
    }

    /// Whether the gripper holds something: then what it holds keeps clear of obstacles too.
    pub fn hold(&mut self, holds: bool) {
        self.places.hold(holds);
    }

    /// The mode in which the first skill is done, once it was evaluated.
    #[must_use]
    pub fn choice(&self) -> Option<Choice> {
        self.skills[0].choice()
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
    /// * `skills`  the modes of each; the first is the task, the others act beside it, and there are as many
    ///   of them as `config.additional_skills`
    ///
    /// # Panics
    /// When there are not.
    #[must_use]
    pub fn new(
        chain: Chain<N>,
        skills: Vec<Vec<SkillPolicy>>,
        control_points: &ControlPoints,
        config: &ControllerConfig,
    ) -> Self {
        assert_eq!(skills.len(), 1 + config.additional_skills.len(), "a leaf for each skill");
        let mut first = 0;
        let leaves = core::iter::once(&config.skill).chain(&config.additional_skills);
        let skills = skills.into_iter().zip(leaves).map(|(modes, leaf)| {
            let leaf = SkillLeaf::new(modes, first, leaf);
            first = leaf.frames.end;
            leaf
        });
        let skills = skills.collect();
        let arm = Arm::new(chain, control_points, config);
        let chain = &arm.chain;
        Self {
            tree: tree(chain, control_points, config, config.posture.as_ref()),
            retreats: {
                let Fallbacks { frames, request, .. } = &config.supervision.fallback;
                [frames, request].map(|fallback| match fallback {
                    Fallback::Retreat(posture) => {
                        Some(tree(chain, control_points, config, Some(posture)))
                    }
                    Fallback::Hold | Fallback::GravityOnly => None,
                })
            },
            arm,
            skills,
            attractor: config.goal_attractor,
            upright: config.keep_upright,
            approach: config.approach,
            lift: config.lift.map(|lift| lift.attractor),
        }
    }

    /// A fresh workspace. Allocates: at start-up only.
    #[must_use]
    pub fn workspace(&self) -> Workspace<N> {
        Workspace {
            kinematics: Kinematics::new(),
            skills: self.skills.iter().map(|_| SkillState::default()).collect(),
            tree: TreeState::default(),
            places: self.arm.places(),
        }
    }

    /// The robot.
    #[must_use]
    pub fn chain(&self) -> &Chain<N> {
        &self.arm.chain
    }

    /// Where the tool is at these joint positions, N \[rad or m\]; the workspace's kinematics are overwritten.
    pub fn tool_pose(&self, q: &SVector<f64, N>, workspace: &mut Workspace<N>) -> Pose {
        forward_kinematics(&self.arm.chain, q, &mut workspace.kinematics);
        workspace.kinematics.tool_pose()
    }

    /// What bounds the velocities that the first skill asks for.
    pub fn governor(&mut self) -> &mut SpeedGovernor {
        &mut self.skills[0].governor
    }

    /// Whether the first skill goes round, and does not end by itself.
    #[must_use]
    pub fn is_periodic(&self) -> bool {
        self.skills[0].is_periodic()
    }

    /// Which coordinates of the tool the first skill moves, displacement before rotation: 1, or 0.
    #[must_use]
    pub fn moved(&self) -> Vector6<f64> {
        self.skills[0].moved()
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
            let policy = leaf.policy(skill);
            let state = &mut skill.state;
            let mut value = policy.evaluate(&leaf.inertia, own, tool, velocity, state);
            value.natural = leaf.governor.govern(&value.natural, velocity, state.acts_alone());
            sum.add(&value.natural);
            energy += value.energy;
            skill.value = Some(value);
        }
        (sum, energy)
    }

    /// The leaves on the tool: the skills with a goal attractor, or the lift; beside them what keeps it upright, an
    /// external command and the approach funnel.
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
        let goal = self.skills[0].policy(&skills[0]).goal(own, &mut skills[0].state);
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
        if let Some(upright) = &self.upright {
            leaf.add(&upright.evaluate(&tool, velocity.angular));
        }
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
        self.decide(q, parameters, workspace);
        forward_kinematics_with_velocity(&self.arm.chain, q, qd, &mut workspace.kinematics);
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
        let first = &workspace.skills[0].state;
        let rounds = first.phase().filter(|_| self.is_periodic());
        let rounds = rounds.map(|phase| first.rounds() + phase.value);
        Ok(Decision {
            acceleration: resolved.acceleration,
            tool,
            goal,
            rounds,
            energy: learned_energy,
            proximity: Proximity {
                obstructed_fraction,
                clearance_min_m: resolved
                    .proximity
                    .clearance_min_m
                    .min(resolved.self_clearance_min_m),
                closing_1_s: resolved.proximity.closing_1_s,
            },
        })
    }

    /// Decides on the modes of the skills that start or go on.
    #[inline]
    fn decide(
        &self,
        q: &SVector<f64, N>,
        parameters: &TaskParameters<'_>,
        workspace: &mut Workspace<N>,
    ) {
        let Workspace { kinematics, skills, places, .. } = workspace;
        for (leaf, state) in self.skills.iter().zip(skills) {
            let frames = parameters.frames.get(leaf.frames.clone()).unwrap_or_default();
            let (arm, obstacles) = (&self.arm, parameters.obstacles);
            let posture = Posture { arm, q, frames, obstacles };
            leaf.decide(&posture, kinematics, places, state);
        }
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
    ) -> Result<Option<Resolved<N>>, ResolveError> {
        let Some(tree) = &self.retreats[retreat as usize] else { return Ok(None) };
        forward_kinematics_with_velocity(&self.arm.chain, q, qd, &mut workspace.kinematics);
        let tool = workspace.kinematics.tool_pose();
        let task = leaves::Task { natural: Natural::zero(), energy: 0.0 };
        self.resolve(tree, task, &tool, (q, qd), parameters, workspace).map(Some)
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
        let links = self.arm.links(kinematics, &mut workspace.places, [&tool, tool_goal]);
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
