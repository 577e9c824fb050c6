//! The RMP-tree of a robot: leaves in task spaces, pulled back to the joints and resolved.

use glam::DVec3;
use nalgebra::{SMatrix, SVector, Vector1, Vector3};
use tprmp_model::controller_config::{ControllerConfig, ExemptObstacle, Exemption};
use tprmp_rmpflow::frame_map::{FrameMotion, Pose};
use tprmp_rmpflow::leaves::{
    ApproachFunnel, Clearance, CollisionAvoidance, JointDamping, Obstacle, PoseAttractor,
};
use tprmp_rmpflow::natural::{Natural, ResolveError};
use tprmp_rmpflow::policy::{Policy as SkillPolicy, PolicyState};
use tprmp_rmpflow::skill::{SkillInertia, SkillValue};
use tprmp_robot::{
    Chain, ControlPoint, ControlPoints, Kinematics, forward_kinematics_with_velocity,
    point_kinematics,
};

/// The tree: immutable.
#[derive(Debug)]
pub struct Policy<const N: usize> {
    chain: Chain<N>,
    skill: SkillPolicy,
    inertia: SkillInertia,
    joint_damping: JointDamping,
    collision: Option<CollisionNode>,
    approach: Option<ApproachFunnel>,
    lift: Option<PoseAttractor>,
}

/// The node of all control points.
#[derive(Debug)]
struct CollisionNode {
    leaf: CollisionAvoidance,
    margin_m: f64,
    points: Vec<AvoidingPoint>,
}

#[derive(Debug)]
struct AvoidingPoint {
    point: ControlPoint,
    avoids_spheres: bool,
    avoids_half_spaces: bool,
}

/// What the tree needs between ticks, and where it puts its intermediate results.
#[derive(Debug)]
pub struct Workspace<const N: usize> {
    /// Kinematics of the last evaluation.
    pub kinematics: Kinematics<N>,
    skill: PolicyState,
    /// Of the last evaluation of the skill.
    value: Option<SkillValue>,
}

/// What the tool should do.
#[derive(Debug, Clone, Copy)]
pub enum Task {
    /// Follow the skill.
    Skill,
    /// Go to a pose.
    Reach(Pose),
}

/// The task parameters of a tick.
#[derive(Debug, Clone, Copy)]
pub struct TaskParameters<'a> {
    /// The skill's frames, in its order.
    pub frames: &'a [FrameMotion],
    /// Which of them the goal is fixed to.
    pub goal_frame: usize,
    /// What to keep away from.
    pub obstacles: &'a [Obstacle],
}

/// What the tree decided, and what it saw.
#[derive(Debug, Clone, Copy)]
pub struct Decision<const N: usize> {
    /// q̈ \[rad/s² or m/s²\].
    pub acceleration: SVector<f64, N>,
    /// Pose of the tool.
    pub tool: Pose,
    /// Goal of the skill as the frames are now.
    pub goal: Pose,
    /// V of the skill \[J\].
    pub energy: f64,
}

impl<const N: usize> Workspace<N> {
    /// A fresh workspace.
    #[must_use]
    pub fn new() -> Self {
        Self { kinematics: Kinematics::new(), skill: PolicyState::default(), value: None }
    }

    /// Forgets how far the skill is on its way: it goes on from where the tool is.
    pub fn restart(&mut self) {
        self.skill.restart();
        self.value = None;
    }

    /// Lets the skill that was evaluated last go on for `dt_s` with the joint accelerations that the arm
    /// gets \[rad/s² or m/s²\], limits included. Where the tool only reaches for a pose nothing goes on.
    pub fn advance(&mut self, acceleration: &SVector<f64, N>, dt_s: f64) {
        if let Some(value) = self.value.take() {
            let tool = self.kinematics.tool_jacobian * acceleration + self.kinematics.tool_jd_qd;
            let linear = DVec3::new(tool[0], tool[1], tool[2]);
            let angular = DVec3::new(tool[3], tool[4], tool[5]);
            self.skill.advance(&value, linear, angular, dt_s);
        }
    }
}

impl<const N: usize> Default for Workspace<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Policy<N> {
    /// Builds the tree. Allocates: at start-up only.
    #[must_use]
    pub fn new(
        chain: Chain<N>,
        skill: SkillPolicy,
        control_points: &ControlPoints,
        config: &ControllerConfig,
    ) -> Self {
        let collision = config.collision.as_ref().map(|collision| CollisionNode {
            leaf: collision.avoidance.leaf(),
            margin_m: collision.margin_m,
            points: control_points
                .as_slice()
                .iter()
                .map(|point| {
                    let link = &chain.moving_links()[point.link].0;
                    let avoids = |obstacle: ExemptObstacle| {
                        !collision.exempt.contains(&Exemption { link: link.clone(), obstacle })
                    };
                    AvoidingPoint {
                        point: *point,
                        avoids_spheres: avoids(ExemptObstacle::Sphere),
                        avoids_half_spaces: avoids(ExemptObstacle::HalfSpace),
                    }
                })
                .collect(),
        });
        Self {
            chain,
            skill,
            inertia: config.skill.inertia(),
            joint_damping: config.joint_damping.leaf(),
            collision,
            approach: config.approach.map(|approach| approach.leaf()),
            lift: config.lift.map(|lift| lift.leaf()),
        }
    }

    /// The robot.
    #[must_use]
    pub fn chain(&self) -> &Chain<N> {
        &self.chain
    }

    /// Whether the skill leads the orientation too.
    #[must_use]
    pub fn turns(&self) -> bool {
        self.skill.turns()
    }

    /// Evaluates the tree  [thesis algorithm 4.1]: pushforward, leaves, pullback, resolve.
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
        let tool =
            Pose { position: kinematics.tool_position, orientation: kinematics.tool_orientation() };
        let twist = &kinematics.tool_twist;
        let linear = DVec3::new(twist[0], twist[1], twist[2]);
        let angular = DVec3::new(twist[3], twist[4], twist[5]);

        let state = &mut workspace.skill;
        let frames = parameters.frames;
        let value = self.skill.evaluate(&self.inertia, frames, &tool, linear, angular, state);
        let goal = self.skill.goal(frames, state);
        workspace.value = matches!(task, Task::Skill).then_some(value);
        let mut root: Natural<N> = self.joint_damping.evaluate(qd);
        let leaf = match (task, &self.lift) {
            (Task::Reach(goal), Some(lift)) => lift.evaluate(&tool, linear, angular, goal),
            _ => value.natural,
        };
        root.add_pullback(&leaf, &kinematics.tool_jacobian, &kinematics.tool_jd_qd);
        if let (Task::Skill, Some(funnel), Some(frame)) =
            (task, &self.approach, frames.get(parameters.goal_frame))
        {
            let clearance = funnel.clearance(tool.position, linear, goal.position, frame);
            let jacobian = kinematics.tool_jacobian.fixed_rows::<3>(0).into_owned();
            let drift = kinematics.tool_jd_qd.fixed_rows::<3>(0).into_owned();
            add_clearance(&funnel.leaf, &clearance, &jacobian, &drift, &mut root);
        }
        if let Some(collision) = &self.collision {
            collision.add(&self.chain, kinematics, parameters.obstacles, &mut root);
        }
        Ok(Decision { acceleration: root.resolve()?, tool, goal, energy: value.energy })
    }
}

impl CollisionNode {
    /// Adds one leaf for each pair of a control point and an obstacle that are close.
    fn add<const N: usize>(
        &self,
        chain: &Chain<N>,
        kinematics: &Kinematics<N>,
        obstacles: &[Obstacle],
        root: &mut Natural<N>,
    ) {
        for AvoidingPoint { point, avoids_spheres, avoids_half_spaces } in &self.points {
            let mut motion = None;
            for obstacle in obstacles {
                let avoids = match obstacle {
                    Obstacle::Sphere { .. } => avoids_spheres,
                    Obstacle::HalfSpace { .. } => avoids_half_spaces,
                };
                if !avoids {
                    continue;
                }
                let motion = motion.get_or_insert_with(|| {
                    point_kinematics(chain, kinematics, point.joint, point.centre)
                });
                let velocity = DVec3::from_slice(motion.velocity.as_slice());
                let clearance =
                    obstacle.clearance(motion.position, velocity, point.radius + self.margin_m);
                add_clearance(&self.leaf, &clearance, &motion.jacobian, &motion.jd_qd, root);
            }
        }
    }
}

/// Pulls a leaf on a clearance back to the joints, through the point whose clearance it is.
///
/// * `jacobian`, `drift`  of the point: 3×N, J̇q̇
fn add_clearance<const N: usize>(
    leaf: &CollisionAvoidance,
    clearance: &Clearance,
    jacobian: &SMatrix<f64, 3, N>,
    drift: &Vector3<f64>,
    root: &mut Natural<N>,
) {
    if let Some(leaf) = leaf.evaluate(clearance.distance, clearance.rate) {
        let normal = clearance.normal;
        let row = SMatrix::<f64, 1, 3>::new(normal.x, normal.y, normal.z);
        let drift = (row * drift)[0] + clearance.curvature;
        root.add_pullback(&leaf, &(row * jacobian), &Vector1::new(drift));
    }
}
