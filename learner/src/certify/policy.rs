//! What a rollout follows: a policy, learned or not, that says how a free body shall move.

use tprmp_model::skill_model::{EvaluationError, SkillModel};
use tprmp_rmpflow::natural::Natural;
use tprmp_rmpflow::policy::{
    Phase, PolicyState, SkillInertia, SkillPolicy, SkillValue, SpeedGovernor,
};
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

/// A free body.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Time since the start \[s\].
    pub time_s: f64,
    /// Its pose.
    pub pose: Pose,
    /// Its velocity [m/s, rad/s].
    pub velocity: Twist,
}

impl Body {
    /// At rest, at the start.
    #[must_use]
    pub fn at_rest(pose: Pose) -> Self {
        Self { time_s: 0.0, pose, velocity: Twist::ZERO }
    }
}

/// How a policy wants a body to move.
#[derive(Clone, Copy, Debug)]
pub struct DesiredMotion {
    /// M a = f on \[linear; angular\].
    pub natural: Natural<6>,
    /// V \[J\], not a number for policies without one.
    pub energy: f64,
}

/// A policy that a body can follow.
pub trait MotionPolicy {
    /// How the body shall move; calling it twice gives the same.
    ///
    /// * `frames`  of the skill, in its order
    fn evaluate(&mut self, frames: &[MovingPose], body: &Body) -> DesiredMotion;

    /// Goes on for a step with the acceleration that the body really gets.
    fn advance(&mut self, _acceleration: &SpatialAcceleration, _step_s: f64) {}

    /// Takes the fraction of the desired velocity that leads into an obstacle, 0 to 1.
    fn set_obstructed(&mut self, _fraction: f64) {}

    /// Where it rests with these frames; `None` when it has no goal of its own.
    fn goal(&mut self, _frames: &[MovingPose]) -> Option<Pose> {
        None
    }
}

/// Inertia of a body whose accelerations alone matter: they do not depend on it.
const UNIT_INERTIA: SkillInertia = SkillInertia { linear_kg: 1.0, angular_kg_m2: 1.0 };

/// A learned policy in the form in which it is evaluated: immutable.
#[derive(Debug)]
pub struct LearnedPolicy {
    policy: SkillPolicy,
    /// Its inertia at the goal.
    inertia: SkillInertia,
    /// Keeps it within a speed.
    governor: Option<SpeedGovernor>,
}

impl LearnedPolicy {
    /// The policy of a model, with an inertia of 1 at its goal and without a governor.
    ///
    /// # Errors
    /// When it cannot be evaluated.
    pub fn new(model: &SkillModel) -> Result<Self, EvaluationError> {
        Self::with(model, UNIT_INERTIA, None)
    }

    /// The policy of a model, with this inertia at its goal, within the speeds of a governor.
    ///
    /// # Errors
    /// When it cannot be evaluated.
    pub fn with(
        model: &SkillModel,
        inertia: SkillInertia,
        governor: Option<SpeedGovernor>,
    ) -> Result<Self, EvaluationError> {
        Ok(Self { policy: model.policy()?, inertia, governor })
    }

    /// The policy itself.
    #[must_use]
    pub fn policy(&self) -> &SkillPolicy {
        &self.policy
    }

    /// By how much V falls in a round; 0 for a skill that does not go round.
    #[must_use]
    pub fn fall_per_round(&self) -> f64 {
        match &self.policy {
            SkillPolicy::Canonical(skill) => skill.fall_per_round(&self.inertia),
            _ => 0.0,
        }
    }

    /// An instance before its start.
    #[must_use]
    pub fn instance(&self) -> PolicyInstance<'_> {
        PolicyInstance { learned: self, state: PolicyState::default(), value: None }
    }
}

/// A learned policy in use.
#[derive(Debug)]
pub struct PolicyInstance<'a> {
    learned: &'a LearnedPolicy,
    state: PolicyState,
    /// Of the last evaluation.
    value: Option<SkillValue>,
}

impl PolicyInstance<'_> {
    /// Forgets its phase: the next evaluation finds the one that suits the body.
    pub fn restart(&mut self) {
        self.state.restart();
    }

    /// Rounds and phase of a canonical policy, once it was evaluated.
    #[must_use]
    pub fn progress(&self) -> Option<f64> {
        Some(self.state.rounds() + self.state.phase()?.value)
    }

    /// V of the policy at rest at the goal \[J\]; it starts anew afterwards.
    pub fn energy_at(&mut self, frames: &[MovingPose], goal: &Pose) -> f64 {
        self.state.resume(Phase { value: 1.0, rate_1_s: 0.0 });
        let energy = self.evaluate(frames, &Body::at_rest(*goal)).energy;
        self.restart();
        energy
    }
}

impl MotionPolicy for PolicyInstance<'_> {
    fn evaluate(&mut self, frames: &[MovingPose], body: &Body) -> DesiredMotion {
        let LearnedPolicy { policy, inertia, governor } = self.learned;
        let state = &mut self.state;
        let mut value = policy.evaluate(inertia, frames, &body.pose, &body.velocity, state);
        if let Some(governor) = governor {
            value.natural = governor.govern(&value.natural, &body.velocity, state.acts_alone());
        }
        self.value = Some(value);
        DesiredMotion { natural: value.natural, energy: value.energy }
    }

    fn advance(&mut self, acceleration: &SpatialAcceleration, step_s: f64) {
        if let Some(value) = self.value.take() {
            self.state.advance(&value, acceleration, step_s);
        }
    }

    fn set_obstructed(&mut self, fraction: f64) {
        self.state.set_obstructed(fraction);
    }

    fn goal(&mut self, frames: &[MovingPose]) -> Option<Pose> {
        Some(self.learned.policy.goal(frames, &mut self.state))
    }
}
