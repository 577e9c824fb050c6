//! Skill files: what to learn, and the numbers that were chosen for it.

mod settings;

pub use settings::*;
