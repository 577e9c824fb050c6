//! Arrays of one demonstration in a NumPy archive (`np.savez`, `np.savez_compressed`):
//! `time_s` (N), `poses` (N×2, N×3 or N×7: x y z qw qx qy qz) and `frames/<name>` (7 numbers).
//!
//! `velocities` (N×2 or more, linear first) are compared with the times when they are there. Other
//! arrays are disregarded. Arrays hold little-endian floats or integers of 4 or 8 bytes.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::Path;

use glam::DVec3;
use npyz::{NpyHeader, Order};
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;
use zip::ZipArchive;
use zip::result::ZipError;

use super::recording::Recording;
use super::rows::{ROWS_MAX, pose_of, read_bytes, vector_of};
use super::selection::Selection;
use crate::file_error::FileError;

/// Most opening brackets in the header of an array. Numbers have two; the parser takes a time
/// exponential in their depth.
const BRACKETS_MAX: usize = 8;

/// Most numbers of an array.
const NUMBERS_MAX: usize = 7 * ROWS_MAX;
/// Most unpacked bytes of an array: its numbers and its header.
const ARRAY_BYTES_MAX: u64 = (8 * NUMBERS_MAX + (1 << 16)) as u64;
/// Most arrays of an archive, counted before its directory is read.
const ARRAYS_MAX: usize = 1000;
/// How an entry of the directory begins.
const DIRECTORY_ENTRY: &[u8] = b"PK\x01\x02";

/// The demonstration of an archive.
pub(super) fn read(path: &Path, selection: &Selection) -> Result<Recording, FileError> {
    let mut archive = Archive::open(path)?;
    let poses = archive.array("poses")?;
    let (rows, columns) = (poses.rows, poses.columns);
    let manifold = match columns {
        2 => Manifold::R2,
        3 => Manifold::R3,
        7 => Manifold::R3S3,
        _ => {
            let problem = format!("expected N×2, N×3 or N×7 numbers, found {rows}×{columns}");
            return Err(archive.refuse("poses", problem));
        }
    };
    let times = archive.array("time_s")?;
    if times.values.len() != rows {
        let problem = format!("expected {rows} times, one a pose, found {}", times.values.len());
        return Err(archive.refuse("time_s", problem));
    }
    let velocities = archive.velocities(rows, manifold.position_dimension())?;
    let [start, goal] = selection.frames(manifold);
    let (start_frame, goal_frame) =
        (archive.frame(&start, manifold)?, archive.frame(&goal, manifold)?);
    let mut other_frames = BTreeMap::new();
    for name in archive.names.clone() {
        if let Some(name) = name.strip_prefix("frames/")
            && name != start
            && name != goal
        {
            other_frames.insert(name.to_owned(), archive.frame(name, manifold)?);
        }
    }
    let pose = |i: usize| {
        let pose = pose_of(poses.row(i));
        pose.map_err(|problem| archive.refuse("poses", format!("row {i}: {problem}")))
    };
    Ok(Recording {
        place: "array `time_s`, `poses`".into(),
        manifold,
        start: start_frame,
        goal_frame,
        other_frames,
        times_s: times.values,
        poses: (0..rows).map(pose).collect::<Result<_, _>>()?,
        velocities,
    })
}

/// An archive of arrays.
struct Archive<'a> {
    path: &'a Path,
    zip: ZipArchive<Cursor<Vec<u8>>>,
    /// Names of the arrays, sorted.
    names: Vec<String>,
}

impl<'a> Archive<'a> {
    fn open(path: &'a Path) -> Result<Self, FileError> {
        let bytes = read_bytes(path)?;
        let arrays = bytes.windows(4).filter(|window| *window == DIRECTORY_ENTRY).count();
        if arrays > ARRAYS_MAX {
            let problem = format!("expected at most {ARRAYS_MAX} arrays, found {arrays}");
            return Err(FileError::input(path, "archive", problem));
        }
        let zip = ZipArchive::new(Cursor::new(bytes)).map_err(|e| {
            FileError::input(path, "archive", format!("expected a NumPy archive (zip): {e}"))
        })?;
        let files = zip.file_names().filter_map(Result::ok);
        let mut names: Vec<String> =
            files.filter_map(|file| file.strip_suffix(".npy").map(str::to_owned)).collect();
        names.sort();
        Ok(Self { path, zip, names })
    }

    fn refuse(&self, array: &str, problem: String) -> FileError {
        FileError::input(self.path, format!("array `{array}`"), problem)
    }

    /// An array of finite numbers.
    fn array(&mut self, name: &str) -> Result<Array, FileError> {
        let content = self.content(name).map_err(|problem| self.refuse(name, problem))?;
        let array = parse(&content).map_err(|problem| self.refuse(name, problem))?;
        if let Some(i) = array.values.iter().position(|x| !x.is_finite()) {
            let (row, column) = (i / array.columns, i % array.columns);
            let problem = format!(
                "expected finite numbers, found {} at row {row}, column {column}",
                array.values[i]
            );
            return Err(self.refuse(name, problem));
        }
        Ok(array)
    }

    fn content(&mut self, name: &str) -> Result<Vec<u8>, String> {
        let entry = self.zip.by_name(&format!("{name}.npy")).map_err(|e| match e {
            ZipError::FileNotFound => {
                format!("expected this array, found only [{}]", self.names.join(", "))
            }
            other => other.to_string(),
        })?;
        let mut content = Vec::new();
        let read = entry.take(ARRAY_BYTES_MAX + 1).read_to_end(&mut content);
        read.map_err(|e| format!("it cannot be unpacked: {e}"))?;
        if content.len() as u64 > ARRAY_BYTES_MAX {
            return Err(format!("expected at most {ARRAY_BYTES_MAX} bytes unpacked, found more"));
        }
        Ok(content)
    }

    /// The velocities [m/s], where there are some.
    fn velocities(
        &mut self,
        rows: usize,
        columns_min: usize,
    ) -> Result<Option<Vec<DVec3>>, FileError> {
        let name = "velocities";
        if !self.names.iter().any(|other| other == name) {
            return Ok(None);
        }
        let array = self.array(name)?;
        if array.rows != rows || array.columns < columns_min {
            let problem = format!(
                "expected {rows}×{columns_min} numbers or more columns, found {}×{}",
                array.rows, array.columns
            );
            return Err(self.refuse(name, problem));
        }
        Ok(Some((0..rows).map(|i| vector_of(&array.row(i)[..columns_min])).collect()))
    }

    fn frame(&mut self, name: &str, manifold: Manifold) -> Result<Pose, FileError> {
        let name = format!("frames/{name}");
        let numbers = self.array(&name)?.values;
        if numbers.len() != 7 {
            let problem = format!("expected 7 numbers x y z qw qx qy qz, found {}", numbers.len());
            return Err(self.refuse(&name, problem));
        }
        let pose = pose_of(&numbers).map_err(|problem| self.refuse(&name, problem))?;
        let tilt = pose.orientation.x.hypot(pose.orientation.y);
        if manifold == Manifold::R2 && (pose.position.z != 0.0 || tilt > 1e-3) {
            let problem = "expected z = 0 and a rotation about z for a planar skill";
            return Err(self.refuse(&name, problem.into()));
        }
        Ok(pose)
    }
}

/// An array of one or two axes; one axis is a column.
#[derive(Debug)]
struct Array {
    rows: usize,
    columns: usize,
    /// Row by row.
    values: Vec<f64>,
}

impl Array {
    fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.columns..(i + 1) * self.columns]
    }
}

/// Reads an array in NumPy's own format, version 1, in which all arrays of numbers are written.
fn parse(bytes: &[u8]) -> Result<Array, String> {
    let wrong = |e: std::io::Error| format!("expected a NumPy array (npy): {e}");
    let truncated = "the array is truncated";
    let (start, rest) = bytes.split_first_chunk::<10>().ok_or(truncated)?;
    let length = usize::from(u16::from_le_bytes([start[8], start[9]]));
    let (text, data) = rest.split_at_checked(length).ok_or(truncated)?;
    if start[6] != 1 || text.iter().filter(|byte| b"([{".contains(byte)).count() > BRACKETS_MAX {
        return Err("expected a NumPy array (npy) of numbers, version 1".into());
    }
    let header = NpyHeader::from_reader(&bytes[..10 + length]).map_err(wrong)?;
    let (rows, columns) = match *header.shape() {
        [rows] => (rows, 1),
        [rows, columns] => (rows, columns),
        ref axes => return Err(format!("expected one or two axes, found shape {axes:?}")),
    };
    if rows.checked_mul(columns).is_none_or(|count| count > NUMBERS_MAX as u64) {
        return Err(format!(
            "expected at most {NUMBERS_MAX} numbers by its shape, found {rows}×{columns}"
        ));
    }
    let descr = header.dtype().descr();
    let numbers: Vec<f64> = match descr.trim_matches('\'') {
        "<f8" => all(data, f64::from_le_bytes),
        "<f4" => all(data, |b| f64::from(f32::from_le_bytes(b))),
        "<i8" => all(data, |b| i64::from_le_bytes(b) as f64),
        "<i4" => all(data, |b| f64::from(i32::from_le_bytes(b))),
        kind => {
            return Err(format!("expected numbers `<f8`, `<f4`, `<i8` or `<i4`, found `{kind}`"));
        }
    };
    if rows.checked_mul(columns) != Some(numbers.len() as u64) {
        let found = numbers.len();
        return Err(format!("expected {rows}×{columns} numbers by its shape, found {found}"));
    }
    let (rows, columns) = (rows as usize, columns as usize);
    let values = match header.order() {
        Order::C => numbers,
        Order::Fortran => {
            (0..numbers.len()).map(|i| numbers[i % columns * rows + i / columns]).collect()
        }
    };
    Ok(Array { rows, columns, values })
}

/// All whole numbers of N bytes each.
fn all<const N: usize>(data: &[u8], number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
    data.as_chunks().0.iter().map(|chunk| number(*chunk)).collect()
}
