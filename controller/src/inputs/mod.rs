//! What arrives: nothing unchecked goes further.

pub mod external;
pub mod inbox;
pub mod scene;
pub mod state;
