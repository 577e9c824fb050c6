//! The controller: reads robot state and task frames from shared memory, evaluates a learned
//! policy, publishes joint commands, and stays safe.
//!
//! Start here: [`cycle`] is the loop, [`policy`] the tree it evaluates, [`startup`] what happens
//! before it. Start-up may allocate, read files and fail loudly; the cycle may do none of that.

pub mod arm;
pub mod commands;
pub mod conformance;
pub mod control;
pub mod cycle;
pub mod detail;
pub mod freedom;
pub mod init;
pub mod inputs;
pub mod motion;
pub mod outbox;
pub mod peers;
pub mod policy;
pub mod skill_leaf;
pub mod startup;
pub mod task;
pub mod telemetry;
pub mod timing;
mod tool_axis;
