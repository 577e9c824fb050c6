//! Rollouts: a free body that obeys a policy, by the semi-implicit Euler rule.

use std::ops::ControlFlow::{self, Break, Continue};

use nalgebra::{Cholesky, Const, SMatrix, SVector, Vector6};
use tprmp_model::skill_model::Manifold;
use tprmp_rmpflow::natural::Natural;
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration};

use crate::certify::policy::{Body, DesiredMotion, MotionPolicy, PolicyInstance};

/// Where a body starts, and how long it follows a policy at most.
#[derive(Clone, Copy, Debug)]
pub struct RolloutSpec {
    /// Space in which it moves.
    pub manifold: Manifold,
    /// The body at the start.
    pub start: Body,
    /// Step \[s\].
    pub step_s: f64,
    /// Steps at most.
    pub steps: usize,
}

/// What surrounds the body and watches it.
pub trait Environment<P: ?Sized> {
    /// Frames of the skill, in its order.
    fn frames(&self) -> &[MovingPose];

    /// Before each evaluation, that after the last step included; breaking ends the rollout.
    fn observe(&mut self, body: &Body, policy: &mut P) -> ControlFlow<()>;

    /// After each evaluation: it may add forces; breaking ends the rollout.
    fn act(&mut self, body: &Body, desired: &mut DesiredMotion, policy: &mut P) -> ControlFlow<()>;

    /// The body's acceleration M⁻¹ f; `None` ends the rollout.
    fn resolve(&self, natural: &Natural<6>, manifold: Manifold) -> Option<SpatialAcceleration> {
        resolve(natural, manifold)
    }
}

/// How a rollout ended.
#[derive(Clone, Copy, Debug)]
pub struct RolloutEnd {
    /// The body, at the end.
    pub body: Body,
    /// Its largest acceleration [m/s²].
    pub acceleration_max_m_s2: f64,
    /// Whether it ended by the environment or after all steps. Otherwise the desired motion had no
    /// solution, or the body is no longer anywhere.
    pub completed: bool,
}

/// Lets a body follow a policy through an environment.
pub fn roll_out<P, E>(policy: &mut P, environment: &mut E, spec: &RolloutSpec) -> RolloutEnd
where
    P: MotionPolicy + ?Sized,
    E: Environment<P>,
{
    let mut body = spec.start;
    let mut end = RolloutEnd { body, acceleration_max_m_s2: 0.0, completed: true };
    for step in 0..=spec.steps {
        body.time_s = step as f64 * spec.step_s;
        end.body = body;
        if environment.observe(&body, policy).is_break() {
            return end;
        }
        let mut desired = policy.evaluate(environment.frames(), &body);
        if environment.act(&body, &mut desired, policy).is_break() || step == spec.steps {
            return end;
        }
        end.completed = false;
        let acceleration = environment.resolve(&desired.natural, spec.manifold);
        let Some(acceleration) = acceleration else { return end };
        end.acceleration_max_m_s2 = end.acceleration_max_m_s2.max(acceleration.linear.length());
        body.velocity = body.velocity.advanced(&acceleration, spec.step_s);
        body.pose = body.pose.advanced(&body.velocity, spec.step_s);
        if !body.pose.is_finite() {
            end.body = body;
            return end;
        }
        end.completed = true;
        policy.advance(&acceleration, spec.step_s);
    }
    end
}

/// The acceleration M⁻¹ f in the directions in which the manifold moves; `None` when M is not
/// positive definite there or a number not finite.
#[must_use]
pub fn resolve(natural: &Natural<6>, manifold: Manifold) -> Option<SpatialAcceleration> {
    match manifold {
        Manifold::R2 => resolve_first::<2>(natural),
        Manifold::R3 => resolve_first::<3>(natural),
        // The tool keeps its tilt: it is turned about z alone.
        Manifold::R3S1 => resolve_in::<4>(natural, manifold.moved()),
        Manifold::S3 => resolve_in::<3>(natural, manifold.moved()),
        Manifold::R3S3 => natural.resolve().ok().map(Into::into),
    }
}

/// The same in the first N directions, by Cholesky's decomposition.
#[must_use]
pub fn resolve_first<const N: usize>(natural: &Natural<6>) -> Option<SpatialAcceleration> {
    let metric = natural.metric.fixed_view::<N, N>(0, 0).into_owned();
    let factor: Cholesky<f64, Const<N>> = Cholesky::new(metric)?;
    let mut acceleration = Vector6::zeros();
    let solved = factor.solve(&natural.force.fixed_rows::<N>(0));
    acceleration.fixed_rows_mut::<N>(0).copy_from(&solved);
    Some(acceleration.into()).filter(SpatialAcceleration::is_finite)
}

/// The same in these N directions.
fn resolve_in<const N: usize>(
    natural: &Natural<6>,
    directions: &[usize],
) -> Option<SpatialAcceleration> {
    let at = |i: usize| directions[i];
    let metric = SMatrix::<f64, N, N>::from_fn(|i, j| natural.metric[(at(i), at(j))]);
    let force = SVector::<f64, N>::from_fn(|i, _| natural.force[at(i)]);
    let solved = Cholesky::new(metric)?.solve(&force);
    let mut acceleration = Vector6::zeros();
    for (direction, value) in directions.iter().zip(solved.iter()) {
        acceleration[*direction] = *value;
    }
    Some(acceleration.into()).filter(SpatialAcceleration::is_finite)
}

/// Where a rollout shall end.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// The goal.
    pub goal: Pose,
    /// It ends early within so many metres and radians of the goal, and as slow a second.
    pub arrived: Option<[f64; 2]>,
}

/// How near to its goal a rollout came, and how V went.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Final distance to the goal \[m\].
    pub goal_error_m: f64,
    /// Final angle to the goal \[rad\]; zero when orientation is free.
    pub goal_error_rad: f64,
    /// Speed at the end [m/s].
    pub speed_m_s: f64,
    /// V at the start above that at the goal.
    pub energy_at_start: f64,
    /// Largest rise of V in a step.
    pub energy_rise_max: f64,
}

/// Frames at rest, and a watch on the way to the goal.
struct Still<'a, F> {
    frames: &'a [MovingPose],
    target: &'a Target,
    has_orientation: bool,
    each: F,
    energy_at_goal: f64,
    /// V of the last evaluation.
    energy: Option<f64>,
    outcome: Outcome,
}

impl<P: ?Sized, F: FnMut(&Pose)> Environment<P> for Still<'_, F> {
    fn frames(&self) -> &[MovingPose] {
        self.frames
    }

    fn observe(&mut self, body: &Body, _policy: &mut P) -> ControlFlow<()> {
        (self.each)(&body.pose);
        let goal = &self.target.goal;
        self.outcome.goal_error_m = (body.pose.position - goal.position).length();
        self.outcome.speed_m_s = body.velocity.linear.length();
        if self.has_orientation {
            self.outcome.goal_error_rad = body.pose.rotation_from(goal).length();
        }
        Continue(())
    }

    fn act(&mut self, body: &Body, desired: &mut DesiredMotion, _: &mut P) -> ControlFlow<()> {
        let Some(before) = self.energy.replace(desired.energy) else {
            self.outcome.energy_at_start = desired.energy - self.energy_at_goal;
            return Continue(());
        };
        let outcome = &mut self.outcome;
        outcome.energy_rise_max = outcome.energy_rise_max.max(desired.energy - before);
        let arrived = self.target.arrived.is_some_and(|[metres, radians]| {
            outcome.goal_error_m < metres
                && body.velocity.linear.length() < metres
                && outcome.goal_error_rad < radians
                && body.velocity.angular.length() < radians
        });
        if arrived { Break(()) } else { Continue(()) }
    }
}

/// Follows a learned policy among frames at rest; `each` gets every pose, the first one included. A
/// policy that cannot be resolved, or diverges, ends the rollout where it was last.
pub fn follow(
    policy: &mut PolicyInstance,
    frames: &[MovingPose],
    target: &Target,
    spec: &RolloutSpec,
    each: impl FnMut(&Pose),
) -> Outcome {
    let mut still = Still {
        frames,
        target,
        has_orientation: spec.manifold.has_orientation(),
        each,
        energy_at_goal: policy.energy_at(frames, &target.goal),
        energy: None,
        outcome: Outcome {
            goal_error_m: f64::INFINITY,
            goal_error_rad: 0.0,
            speed_m_s: 0.0,
            energy_at_start: f64::INFINITY,
            energy_rise_max: 0.0,
        },
    };
    roll_out(policy, &mut still, spec);
    still.outcome
}
