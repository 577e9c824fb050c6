//! Descriptions, kinematics and dynamics: against other implementations, identities, and files as they are found.
//!
//! One program: what it has in common with the library is compiled once.

mod against_dynibo;
mod allocation;
mod common;
mod control_points;
mod identities;
mod self_pairs;
mod urdf_bounds;
mod urdf_cases;
mod urdf_errors;
mod urdf_values;
