//! Spheres around meshes.
//!
//! One program: what it has in common with the library is compiled once.

mod common;
mod covers;
mod meshes;
mod vendors;
