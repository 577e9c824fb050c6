//! What arrives: nothing unchecked goes further.

pub mod estimator;
pub mod external;
pub mod inbox;
pub mod scene;
