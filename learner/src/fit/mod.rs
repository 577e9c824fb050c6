//! Step 4, the fit: the canonical policy by one convex program a block, or the thesis' potential and
//! damping.

pub mod basis;
pub mod canonical;
pub mod conic;
mod error;
mod field;
mod program;
pub mod targets;
pub mod thesis;

pub use error::{FitError, NotSolved, Reason};
pub(crate) use field::fit_blocks;
pub use field::{Fitted, fit, round_shape, shape};
