//! A policy among frames at rest: what its pictures need to know of it.

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use tprmp_model::skill_model::{EvaluationError, Manifold, Motion, PolicyModel, SkillModel};
use tprmp_rmpflow::policy::canonical::frame_map::{Canonical, FrameMap, FrameTransforms};
use tprmp_rmpflow::policy::thesis::{ThesisPolicy, ThesisState};
use tprmp_rmpflow::policy::{PolicyState, SkillPolicy};
use tprmp_spatial::{MovingPose, Pose, Twist, Wrench};

use super::forces::Forces;
use crate::canonical::PhaseProfile;
use crate::certify::policy::{Body, LearnedPolicy, MotionPolicy, PolicyInstance};
use crate::certify::rollout::{RolloutSpec, Target, follow, resolve};
use tprmp_drawing::Ellipsoid;

/// Step of the rollouts [s].
const STEP_S: f64 = 2e-3;
/// Time between the poses of a rollout \[s\], and how many steps that is.
pub const SAMPLE_S: f64 = 1e-2;
const SAMPLE_STEPS: usize = 5;
/// Bound on the duration of a rollout [s].
const DURATION_MAX_S: f64 = 20.0;
/// A rollout is over this near to the goal and to rest, in fractions of the way from start to goal …
const ARRIVED_FRACTION: f64 = 1e-3;
/// … and in radians.
const ARRIVED_RAD: f64 = 5e-3;

/// The position part of a policy at a point, at rest, for an inertia of 1 kg at the goal, at the phase
/// at which the point is most at home.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Φ above that of the goal \[J\].
    pub potential: f64,
    /// −∇Φ \[N\].
    pub force: DVec3,
    /// −M⁻¹∇Φ [m/s²].
    pub acceleration: DVec3,
    /// Mean eigenvalue of B over the directions in which the skill moves [kg/s].
    pub damping: f64,
}

/// What the pictures of a model are made from.
pub struct Skill<'a> {
    /// The model.
    pub model: &'a SkillModel,
    /// The map of its frames.
    pub map: FrameMap,
    /// Its policy.
    policy: LearnedPolicy,
    /// The part of it that leads positions: of a canonical policy its position field; of a product
    /// of Gaussians on poses the whole, which does not fall into parts.
    position: LearnedPolicy,
    /// Where the position part moves.
    position_manifold: Manifold,
}

impl<'a> Skill<'a> {
    /// Evaluates a model, of which `position` is [`position_part`].
    ///
    /// # Errors
    /// When start and goal coincide, or the policy cannot be evaluated.
    pub fn new(model: &'a SkillModel, position: &'a SkillModel) -> Result<Self, EvaluationError> {
        Ok(Self {
            model,
            map: model.frame_map()?,
            policy: LearnedPolicy::new(model)?,
            position: LearnedPolicy::new(position)?,
            position_manifold: position.manifold,
        })
    }

    /// Whether it moves in the plane.
    pub fn planar(&self) -> bool {
        self.model.manifold == Manifold::R2
    }

    /// Whether start and goal are fixed to the same frame.
    pub fn single_frame(&self) -> bool {
        self.model.start_frame == self.model.goal_frame
    }

    /// Frames in the model's order, as the map takes them in.
    pub fn displacement(&self, frames: &[Pose]) -> FrameTransforms {
        let frames: Vec<_> = frames.iter().copied().map(MovingPose::at_rest).collect();
        self.map.transforms(&frames).expect("they are the model's frames")
    }

    /// How far it is from the start to the farthest of the other frames \[m\].
    pub fn way(&self) -> f64 {
        let start = DVec3::from_array(self.model.canonical.start.position_m);
        let points = self.map.anchors().iter().map(|anchor| anchor.point);
        points.map(|point| (point - start).length()).fold(0.0, f64::max)
    }
}

/// A model without what leads its orientation, where that is a field of its own.
pub fn position_part(model: &SkillModel) -> SkillModel {
    let mut part = model.clone();
    if let PolicyModel::Canonical { orientation, .. } = &mut part.policy
        && orientation.take().is_some()
    {
        part.manifold = Manifold::R3;
    }
    part
}

/// A skill among frames at rest, in the robot's base frame.
pub struct Scene<'a> {
    /// The skill.
    pub skill: &'a Skill<'a>,
    /// The frames, in the model's order.
    pub frames: Vec<Pose>,
    /// Where the skill ends.
    pub goal: Pose,
    /// The policy's Gaussians over positions.
    pub gaussians: Vec<Ellipsoid>,
    /// Demonstrations as they would go among these frames.
    pub demonstrations: Vec<Vec<Pose>>,
}

impl<'a> Scene<'a> {
    /// A skill among these frames, in the model's order. Demonstrations and Gaussians, given in
    /// canonical coordinates, are carried there by the frames' map; where the policy has Gaussians of
    /// its own, the products of what the frames see, those are taken.
    pub fn new(
        skill: &'a Skill<'a>,
        frames: Vec<Pose>,
        demonstrations: &[Vec<Canonical>],
        gaussians: &[Ellipsoid],
        profile: &PhaseProfile,
    ) -> Self {
        let transforms = skill.displacement(&frames);
        let carried = |path: &Vec<Canonical>| -> Vec<Pose> {
            let last = (path.len() - 1) as f64;
            let phase = |i: usize| profile.at(i as f64 / last)[0];
            let points = path.iter().enumerate();
            points.map(|(i, y)| skill.map.forward(&transforms, phase(i), y)).collect()
        };
        let moving: Vec<MovingPose> = frames.iter().copied().map(MovingPose::at_rest).collect();
        let policy = skill.policy.policy();
        let products = match policy {
            SkillPolicy::Canonical(_) => {
                gaussians.iter().map(|g| carry(&skill.map, &transforms, g)).collect()
            }
            SkillPolicy::Plane(product) => products(product, &moving, gaussians),
            SkillPolicy::Space(product) => products(product, &moving, gaussians),
            SkillPolicy::Pose(product) => products(product, &moving, gaussians),
        };
        Self {
            goal: policy.goal(&moving, &mut PolicyState::default()),
            gaussians: products,
            demonstrations: demonstrations.iter().map(carried).collect(),
            skill,
            frames,
        }
    }

    /// The components of the field of a planar skill.
    pub(super) fn forces(&self) -> Option<Forces> {
        Forces::new(self.skill.policy.policy(), &self.frames)
    }

    fn frames_at_rest(&self) -> Vec<MovingPose> {
        self.frames.iter().copied().map(MovingPose::at_rest).collect()
    }

    /// Evaluates the position part at points, the tool turned as at the goal.
    pub fn sampler(&self) -> impl FnMut(DVec3) -> Sample {
        let goal = self.goal;
        let manifold = self.skill.position_manifold;
        let frames = self.frames_at_rest();
        let mut policy = self.skill.position.instance();
        let at_goal = match self.skill.model.motion {
            Motion::Discrete => policy.energy_at(&frames, &goal),
            // What goes round has no goal: above that a round later.
            Motion::Periodic { .. } => {
                let start = self.skill.model.canonical.start.into();
                policy.energy_at(&frames, &self.frames[0].compose(&start))
            }
        };
        move |position| sample(&mut policy, &frames, manifold, at_goal, &Pose { position, ..goal })
    }

    /// Paths from these starts at rest, in their order, a pose every [`SAMPLE_S`].
    pub fn rollouts(&self, starts: &[Pose]) -> Vec<Vec<Pose>> {
        let arrived = Some([ARRIVED_FRACTION * self.skill.way(), ARRIVED_RAD]);
        let target = Target { goal: self.goal, arrived };
        let frames = self.frames_at_rest();
        let rollout = |start: &Pose| {
            let spec = RolloutSpec {
                manifold: self.skill.model.manifold,
                start: Body::at_rest(*start),
                step_s: STEP_S,
                steps: (DURATION_MAX_S / STEP_S) as usize,
            };
            let (mut path, mut step) = (Vec::new(), 0);
            follow(&mut self.skill.policy.instance(), &frames, &target, &spec, |pose| {
                if step % SAMPLE_STEPS == 0 {
                    path.push(*pose);
                }
                step += 1;
            });
            path
        };
        starts.par_iter().map(rollout).collect()
    }
}

/// Takes a Gaussian along with the frames at its phase.
fn carry(map: &FrameMap, transforms: &FrameTransforms, gaussian: &Ellipsoid) -> Ellipsoid {
    let y = Canonical { position: gaussian.mean, rotation: DVec3::ZERO };
    let phase = gaussian.phase;
    let pose = map.forward(transforms, phase, &y);
    let mapped = map.at(transforms, phase, 0.0).position(pose.position, DVec3::ZERO);
    let jacobian = mapped.jacobian.transpose();
    Ellipsoid {
        mean: pose.position,
        covariance: jacobian * gaussian.covariance * jacobian.transpose(),
        phase: gaussian.phase,
    }
}

/// The products of what the frames see, with the phases of these Gaussians.
fn products<const D: usize>(
    skill: &ThesisPolicy<D>,
    frames: &[MovingPose],
    gaussians: &[Ellipsoid],
) -> Vec<Ellipsoid> {
    let mut state = ThesisState::default();
    skill.update(frames, &mut state);
    let Some(field) = state.field() else { return Vec::new() };
    let each = field.components().zip(gaussians);
    each.filter_map(|((mean, precision), gaussian)| {
        let covariance = precision.try_inverse()?;
        let mut ellipsoid =
            Ellipsoid { mean: DVec3::ZERO, covariance: DMat3::ZERO, phase: gaussian.phase };
        for i in 0..D.min(3) {
            ellipsoid.mean[i] = mean[i];
            for j in 0..D.min(3) {
                ellipsoid.covariance.col_mut(j)[i] = covariance[(i, j)];
            }
        }
        Some(ellipsoid)
    })
    .collect()
}

/// f = −∇Φ − ξ − B ẋ with ξ quadratic in ẋ: at rest it is −∇Φ, and half the difference of f for
/// opposite velocities is −B ẋ.
fn sample(
    policy: &mut PolicyInstance,
    frames: &[MovingPose],
    manifold: Manifold,
    at_goal: f64,
    pose: &Pose,
) -> Sample {
    policy.restart();
    let mut desired = |linear: DVec3| {
        let velocity = Twist { linear, ..Twist::ZERO };
        policy.evaluate(frames, &Body { velocity, ..Body::at_rest(*pose) })
    };
    let rest = desired(DVec3::ZERO);
    let dimension = manifold.position_dimension();
    let mut trace = 0.0;
    for (i, axis) in DVec3::AXES.into_iter().enumerate().take(dimension) {
        let [ahead, back] = [axis, -axis].map(|v| desired(v).natural.force[i]);
        trace += 0.5 * (back - ahead);
    }
    Sample {
        potential: rest.energy - at_goal,
        force: Wrench::from(rest.natural.force).force,
        acceleration: resolve(&rest.natural, manifold).map_or(DVec3::ZERO, |a| a.linear),
        damping: trace / dimension as f64,
    }
}
