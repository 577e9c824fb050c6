//! Model files and configurations.
//!
//! One program: what it has in common with the library is compiled once.

mod bounds;
mod examples;
mod skill_model;
mod upgrade;
