//! Demonstrations from a live robot: an observer of the states and frames of an instance, whoever
//! publishes them.
//!
//! `recorder` makes the decisions, fed with samples and free of I/O. `intake` checks what arrives,
//! `arm` makes a pose of it, `recording` a demonstration, and `folder` writes it. `session` reads
//! shared memory and calls them; `announcer` reports what it waits for.

mod announcer;
pub(crate) mod arm;
mod error;
mod folder;
mod intake;
mod options;
mod recorder;
mod recording;
mod session;

pub use error::RecordError;
pub use options::Options;
pub use session::record;
