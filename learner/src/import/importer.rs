//! From a file of another format to files of demonstrations.

use std::path::{Path, PathBuf};

use tprmp_files::{Draft, Existing, make_folder, name};

use super::recording::Recording;
use super::selection::Selection;
use super::{lasa, npz, table, thesis};
use crate::demonstration::{Demonstration, to_text};
use crate::file_error::FileError;

/// Imports a file and writes its demonstrations into a folder, which is made when it is missing:
/// `<file>.json` of a file with one demonstration, else `<skill>_01.json` and so on. Returns the
/// files written: all, or none when one of them may not be.
///
/// # Errors
/// [`FileError`], naming the file and the key, column, array or variable: the file cannot be
/// read or is not of the format, its times and velocities contradict each other, an option does
/// not fit, or the folder cannot be written.
pub fn import(
    foreign: &Path,
    folder: &Path,
    selection: &Selection,
    existing: Existing,
) -> Result<Vec<PathBuf>, FileError> {
    let demonstrations = load(foreign, selection)?;
    make_folder(folder)?;
    let mut written = Vec::with_capacity(demonstrations.len());
    for demonstration in demonstrations {
        let [start_frame, goal_frame] = selection.frames(demonstration.manifold);
        let mut draft = Draft::open(&folder.join(&demonstration.name), existing)?;
        draft.put(to_text(&demonstration, &start_frame, &goal_frame))?;
        written.push((folder.join(&demonstration.name), draft));
    }
    let keep = |(path, draft): (PathBuf, Draft)| draft.keep().map(|()| path);
    Ok(written.into_iter().map(keep).collect::<Result<_, _>>()?)
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
            let problem = format!("expected a positive time, found {time}");
            return Err(FileError::input(foreign, option, problem));
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
            return Err(FileError::input(foreign, "extension", problem));
        }
    };
    // Both become names of files.
    let stem = foreign.file_stem().unwrap_or_default().to_string_lossy();
    let key = if selection.skill.is_some() { "option --skill" } else { "key `name`" };
    for (place, name) in [("name of the file", &*stem), (key, &*skill)] {
        name::check(name).map_err(|error| FileError::input(foreign, place, error.to_string()))?;
    }
    let finish = |(i, recording): (usize, Recording)| {
        let name =
            if single { format!("{stem}.json") } else { format!("{skill}_{:02}.json", i + 1) };
        recording.finish(foreign, &skill, &name, selection)
    };
    recordings.into_iter().enumerate().map(finish).collect()
}
