//! The one place that draws: figures as SVG text, and pages of them.

pub mod canvas;
pub mod colour;
pub mod projection;
pub mod svg;
