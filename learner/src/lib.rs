//! Learns a frozen model from demonstrations: one skill, one convex program a block.
//!
//! [`train::train`] is the whole way: demonstrations → canonical coordinates ([`canonical`],
//! [`savitzky_golay`]) → Gaussian mixture ([`k_means`], [`em`], [`components`]) → field of each block ([`basis`], [`fit`]) →
//! rollouts ([`verify`]) → model. Demonstrations are files; [`record`] writes them from a live robot.

pub mod attractors;
pub mod basis;
pub mod canonical;
pub mod components;
pub mod conic;
pub mod demonstration;
pub mod em;
pub mod error;
pub mod fit;
pub mod import;
pub mod k_means;
pub mod plausibility;
pub mod record;
pub mod report;
pub mod savitzky_golay;
pub mod skill;
pub mod targets;
pub mod train;
pub mod verify;
