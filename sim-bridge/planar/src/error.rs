//! Errors a user can act on: each names the file and the key.

use std::path::{Path, PathBuf};

use thiserror::Error;
use tprmp_files::WriteError;
use tprmp_messages::ServiceError;
use tprmp_robot::UrdfError;

/// Why a command failed.
#[derive(Debug, Error)]
pub(crate) enum SimError {
    /// A file cannot be read.
    #[error("{}: cannot be read: {source}{hint}", path.display())]
    Read {
        /// File.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
        /// What to do, empty where there is nothing to say.
        hint: &'static str,
    },
    /// A file or folder cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A file's content is not as expected.
    #[error("{}: `{key}`: {problem}", path.display())]
    Key {
        /// File.
        path: PathBuf,
        /// Key, or line and column.
        key: String,
        /// What was expected, and what was found.
        problem: String,
    },
    /// The robot's description.
    #[error(transparent)]
    Robot(#[from] UrdfError),
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// Signal handlers.
    #[error("signal handlers cannot be set: {0}")]
    Signals(std::io::Error),
    /// The controller runs against the machine's clock.
    #[error(
        "the controller of instance `{0}` answers on the machine's clock, this simulator runs in lockstep: \
         start both with --lockstep, or both without"
    )]
    NotInLockstep(String),
    /// No command came, or none any more.
    #[error(
        "no command from a controller within {waited_s} s (instance `{instance}`): start \
         `controller run` on the same instance, as the same user{lockstep}"
    )]
    NoController {
        /// How long was waited \[s\].
        waited_s: u64,
        /// Instance.
        instance: String,
        /// What else it needs.
        lockstep: &'static str,
    },
    /// A message could not be sent.
    #[error("shared memory: a message could not be sent; check that /dev/shm is not full")]
    Publish,
}

impl SimError {
    /// A key that is not as expected.
    pub(crate) fn key(path: &Path, key: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Key { path: path.into(), key: key.into(), problem: problem.into() }
    }
}

/// Largest file \[bytes\]: the log of a run has some million.
const BYTES_MAX: u64 = 32 << 20;

/// Reads a text file of at most 32 MiB.
pub(crate) fn read_text(path: &Path, hint: &'static str) -> Result<String, SimError> {
    tprmp_files::read_text(path, BYTES_MAX).map_err(|source| SimError::Read {
        path: path.into(),
        source,
        hint,
    })
}

/// Parses JSON; an error names the key.
pub(crate) fn parse_json<T: serde::de::DeserializeOwned>(
    text: &str,
    path: &Path,
) -> Result<T, SimError> {
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let key = error.path().to_string();
        SimError::key(path, key, error.inner().to_string())
    })?;
    deserializer.end().map_err(|error| SimError::key(path, ".", error.to_string()))?;
    Ok(value)
}
