//! Demonstrations: their files, and numbers in them that are hardly meant.

mod bounds;
mod file;
pub mod plausibility;

pub use bounds::diagonal;
pub use file::{
    DURATION_MAX_S, Demonstration, FileFrame, POINTS_MIN, POSITION_MAX_M, SCHEMA, columns, frame,
    other_frames, read, read_folder, to_text,
};
