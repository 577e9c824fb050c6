//! The experiments, small, and their measures against other implementations.
//!
//! One program: what it has in common with the library is compiled once.

mod experiments;
#[path = "../../tests/common/folder.rs"]
mod folder;
mod measures_oracle;
mod scale;
mod small;
