//! Demonstrations as people give them: at their own pace, with pauses and a tremor.

pub mod hand;
pub mod scene;
pub mod table;
