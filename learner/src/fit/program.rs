//! The convex program of a field, in the parameters θ of [`basis`](crate::fit::basis): equation (8) of MATHEMATICS.md.
//!
//! ```text
//! minimise    Σ_i W_i ‖M⁻¹G_i θ + d v_i + a_i + M⁻¹ξ_i‖²/d² + τ/(N d) Σ_j ζ_j + λ ‖C θ‖²
//!             ‖r‖² = |r_y|² + χ r_s², with χ the phase's weight
//! subject to  ζ_j ≥ 0,  ζ_j ≥ ε d m_j + t̂_jᵀ M⁻¹ G_j θ               descent along the demonstrations
//!             G(g) θ = 0                                           the goal is at rest
//!             H(g) θ ⪰ h M(g)                                      and a strict minimum
//!             S_k,yy ⪰ h_y M_k,yy                                  one lowest point for each phase
//!             S_1,ss ≥ 0                                           the start holds the phase
//! ```
//!
//! A field that goes round has no goal, and no start: of the constraints, descent and those of S_k,yy are its own.
//!
//! For the two coordinates of the plane the matrix inequality is a second-order cone; otherwise it is
//! replaced by diagonal dominance, which is sufficient. The squares enter through their normal
//! equations, so that the solver sees as many variables as parameters and checked points, not as many as
//! samples.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use tprmp_model::skill_model::{
    ActiveConstraints, Constraints, Figure, Program, ProgramFit, ProgramStatus,
};
use tprmp_rmpflow::policy::canonical::field::Component;

use crate::fit::basis::{Parameter, Shape, axis};
use crate::fit::conic::{Affine, ConicProgram, Solution};
use crate::fit::error::{NotSolved, Reason};
use crate::fit::targets::{Descent, Target};
use crate::skill::FieldSettings;

/// A constraint is active when it holds with equality to this fraction of its bound.
const ACTIVE: f64 = 1e-4;
/// Every how many descent constraints the solver sees at first. Others join when they turn out violated,
/// so that the optimum is the same with any stride.
const WORKING_STRIDE: usize = 32;
/// After so many rounds all descent constraints are in: seldom are there more than five.
const WORKING_ROUNDS_MAX: u32 = 20;
/// Constraints that are met by less than this fraction of their speed join those that are violated:
/// likewise without a change of the optimum.
const MET: f64 = 0.05;
/// Step of the central difference for the Hessian at the goal [ŷ]: near the cube root of the precision of
/// a double.
const HESSIAN_STEP: f64 = 1e-4;

/// A solution p, how exact it is, and after how many iterations.
type Solved = (Vec<f64>, ProgramStatus, u32);

/// The program of one field.
pub(crate) struct FieldProgram<'a, const N: usize> {
    name: Program,
    shape: &'a Shape<N>,
    settings: &'a FieldSettings,
    residual: Quadratic,
    descents: Vec<DescentConstraint>,
    /// Descent constraints without the refined ones.
    checked: usize,
    /// Descent constraints that the solver sees.
    working: Vec<usize>,
    /// G(g); none where there is no goal.
    goal_gradient: Vec<SVector<f64, N>>,
    /// H(g) relative to M(g), one matrix a parameter; none where there is no goal.
    goal_hessian: Vec<SMatrix<f64, N, N>>,
    /// S_k,yy relative to M_k,yy: for each component its parameters and their matrices.
    stiffness: Vec<Stiffness>,
    /// The diagonal of C.
    weights: Vec<f64>,
}

/// pᵀ A p + 2 bᵀp + c.
struct Quadratic {
    /// The upper triangle of A.
    square: DMatrix<f64>,
    linear: DVector<f64>,
    constant: f64,
}

/// `slope` + `speed` ≤ its slack.
struct DescentConstraint {
    /// t̂ᵀM⁻¹G.
    row: Vec<f64>,
    /// ε d fraction.
    speed: f64,
    /// Factor of the slack in the objective.
    weight: f64,
}

impl DescentConstraint {
    /// t̂ᵀM⁻¹G p: the rise of the potential along the demonstrated direction.
    fn slope(&self, p: &[f64]) -> f64 {
        self.row.iter().zip(p).map(|(r, p)| r * p).sum()
    }
}

/// A symmetric matrix in the coordinates without the phase, linear in some parameters.
type Stiffness = Vec<(usize, DMatrix<f64>)>;

impl<'a, const N: usize> FieldProgram<'a, N> {
    /// The parameter S_1,ss: after φ⁰_1, g_1 and the other entries of S_1.
    const START_HOLD: usize = N + Shape::<N>::TRIANGLE;

    /// A program that compares with `targets`, and has a constraint at each of `descents`.
    ///
    /// # Errors
    /// A metric is not positive definite.
    pub(crate) fn new(
        name: Program,
        shape: &'a Shape<N>,
        targets: &[Target<N>],
        descents: &[Descent<N>],
        settings: &'a FieldSettings,
    ) -> Result<Self, Reason> {
        let (goal_gradient, goal_hessian) = match shape.round_length() {
            Some(_) => (Vec::new(), Vec::new()),
            None => {
                let goal = shape.goal();
                let metric = shape.bare().evaluate(&goal, &SVector::zeros()).metric;
                (shape.basis(&goal).gradient, goal_hessian(shape, &metric)?)
            }
        };
        let unit = 1.0 / (shape.mean_metric() * settings.damping_1_s);
        let length = settings.regularisation_length;
        let weight = |kind: &Parameter| match kind {
            Parameter::Potential => unit,
            Parameter::Gradient => unit * length,
            Parameter::Hessian => unit * length * length,
        };
        let mut program = Self {
            name,
            shape,
            settings,
            residual: normal_equations(shape, targets, settings)?,
            descents: Vec::with_capacity(descents.len()),
            checked: descents.len(),
            working: (0..descents.len()).step_by(WORKING_STRIDE).collect(),
            goal_gradient,
            goal_hessian,
            stiffness: stiffness(shape)?,
            weights: shape.parameters().iter().map(weight).collect(),
        };
        for descent in descents {
            program.constrain(descent, 1.0)?;
        }
        Ok(program)
    }

    /// Adds a descent constraint; `weight` is relative to that of a checked point.
    ///
    /// # Errors
    /// The metric there is not positive definite.
    pub(crate) fn constrain(&mut self, descent: &Descent<N>, weight: f64) -> Result<(), Reason> {
        let damping = self.settings.damping_1_s;
        let metric = self.shape.bare().evaluate(&descent.point, &SVector::zeros()).metric;
        let direction = inverse_metric(&metric)? * descent.direction;
        let gradient = self.shape.basis(&descent.point).gradient;
        let fraction = self.settings.descent_weight / (self.checked as f64 * damping);
        self.descents.push(DescentConstraint {
            row: gradient.iter().map(|column| direction.dot(column)).collect(),
            speed: self.settings.descent_speed * damping * descent.fraction,
            weight: fraction * weight,
        });
        Ok(())
    }

    /// Solves the program with the constraints that matter: those that are met anyway are left out, so
    /// that the solver sees a few hundred rows at most. Constraints that turn out violated join, until
    /// none is: then the optimum is that of the whole program. After some rounds all join.
    ///
    /// # Errors
    /// [`NotSolved`] when the solver finds no solution.
    pub(crate) fn solve(&mut self) -> Result<Solved, NotSolved> {
        let mut iterations = 0;
        for round in 1.. {
            let (p, status, more) = self.solve_working()?;
            iterations += more;
            let missing = |j: &usize, margin: f64| {
                let descent = &self.descents[*j];
                descent.slope(&p) + descent.speed * margin > 0.0
            };
            let joining: Vec<usize> = (0..self.descents.len())
                .filter(|j| !self.working.contains(j) && missing(j, 1.0 + MET))
                .collect();
            if !joining.iter().any(|j| missing(j, 1.0)) {
                return Ok((p, status, iterations));
            }
            if round == WORKING_ROUNDS_MAX {
                self.working = (0..self.descents.len()).collect();
            } else {
                self.working.extend(joining);
            }
        }
        unreachable!("with all constraints in the working set none joins")
    }

    /// Solves for x = (C p, s) with the constraints of the working set.
    fn solve_working(&self) -> Result<Solved, NotSolved> {
        let n = self.weights.len();
        let (square, weights) = (&self.residual.square, &self.weights);
        let quadratic = DMatrix::from_fn(n, n, |i, j| {
            let own = if i == j { 2.0 * self.settings.regularisation } else { 0.0 };
            2.0 * square[(i.min(j), i.max(j))] / (weights[i] * weights[j]) + own
        });
        let mut linear: Vec<f64> =
            self.residual.linear.iter().zip(weights).map(|(b, c)| 2.0 * b / c).collect();
        linear.extend(self.working.iter().map(|j| self.descents[*j].weight));

        let mut program = ConicProgram::new(quadratic, linear);
        let has_goal = !self.goal_gradient.is_empty();
        let mut nonnegative = Vec::new();
        if has_goal {
            let gradient = |i: usize| self.affine(0.0, |j| self.goal_gradient[j][i]);
            program.require_zero((0..N).map(gradient).collect());
            let hold = |j: usize| if j == Self::START_HOLD { 1.0 } else { 0.0 };
            nonnegative.push(self.affine(0.0, hold));
        }
        for (s, j) in self.working.iter().enumerate() {
            let DescentConstraint { row, speed, .. } = &self.descents[*j];
            nonnegative.push(Affine { constant: 0.0, coefficients: vec![(n + s, 1.0)] });
            let mut slack = self.affine(-speed, |j| -row[j]);
            slack.coefficients.push((n + s, 1.0));
            nonnegative.push(slack);
        }
        let hessian = |a: usize, b: usize| -> Vec<(usize, f64)> {
            self.goal_hessian.iter().map(|matrix| matrix[(a, b)]).enumerate().collect()
        };
        let least = self.settings.goal_hessian_min_1_s2;
        if has_goal {
            dominate(N, hessian, least, weights, &mut nonnegative);
        }
        self.require_stiffness(&mut program, &mut nonnegative);
        program.require_nonnegative(nonnegative);
        let Solution { status, iterations, x, .. } =
            program.solve().map_err(|failure| NotSolved::new(self.name, failure))?;
        Ok((x[..n].iter().zip(weights).map(|(x, c)| x / c).collect(), status, iterations))
    }

    /// h_y M_k,yy ⪯ S_k,yy ⪯ H_y M_k,yy, by cones of the program or by diagonal dominance.
    fn require_stiffness(&self, program: &mut ConicProgram, nonnegative: &mut Vec<Affine>) {
        let FieldSettings { stiffness_min_1_s2, stiffness_max_1_s2, .. } = *self.settings;
        // The least eigenvalue of S is no smaller than h, that of −S no smaller than −H.
        for (sign, least) in [(1.0, stiffness_min_1_s2), (-1.0, -stiffness_max_1_s2)] {
            for stiffness in &self.stiffness {
                let entries = |a: usize, b: usize| -> Vec<(usize, f64)> {
                    stiffness.iter().map(|(j, matrix)| (*j, sign * matrix[(a, b)])).collect()
                };
                if N == 3 {
                    // The smaller eigenvalue of a 2×2 matrix, exactly.
                    let trace_and_difference = |sign: f64| -> Vec<(usize, f64)> {
                        let second = entries(1, 1).into_iter().map(|(j, x)| (j, sign * x));
                        entries(0, 0).into_iter().chain(second).collect()
                    };
                    let twice = entries(0, 1).into_iter().map(|(j, x)| (j, 2.0 * x)).collect();
                    program.require_second_order(vec![
                        affine_of(-2.0 * least, trace_and_difference(1.0), &self.weights),
                        affine_of(0.0, trace_and_difference(-1.0), &self.weights),
                        affine_of(0.0, twice, &self.weights),
                    ]);
                } else {
                    dominate(N - 1, entries, least, &self.weights, nonnegative);
                }
            }
        }
    }

    /// Σ_j row(j) p_j + constant, as a function of x.
    fn affine(&self, constant: f64, row: impl Fn(usize) -> f64) -> Affine {
        let weights = self.weights.iter().enumerate();
        Affine { constant, coefficients: weights.map(|(j, c)| (j, row(j) / c)).collect() }
    }

    /// Removes what the solver's tolerance left of the gradient at the goal, by the smallest
    /// change of C p. Where there is no goal nothing is done.
    ///
    /// # Errors
    /// The parameters do not span every gradient at the goal, which S_G does but for numbers that are too
    /// large or too small.
    pub(crate) fn bring_goal_to_rest(&self, p: &mut [f64]) -> Result<(), Reason> {
        let columns = &self.goal_gradient;
        if columns.is_empty() {
            return Ok(());
        }
        let scaled = |j: usize| columns[j] / (self.weights[j] * self.weights[j]);
        let mut gram = SMatrix::<f64, N, N>::zeros();
        for (j, column) in columns.iter().enumerate() {
            gram += scaled(j) * column.transpose();
        }
        let factor = gram.cholesky().ok_or(Reason::Singular("the gradient at the goal"))?;
        // Twice: the second time takes away the rounding of the first.
        for _ in 0..2 {
            let left: SVector<f64, N> = columns.iter().zip(&*p).map(|(c, p)| c * *p).sum();
            let multiplier = factor.solve(&left);
            for (j, p) in p.iter_mut().enumerate() {
                *p -= scaled(j).dot(&multiplier);
            }
        }
        Ok(())
    }

    /// What is known of a solution.
    pub(crate) fn figures(&self, p: &[f64], status: ProgramStatus, iterations: u32) -> ProgramFit {
        let residual = self.residual.at(p);
        let slopes: Vec<f64> = self.descents.iter().map(|descent| descent.slope(p)).collect();
        let violations: Vec<f64> = std::iter::zip(&slopes, &self.descents)
            .map(|(slope, descent)| (slope + descent.speed).max(0.0))
            .collect();
        let checked = self.checked as f64;
        let hinge =
            violations[..self.checked].iter().sum::<f64>() / (checked * self.settings.damping_1_s);
        let slack: f64 =
            std::iter::zip(&violations, &self.descents).map(|(v, d)| v * d.weight).sum();
        let weighted: f64 = p.iter().zip(&self.weights).map(|(p, c)| (p * c).powi(2)).sum();
        let rising = slopes[..self.checked].iter().filter(|slope| **slope > 0.0).count();
        let violated = violations.iter().filter(|v| **v > 0.0).count();
        ProgramFit {
            name: self.name,
            status,
            iterations,
            objective: residual + slack + self.settings.regularisation * weighted,
            residual,
            active: self.active(p, violated, violations.len()),
            figures: vec![
                (Figure::Hinge, hinge),
                (Figure::AgainstDemonstrations, rising as f64 / checked),
            ],
        }
    }

    /// How many constraints of each kind hold with equality.
    fn active(&self, p: &[f64], violated: usize, descents: usize) -> Vec<ActiveConstraints> {
        let FieldSettings { goal_hessian_min_1_s2, stiffness_min_1_s2, .. } = *self.settings;
        let mut active = vec![ActiveConstraints {
            name: Constraints::Descent,
            active: violated as u32,
            count: descents as u32,
        }];
        if !self.goal_hessian.is_empty() {
            let dominance = self.dominance(p);
            active.push(tight(Constraints::GoalHessian, &dominance, goal_hessian_min_1_s2));
        }
        active.push(tight(Constraints::Stiffness, &self.least_stiffness(p), stiffness_min_1_s2));
        active
    }

    /// H_ii − Σ |H_ij| of each row of the Hessian at the goal [1/s²].
    fn dominance(&self, p: &[f64]) -> Vec<f64> {
        let hessian: SMatrix<f64, N, N> =
            self.goal_hessian.iter().zip(p).map(|(h, p)| h * *p).sum();
        let row = |i: usize| {
            let others = (0..N).filter(|j| *j != i).map(|j| hessian[(i, j)].abs());
            hessian[(i, i)] - others.sum::<f64>()
        };
        (0..N).map(row).collect()
    }

    /// Smallest eigenvalue of S_k,yy relative to M_k,yy of each component [1/s²].
    fn least_stiffness(&self, p: &[f64]) -> Vec<f64> {
        let least = |parts: &Stiffness| {
            let zero = DMatrix::zeros(N - 1, N - 1);
            let sum = parts.iter().fold(zero, |sum, (j, matrix)| sum + matrix * p[*j]);
            sum.symmetric_eigenvalues().min()
        };
        self.stiffness.iter().map(least).collect()
    }
}

impl Quadratic {
    fn at(&self, p: &[f64]) -> f64 {
        let p = DVector::from_column_slice(p);
        let mut square = self.square.clone();
        square.fill_lower_triangle_with_upper_triangle();
        p.dot(&(square * &p)) + 2.0 * self.linear.dot(&p) + self.constant
    }
}

/// How many of these values are at their bound.
fn tight(name: Constraints, values: &[f64], bound: f64) -> ActiveConstraints {
    let active = values.iter().filter(|value| **value <= bound * (1.0 + ACTIVE)).count();
    ActiveConstraints { name, active: active as u32, count: values.len() as u32 }
}

/// Σ W ‖M⁻¹G p + t‖²/d² over the targets, with t = d v + a + M⁻¹ξ.
fn normal_equations<const N: usize>(
    shape: &Shape<N>,
    targets: &[Target<N>],
    settings: &FieldSettings,
) -> Result<Quadratic, Reason> {
    let d = settings.damping_1_s;
    let n = shape.parameters().len();
    let bare = shape.bare();
    let mut square = DMatrix::zeros(n, n);
    let mut linear = DVector::zeros(n);
    let mut constant = 0.0;
    let mut row = vec![0.0; n];
    for target in targets {
        let weight = target.weight / (d * d);
        let value = bare.evaluate(&target.point, &target.velocity);
        let inverse = inverse_metric(&value.metric)?;
        let rest = target.velocity * d + target.acceleration + inverse * value.curvature;
        let gradient = shape.basis(&target.point).gradient;
        for i in 0..N {
            let weight = if i == N - 1 { weight * settings.phase_weight } else { weight };
            constant += weight * rest[i] * rest[i];
            for (entry, column) in row.iter_mut().zip(&gradient) {
                *entry = inverse.row(i).tr_dot(column);
            }
            accumulate(&mut square, &row, weight);
            for (sum, entry) in linear.iter_mut().zip(&row) {
                *sum += weight * rest[i] * entry;
            }
        }
    }
    Ok(Quadratic { square, linear, constant })
}

/// M⁻¹; a metric is a mixture of positive definite ones.
fn inverse_metric<const N: usize>(
    metric: &SMatrix<f64, N, N>,
) -> Result<SMatrix<f64, N, N>, Reason> {
    Ok(metric.cholesky().ok_or(Reason::Singular("a metric"))?.inverse())
}

/// Adds w r rᵀ to the upper triangle.
fn accumulate(square: &mut DMatrix<f64>, row: &[f64], weight: f64) {
    // Columns as slices: this loop is most of the work of a program.
    let columns = square.as_mut_slice().chunks_exact_mut(row.len());
    for ((j, entry), column) in row.iter().enumerate().zip(columns) {
        let scaled = weight * entry;
        for (sum, other) in column[..=j].iter_mut().zip(&row[..=j]) {
            *sum += scaled * other;
        }
    }
}

/// H(g) in coordinates in which M(g) is the identity, one matrix a parameter: the derivative of
/// G(y) by central differences.
fn goal_hessian<const N: usize>(
    shape: &Shape<N>,
    metric: &SMatrix<f64, N, N>,
) -> Result<Vec<SMatrix<f64, N, N>>, Reason> {
    let goal = shape.goal();
    let factor = metric.cholesky().ok_or(Reason::Singular("the metric of the goal"))?.l();
    let inverse = factor.try_inverse().ok_or(Reason::Singular("the metric of the goal"))?;
    let sides: Vec<_> = (0..N)
        .map(|i| {
            let step = axis::<N>(i, HESSIAN_STEP);
            (shape.basis(&(goal + step)).gradient, shape.basis(&(goal - step)).gradient)
        })
        .collect();
    let hessians = (0..shape.parameters().len()).map(|j| {
        let hessian = SMatrix::<f64, N, N>::from_fn(|a, i| {
            (sides[i].0[j][a] - sides[i].1[j][a]) / (2.0 * HESSIAN_STEP)
        });
        inverse * (hessian + hessian.transpose()) * 0.5 * inverse.transpose()
    });
    Ok(hessians.collect())
}

/// S_k,yy in coordinates in which M_k,yy is the identity, as a function of the parameters.
fn stiffness<const N: usize>(shape: &Shape<N>) -> Result<Vec<Stiffness>, Reason> {
    let d = N - 1;
    let each = |(k, component): (usize, &Component<N>)| {
        let metric = DMatrix::from_fn(d, d, |i, j| component.metric[(i, j)]);
        let factor = metric.cholesky().ok_or(Reason::Singular("a metric"))?.l();
        let inverse = factor.try_inverse().ok_or(Reason::Singular("a metric"))?;
        let mut j = shape.hessian_parameter(k);
        let mut parts = Vec::new();
        for a in 0..N {
            for b in a..N {
                if b < d {
                    let mut unit = DMatrix::zeros(d, d);
                    unit[(a, b)] = 1.0;
                    unit[(b, a)] = 1.0;
                    parts.push((j, &inverse * unit * inverse.transpose()));
                }
                j += 1;
            }
        }
        Ok(parts)
    };
    shape.components().iter().enumerate().map(each).collect()
}

/// Diagonal dominance of a symmetric matrix of `size`, H_ii − Σ |H_ij| ≥ least: one row for each choice
/// of signs. `entries` are the parameters that make an entry, with their factors.
fn dominate(
    size: usize,
    entries: impl Fn(usize, usize) -> Vec<(usize, f64)>,
    least: f64,
    weights: &[f64],
    rows: &mut Vec<Affine>,
) {
    for i in 0..size {
        for signs in 0..1_usize << (size - 1) {
            let mut coefficients = entries(i, i);
            for (bit, other) in (0..size).filter(|other| *other != i).enumerate() {
                let sign = if signs >> bit & 1 == 1 { 1.0 } else { -1.0 };
                coefficients.extend(entries(i, other).into_iter().map(|(j, x)| (j, sign * x)));
            }
            rows.push(affine_of(-least, coefficients, weights));
        }
    }
}

/// A function of x = C p from factors of p, of which one parameter may have several.
fn affine_of(constant: f64, mut factors: Vec<(usize, f64)>, weights: &[f64]) -> Affine {
    factors.sort_by_key(|(j, _)| *j);
    factors.dedup_by(|later, earlier| {
        let same = later.0 == earlier.0;
        if same {
            earlier.1 += later.1;
        }
        same
    });
    let coefficients = factors.into_iter().map(|(j, x)| (j, x / weights[j])).collect();
    Affine { constant, coefficients }
}
