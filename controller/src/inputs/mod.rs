//! What arrives: nothing unchecked goes further.

pub mod estimator;
pub mod external;
pub mod frozen;
pub mod gripped;
pub mod inbox;
pub mod measured;
pub mod offender;
pub mod scene;
pub mod turns;
pub mod velocity;
