//! What every program does with files: writing them whole, names that come out of them, and texts for
//! whoever reads the standard streams.

pub mod name;
pub mod printable;
pub mod standard;
pub mod write;

pub use name::{Name, NameError};
pub use printable::printable;
pub use write::{Draft, Existing, WriteError, make_folder, try_out, write};
