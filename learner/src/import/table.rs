//! A table of one demonstration: `time_s` and the columns of our own format, in any order.
//!
//! `vx_m_s`, `vy_m_s`, `vz_m_s` are compared with the times when all of the space are there. Other
//! columns are disregarded. `<name>.frames.json` beside `<name>.csv` holds `{"frames": {…}}`, as in
//! our own format.

use std::collections::BTreeMap;
use std::path::Path;

use csv::StringRecord;
use serde::Deserialize;
use tprmp_model::skill_model::Manifold;

use super::recording::Recording;
use super::rows::{pose_of, read_bytes, vector_of};
use super::selection::Selection;
use crate::demonstration::{FileFrame, columns, frame, other_frames};
use crate::file_error::{FileError, read_text};

#[derive(Deserialize)]
struct Frames {
    frames: BTreeMap<String, FileFrame>,
}

/// The demonstration of a table.
pub(super) fn read(path: &Path, selection: &Selection) -> Result<Recording, FileError> {
    let bytes = read_bytes(path)?;
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
    let frames: Frames = serde_json::from_str(&read_text(&frames_path)?)
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
        let names = &header.names;
        match names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
            Some((_, twice)) => Err(header.refuse(twice, "expected it once, found it again")),
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
