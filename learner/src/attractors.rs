//! Looks for points other than the goal at which a field comes to rest.

use nalgebra::SVector;
use rayon::prelude::*;
use tprmp_rmpflow::field::Field;

/// Step of the flow [s].
const STEP_S: f64 = 0.02;
/// Bound on the steps of one rollout: 20 s.
const STEPS_MAX: u32 = 1000;
/// Nearer to the goal than this [ŷ], and slower [ŷ/s], the goal is reached: its Hessian is checked
/// on its own.
const REACHED: f64 = 0.03;
/// Slower than this the policy is at rest [ŷ/s].
const REST_SPEED: f64 = 1e-4;
/// Ends nearer to each other than this are the same [ŷ].
const SAME: f64 = 0.05;

/// Follows the policy from rest at each start, and returns where it is at the end when that is not
/// the goal, each place once: an attractor, or a plateau on which it hardly moves.
///
/// The semi-implicit Euler rule is stable while M⁻¹H stays below 10⁴/s².
#[must_use]
pub fn stray_attractors<const D: usize>(
    field: &Field<D>,
    starts: &[SVector<f64, D>],
) -> Vec<SVector<f64, D>> {
    let ends: Vec<_> = starts.par_iter().filter_map(|start| stray_end(field, *start)).collect();
    let mut found: Vec<SVector<f64, D>> = Vec::new();
    for y in ends {
        if found.iter().all(|other| (other - y).norm() > SAME) {
            found.push(y);
        }
    }
    found
}

/// Where the policy is at the end, when that is not the goal.
fn stray_end<const D: usize>(field: &Field<D>, start: SVector<f64, D>) -> Option<SVector<f64, D>> {
    let goal = field.goal();
    let mut y = start;
    let mut velocity = SVector::<f64, D>::zeros();
    for _ in 0..STEPS_MAX {
        if (y - goal).norm() < REACHED && velocity.norm() < REACHED {
            return None;
        }
        let value = field.evaluate(&y, &velocity);
        let Some(factor) = value.metric.cholesky() else { break };
        let acceleration = factor.solve(&value.force(&velocity));
        let rests =
            velocity.norm() < REST_SPEED && acceleration.norm() < REST_SPEED * field.damping_1_s();
        if rests {
            break;
        }
        velocity += acceleration * STEP_S;
        y += velocity * STEP_S;
    }
    Some(y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};
    use tprmp_rmpflow::field::{Background, Component};

    /// Two wells, the second one the goal's.
    fn wells(depth: f64) -> Field<2> {
        let component = |x: f64, potential: f64| Component {
            mean: Vector2::new(x, 0.0),
            precision: Matrix2::identity() * 10.0,
            metric: Matrix2::identity(),
            potential,
            gradient: Vector2::zeros(),
            hessian: Matrix2::identity() * 2.0,
        };
        let background =
            Background { exponent: -8.0, metric: 1.0, offset: 3.0, slope: 9.0, softening: 0.3 };
        Field::new(&[component(-1.5, depth), component(0.0, 0.0)], background, 8.0).unwrap()
    }

    #[test]
    fn a_second_well_is_found_once_and_one_well_is_none() {
        let starts: Vec<_> =
            (0..40).map(|i| Vector2::new(-2.0 + 0.1 * f64::from(i), 0.3)).collect();
        let found = stray_attractors(&wells(1.0), &starts);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0] - Vector2::new(-1.5, 0.0)).norm() < 0.2);
        let near: Vec<_> = starts.into_iter().filter(|y| y[0] > -0.4).collect();
        let one = stray_attractors(&wells(1.0), &near);
        assert!(one.is_empty(), "{one:?}");
    }
}
