//! From files of other formats to files of demonstrations.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use tprmp_files::{Draft, Existing, make_folder, name};

use super::joints::Joints;
use super::recording::{Finished, Recording};
use super::selection::Selection;
use super::sources::{Sources, is_lerobot};
use super::{lasa, lerobot, npy, npz, table, thesis};
use crate::demonstration::{Demonstration, plausibility, to_text};
use crate::file_error::FileError;

/// What an import did.
#[derive(Clone, Debug, Default)]
pub struct Imported {
    /// The files written.
    pub written: Vec<PathBuf>,
    /// What was read, a line for each demonstration: its source, its space, the number of samples and
    /// their rate \[Hz\], what was ignored.
    pub summary: Vec<String>,
    /// What is hardly meant: holes in time, jumps, implausible speeds.
    pub warnings: Vec<String>,
}

/// Imports files, and folders of files, and writes their demonstrations into a folder, which is made when it
/// is missing: `<file>.json` of a file with one demonstration, else `<skill>_01.json` and so on. All files
/// are written, or none when one of them may not be.
///
/// # Errors
/// [`FileError`], naming the file and the key, column, array or variable: a file cannot be read or is not of
/// the format, its times and velocities contradict each other, an option does not fit, two files would
/// be written under one name, or the folder cannot be written.
pub fn import(
    foreign: &[impl AsRef<Path>],
    folder: &Path,
    selection: &Selection,
    existing: Existing,
) -> Result<Imported, FileError> {
    let sources = Sources::find(foreign)?;
    let mut imported = Imported { summary: sources.skipped.clone(), ..Imported::default() };
    let mut demonstrations = Vec::new();
    let mut origins: BTreeMap<String, &Path> = BTreeMap::new();
    for source in &sources.files {
        let all = read(source, selection, sources.files.len() == 1)?;
        let are_several = all.len() > 1;
        for finished in all {
            let name = finished.demonstration.name.clone();
            if let Some(other) = origins.insert(name.clone(), source) {
                let other = other.display();
                let problem =
                    format!("it would be written as `{name}`, and so would `{other}`: rename one");
                return Err(FileError::input(source, "name of the file", problem));
            }
            let which = if are_several { format!(", {name}") } else { String::new() };
            imported.summary.push(format!("{}{which}: {}", source.display(), finished.summary));
            imported.warnings.extend(finished.warning);
            demonstrations.push(finished.demonstration);
        }
    }
    imported.warnings.extend(plausibility::warnings(&demonstrations));
    make_folder(folder)?;
    let mut drafts = Vec::with_capacity(demonstrations.len());
    for demonstration in demonstrations {
        let [start_frame, goal_frame] = selection.frames(demonstration.manifold);
        let mut draft = Draft::open(&folder.join(&demonstration.name), existing)?;
        draft.put(to_text(&demonstration, &start_frame, &goal_frame))?;
        drafts.push((folder.join(&demonstration.name), draft));
    }
    for (path, draft) in drafts {
        draft.keep()?;
        imported.written.push(path);
    }
    Ok(imported)
}

/// The demonstrations of a file, as [`import`] would write them.
///
/// # Errors
/// Those of [`import`] that concern the file.
pub fn load(foreign: &Path, selection: &Selection) -> Result<Vec<Demonstration>, FileError> {
    let read = read(foreign, selection, true)?;
    Ok(read.into_iter().map(|finished| finished.demonstration).collect())
}

/// Recordings of a source, the skill, and whether there can be several.
type Read = (String, Vec<Recording>, bool);

fn read(foreign: &Path, selection: &Selection, is_only: bool) -> Result<Vec<Finished>, FileError> {
    selection.check(foreign)?;
    let (skill, recordings, is_single) = recordings(foreign, selection)?;
    // Both become names of files.
    let stem = foreign.file_stem().unwrap_or_default().to_string_lossy();
    let key = if selection.skill.is_some() { "option --skill" } else { "key `name`" };
    for (place, name) in [("name of the file", &*stem), (key, &*skill)] {
        name::check(name).map_err(|error| FileError::input(foreign, place, error.to_string()))?;
    }
    // Of several files each has its own name.
    let base = if is_only { &*skill } else { &*stem };
    let finish = |(i, recording): (usize, Recording)| {
        let name =
            if is_single { format!("{stem}.json") } else { format!("{base}_{:02}.json", i + 1) };
        recording.finish(foreign, &skill, &name, selection)
    };
    recordings.into_iter().enumerate().map(finish).collect()
}

fn recordings(foreign: &Path, selection: &Selection) -> Result<Read, FileError> {
    let skill = || selection.skill_of(foreign);
    let mut joints = Joints::open(selection)?;
    let extension = foreign.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let own_frames = [
        ("--frames", selection.frames.is_some()),
        ("--frame-at-closing", selection.frame_at_closing.is_some()),
    ];
    let own_unit = [
        ("--robot", selection.robot.is_some()),
        ("--unit", selection.unit.is_some()),
        ("--time-unit", selection.time_unit.is_some()),
        ("--space", selection.space.is_some()),
    ];
    if is_lerobot(foreign) {
        let recordings = lerobot::read(foreign, joints.as_mut(), selection)?;
        return Ok((skill()?, recordings, false));
    }
    match extension.as_str() {
        "json" | "mat" => selection.refuse(foreign, &[&own_frames[..], &own_unit].concat())?,
        "npz" => selection
            .refuse(foreign, &[&own_frames[..], &own_unit[..1], &own_unit[3..]].concat())?,
        _ => {}
    }
    Ok(match extension.as_str() {
        "json" => {
            let (skill, recordings) = thesis::read(foreign, selection)?;
            (skill, recordings, false)
        }
        "csv" => (skill()?, vec![table::read(foreign, joints.as_mut(), selection)?], true),
        "npz" => (skill()?, vec![npz::read(foreign, selection)?], true),
        "npy" => (skill()?, npy::read(foreign, joints.as_mut(), selection)?, false),
        "mat" => {
            let (skill, recordings) = lasa::read(foreign, selection)?;
            (skill, recordings, false)
        }
        other => {
            let problem =
                format!("expected .csv, .npz, .npy, .mat or .json, or a folder, found `.{other}`");
            return Err(FileError::input(foreign, "extension", problem));
        }
    })
}
