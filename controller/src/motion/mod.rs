//! From the policy's accelerations to commands within the limits.

pub mod caution;
pub mod disturbance;
pub mod generator;
pub mod limits;
pub mod load;
pub mod profile;
pub mod servo;
pub mod tracking;
