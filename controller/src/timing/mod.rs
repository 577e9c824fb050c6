//! When a tick happens, and what it costs.

pub mod allocation;
pub mod overruns;
pub mod pacing;
pub mod realtime;
