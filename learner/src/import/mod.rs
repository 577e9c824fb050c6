//! Imports demonstrations of other formats. The extension decides which one it is:
//!
//! * `.csv` a table, with its frames beside it in `<name>.frames.json` (`table.rs`),
//! * `.npz` arrays of NumPy (`npz.rs`),
//! * `.npy` one array of several demonstrations, described in `<name>.array.json` (`npy.rs`),
//! * `.mat` shapes of the LASA handwriting data set (`lasa.rs`),
//! * `.json` the layout of the thesis' reference data (`thesis.rs`),
//! * a folder with `meta/info.json` a LeRobot data set (`lerobot.rs`, `parquet.rs`).
//!
//! `sources.rs` looks into folders. Rows of numbers are found by the names of their columns (`columns.rs`)
//! and become a recording in `samples.rs`; the joints of a robot become poses in `joints.rs`.
//! `recording.rs` checks each recording and brings it to even times.

mod array;
mod clock;
mod columns;
mod frames;
mod holes;
mod importer;
mod joints;
mod lasa;
mod lerobot;
mod mat;
mod names;
mod npy;
mod npz;
mod parquet;
mod recording;
mod resampling;
mod rows;
mod samples;
mod selection;
mod sources;
mod table;
mod thesis;

pub use importer::{Imported, import, load};
pub use selection::{AngleUnit, Closed, Interpolation, LengthUnit, Selection, Space, TimeUnit};
