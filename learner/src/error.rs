//! What can go wrong, told so that the reader knows what to mend.

use std::path::{Path, PathBuf};

use tprmp_model::skill_model::ModelError;

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
        "the {block} field could not be fitted: the solver stopped with `{status}` after \
         {iterations} iterations; look for jumps in the demonstrations, or raise `regularisation`"
    )]
    NotSolved {
        /// `position` or `orientation`.
        block: &'static str,
        /// The solver's status.
        status: String,
        /// Its iterations.
        iterations: u32,
    },
    /// A demonstration cannot be brought into canonical coordinates, or cannot be learned from.
    #[error("demonstration `{name}`: {problem}")]
    Demonstration {
        /// Its file name.
        name: String,
        /// What is wrong.
        problem: String,
    },
    /// The learned skill does not do what was shown.
    #[error(
        "the learned skill does not reach the goal from the start of demonstration `{name}`: it \
         ends {error_mm:.2} mm and {error_deg:.2}° away; nothing was written. Look for \
         demonstrations that contradict each other, or change `mixture.components`"
    )]
    GoalMissed {
        /// File name of the demonstration.
        name: String,
        /// Distance to the goal [mm].
        error_mm: f64,
        /// Angle to the goal [°].
        error_deg: f64,
    },
    /// Nothing can be recorded.
    #[error(transparent)]
    Record(#[from] crate::record::RecordError),
    /// The model file was refused.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl LearnerError {
    /// A wrong value at a key of a file.
    pub(crate) fn key(
        path: &Path,
        key: impl std::fmt::Display,
        problem: impl Into<String>,
    ) -> Self {
        Self::Input { path: path.into(), place: format!("key `{key}`"), problem: problem.into() }
    }

    /// A file that does not parse.
    pub(crate) fn syntax(
        path: &Path,
        line: usize,
        column: usize,
        problem: impl Into<String>,
    ) -> Self {
        Self::Input {
            path: path.into(),
            place: format!("line {line}, column {column}"),
            problem: problem.into(),
        }
    }
}

/// Reads a text file.
pub(crate) fn read_text(path: &Path) -> Result<String, LearnerError> {
    std::fs::read_to_string(path).map_err(|source| LearnerError::Read { path: path.into(), source })
}
