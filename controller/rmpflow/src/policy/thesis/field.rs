//! The field of a mixture of Gaussians in one chart  [thesis section 4.2].
//!
//! With v_k = y − μ_k, the precisions Λ_k = Σ̂_k⁻¹ and n_k² = v_kᵀ Λ_k v_k,
//!
//! ```text
//! M   = γ Σ w̃_k Λ_k                                            [thesis eq. 4.5]
//! w̃_k = N(y|μ_k, Σ̂_k) / Σ_j N(y|μ_j, Σ̂_j)                     [thesis eq. 4.6]
//! ξ   = Ṁẏ − ½ ∂/∂y (ẏᵀMẏ)                                     [thesis eq. 4.7]
//! Ṁẏ  = γ Σ w̃_k (p̄ᵀẏ − (Λ_k v_k)ᵀẏ) Λ_k ẏ                      [thesis eq. 4.8]
//! ∂/∂y (ẏᵀMẏ) = γ Σ w̃_k (p̄ − Λ_k v_k) ẏᵀΛ_k ẏ                  [thesis eq. 4.9]
//! Φ   = Σ w̃_k φ_k                                              [thesis eq. 4.10]
//! φ_k = φ⁰_k + { ½ n_k²            for n_k ≤ δ
//!              { δ (n_k − ½ δ)     otherwise                   [thesis eq. 4.11]
//! ∇Φ  = Σ w̃_k ∇φ_k + Σ ∇w̃_k φ_k                                [thesis eq. 4.12]
//! ∇φ_k = { Λ_k v_k                 for n_k ≤ δ
//!        { δ Λ_k v_k / n_k         otherwise                   [thesis eq. 4.13]
//! ∇w̃_k = w̃_k (p̄ − Λ_k v_k)        p̄ = Σ_j w̃_j Λ_j v_j          [thesis eq. 4.14]
//! B   = Σ w̃_k d_k I                                            [thesis eq. 4.17]
//! ```
//!
//! and the policy M ÿ = −∇Φ − ξ − B ẏ, along which V = Φ + ½ ẏᵀMẏ falls as V̇ = −ẏᵀBẏ. The thesis
//! prints eq. 4.13 without the factor δ in the second case, without which ∇Φ would not be the
//! derivative of Φ.
//!
//! n_k, Φ and δ carry no unit: Λ is in \[1/m²\] (or 1/rad², 1/(m rad) in mixed blocks), so γ is in \[s²\]
//! and d in \[s/m²\] when M is to be the inertia of Φ. Whoever adds the policy to others scales force
//! and metric by one factor \[J\], which leaves the acceleration as it is.

#[cfg(test)]
mod tests;

use nalgebra::{SMatrix, SVector};

use crate::lanes::{
    self, Kernel, LANES, Lanes, Quad, add_scaled, dot, load_all, splat_all, store_all, sums,
    symmetric_times,
};
use crate::policy::canonical::field::{COMPONENT_CAPACITY, FieldValue};

/// Most groups of four components.
const GROUP_CAPACITY: usize = COMPONENT_CAPACITY / LANES;

/// Four components side by side, one in each lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group<const D: usize> {
    /// √det Λ; 0 in the lanes beyond the last component, which repeat that.
    pub(super) normaliser: Quad,
    pub(super) mean: [Quad; D],
    /// Its lower triangle counts.
    pub(super) precision: [[Quad; D]; D],
    /// φ⁰.
    pub(super) potential: Quad,
    /// d.
    pub(super) damping: Quad,
}

/// A field of dimension D; its last component is the goal's.
#[derive(Debug, Clone)]
pub struct GaussianField<const D: usize> {
    pub(super) groups: [Group<D>; GROUP_CAPACITY],
    pub(super) count: usize,
    /// γ \[s²\].
    pub(super) metric_scale: f64,
    /// δ.
    pub(super) huber_threshold: f64,
}

/// What a component contributes at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term<const D: usize> {
    /// w̃_k  [thesis eq. 4.6].
    pub weight: f64,
    /// ∇w̃_k  [thesis eq. 4.14].
    pub weight_gradient: SVector<f64, D>,
    /// φ_k  [thesis eq. 4.11].
    pub potential: f64,
    /// w̃_k ∇φ_k  [thesis eq. 4.13].
    pub attraction: SVector<f64, D>,
}

/// A group of components at a point.
struct Local<L, const D: usize> {
    /// w̃_k before they are normalised.
    activation: L,
    /// Λ_k v_k.
    pull: [L; D],
    /// φ_k.
    potential: L,
    /// s in ∇φ_k = s Λ_k v_k.
    slope: L,
}

impl<const D: usize> Group<D> {
    const NONE: Self = Self {
        normaliser: [0.0; LANES],
        mean: [[0.0; LANES]; D],
        precision: [[[0.0; LANES]; D]; D],
        potential: [0.0; LANES],
        damping: [0.0; LANES],
    };

    /// Λ_k v_k and n_k².
    #[inline(always)]
    fn pull<L: Lanes>(&self, y: &[L; D]) -> ([L; D], L) {
        let mut offset = load_all(&self.mean);
        for i in 0..D {
            offset[i] = y[i] - offset[i];
        }
        let pull = symmetric_times(&self.precision, &offset);
        (pull, dot(&offset, &pull))
    }

    /// * `least`  least n_k² of all components: exponents are relative to it, so that weights are
    ///   right however far away y is
    /// * `threshold`  δ
    #[inline(always)]
    fn at<L: Lanes>(&self, y: &[L; D], least: L, threshold: f64) -> Local<L, D> {
        let half = L::splat(0.5);
        let (pull, squared) = self.pull(y);
        // [thesis eq. 4.6]
        let activation = (half * (least - squared)).exp() * L::load(&self.normaliser);
        // [thesis eq. 4.11 and 4.13]
        let bound = threshold * threshold;
        let norm = squared.at_least(bound).sqrt();
        let far = L::splat(threshold) * (norm - L::splat(0.5 * threshold));
        let local = squared.choose(bound, half * squared, far);
        let potential = local + L::load(&self.potential);
        let slope = squared.choose(bound, L::splat(1.0), L::splat(threshold) / norm);
        Local { activation, pull, potential, slope }
    }
}

impl<const D: usize> GaussianField<D> {
    /// A field without components.
    pub(super) const NONE: Self = Self {
        groups: [Group::NONE; GROUP_CAPACITY],
        count: 0,
        metric_scale: f64::NAN,
        huber_threshold: f64::NAN,
    };

    /// μ_k \[m, rad\] and Λ_k of its components, the last of which is the goal's.
    pub fn components(
        &self,
    ) -> impl ExactSizeIterator<Item = (SVector<f64, D>, SMatrix<f64, D, D>)> + '_ {
        (0..self.count).map(|k| {
            let (group, lane) = (&self.groups[k / LANES], k % LANES);
            let precision = |i: usize, j: usize| group.precision[i.max(j)][i.min(j)][lane];
            (SVector::from_fn(|i, _| group.mean[i][lane]), SMatrix::from_fn(precision))
        })
    }

    /// What each component contributes at y; beyond the last component all is zero.
    ///
    /// No allocation, O(K D²).
    #[must_use]
    pub fn terms(&self, y: &SVector<f64, D>) -> [Term<D>; COMPONENT_CAPACITY] {
        lanes::run(Terms { field: self, y })
    }

    /// Evaluates the field at y for the velocity ẏ.
    ///
    /// Hot path: no allocation, O(K D²). Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn evaluate(&self, y: &SVector<f64, D>, velocity: &SVector<f64, D>) -> FieldValue<D> {
        lanes::run(Evaluation { field: self, y, velocity })
    }

    /// The components, four in each.
    fn groups(&self) -> &[Group<D>] {
        &self.groups[..self.count.div_ceil(LANES)]
    }

    /// Least n_k² of all components.
    #[inline(always)]
    fn least_squared<L: Lanes>(&self, y: &[L; D]) -> L {
        let mut least = L::splat(f64::INFINITY);
        for group in self.groups() {
            least = group.pull(y).1.smaller(least);
        }
        L::splat(least.store().into_iter().fold(f64::INFINITY, f64::min))
    }
}

/// [`GaussianField::terms`].
pub(super) struct Terms<'a, const D: usize> {
    pub(super) field: &'a GaussianField<D>,
    pub(super) y: &'a SVector<f64, D>,
}

impl<const D: usize> Kernel for Terms<'_, D> {
    type Output = [Term<D>; COMPONENT_CAPACITY];

    #[inline(always)]
    fn run<L: Lanes>(self) -> [Term<D>; COMPONENT_CAPACITY] {
        let Self { field, y } = self;
        let y = splat_all::<L, D>(&y.data.0[0]);
        let least = field.least_squared(&y);
        let zero = SVector::zeros();
        let none = Term { weight: 0.0, weight_gradient: zero, potential: 0.0, attraction: zero };
        let (mut terms, mut slopes) = ([none; COMPONENT_CAPACITY], [0.0; COMPONENT_CAPACITY]);
        let mut density = L::zero();
        for (g, group) in field.groups().iter().enumerate() {
            let Local { activation, pull, potential, slope } =
                group.at(&y, least, field.huber_threshold);
            density = density + activation;
            let (weights, potentials) = (activation.store(), potential.store());
            let (pulls, slope) = (store_all(&pull), slope.store());
            for lane in 0..LANES.min(field.count - g * LANES) {
                let pull = SVector::from_fn(|i, _| pulls[i][lane]);
                let (weight, potential) = (weights[lane], potentials[lane]);
                terms[g * LANES + lane] =
                    Term { weight, weight_gradient: zero, potential, attraction: pull };
                slopes[g * LANES + lane] = slope[lane];
            }
        }
        let density = density.sum();
        let terms_of_components = &mut terms[..field.count];
        let mut mean_pull = SVector::<f64, D>::zeros();
        for term in &mut *terms_of_components {
            term.weight /= density;
            mean_pull += term.attraction * term.weight;
        }
        for (term, slope) in terms_of_components.iter_mut().zip(slopes) {
            term.weight_gradient = (mean_pull - term.attraction) * term.weight;
            term.attraction *= term.weight * slope;
        }
        terms
    }
}

/// [`GaussianField::evaluate`].
pub(super) struct Evaluation<'a, const D: usize> {
    pub(super) field: &'a GaussianField<D>,
    pub(super) y: &'a SVector<f64, D>,
    pub(super) velocity: &'a SVector<f64, D>,
}

impl<const D: usize> Kernel for Evaluation<'_, D> {
    type Output = FieldValue<D>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> FieldValue<D> {
        let Self { field, y, velocity } = self;
        let y = splat_all::<L, D>(&y.data.0[0]);
        let rate = splat_all::<L, D>(&velocity.data.0[0]);
        let least = field.least_squared(&y);
        let zero = L::zero();
        // Sums over the components with weights that are not normalised.
        let (mut density, mut potential, mut damping) = (zero, zero, zero);
        let (mut pulls, mut slopes) = ([zero; D], [zero; D]);
        let (mut momentum_rates, mut kinetic_pulls) = ([zero; D], [zero; D]);
        let mut precisions = [[zero; D]; D];
        for group in field.groups() {
            let local = group.at(&y, least, field.huber_threshold);
            let (activation, pull) = (local.activation, &local.pull);
            let momentum = symmetric_times(&group.precision, &rate);
            density = density + activation;
            potential = potential + activation * local.potential;
            damping = damping + activation * L::load(&group.damping);
            add_scaled(&mut pulls, pull, activation);
            add_scaled(&mut slopes, pull, activation * (local.slope - local.potential));
            add_scaled(&mut momentum_rates, &momentum, activation * dot(pull, &rate));
            add_scaled(&mut kinetic_pulls, pull, activation * dot(&momentum, &rate));
            for i in 0..D {
                for j in 0..=i {
                    let entry = L::load(&group.precision[i][j]);
                    precisions[i][j] = precisions[i][j] + activation * entry;
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
        // [thesis eq. 4.8 and 4.9]
        let momentum_rate = momentum * mean_pull.dot(velocity) - sums(&momentum_rates) * inverse;
        let kinetic = mean_pull * momentum.dot(velocity) - sums(&kinetic_pulls) * inverse;
        FieldValue {
            potential,
            gradient: mean_pull * potential + sums(&slopes) * inverse,
            metric: precision * field.metric_scale,
            curvature: (momentum_rate - kinetic * 0.5) * field.metric_scale,
            damping: SMatrix::identity() * (damping.sum() * inverse),
        }
    }
}
