//! A table of one demonstration: `time_s` and the columns of our own format, in any order.
//!
//! `vx_m_s`, `vy_m_s`, `vz_m_s` are compared with the times when all of the space are there. Other
//! columns are disregarded. `<name>.frames.json` beside `<name>.csv` holds `{"frames": {…}}`, as in
//! our own format.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DQuat, DVec3};
use serde::Deserialize;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::{Recording, Selection, input, read_bytes};
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
        input(path, format!("line {line}"), format!("expected a table of text, found: {e}"))
    };
    let header = table.headers().map_err(malformed)?.clone();
    // Some programs begin a text with a byte order mark.
    let names: Vec<&str> = header.iter().map(|name| name.trim_start_matches('\u{feff}')).collect();
    if let Some(twice) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
        return Err(column(path, twice.1, "expected it once, found it again".into()));
    }
    let has = |all: &[&str]| all.iter().all(|name| names.contains(name));
    let manifold = if has(&["qw"]) {
        Manifold::R3S3
    } else if has(&["z_m"]) {
        Manifold::R3
    } else {
        Manifold::R2
    };
    let places = |wanted: &[&str]| -> Result<Vec<(String, usize)>, FileError> {
        let place = |name: &&str| {
            let found = names.iter().position(|n| n == name);
            found.map(|at| ((*name).to_owned(), at)).ok_or_else(|| {
                let expected = columns(manifold).join(", ");
                let problem = format!(
                    "expected a header with time_s, {expected}, found {}",
                    names.join(", ")
                );
                column(path, name, problem)
            })
        };
        wanted.iter().map(place).collect()
    };
    let speeds = &["vx_m_s", "vy_m_s", "vz_m_s"][..manifold.position_dimension()];
    let time_column = places(&["time_s"])?;
    let pose_columns = places(columns(manifold))?;
    let speed_columns = if has(speeds) { places(speeds)? } else { Vec::new() };

    let (mut times_s, mut poses, mut velocities) = (Vec::new(), Vec::new(), Vec::new());
    for record in table.records() {
        let record = record.map_err(malformed)?;
        let line = record.position().map_or(0, csv::Position::line);
        let numbers = |columns: &[(String, usize)]| -> Result<Vec<f64>, FileError> {
            let number = |(name, at): &(String, usize)| {
                let text = record.get(*at).unwrap_or_default();
                text.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(|| {
                    let problem = format!("expected a finite number, found `{text}`");
                    input(path, format!("line {line}, column `{name}`"), problem)
                })
            };
            columns.iter().map(number).collect()
        };
        times_s.push(numbers(&time_column)?[0]);
        poses.push(pose_of(&numbers(&pose_columns)?).map_err(|problem| {
            input(path, format!("line {line}, columns `qw`, `qx`, `qy`, `qz`"), problem)
        })?);
        if !speed_columns.is_empty() {
            velocities.push(vector_of(&numbers(&speed_columns)?));
        }
    }

    let frames_path = path.with_extension("frames.json");
    let text = read_text(&frames_path)?;
    let frames: Frames = serde_json::from_str(&text)
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

fn column(path: &Path, name: &str, problem: String) -> FileError {
    input(path, format!("column `{name}`"), problem)
}

/// x, y and z if there is one.
pub(super) fn vector_of(row: &[f64]) -> DVec3 {
    DVec3::new(row[0], row[1], row.get(2).copied().unwrap_or(0.0))
}

/// The pose of 2, 3 or 7 numbers: x y [z [qw qx qy qz]].
pub(super) fn pose_of(row: &[f64]) -> Result<Pose, String> {
    let orientation = match row.get(3..7) {
        None => DQuat::IDENTITY,
        Some(q) => {
            let q = DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
            let length = q.length();
            if !length.is_finite() || (length - 1.0).abs() > 1e-3 {
                return Err(format!(
                    "expected a unit quaternion w, x, y, z, found one of length {length:.6}"
                ));
            }
            q.normalize()
        }
    };
    Ok(Pose { position: vector_of(row), orientation })
}
