//! Learned policies in the form in which they are rolled out and examined.

use nalgebra::{DMatrix, SMatrix, SVector};
use tprmp_model::skill_model::{
    BlockCertificate, EvaluationError, FieldModel, PolicyModel, SkillModel, ValleyCertificate,
};
use tprmp_rmpflow::policy::canonical::field::Component;
use tprmp_rmpflow::policy::thesis::{ThesisPolicy, ThesisState};
use tprmp_rmpflow::policy::{Phase, PolicyState, SkillInertia, SkillPolicy, SkillValue};
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

use crate::certify::rollout::at_rest;
use crate::fit::valley;

/// Inertia of the body that follows a policy; accelerations do not depend on it.
const INERTIA: SkillInertia = SkillInertia { linear_kg: 1.0, angular_kg_m2: 1.0 };
/// Step of the central differences at the goal [m or rad].
const GOAL_STEP: f64 = 1e-5;

/// A learned policy.
pub struct Learned<'a> {
    model: &'a SkillModel,
    policy: SkillPolicy,
}

/// A policy among frames, on its way.
pub struct Situation<'a> {
    policy: &'a SkillPolicy,
    frames: Vec<MovingPose>,
    state: PolicyState,
}

impl Situation<'_> {
    /// The policy at a moving pose of the tool.
    pub fn evaluate(&mut self, pose: &Pose, velocity: &Twist) -> SkillValue {
        self.policy.evaluate(&INERTIA, &self.frames, pose, velocity, &mut self.state)
    }

    /// Lets the policy go on for a step with the acceleration that the tool gets.
    pub fn advance(&mut self, value: &SkillValue, tool: &SpatialAcceleration, step_s: f64) {
        self.state.advance(value, tool, step_s);
    }

    /// Forgets how far the policy is on its way: it goes on from where the tool is.
    pub fn restart(&mut self) {
        self.state.restart();
    }

    /// Moves the frames, which are in the order of the model's.
    ///
    /// # Panics
    /// When they are not as many as before.
    pub fn move_frames(&mut self, frames: &[MovingPose]) {
        self.frames.copy_from_slice(frames);
    }

    /// V of the policy at the goal, at rest; it has to start anew afterwards, and does.
    pub fn energy_at(&mut self, goal: &Pose) -> f64 {
        self.state.resume(Phase { value: 1.0, rate_1_s: 0.0 });
        let energy = self.evaluate(goal, &Twist::ZERO).energy;
        self.restart();
        energy
    }
}

impl<'a> Learned<'a> {
    /// The policy of a model.
    ///
    /// # Errors
    /// When it cannot be evaluated.
    pub fn new(model: &'a SkillModel) -> Result<Self, EvaluationError> {
        Ok(Self { model, policy: model.policy()? })
    }

    /// The policy as it is evaluated.
    pub fn policy(&self) -> &SkillPolicy {
        &self.policy
    }

    /// The policy with these frames, in the order of the model's.
    #[must_use]
    pub fn situation(&self, frames: &[Pose]) -> Situation<'_> {
        let frames = frames.iter().map(|pose| MovingPose::at_rest(*pose)).collect();
        Situation { policy: &self.policy, frames, state: PolicyState::default() }
    }

    /// What can be said of the metric, and of the goal with these frames.
    #[must_use]
    pub fn blocks(&self, frames: &[Pose], goal: &Pose) -> Vec<BlockCertificate> {
        if let PolicyModel::Canonical { position, orientation } = &self.model.policy {
            let mut blocks = vec![if position.components[0].mean.len() == 3 {
                field_block::<3>("position", position)
            } else {
                field_block::<4>("position", position)
            }];
            blocks.extend(orientation.iter().map(|field| field_block::<4>("orientation", field)));
            return blocks;
        }
        let frames: Vec<_> = frames.iter().map(|pose| MovingPose::at_rest(*pose)).collect();
        let block = match &self.policy {
            SkillPolicy::Plane(skill) => product_block("position", skill, &frames, goal),
            SkillPolicy::Space(skill) => product_block("position", skill, &frames, goal),
            SkillPolicy::Pose(skill) => product_block("pose", skill, &frames, goal),
            SkillPolicy::Canonical(_) => None,
        };
        block.into_iter().collect()
    }
}

fn field_block<const N: usize>(name: &str, model: &FieldModel) -> BlockCertificate {
    let field = model.field::<N>();
    let metrics = field.components().iter().map(|component| component.metric);
    let certificate = block(name, metrics, &field.goal(), |z| {
        let value = field.evaluate(z, &SVector::zeros());
        (value.gradient, value.metric)
    });
    let (descent_min, _) = valley::descent(&field, 1.0);
    // xᵀ(Σw S)x ≥ h xᵀ(Σw M)x when that holds for each component: so it does at every phase.
    let stiffness = field.components().iter().map(stiffness_min);
    let valley = ValleyCertificate {
        phases: valley::PHASES,
        stiffness_min_1_s2: stiffness.fold(f64::INFINITY, f64::min),
        descent_min,
    };
    BlockCertificate { valley: Some(valley), ..certificate }
}

/// Smallest eigenvalue of S_yy relative to M_yy.
fn stiffness_min<const N: usize>(component: &Component<N>) -> f64 {
    let part = |matrix: &SMatrix<f64, N, N>| DMatrix::from_fn(N - 1, N - 1, |i, j| matrix[(i, j)]);
    let Some(factor) = part(&component.metric).cholesky() else { return f64::NEG_INFINITY };
    let inverse = factor.l().try_inverse().expect("its factor has a positive diagonal");
    let relative = &inverse * part(&component.hessian) * inverse.transpose();
    relative.symmetric_eigenvalues().min()
}

/// `None` when there is no product of the Gaussians.
fn product_block<const D: usize>(
    name: &str,
    skill: &ThesisPolicy<D>,
    frames: &[MovingPose],
    goal: &Pose,
) -> Option<BlockCertificate> {
    let mut state = ThesisState::default();
    skill.update(frames, &mut state);
    let field = state.field()?;
    let goal = state.point(goal);
    let metrics = field.components().map(|(_, precision)| precision * skill.metric_scale());
    Some(block(name, metrics, &goal, |y| {
        let value = field.evaluate(y, &SVector::zeros());
        (value.gradient, value.metric)
    }))
}

/// The metric is a mean of the components': its eigenvalues lie between the least and the largest
/// of theirs, everywhere.
fn block<const D: usize>(
    name: &str,
    metrics: impl Iterator<Item = SMatrix<f64, D, D>>,
    goal: &SVector<f64, D>,
    evaluate: impl Fn(&SVector<f64, D>) -> (SVector<f64, D>, SMatrix<f64, D, D>),
) -> BlockCertificate {
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for metric in metrics {
        let metric = DMatrix::from_fn(D, D, |i, j| metric[(i, j)]);
        let eigenvalues = metric.symmetric_eigenvalues();
        least = least.min(eigenvalues.min());
        most = most.max(eigenvalues.max());
    }
    let (goal_gradient, goal_hessian_min_1_s2) = at_rest(goal, GOAL_STEP, evaluate);
    BlockCertificate {
        name: name.into(),
        metric_eigenvalue_min: least,
        metric_eigenvalue_max: most,
        goal_gradient,
        goal_hessian_min_1_s2,
        valley: None,
    }
}
