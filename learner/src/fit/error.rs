//! Why a policy is not fitted.

use clarabel::solver::{SolverError, SolverStatus};
use tprmp_model::skill_model::Program;

use crate::alignment::rest::DemonstrationError;

/// Why a policy is not fitted.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The Gaussians of a demonstration's frames cannot be multiplied.
    #[error(transparent)]
    Demonstration(#[from] DemonstrationError),
    /// A program is not solved.
    #[error(transparent)]
    NotSolved(#[from] NotSolved),
}

/// A program of the fit was not solved.
#[derive(Debug, thiserror::Error)]
#[error(
    "the {program} could not be fitted: the solver stopped with `{reason}` after {iterations} \
     iterations; {}",
    remedy(reason, causes)
)]
pub struct NotSolved {
    /// What was fitted.
    pub program: Program,
    /// Why the solver stopped.
    pub reason: Reason,
    /// Its iterations.
    pub iterations: u32,
    /// File names of the demonstrations without any one of which it is solved.
    pub causes: Vec<String>,
}

/// Why the solver has no solution.
#[derive(Debug, thiserror::Error)]
pub enum Reason {
    /// It ended without one.
    #[error("{0:?}")]
    Ended(SolverStatus),
    /// A matrix of the program is not positive definite.
    #[error("{0} is not positive definite")]
    Singular(&'static str),
    /// It did not begin: numbers that are not finite end here.
    #[error(transparent)]
    Refused(#[from] SolverError),
}

impl NotSolved {
    /// An error of this program; its causes are found later.
    #[must_use]
    pub fn new(program: Program, (reason, iterations): (Reason, u32)) -> Self {
        Self { program, reason, iterations, causes: Vec::new() }
    }
}

/// What to do about it: which demonstrations keep a program from being solved.
fn remedy(reason: &Reason, causes: &[String]) -> String {
    if !matches!(reason, Reason::Ended(_)) {
        return "numbers of the skill file's `fit` and `scale` differ too much in size: begin with those of \
                the files in config/skills"
            .into();
    }
    let quoted: Vec<_> = causes.iter().map(|name| format!("`{name}`")).collect();
    match quoted.as_slice() {
        [] => "no single demonstration causes it: raise `regularisation`".into(),
        [one] => format!("demonstration {one} causes it: it is solved without"),
        _ => format!(
            "it is solved without any one of the demonstrations {}: look for those that contradict \
             each other",
            quoted.join(", ")
        ),
    }
}
