//! Pictures of a learned skill, as SVG files and a page that shows them all.
//!
//! Demonstrations are read again and have to be those the model was learned from. Fields are drawn
//! as they act on the robot, in its base frame, for an inertia of 1 kg at the goal: both kinds of
//! policy are asked by [`LearnedPolicy`](crate::certify::policy::LearnedPolicy). The canonical coordinates are
//! themselves a place where the frames can be: their mean poses.

pub mod field;
mod figures;
mod files;
mod forces;
mod gallery;
pub mod scene;

pub use files::{PlotError, choice, plot};
pub use gallery::{frame_of, gallery, gaussians};
