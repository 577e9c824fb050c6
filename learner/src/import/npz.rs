//! Arrays of one demonstration in a NumPy archive (`np.savez`, `np.savez_compressed`):
//! `time_s` (N), `poses` (N×2, N×3 or N×7: x y z qw qx qy qz) and `frames/<name>` (7 numbers).
//!
//! `velocities` (N×2 or more, linear first) are compared with the times when they are there. Other
//! arrays are disregarded. Arrays hold little-endian floats or integers of 4 or 8 bytes.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::Path;

use glam::DVec3;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;
use zip::ZipArchive;

use super::table::{pose_of, vector_of};
use super::{BYTES_MAX, Recording, Selection, input, read_bytes};
use crate::file_error::FileError;

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

/// The demonstration of an archive.
pub(super) fn read(path: &Path, selection: &Selection) -> Result<Recording, FileError> {
    let bytes = read_bytes(path)?;
    let mut archive = ZipArchive::new(Cursor::new(bytes))
        .map_err(|e| input(path, "archive", format!("expected a NumPy archive (zip): {e}")))?;
    let fail = |name: &str, problem: String| input(path, format!("array `{name}`"), problem);
    let mut names: Vec<String> =
        archive.file_names().filter_map(|name| Some(name.ok()?.into_owned())).collect();
    names.sort();
    let found = names.iter().map(|n| n.trim_end_matches(".npy")).collect::<Vec<_>>().join(", ");
    let mut array = |name: &str| -> Result<Array, FileError> {
        let mut entry = archive.by_name(&format!("{name}.npy")).map_err(|e| match e {
            zip::result::ZipError::FileNotFound => {
                fail(name, format!("expected this array, found only [{found}]"))
            }
            other => fail(name, other.to_string()),
        })?;
        let mut content = Vec::new();
        let read = entry.by_ref().take(BYTES_MAX).read_to_end(&mut content);
        read.map_err(|e| fail(name, format!("it cannot be unpacked: {e}")))?;
        let array = npy(&content).map_err(|problem| fail(name, problem))?;
        if let Some(i) = array.values.iter().position(|x| !x.is_finite()) {
            let (row, column) = (i / array.columns, i % array.columns);
            let problem = format!(
                "expected finite numbers, found {} at row {row}, column {column}",
                array.values[i]
            );
            return Err(fail(name, problem));
        }
        Ok(array)
    };

    let poses = array("poses")?;
    let (rows, columns) = (poses.rows, poses.columns);
    let manifold = match columns {
        2 => Manifold::R2,
        3 => Manifold::R3,
        7 => Manifold::R3S3,
        _ => {
            let problem = format!("expected N×2, N×3 or N×7 numbers, found {rows}×{columns}");
            return Err(fail("poses", problem));
        }
    };
    let times = array("time_s")?;
    if times.values.len() != rows {
        let problem = format!("expected {rows} times, one a pose, found {}", times.values.len());
        return Err(fail("time_s", problem));
    }
    let velocities = if names.iter().any(|name| name == "velocities.npy") {
        let array = array("velocities")?;
        let least = manifold.position_dimension();
        if array.rows != rows || array.columns < least {
            let problem = format!(
                "expected {rows}×{least} numbers or more columns, found {}×{}",
                array.rows, array.columns
            );
            return Err(fail("velocities", problem));
        }
        Some((0..rows).map(|i| vector_of(&array.row(i)[..least])).collect::<Vec<DVec3>>())
    } else {
        None
    };
    let mut frame = |name: &str| -> Result<Pose, FileError> {
        let name = format!("frames/{name}");
        let numbers = array(&name)?.values;
        if numbers.len() != 7 {
            let problem = format!("expected 7 numbers x y z qw qx qy qz, found {}", numbers.len());
            return Err(fail(&name, problem));
        }
        let pose = pose_of(&numbers).map_err(|problem| fail(&name, problem))?;
        let tilt = pose.orientation.x.hypot(pose.orientation.y);
        if manifold == Manifold::R2 && (pose.position.z != 0.0 || tilt > 1e-3) {
            let problem = "expected z = 0 and a rotation about z for a planar skill";
            return Err(fail(&name, problem.into()));
        }
        Ok(pose)
    };
    let [start, goal] = selection.frames(manifold);
    let (start_frame, goal_frame) = (frame(&start)?, frame(&goal)?);
    let mut other_frames = BTreeMap::new();
    for name in names.iter().filter_map(|name| name.strip_prefix("frames/")?.strip_suffix(".npy")) {
        if name != start && name != goal {
            other_frames.insert(name.to_owned(), frame(name)?);
        }
    }
    let poses = (0..rows).map(|i| {
        pose_of(poses.row(i)).map_err(|problem| fail("poses", format!("row {i}: {problem}")))
    });
    Ok(Recording {
        place: "array `time_s`, `poses`".into(),
        manifold,
        start: start_frame,
        goal_frame,
        other_frames,
        times_s: times.values,
        poses: poses.collect::<Result<_, _>>()?,
        velocities,
    })
}

/// Reads an array in NumPy's own format, versions 1 to 3: magic, version, length of the header,
/// the header as text of a Python dictionary, numbers.
fn npy(bytes: &[u8]) -> Result<Array, String> {
    let truncated = || String::from("the array is truncated");
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or("expected a NumPy array (npy)")?;
    let (version, rest) = rest.split_at_checked(2).ok_or_else(truncated)?;
    let (length, rest) = match version[0] {
        1 => {
            let (length, rest) = rest.split_first_chunk().ok_or_else(truncated)?;
            (usize::from(u16::from_le_bytes(*length)), rest)
        }
        2 | 3 => {
            let (length, rest) = rest.split_first_chunk().ok_or_else(truncated)?;
            (u32::from_le_bytes(*length) as usize, rest)
        }
        other => return Err(format!("expected version 1, 2 or 3 of npy, found {other}")),
    };
    let (header, data) = rest.split_at_checked(length).ok_or_else(truncated)?;
    let header = std::str::from_utf8(header).map_err(|_| "its header is not text")?;
    let value = |key: &str| {
        let quoted = format!("'{key}':");
        let at = header.find(&quoted).ok_or(format!("its header has no `{key}`"))?;
        Ok::<_, String>(header[at + quoted.len()..].trim_start())
    };
    let fortran = value("fortran_order")?.starts_with("True");
    let shape = value("shape")?;
    let shape = shape.strip_prefix('(').and_then(|s| s.split_once(')')).map(|(inside, _)| {
        let axes = inside.split(',').map(str::trim).filter(|axis| !axis.is_empty());
        axes.map(str::parse::<usize>).collect::<Result<Vec<_>, _>>()
    });
    let (rows, columns) = match shape {
        Some(Ok(axes)) if axes.len() == 1 => (axes[0], 1),
        Some(Ok(axes)) if axes.len() == 2 => (axes[0], axes[1]),
        Some(Ok(axes)) => return Err(format!("expected one or two axes, found shape {axes:?}")),
        _ => return Err("its header has no readable `shape`".into()),
    };
    let kind = value("descr")?.trim_start_matches('\'');
    let numbers: Vec<f64> = match kind.get(..3) {
        Some("<f8") => all(data, f64::from_le_bytes),
        Some("<f4") => all(data, |b| f64::from(f32::from_le_bytes(b))),
        Some("<i8") => all(data, |b| i64::from_le_bytes(b) as f64),
        Some("<i4") => all(data, |b| f64::from(i32::from_le_bytes(b))),
        _ => {
            let kind: String = kind.chars().take_while(|c| *c != '\'').take(20).collect();
            return Err(format!("expected numbers `<f8`, `<f4`, `<i8` or `<i4`, found `{kind}`"));
        }
    };
    if rows.checked_mul(columns) != Some(numbers.len()) {
        let found = numbers.len();
        return Err(format!("expected {rows}×{columns} numbers by its shape, found {found}"));
    }
    let values = if fortran {
        (0..numbers.len()).map(|i| numbers[i % columns * rows + i / columns]).collect()
    } else {
        numbers
    };
    Ok(Array { rows, columns, values })
}

/// All whole numbers of N bytes each.
fn all<const N: usize>(data: &[u8], number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
    data.as_chunks().0.iter().map(|chunk| number(*chunk)).collect()
}
