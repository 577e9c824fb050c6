//! A table of one demonstration: `time_s` and the columns of our own format, in any order.
//!
//! `vx_m_s`, `vy_m_s`, `vz_m_s` are compared with the times when all of the space are there. Other
//! columns are disregarded. `<name>.frames.json` beside `<name>.csv` holds `{"frames": {…}}`, as in
//! our own format.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use csv::StringRecord;
use serde::Deserialize;
use tprmp_model::skill_model::Manifold;

use super::recording::Recording;
use super::rows::{ROWS_MAX, pose_of, read_bytes, vector_of};
use super::selection::Selection;
use crate::demonstration::{FileFrame, columns, frame, other_frames};
use crate::file_error::{FileError, read_text};

#[derive(Deserialize)]
struct Frames {
    frames: BTreeMap<String, FileFrame>,
}

/// Longest line [bytes]: a thousand columns.
const LINE_MAX: usize = 32 << 10;
/// Most columns.
const COLUMNS_MAX: usize = 1000;
/// Largest file of frames [bytes].
const FRAMES_BYTES_MAX: u64 = 1 << 20;

/// The demonstration of a table.
pub(super) fn read(path: &Path, selection: &Selection) -> Result<Recording, FileError> {
    let bytes = read_bytes(path)?;
    check_lines(&bytes).map_err(|(place, problem)| FileError::input(path, place, problem))?;
    let mut table = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes.as_slice());
    let malformed = |e: csv::Error| {
        let line = e.position().map_or(1, csv::Position::line);
        let problem = format!("expected a table of text, found: {e}");
        FileError::input(path, format!("line {line}"), problem)
    };
    let header = Header::new(table.headers().map_err(malformed)?, path)?;
    let manifold = header.manifold();
    let speeds = &["vx_m_s", "vy_m_s", "vz_m_s"][..manifold.position_dimension()];
    let time_column = header.find(&["time_s"])?;
    let pose_columns = header.find(columns(manifold))?;
    let speed_columns = if header.has(speeds) { header.find(speeds)? } else { Vec::new() };

    let (mut times_s, mut poses, mut velocities) = (Vec::new(), Vec::new(), Vec::new());
    for record in table.records() {
        let record = record.map_err(malformed)?;
        let line = record.position().map_or(0, csv::Position::line);
        let numbers = |columns| {
            numbers(&record, columns).map_err(|(column, problem)| {
                FileError::input(path, format!("line {line}, column `{column}`"), problem)
            })
        };
        if times_s.len() == ROWS_MAX {
            let problem =
                format!("expected at most {ROWS_MAX} rows, found more; record fewer a second");
            return Err(FileError::input(path, format!("line {line}"), problem));
        }
        times_s.push(numbers(&time_column)?[0]);
        poses.push(pose_of(&numbers(&pose_columns)?).map_err(|problem| {
            let place = format!("line {line}, columns `qw`, `qx`, `qy`, `qz`");
            FileError::input(path, place, problem)
        })?);
        if !speed_columns.is_empty() {
            velocities.push(vector_of(&numbers(&speed_columns)?));
        }
    }

    let frames_path = path.with_extension("frames.json");
    let frames: Frames = serde_json::from_str(&read_text(&frames_path, FRAMES_BYTES_MAX)?)
        .map_err(|e| FileError::syntax(&frames_path, e.line(), e.column(), e.to_string()))?;
    let [start, goal] = selection.frames(manifold);
    Ok(Recording {
        place: "rows".into(),
        manifold,
        start: frame(&frames.frames, &start, manifold, &frames_path)?,
        goal_frame: frame(&frames.frames, &goal, manifold, &frames_path)?,
        other_frames: other_frames(&frames.frames, [&start, &goal], manifold, &frames_path)?,
        times_s,
        poses,
        velocities: (!speed_columns.is_empty()).then_some(velocities),
    })
}

/// Refuses a line of more columns than a recording has before it is taken apart, and one that ends in
/// quotes: a row of any length could follow.
fn check_lines(bytes: &[u8]) -> Result<(), (String, String)> {
    for (i, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
        let place = || format!("line {}", i + 1);
        if line.len() > LINE_MAX {
            let found = line.len();
            return Err((place(), format!("expected at most {LINE_MAX} bytes, found {found}")));
        }
        if line.iter().filter(|byte| **byte == b'"').count() % 2 == 1 {
            return Err((place(), "expected quotes that end in their line".into()));
        }
    }
    Ok(())
}

/// A column's name and its place in a row.
type Column = (String, usize);

/// The names of a table's columns.
struct Header<'a> {
    path: &'a Path,
    names: Vec<&'a str>,
}

impl<'a> Header<'a> {
    fn new(record: &'a StringRecord, path: &'a Path) -> Result<Self, FileError> {
        // Some programs begin a text with a byte order mark.
        let names: Vec<_> = record.iter().map(|name| name.trim_start_matches('\u{feff}')).collect();
        let header = Self { path, names };
        if header.names.len() > COLUMNS_MAX {
            let problem =
                format!("expected at most {COLUMNS_MAX} columns, found {}", header.names.len());
            return Err(FileError::input(path, "line 1", problem));
        }
        let mut before = HashSet::new();
        match header.names.iter().find(|name| !before.insert(**name)) {
            Some(twice) => Err(header.refuse(twice, "expected it once, found it again")),
            None => Ok(header),
        }
    }

    fn refuse(&self, column: &str, problem: impl Into<String>) -> FileError {
        FileError::input(self.path, format!("column `{column}`"), problem)
    }

    fn has(&self, all: &[&str]) -> bool {
        all.iter().all(|name| self.names.contains(name))
    }

    fn manifold(&self) -> Manifold {
        match (self.has(&["qw"]), self.has(&["z_m"])) {
            (true, _) => Manifold::R3S3,
            (_, true) => Manifold::R3,
            _ => Manifold::R2,
        }
    }

    fn find(&self, wanted: &[&str]) -> Result<Vec<Column>, FileError> {
        let find = |name: &&str| {
            let found = self.names.iter().position(|n| n == name);
            found.map(|at| ((*name).to_owned(), at)).ok_or_else(|| {
                let expected = columns(self.manifold()).join(", ");
                let found = self.names.join(", ");
                let problem = format!("expected a header with time_s, {expected}, found {found}");
                self.refuse(name, problem)
            })
        };
        wanted.iter().map(find).collect()
    }
}

/// Finite numbers of a row, or the column that has none and what was expected.
fn numbers(record: &StringRecord, columns: &[Column]) -> Result<Vec<f64>, (String, String)> {
    let number = |(name, at): &Column| {
        let text = record.get(*at).unwrap_or_default();
        let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
        number.ok_or_else(|| (name.clone(), format!("expected a finite number, found `{text}`")))
    };
    columns.iter().map(number).collect()
}
