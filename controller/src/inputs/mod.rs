//! What arrives: nothing unchecked goes further.

pub mod estimator;
pub mod external;
pub mod frozen;
pub mod inbox;
pub mod offender;
pub mod scene;
pub mod velocity;
