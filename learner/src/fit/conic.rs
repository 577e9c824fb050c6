//! Convex quadratic programs over cones, for the solver:
//! minimise ½ xᵀPx + qᵀx such that affine functions of x lie in cones.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus,
    SupportedConeT, ZeroConeT,
};
use nalgebra::DMatrix;
use tprmp_model::skill_model::ProgramStatus;

use crate::fit::error::Reason;

/// Bound on the solver's iterations; some twenty are usual.
const ITERATIONS_MAX: u32 = 200;

/// c₀ + Σ c_j x_j, with the variables in ascending order.
#[derive(Clone, Debug)]
pub struct Affine {
    /// c₀.
    pub constant: f64,
    /// (j, c_j).
    pub coefficients: Vec<(usize, f64)>,
}

impl Affine {
    /// Its value; variables beyond `x` are zero.
    #[must_use]
    pub fn at(&self, x: &[f64]) -> f64 {
        let terms = self.coefficients.iter().filter_map(|(j, c)| Some(c * x.get(*j)?));
        self.constant + terms.sum::<f64>()
    }
}

/// A program under construction.
#[derive(Clone, Debug)]
pub struct ConicProgram {
    quadratic: DMatrix<f64>,
    linear: Vec<f64>,
    rows: Vec<Affine>,
    cones: Vec<SupportedConeT<f64>>,
}

/// What the solver found.
#[derive(Clone, Debug)]
pub struct Solution {
    /// How exact it is.
    pub status: ProgramStatus,
    /// The solver's iterations.
    pub iterations: u32,
    /// Optimal value.
    pub objective: f64,
    /// The variables.
    pub x: Vec<f64>,
}

impl ConicProgram {
    /// A program without constraints. `quadratic` is P for the first variables, symmetric; the
    /// others, up to the length of `linear`, enter linearly.
    ///
    /// # Panics
    /// When `linear` is shorter than `quadratic`.
    #[must_use]
    pub fn new(quadratic: DMatrix<f64>, linear: Vec<f64>) -> Self {
        assert!(quadratic.nrows() <= linear.len(), "one linear term a variable");
        Self { quadratic, linear, rows: Vec::new(), cones: Vec::new() }
    }

    /// All of these are zero.
    pub fn require_zero(&mut self, functions: Vec<Affine>) {
        self.cones.push(ZeroConeT(functions.len()));
        self.rows.extend(functions);
    }

    /// None of these is negative.
    pub fn require_nonnegative(&mut self, functions: Vec<Affine>) {
        self.cones.push(NonnegativeConeT(functions.len()));
        self.rows.extend(functions);
    }

    /// The first of these is at least the norm of the others.
    pub fn require_second_order(&mut self, functions: Vec<Affine>) {
        self.cones.push(SecondOrderConeT(functions.len()));
        self.rows.extend(functions);
    }

    /// Solves the program, in one thread and always in the same way.
    ///
    /// # Errors
    /// Why there is no solution, and after how many iterations.
    pub fn solve(&self) -> Result<Solution, (Reason, u32)> {
        let variables = self.linear.len();
        let quadratic = upper_triangle(&self.quadratic, variables);
        // The solver's form: A x + s = b with s in the cones.
        let (mut row_of, mut column_of, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for (i, row) in self.rows.iter().enumerate() {
            for (j, coefficient) in row.coefficients.iter().filter(|(_, c)| *c != 0.0) {
                row_of.push(i);
                column_of.push(*j);
                values.push(-coefficient);
            }
        }
        let matrix =
            CscMatrix::new_from_triplets(self.rows.len(), variables, row_of, column_of, values);
        let bounds: Vec<f64> = self.rows.iter().map(|row| row.constant).collect();
        let settings = DefaultSettings {
            verbose: false,
            max_iter: ITERATIONS_MAX,
            max_threads: 1,
            direct_solve_method: "qdldl".into(),
            ..DefaultSettings::default()
        };
        let mut solver =
            DefaultSolver::new(&quadratic, &self.linear, &matrix, &bounds, &self.cones, settings)
                .map_err(|error| (error.into(), 0))?;
        solver.solve();
        let solution = solver.solution;
        let status = match solution.status {
            SolverStatus::Solved => ProgramStatus::Solved,
            SolverStatus::AlmostSolved => ProgramStatus::AlmostSolved,
            other => return Err((Reason::Ended(other), solution.iterations)),
        };
        if !solution.x.iter().all(|x| x.is_finite()) {
            return Err((Reason::Ended(solution.status), solution.iterations));
        }
        let (iterations, objective) = (solution.iterations, solution.obj_val);
        Ok(Solution { status, iterations, objective, x: solution.x })
    }
}

/// The upper triangle of a dense matrix, filled up with zeros to `size`.
fn upper_triangle(matrix: &DMatrix<f64>, size: usize) -> CscMatrix<f64> {
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for j in 0..size {
        if j < matrix.ncols() {
            rows.extend(0..=j);
            values.extend((0..=j).map(|i| matrix[(i, j)]));
        }
        starts.push(rows.len());
    }
    CscMatrix::new(size, size, starts, rows, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn affine(constant: f64, coefficients: &[(usize, f64)]) -> Affine {
        Affine { constant, coefficients: coefficients.to_vec() }
    }

    #[test]
    fn a_small_program_with_each_cone_has_its_known_solution() {
        // minimise x² + y² + z with x + y = 2, z ≥ 1, 3 ≥ |(x, y − 3)|: x = 1, y = 1 is too far.
        let mut program =
            ConicProgram::new(DMatrix::from_diagonal_element(2, 2, 2.0), vec![0.0, 0.0, 1.0]);
        program.require_zero(vec![affine(-2.0, &[(0, 1.0), (1, 1.0)])]);
        program.require_nonnegative(vec![affine(-1.0, &[(2, 1.0)])]);
        program.require_second_order(vec![
            affine(1.5, &[]),
            affine(0.0, &[(0, 1.0)]),
            affine(-3.0, &[(1, 1.0)]),
        ]);
        let solution = program.solve().unwrap();
        // On the circle and the line: x² + (x + 1)² = 1.5², the larger root.
        let x = (-1.0 + (2.0_f64 * 2.25 - 1.0).sqrt()) / 2.0;
        assert!((solution.x[0] - x).abs() < 1e-6 && (solution.x[1] - 2.0 + x).abs() < 1e-6);
        assert!((solution.x[2] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_contradiction_has_no_solution() {
        let mut program = ConicProgram::new(DMatrix::identity(1, 1), vec![0.0]);
        program.require_nonnegative(vec![affine(-1.0, &[(0, 1.0)]), affine(-1.0, &[(0, -1.0)])]);
        assert!(matches!(program.solve(), Err((Reason::Ended(SolverStatus::PrimalInfeasible), _))));
    }
}
