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

use crate::lanes::{
    self, Kernel, LANES, Lanes, Quad, add_scaled, dot, splat_all, sums, symmetric_times,
};
use crate::policy::canonical::field::{COMPONENT_CAPACITY, FieldValue};

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

/// Four components side by side, one in each lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GaussianQuad<const D: usize> {
    /// √det Λ; 0 in the lanes beyond the last component, which repeat that.
    pub(crate) normaliser: Quad,
    pub(crate) mean: [Quad; D],
    /// Its lower triangle counts.
    pub(crate) precision: [[Quad; D]; D],
    pub(crate) potential: Quad,
    pub(crate) damping: Quad,
}

/// Most groups of four components.
pub(crate) const QUAD_CAPACITY: usize = COMPONENT_CAPACITY / LANES;

impl<const D: usize> GaussianQuad<D> {
    pub(crate) const NONE: Self = Self {
        normaliser: [0.0; LANES],
        mean: [[0.0; LANES]; D],
        precision: [[[0.0; LANES]; D]; D],
        potential: [0.0; LANES],
        damping: [0.0; LANES],
    };

    fn set(&mut self, lane: usize, component: &GaussianComponent<D>, normaliser: f64) {
        self.normaliser[lane] = normaliser;
        self.potential[lane] = component.potential;
        self.damping[lane] = component.damping;
        for i in 0..D {
            self.mean[i][lane] = component.mean[i];
            for j in 0..=i {
                self.precision[i][j][lane] = component.precision[(i, j)];
            }
        }
    }

    fn get(&self, lane: usize) -> GaussianComponent<D> {
        GaussianComponent {
            mean: SVector::from_fn(|i, _| self.mean[i][lane]),
            precision: SMatrix::from_fn(|i, j| self.precision[i.max(j)][i.min(j)][lane]),
            potential: self.potential[lane],
            damping: self.damping[lane],
        }
    }

    /// Λ v, and n² = vᵀΛv of each component, for v = y − μ.
    #[inline(always)]
    fn pull<L: Lanes>(&self, at: &[L; D]) -> ([L; D], L) {
        let mut offset = [L::zero(); D];
        for i in 0..D {
            offset[i] = at[i] - L::load(&self.mean[i]);
        }
        let pull = symmetric_times(&self.precision, &offset);
        (pull, dot(&offset, &pull))
    }
}

/// An immutable field of dimension D; its last component is the goal's.
#[derive(Debug, Clone)]
pub struct GaussianField<const D: usize> {
    pub(crate) quads: [GaussianQuad<D>; QUAD_CAPACITY],
    pub(crate) count: usize,
    /// γ \[s²\].
    pub(crate) metric_scale: f64,
    /// δ.
    pub(crate) huber_threshold: f64,
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
        let mut field = Self { count, metric_scale, huber_threshold, ..Self::NONE };
        for (k, component) in components.iter().enumerate() {
            let normaliser = Cholesky::new(component.precision)
                .map(|f| f.l_dirty().diagonal().iter().product())
                .filter(|n: &f64| n.is_finite() && *n > 0.0)
                .ok_or(GaussianFieldError::Precision(k))?;
            field.quads[k / LANES].set(k % LANES, component, normaliser);
        }
        for k in count..count.next_multiple_of(LANES) {
            field.quads[k / LANES].set(k % LANES, last, 0.0);
        }
        Ok(field)
    }

    /// A field without components.
    pub(crate) const NONE: Self = Self {
        quads: [GaussianQuad::NONE; QUAD_CAPACITY],
        count: 0,
        metric_scale: f64::NAN,
        huber_threshold: f64::NAN,
    };

    /// Its components, the last of which is the goal's.
    pub fn components(&self) -> impl ExactSizeIterator<Item = GaussianComponent<D>> + '_ {
        (0..self.count).map(|k| self.quads[k / LANES].get(k % LANES))
    }

    /// γ \[s²\].
    #[must_use]
    pub fn metric_scale(&self) -> f64 {
        self.metric_scale
    }

    /// The components, four in each.
    fn quads(&self) -> &[GaussianQuad<D>] {
        &self.quads[..self.count.div_ceil(LANES)]
    }

    /// w̃_k, the normalised densities at y; zero beyond the last component  [thesis eq. 4.6].
    ///
    /// The exponents are taken relative to the largest, so that they are right however far away y
    /// is.
    #[must_use]
    pub fn weights(&self, y: &SVector<f64, D>) -> [f64; COMPONENT_CAPACITY] {
        lanes::run(Weights { field: self, y })
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
        lanes::run(Evaluation { field: self, y, velocity })
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
        for ((component, weight), pull) in self.components().zip(weights).zip(&mut weight_gradients)
        {
            *pull = component.precision * (y - component.mean);
            mean_pull += *pull * weight;
        }
        let mut potential = 0.0;
        let mut gradient = SVector::<f64, D>::zeros();
        for ((component, weight), weight_gradient) in
            self.components().zip(weights).zip(&mut weight_gradients)
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

/// Least n_k² of all components.
#[inline(always)]
fn least_squared<L: Lanes, const D: usize>(
    field: &GaussianField<D>,
    at: &[L; D],
    squared: &mut [Quad; QUAD_CAPACITY],
) -> f64 {
    let mut least = L::splat(f64::INFINITY);
    for (quad, squared) in field.quads().iter().zip(squared) {
        let found = quad.pull(at).1;
        least = found.smaller(least);
        *squared = found.store();
    }
    least.store().into_iter().fold(f64::INFINITY, f64::min)
}

/// The weights of a field, of four components at once.
struct Weights<'a, const D: usize> {
    field: &'a GaussianField<D>,
    y: &'a SVector<f64, D>,
}

impl<const D: usize> Kernel for Weights<'_, D> {
    type Output = [f64; COMPONENT_CAPACITY];

    #[inline(always)]
    fn run<L: Lanes>(self) -> [f64; COMPONENT_CAPACITY] {
        let Self { field, y } = self;
        let mut squared = [[0.0; LANES]; QUAD_CAPACITY];
        let least = least_squared(field, &splat_all::<L, D>(&y.data.0[0]), &mut squared);
        let mut weights = [0.0; COMPONENT_CAPACITY];
        let mut density = L::zero();
        let groups = field.quads().iter().zip(&squared);
        for ((quad, squared), weights) in groups.zip(weights.chunks_exact_mut(LANES)) {
            let exponent = L::splat(0.5) * (L::splat(least) - L::load(squared));
            let activation = exponent.exp() * L::load(&quad.normaliser);
            density = density + activation;
            weights.copy_from_slice(&activation.store());
        }
        let density = density.sum();
        for weight in &mut weights[..field.count] {
            *weight /= density;
        }
        weights
    }
}

/// The evaluation of a field, of four components at once.
struct Evaluation<'a, const D: usize> {
    field: &'a GaussianField<D>,
    y: &'a SVector<f64, D>,
    velocity: &'a SVector<f64, D>,
}

impl<const D: usize> Kernel for Evaluation<'_, D> {
    type Output = FieldValue<D>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> FieldValue<D> {
        let Self { field, y, velocity } = self;
        let at = splat_all::<L, D>(&y.data.0[0]);
        let speed = splat_all::<L, D>(&velocity.data.0[0]);
        let mut squared = [[0.0; LANES]; QUAD_CAPACITY];
        let least = least_squared(field, &at, &mut squared);
        let (zero, half) = (L::zero(), L::splat(0.5));
        let threshold = field.huber_threshold;
        let bound = threshold * threshold;
        // Sums of e_k, the weights before they are normalised, with what stands beside them.
        let (mut density, mut potential, mut damping) = (zero, zero, zero);
        let (mut pulls, mut slopes) = ([zero; D], [zero; D]);
        let (mut momentum_rates, mut kinetic_pulls) = ([zero; D], [zero; D]);
        let mut precisions = [[zero; D]; D];
        for (quad, squared) in field.quads().iter().zip(&squared) {
            let (pull, _) = quad.pull(&at);
            let squared = L::load(squared);
            let exponent = half * (L::splat(least) - squared);
            let activation = exponent.exp() * L::load(&quad.normaliser);
            // φ_k − φ⁰_k and the factor s of ∇φ_k = s Λ_k v_k.
            let norm = squared.at_least(bound).sqrt();
            let far = L::splat(threshold) * (norm - L::splat(0.5 * threshold));
            let local = squared.choose(bound, half * squared, far) + L::load(&quad.potential);
            let slope = squared.choose(bound, L::splat(1.0), L::splat(threshold) / norm);
            let momentum = symmetric_times(&quad.precision, &speed);
            density = density + activation;
            potential = potential + activation * local;
            damping = damping + activation * L::load(&quad.damping);
            add_scaled(&mut pulls, &pull, activation);
            add_scaled(&mut slopes, &pull, activation * (slope - local));
            add_scaled(&mut momentum_rates, &momentum, activation * dot(&pull, &speed));
            add_scaled(&mut kinetic_pulls, &pull, activation * dot(&momentum, &speed));
            for i in 0..D {
                for j in 0..=i {
                    precisions[i][j] =
                        precisions[i][j] + activation * L::load(&quad.precision[i][j]);
                }
            }
        }
        let inverse = 1.0 / density.sum();
        let mut precision = SMatrix::<f64, D, D>::zeros();
        for i in 0..D {
            let row = sums(&precisions[i]);
            for j in 0..=i {
                precision[(i, j)] = row[j] * inverse;
                precision[(j, i)] = row[j] * inverse;
            }
        }
        let potential = potential.sum() * inverse;
        let mean_pull = sums(&pulls) * inverse;
        let momentum = precision * velocity;
        let rate = momentum * mean_pull.dot(velocity) - sums(&momentum_rates) * inverse;
        let kinetic = mean_pull * momentum.dot(velocity) - sums(&kinetic_pulls) * inverse;
        FieldValue {
            potential,
            gradient: mean_pull * potential + sums(&slopes) * inverse,
            metric: precision * field.metric_scale,
            curvature: (rate - kinetic * 0.5) * field.metric_scale,
            damping: SMatrix::identity() * (damping.sum() * inverse),
        }
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
        field.components().any(|c| {
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
            let sum: f64 = field.components().map(|c| density(&c)).sum();
            for (component, weight) in field.components().zip(field.weights(&y)) {
                prop_assert!((weight - density(&component) / sum).abs() < 1e-12);
            }
        }

        #[test]
        fn the_potential_is_affine_in_the_bias_potentials(y in vector(3.0)) {
            let field = field();
            let value = field.evaluate(&y, &Vector3::zeros());
            let affine = field.affine_potential(&y);
            let (mut potential, mut gradient) = (affine.potential, affine.gradient);
            let mut damping = 0.0;
            for (k, component) in field.components().enumerate() {
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
    fn every_machine_gives_the_same_bits() {
        let field = field();
        for i in 0..40 {
            let s = f64::from(i);
            let y = Vector3::new((s * 0.7).sin(), (s * 1.3).cos(), 0.5 * (s * 0.31).sin()) * 2.0;
            let velocity = Vector3::new((s * 0.9).cos(), 0.6 * (s * 0.5).sin(), 0.8 - 0.03 * s);
            let kernel = || Evaluation { field: &field, y: &y, velocity: &velocity };
            let parts =
                |v: FieldValue<3>| (v.potential, v.gradient, v.metric, v.curvature, v.damping);
            let (here, anywhere) = (lanes::run(kernel()), lanes::run_portable(kernel()));
            assert_eq!(parts(here), parts(anywhere));
            let kernel = || Weights { field: &field, y: &y };
            assert_eq!(lanes::run(kernel()), lanes::run_portable(kernel()));
        }
    }

    #[test]
    fn what_makes_no_field_is_refused() {
        let good = field().components().next().unwrap();
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
