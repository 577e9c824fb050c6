//! The report: every figure beside what the thesis published, and what the default policy must do.

mod boxes;
pub(crate) mod content;
mod fields;
pub(crate) mod measures;
mod obstacle;
pub(crate) mod page;
mod paths;
mod stability;
mod style;
mod times;
