//! Step 1, canonical coordinates: the space in which all demonstrations share their frames.

pub mod adaptation;
mod coordinates;
mod frame_map;
pub mod kaiser_smoothing;
pub mod means;
mod motion;
pub mod path;
pub mod phase_profile;
pub mod savitzky_golay;

pub use coordinates::{
    ANGLE_MAX_RAD, CanonicalDemonstration, CanonicalSet, canonical_path, canonicalise, prepared,
};
pub use means::{mean_goal, mean_pose};
pub use motion::{DemonstrationError, moving_ranges};
pub use phase_profile::PhaseProfile;
