//! Fits the field of one block: a convex program in the parameters p of [`crate::fit::basis`].
//!
//! ```text
//! minimise    Σ_i W_i ‖M⁻¹G_i p + d v_i + a_i + M⁻¹ξ_i‖²/d² + ρ/(N d) Σ_j s_j + λ ‖C p‖²
//!             ‖r‖² = Σ r_y² + ω r_s², with ω the phase's weight
//! subject to  s_j ≥ 0,  s_j ≥ ε d fraction_j + t̂_jᵀ M⁻¹ G_j p        descent along the demonstrations
//!             G(g) p = 0                                           the goal is at rest
//!             H(g) p ⪰ h M(g)                                      and a strict minimum
//!             S_k,yy ⪰ h_y M_k,yy                                  one lowest point for each phase
//!             S_1,ss ≥ 0                                           the start holds the phase
//! ```
//!
//! For the two coordinates of the plane the matrix inequality is a second-order cone; otherwise it is
//! replaced by diagonal dominance, which is sufficient. The squares enter through their normal
//! equations, so that the solver sees as many variables as parameters and checked points, not as many as
//! samples.
//!
//! The demand of descent is soft, so that contradictory demonstrations still give a model. Where the
//! valley of the potential does not fall towards the goal, it is repeated with more weight, and the
//! program solved again.
//!
//! Everything is in normalised coordinates ẑ: ŷ, and last the phase times its length;
//! [`Fitted::physical`] scales back.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use rand::Rng;
use tprmp_model::skill_model::{
    ActiveConstraints, Constraints, FieldModel, Figure, Program, ProgramFit, ProgramStatus,
};
use tprmp_rmpflow::policy::canonical::field::Component;

use crate::fit::basis::{Parameter, Shape, axis};
use crate::fit::conic::{Affine, ConicProgram, Solution};
use crate::fit::error::NotSolved;
use crate::fit::targets::{BlockPath, Descent, Guide, Target, targets};
use crate::fit::valley;
use crate::skill::FieldSettings;

/// A constraint is active when it holds with equality to this fraction of its bound.
const ACTIVE: f64 = 1e-4;
/// Every how many demands the solver sees at first.
const WORKING_STRIDE: usize = 32;
/// Demands that are met by less than this fraction of their speed join those that are not met.
const MET: f64 = 0.05;
/// Weight of a demand of a repair against that of a checked point.
const REPAIR_WEIGHT: f64 = 30.0;
/// Points around a fault of the valley at which a repair demands descent.
const REPAIR_POINTS: u32 = 12;
/// Half the side of the box in which they lie [ŷ].
const REPAIR_RADIUS: f64 = 0.15;
/// Step of the central difference for the Hessian at the goal [ŷ].
const HESSIAN_STEP: f64 = 1e-4;

/// A fitted field in normalised coordinates.
#[derive(Clone, Debug)]
pub struct Fitted<const N: usize> {
    /// What was settled before.
    pub shape: Shape<N>,
    /// The parameters.
    pub parameters: Vec<f64>,
    /// Figures of the program.
    pub figures: ProgramFit,
}

/// The shape of a block's field from the mixture's means and covariances in ẑ.
///
/// M_k = γ (C_k + σ₀² I)⁻¹; the goal's metric is γ times the mean of det(M_k/γ)^{1/N}. Components pass
/// into each other over a fraction of the phase between two of them.
///
/// # Panics
/// When a covariance is not positive semi-definite.
#[must_use]
pub fn shape<const N: usize>(
    means: &[SVector<f64, N>],
    covariances: &[SMatrix<f64, N, N>],
    goal: &SVector<f64, N>,
    settings: &FieldSettings,
) -> Shape<N> {
    let identity = SMatrix::<f64, N, N>::identity();
    let component = |mean: SVector<f64, N>, metric| Component {
        mean,
        metric,
        potential: 0.0,
        gradient: SVector::zeros(),
        hessian: SMatrix::zeros(),
    };
    let mut components = Vec::with_capacity(means.len() + 1);
    let mut sizes = 0.0;
    for (mean, covariance) in means.iter().zip(covariances) {
        let widened = covariance + identity * settings.activation_width.powi(2);
        let factor = widened.cholesky().expect("a covariance is positive semi-definite");
        let inverse = factor.inverse();
        let precision = (inverse + inverse.transpose()) * 0.5;
        let root_determinant: f64 = factor.l().diagonal().iter().product();
        sizes += root_determinant.powf(-2.0 / N as f64);
        components.push(component(*mean, precision * settings.metric_scale));
    }
    let metric = settings.metric_scale * sizes / means.len() as f64;
    components.push(component(*goal, identity * metric));
    let phase_width = settings.phase_overlap * goal[N - 1] / means.len() as f64;
    Shape::new(components, phase_width, settings.damping_1_s)
}

/// Fits the field of a block.
///
/// # Errors
/// [`NotSolved`] when the solver finds no solution.
pub fn fit<const N: usize>(
    block: Program,
    shape: Shape<N>,
    paths: &[BlockPath<N>],
    settings: &FieldSettings,
    random: &mut impl Rng,
) -> Result<Fitted<N>, NotSolved> {
    let guide = Guide::new(paths, &shape.goal(), settings);
    let descents = guide.descents(random);
    let phase_length = shape.goal()[N - 1];
    let mut program = FieldProgram::new(&shape, &targets(paths, settings), &descents, settings);
    let mut repairs = 0;
    loop {
        let (mut parameters, status, iterations) = program.solve(block)?;
        program.bring_goal_to_rest(&mut parameters);
        let (_, faults) = valley::descent(&shape.field(&parameters), phase_length);
        if faults.is_empty() || repairs == settings.refinement_rounds_max {
            let mut figures = program.figures(block, &parameters, status, iterations);
            figures.figures.push((Figure::RefinementRounds, repairs as f64));
            figures.figures.push((Figure::ValleyFaults, faults.len() as f64));
            return Ok(Fitted { shape, parameters, figures });
        }
        // The demand was too weak there: repeat it louder, at and around the fault.
        for point in faults {
            program.demand(&shape, &guide.descent(point), settings, REPAIR_WEIGHT);
            for _ in 0..REPAIR_POINTS {
                let offset = SVector::from_fn(|_, _| random.random_range(-1.0..1.0));
                let beside = guide.descent(point + offset * REPAIR_RADIUS);
                program.demand(&shape, &beside, settings, REPAIR_WEIGHT);
            }
        }
        repairs += 1;
    }
}

/// The data of the convex program.
struct FieldProgram<const N: usize> {
    /// Σ W (M⁻¹G)ᵀ(M⁻¹G)/d².
    square: DMatrix<f64>,
    /// Σ W (M⁻¹G)ᵀ t /d², with t the rest of the residual.
    linear: DVector<f64>,
    /// Σ W |t|²/d².
    constant: f64,
    /// t̂ᵀM⁻¹G, one row a checked point.
    descent_rows: Vec<Vec<f64>>,
    /// ε d fraction.
    descent_speeds: Vec<f64>,
    /// Factors of the slacks in the objective.
    slack_weights: Vec<f64>,
    /// Checked points without those of the repairs.
    checked: usize,
    /// Demands that the solver sees.
    working: Vec<usize>,
    /// G(g).
    goal_gradient: Vec<SVector<f64, N>>,
    /// H(g) relative to M(g), one matrix a parameter.
    goal_hessian: Vec<SMatrix<f64, N, N>>,
    /// S_k,yy relative to M_k,yy: for each component its parameters and their matrices.
    stiffness: Vec<Stiffness>,
    /// The parameter S_1,ss.
    start_hold: usize,
    /// The diagonal of C.
    weights: Vec<f64>,
    damping: f64,
    hessian_min: f64,
    stiffness_min: f64,
    regularisation: f64,
}

/// A symmetric matrix in the coordinates without the phase, linear in some parameters.
type Stiffness = Vec<(usize, DMatrix<f64>)>;

impl<const N: usize> FieldProgram<N> {
    /// Entries of the upper triangle of a symmetric matrix.
    const TRIANGLE: usize = N * (N + 1) / 2;

    fn new(
        shape: &Shape<N>,
        targets: &[Target<N>],
        descents: &[Descent<N>],
        settings: &FieldSettings,
    ) -> Self {
        let d = settings.damping_1_s;
        let kinds = shape.parameters();
        let n = kinds.len();
        let bare = shape.bare();
        let zero = SVector::zeros();

        let mut square = DMatrix::zeros(n, n);
        let mut linear = DVector::zeros(n);
        let mut constant = 0.0;
        let mut row = vec![0.0; n];
        for target in targets {
            let weight = target.weight / (d * d);
            let value = bare.evaluate(&target.point, &target.velocity);
            let inverse = inverse_metric(&value.metric);
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

        let goal = shape.goal();
        let mean_metric = shape.mean_metric();
        let unit = 1.0 / (mean_metric * d);
        let length = settings.regularisation_length;
        let weights = kinds
            .iter()
            .map(|kind| match kind {
                Parameter::Potential => unit,
                Parameter::Gradient => unit * length,
                Parameter::Hessian => unit * length * length,
            })
            .collect();
        let mut program = Self {
            square,
            linear,
            constant,
            descent_rows: Vec::with_capacity(descents.len()),
            descent_speeds: Vec::with_capacity(descents.len()),
            slack_weights: Vec::with_capacity(descents.len()),
            checked: descents.len(),
            working: (0..descents.len()).step_by(WORKING_STRIDE).collect(),
            goal_gradient: shape.basis(&goal).gradient,
            goal_hessian: goal_hessian(shape, &bare.evaluate(&goal, &zero).metric),
            stiffness: stiffness(shape),
            start_hold: N + Self::TRIANGLE,
            weights,
            damping: d,
            hessian_min: settings.goal_hessian_min_1_s2,
            stiffness_min: settings.stiffness_min_1_s2,
            regularisation: settings.regularisation,
        };
        for descent in descents {
            program.demand(shape, descent, settings, 1.0);
        }
        program
    }

    /// Demands descent at a point; `loudness` is the weight against that of a checked point.
    fn demand(
        &mut self,
        shape: &Shape<N>,
        descent: &Descent<N>,
        settings: &FieldSettings,
        loudness: f64,
    ) {
        let metric = shape.bare().evaluate(&descent.point, &SVector::zeros()).metric;
        let direction = inverse_metric(&metric) * descent.direction;
        let gradient = shape.basis(&descent.point).gradient;
        self.descent_rows.push(gradient.iter().map(|column| direction.dot(column)).collect());
        self.descent_speeds.push(settings.descent_speed * self.damping * descent.fraction);
        let fraction = settings.descent_weight / (self.checked as f64 * self.damping);
        self.slack_weights.push(fraction * loudness);
    }

    /// Solves the program with the demands that matter: those that are met anyway are left out, so
    /// that the solver sees a few hundred rows at most. Demands that turn out violated join, until
    /// none is: then the optimum is that of the whole program. Returns p, the status and the
    /// iterations.
    fn solve(&mut self, block: Program) -> Result<(Vec<f64>, ProgramStatus, u32), NotSolved> {
        let mut iterations = 0;
        loop {
            let (p, status, more) = self.solve_working(block)?;
            iterations += more;
            let joining: Vec<usize> = (0..self.descent_rows.len())
                .filter(|j| !self.working.contains(j))
                .filter(|j| {
                    let rate: f64 = self.descent_rows[*j].iter().zip(&p).map(|(r, p)| r * p).sum();
                    rate + self.descent_speeds[*j] * (1.0 + MET) > 0.0
                })
                .collect();
            let violated = joining.iter().any(|j| {
                let row = &self.descent_rows[*j];
                let rate: f64 = row.iter().zip(&p).map(|(r, p)| r * p).sum();
                rate + self.descent_speeds[*j] > 0.0
            });
            if !violated {
                return Ok((p, status, iterations));
            }
            self.working.extend(joining);
        }
    }

    /// Solves for x = (C p, s) with the demands of the working set.
    fn solve_working(&self, block: Program) -> Result<(Vec<f64>, ProgramStatus, u32), NotSolved> {
        let n = self.weights.len();
        let weights = &self.weights;
        let quadratic = DMatrix::from_fn(n, n, |i, j| {
            let own = if i == j { 2.0 * self.regularisation } else { 0.0 };
            2.0 * self.square[(i.min(j), i.max(j))] / (weights[i] * weights[j]) + own
        });
        let mut linear: Vec<f64> =
            self.linear.iter().zip(weights).map(|(b, c)| 2.0 * b / c).collect();
        linear.extend(self.working.iter().map(|j| self.slack_weights[*j]));
        // Σ_j row(j) p_j + constant, as a function of x.
        let affine = |constant: f64, row: &dyn Fn(usize) -> f64| Affine {
            constant,
            coefficients: (0..n).map(|j| (j, row(j) / weights[j])).collect(),
        };
        let single =
            |j: usize, constant: f64| affine(constant, &|other| if other == j { 1.0 } else { 0.0 });

        let mut program = ConicProgram::new(quadratic, linear);
        program.require_zero((0..N).map(|i| affine(0.0, &|j| self.goal_gradient[j][i])).collect());
        let mut nonnegative = vec![single(self.start_hold, 0.0)];
        for (s, j) in self.working.iter().enumerate() {
            let (row, speed) = (&self.descent_rows[*j], self.descent_speeds[*j]);
            nonnegative.push(Affine { constant: 0.0, coefficients: vec![(n + s, 1.0)] });
            let mut violated = affine(-speed, &|j| -row[j]);
            violated.coefficients.push((n + s, 1.0));
            nonnegative.push(violated);
        }
        let hessian = |a: usize, b: usize| {
            let entry = |(j, matrix): (usize, &SMatrix<f64, N, N>)| (j, matrix[(a, b)]);
            self.goal_hessian.iter().enumerate().map(entry).collect()
        };
        dominate(N, &hessian, self.hessian_min, weights, &mut nonnegative);
        for stiffness in &self.stiffness {
            let entries = |a: usize, b: usize| -> Vec<(usize, f64)> {
                stiffness.iter().map(|(j, matrix)| (*j, matrix[(a, b)])).collect()
            };
            if N == 3 {
                // The smaller eigenvalue of a 2×2 matrix, exactly.
                let trace_and_difference = |sign: f64| -> Vec<(usize, f64)> {
                    let second = entries(1, 1).into_iter().map(|(j, x)| (j, sign * x));
                    entries(0, 0).into_iter().chain(second).collect()
                };
                let twice = entries(0, 1).into_iter().map(|(j, x)| (j, 2.0 * x)).collect();
                program.require_second_order(vec![
                    affine_of(-2.0 * self.stiffness_min, trace_and_difference(1.0), weights),
                    affine_of(0.0, trace_and_difference(-1.0), weights),
                    affine_of(0.0, twice, weights),
                ]);
            } else {
                dominate(N - 1, &entries, self.stiffness_min, weights, &mut nonnegative);
            }
        }
        program.require_nonnegative(nonnegative);

        let Solution { status, iterations, x, .. } =
            program.solve().map_err(|failure| NotSolved::new(block, failure))?;
        Ok((x[..n].iter().zip(weights).map(|(x, c)| x / c).collect(), status, iterations))
    }

    /// Removes what the solver's tolerance left of the gradient at the goal, by the smallest
    /// change of C p.
    fn bring_goal_to_rest(&self, p: &mut [f64]) {
        let columns = &self.goal_gradient;
        let scaled = |j: usize| columns[j] / (self.weights[j] * self.weights[j]);
        let mut gram = SMatrix::<f64, N, N>::zeros();
        for (j, column) in columns.iter().enumerate() {
            gram += scaled(j) * column.transpose();
        }
        let factor = gram.cholesky().expect("parameters span every gradient at the goal");
        // Twice: the second time takes away the rounding of the first.
        for _ in 0..2 {
            let left: SVector<f64, N> = columns.iter().zip(&*p).map(|(c, p)| c * *p).sum();
            let multiplier = factor.solve(&left);
            for (j, p) in p.iter_mut().enumerate() {
                *p -= scaled(j).dot(&multiplier);
            }
        }
    }

    fn figures(
        &self,
        name: Program,
        p: &[f64],
        status: ProgramStatus,
        iterations: u32,
    ) -> ProgramFit {
        let vector = DVector::from_column_slice(p);
        let mut square = self.square.clone();
        square.fill_lower_triangle_with_upper_triangle();
        let residual =
            vector.dot(&(square * &vector)) + 2.0 * self.linear.dot(&vector) + self.constant;
        let slopes: Vec<f64> = self
            .descent_rows
            .iter()
            .map(|row| row.iter().zip(p).map(|(r, p)| r * p).sum())
            .collect();
        let violations: Vec<f64> = slopes
            .iter()
            .zip(&self.descent_speeds)
            .map(|(r, speed)| (r + speed).max(0.0))
            .collect();
        let checked = self.checked as f64;
        let hinge = violations[..self.checked].iter().sum::<f64>() / (checked * self.damping);
        let slack: f64 = violations.iter().zip(&self.slack_weights).map(|(v, w)| v * w).sum();
        let weighted: f64 = p.iter().zip(&self.weights).map(|(p, c)| (p * c).powi(2)).sum();
        let hessian: SMatrix<f64, N, N> =
            self.goal_hessian.iter().zip(p).map(|(h, p)| h * *p).sum();
        let least = (0..N).map(|i| {
            let others = (0..N).filter(|j| *j != i).map(|j| hessian[(i, j)].abs());
            hessian[(i, i)] - others.sum::<f64>()
        });
        let least: Vec<f64> = least.collect();
        let stiffness: Vec<f64> = self
            .stiffness
            .iter()
            .map(|parts| {
                let sum =
                    |sum: DMatrix<f64>, (j, matrix): &(usize, DMatrix<f64>)| sum + matrix * p[*j];
                let zero = DMatrix::zeros(N - 1, N - 1);
                parts.iter().fold(zero, sum).symmetric_eigenvalues().min()
            })
            .collect();
        let violated = slopes[..self.checked].iter().filter(|r| **r > 0.0).count();
        let active = |name: Constraints, active: usize, count: usize| ActiveConstraints {
            name,
            active: active as u32,
            count: count as u32,
        };
        let tight = |value: f64, bound: f64| value <= bound * (1.0 + ACTIVE);
        ProgramFit {
            name,
            status,
            iterations,
            objective: residual + slack + self.regularisation * weighted,
            residual,
            active: vec![
                active(
                    Constraints::Descent,
                    violations.iter().filter(|v| **v > 0.0).count(),
                    violations.len(),
                ),
                active(
                    Constraints::GoalHessian,
                    least.iter().filter(|h| tight(**h, self.hessian_min)).count(),
                    least.len(),
                ),
                active(
                    Constraints::Stiffness,
                    stiffness.iter().filter(|h| tight(**h, self.stiffness_min)).count(),
                    stiffness.len(),
                ),
            ],
            figures: vec![
                (Figure::Hinge, hinge),
                (Figure::AgainstDemonstrations, violated as f64 / checked),
            ],
        }
    }
}

/// M⁻¹; a metric is a mixture of positive definite ones.
fn inverse_metric<const N: usize>(metric: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    metric.cholesky().expect("a metric is positive definite").inverse()
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
) -> Vec<SMatrix<f64, N, N>> {
    let goal = shape.goal();
    let factor = metric.cholesky().expect("a metric is positive definite").l();
    let inverse = factor.try_inverse().expect("its factor has a positive diagonal");
    let sides: Vec<_> = (0..N)
        .map(|i| {
            let step = axis::<N>(i, HESSIAN_STEP);
            (shape.basis(&(goal + step)).gradient, shape.basis(&(goal - step)).gradient)
        })
        .collect();
    (0..shape.parameters().len())
        .map(|j| {
            let hessian = SMatrix::<f64, N, N>::from_fn(|a, i| {
                (sides[i].0[j][a] - sides[i].1[j][a]) / (2.0 * HESSIAN_STEP)
            });
            inverse * (hessian + hessian.transpose()) * 0.5 * inverse.transpose()
        })
        .collect()
}

/// S_k,yy in coordinates in which M_k,yy is the identity, as a function of the parameters.
fn stiffness<const N: usize>(shape: &Shape<N>) -> Vec<Stiffness> {
    let d = N - 1;
    let triangle = N * (N + 1) / 2;
    let components = shape.bare().components();
    let each = |(k, component): (usize, &Component<N>)| {
        let metric = DMatrix::from_fn(d, d, |i, j| component.metric[(i, j)]);
        let factor = metric.cholesky().expect("a metric is positive definite").l();
        let inverse = factor.try_inverse().expect("its factor has a positive diagonal");
        // Each component but the goal's has φ⁰ and g before its S.
        let mut j = k * (1 + N + triangle);
        if k + 1 != components.len() {
            j += 1 + N;
        }
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
        parts
    };
    components.iter().enumerate().map(each).collect()
}

/// Diagonal dominance of a symmetric matrix of `size`, H_ii − Σ |H_ij| ≥ least: one row for each choice
/// of signs. `entries` are the parameters that make an entry, with their factors.
fn dominate(
    size: usize,
    entries: &dyn Fn(usize, usize) -> Vec<(usize, f64)>,
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

impl<const N: usize> Fitted<N> {
    /// The field in physical coordinates, divided by the goal's metric: y = ŷ/s, and the phase from 0 to
    /// 1.
    ///
    /// With ẑ = T z, T diagonal, Φ(z) = c Φ̂(T z) and M(z) = c T M̂(T z) T give the same accelerations for
    /// any c; c = 1/(s² m_G) makes M_G the identity in y.
    #[must_use]
    pub fn physical(&self, length_scale: f64) -> (FieldModel, ProgramFit) {
        let s = length_scale;
        let phase_length = self.shape.goal()[N - 1];
        let scales = SVector::<f64, N>::from_fn(|i, _| if i + 1 < N { s } else { phase_length });
        let mut components = self.shape.with(&self.parameters);
        let goal_metric = components[components.len() - 1].metric[(0, 0)];
        let c = 1.0 / (s * s * goal_metric);
        let both = scales * scales.transpose() * c;
        for component in &mut components {
            component.mean.component_div_assign(&scales);
            component.metric.component_mul_assign(&both);
            component.potential *= c;
            component.gradient.component_mul_assign(&(scales * c));
            component.hessian.component_mul_assign(&both);
        }
        let bare = self.shape.bare();
        let width = bare.phase_width() / phase_length;
        let field = FieldModel::from_parts(&components, width, bare.damping_1_s());
        let mut figures = self.figures.clone();
        figures.figures.push((Figure::LengthScale, s));
        figures.figures.push((Figure::PhaseLength, phase_length));
        (field, figures)
    }
}
