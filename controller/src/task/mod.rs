//! Where the task stands, and whether it makes progress.

pub mod rounds;
pub mod stall;
pub mod state;
