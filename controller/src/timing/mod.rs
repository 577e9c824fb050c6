//! When a tick happens, and what it costs.

pub mod allocation;
pub mod loop_timing;
pub mod overruns;
pub mod pacing;
pub mod realtime;
