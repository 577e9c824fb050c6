//! Folders of LeRobot data sets, version 3: `meta/info.json` says what there is, and
//! `data/chunk-…/file-….parquet` hold all episodes, one row a sample.
//!
//! The elements of the state (`observation.state`) are columns by their names; those of another feature
//! have its name before theirs, without `observation.`: `object.x_m` is element `x_m` of
//! `observation.object`. Times are the column `timestamp` [s]. Videos and images are not looked at.
//! `frames.json` in the folder holds frames: of all episodes, or of each.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::Value;

use super::clock::Stamp;
use super::columns::{Columns, Wrong};
use super::frames::{DEMONSTRATIONS_MAX, FrameFile, parse};
use super::joints::Joints;
use super::parquet::Table;
use super::recording::Recording;
use super::rows::ROWS_MAX;
use super::samples::Samples;
use super::selection::Selection;
use crate::file_error::{FileError, read_text};

/// Where a data set says what it holds.
pub(super) const INFO: &str = "meta/info.json";
/// Largest `meta/info.json` \[bytes\].
const INFO_BYTES_MAX: u64 = 1 << 20;
/// Most features, and most elements of one that is read.
const FEATURES_MAX: usize = 1000;
const ELEMENTS_MAX: usize = 100;
/// Most files of data.
const FILES_MAX: usize = 1000;
/// The feature of times, and that of the episode's number.
const TIME: &str = "timestamp";
const EPISODE: &str = "episode_index";
/// What a recorder adds by itself, and nobody looks for.
const OWN: [&str; 5] = [TIME, EPISODE, "frame_index", "index", "task_index"];

#[derive(Deserialize)]
struct Info {
    codebase_version: String,
    features: BTreeMap<String, Feature>,
}

#[derive(Deserialize)]
struct Feature {
    dtype: String,
    shape: Vec<usize>,
    #[serde(default)]
    names: Value,
}

/// A number that a row of a feature holds.
struct Element {
    feature: String,
    /// Which of the feature's numbers, and how many it has.
    i: usize,
    count: usize,
}

/// The episodes of a data set, in order of their numbers.
pub(super) fn read(
    folder: &Path,
    joints: Option<&mut Joints>,
    selection: &Selection,
) -> Result<Vec<Recording>, FileError> {
    let path = folder.join(INFO);
    let info: Info = parse(&read_text(&path, INFO_BYTES_MAX)?, &path)?;
    let (names, elements) =
        elements(&info, selection).map_err(|(key, problem)| FileError::key(&path, key, problem))?;
    let in_column = |(column, problem): Wrong| {
        FileError::input(&path, format!("key `features`, column `{column}`"), problem)
    };
    let joint_names = joints.as_ref().map(|joints| &joints.names[..]);
    let columns = Columns::find(&names, joint_names, true, false, selection).map_err(in_column)?;
    let goal_is_known = !columns.frames.is_empty() || selection.frame_at_closing.is_some();
    let frames = FrameFile::read(&folder.join("frames.json"), !goal_is_known, selection)?;
    let mut reader = Reader {
        folder,
        names: &names,
        elements: &elements,
        columns: &columns,
        joints,
        frames: frames.as_ref(),
        selection,
        rows: 0,
        recordings: BTreeMap::new(),
    };
    for file in data_files(folder)? {
        reader.add(&file)?;
    }
    reader.finish()
}

/// All numbers of a row by name, and where they are; or the key that is wrong.
fn elements(info: &Info, selection: &Selection) -> Result<(Vec<String>, Vec<Element>), Wrong> {
    if !info.codebase_version.starts_with("v3.") {
        let found = &info.codebase_version;
        let problem = format!("expected v3.0, found {found}: LeRobot converts data sets of before");
        return Err(("codebase_version".into(), problem));
    }
    let state = selection.state.as_deref().unwrap_or("observation.state");
    let count = info.features.len();
    if !info.features.contains_key(state) || count > FEATURES_MAX {
        let known: Vec<_> = info.features.keys().map(String::as_str).take(20).collect();
        let problem = format!(
            "expected the feature `{state}` among at most {FEATURES_MAX}, found {count}: {}; --state names \
             another",
            known.join(", ")
        );
        return Err(("features".into(), problem));
    }
    let (mut names, mut elements) = (vec!["time_s".to_owned()], Vec::new());
    elements.push(Element { feature: TIME.into(), i: 0, count: 1 });
    for (key, feature) in &info.features {
        let is_number = ["float32", "float64"].contains(&&*feature.dtype);
        // Actions are what was commanded, not where the robot was.
        let [count] = feature.shape[..] else { continue };
        if !is_number || OWN.contains(&&**key) || key == "action" || count > ELEMENTS_MAX {
            continue;
        }
        let is_state = key == state;
        let chosen = if is_state { &selection.columns[..] } else { &[] };
        let own = element_names(feature, chosen, count)
            .map_err(|problem| (format!("features.{key}.names"), problem))?;
        let prefix = key.strip_prefix("observation.").unwrap_or(key);
        for (i, name) in own.into_iter().enumerate() {
            names.push(match (is_state, name.is_empty()) {
                (true, _) => name,
                (false, true) => prefix.to_owned(),
                (false, false) => format!("{prefix}.{name}"),
            });
            elements.push(Element { feature: key.clone(), i, count });
        }
    }
    Ok((names, elements))
}

/// Names of a feature's elements: those chosen, or a list, or a list under one key (`motors`), or numbers.
fn element_names(
    feature: &Feature,
    chosen: &[String],
    count: usize,
) -> Result<Vec<String>, String> {
    let list = match &feature.names {
        Value::Object(map) if map.len() == 1 => map.values().next().unwrap_or(&Value::Null),
        other => other,
    };
    let named: Vec<String> = match list {
        _ if !chosen.is_empty() => chosen.to_vec(),
        Value::Array(names) => {
            names.iter().map(|name| name.as_str().unwrap_or_default().to_owned()).collect()
        }
        _ if count == 1 => vec![String::new()],
        _ => (0..count).map(|i| i.to_string()).collect(),
    };
    if named.len() == count {
        return Ok(named);
    }
    let found = named.len();
    Err(format!(
        "expected {count} names, as `shape` says, found {found}; --columns names those of the state"
    ))
}

/// The files of data, in order.
fn data_files(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let data = folder.join("data");
    let mut files = Vec::new();
    for chunk in entries(&data, "chunk-", "")? {
        files.extend(entries(&chunk, "file-", ".parquet")?);
        if files.len() > FILES_MAX {
            let problem = format!("expected at most {FILES_MAX} files, found more");
            return Err(FileError::input(&data, "folder", problem));
        }
    }
    if files.is_empty() {
        let problem = "expected `chunk-000/file-000.parquet`, found none";
        return Err(FileError::input(&data, "folder", problem));
    }
    Ok(files)
}

/// Entries of a folder whose names begin and end so.
fn entries(folder: &Path, begin: &str, end: &str) -> Result<Vec<PathBuf>, FileError> {
    let unreadable = |source| FileError::Read { path: folder.into(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)?.take(100 * FILES_MAX) {
        let path = entry.map_err(unreadable)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with(begin) && name.ends_with(end) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Collects the samples of each episode.
struct Reader<'a> {
    folder: &'a Path,
    names: &'a [String],
    elements: &'a [Element],
    columns: &'a Columns,
    joints: Option<&'a mut Joints>,
    frames: Option<&'a FrameFile>,
    selection: &'a Selection,
    /// Of all files.
    rows: usize,
    recordings: BTreeMap<i64, Recording>,
}

impl Reader<'_> {
    /// Adds the episodes of a file.
    fn add(&mut self, path: &Path) -> Result<(), FileError> {
        let fail = |problem| FileError::input(path, "parquet", problem);
        let table = Table::open(path)?;
        self.rows += table.rows();
        if self.rows > ROWS_MAX {
            return Err(fail(format!("expected at most {ROWS_MAX} rows in all files, found more")));
        }
        let episodes = table.numbers(EPISODE, 1).map_err(|e| in_column(path, EPISODE, e))?;
        let mut features: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for i in self.columns.indices() {
            let Element { feature, count, .. } = &self.elements[i];
            if !features.contains_key(&**feature) {
                let read = table.numbers(feature, *count);
                features.insert(feature, read.map_err(|e| in_column(path, feature, e))?);
            }
        }
        let mut from = 0;
        for rows in episodes.chunk_by(|a, b| a == b) {
            let episode = rows[0] as i64;
            if self.recordings.contains_key(&episode) || self.recordings.len() == DEMONSTRATIONS_MAX
            {
                return Err(fail(format!(
                    "expected at most {DEMONSTRATIONS_MAX} episodes, each in one piece, found episode {episode} \
                     again or beyond"
                )));
            }
            let recording = self.episode(path, episode, from..from + rows.len(), &features)?;
            self.recordings.insert(episode, recording);
            from += rows.len();
        }
        Ok(())
    }

    fn episode(
        &mut self,
        path: &Path,
        episode: i64,
        rows: std::ops::Range<usize>,
        features: &BTreeMap<&str, Vec<f64>>,
    ) -> Result<Recording, FileError> {
        let (names, elements) = (self.names, self.elements);
        let mut samples = Samples::new(self.columns, self.joints.as_deref_mut(), self.selection);
        for (sample, row) in rows.enumerate() {
            let number = |i: usize| {
                let Element { feature, i: at, count } = &elements[i];
                let number = features[&**feature][row * count + at];
                let problem = || format!("expected a finite number, found {number}");
                let finite = Some(number).filter(|number| number.is_finite());
                finite.ok_or_else(|| (names[i].clone(), problem()))
            };
            let time = self.columns.time.map_or(0, |(time, _)| time);
            let stamp = number(time).map(Stamp::of);
            stamp.and_then(|stamp| samples.push(stamp, number)).map_err(|(column, problem)| {
                let place = format!("episode {episode}, sample {sample}, column `{column}`");
                FileError::input(path, place, problem)
            })?;
        }
        let frames = self.frames.zip(usize::try_from(episode).ok());
        samples.finish(path, &format!("episode {episode}"), frames)
    }

    fn finish(self) -> Result<Vec<Recording>, FileError> {
        let count = self.recordings.len();
        let own = self.frames.map_or(0, |frames| frames.own.len());
        if own != 0 && own != count {
            let problem =
                format!("expected frames of {count} episodes, as many as there are, found {own}");
            return Err(FileError::input(
                self.folder,
                "key `demonstrations` of the frames",
                problem,
            ));
        }
        Ok(self.recordings.into_values().collect())
    }
}

fn in_column(path: &Path, column: &str, problem: String) -> FileError {
    FileError::input(path, format!("column `{column}`"), problem)
}
