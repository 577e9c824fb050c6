//! What can be said of a policy without rolling it out: of its metric, its valley and its goal.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use tprmp_rmpflow::policy::SkillPolicy;
use tprmp_rmpflow::policy::canonical::field::{Component, Field};
use tprmp_rmpflow::policy::canonical::policy::PositionField;
use tprmp_rmpflow::policy::thesis::{ThesisPolicy, ThesisState};
use tprmp_spatial::{MovingPose, Pose};

use crate::skill_model::certificate::{BlockCertificate, ValleyCertificate};
use crate::skill_model::{descent, valley};

/// Step of the central differences at the goal [m or rad].
const GOAL_STEP: f64 = 1e-5;

/// What can be said of each block of a policy, with these frames and this goal.
#[must_use]
pub fn blocks(policy: &SkillPolicy, frames: &[MovingPose], goal: &Pose) -> Vec<BlockCertificate> {
    let product = match policy {
        SkillPolicy::Canonical(skill) => {
            let goes_round = skill.cycle.is_some();
            let mut blocks = vec![match &skill.position {
                PositionField::Plane(field) => field_block("position", field, goes_round),
                PositionField::Space(field) => field_block("position", field, goes_round),
            }];
            let rotation = skill.orientation.iter();
            blocks.extend(rotation.map(|field| field_block("orientation", field, goes_round)));
            return blocks;
        }
        SkillPolicy::Plane(skill) => product_block("position", skill, frames, goal),
        SkillPolicy::Space(skill) => product_block("position", skill, frames, goal),
        SkillPolicy::Pose(skill) => product_block("pose", skill, frames, goal),
    };
    product.into_iter().collect()
}

/// What goes round has no goal: of its block, the metric and the valley are examined.
fn field_block<const N: usize>(name: &str, field: &Field<N>, goes_round: bool) -> BlockCertificate {
    let metrics = field.components().iter().map(|component| component.metric);
    let certificate = block(name, metrics, &field.goal(), |z| {
        let value = field.evaluate(z, &SVector::zeros());
        (value.gradient, value.metric)
    });
    let ((descent_min, _), proof) = if goes_round {
        (valley::round_descent(field, 1.0), descent::prove_round(field))
    } else {
        (valley::descent(field, 1.0), descent::prove(field))
    };
    // xᵀ(Σw S)x ≥ h xᵀ(Σw M)x when that holds for each component: so it does at every phase.
    let stiffness = field.components().iter().map(stiffness_min);
    let valley = ValleyCertificate {
        phases: valley::PHASES,
        stiffness_min_1_s2: stiffness.fold(f64::INFINITY, f64::min),
        descent_min,
        intervals: proof.unwrap_or(0),
        unproved: proof.err(),
    };
    let valley = Some(valley);
    if goes_round {
        let none =
            BlockCertificate { goal_gradient: 0.0, goal_hessian_min_1_s2: 0.0, ..certificate };
        return BlockCertificate { valley, ..none };
    }
    BlockCertificate { valley, ..certificate }
}

/// Smallest eigenvalue of S_yy relative to M_yy.
fn stiffness_min<const N: usize>(component: &Component<N>) -> f64 {
    let part = |matrix: &SMatrix<f64, N, N>| DMatrix::from_fn(N - 1, N - 1, |i, j| matrix[(i, j)]);
    let Some(factor) = part(&component.metric).cholesky() else { return f64::NEG_INFINITY };
    let Some(inverse) = factor.l().try_inverse() else { return f64::NEG_INFINITY };
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

/// Smallest eigenvalue of a Hessian relative to a metric, and |M⁻¹∇Φ|, at a point. The Hessian is
/// the derivative of the gradient, by central differences.
fn at_rest<const D: usize>(
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
    let factor = metric.cholesky();
    let inverse = factor.as_ref().and_then(|factor| factor.l().try_inverse());
    let (Some(factor), Some(inverse)) = (factor, inverse) else {
        return (f64::INFINITY, f64::NEG_INFINITY);
    };
    let relative = &inverse * hessian * inverse.transpose();
    (factor.solve(&gradient).norm(), relative.symmetric_eigenvalues().min())
}
