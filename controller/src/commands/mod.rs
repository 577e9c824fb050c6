//! What the command line offers.

pub mod check;
pub mod clean;
pub mod conformance;
pub mod cover;
pub mod ctl;
pub mod frames;
pub mod init;
pub mod layout;
pub mod monitor;
pub mod overrides;
pub mod run;
pub mod sentences;
pub mod soak;
pub mod top;
