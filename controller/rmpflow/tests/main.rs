//! The tree and its leaves.
//!
//! One program: what it has in common with the library is compiled once.

mod avoidance;
mod tree;
