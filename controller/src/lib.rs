//! The controller: reads robot state and task frames from shared memory, evaluates a learned
//! policy, publishes joint commands, and stays safe.
//!
//! Start here: [`cycle`] is the loop, [`policy`] the tree it evaluates, [`startup`] what happens
//! before it. Start-up may allocate, read files and fail loudly; the cycle may do none of that.

pub mod allocation;
pub mod check;
pub mod cycle;
pub mod disturbance;
pub mod external;
pub mod inputs;
pub mod limits;
pub mod monitor;
pub mod motion;
pub mod overrides;
pub mod overruns;
pub mod pacing;
pub mod policy;
pub mod realtime;
pub mod soak;
pub mod standstill;
pub mod startup;
pub mod task;
pub mod telemetry;
pub mod top;
pub mod tracking;
