//! The loop as a whole, with real ports: limits, faults, skills, allocations.
//!
//! One program: what it has in common with the library is compiled once.

mod allocation;
mod common;
mod continuous;
mod descriptions;
mod external;
mod fallback;
mod hostile;
mod limits;
mod modes;
mod payload;
mod periodic;
mod skills;
