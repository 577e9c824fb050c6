//! Fits the field of one block: a convex program in the parameters p of [`crate::basis`].
//!
//! ```text
//! minimise    Σ_i W_i ‖M⁻¹G_i p + d v_i + a_i + M⁻¹ξ_i‖²/d² + ρ/(N d) Σ_j s_j + λ ‖C p‖²
//! subject to  s_j ≥ 0,  s_j ≥ ε d share_j + t̂_jᵀ M⁻¹ G_j p        descent along the demonstrations
//!             G(g) p = 0                                           the goal is at rest
//!             H(g) p ⪰ h M(g)                                      and a strict minimum
//!             k₀ ≥ k_min m̄ d,  c₀ ≥ 0                              Φ is radially unbounded
//! ```
//!
//! In the plane the matrix inequality is a second-order cone; in space it is replaced by diagonal
//! dominance, which is sufficient. The squares enter through their normal equations, so that the
//! solver sees as many variables as parameters and checked points, not as many as samples.
//!
//! The demand of descent is soft, so that contradictory demonstrations still give a model. Where it
//! leaves an attractor besides the goal, it is repeated with more weight, and the program solved
//! again.
//!
//! Everything is in normalised coordinates ŷ; [`Fitted::physical`] scales back.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use rand::Rng;
use tprmp_model::skill_model::{ActiveConstraints, FieldModel, ProgramFit};
use tprmp_rmpflow::field::{Background, Component};

use crate::attractors::stray_attractors;
use crate::basis::{Parameter, Shape, axis};
use crate::conic::{Affine, ConicProgram, Solution};
use crate::error::LearnerError;
use crate::skill::FieldSettings;
use crate::targets::{BlockPath, Descent, Guide, Target, targets};

/// Figure: how often the program was solved again to take away stray attractors.
const REPAIRS: &str = "repairs";
/// Figure: attractors besides the goal that were found and are left.
pub const STRAY_ATTRACTORS: &str = "stray attractors";
/// A constraint is active when it holds with equality to this share of its bound.
const ACTIVE: f64 = 1e-4;
/// Bound on the repairs of a fit.
const REPAIRS_MAX: u32 = 4;
/// Every how many demands the solver sees at first.
const WORKING_STRIDE: usize = 32;
/// Demands that are met by less than this share of their speed join those that are not met.
const MET: f64 = 0.05;
/// Weight of a demand of a repair against that of a checked point.
const REPAIR_WEIGHT: f64 = 30.0;
/// Points around a stray attractor at which a repair demands descent.
const REPAIR_POINTS: u32 = 12;
/// Half the side of the box in which they lie [ŷ].
const REPAIR_RADIUS: f64 = 0.15;
/// Random starts of the search for stray attractors, besides the checked points.
const STRAY_STARTS: u32 = 300;
/// Margin of their box, in margins of the grid.
const STRAY_MARGIN: f64 = 1.5;
/// Step of the central difference for the Hessian at the goal [ŷ].
const HESSIAN_STEP: f64 = 1e-4;

/// A fitted field in normalised coordinates.
#[derive(Clone, Debug)]
pub struct Fitted<const D: usize> {
    /// What was settled before.
    pub shape: Shape<D>,
    /// The parameters.
    pub parameters: Vec<f64>,
    /// Figures of the program.
    pub figures: ProgramFit,
}

/// The shape of a block's field from the mixture's means and covariances.
///
/// Λ_k = (C_k + σ₀² I)⁻¹, M_k = γ Λ_k; the goal's and the background's metric is γ times the mean
/// of det(Λ_k)^{1/D}.
///
/// # Panics
/// When a covariance is not positive semi-definite.
#[must_use]
pub fn shape<const D: usize>(
    means: &[SVector<f64, D>],
    covariances: &[SMatrix<f64, D, D>],
    goal: &SVector<f64, D>,
    settings: &FieldSettings,
) -> Shape<D> {
    let identity = SMatrix::<f64, D, D>::identity();
    let component = |mean: SVector<f64, D>, precision, metric| Component {
        mean,
        precision,
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
        sizes += root_determinant.powf(-2.0 / D as f64);
        components.push(component(*mean, precision, precision * settings.metric_scale));
    }
    let metric = settings.metric_scale * sizes / means.len() as f64;
    let goal_precision = identity / settings.goal_width.powi(2);
    components.push(component(*goal, goal_precision, identity * metric));
    let background = Background {
        exponent: -0.5 * settings.background_distance.powi(2),
        metric,
        offset: 0.0,
        slope: 0.0,
        softening: settings.softening,
    };
    Shape::new(components, background, settings.damping_1_s)
}

/// Fits the field of a block.
///
/// # Errors
/// [`LearnerError::NotSolved`] when the solver finds no solution.
pub fn fit<const D: usize>(
    block: &'static str,
    shape: Shape<D>,
    paths: &[BlockPath<D>],
    settings: &FieldSettings,
    random: &mut impl Rng,
) -> Result<Fitted<D>, LearnerError> {
    let guide = Guide::new(paths, &shape.goal(), settings);
    let descents = guide.descents(random);
    let mut starts: Vec<_> = descents.iter().map(|descent| descent.point).collect();
    let margin = STRAY_MARGIN * settings.grid_margin;
    starts.extend((0..STRAY_STARTS).map(|_| guide.random_point(margin, random)));

    let mut program = Program::new(&shape, &targets(paths, settings), &descents, settings);
    let mut repairs = 0;
    loop {
        let (mut parameters, status, iterations) = program.solve(block)?;
        program.bring_goal_to_rest(&mut parameters);
        let stray = stray_attractors(&shape.field(&parameters), &starts);
        if stray.is_empty() || repairs == REPAIRS_MAX {
            let mut figures = program.figures(block, &parameters, status, iterations);
            figures.figures.push((REPAIRS.into(), f64::from(repairs)));
            figures.figures.push((STRAY_ATTRACTORS.into(), stray.len() as f64));
            return Ok(Fitted { shape, parameters, figures });
        }
        // The demand was too weak there: repeat it louder, at and around the stray attractor.
        for point in stray {
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
struct Program<const D: usize> {
    /// Σ W (M⁻¹G)ᵀ(M⁻¹G)/d².
    square: DMatrix<f64>,
    /// Σ W (M⁻¹G)ᵀ t /d², with t the rest of the residual.
    linear: DVector<f64>,
    /// Σ W |t|²/d².
    constant: f64,
    /// t̂ᵀM⁻¹G, one row a checked point.
    descent_rows: Vec<Vec<f64>>,
    /// ε d share.
    descent_speeds: Vec<f64>,
    /// Factors of the slacks in the objective.
    slack_weights: Vec<f64>,
    /// Checked points without those of the repairs.
    checked: usize,
    /// Demands that the solver sees.
    working: Vec<usize>,
    /// G(g).
    goal_gradient: Vec<SVector<f64, D>>,
    /// H(g) relative to M(g), one matrix a parameter.
    goal_hessian: Vec<SMatrix<f64, D, D>>,
    /// Least k₀.
    slope_min: f64,
    /// The diagonal of C.
    weights: Vec<f64>,
    damping: f64,
    hessian_min: f64,
    regularisation: f64,
}

impl<const D: usize> Program<D> {
    fn new(
        shape: &Shape<D>,
        targets: &[Target<D>],
        descents: &[Descent<D>],
        settings: &FieldSettings,
    ) -> Self {
        let d = settings.damping_1_s;
        let kinds = shape.parameters();
        let n = kinds.len();
        let bare = shape.field(&vec![0.0; n]);
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
            constant += weight * rest.norm_squared();
            let gradient = shape.basis(&target.point).gradient;
            for i in 0..D {
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
                Parameter::Potential | Parameter::Offset | Parameter::Slope => unit,
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
            slope_min: settings.background_slope_min * mean_metric * d,
            weights,
            damping: d,
            hessian_min: settings.goal_hessian_min_1_s2,
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
        shape: &Shape<D>,
        descent: &Descent<D>,
        settings: &FieldSettings,
        loudness: f64,
    ) {
        let bare = shape.field(&vec![0.0; self.weights.len()]);
        let metric = bare.evaluate(&descent.point, &SVector::zeros()).metric;
        let direction = inverse_metric(&metric) * descent.direction;
        let gradient = shape.basis(&descent.point).gradient;
        self.descent_rows.push(gradient.iter().map(|column| direction.dot(column)).collect());
        self.descent_speeds.push(settings.descent_speed * self.damping * descent.share);
        let share = settings.descent_weight / (self.checked as f64 * self.damping);
        self.slack_weights.push(share * loudness);
    }

    /// Solves the program with the demands that matter: those that are met anyway are left out, so
    /// that the solver sees a few hundred rows at most. Demands that turn out violated join, until
    /// none is: then the optimum is that of the whole program. Returns p, the status and the
    /// iterations.
    fn solve(&mut self, block: &'static str) -> Result<(Vec<f64>, String, u32), LearnerError> {
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
    fn solve_working(&self, block: &'static str) -> Result<(Vec<f64>, String, u32), LearnerError> {
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
        program.require_zero((0..D).map(|i| affine(0.0, &|j| self.goal_gradient[j][i])).collect());
        let mut nonnegative = vec![single(n - 2, 0.0), single(n - 1, -self.slope_min)];
        for (s, j) in self.working.iter().enumerate() {
            let (row, speed) = (&self.descent_rows[*j], self.descent_speeds[*j]);
            nonnegative.push(Affine { constant: 0.0, coefficients: vec![(n + s, 1.0)] });
            let mut violated = affine(-speed, &|j| -row[j]);
            violated.coefficients.push((n + s, 1.0));
            nonnegative.push(violated);
        }
        let hessian = |j: usize, a: usize, b: usize| self.goal_hessian[j][(a, b)];
        let least = self.hessian_min;
        if D == 2 {
            program.require_second_order(vec![
                affine(-2.0 * least, &|j| hessian(j, 0, 0) + hessian(j, 1, 1)),
                affine(0.0, &|j| hessian(j, 0, 0) - hessian(j, 1, 1)),
                affine(0.0, &|j| 2.0 * hessian(j, 0, 1)),
            ]);
        } else {
            // Diagonal dominance, H_ii − Σ |H_ij| ≥ h: one row for each choice of signs.
            for i in 0..D {
                for signs in 0..1_usize << (D - 1) {
                    nonnegative.push(affine(-least, &|j| {
                        let others = (0..D).filter(|other| *other != i).enumerate();
                        let signed = others.map(|(bit, other)| {
                            let sign = if signs >> bit & 1 == 1 { 1.0 } else { -1.0 };
                            sign * hessian(j, i, other)
                        });
                        hessian(j, i, i) + signed.sum::<f64>()
                    }));
                }
            }
        }
        program.require_nonnegative(nonnegative);

        let Solution { usable, status, iterations, x, .. } = program.solve();
        if !usable {
            return Err(LearnerError::NotSolved {
                program: block,
                status,
                iterations,
                causes: Vec::new(),
            });
        }
        Ok((x[..n].iter().zip(weights).map(|(x, c)| x / c).collect(), status, iterations))
    }

    /// Removes what the solver's tolerance left of the gradient at the goal, by the smallest
    /// change of C p.
    fn bring_goal_to_rest(&self, p: &mut [f64]) {
        let columns = &self.goal_gradient;
        let scaled = |j: usize| columns[j] / (self.weights[j] * self.weights[j]);
        let mut gram = SMatrix::<f64, D, D>::zeros();
        for (j, column) in columns.iter().enumerate() {
            gram += scaled(j) * column.transpose();
        }
        let factor = gram.cholesky().expect("parameters span every gradient at the goal");
        // Twice: the second time takes away the rounding of the first.
        for _ in 0..2 {
            let left: SVector<f64, D> = columns.iter().zip(&*p).map(|(c, p)| c * *p).sum();
            let multiplier = factor.solve(&left);
            for (j, p) in p.iter_mut().enumerate() {
                *p -= scaled(j).dot(&multiplier);
            }
        }
    }

    fn figures(&self, name: &str, p: &[f64], status: String, iterations: u32) -> ProgramFit {
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
        let hessian: SMatrix<f64, D, D> =
            self.goal_hessian.iter().zip(p).map(|(h, p)| h * *p).sum();
        let least = (0..D).map(|i| {
            let others = (0..D).filter(|j| *j != i).map(|j| hessian[(i, j)].abs());
            hessian[(i, i)] - others.sum::<f64>()
        });
        // In the plane the smallest eigenvalue is constrained, in space each row's dominance.
        let least: Vec<f64> = if D == 2 {
            let dense = DMatrix::from_fn(D, D, |i, j| hessian[(i, j)]);
            vec![dense.symmetric_eigenvalues().min()]
        } else {
            least.collect()
        };
        let violated = slopes[..self.checked].iter().filter(|r| **r > 0.0).count();
        let active = |name: &str, active: usize, count: usize| ActiveConstraints {
            name: name.into(),
            active: active as u32,
            count: count as u32,
        };
        let [offset, slope] = [p[p.len() - 2], p[p.len() - 1]];
        let tight = |value: f64, bound: f64| value <= bound * (1.0 + ACTIVE);
        ProgramFit {
            name: name.into(),
            status,
            iterations,
            objective: residual + slack + self.regularisation * weighted,
            residual,
            active: vec![
                active(
                    "descent along the demonstrations",
                    violations.iter().filter(|v| **v > 0.0).count(),
                    violations.len(),
                ),
                active(
                    "Hessian at the goal",
                    least.iter().filter(|h| tight(**h, self.hessian_min)).count(),
                    least.len(),
                ),
                active("slope of the background", usize::from(tight(slope, self.slope_min)), 1),
                active(
                    "offset of the background",
                    usize::from(tight(offset, ACTIVE * self.slope_min)),
                    1,
                ),
            ],
            figures: vec![
                ("hinge".into(), hinge),
                ("share against the demonstrations".into(), violated as f64 / checked),
            ],
        }
    }
}

/// M⁻¹; a metric is a mixture of positive definite ones.
fn inverse_metric<const D: usize>(metric: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D> {
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
fn goal_hessian<const D: usize>(
    shape: &Shape<D>,
    metric: &SMatrix<f64, D, D>,
) -> Vec<SMatrix<f64, D, D>> {
    let goal = shape.goal();
    let factor = metric.cholesky().expect("a metric is positive definite").l();
    let inverse = factor.try_inverse().expect("its factor has a positive diagonal");
    let sides: Vec<_> = (0..D)
        .map(|i| {
            let step = axis::<D>(i, HESSIAN_STEP);
            (shape.basis(&(goal + step)).gradient, shape.basis(&(goal - step)).gradient)
        })
        .collect();
    (0..shape.parameters().len())
        .map(|j| {
            let hessian = SMatrix::<f64, D, D>::from_fn(|a, i| {
                (sides[i].0[j][a] - sides[i].1[j][a]) / (2.0 * HESSIAN_STEP)
            });
            inverse * (hessian + hessian.transpose()) * 0.5 * inverse.transpose()
        })
        .collect()
}

impl<const D: usize> Fitted<D> {
    /// The field in physical coordinates y = ŷ/s, divided by the goal's metric.
    ///
    /// With ŷ = s y, Φ(y) = c Φ̂(s y) and M(y) = c s² M̂(s y) give the same accelerations for any c;
    /// c = 1/(s² m_G) makes M_G the identity.
    #[must_use]
    pub fn physical(&self, length_scale: f64) -> (FieldModel, ProgramFit) {
        let s = length_scale;
        let (mut components, background) = self.shape.with(&self.parameters);
        let goal_metric = components[components.len() - 1].metric[(0, 0)];
        let c = 1.0 / (s * s * goal_metric);
        for component in &mut components {
            component.mean /= s;
            component.precision *= s * s;
            component.metric /= goal_metric;
            component.potential *= c;
            component.gradient *= c * s;
            component.hessian *= c * s * s;
        }
        let background = Background {
            exponent: background.exponent,
            metric: background.metric / goal_metric,
            offset: (c * background.offset).max(0.0),
            slope: c * s * background.slope,
            softening: background.softening / s,
        };
        let field = FieldModel::from_parts(&components, background, self.shape.damping_1_s());
        let mut figures = self.figures.clone();
        figures.figures.push(("normalised units a unit".into(), length_scale));
        (field, figures)
    }
}
