//! Rollouts of a learned policy in the world, on a free body that obeys it.

use nalgebra::{Cholesky, DMatrix, DVector, SMatrix, SVector, Vector6};
use tprmp_model::skill_model::Manifold;
use tprmp_rmpflow::policy::SkillValue;
use tprmp_spatial::{Pose, SpatialAcceleration, Twist};

use crate::certify::policy::Situation;

/// Where and how long a body follows a policy.
#[derive(Clone, Copy, Debug)]
pub struct Course {
    /// Where it starts, at rest.
    pub start: Pose,
    /// Where it should end.
    pub goal: Pose,
    /// Step [s].
    pub step_s: f64,
    /// Steps.
    pub steps: usize,
    /// It stops early within so many metres and radians of the goal, and as slow a second.
    pub arrived: Option<[f64; 2]>,
}

/// How a rollout went.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Where it ended.
    pub end: Pose,
    /// Final distance to the goal [m].
    pub goal_error_m: f64,
    /// Final angle to the goal [rad]; zero when orientation is free.
    pub goal_error_rad: f64,
    /// V at the start above that at the goal.
    pub energy_at_start: f64,
    /// Largest rise of V in a step.
    pub energy_rise_max: f64,
}

/// Follows a policy from rest by the semi-implicit Euler rule; `each` is told every pose, the
/// first one included. A policy that cannot be resolved, or diverges, ends the rollout where it is.
pub fn follow(
    situation: &mut Situation,
    manifold: Manifold,
    course: &Course,
    mut each: impl FnMut(&Pose),
) -> Outcome {
    let Course { start, goal, step_s, steps, arrived } = *course;
    let turns = manifold.has_orientation();
    let at_goal = situation.energy_at(&goal);
    let (mut pose, mut velocity) = (start, Twist::ZERO);
    let mut value = situation.evaluate(&pose, &velocity);
    let energy_at_start = value.energy - at_goal;
    let mut energy_rise_max: f64 = 0.0;
    each(&pose);
    for _ in 0..steps {
        let Some(acceleration) = acceleration(&value, manifold) else { break };
        velocity = velocity.advanced(&acceleration, step_s);
        let next = pose.advanced(&velocity, step_s);
        if !next.is_finite() {
            break;
        }
        let before = value;
        situation.advance(&value, &acceleration, step_s);
        pose = next;
        value = situation.evaluate(&pose, &velocity);
        energy_rise_max = energy_rise_max.max(value.energy - before.energy);
        each(&pose);
        let near = |[metres, radians]: [f64; 2]| {
            let far = (pose.position - goal.position).length();
            let turned = if turns { pose.rotation_from(&goal).length() } else { 0.0 };
            far < metres
                && velocity.linear.length() < metres
                && turned < radians
                && velocity.angular.length() < radians
        };
        if arrived.is_some_and(near) {
            break;
        }
    }
    Outcome {
        end: pose,
        goal_error_m: (pose.position - goal.position).length(),
        goal_error_rad: if turns { pose.rotation_from(&goal).length() } else { 0.0 },
        energy_at_start,
        energy_rise_max,
    }
}

/// Acceleration; `None` when the metric is not positive definite or a number not
/// finite. What the manifold does not span does not move.
pub fn acceleration(value: &SkillValue, manifold: Manifold) -> Option<SpatialAcceleration> {
    let natural = &value.natural;
    let mut a = [0.0; 6];
    match manifold {
        Manifold::R2 => {
            let factor = Cholesky::new(natural.metric.fixed_view::<2, 2>(0, 0).into_owned())?;
            let solved = factor.solve(&natural.force.fixed_rows::<2>(0).into_owned());
            a[..2].copy_from_slice(solved.as_slice());
        }
        Manifold::R3 => {
            let factor = Cholesky::new(natural.metric.fixed_view::<3, 3>(0, 0).into_owned())?;
            let solved = factor.solve(&natural.force.fixed_rows::<3>(0).into_owned());
            a[..3].copy_from_slice(solved.as_slice());
        }
        Manifold::R3S3 => a.copy_from_slice(natural.resolve().ok()?.as_slice()),
    }
    Some(SpatialAcceleration::from(Vector6::from(a))).filter(SpatialAcceleration::is_finite)
}

/// Smallest eigenvalue of a Hessian relative to a metric, and |M⁻¹∇Φ|, at a point. The Hessian is
/// the derivative of the gradient, by central differences.
#[must_use]
pub fn at_rest<const D: usize>(
    point: &SVector<f64, D>,
    step: f64,
    evaluate: impl Fn(&SVector<f64, D>) -> (SVector<f64, D>, SMatrix<f64, D, D>),
) -> (f64, f64) {
    let (gradient, metric) = evaluate(point);
    let mut hessian = DMatrix::zeros(D, D);
    for i in 0..D {
        let mut beside = [*point, *point];
        beside[0][i] += step;
        beside[1][i] -= step;
        let [plus, minus] = beside.map(|y| evaluate(&y).0);
        let column = (plus - minus) / (2.0 * step);
        hessian.set_column(i, &DVector::from_column_slice(column.as_slice()));
    }
    let hessian = (&hessian + hessian.transpose()) * 0.5;
    let metric = DMatrix::from_fn(D, D, |i, j| metric[(i, j)]);
    let gradient = DVector::from_column_slice(gradient.as_slice());
    let Some(factor) = metric.cholesky() else { return (f64::INFINITY, f64::NEG_INFINITY) };
    let inverse = factor.l().try_inverse().expect("its factor has a positive diagonal");
    let relative = &inverse * hessian * inverse.transpose();
    (factor.solve(&gradient).norm(), relative.symmetric_eigenvalues().min())
}
