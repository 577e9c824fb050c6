//! The canonical policy: fields on canonical coordinates and the phase, behind a frame map.

pub mod adaptation;
pub mod field;
pub mod frame_map;
pub mod policy;
pub mod restriction;
pub mod rounds;
