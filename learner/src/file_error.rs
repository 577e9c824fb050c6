//! What is wrong with a file: every command that reads or writes files reports it so.

use std::path::{Path, PathBuf};

use tprmp_files::{WriteError, name};

/// A file or folder is the problem. Each message names it, and the place in it.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// It cannot be read.
    #[error("`{path}` cannot be read: {source}")]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// It cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Its content is not what it should be.
    #[error("`{path}`, {place}: {problem}")]
    Input {
        /// The file or folder.
        path: PathBuf,
        /// The key, or line and column.
        place: String,
        /// What was expected, and found.
        problem: String,
    },
}

impl FileError {
    /// A file that does not say what it should, at a place.
    pub fn input(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Input { path: path.into(), place: place.into(), problem: problem.into() }
    }

    /// A wrong value at a key of a file.
    pub fn key(path: &Path, key: impl std::fmt::Display, problem: impl Into<String>) -> Self {
        Self::Input { path: path.into(), place: format!("key `{key}`"), problem: problem.into() }
    }

    /// A text at a key of a file that is not fit for a name.
    pub fn name(path: &Path, key: impl std::fmt::Display, text: &str) -> Result<(), Self> {
        name::check(text).map_err(|error| Self::key(path, key, error.to_string()))
    }

    /// A file that does not parse.
    pub fn syntax(path: &Path, line: usize, column: usize, problem: impl Into<String>) -> Self {
        Self::Input {
            path: path.into(),
            place: format!("line {line}, column {column}"),
            problem: tprmp_files::shortened(&problem.into()),
        }
    }
}

/// Reads a text file of at most `bytes_max`.
pub fn read_text(path: &Path, bytes_max: u64) -> Result<String, FileError> {
    tprmp_files::read_text(path, bytes_max)
        .map_err(|source| FileError::Read { path: path.into(), source })
}
