//! Why nothing can be recorded.

use tprmp_messages::ServiceError;
use tprmp_model::controller_config::ConfigError;
use tprmp_robot::UrdfError;

use crate::file_error::FileError;

/// Why nothing can be recorded.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The skill file, the configuration, or the folder of demonstrations.
    #[error(transparent)]
    File(#[from] FileError),
    /// The controller's configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The robot's description.
    #[error(transparent)]
    Urdf(#[from] UrdfError),
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The signal handlers.
    #[error("signal handlers cannot be installed: {0}")]
    Signals(std::io::Error),
}
