//! Why a comparison stops.

use std::path::PathBuf;

use tprmp_files::WriteError;
use tprmp_learner::alignment::rest::DemonstrationError;
use tprmp_learner::file_error::FileError;
use tprmp_model::controller_config::ConfigError;

/// Why a comparison stops. Each message names the file or the part that failed.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentsError {
    /// The data set, or a skill file.
    #[error(transparent)]
    File(#[from] FileError),
    /// The results.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A demonstration does not move.
    #[error(transparent)]
    Demonstration(#[from] DemonstrationError),
    /// The controller's configuration is refused.
    #[error(transparent)]
    Configuration(#[from] ConfigError),
    /// The controller's configuration does not say how obstacles are avoided.
    #[error("configuration `{path}`, key `{key}`: expected Some, found None")]
    Unconfigured {
        /// The file.
        path: PathBuf,
        /// The key.
        key: &'static str,
    },
}
