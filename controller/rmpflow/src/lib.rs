//! Riemannian motion policies: learned fields, task maps, leaves and the tree, evaluated without
//! allocation.

pub mod field;
pub mod frame_map;
pub mod jet;
pub mod leaves;
pub mod natural;
pub mod skill;
