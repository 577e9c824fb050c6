//! Arrays of one demonstration in a NumPy archive (`np.savez`, `np.savez_compressed`):
//! `time_s` (N), `poses` (N×2, N×3 or N×7: x y z qw qx qy qz) and `frames/<name>` (7 numbers).
//!
//! `gripper` (N, 0 for open and 1 for closed) or `gripper_width_m` (N) say what the gripper does.
//! `velocities` (N×2 or more, linear first) are compared with the times when they are there. Other
//! arrays are named in the summary; those that are nearly known are refused. Arrays hold little-endian floats or integers of 4 or 8 bytes.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::Path;

use glam::DVec3;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;
use zip::ZipArchive;
use zip::result::ZipError;

use super::array::{Array, NUMBERS_MAX, parse};
use super::clock::{Clock, Stamp};
use super::names::nearly;
use super::recording::Recording;
use super::rows::{pose_of, read_bytes, vector_of};
use super::samples::{check_grip, gripper_note, grips_of};
use super::selection::{Selection, TimeUnit};
use crate::demonstration::{Gripper, check_width};
use crate::file_error::FileError;

/// Most unpacked bytes of an array: its numbers and its header.
const ARRAY_BYTES_MAX: u64 = (8 * NUMBERS_MAX + (1 << 16)) as u64;
/// Most arrays of an archive, counted before its directory is read.
const ARRAYS_MAX: usize = 1000;
/// Names of arrays.
const KNOWN: [&str; 5] = ["gripper", "gripper_width_m", "poses", "time_s", "velocities"];
/// How an entry of the directory begins.
const DIRECTORY_ENTRY: &[u8] = b"PK\x01\x02";

/// The demonstration of an archive.
pub(super) fn read(path: &Path, selection: &Selection) -> Result<Recording, FileError> {
    let mut archive = Archive::open(path, selection.length_m())?;
    archive.check_names()?;
    let poses = archive.array("poses")?;
    let (rows, columns) = (poses.rows(), poses.columns());
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
    let mut clock = Clock::new(TimeUnit::S, selection.time_unit);
    let seconds = |time: &f64| clock.seconds(Stamp::of(*time));
    let times_s = times.values.iter().map(seconds).collect::<Result<Vec<_>, _>>();
    let times_s = times_s.map_err(|problem| archive.refuse("time_s", problem))?;
    let velocities = archive.velocities(rows, manifold.position_dimension())?;
    let gripper = archive.gripper(rows)?;
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
        let pose = pose_of(poses.row(i), archive.length_m);
        pose.map_err(|problem| archive.refuse("poses", format!("row {i}: {problem}")))
    };
    Ok(Recording {
        place: "array `time_s`, `poses`".into(),
        manifold,
        start: start_frame,
        goal_frame,
        other_frames,
        times_s,
        poses: (0..rows).map(pose).collect::<Result<_, _>>()?,
        velocities,
        notes: clock.note().into_iter().chain(gripper.as_ref().map(gripper_note)).collect(),
        gripper,
        ignored: archive.ignored(),
        has_own_unit: false,
    })
}

/// An archive of arrays.
struct Archive<'a> {
    path: &'a Path,
    zip: ZipArchive<Cursor<Vec<u8>>>,
    /// Names of the arrays, sorted.
    names: Vec<String>,
    /// Metres in a unit of positions [m].
    length_m: f64,
}

impl<'a> Archive<'a> {
    fn open(path: &'a Path, length_m: f64) -> Result<Self, FileError> {
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
        Ok(Self { path, zip, names, length_m })
    }

    fn refuse(&self, array: &str, problem: String) -> FileError {
        FileError::input(self.path, format!("array `{array}`"), problem)
    }

    /// Arrays that are not read, as a list for people.
    fn ignored(&self) -> Option<String> {
        let others: Vec<&str> = self.others().take(8).collect();
        (!others.is_empty()).then(|| format!("ignored: {}", others.join(", ")))
    }

    /// Names of the arrays that are not read.
    fn others(&self) -> impl Iterator<Item = &str> {
        let names = self.names.iter().map(String::as_str);
        names.filter(|name| !KNOWN.contains(name) && !name.starts_with("frames/"))
    }

    /// Refuses an array that differs from a known one by case, unit or underscore.
    fn check_names(&self) -> Result<(), FileError> {
        for other in self.others() {
            let like = nearly(other, &KNOWN).filter(|like| !self.names.iter().any(|n| n == like));
            if let Some(like) = like {
                let problem = format!("it looks like `{like}`, and would be left out: rename it");
                return Err(self.refuse(other, problem));
            }
        }
        Ok(())
    }

    /// An array of finite numbers.
    fn array(&mut self, name: &str) -> Result<Array, FileError> {
        let content = self.content(name).map_err(|problem| self.refuse(name, problem))?;
        let array = parse(&content, 2).map_err(|problem| self.refuse(name, problem))?;
        if let Some(i) = array.values.iter().position(|x| !x.is_finite()) {
            let (row, column) = (i / array.columns(), i % array.columns());
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
        if array.rows() != rows || array.columns() < columns_min {
            let problem = format!(
                "expected {rows}×{columns_min} numbers or more columns, found {}×{}",
                array.rows(),
                array.columns()
            );
            return Err(self.refuse(name, problem));
        }
        Ok(Some(
            (0..rows).map(|i| vector_of(&array.row(i)[..columns_min]) * self.length_m).collect(),
        ))
    }

    /// What the gripper does, where there is an array of it: 0 for open and 1 for closed, or widths [m].
    fn gripper(&mut self, rows: usize) -> Result<Option<Gripper>, FileError> {
        let has = |name: &str| self.names.iter().any(|other| other == name);
        let name = match (has("gripper"), has("gripper_width_m")) {
            (false, false) => return Ok(None),
            (true, true) => {
                let problem = "expected this array or `gripper_width_m`, found both";
                return Err(self.refuse("gripper", problem.into()));
            }
            (true, false) => "gripper",
            (false, true) => "gripper_width_m",
        };
        let values = self.array(name)?.values;
        if values.len() != rows {
            let problem = format!("expected {rows} values, one a pose, found {}", values.len());
            return Err(self.refuse(name, problem));
        }
        let is_width = name == "gripper_width_m";
        let checked = values.iter().enumerate().map(|(i, value)| {
            let value = if is_width {
                check_width(Some(value * self.length_m))
            } else {
                check_grip(*value)
            };
            value.map_err(|problem| self.refuse(name, format!("row {i}: {problem}")))
        });
        let checked = checked.collect::<Result<Vec<_>, _>>()?;
        Ok(Some(if is_width {
            Gripper::Widths(checked)
        } else {
            Gripper::Grips(grips_of(&checked))
        }))
    }

    fn frame(&mut self, name: &str, manifold: Manifold) -> Result<Pose, FileError> {
        let name = format!("frames/{name}");
        let numbers = self.array(&name)?.values;
        if numbers.len() != 7 {
            let problem = format!("expected 7 numbers x y z qw qx qy qz, found {}", numbers.len());
            return Err(self.refuse(&name, problem));
        }
        let pose =
            pose_of(&numbers, self.length_m).map_err(|problem| self.refuse(&name, problem))?;
        let tilt = pose.orientation.x.hypot(pose.orientation.y);
        if manifold == Manifold::R2 && (pose.position.z != 0.0 || tilt > 1e-3) {
            let problem = "expected z = 0 and a rotation about z for a planar skill";
            return Err(self.refuse(&name, problem.into()));
        }
        Ok(pose)
    }
}
