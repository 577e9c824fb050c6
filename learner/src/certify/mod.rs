//! Step 4, the certificate: what can be proved of a fitted policy, and what rollouts show.

mod blocks;
mod certifier;
pub mod policy;
pub mod rollout;

pub use certifier::Certifier;
