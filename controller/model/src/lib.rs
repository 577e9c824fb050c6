//! Frozen model files and RON configuration, parsed into valid types.
//!
//! A value of a type in this crate that came from a file is valid: every reader checks schema,
//! checksum, dimensions, finiteness and definiteness, and names the file and the key it refuses.

pub mod controller_config;
mod renamed;
mod ron_text;
pub mod skill_model;

pub use renamed::{RENAMED_KEYS, RenamedKey, renamed_keys};
