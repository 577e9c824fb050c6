//! Demonstrations from a live robot: an observer of the states and frames of an instance, whoever
//! publishes them.
//!
//! `recorder` makes the decisions, fed with samples and free of I/O. `intake` checks what arrives,
//! `arm` makes a pose of it; `rest` and `frame_rest` judge whether tool and frames rest, by the means
//! of `statistics` and within `bounds`. `recording` makes a demonstration of what `cut` finds to be the
//! motion, and `folder` writes it. `session` reads shared memory and calls them; `announcer` reports
//! what it sees, `joint_noise` with it, and what it waits for.

mod announcer;
pub(crate) mod arm;
mod bounds;
mod cut;
mod error;
mod folder;
mod frame_rest;
mod grips;
mod intake;
mod joint_noise;
#[cfg(test)]
mod noise_tests;
#[cfg(test)]
mod noisy;
mod options;
mod recorder;
mod recording;
mod rest;
mod session;
mod statistics;

pub use error::RecordError;
pub use options::Options;
pub use session::record;
