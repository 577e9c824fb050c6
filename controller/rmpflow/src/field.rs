//! A learned field on canonical coordinates: potential, metric, curvature and damping as mixtures
//! over the components of a Gaussian mixture.
//!
//! With v_k = y − μ_k and the unnormalised activations e_k = exp(−½ v_kᵀ Λ_k v_k),
//!
//! ```text
//! w_k = e_k / (Σ_j e_j + ε₀)      w_0 = ε₀ / (Σ_j e_j + ε₀)          (weights)
//! φ_k = φ⁰_k + g_kᵀv_k + ½ v_kᵀ S_k v_k                              (local potentials)
//! φ_0 = c₀ + k₀ (√(|y−g|² + a²) − a)                                 (background potential)
//! Φ   = Σ w_k φ_k          M = Σ w_k M_k          B = d M            [thesis eq. 4.5, 4.10, 4.17]
//! ξ   = Ṁẏ − ½ ∂/∂y (ẏᵀMẏ)                                           [thesis eq. 4.7]
//! ```
//!
//! and the policy M ÿ = −∇Φ − ξ − B ẏ, along which V = Φ + ½ ẏᵀMẏ falls as V̇ = −d ẏᵀMẏ. The
//! background component of constant density ε₀ takes over away from the demonstrations, so that Φ
//! is radially unbounded and the weights never divide zero by zero. The thesis normalises the
//! densities (eq. 4.6); here the normaliser is left out, so that a narrow component does not
//! swallow its neighbours.

use nalgebra::{SMatrix, SVector};

/// Most components of a field, the goal's included.
pub const COMPONENT_CAPACITY: usize = 64;

/// One component: a Gaussian activation with its metric and its quadratic potential.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component<const D: usize> {
    /// μ \[m or rad\].
    pub mean: SVector<f64, D>,
    /// Λ, symmetric positive definite \[1/m² or 1/rad²\].
    pub precision: SMatrix<f64, D, D>,
    /// M_k, symmetric positive definite \[kg or kg m²\].
    pub metric: SMatrix<f64, D, D>,
    /// φ⁰ \[J\].
    pub potential: f64,
    /// g \[J/m or J/rad\].
    pub gradient: SVector<f64, D>,
    /// S, symmetric \[J/m² or J/rad²\].
    pub hessian: SMatrix<f64, D, D>,
}

/// The component of constant density that takes over away from the demonstrations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Background {
    /// ln ε₀, the logarithm of its density.
    pub exponent: f64,
    /// m₀ in M_0 = m₀ I \[kg or kg m²\].
    pub metric: f64,
    /// c₀ \[J\].
    pub offset: f64,
    /// k₀ \[J/m or J/rad\].
    pub slope: f64,
    /// a \[m or rad\].
    pub softening: f64,
}

/// Why a field could not be built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldError {
    /// There is no component, or there are more than [`COMPONENT_CAPACITY`].
    ComponentCount(usize),
}

/// An immutable learned field of dimension D; its last component is the goal's.
#[derive(Debug, Clone)]
pub struct Field<const D: usize> {
    components: [Component<D>; COMPONENT_CAPACITY],
    count: usize,
    background: Background,
    /// ε₀.
    background_density: f64,
    goal: SVector<f64, D>,
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

impl<const D: usize> Field<D> {
    /// A field of these components, the last of which is the goal's.
    ///
    /// # Errors
    /// When there is no component, or there are too many.
    pub fn new(
        components: &[Component<D>],
        background: Background,
        damping_1_s: f64,
    ) -> Result<Self, FieldError> {
        let count = components.len();
        let last = components.last().ok_or(FieldError::ComponentCount(0))?;
        if count > COMPONENT_CAPACITY {
            return Err(FieldError::ComponentCount(count));
        }
        let mut stored = [*last; COMPONENT_CAPACITY];
        stored[..count].copy_from_slice(components);
        Ok(Self {
            components: stored,
            count,
            background,
            background_density: background.exponent.exp(),
            goal: last.mean,
            damping_1_s,
        })
    }

    /// Its components, the last of which is the goal's.
    #[must_use]
    pub fn components(&self) -> &[Component<D>] {
        &self.components[..self.count]
    }

    /// The goal g \[m or rad\].
    #[must_use]
    pub fn goal(&self) -> SVector<f64, D> {
        self.goal
    }

    /// d in B = d M \[1/s\].
    #[must_use]
    pub fn damping_1_s(&self) -> f64 {
        self.damping_1_s
    }

    /// Evaluates the field at y for the velocity ẏ.
    ///
    /// Hot path: no allocation, O(K D²). Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn evaluate(&self, y: &SVector<f64, D>, velocity: &SVector<f64, D>) -> FieldValue<D> {
        // One pass gathers Σe, ΣeΛv and the sums the gradient of the weights needs:
        // ∇w_k = w_k (p̄ − Λ_k v_k) with p̄ = Σ_j w_j Λ_j v_j.
        let background = &self.background;
        let mut density = self.background_density;
        let mut pull_sum = SVector::<f64, D>::zeros();
        let mut potential = 0.0;
        let mut slope_sum = SVector::<f64, D>::zeros();
        let mut potential_pull = SVector::<f64, D>::zeros();
        let mut metric = SMatrix::<f64, D, D>::zeros();
        let mut momentum_rate = SVector::<f64, D>::zeros();
        let mut kinetic_pull = SVector::<f64, D>::zeros();
        for component in self.components() {
            let offset = y - component.mean;
            let pull = component.precision * offset;
            let activation = (-0.5 * offset.dot(&pull)).exp();
            let bend = component.hessian * offset;
            let local =
                component.potential + component.gradient.dot(&offset) + 0.5 * bend.dot(&offset);
            let momentum = component.metric * velocity;
            density += activation;
            pull_sum += pull * activation;
            potential += activation * local;
            slope_sum += (component.gradient + bend) * activation;
            potential_pull += pull * (activation * local);
            metric += component.metric * activation;
            momentum_rate += momentum * (activation * pull.dot(velocity));
            kinetic_pull += pull * (activation * momentum.dot(velocity));
        }
        let away = y - self.goal;
        let root = (away.dot(&away) + background.softening * background.softening).sqrt();
        let local = background.offset + background.slope * (root - background.softening);
        potential += self.background_density * local;
        slope_sum += away * (self.background_density * background.slope / root);
        for i in 0..D {
            metric[(i, i)] += self.background_density * background.metric;
        }

        let inverse = 1.0 / density;
        let mean_pull = pull_sum * inverse;
        let potential = potential * inverse;
        let metric = metric * inverse;
        let momentum = metric * velocity;
        let rate = momentum * mean_pull.dot(velocity) - momentum_rate * inverse;
        let kinetic = mean_pull * momentum.dot(velocity) - kinetic_pull * inverse;
        FieldValue {
            potential,
            gradient: slope_sum * inverse + mean_pull * potential - potential_pull * inverse,
            metric,
            curvature: rate - kinetic * 0.5,
            damping: metric * self.damping_1_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    fn field() -> Field<3> {
        let component = |i: usize| {
            let s = i as f64;
            let spread =
                Matrix3::new(6.0 + s, 0.5, 0.2 * s, 0.5, 4.0, -0.3, 0.2 * s, -0.3, 5.0 - 0.3 * s);
            Component {
                mean: Vector3::new(0.4 * s, 0.3 * (s - 2.0).powi(2), 0.1 * s),
                precision: spread,
                metric: spread * 0.25,
                potential: 5.0 - s,
                gradient: Vector3::new(-1.0 - 0.1 * s, 0.2, 0.1 * s),
                hessian: Matrix3::new(1.0, 0.3, 0.1 * s, 0.3, 2.0, -0.2, 0.1 * s, -0.2, 0.5),
            }
        };
        let components: Vec<_> = (0..5).map(component).collect();
        let background =
            Background { exponent: -10.0, metric: 1.2, offset: 2.0, slope: 3.0, softening: 0.3 };
        Field::new(&components, background, 8.0).unwrap()
    }

    fn points() -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> {
        (0..40).map(|i| {
            let s = f64::from(i);
            let y = Vector3::new((s * 0.7).sin(), (s * 1.3).cos(), 0.5 * (s * 0.31).sin());
            (y * 1.5, Vector3::new((s * 0.9).cos(), 0.6 * (s * 0.5).sin(), 0.8 - 0.03 * s))
        })
    }

    fn derivative(f: impl Fn(Vector3<f64>) -> f64, y: &Vector3<f64>) -> Vector3<f64> {
        let h = 1e-5;
        Vector3::from_fn(|i, _| {
            let mut step = Vector3::zeros();
            step[i] = h;
            (8.0 * (f(y + step) - f(y - step)) - (f(y + step * 2.0) - f(y - step * 2.0)))
                / (12.0 * h)
        })
    }

    #[test]
    fn gradient_is_the_derivative_of_the_potential() {
        let field = field();
        for (y, v) in points() {
            let value = field.evaluate(&y, &v);
            let expected = derivative(|y| field.evaluate(&y, &v).potential, &y);
            let error = (value.gradient - expected).norm();
            assert!(error < 1e-8 * (1.0 + expected.norm()), "{error:e}");
        }
    }

    #[test]
    fn curvature_is_that_of_the_metric() {
        let field = field();
        let h = 1e-5;
        for (y, v) in points() {
            let value = field.evaluate(&y, &v);
            let metric_at = |s: f64| field.evaluate(&(y + v * s), &v).metric * v;
            let rate = (metric_at(h) - metric_at(-h)) / (2.0 * h);
            let kinetic = derivative(|y| v.dot(&(field.evaluate(&y, &v).metric * v)), &y);
            let expected = rate - kinetic * 0.5;
            let error = (value.curvature - expected).norm();
            assert!(error < 1e-7 * (1.0 + expected.norm()), "{error:e}");
        }
    }

    #[test]
    fn metric_is_positive_definite_and_far_away_the_background_s() {
        let field = field();
        for (y, v) in points() {
            assert!(field.evaluate(&y, &v).metric.cholesky().is_some());
        }
        let far = field.evaluate(&Vector3::new(50.0, 0.0, 0.0), &Vector3::x());
        assert!((far.metric - Matrix3::identity() * 1.2).norm() < 1e-12);
        assert!((far.gradient.norm() - 3.0).abs() < 1e-3);
    }

    #[test]
    fn energy_falls_along_the_policy() {
        let field = field();
        let (mut y, mut v) = (Vector3::new(-0.8, 1.0, 0.4), Vector3::new(0.5, -0.5, 0.2));
        let dt = 1e-3;
        let acceleration = |y: &Vector3<f64>, v: &Vector3<f64>| {
            let value = field.evaluate(y, v);
            value.metric.cholesky().unwrap().solve(&value.force(v))
        };
        let mut before = field.evaluate(&y, &v).energy(&v);
        for _ in 0..4000 {
            // Midpoint rule: its error is far below the damping's loss per step.
            let half_v = v + acceleration(&y, &v) * (dt / 2.0);
            let half_y = y + v * (dt / 2.0);
            v += acceleration(&half_y, &half_v) * dt;
            y += half_v * dt;
            let after = field.evaluate(&y, &v).energy(&v);
            assert!(after <= before + 1e-9, "energy rose by {}", after - before);
            before = after;
        }
    }

    #[test]
    fn counts_outside_the_capacity_are_refused() {
        let field = field();
        let many = [field.components()[0]; COMPONENT_CAPACITY + 1];
        let error = |c: &[Component<3>]| Field::new(c, field.background, 8.0).unwrap_err();
        assert_eq!(error(&[]), FieldError::ComponentCount(0));
        assert_eq!(error(&many), FieldError::ComponentCount(COMPONENT_CAPACITY + 1));
    }
}
