//! What every program does with files: reading them within bounds, writing them whole, names that come out
//! of them, and texts for whoever reads the standard streams; and what it says of a fault of its own.

pub mod name;
pub mod panics;
pub mod printable;
pub mod read;
pub mod standard;
pub mod write;

pub use name::{Name, NameError};
pub use panics::report_panics;
pub use printable::printable;
pub use read::{ReadProblem, read, read_text, shortened};
pub use write::{Draft, Existing, WriteError, make_folder, try_out, write};
