//! The field of a mixture of Gaussians in one chart  [thesis section 4.2].
//!
//! With v_k = y − μ_k, the precisions Λ_k = Σ̂_k⁻¹ and n_k² = v_kᵀ Λ_k v_k,
//!
//! ```text
//! w̃_k = N(y|μ_k, Σ̂_k) / Σ_j N(y|μ_j, Σ̂_j)                    [thesis eq. 4.6]
//! ∇w̃_k = w̃_k (p̄ − Λ_k v_k)        p̄ = Σ_j w̃_j Λ_j v_j
//! φ_k = φ⁰_k + { ½ n_k²            for n_k ≤ δ
//!              { δ (n_k − ½ δ)     otherwise                   [thesis eq. 4.11]
//! Φ   = Σ w̃_k φ_k                                              [thesis eq. 4.10]
//! ∇Φ  = Σ w̃_k ∇φ_k + Σ ∇w̃_k φ_k                                [thesis eq. 4.12–4.14]
//! M   = γ Σ w̃_k Λ_k                                            [thesis eq. 4.5]
//! ξ   = Ṁẏ − ½ ∂/∂y (ẏᵀMẏ)                                     [thesis eq. 4.7–4.9]
//! B   = Σ w̃_k d_k I                                            [thesis eq. 4.17]
//! ```
//!
//! and the policy M ÿ = −∇Φ − ξ − B ẏ, along which V = Φ + ½ ẏᵀMẏ falls as V̇ = −ẏᵀBẏ. In the second
//! case ∇φ_k = δ Λ_k v_k / n_k: eq. 4.13 leaves out the factor δ, without which ∇Φ would not be the
//! derivative of Φ.
//!
//! n_k, Φ and δ carry no unit: Λ is in \[1/m²\] (or 1/rad², 1/(m rad) in mixed blocks), so γ is in \[s²\]
//! and d in \[s/m²\] when M is to be the inertia of Φ. Whoever adds the policy to others scales force
//! and metric by one factor \[J\], which leaves the acceleration as it is.

use nalgebra::{Cholesky, SMatrix, SVector};

use crate::field::{COMPONENT_CAPACITY, FieldValue};

/// One component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianComponent<const D: usize> {
    /// μ \[m or rad\].
    pub mean: SVector<f64, D>,
    /// Λ = Σ̂⁻¹, symmetric positive definite \[1/m² or 1/rad²\].
    pub precision: SMatrix<f64, D, D>,
    /// φ⁰, the bias potential.
    pub potential: f64,
    /// d ≥ 0 \[s/m² or s/rad²\].
    pub damping: f64,
}

/// Why a field could not be built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GaussianFieldError {
    /// There is no component, or there are more than [`COMPONENT_CAPACITY`].
    ComponentCount(usize),
    /// The precision of this component is not positive definite or not finite.
    Precision(usize),
}

/// An immutable field of dimension D; its last component is the goal's.
#[derive(Debug, Clone)]
pub struct GaussianField<const D: usize> {
    components: [GaussianComponent<D>; COMPONENT_CAPACITY],
    /// ½ ln det Λ_k.
    log_normalisers: [f64; COMPONENT_CAPACITY],
    count: usize,
    /// γ \[s²\].
    metric_scale: f64,
    /// δ.
    huber_threshold: f64,
}

/// The potential at a point as an affine function of the bias potentials:
/// Φ = Φ₀ + Σ_k w̃_k φ⁰_k and ∇Φ = ∇Φ₀ + Σ_k ∇w̃_k φ⁰_k.
///
/// The weights are those of the damping too: B = Σ_k w̃_k d_k I.
#[derive(Debug, Clone, Copy)]
pub struct AffinePotential<const D: usize> {
    /// Φ₀, the potential for φ⁰ = 0.
    pub potential: f64,
    /// ∇Φ₀, its gradient for φ⁰ = 0.
    pub gradient: SVector<f64, D>,
    /// w̃_k; zero beyond the last component.
    pub weights: [f64; COMPONENT_CAPACITY],
    /// ∇w̃_k; zero beyond the last component.
    pub weight_gradients: [SVector<f64, D>; COMPONENT_CAPACITY],
}

impl<const D: usize> GaussianField<D> {
    /// A field of these components, the last of which is the goal's.
    ///
    /// * `metric_scale`  γ > 0 \[s²\]
    /// * `huber_threshold`  δ > 0
    ///
    /// Hot path where frames move: no allocation, O(K D³).
    ///
    /// # Errors
    /// When there is no component, there are too many, or a precision is not positive definite.
    pub fn new(
        components: &[GaussianComponent<D>],
        metric_scale: f64,
        huber_threshold: f64,
    ) -> Result<Self, GaussianFieldError> {
        let count = components.len();
        let last = components.last().ok_or(GaussianFieldError::ComponentCount(0))?;
        if count > COMPONENT_CAPACITY {
            return Err(GaussianFieldError::ComponentCount(count));
        }
        let mut stored = [*last; COMPONENT_CAPACITY];
        stored[..count].copy_from_slice(components);
        let mut log_normalisers = [0.0; COMPONENT_CAPACITY];
        for (k, (component, log)) in components.iter().zip(&mut log_normalisers).enumerate() {
            let factor = Cholesky::new(component.precision);
            // ½ ln det Λ is the sum of the logarithms of the factor's diagonal.
            *log = factor
                .map(|f| f.l_dirty().diagonal().iter().map(|d| d.ln()).sum())
                .filter(|log: &f64| log.is_finite())
                .ok_or(GaussianFieldError::Precision(k))?;
        }
        Ok(Self { components: stored, log_normalisers, count, metric_scale, huber_threshold })
    }

    /// Its components, the last of which is the goal's.
    #[must_use]
    pub fn components(&self) -> &[GaussianComponent<D>] {
        &self.components[..self.count]
    }

    /// γ \[s²\].
    #[must_use]
    pub fn metric_scale(&self) -> f64 {
        self.metric_scale
    }

    /// w̃_k, the normalised densities at y; zero beyond the last component  [thesis eq. 4.6].
    ///
    /// Computed by their logarithms, so that they are right however far away y is.
    #[must_use]
    pub fn weights(&self, y: &SVector<f64, D>) -> [f64; COMPONENT_CAPACITY] {
        let mut weights = [0.0; COMPONENT_CAPACITY];
        let mut largest = f64::NEG_INFINITY;
        for (k, component) in self.components().iter().enumerate() {
            let offset = y - component.mean;
            weights[k] =
                self.log_normalisers[k] - 0.5 * offset.dot(&(component.precision * offset));
            largest = largest.max(weights[k]);
        }
        let mut sum = 0.0;
        for weight in &mut weights[..self.count] {
            *weight = (*weight - largest).exp();
            sum += *weight;
        }
        for weight in &mut weights[..self.count] {
            *weight /= sum;
        }
        weights
    }

    /// φ_k − φ⁰_k and the factor s of ∇φ_k = s Λ_k v_k, from n_k²  [thesis eq. 4.11, 4.13].
    fn huber(&self, squared: f64) -> (f64, f64) {
        let threshold = self.huber_threshold;
        if squared <= threshold * threshold {
            (0.5 * squared, 1.0)
        } else {
            let norm = squared.sqrt();
            (threshold * (norm - 0.5 * threshold), threshold / norm)
        }
    }

    /// Evaluates the field at y for the velocity ẏ.
    ///
    /// Hot path: no allocation, O(K D²). Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn evaluate(&self, y: &SVector<f64, D>, velocity: &SVector<f64, D>) -> FieldValue<D> {
        let mut mean_pull = SVector::<f64, D>::zeros();
        let mut potential = 0.0;
        let mut attraction = SVector::<f64, D>::zeros();
        let mut potential_pull = SVector::<f64, D>::zeros();
        let mut precision = SMatrix::<f64, D, D>::zeros();
        let mut momentum_rate = SVector::<f64, D>::zeros();
        let mut kinetic_pull = SVector::<f64, D>::zeros();
        let mut damping = 0.0;
        for (component, weight) in self.components().iter().zip(self.weights(y)) {
            if weight == 0.0 {
                continue;
            }
            let offset = y - component.mean;
            let pull = component.precision * offset;
            let (local, slope) = self.huber(offset.dot(&pull));
            let local = component.potential + local;
            let momentum = component.precision * velocity;
            mean_pull += pull * weight;
            potential += weight * local;
            attraction += pull * (weight * slope);
            potential_pull += pull * (weight * local);
            precision += component.precision * weight;
            momentum_rate += momentum * (weight * pull.dot(velocity));
            kinetic_pull += pull * (weight * momentum.dot(velocity));
            damping += weight * component.damping;
        }
        let momentum = precision * velocity;
        let rate = momentum * mean_pull.dot(velocity) - momentum_rate;
        let kinetic = mean_pull * momentum.dot(velocity) - kinetic_pull;
        FieldValue {
            potential,
            gradient: attraction + mean_pull * potential - potential_pull,
            metric: precision * self.metric_scale,
            curvature: (rate - kinetic * 0.5) * self.metric_scale,
            damping: SMatrix::identity() * damping,
        }
    }

    /// The potential at y as an affine function of the bias potentials; those of the components do
    /// not enter.
    ///
    /// No allocation, O(K D²).
    #[must_use]
    pub fn affine_potential(&self, y: &SVector<f64, D>) -> AffinePotential<D> {
        let weights = self.weights(y);
        let mut weight_gradients = [SVector::<f64, D>::zeros(); COMPONENT_CAPACITY];
        let mut mean_pull = SVector::<f64, D>::zeros();
        for ((component, weight), pull) in
            self.components().iter().zip(weights).zip(&mut weight_gradients)
        {
            *pull = component.precision * (y - component.mean);
            mean_pull += *pull * weight;
        }
        let mut potential = 0.0;
        let mut gradient = SVector::<f64, D>::zeros();
        for ((component, weight), weight_gradient) in
            self.components().iter().zip(weights).zip(&mut weight_gradients)
        {
            let pull = *weight_gradient;
            let (local, slope) = self.huber(pull.dot(&(y - component.mean)));
            *weight_gradient = (mean_pull - pull) * weight;
            potential += weight * local;
            gradient += pull * (weight * slope) + *weight_gradient * local;
        }
        AffinePotential { potential, gradient, weights, weight_gradients }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;

    const THRESHOLD: f64 = 1.3;

    fn field() -> GaussianField<3> {
        let component = |i: usize| {
            let s = i as f64;
            let precision =
                Matrix3::new(6.0 + s, 0.5, 0.2 * s, 0.5, 4.0, -0.3, 0.2 * s, -0.3, 5.0 - 0.3 * s);
            GaussianComponent {
                mean: Vector3::new(0.4 * s, 0.3 * (s - 2.0).powi(2), 0.1 * s),
                precision: precision * (1.0 + s),
                potential: 3.0 * (4.0 - s),
                damping: 2.0 + s,
            }
        };
        GaussianField::new(&std::array::from_fn::<_, 5, _>(component), 0.25, THRESHOLD).unwrap()
    }

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        let component = -size..size;
        (component.clone(), component.clone(), component)
            .prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    /// Fourth-order central differences.
    fn slope(f: impl Fn(f64) -> f64) -> f64 {
        let h = 1e-4;
        (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
    }

    fn derivative(f: impl Fn(Vector3<f64>) -> f64, y: &Vector3<f64>) -> Vector3<f64> {
        Vector3::from_fn(|i, _| {
            let axis = Vector3::from_fn(|j, _| f64::from(u8::from(i == j)));
            slope(|s| f(y + axis * s))
        })
    }

    /// Whether n_k = δ within the reach of the differences, which a kink in φ_k″ would disturb.
    fn near_a_kink(field: &GaussianField<3>, y: &Vector3<f64>) -> bool {
        field.components().iter().any(|c| {
            let offset = y - c.mean;
            (offset.dot(&(c.precision * offset)).sqrt() - THRESHOLD).abs() < 5e-3
        })
    }

    fn acceleration(value: &FieldValue<3>, v: &Vector3<f64>) -> Vector3<f64> {
        value.metric.cholesky().unwrap().solve(&value.force(v))
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn gradient_is_the_derivative_of_the_potential(y in vector(2.0)) {
            let (field, v) = (field(), Vector3::zeros());
            prop_assume!(!near_a_kink(&field, &y));
            let found = field.evaluate(&y, &v).gradient;
            let expected = derivative(|y| field.evaluate(&y, &v).potential, &y);
            prop_assert!((found - expected).norm() < 1e-6 * (1.0 + expected.norm()));
        }

        #[test]
        fn curvature_is_that_of_the_metric(y in vector(2.0), v in vector(1.0)) {
            let field = field();
            let found = field.evaluate(&y, &v).curvature;
            let rate = Vector3::from_fn(|i, _| {
                slope(|s| (field.evaluate(&(y + v * s), &v).metric * v)[i])
            });
            let kinetic = derivative(|y| v.dot(&(field.evaluate(&y, &v).metric * v)), &y);
            let expected = rate - kinetic * 0.5;
            prop_assert!((found - expected).norm() < 1e-6 * (1.0 + expected.norm()));
        }

        /// V̇ = ∇Φ·ẏ + ẏᵀMÿ + ½ ẏᵀṀẏ, with Ṁ by differences.
        #[test]
        fn energy_falls_by_the_damping_alone(y in vector(2.0), v in vector(1.0)) {
            let field = field();
            let value = field.evaluate(&y, &v);
            let turning = slope(|s| v.dot(&(field.evaluate(&(y + v * s), &v).metric * v)));
            let rate = value.gradient.dot(&v)
                + v.dot(&(value.metric * acceleration(&value, &v)))
                + 0.5 * turning;
            let dissipated = v.dot(&(value.damping * v));
            prop_assert!(dissipated >= 0.0);
            prop_assert!((rate + dissipated).abs() < 1e-6 * (1.0 + dissipated + turning.abs()));
        }

        /// ξ·ẏ = ½ ẏᵀṀẏ: what the curvature does not conserve would be a power of its own.
        #[test]
        fn curvature_does_no_work_beyond_that_of_the_metric(y in vector(2.0), v in vector(1.0)) {
            let field = field();
            let found = field.evaluate(&y, &v).curvature.dot(&v);
            let turning = slope(|s| v.dot(&(field.evaluate(&(y + v * s), &v).metric * v)));
            prop_assert!((found - 0.5 * turning).abs() < 1e-6 * (1.0 + turning.abs()));
        }

        #[test]
        fn weights_sum_to_one_however_far_away(direction in vector(1.0), distance in 0.0..1e3) {
            let field = field();
            let y = direction * distance;
            let value = field.evaluate(&y, &direction);
            let weights = field.weights(&y);
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
            prop_assert!(value.metric.cholesky().is_some());
            prop_assert!(value.force(&direction).iter().all(|f| f.is_finite()));
        }

        #[test]
        fn weights_are_the_normalised_densities(y in vector(1.5)) {
            let field = field();
            let density = |c: &GaussianComponent<3>| {
                let offset = y - c.mean;
                c.precision.determinant().sqrt()
                    * (-0.5 * offset.dot(&(c.precision * offset))).exp()
            };
            let sum: f64 = field.components().iter().map(density).sum();
            for (component, weight) in field.components().iter().zip(field.weights(&y)) {
                prop_assert!((weight - density(component) / sum).abs() < 1e-12);
            }
        }

        #[test]
        fn the_potential_is_affine_in_the_bias_potentials(y in vector(3.0)) {
            let field = field();
            let value = field.evaluate(&y, &Vector3::zeros());
            let affine = field.affine_potential(&y);
            let (mut potential, mut gradient) = (affine.potential, affine.gradient);
            let mut damping = 0.0;
            for (k, component) in field.components().iter().enumerate() {
                potential += affine.weights[k] * component.potential;
                gradient += affine.weight_gradients[k] * component.potential;
                damping += affine.weights[k] * component.damping;
            }
            let scale = 1.0 + gradient.norm();
            prop_assert!((value.potential - potential).abs() < 1e-11 * scale);
            prop_assert!((value.gradient - gradient).norm() < 1e-11 * scale);
            prop_assert!((value.damping[(1, 1)] - damping).abs() < 1e-12);
        }
    }

    #[test]
    fn energy_never_rises_along_the_policy() {
        let field = field();
        let (mut y, mut v) = (Vector3::new(-0.8, 1.0, 0.4), Vector3::new(0.5, -0.5, 0.2));
        let dt = 1e-4;
        let first = field.evaluate(&y, &v).energy(&v);
        let mut before = first;
        for _ in 0..60_000 {
            // Midpoint rule: its error is far below the damping's loss per step.
            let half_v = v + acceleration(&field.evaluate(&y, &v), &v) * (dt / 2.0);
            let half_y = y + v * (dt / 2.0);
            v += acceleration(&field.evaluate(&half_y, &half_v), &half_v) * dt;
            y += half_v * dt;
            let after = field.evaluate(&y, &v).energy(&v);
            assert!(after <= before + 1e-10, "energy rose by {:e}", after - before);
            before = after;
        }
        assert!(before < 0.5 * first, "{before} of {first}");
    }

    #[test]
    fn the_local_potential_is_smooth_at_the_threshold() {
        let field = field();
        let at = |norm: f64| field.huber(norm * norm);
        let (below, above) = (at(THRESHOLD * (1.0 - 1e-9)), at(THRESHOLD * (1.0 + 1e-9)));
        assert!((below.0 - above.0).abs() < 1e-8);
        assert!((below.1 - above.1).abs() < 1e-8);
        // Far away it pulls with the constant |∇φ| = δ in the metric of Λ.
        let (_, factor) = at(50.0);
        assert!((factor * 50.0 - THRESHOLD).abs() < 1e-12);
    }

    #[test]
    fn what_makes_no_field_is_refused() {
        let good = *field().components().first().unwrap();
        let error = |c: &[GaussianComponent<3>]| GaussianField::new(c, 1.0, 1.0).unwrap_err();
        assert_eq!(error(&[]), GaussianFieldError::ComponentCount(0));
        let many = [good; COMPONENT_CAPACITY + 1];
        assert_eq!(error(&many), GaussianFieldError::ComponentCount(COMPONENT_CAPACITY + 1));
        for scale in [-1.0, 0.0, f64::NAN, f64::INFINITY] {
            let bad = GaussianComponent { precision: good.precision * scale, ..good };
            assert_eq!(error(&[good, bad]), GaussianFieldError::Precision(1));
        }
    }
}
