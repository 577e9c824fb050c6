//! Step 3, the mixture: Gaussians of the demonstrations, in each frame.

pub mod components;
pub mod expectation_maximisation;
pub mod k_means;
mod left_right;
pub mod tp_gmm;
mod view;

pub use tp_gmm::MixtureError;
pub use view::{Gaussian, View};
