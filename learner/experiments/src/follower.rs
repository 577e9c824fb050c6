//! What all compared policies have in common: they say how they want to accelerate.

use glam::DVec3;
use nalgebra::DMatrix;
use tprmp_model::skill_model::{EvaluationError, PolicyModel, SkillModel};
use tprmp_rmpflow::natural::Natural;
use tprmp_rmpflow::policy::{PolicyState, SkillInertia, SkillPolicy, SkillValue, SpeedGovernor};
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

/// Inertia of a point that obeys a policy without an inertia of its own, the certified one's at the
/// goal included [kg]: about what γ = 0.25 gives a skill of 2.75 m, so that a force does to all what
/// it does to the thesis' policy.
pub const INERTIA_KG: f64 = 5.0;
/// The same of its turning [kg m²].
pub const INERTIA_KG_M2: f64 = 0.05;

/// Largest speed that the default policy, and what leads it around obstacles, asks for [m/s]: as in the
/// shipped planar controller. Far from its demonstrations a field asks for any.
pub const SPEED_MAX_M_S: f64 = 4.3;
/// The same of turning [rad/s].
const ANGULAR_SPEED_MAX_RAD_S: f64 = 10.0;

/// A body's state and the frames around it.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// Time since the start [s].
    pub time_s: f64,
    /// Frames of the skill, in its order.
    pub frames: &'a [MovingPose],
    /// Pose.
    pub pose: Pose,
    /// Its velocity.
    pub velocity: Twist,
}

/// What a policy wants.
#[derive(Clone, Copy, Debug)]
pub struct Wish {
    /// M a = f.
    pub natural: Natural<6>,
    /// V, for policies that have one [J].
    pub energy: f64,
}

/// A policy that a body follows.
pub trait Follower {
    /// What it wants now; calling it twice gives the same.
    fn evaluate(&mut self, now: &Moment) -> Wish;

    /// Told how the body really accelerates until the next evaluation.
    fn advance(&mut self, _wish: &Wish, _acceleration: &SpatialAcceleration, _step_s: f64) {}

    /// Told which fraction of the velocity that it wants leads into an obstacle.
    fn set_obstructed(&mut self, _fraction: f64) {}

    /// Where it rests with these frames; `None` when it knows of no goal of its own.
    fn goal(&mut self, _frames: &[MovingPose]) -> Option<Pose> {
        None
    }
}

/// A wish of a point mass.
#[must_use]
pub fn point_wish(acceleration: DVec3) -> Wish {
    let mut natural = Natural::zero();
    for i in 0..3 {
        natural.metric[(i, i)] = INERTIA_KG;
        natural.metric[(i + 3, i + 3)] = INERTIA_KG_M2;
        natural.force[i] = INERTIA_KG * acceleration[i];
    }
    Wish { natural, energy: f64::NAN }
}

/// A learned model as it is evaluated.
#[derive(Debug)]
pub struct Model {
    policy: SkillPolicy,
    inertia: SkillInertia,
    /// Of the default policy; the thesis' has none.
    governor: Option<SpeedGovernor>,
}

impl Model {
    /// Takes a model.
    ///
    /// # Errors
    /// When it cannot be evaluated.
    pub fn new(model: &SkillModel) -> Result<Self, EvaluationError> {
        let linear_kg = thesis_inertia_kg(model).unwrap_or(INERTIA_KG);
        let inertia = SkillInertia { linear_kg, angular_kg_m2: INERTIA_KG_M2 };
        let governor = match &model.policy {
            PolicyModel::Canonical { position, .. } => Some(SpeedGovernor {
                linear_max_m_s: SPEED_MAX_M_S,
                angular_max_rad_s: ANGULAR_SPEED_MAX_RAD_S,
                response_1_s: position.damping_1_s,
            }),
            PolicyModel::Thesis(_) => None,
        };
        Ok(Self { policy: model.policy()?, inertia, governor })
    }

    /// A follower at the start.
    #[must_use]
    pub fn follower(&self) -> Learned<'_> {
        Learned { model: self, state: PolicyState::default(), value: None }
    }
}

/// The thesis' policy has an inertia of its own, γ Σ Λ at the goal's component; the mean of its linear
/// eigenvalues [kg].
fn thesis_inertia_kg(model: &SkillModel) -> Option<f64> {
    let PolicyModel::Thesis(thesis) = &model.policy else { return None };
    let n = model.manifold.position_dimension();
    let mut trace = 0.0;
    for frame in &model.frames {
        let covariance = &frame.gaussians.last()?.covariance;
        let d = covariance.len();
        let precision = DMatrix::from_fn(d, d, |i, j| covariance[i][j]).try_inverse()?;
        trace += (0..n).map(|i| precision[(i, i)]).sum::<f64>();
    }
    Some(thesis.metric_scale * trace / n as f64)
}

/// A learned model on its way.
#[derive(Debug)]
pub struct Learned<'a> {
    model: &'a Model,
    state: PolicyState,
    /// Of the last evaluation.
    value: Option<SkillValue>,
}

impl Follower for Learned<'_> {
    fn evaluate(&mut self, now: &Moment) -> Wish {
        let Model { policy, inertia, governor } = self.model;
        let state = &mut self.state;
        let value = policy.evaluate(inertia, now.frames, &now.pose, &now.velocity, state);
        self.value = Some(value);
        let natural = governor.map_or(value.natural, |g| g.govern(&value.natural, &now.velocity));
        Wish { natural, energy: value.energy }
    }

    fn advance(&mut self, _wish: &Wish, acceleration: &SpatialAcceleration, step_s: f64) {
        if let Some(value) = self.value.take() {
            self.state.advance(&value, acceleration, step_s);
        }
    }

    fn set_obstructed(&mut self, fraction: f64) {
        self.state.set_obstructed(fraction);
    }

    fn goal(&mut self, frames: &[MovingPose]) -> Option<Pose> {
        Some(self.model.policy.goal(frames, &mut self.state))
    }
}
