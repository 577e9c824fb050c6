//! What every program does with files: writing them whole, and names that come out of them.

pub mod name;
pub mod printable;
pub mod write;

pub use name::{Name, NameError};
pub use printable::printable;
pub use write::{Draft, Existing, WriteError, write};
