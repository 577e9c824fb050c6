//! A learned field on canonical coordinates and the phase: potential, metric, curvature and damping
//! as a mixture over the phase.
//!
//! A point z = (y, s) has the position or the orientation chart y and, as its last coordinate, the
//! phase s, 0 at the start of the skill and 1 at its goal g, so that demonstrations are curves that
//! never close or cross. With v_k = z − μ_k and s_k the last coordinate of μ_k,
//!
//! ```text
//! w_k = e_k / Σ_j e_j        e_k = exp(−½ (s − s_k)²/σ²)               (weights)
//! φ_k = φ⁰_k + g_kᵀv_k + ½ v_kᵀ S_k v_k                                (local potentials)
//! Φ   = Σ w_k φ_k          M = Σ w_k M_k          B = d M              [thesis eq. 4.5, 4.10, 4.17]
//! ξ   = Ṁż − ½ ∂/∂z (żᵀMż)                                             [thesis eq. 4.7]
//! ```
//!
//! and the policy M z̈ = −∇Φ − ξ − B ż, along which V = Φ + ½ żᵀMż falls as V̇ = −d żᵀMż.
//!
//! For each s the potential is one quadratic in y. Where its Hessian H(s) = Σ w_k S_k,yy is positive
//! definite it has one lowest point y*(s), and all of them form the *valley* of the field. ∇Φ is
//! zero nowhere but in the valley, and there exactly where U(s) = Φ(y*(s), s) is level: whether the
//! goal is the only place of rest is a question about a function of one variable.
//!
//! The thesis' weights are densities of the state (eq. 4.6). Those of the phase alone are what makes
//! the question that simple; far from the demonstrations, too, they are defined.

use nalgebra::{SMatrix, SVector};

use crate::lanes::{self, Kernel, LANES, Lanes, Quad};

/// Most components of a field, the goal's included.
pub const COMPONENT_CAPACITY: usize = 64;
/// Groups of four numbers of a component that are blended: enough for N = 4, 1 + 4 + 10 + 10.
const ROW_CAPACITY: usize = 7;
/// Most groups of four components.
const QUAD_CAPACITY: usize = COMPONENT_CAPACITY / LANES;
/// Components whose weight is below exp(−45) of the largest are left out: less than what rounding
/// leaves of the others.
const EXPONENT_MAX: f64 = 45.0;

/// One component: a metric and a quadratic potential around a mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component<const N: usize> {
    /// μ: position \[m\] or rotation vector \[rad\], and last the phase.
    pub mean: SVector<f64, N>,
    /// M_k, symmetric positive definite \[kg or kg m²; for the phase kg m²\].
    pub metric: SMatrix<f64, N, N>,
    /// φ⁰ \[J\].
    pub potential: f64,
    /// g \[J/m or J/rad; J\].
    pub gradient: SVector<f64, N>,
    /// S, symmetric \[J/m² or J/rad²; J\].
    pub hessian: SMatrix<f64, N, N>,
}

/// Why a field could not be built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldError {
    /// There is no component, or there are more than [`COMPONENT_CAPACITY`].
    ComponentCount(usize),
}

/// An immutable learned field on z = (y, s) of dimension N, at most 4; its last component is the goal's.
#[derive(Debug, Clone)]
pub struct Field<const N: usize> {
    components: [Component<N>; COMPONENT_CAPACITY],
    /// φ_k and M_k as polynomials of u = z − (g, 1): φ_k(0), ∇φ_k(0), and the upper triangles of S_k
    /// and M_k, row by row.
    rows: [[Quad; ROW_CAPACITY]; COMPONENT_CAPACITY],
    /// s_k, four in each; the lanes beyond the last component repeat that.
    phases: [Quad; QUAD_CAPACITY],
    /// 1, or 0 in the lanes beyond the last component.
    presence: Quad,
    count: usize,
    /// σ.
    phase_width: f64,
    goal: SVector<f64, N>,
    /// d in B = d M \[1/s\].
    damping_1_s: f64,
}

/// A field at a point, for a velocity.
#[derive(Debug, Clone, Copy)]
pub struct FieldValue<const D: usize> {
    /// Φ \[J\].
    pub potential: f64,
    /// ∇Φ \[N or N m\].
    pub gradient: SVector<f64, D>,
    /// M \[kg or kg m²\].
    pub metric: SMatrix<f64, D, D>,
    /// ξ \[N or N m\].
    pub curvature: SVector<f64, D>,
    /// B, symmetric, positive semi-definite \[N s/m or N m s\].
    pub damping: SMatrix<f64, D, D>,
}

impl<const D: usize> FieldValue<D> {
    /// f = −∇Φ − ξ − B ẏ, the force of the natural form M ÿ = f  [thesis eq. 4.4].
    #[must_use]
    pub fn force(&self, velocity: &SVector<f64, D>) -> SVector<f64, D> {
        -self.gradient - self.curvature - self.damping * velocity
    }

    /// V = Φ + ½ ẏᵀMẏ \[J\].
    #[must_use]
    pub fn energy(&self, velocity: &SVector<f64, D>) -> f64 {
        self.potential + 0.5 * velocity.dot(&(self.metric * velocity))
    }
}

/// A point of the valley of a field.
#[derive(Debug, Clone, Copy)]
pub struct Valley<const N: usize> {
    /// (y*(s), s).
    pub point: SVector<f64, N>,
    /// U(s) = Φ(y*(s), s) \[J\].
    pub potential: f64,
    /// U′(s) \[J\].
    pub slope: f64,
}

/// Numbers blended from the rows of all components: a quadratic and a metric.
#[derive(Clone, Copy)]
struct Blend([Quad; ROW_CAPACITY]);

impl Blend {
    /// Constant, gradient and Hessian of the quadratic.
    fn quadratic<const N: usize>(&self) -> (f64, SVector<f64, N>, SMatrix<f64, N, N>) {
        let row = self.0.as_flattened();
        (row[0], SVector::from_fn(|i, _| row[1 + i]), self.triangle(1 + N))
    }

    fn metric<const N: usize>(&self) -> SMatrix<f64, N, N> {
        self.triangle(1 + N + N * (N + 1) / 2)
    }

    fn triangle<const N: usize>(&self, first: usize) -> SMatrix<f64, N, N> {
        let row = self.0.as_flattened();
        let mut matrix = SMatrix::zeros();
        let mut at = first;
        for i in 0..N {
            for j in i..N {
                matrix[(i, j)] = row[at];
                matrix[(j, i)] = row[at];
                at += 1;
            }
        }
        matrix
    }
}

/// The component as a row of [`Field::rows`].
fn row<const N: usize>(component: &Component<N>, goal: &SVector<f64, N>) -> [Quad; ROW_CAPACITY] {
    let mean = component.mean - goal;
    let curved = component.hessian * mean;
    let gradient = component.gradient - curved;
    let mut quads = [[0.0; LANES]; ROW_CAPACITY];
    let row = quads.as_flattened_mut();
    row[0] = component.potential - component.gradient.dot(&mean) + 0.5 * curved.dot(&mean);
    let mut at = 1;
    for entry in &gradient {
        row[at] = *entry;
        at += 1;
    }
    for matrix in [&component.hessian, &component.metric] {
        for i in 0..N {
            for j in i..N {
                row[at] = matrix[(i, j)];
                at += 1;
            }
        }
    }
    quads
}

impl<const N: usize> Field<N> {
    /// More dimensions do not fit a row.
    const FITS: () = assert!(Self::ROW <= ROW_CAPACITY, "a field has at most four dimensions");
    /// Groups of four numbers that a component has.
    const ROW: usize = (1 + N + N * (N + 1)).div_ceil(LANES);

    /// A field of these components, the last of which is the goal's; `phase_width` is σ.
    ///
    /// # Errors
    /// When there is no component, or there are too many.
    pub fn new(
        components: &[Component<N>],
        phase_width: f64,
        damping_1_s: f64,
    ) -> Result<Self, FieldError> {
        let () = Self::FITS;
        let count = components.len();
        let last = components.last().ok_or(FieldError::ComponentCount(0))?;
        if count > COMPONENT_CAPACITY {
            return Err(FieldError::ComponentCount(count));
        }
        let mut stored = [*last; COMPONENT_CAPACITY];
        stored[..count].copy_from_slice(components);
        let goal = last.mean;
        let rows = stored.map(|component| row(&component, &goal));
        let mut phases = [[goal[N - 1]; LANES]; QUAD_CAPACITY];
        for (phase, component) in phases.as_flattened_mut().iter_mut().zip(components) {
            *phase = component.mean[N - 1];
        }
        let mut presence = [0.0; LANES];
        presence[..(count - 1) % LANES + 1].fill(1.0);
        Ok(Self {
            components: stored,
            rows,
            phases,
            presence,
            count,
            phase_width,
            goal,
            damping_1_s,
        })
    }

    /// Its components, the last of which is the goal's.
    #[must_use]
    pub fn components(&self) -> &[Component<N>] {
        &self.components[..self.count]
    }

    /// The goal (g, 1) \[m or rad\].
    #[must_use]
    pub fn goal(&self) -> SVector<f64, N> {
        self.goal
    }

    /// σ.
    #[must_use]
    pub fn phase_width(&self) -> f64 {
        self.phase_width
    }

    /// d in B = d M \[1/s\].
    #[must_use]
    pub fn damping_1_s(&self) -> f64 {
        self.damping_1_s
    }

    /// The weights w_k and their derivatives at a phase; what lies behind the count is zero.
    #[must_use]
    pub fn weights(&self, phase: f64) -> [[f64; 2]; COMPONENT_CAPACITY] {
        let Weights { values, rates } = lanes::run(Weighing { field: self, phase });
        let mut weights = [[0.0; 2]; COMPONENT_CAPACITY];
        let each = values.as_flattened().iter().zip(rates.as_flattened());
        for (weight, (value, rate)) in weights.iter_mut().zip(each).take(self.count) {
            *weight = [*value, *rate];
        }
        weights
    }

    /// Σ w_k row_k and Σ w_k′ row_k.
    fn blend(&self, phase: f64) -> [Blend; 2] {
        lanes::run(Blending { field: self, phase })
    }

    /// Evaluates the field at z for the velocity ż.
    ///
    /// Hot path: no allocation, O(K N²). Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn evaluate(&self, z: &SVector<f64, N>, velocity: &SVector<f64, N>) -> FieldValue<N> {
        let last = N - 1;
        let offset = z - self.goal;
        let [value, slope] = self.blend(z[last]);
        let (constant, linear, hessian) = value.quadratic::<N>();
        let curved = hessian * offset;
        let mut gradient = linear + curved;
        let potential = constant + linear.dot(&offset) + 0.5 * curved.dot(&offset);
        let (constant, linear, hessian) = slope.quadratic::<N>();
        gradient[last] += constant + (linear + hessian * offset * 0.5).dot(&offset);

        // Ṁ = ṡ M′, and only the phase changes the metric.
        let metric = value.metric::<N>();
        let momentum_slope = slope.metric::<N>() * velocity;
        let mut curvature = momentum_slope * velocity[last];
        curvature[last] -= 0.5 * momentum_slope.dot(velocity);
        FieldValue { potential, gradient, metric, curvature, damping: metric * self.damping_1_s }
    }

    /// The valley at a phase; `None` where the Hessian H(s) is not positive definite.
    #[must_use]
    pub fn valley(&self, phase: f64) -> Option<Valley<N>> {
        let last = N - 1;
        let mut offset = SVector::<f64, N>::zeros();
        offset[last] = phase - self.goal[last];
        let [value, slope] = self.blend(phase);
        let (constant, linear, hessian) = value.quadratic::<N>();
        // One Newton step from y = g, with the phase held: pinning a row and a column leaves the
        // solution of the others.
        let mut pinned = hessian;
        let mut force = linear + hessian * offset;
        for i in 0..last {
            pinned[(i, last)] = 0.0;
            pinned[(last, i)] = 0.0;
        }
        pinned[(last, last)] = 1.0;
        force[last] = 0.0;
        offset -= pinned.cholesky()?.solve(&force);
        let curved = hessian * offset;
        let potential = constant + linear.dot(&offset) + 0.5 * curved.dot(&offset);
        let mut rate = (linear + curved)[last];
        let (constant, linear, hessian) = slope.quadratic::<N>();
        rate += constant + (linear + hessian * offset * 0.5).dot(&offset);
        Some(Valley { point: self.goal + offset, potential, slope: rate })
    }

    /// Σ w_k μ_k at a phase, without the phase: the demonstrated path of a field that goes round, whose means are
    /// chosen so \[m or rad; last the phase\].
    #[must_use]
    pub fn mean(&self, phase: f64) -> SVector<f64, N> {
        let weights = self.weights(phase);
        let each = self.components().iter().zip(&weights);
        let mut mean: SVector<f64, N> = each.map(|(component, [w, _])| component.mean * *w).sum();
        mean[N - 1] = phase;
        mean
    }

    /// Half the squared norm of an offset in the metric at a phase: ½ vᵀMv \[kg m²\].
    #[must_use]
    pub fn half_squared_norm(&self, phase: f64, offset: &SVector<f64, N>) -> f64 {
        let metric = self.blend(phase)[0].metric::<N>();
        0.5 * offset.dot(&(metric * offset))
    }

    /// The squared distance of z from the demonstrations of its phase: ½ Σ w_k v_kᵀM_kv_k \[kg m²\].
    ///
    /// Metrics are large where the demonstrations agree.
    #[must_use]
    pub fn distance(&self, z: &SVector<f64, N>) -> f64 {
        let weights = self.weights(z[N - 1]);
        let each = self.components().iter().zip(&weights);
        each.map(|(component, [weight, _])| {
            let offset = z - component.mean;
            0.5 * weight * offset.dot(&(component.metric * offset))
        })
        .sum()
    }
}

/// w_k and w_k′, four components side by side; beyond the last one they are zero.
struct Weights {
    values: [Quad; QUAD_CAPACITY],
    rates: [Quad; QUAD_CAPACITY],
}

impl Weights {
    const NONE: Self =
        Self { values: [[0.0; LANES]; QUAD_CAPACITY], rates: [[0.0; LANES]; QUAD_CAPACITY] };
}

/// Sets the weights of a field's components at a phase.
#[inline(always)]
fn weigh<L: Lanes, const N: usize>(field: &Field<N>, phase: f64, weights: &mut Weights) {
    let (at, inverse) = (L::splat(phase), L::splat(1.0 / field.phase_width));
    let phases = &field.phases[..field.count.div_ceil(LANES)];
    let mut least = L::splat(f64::INFINITY);
    for own in phases {
        let offset = (at - L::load(own)) * inverse;
        least = (offset * offset).smaller(least);
    }
    let [a, b, c, d] = least.store();
    let least = L::splat(a.min(b).min(c.min(d)));
    let (mut sum, mut offset_sum) = (L::zero(), L::zero());
    for (q, own) in phases.iter().enumerate() {
        let offset = (at - L::load(own)) * inverse;
        let above = (offset * offset - least) * L::splat(0.5);
        // Not a number has no weight; then there is no sum to divide by, and nothing is a number.
        let mut weight = above.choose(EXPONENT_MAX, (-above).exp(), L::zero());
        if (q + 1) * LANES > field.count {
            weight = weight * L::load(&field.presence);
        }
        sum = sum + weight;
        offset_sum = offset_sum + weight * offset;
        weights.values[q] = weight.store();
    }
    let scale = 1.0 / sum.sum();
    let mean_offset = L::splat(offset_sum.sum() * scale);
    for (q, own) in phases.iter().enumerate() {
        let offset = (at - L::load(own)) * inverse;
        let weight = L::load(&weights.values[q]) * L::splat(scale);
        weights.values[q] = weight.store();
        weights.rates[q] = (weight * (mean_offset - offset) * inverse).store();
    }
}

/// [`weigh`].
struct Weighing<'a, const N: usize> {
    field: &'a Field<N>,
    phase: f64,
}

impl<const N: usize> Kernel for Weighing<'_, N> {
    type Output = Weights;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Weights {
        let mut weights = Weights::NONE;
        weigh::<L, N>(self.field, self.phase, &mut weights);
        weights
    }
}

/// Σ w_k row_k and Σ w_k′ row_k, four entries at once.
struct Blending<'a, const N: usize> {
    field: &'a Field<N>,
    phase: f64,
}

impl<const N: usize> Kernel for Blending<'_, N> {
    type Output = [Blend; 2];

    #[inline(always)]
    fn run<L: Lanes>(self) -> [Blend; 2] {
        let Self { field, phase } = self;
        let mut weights = Weights::NONE;
        weigh::<L, N>(field, phase, &mut weights);
        let Weights { values, rates } = &weights;
        let (mut value, mut slope) = ([L::zero(); ROW_CAPACITY], [L::zero(); ROW_CAPACITY]);
        let each = values.as_flattened().iter().zip(rates.as_flattened()).zip(&field.rows);
        for ((weight, rate), row) in each.take(field.count) {
            if *weight == 0.0 {
                continue;
            }
            let (weight, rate) = (L::splat(*weight), L::splat(*rate));
            for i in 0..Field::<N>::ROW {
                let entries = L::load(&row[i]);
                value[i] = value[i] + weight * entries;
                slope[i] = slope[i] + rate * entries;
            }
        }
        let mut blends = [Blend([[0.0; LANES]; ROW_CAPACITY]); 2];
        for i in 0..Field::<N>::ROW {
            blends[0].0[i] = value[i].store();
            blends[1].0[i] = slope[i].store();
        }
        blends
    }
}

#[cfg(test)]
mod tests;
