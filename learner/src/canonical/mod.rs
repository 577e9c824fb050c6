//! Step 2, canonical coordinates: the space in which all demonstrations share their frames.

pub mod adaptation;
pub mod agreement;
mod coordinates;
mod frame_map;
pub mod kaiser_smoothing;
pub mod means;
pub mod path;
pub mod phase_profile;
pub mod savitzky_golay;
pub(crate) mod scales;

pub use coordinates::{
    ANGLE_MAX_RAD, CanonicalDemonstration, CanonicalSet, canonical_path, canonicalise,
};
pub use means::{mean_goal, mean_pose};
pub use phase_profile::PhaseProfile;
