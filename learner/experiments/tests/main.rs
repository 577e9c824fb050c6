//! The experiments, small, and their measures against other implementations.
//!
//! One program: what it has in common with the library is compiled once.

mod experiments;
mod measures_oracle;
mod scale;
mod small;
