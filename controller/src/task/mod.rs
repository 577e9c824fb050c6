//! Where the task stands, and whether it gets on.

pub mod stall;
pub mod state;
