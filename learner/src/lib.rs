//! Learns a frozen model from demonstrations.
//!
//! [`train::train`] is the whole way: demonstrations → canonical coordinates ([`canonical`],
//! [`savitzky_golay`]) → Gaussian mixture in each frame ([`tp_gmm`], [`em`], [`k_means`],
//! [`components`]) → policy, the canonical one ([`basis`], [`targets`], [`fit`]) or the thesis'
//! ([`thesis`], [`running_mean`]) → certificate ([`certify`], [`rollout`]) → model. Demonstrations are files;
//! [`record`] writes them from a live robot; [`plot`] draws what was learned.

pub mod adaptation;
pub mod basis;
pub mod canonical;
pub mod certify;
pub mod components;
pub mod conic;
pub mod demonstration;
pub mod em;
pub mod error;
pub mod experiments;
pub mod fit;
pub mod import;
pub mod k_means;
pub mod orientation;
pub mod pace;
pub mod plausibility;
pub mod plot;
pub mod policy;
pub mod record;
pub mod report;
pub mod rollout;
pub mod running_mean;
pub mod savitzky_golay;
pub mod skill;
pub mod targets;
pub mod thesis;
pub mod tp_gmm;
pub mod train;
pub mod valley;
