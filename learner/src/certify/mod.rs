//! Step 5, the certificate: what can be proved of a fitted policy, and what rollouts show.

mod certifier;
mod failures;
pub mod policy;
pub mod rollout;
mod starts;

pub use certifier::Certifier;
pub(crate) use certifier::beside;
pub(crate) use failures::cycle_failures;
pub(crate) use starts::in_ball;
