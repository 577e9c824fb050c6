//! Frames of a recording: of a file beside it, of its columns, or the tool's pose where the gripper
//! closes first.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::selection::{Closed, Selection};
use crate::demonstration::at_most::at_most;
use crate::demonstration::{FileFrame, Grip, other_frames};
use crate::file_error::{FileError, read_text};

/// Largest file of frames \[bytes\].
const BYTES_MAX: u64 = 1 << 20;
/// Most demonstrations with frames of their own.
pub(super) const DEMONSTRATIONS_MAX: usize = 1000;
/// A gripper whose values differ by a smaller fraction of the greatest does not move: that is noise.
const STROKE_MIN: f64 = 0.05;

type Named = BTreeMap<String, FileFrame>;

/// Frames of one demonstration.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Own {
    frames: Named,
    /// How many samples of an array are its own; all, when nothing is said.
    pub(super) samples: Option<usize>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    frames: Named,
    #[serde(default, deserialize_with = "at_most::<DEMONSTRATIONS_MAX, _, _>")]
    demonstrations: Vec<Own>,
}

/// A file of frames.
pub(super) struct FrameFile {
    /// Where it is, or should be.
    path: PathBuf,
    common: Named,
    /// Of each demonstration.
    pub(super) own: Vec<Own>,
}

impl FrameFile {
    /// Frames that stand in another file already.
    pub(super) fn of(path: &Path, common: Named, own: Vec<Own>) -> Self {
        Self { path: path.into(), common, own }
    }

    /// The file that the options name, or else the usual one. The usual one may be missing where the
    /// frames come from elsewhere.
    pub(super) fn read(
        usual: &Path,
        is_needed: bool,
        selection: &Selection,
    ) -> Result<Option<Self>, FileError> {
        let path = selection.frames.as_deref().unwrap_or(usual);
        if selection.frames.is_none() && !is_needed && !path.exists() {
            return Ok(None);
        }
        let file: File = parse(&read_text(path, BYTES_MAX)?, path)?;
        Ok(Some(Self::of(path, file.frames, file.demonstrations)))
    }

    /// The frames of demonstration `i`.
    fn add_to(&self, i: usize, to: &mut Frames) -> Result<(), FileError> {
        let none = Named::new();
        let own = self.own.get(i).map_or(&none, |own| &own.frames);
        for frames in [&self.common, own] {
            for (name, pose) in other_frames(frames, ["", ""], to.manifold, &self.path)? {
                to.add(name, pose, &self.path)?;
            }
        }
        Ok(())
    }
}

/// Reads JSON, whether it begins with a byte order mark or not.
pub(super) fn parse<'a, T: Deserialize<'a>>(text: &'a str, path: &Path) -> Result<T, FileError> {
    serde_json::from_str(text.trim_start_matches('\u{feff}'))
        .map_err(|e| FileError::syntax(path, e.line(), e.column(), e.to_string()))
}

/// The frames of one recording.
pub(super) struct Frames {
    manifold: Manifold,
    found: BTreeMap<String, Pose>,
}

impl Frames {
    pub(super) fn new(manifold: Manifold) -> Self {
        Self { manifold, found: BTreeMap::new() }
    }

    /// Adds a frame that a file or a column says.
    pub(super) fn add(&mut self, name: String, pose: Pose, path: &Path) -> Result<(), FileError> {
        if self.found.contains_key(&name) {
            let problem = "expected this frame once, found it again: in a file of frames, in columns, or by \
                           --frame-at-closing";
            return Err(FileError::key(path, format!("frames.{name}"), problem));
        }
        self.found.insert(name, pose);
        Ok(())
    }

    /// Start frame, goal frame and the others. Where no file of frames is there, the start frame may be the
    /// tool's pose at the start; that is noted.
    pub(super) fn finish(
        mut self,
        path: &Path,
        file: Option<(&FrameFile, usize)>,
        first: Option<&Pose>,
        selection: &Selection,
        notes: &mut Vec<String>,
    ) -> Result<(Pose, Pose, BTreeMap<String, Pose>), FileError> {
        if let Some((file, i)) = file {
            file.add_to(i, &mut self)?;
        }
        let [start_name, goal_name] = selection.frames(self.manifold);
        let path = file.map_or(path, |(file, _)| &file.path);
        let names: Vec<_> = self.found.keys().cloned().collect();
        let missing = |name: &str| {
            let problem = format!("expected this frame, found only [{}]", names.join(", "));
            FileError::key(path, format!("frames.{name}"), problem)
        };
        let goal = *self.found.get(&goal_name).ok_or_else(|| missing(&goal_name))?;
        let start = match (self.found.get(&start_name), first) {
            (Some(start), _) => *start,
            (None, Some(first)) => {
                notes.push(format!("frame {start_name} is the tool's pose at the start"));
                *first
            }
            (None, None) => return Err(missing(&start_name)),
        };
        self.found.remove(&start_name);
        self.found.remove(&goal_name);
        Ok((start, goal, self.found))
    }
}

/// Whether a gripper is closed, by its values: past the middle of them; `None` when it does not move.
pub(super) fn closed_where(values: &[f64], closed: Closed) -> Option<Vec<Grip>> {
    let [least, greatest] = extremes(values);
    let moves = greatest - least > STROKE_MIN * least.abs().max(greatest.abs());
    let middle = least + 0.5 * (greatest - least);
    let is_closed = |value: &f64| match closed {
        Closed::Low => *value < middle,
        Closed::High => *value > middle,
    };
    let grip = |value| if is_closed(value) { Grip::Closed } else { Grip::Open };
    moves.then(|| values.iter().map(grip).collect())
}

/// The first sample at which a gripper is closed after it was open, by its values.
pub(super) fn first_closing(values: &[f64], closed: Closed) -> Result<usize, String> {
    let grips = closed_where(values, closed).unwrap_or_default();
    let closes = grips.windows(2).position(|pair| pair == [Grip::Open, Grip::Closed]);
    closes.map(|i| i + 1).ok_or_else(|| {
        let [least, greatest] = extremes(values);
        format!(
            "expected a gripper that closes once at least, found values from {least} to {greatest} that \
             never do: is --closed right?"
        )
    })
}

/// The least and the greatest of some values.
fn extremes(values: &[f64]) -> [f64; 2] {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    [least, values.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gripper_closes_where_it_passes_the_middle_of_its_values() {
        let values = [0.9, 1.0, 0.9, 0.6, 0.4, 0.0, 0.0, 1.0, 0.0];
        assert_eq!(first_closing(&values, Closed::Low), Ok(4));
        assert_eq!(first_closing(&values, Closed::High), Ok(7));
        // Closed from the start: it has to open first.
        assert_eq!(first_closing(&[0.0, 0.0, 1.0, 1.0, 0.0], Closed::Low), Ok(4));
        for still in [&[][..], &[1.0], &[1.0; 9], &[0.0, 0.0, 1.0], &[1.0, 0.99, 1.0]] {
            assert!(first_closing(still, Closed::Low).is_err(), "{still:?}");
        }
    }
}
