//! Learns a frozen model from demonstrations.
//!
//! [`train::train`] is the whole way: demonstrations → canonical coordinates ([`canonical`],
//! [`savitzky_golay`]) → Gaussian mixture in each frame ([`tp_gmm`], [`em`], [`k_means`],
//! [`components`]) → policy, the canonical one ([`basis`], [`targets`], [`fit`]) or the thesis'
//! ([`thesis`], [`kaiser_smoothing`]) → certificate ([`certify`], [`rollout`]) → model. Demonstrations are files;
//! [`record`] writes them from a live robot; [`plot`] draws what was learned.

pub mod canonical;
pub mod certify;
pub mod demonstration;
pub mod file_error;
pub mod fit;
pub mod import;
pub mod mixture;
pub mod plot;
pub mod record;
pub mod report;
pub mod skill;
pub mod train;
