//! What the command line offers beside the loop.

pub mod check;
pub mod monitor;
pub mod overrides;
pub mod soak;
pub mod top;
