//! Imports demonstrations of other formats, told apart by their extension:
//!
//! * `.json` the layout of the thesis' reference data ([`thesis`]),
//! * `.csv` a table, with its frames beside it in `<name>.frames.json` ([`table`]),
//! * `.npz` arrays of NumPy ([`npz`]),
//! * `.mat` shapes of the LASA handwriting data set ([`lasa`]).
//!
//! Each reader gives [`Recording`]s; [`recording`] checks them and brings them to even times.

mod lasa;
mod mat;
mod npz;
mod recording;
mod table;
mod thesis;

use std::path::{Path, PathBuf};

use tprmp_model::skill_model::Manifold;

use crate::demonstration::{Demonstration, to_text};
use crate::file_error::FileError;
use recording::Recording;

/// Larger files, and larger contents of compressed ones, are refused [bytes].
const BYTES_MAX: u64 = 256 << 20;

/// How values between samples are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Interpolation {
    /// Cubic Hermite: smooth, with the slopes of parabolas through three samples.
    #[default]
    Cubic,
    /// Straight lines, and turns at constant speed.
    Linear,
}

/// What to import, and how.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Name of the skill; the file's own name when there is none and the file has one.
    pub skill: Option<String>,
    /// Only demonstrations with this tag.
    pub tag: Option<String>,
    /// Name of the start frame; by default `start` in the plane, `ee_start` in space.
    pub start_frame: Option<String>,
    /// Name of the goal frame; by default `end` in the plane, `object` in space.
    pub goal_frame: Option<String>,
    /// Time between samples to bring the demonstrations to [s].
    pub sampling_time_s: Option<f64>,
    /// How.
    pub interpolation: Interpolation,
    /// Time between recorded samples in place of the file's own times [s].
    pub recorded_at_s: Option<f64>,
    /// The frames with which the thesis learned a demonstration in place of its own, where a file of
    /// the thesis' layout has them.
    pub reference_frames: bool,
}

impl Selection {
    /// Names of start and goal frame.
    fn frames(&self, manifold: Manifold) -> [String; 2] {
        let [start, goal] = match manifold {
            Manifold::R2 => ["start", "end"],
            Manifold::R3 | Manifold::R3S3 => ["ee_start", "object"],
        };
        let name = |chosen: &Option<String>, usual: &str| chosen.clone().unwrap_or(usual.into());
        [name(&self.start_frame, start), name(&self.goal_frame, goal)]
    }

    /// The skill's name of a file that has none.
    fn skill_of(&self, path: &Path) -> Result<String, FileError> {
        self.skill.clone().ok_or_else(|| {
            input(path, "option --skill", "expected the skill's name: such a file does not say it")
        })
    }
}

/// Imports a file and writes its demonstrations into a folder, which is made when it is missing:
/// `<file>.json` of a file with one demonstration, else `<skill>_01.json` and so on. Returns the
/// files written.
///
/// # Errors
/// [`FileError`], naming the file and the key, column, array or variable: the file cannot be
/// read or is not of the format, its times and velocities contradict each other, an option does
/// not fit, or the folder cannot be written.
pub fn import(
    foreign: &Path,
    folder: &Path,
    selection: &Selection,
) -> Result<Vec<PathBuf>, FileError> {
    let texts: Vec<_> = load(foreign, selection)?
        .into_iter()
        .map(|shown| {
            let [start_frame, goal_frame] = selection.frames(shown.manifold);
            (shown.name.clone(), to_text(&shown, &start_frame, &goal_frame))
        })
        .collect();
    let failed = |path: &Path, source| FileError::Write { path: path.into(), source };
    std::fs::create_dir_all(folder).map_err(|source| failed(folder, source))?;
    let mut written = Vec::with_capacity(texts.len());
    for (name, text) in texts {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|source| failed(&path, source))?;
        written.push(path);
    }
    Ok(written)
}

/// The demonstrations of a file, as [`import`] would write them.
///
/// # Errors
/// Those of [`import`] that concern the file.
pub fn load(foreign: &Path, selection: &Selection) -> Result<Vec<Demonstration>, FileError> {
    for (option, time) in [
        ("option --sampling-time-s", selection.sampling_time_s),
        ("option --recorded-at-s", selection.recorded_at_s),
    ] {
        if let Some(time) = time.filter(|time| !(time.is_finite() && *time > 0.0)) {
            return Err(input(foreign, option, format!("expected a positive time, found {time}")));
        }
    }
    let extension = foreign.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let single = matches!(extension.as_str(), "csv" | "npz");
    let (skill, recordings) = match extension.as_str() {
        "json" => thesis::read(foreign, selection)?,
        "csv" => (selection.skill_of(foreign)?, vec![table::read(foreign, selection)?]),
        "npz" => (selection.skill_of(foreign)?, vec![npz::read(foreign, selection)?]),
        "mat" => lasa::read(foreign, selection)?,
        other => {
            let problem = format!("expected .json, .csv, .npz or .mat, found `.{other}`");
            return Err(input(foreign, "extension", problem));
        }
    };
    let stem = foreign.file_stem().unwrap_or_default().to_string_lossy();
    let finish = |(i, recording): (usize, Recording)| {
        let name =
            if single { format!("{stem}.json") } else { format!("{skill}_{:02}.json", i + 1) };
        recording.finish(foreign, &skill, &name, selection)
    };
    recordings.into_iter().enumerate().map(finish).collect()
}

/// A file that does not say what it should, at a place that is not a key.
fn input(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> FileError {
    FileError::Input { path: path.into(), place: place.into(), problem: problem.into() }
}

/// The bytes of a file that is not too large.
fn read_bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let unreadable = |source| FileError::Read { path: path.into(), source };
    let size = std::fs::metadata(path).map_err(unreadable)?.len();
    if size > BYTES_MAX {
        return Err(input(
            path,
            "size",
            format!("expected at most {BYTES_MAX} bytes, found {size}"),
        ));
    }
    std::fs::read(path).map_err(unreadable)
}
