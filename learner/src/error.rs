//! What can go wrong, told so that the reader knows what to mend.

use std::path::{Path, PathBuf};

use tprmp_model::skill_model::{EvaluationError, ModelError};

/// Why the learner stops. Each message names the file or the part that failed.
#[derive(Debug, thiserror::Error)]
pub enum LearnerError {
    /// A file or folder cannot be read.
    #[error("`{path}` cannot be read: {source}")]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file or folder cannot be written.
    #[error("`{path}` cannot be written: {source}")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// What is told cannot be written.
    #[error("standard output cannot be written: {0}")]
    Output(std::io::Error),
    /// A file does not say what it should.
    #[error("`{path}`, {place}: {problem}")]
    Input {
        /// The file or folder.
        path: PathBuf,
        /// The key, or line and column.
        place: String,
        /// What was expected, and found.
        problem: String,
    },
    /// The mixture has more components than the demonstrations can fill.
    #[error(
        "the mixture has too many components: {problem}, but key `mixture.components` asks for \
         {components}"
    )]
    Mixture {
        /// Components that were asked for.
        components: usize,
        /// What is wrong.
        problem: String,
    },
    /// The command line asks for a number of components that cannot be.
    #[error("option --components: {0}")]
    Components(String),
    /// The convex program of a field was not solved.
    #[error(
        "the {program} could not be fitted: the solver stopped with `{status}` after \
         {iterations} iterations; {}",
        blamed(causes)
    )]
    NotSolved {
        /// What was fitted.
        program: &'static str,
        /// The solver's status.
        status: String,
        /// Its iterations.
        iterations: u32,
        /// File names of the demonstrations without any one of which it is solved.
        causes: Vec<String>,
    },
    /// A demonstration cannot be brought into canonical coordinates, or cannot be learned from.
    #[error("demonstration `{name}`: {problem}")]
    Demonstration {
        /// Its file name.
        name: String,
        /// What is wrong.
        problem: String,
    },
    /// The learned skill fails its certificate.
    #[error(
        "the learned skill fails its certificate in {} point{}, first: {}; nothing was written. Heed the \
         warnings above; another `mixture.components` may help; the thesis' policy seldom holds a \
         certificate, `fit: Canonical` mostly does; --allow-uncertified writes the model all \
         the same",
        failures.len(),
        if failures.len() == 1 { "" } else { "s" },
        failures.first().map_or("", String::as_str)
    )]
    Uncertified {
        /// What failed.
        failures: Vec<String>,
    },
    /// The learned numbers cannot be computed with.
    #[error("the learned policy cannot be evaluated: {0}")]
    Evaluation(#[from] EvaluationError),
    /// Nothing can be recorded.
    #[error(transparent)]
    Record(#[from] crate::record::RecordError),
    /// The model file was refused.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl LearnerError {
    /// A wrong value at a key of a file.
    pub fn key(path: &Path, key: impl std::fmt::Display, problem: impl Into<String>) -> Self {
        Self::Input { path: path.into(), place: format!("key `{key}`"), problem: problem.into() }
    }

    /// A file that does not parse.
    pub fn syntax(path: &Path, line: usize, column: usize, problem: impl Into<String>) -> Self {
        Self::Input {
            path: path.into(),
            place: format!("line {line}, column {column}"),
            problem: problem.into(),
        }
    }
}

/// Which demonstrations keep a program from being solved.
fn blamed(causes: &[String]) -> String {
    let quoted: Vec<_> = causes.iter().map(|name| format!("`{name}`")).collect();
    match quoted.len() {
        0 => "no single demonstration causes it: raise `regularisation`".into(),
        1 => format!("demonstration {} causes it: it is solved without", quoted[0]),
        _ => format!(
            "it is solved without any one of the demonstrations {}: look for those that contradict \
             each other",
            quoted.join(", ")
        ),
    }
}

/// Reads a text file.
pub fn read_text(path: &Path) -> Result<String, LearnerError> {
    std::fs::read_to_string(path).map_err(|source| LearnerError::Read { path: path.into(), source })
}
