//! One array of NumPy (`np.save`) with several demonstrations: demonstrations × samples × coordinates, or
//! samples × coordinates for one.
//!
//! `<name>.array.json` beside `<name>.npy` says what the coordinates are, when the samples were taken, and
//! the frames:
//!
//! ```text
//! {"columns": ["x_m", "y_m"], "sampling_time_s": 0.02, "frames": {"start": {…}, "end": {…}},
//!  "demonstrations": [{"frames": {…}, "samples": 87}, …]}
//! ```
//!
//! Times are a column `time_s`, or `times_s`, a list common to all, or `sampling_time_s`. `frames` belong to
//! all demonstrations, those within `demonstrations` to one each; `samples` is said where the array is
//! filled up behind a shorter one.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::array::{Array, parse};
use super::clock::Stamp;
use super::columns::{Columns, Wrong};
use super::frames::{DEMONSTRATIONS_MAX, FrameFile, Own, parse as parse_json};
use super::joints::Joints;
use super::recording::Recording;
use super::rows::{ROWS_MAX, read_bytes};
use super::samples::Samples;
use super::selection::Selection;
use crate::demonstration::FileFrame;
use crate::demonstration::at_most::at_most;
use crate::file_error::{FileError, read_text};

/// Largest file beside an array \[bytes\].
const BYTES_MAX: u64 = 16 << 20;
/// Most coordinates.
const COLUMNS_MAX: usize = 1000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Layout {
    #[serde(default, deserialize_with = "at_most::<COLUMNS_MAX, _, _>")]
    columns: Vec<String>,
    sampling_time_s: Option<f64>,
    #[serde(default, deserialize_with = "at_most::<ROWS_MAX, _, _>")]
    times_s: Vec<f64>,
    #[serde(default)]
    frames: BTreeMap<String, FileFrame>,
    #[serde(default, deserialize_with = "at_most::<DEMONSTRATIONS_MAX, _, _>")]
    demonstrations: Vec<Own>,
}

/// The demonstrations of an array.
pub(super) fn read(
    path: &Path,
    mut joints: Option<&mut Joints>,
    selection: &Selection,
) -> Result<Vec<Recording>, FileError> {
    let array =
        parse(&read_bytes(path)?, 3).map_err(|problem| FileError::input(path, "array", problem))?;
    let layout_path = path.with_extension("array.json");
    let mut layout: Layout = parse_json(&read_text(&layout_path, BYTES_MAX)?, &layout_path)?;
    let own = std::mem::take(&mut layout.demonstrations);
    let frames = std::mem::take(&mut layout.frames);
    if !selection.columns.is_empty() {
        layout.columns.clone_from(&selection.columns);
    }
    let fail = |key: &str, problem: String| FileError::key(&layout_path, key, problem);
    if layout.columns.len() != array.columns() {
        let (expected, found) = (array.columns(), layout.columns.len());
        let problem = format!("expected {expected} names, one a coordinate, found {found}");
        return Err(fail("columns", problem));
    }
    let in_column = |(column, problem): Wrong| {
        FileError::input(&layout_path, format!("key `columns`, column `{column}`"), problem)
    };
    let names = joints.as_ref().map(|joints| &joints.names[..]);
    let columns =
        Columns::find(&layout.columns, names, false, true, selection).map_err(in_column)?;
    let times = Times::new(&layout, &columns, array.rows()).map_err(|(key, e)| fail(&key, e))?;
    if array.blocks() > DEMONSTRATIONS_MAX {
        let found = array.blocks();
        let problem =
            format!("expected at most {DEMONSTRATIONS_MAX} demonstrations, found {found}");
        return Err(FileError::input(path, "array", problem));
    }
    if !own.is_empty() && own.len() != array.blocks() {
        let (expected, found) = (array.blocks(), own.len());
        let problem = format!("expected {expected}, as many as the array has, found {found}");
        return Err(fail("demonstrations", problem));
    }
    let file = match &selection.frames {
        Some(_) => FrameFile::read(&layout_path, true, selection)?,
        None => Some(FrameFile::of(&layout_path, frames, own)),
    };
    let block = |i: usize| {
        let block =
            Block { array: &array, names: &layout.columns, columns: &columns, times: &times, i };
        let samples = block.samples(path, file.as_ref(), joints.as_deref_mut(), selection)?;
        samples.finish(path, &block.place(), file.as_ref().map(|file| (file, i)))
    };
    (0..array.blocks()).map(block).collect()
}

/// Where the times of samples come from.
enum Times<'a> {
    Column(usize),
    List(&'a [f64]),
    Even(f64),
}

impl<'a> Times<'a> {
    /// The one source of times that there is, or the key that is wrong.
    fn new(layout: &'a Layout, columns: &Columns, rows: usize) -> Result<Self, Wrong> {
        let list = &layout.times_s[..];
        match (columns.time, list, layout.sampling_time_s) {
            (Some((column, _)), [], None) => Ok(Self::Column(column)),
            (None, [], Some(step_s)) if step_s.is_finite() && step_s > 0.0 => {
                Ok(Self::Even(step_s))
            }
            (None, [], Some(step_s)) => {
                let problem = format!("expected a positive time, found {step_s}");
                Err(("sampling_time_s".into(), problem))
            }
            (None, [_, ..], None) if list.len() == rows => Ok(Self::List(list)),
            (None, [_, ..], None) => {
                let found = list.len();
                Err((
                    "times_s".into(),
                    format!("expected {rows} times, one a sample, found {found}"),
                ))
            }
            _ => {
                let problem = "expected the times once: a column `time_s`, or the key `times_s`, or \
                               `sampling_time_s`";
                Err(("sampling_time_s".into(), problem.into()))
            }
        }
    }

    fn stamp(&self, sample: usize, row: &[f64]) -> Stamp {
        Stamp::of(match self {
            Self::Column(column) => row[*column],
            Self::List(list) => list[sample],
            Self::Even(step_s) => sample as f64 * step_s,
        })
    }
}

/// One demonstration of an array.
struct Block<'a> {
    array: &'a Array,
    names: &'a [String],
    columns: &'a Columns,
    times: &'a Times<'a>,
    i: usize,
}

impl<'a> Block<'a> {
    fn place(&self) -> String {
        format!("array[{}]", self.i)
    }

    fn samples(
        &self,
        path: &Path,
        file: Option<&FrameFile>,
        joints: Option<&'a mut Joints>,
        selection: &'a Selection,
    ) -> Result<Samples<'a>, FileError> {
        let rows = self.array.rows();
        let own = file.and_then(|file| file.own.get(self.i)?.samples).unwrap_or(rows);
        if own > rows {
            let problem = format!("expected at most {rows} `samples` in all, found {own}");
            return Err(FileError::input(path, self.place(), problem));
        }
        let mut samples = Samples::new(self.columns, joints, selection);
        for sample in 0..own.min(ROWS_MAX) {
            let row = self.array.row(self.i * rows + sample);
            let number = |column: usize| {
                let problem = || {
                    format!(
                        "expected a finite number, found {}; the key `demonstrations[{}].samples` says where a \
                         shorter demonstration ends",
                        row[column], self.i
                    )
                };
                let finite = Some(row[column]).filter(|number| number.is_finite());
                finite.ok_or_else(|| (self.names[column].clone(), problem()))
            };
            let stamp = self.columns.time.map_or(Ok(0.0), |(column, _)| number(column));
            let stamp = stamp.map(|_| self.times.stamp(sample, row));
            stamp.and_then(|stamp| samples.push(stamp, number)).map_err(|(column, problem)| {
                let place = format!("array[{}, {sample}], column `{column}`", self.i);
                FileError::input(path, place, problem)
            })?;
        }
        Ok(samples)
    }
}
