//! Skill files: what to learn, and every number that was chosen for it.

mod read;
mod settings;
mod validate;

pub use read::{SCHEMA, SCHEMA_BEFORE};
pub use settings::*;
