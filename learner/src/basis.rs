//! Φ and ∇Φ as linear functions of the parameters p of a field.
//!
//! ```text
//! p = (φ⁰_k, g_k, S_k for each component k; S_G of the goal's; c₀, k₀ of the background)
//! Φ(y) = b(y)ᵀ p        ∇Φ(y) = G(y) p
//! ```
//!
//! S is symmetric: its upper triangle stands in p, row by row. The goal's component has no φ⁰ and
//! no g: that fixes the constant to which Φ is only determined, and keeps φ_G at rest at the goal.

use nalgebra::{SMatrix, SVector};
use tprmp_rmpflow::field::{Background, Component, Field};

/// The part of a field that is settled before the convex program: where its components are, how
/// wide, and with what metric. Potentials are zero in it.
#[derive(Clone, Debug)]
pub struct Shape<const D: usize> {
    components: Vec<Component<D>>,
    background: Background,
    damping_1_s: f64,
}

/// b(y) and G(y), one entry and one column a parameter.
#[derive(Clone, Debug)]
pub struct Basis<const D: usize> {
    /// b(y).
    pub value: Vec<f64>,
    /// The columns of G(y).
    pub gradient: Vec<SVector<f64, D>>,
}

/// How a parameter enters the field, for weighing it against others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// A potential, of the unit [u²/s²].
    Potential,
    /// An entry of a gradient [u/s²].
    Gradient,
    /// An entry of a Hessian [1/s²].
    Hessian,
    /// The background's offset c₀ [u²/s²].
    Offset,
    /// The background's slope k₀ [u/s²].
    Slope,
}

impl<const D: usize> Shape<D> {
    /// Entries of the upper triangle of a symmetric matrix.
    const TRIANGLE: usize = D * (D + 1) / 2;

    /// A shape; the potentials in `components` and `background` are disregarded, the last
    /// component is the goal's.
    ///
    /// # Panics
    /// When there is no component.
    #[must_use]
    pub fn new(
        mut components: Vec<Component<D>>,
        background: Background,
        damping_1_s: f64,
    ) -> Self {
        assert!(!components.is_empty(), "the goal has a component");
        for component in &mut components {
            component.potential = 0.0;
            component.gradient = SVector::zeros();
            component.hessian = SMatrix::zeros();
        }
        let background = Background { offset: 0.0, slope: 0.0, ..background };
        Self { components, background, damping_1_s }
    }

    /// The field for some parameters.
    ///
    /// # Panics
    /// When there are not [`Shape::parameters`] of them.
    #[must_use]
    pub fn field(&self, p: &[f64]) -> Field<D> {
        let (components, background) = self.with(p);
        Field::new(&components, background, self.damping_1_s)
            .expect("the number of components is checked where it is chosen")
    }

    /// Components and background for some parameters.
    ///
    /// # Panics
    /// When there are not [`Shape::parameters`] of them.
    #[must_use]
    pub fn with(&self, p: &[f64]) -> (Vec<Component<D>>, Background) {
        assert_eq!(p.len(), self.parameters().len(), "one number a parameter");
        let mut rest = p.iter().copied();
        let mut next = || rest.next().expect("their number was checked");
        let mut components = self.components.clone();
        let goal = components.len() - 1;
        for (k, component) in components.iter_mut().enumerate() {
            if k != goal {
                component.potential = next();
                component.gradient = SVector::from_fn(|_, _| next());
            }
            for a in 0..D {
                for b in a..D {
                    component.hessian[(a, b)] = next();
                    component.hessian[(b, a)] = component.hessian[(a, b)];
                }
            }
        }
        let background = Background { offset: next(), slope: next(), ..self.background };
        (components, background)
    }

    /// What each parameter is, in their order.
    #[must_use]
    pub fn parameters(&self) -> Vec<Parameter> {
        let mut parameters = Vec::new();
        for _ in 1..self.components.len() {
            parameters.push(Parameter::Potential);
            parameters.extend([Parameter::Gradient; D]);
            parameters.extend(std::iter::repeat_n(Parameter::Hessian, Self::TRIANGLE));
        }
        parameters.extend(std::iter::repeat_n(Parameter::Hessian, Self::TRIANGLE));
        parameters.extend([Parameter::Offset, Parameter::Slope]);
        parameters
    }

    /// Damping d.
    #[must_use]
    pub fn damping_1_s(&self) -> f64 {
        self.damping_1_s
    }

    /// The goal.
    #[must_use]
    pub fn goal(&self) -> SVector<f64, D> {
        self.components[self.components.len() - 1].mean
    }

    /// Mean over all metrics, the background's included, of a metric's mean eigenvalue.
    #[must_use]
    pub fn mean_metric(&self) -> f64 {
        let sum: f64 = self.components.iter().map(|c| c.metric.trace() / D as f64).sum();
        (sum + self.background.metric) / (self.components.len() + 1) as f64
    }

    /// b(y) and G(y).
    #[must_use]
    pub fn basis(&self, y: &SVector<f64, D>) -> Basis<D> {
        let offsets: Vec<_> = self.components.iter().map(|c| y - c.mean).collect();
        let pulls: Vec<_> =
            self.components.iter().zip(&offsets).map(|(c, v)| c.precision * v).collect();
        let mut weights: Vec<_> =
            offsets.iter().zip(&pulls).map(|(v, pull)| (-0.5 * v.dot(pull)).exp()).collect();
        let mut background_weight = self.background.exponent.exp();
        let density = weights.iter().sum::<f64>() + background_weight;
        weights.iter_mut().for_each(|w| *w /= density);
        background_weight /= density;
        let mean_pull: SVector<f64, D> =
            weights.iter().zip(&pulls).map(|(w, pull)| pull * *w).sum();

        // The gradient of w φ is φ ∇w + w ∇φ, with ∇w_k = w_k (Σ_j w_j Λ_j v_j − Λ_k v_k).
        let mut basis = Basis { value: Vec::new(), gradient: Vec::new() };
        let mut push = |w: f64, dw: &SVector<f64, D>, phi: f64, dphi: &SVector<f64, D>| {
            basis.value.push(w * phi);
            basis.gradient.push(dw * phi + dphi * w);
        };
        let zero = SVector::zeros();
        let goal = self.components.len() - 1;
        for (k, ((v, pull), w)) in offsets.iter().zip(&pulls).zip(&weights).enumerate() {
            let dw = (mean_pull - pull) * *w;
            if k != goal {
                push(*w, &dw, 1.0, &zero);
                for a in 0..D {
                    push(*w, &dw, v[a], &axis(a, 1.0));
                }
            }
            for a in 0..D {
                push(*w, &dw, 0.5 * v[a] * v[a], &axis(a, v[a]));
                for b in a + 1..D {
                    let slope = axis(a, v[b]) + axis(b, v[a]);
                    push(*w, &dw, v[a] * v[b], &slope);
                }
            }
        }
        let dw = mean_pull * background_weight;
        let softening = self.background.softening;
        let away = offsets[goal];
        let root = (away.norm_squared() + softening * softening).sqrt();
        push(background_weight, &dw, 1.0, &zero);
        push(background_weight, &dw, root - softening, &(away / root));
        basis
    }
}

/// A vector along one axis.
pub(crate) fn axis<const D: usize>(index: usize, length: f64) -> SVector<f64, D> {
    SVector::from_fn(|i, _| if i == index { length } else { 0.0 })
}

impl<const D: usize> Basis<D> {
    /// G p.
    #[must_use]
    pub fn gradient_of(&self, p: &[f64]) -> SVector<f64, D> {
        self.gradient.iter().zip(p).map(|(column, p)| column * *p).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use rand::{Rng, SeedableRng};

    fn random_shape() -> (Shape<3>, Vec<f64>, Vec<Vector3<f64>>) {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut number = move || random.random_range(-1.0..1.0);
        let components: Vec<_> = (0..5)
            .map(|_| {
                let root = Matrix3::from_fn(|_, _| number());
                let precision = root * root.transpose() + Matrix3::identity();
                Component {
                    mean: Vector3::from_fn(|_, _| number()),
                    precision,
                    metric: precision * 0.25,
                    potential: 0.0,
                    gradient: Vector3::zeros(),
                    hessian: Matrix3::zeros(),
                }
            })
            .collect();
        let background =
            Background { exponent: -6.0, metric: 0.5, offset: 0.0, slope: 0.0, softening: 0.3 };
        let shape = Shape::new(components, background, 8.0);
        let p = (0..shape.parameters().len()).map(|_| number()).collect();
        let points = (0..30).map(|_| Vector3::from_fn(|_, _| 2.0 * number())).collect();
        (shape, p, points)
    }

    #[test]
    fn basis_times_parameters_is_the_field() {
        let (shape, p, points) = random_shape();
        let field = shape.field(&p);
        for y in &points {
            let basis = shape.basis(y);
            let value = field.evaluate(y, &Vector3::zeros());
            let potential: f64 = basis.value.iter().zip(&p).map(|(b, p)| b * p).sum();
            assert!((potential - value.potential).abs() < 1e-13);
            assert!((basis.gradient_of(&p) - value.gradient).norm() < 1e-12);
        }
    }

    #[test]
    fn gradient_is_the_derivative_of_the_value() {
        let (shape, p, points) = random_shape();
        let h = 1e-5;
        for y in &points {
            let basis = shape.basis(y);
            for i in 0..3 {
                let step = Vector3::ith(i, h);
                let (after, before) = (shape.basis(&(y + step)), shape.basis(&(y - step)));
                for j in 0..p.len() {
                    let expected = (after.value[j] - before.value[j]) / (2.0 * h);
                    assert!((basis.gradient[j][i] - expected).abs() < 1e-8);
                }
            }
        }
    }
}
