//! Φ and ∇Φ as linear functions of the parameters p of a field.
//!
//! ```text
//! p = (φ⁰_k, g_k, S_k for each component k; S_G of the goal's)
//! Φ(z) = b(z)ᵀ p        ∇Φ(z) = G(z) p
//! ```
//!
//! Of a field that goes round, the parameters are those of the components of one round, none of which is a goal's, and
//! last D, by which the potential falls in a round: each copy of a component has its parameters, φ⁰ less its round
//! times D.
//!
//! S is symmetric: its upper triangle stands in p, row by row. The goal's component has no φ⁰ and
//! no g: that fixes the constant to which Φ is only determined, and keeps φ_G at rest at the goal.

use nalgebra::{SMatrix, SVector};
use tprmp_model::skill_model::{RoundCopy, copies};
use tprmp_rmpflow::policy::canonical::field::{Component, Field};
use tprmp_rmpflow::policy::canonical::rounds::in_round;

/// The part of a field on N coordinates, the phase the last of them, that is settled before the convex
/// program: where its components are, and with what metric.
#[derive(Clone, Debug)]
pub struct Shape<const N: usize> {
    /// The field without potentials.
    bare: Field<N>,
    /// Of a field that goes round.
    round: Option<Round<N>>,
}

/// One round of a field that goes round.
#[derive(Clone, Debug)]
struct Round<const N: usize> {
    components: Vec<Component<N>>,
    /// Which component each of the field's is, in which round.
    copies: Vec<RoundCopy>,
    /// Of a round in the last coordinate \[ŷ\].
    length: f64,
}

/// b(z) and G(z), one entry and one column a parameter.
#[derive(Clone, Debug)]
pub struct Basis<const N: usize> {
    /// b(z).
    pub value: Vec<f64>,
    /// The columns of G(z).
    pub gradient: Vec<SVector<f64, N>>,
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
}

impl<const N: usize> Shape<N> {
    /// Entries of the upper triangle of a symmetric matrix.
    pub const TRIANGLE: usize = N * (N + 1) / 2;

    /// A shape; the potentials in `components` are disregarded, the last component is the goal's.
    ///
    /// # Panics
    /// When there is no component, or more than a field holds.
    #[must_use]
    pub fn new(mut components: Vec<Component<N>>, phase_width: f64, damping_1_s: f64) -> Self {
        clear(&mut components);
        let bare = Field::new(&components, phase_width, damping_1_s)
            .expect("the number of components is checked where it is chosen");
        Self { bare, round: None }
    }

    /// The shape of a field that goes round, of the components of one round in order of their phases; the
    /// potentials in them are disregarded.
    ///
    /// * `length`  of a round in the last coordinate \[ŷ\]
    ///
    /// # Panics
    /// When they are, with their copies, none or more than a field holds.
    #[must_use]
    pub fn round(
        mut components: Vec<Component<N>>,
        phase_width: f64,
        damping_1_s: f64,
        length: f64,
    ) -> Self {
        clear(&mut components);
        let phases: Vec<f64> = components.iter().map(|c| c.mean[N - 1] / length).collect();
        let copies = copies(&phases, phase_width / length);
        let copied =
            |copy: &RoundCopy| in_round(&components[copy.component], copy.round, length, 0.0);
        let all: Vec<_> = copies.iter().map(copied).collect();
        let bare = Field::new(&all, phase_width, damping_1_s)
            .expect("the number of copies is checked where it is chosen");
        Self { bare, round: Some(Round { components, copies, length }) }
    }

    /// The length of a round in the last coordinate \[ŷ\]; `None` for a field with a goal.
    #[must_use]
    pub fn round_length(&self) -> Option<f64> {
        self.round.as_ref().map(|round| round.length)
    }

    /// What the phase one stands for in the last coordinate \[ŷ\].
    #[must_use]
    pub fn phase_length(&self) -> f64 {
        self.round_length().unwrap_or_else(|| self.goal()[N - 1])
    }

    /// The components that have parameters, without their copies.
    #[must_use]
    pub fn components(&self) -> &[Component<N>] {
        self.round.as_ref().map_or(self.bare.components(), |round| &round.components)
    }

    /// The first parameter of S_k.
    #[must_use]
    pub fn hessian_parameter(&self, k: usize) -> usize {
        let first = k * (1 + N + Self::TRIANGLE);
        let is_goal = self.round.is_none() && k + 1 == self.components().len();
        if is_goal { first } else { first + 1 + N }
    }

    /// The field without potentials.
    #[must_use]
    pub fn bare(&self) -> &Field<N> {
        &self.bare
    }

    /// The field for some parameters.
    ///
    /// # Panics
    /// When there are not [`Shape::parameters`] of them.
    #[must_use]
    pub fn field(&self, p: &[f64]) -> Field<N> {
        let bare = &self.bare;
        Field::new(&self.with(p), bare.phase_width(), bare.damping_1_s())
            .expect("there are as many components as before")
    }

    /// The components for some parameters.
    ///
    /// # Panics
    /// When there are not [`Shape::parameters`] of them.
    #[must_use]
    pub fn with(&self, p: &[f64]) -> Vec<Component<N>> {
        let (components, fall) = self.learned(p);
        let Some(round) = &self.round else { return components };
        let copied = |copy: &RoundCopy| {
            in_round(&components[copy.component], copy.round, round.length, fall)
        };
        round.copies.iter().map(copied).collect()
    }

    /// The components that have parameters, for some of them, and by how much the potential falls in a round; by 0
    /// for a field with a goal.
    ///
    /// # Panics
    /// When there are not [`Shape::parameters`] of them.
    #[must_use]
    pub fn learned(&self, p: &[f64]) -> (Vec<Component<N>>, f64) {
        assert_eq!(p.len(), self.parameters().len(), "one number a parameter");
        let mut rest = p.iter().copied();
        let mut next = || rest.next().expect("their number was checked");
        let mut components = self.components().to_vec();
        let goal = if self.round.is_some() { components.len() } else { components.len() - 1 };
        for (k, component) in components.iter_mut().enumerate() {
            if k != goal {
                component.potential = next();
                component.gradient = SVector::from_fn(|_, _| next());
            }
            for a in 0..N {
                for b in a..N {
                    component.hessian[(a, b)] = next();
                    component.hessian[(b, a)] = component.hessian[(a, b)];
                }
            }
        }
        (components, if self.round.is_some() { next() } else { 0.0 })
    }

    /// What each parameter is, in their order.
    #[must_use]
    pub fn parameters(&self) -> Vec<Parameter> {
        let mut parameters = Vec::new();
        let goals = usize::from(self.round.is_none());
        for _ in goals..self.components().len() {
            parameters.push(Parameter::Potential);
            parameters.extend([Parameter::Gradient; N]);
            parameters.extend(std::iter::repeat_n(Parameter::Hessian, Self::TRIANGLE));
        }
        if self.round.is_some() {
            parameters.push(Parameter::Potential);
            return parameters;
        }
        parameters.extend(std::iter::repeat_n(Parameter::Hessian, Self::TRIANGLE));
        parameters
    }

    /// The goal.
    #[must_use]
    pub fn goal(&self) -> SVector<f64, N> {
        self.bare.goal()
    }

    /// Mean over all components of a metric's mean eigenvalue.
    #[must_use]
    pub fn mean_metric(&self) -> f64 {
        let components = self.components();
        let sum: f64 = components.iter().map(|c| c.metric.trace() / N as f64).sum();
        sum / components.len() as f64
    }

    /// b(z) and G(z).
    #[must_use]
    pub fn basis(&self, z: &SVector<f64, N>) -> Basis<N> {
        // The gradient of w φ is φ ∇w + w ∇φ, and ∇w has only the phase's entry.
        let mut basis = Basis { value: Vec::new(), gradient: Vec::new() };
        let weights = self.bare.weights(z[N - 1]);
        let components = self.bare.components();
        if let Some(round) = &self.round {
            let count = self.parameters().len();
            basis.value = vec![0.0; count];
            basis.gradient = vec![SVector::zeros(); count];
            for (copy, (component, [w, dw])) in
                round.copies.iter().zip(components.iter().zip(&weights))
            {
                let mut at = copy.component * (1 + N + Self::TRIANGLE);
                polynomials(&(z - component.mean), false, |phi, dphi| {
                    basis.value[at] += w * phi;
                    basis.gradient[at] += axis::<N>(N - 1, dw * phi) + dphi * *w;
                    at += 1;
                });
                let rounds = f64::from(copy.round);
                basis.value[count - 1] -= w * rounds;
                basis.gradient[count - 1][N - 1] -= dw * rounds;
            }
            return basis;
        }
        for (k, (component, [w, dw])) in components.iter().zip(&weights).enumerate() {
            let is_goal = k + 1 == components.len();
            polynomials(&(z - component.mean), is_goal, |phi, dphi| {
                basis.value.push(w * phi);
                basis.gradient.push(axis::<N>(N - 1, dw * phi) + dphi * *w);
            });
        }
        basis
    }
}

/// The polynomials of v that a component's parameters multiply, with their gradients.
fn polynomials<const N: usize>(
    v: &SVector<f64, N>,
    is_goal: bool,
    mut push: impl FnMut(f64, SVector<f64, N>),
) {
    if !is_goal {
        push(1.0, SVector::zeros());
        for a in 0..N {
            push(v[a], axis(a, 1.0));
        }
    }
    for a in 0..N {
        push(0.5 * v[a] * v[a], axis(a, v[a]));
        for b in a + 1..N {
            push(v[a] * v[b], axis::<N>(a, v[b]) + axis(b, v[a]));
        }
    }
}

/// Without potentials.
fn clear<const N: usize>(components: &mut [Component<N>]) {
    for component in components {
        component.potential = 0.0;
        component.gradient = SVector::zeros();
        component.hessian = SMatrix::zeros();
    }
}

/// A vector along one axis.
pub fn axis<const N: usize>(index: usize, length: f64) -> SVector<f64, N> {
    SVector::from_fn(|i, _| if i == index { length } else { 0.0 })
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
                Component {
                    mean: Vector3::from_fn(|_, _| number()),
                    metric: root * root.transpose() + Matrix3::identity(),
                    potential: 0.0,
                    gradient: Vector3::zeros(),
                    hessian: Matrix3::zeros(),
                }
            })
            .collect();
        let shape = Shape::new(components, 0.4, 8.0);
        let p = (0..shape.parameters().len()).map(|_| number()).collect();
        let points = (0..30).map(|_| Vector3::from_fn(|_, _| 2.0 * number())).collect();
        (shape, p, points)
    }

    #[test]
    fn basis_times_parameters_is_the_field_that_goes_round() {
        let (shape, mut p, points) = random_shape();
        let mut components = shape.bare().components().to_vec();
        for (k, component) in components.iter_mut().enumerate() {
            component.mean[2] = 0.5 * k as f64 + 0.1;
        }
        let round = Shape::round(components, 0.3, 8.0, 2.5);
        let count = round.parameters().len();
        p.extend_from_within(..);
        p.truncate(count);
        for y in &points {
            let basis = round.basis(y);
            let value = round.field(&p).evaluate(y, &Vector3::zeros());
            let potential: f64 = basis.value.iter().zip(&p).map(|(b, p)| b * p).sum();
            assert!((potential - value.potential).abs() < 1e-12);
            let gradient: Vector3<f64> =
                basis.gradient.iter().zip(&p).map(|(column, p)| column * *p).sum();
            assert!((gradient - value.gradient).norm() < 1e-11);
        }
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
            let gradient: Vector3<f64> =
                basis.gradient.iter().zip(&p).map(|(column, p)| column * *p).sum();
            assert!((gradient - value.gradient).norm() < 1e-12);
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
