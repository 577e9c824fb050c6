//! What the benchmarks of several processes share: the parties, the machine, the numbers and the
//! file they end up in.
//!
//! A benchmark plays several parts in processes of its own ([`role`]): the publisher of states
//! ([`robot`]), the other end of a ping-pong, a busy neighbour. The controller is the real one
//! ([`controller`]), and `cyclictest` the reference for what the machine does ([`cyclictest`]).

use std::error::Error;

pub mod controller;
pub mod cyclictest;
pub mod machine;
pub mod results;
pub mod robot;
pub mod role;
pub mod statistics;
pub mod timing;

/// A benchmark that cannot go on reports why.
pub type Fallible<T> = Result<T, Box<dyn Error>>;

/// Real-time priority of every party, that of the shipped configurations.
pub const FIFO_PRIORITY: u8 = 80;
