//! Policies to compare with, from the thesis' related work, implemented plainly.

pub mod dmp;
pub mod lqr;
pub mod pd;
