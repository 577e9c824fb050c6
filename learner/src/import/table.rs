//! A table of one demonstration: times and the columns of our own format, or the joints of a robot, in any
//! order, separated by commas, semicolons or tabs.
//!
//! `vx_m_s`, `vy_m_s`, `vz_m_s` are compared with the times when all of the space are there. Columns that
//! are not known are named in the summary; those that are nearly known are refused.
//! `<name>.frames.json` beside `<name>.csv` holds `{"frames": {…}}`, as in our own format.

use std::path::Path;

use csv::StringRecord;

use super::clock::Stamp;
use super::columns::{Channel, Columns, Wrong};
use super::frames::FrameFile;
use super::joints::Joints;
use super::recording::Recording;
use super::rows::{ROWS_MAX, read_bytes};
use super::samples::Samples;
use super::selection::Selection;
use crate::demonstration::Grip;
use crate::file_error::FileError;

/// Longest line [bytes]: a thousand columns.
const LINE_MAX: usize = 32 << 10;
/// Most columns.
const COLUMNS_MAX: usize = 1000;
/// What separates columns, and how it is called.
const SEPARATORS: [(u8, &str); 3] = [(b',', "commas"), (b';', "semicolons"), (b'\t', "tabs")];
/// How some programs begin a text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The demonstration of a table.
pub(super) fn read(
    path: &Path,
    joints: Option<&mut Joints>,
    selection: &Selection,
) -> Result<Recording, FileError> {
    let refuse = |place: String, problem: String| FileError::input(path, place, problem);
    let all = read_bytes(path)?;
    let bytes = all.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&all);
    check_lines(bytes).map_err(|(place, problem)| refuse(place, problem))?;
    let (separator, separator_name) = separator(bytes);
    let mut reader = csv::ReaderBuilder::new();
    let mut table = reader.trim(csv::Trim::All).delimiter(separator).from_reader(bytes);
    let malformed = |e: csv::Error| {
        let line = e.position().map_or(1, csv::Position::line);
        refuse(format!("line {line}"), format!("expected a table of text, found: {e}"))
    };
    let names = header(table.headers().map_err(malformed)?)
        .map_err(|problem| refuse("line 1".into(), problem))?;
    let in_column = |(column, problem): Wrong| refuse(format!("column `{column}`"), problem);
    let joint_names = joints.as_ref().map(|joints| &joints.names[..]);
    let columns = Columns::find(&names, joint_names, true, true, selection).map_err(in_column)?;
    let time = columns.time.map_or(0, |(time, _)| time);

    let mut samples = Samples::new(&columns, joints, selection);
    for record in table.records() {
        let record = record.map_err(malformed)?;
        let line = record.position().map_or(0, csv::Position::line);
        if samples.len() == ROWS_MAX {
            let problem =
                format!("expected at most {ROWS_MAX} rows, found more; record fewer a second");
            return Err(refuse(format!("line {line}"), problem));
        }
        let cell = |i: usize| record.get(i).unwrap_or_default();
        let number = |i: usize| {
            let is_word = matches!(columns.channel, Some(Channel::Grips(column)) if column == i);
            match Grip::of_word(cell(i)).filter(|_| is_word) {
                Some(Grip::Open) => return Ok(0.0),
                Some(Grip::Closed) => return Ok(1.0),
                None => {}
            }
            let number = cell(i).parse::<f64>().ok().filter(|x| x.is_finite());
            number.ok_or_else(|| (names[i].clone(), not_a_number(cell(i))))
        };
        let stamp = Stamp::parse(cell(time));
        let stamp = stamp.ok_or_else(|| (names[time].clone(), not_a_number(cell(time))));
        stamp.and_then(|stamp| samples.push(stamp, number)).map_err(|(column, problem)| {
            refuse(format!("line {line}, column `{column}`"), problem)
        })?;
    }
    let goal_is_known = !columns.frames.is_empty() || selection.frame_at_closing.is_some();
    let file = FrameFile::read(&path.with_extension("frames.json"), !goal_is_known, selection)?;
    let mut recording = samples.finish(path, "rows", file.as_ref().map(|file| (file, 0)))?;
    if separator != b',' {
        recording.notes.push(format!("columns separated by {separator_name}"));
    }
    Ok(recording)
}

/// What was expected in place of a cell.
fn not_a_number(cell: &str) -> String {
    let comma = cell.contains(',') && cell.replace(',', ".").parse::<f64>().is_ok();
    let hint = if comma { "; export with decimal points" } else { "" };
    format!("expected a finite number, found `{cell}`{hint}")
}

/// What separates the columns: the separator that the first line has most of.
fn separator(bytes: &[u8]) -> (u8, &'static str) {
    let line = bytes.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let count = |separator: u8| line.iter().filter(|byte| **byte == separator).count();
    // Of several as frequent ones the last is taken, and commas stand last here.
    SEPARATORS.into_iter().rev().max_by_key(|(byte, _)| count(*byte)).unwrap_or(SEPARATORS[0])
}

/// The names of the columns.
fn header(record: &StringRecord) -> Result<Vec<String>, String> {
    if record.len() > COLUMNS_MAX {
        return Err(format!("expected at most {COLUMNS_MAX} columns, found {}", record.len()));
    }
    let is_number = |name: &str| name.parse::<f64>().is_ok();
    if !record.is_empty() && record.iter().all(is_number) {
        return Err(
            "expected a header with the names of the columns, found numbers: write one, for \
                    example `time_s,x_m,y_m,z_m,qw,qx,qy,qz`"
                .into(),
        );
    }
    Ok(record.iter().map(str::to_owned).collect())
}

/// Refuses a text of another encoding, a line of more columns than a recording has before it is taken apart,
/// and one that ends in quotes: a row of any length could follow.
fn check_lines(bytes: &[u8]) -> Result<(), (String, String)> {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(("line 1".into(), "expected UTF-8, found UTF-16: save it as UTF-8".into()));
    }
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
