//! Step 1, canonical coordinates: the space in which all demonstrations share their frames.

pub mod adaptation;
mod coordinates;
pub mod kaiser_smoothing;
pub mod means;
pub mod phase_profile;
pub mod savitzky_golay;

pub use coordinates::{
    CanonicalDemonstration, CanonicalSet, DemonstrationError, canonical_path, canonicalise,
    mean_goal, mean_pose, moving_ranges, prepared,
};
pub use phase_profile::PhaseProfile;
