//! Who has to say that the arm may move: the life cycle, requests from outside, and what is remembered of a
//! controller that did not end by itself.

pub mod journal;
pub mod requests;
pub mod server;
pub mod supervisor;
