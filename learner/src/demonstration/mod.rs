//! Demonstrations: their files, what the gripper does in them, and numbers in them that are hardly meant.

pub(crate) mod at_most;
mod bounds;
mod file;
mod gripper;
mod part;
pub mod plausibility;
mod recorded;

pub use bounds::diagonal;
pub(crate) use file::largest_span_m;
pub use file::{
    BYTES_MAX, DURATION_MAX_S, FileFrame, POINTS_MIN, POSITION_MAX_M, SAMPLES_MAX,
    SAMPLING_TIME_MIN_S, SCHEMA, columns, frame, other_frames, read, read_folder,
    read_folder_with_all_frames, skipped, to_text,
};
pub(crate) use gripper::check_width;
pub use gripper::{Grip, Gripper, WIDTH_MAX_M};
pub(crate) use part::leave_part;
pub use recorded::{Demonstration, mean_duration_s};
