//! Imports demonstrations of other formats. The extension decides which one it is:
//!
//! * `.json` the layout of the thesis' reference data (`thesis.rs`),
//! * `.csv` a table, with its frames beside it in `<name>.frames.json` (`table.rs`),
//! * `.npz` arrays of NumPy (`npz.rs`),
//! * `.mat` shapes of the LASA handwriting data set (`lasa.rs`).
//!
//! Each reader gives recordings; `recording.rs` checks them and brings them to even times.

mod importer;
mod lasa;
mod mat;
mod npz;
mod recording;
mod resampling;
mod rows;
mod selection;
mod table;
mod thesis;

pub use importer::{import, load};
pub use selection::{Interpolation, Selection};
