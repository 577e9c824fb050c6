//! Step 5, the certificate: what can be proved of a fitted policy, and what rollouts show.

mod certifier;
mod failures;
pub mod policy;
pub mod rollout;
mod starts;

pub use certifier::Certifier;
