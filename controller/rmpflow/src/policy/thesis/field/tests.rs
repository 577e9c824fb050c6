//! The equations of the field, against differences and against the densities.

use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

use crate::policy::thesis::tests::{
    COMPONENTS, THRESHOLD, components, field, frames, point, policy_of, state,
};

/// Fourth-order central differences.
fn slope(f: impl Fn(f64) -> f64) -> f64 {
    let h = 1e-4;
    (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
}

fn derivative(f: impl Fn(Vector3<f64>) -> f64, y: &Vector3<f64>) -> Vector3<f64> {
    Vector3::from_fn(|i, _| slope(|s| f(y + Vector3::ith(i, s))))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn the_gradient_is_the_derivative_of_the_potential((y, _) in point()) {
        let (field, v) = (field(), Vector3::zeros());
        // A kink in φ_k″ within their reach would disturb the differences.
        let near_a_kink = |(mean, precision): (Vector3<f64>, Matrix3<f64>)| {
            ((y - mean).dot(&(precision * (y - mean))).sqrt() - THRESHOLD).abs() < 5e-3
        };
        prop_assume!(!field.components().any(near_a_kink));
        let expected = derivative(|y| field.evaluate(&y, &v).potential, &y);
        let error = field.evaluate(&y, &v).gradient - expected;
        prop_assert!(error.norm() < 1e-6 * (1.0 + expected.norm()));
    }

    /// ξ = Ṁẏ − ½ ∂/∂y (ẏᵀMẏ), so that V̇ = ∇Φ·ẏ + ẏᵀMÿ + ½ ẏᵀṀẏ = −ẏᵀBẏ.
    #[test]
    fn the_curvature_is_that_of_the_metric_and_energy_falls_by_the_damping_alone(
        (y, v) in point(),
    ) {
        let field = field();
        let momentum = |y: Vector3<f64>| field.evaluate(&y, &v).metric * v;
        let rate = Vector3::from_fn(|i, _| slope(|s| momentum(y + v * s)[i]));
        let expected = rate - derivative(|y| v.dot(&momentum(y)), &y) * 0.5;
        let value = field.evaluate(&y, &v);
        prop_assert!((value.curvature - expected).norm() < 1e-6 * (1.0 + expected.norm()));
        let work = 0.5 * rate.dot(&v);
        prop_assert!((value.curvature.dot(&v) - work).abs() < 1e-6 * (1.0 + work.abs()));
        let acceleration = value.metric.cholesky().unwrap().solve(&value.force(&v));
        let energy_rate = value.gradient.dot(&v) + v.dot(&(value.metric * acceleration)) + work;
        let dissipated = v.dot(&(value.damping * v));
        prop_assert!(dissipated >= 0.0);
        prop_assert!((energy_rate + dissipated).abs() < 1e-6 * (1.0 + dissipated + work.abs()));
    }

    #[test]
    fn weights_are_the_normalised_densities_and_sum_to_one_however_far_away(
        (y, v) in point(), distance in 1.0..1e3,
    ) {
        let field = field();
        let density = |(mean, precision): (Vector3<f64>, Matrix3<f64>)| {
            precision.determinant().sqrt() * (-0.5 * (y - mean).dot(&(precision * (y - mean)))).exp()
        };
        let sum: f64 = field.components().map(density).sum();
        for (component, term) in field.components().zip(field.terms(&y)) {
            prop_assert!(sum < 1e-200 || (term.weight - density(component) / sum).abs() < 1e-12);
        }
        let (weights, value) = (field.terms(&(y * distance)), field.evaluate(&(y * distance), &v));
        prop_assert!((weights.iter().map(|t| t.weight).sum::<f64>() - 1.0).abs() < 1e-14);
        prop_assert!(weights.iter().all(|t| (0.0..=1.0).contains(&t.weight)));
        prop_assert!(value.metric.cholesky().is_some());
        prop_assert!(value.force(&v).iter().all(|f| f.is_finite()));
    }

    #[test]
    fn the_terms_are_the_parts_of_potential_gradient_and_damping((y, v) in point()) {
        let (field, value) = (field(), field().evaluate(&y, &v));
        let (mut potential, mut gradient, mut damping) = (0.0, Vector3::zeros(), 0.0);
        for (component, term) in components::<3>(COMPONENTS).iter().zip(field.terms(&y)) {
            potential += term.weight * term.potential;
            gradient += term.attraction + term.weight_gradient * term.potential;
            damping += term.weight * component.damping;
        }
        let scale = 1.0 + gradient.norm();
        prop_assert!((value.potential - potential).abs() < 1e-11 * scale);
        prop_assert!((value.gradient - gradient).norm() < 1e-11 * scale);
        prop_assert!((value.damping[(1, 1)] - damping).abs() < 1e-12 * damping);
    }
}

#[test]
fn the_local_potential_is_smooth_at_the_threshold_and_pulls_evenly_far_away() {
    let alone = policy_of(vec![components(COMPONENTS)[0].clone()]);
    let state = state(&alone, &frames());
    let field = state.field().unwrap();
    let (mean, precision) = field.components().next().unwrap();
    let along = Vector3::new(0.6, 0.0, -0.8);
    let unit = along / along.dot(&(precision * along)).sqrt();
    let at = |norm: f64| field.terms(&(mean + unit * norm))[0];
    let (below, above) = (at(THRESHOLD * (1.0 - 1e-9)), at(THRESHOLD * (1.0 + 1e-9)));
    assert!((below.potential - above.potential).abs() < 1e-8);
    assert!((below.attraction - above.attraction).norm() < 1e-6);
    // |∇φ| = δ in the metric of Λ.
    assert!((at(50.0).attraction.dot(&unit) - THRESHOLD).abs() < 1e-12);
}
