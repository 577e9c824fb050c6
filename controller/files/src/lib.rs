//! What every program does with files: reading them within bounds, writing them whole, and names that come
//! out of them; and what it says of a fault of its own.

pub mod name;
pub mod panics;
pub mod printable;
pub mod read;
pub mod write;

pub use name::{Name, NameError};
pub use panics::report_panics;
pub use printable::printable;
pub use read::{ReadProblem, read, read_text, shortened};
pub use write::{Draft, Existing, WriteError, write};
