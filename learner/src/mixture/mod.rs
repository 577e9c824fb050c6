//! Step 2, the mixture: Gaussians of the demonstrations, in each frame.

pub mod components;
pub mod expectation_maximisation;
pub mod k_means;
pub mod tp_gmm;

pub use tp_gmm::MixtureError;
