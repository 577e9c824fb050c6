//! What the benchmarks share: the rows they write, and what is needed to measure several processes.

pub mod results;
pub mod timing;
