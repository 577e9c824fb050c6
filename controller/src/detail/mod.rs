//! What was seen beside a reason, and what was expected: numbers of a fixed size in the loop, text off it.

mod seen;
mod shared;
mod text;

pub use seen::{About, Detail};
pub use shared::{SharedDetail, Snapshot};
pub use text::explain;
