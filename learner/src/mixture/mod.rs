//! Gaussian mixtures of the demonstrations, in each frame.

pub mod components;
pub mod em;
pub mod k_means;
pub mod tp_gmm;
