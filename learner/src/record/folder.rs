//! The folder of demonstrations: a file is there whole or not at all, and none is replaced.

use std::fs;
use std::path::{Path, PathBuf};

use tprmp_files::{Draft, Existing, WriteError, make_folder, try_out};

use crate::demonstration::{self, Demonstration};
use crate::file_error::FileError;

/// How often a number is looked for that nobody else took in the meantime.
const TRIES: u32 = 100;

/// A folder that can be written.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
}

impl Folder {
    /// Makes the folder where it is missing, and tries it: what is recorded later must not be lost.
    pub(super) fn open(path: &Path) -> Result<Self, FileError> {
        make_folder(path)?;
        let folder = Self { path: path.into() };
        try_out(&folder.next()?, Existing::Keep)?;
        Ok(folder)
    }

    /// Writes a demonstration under the next number, and reads it back before it gets its name.
    ///
    /// # Errors
    /// [`FileError::Input`] when training would refuse the file, [`FileError::Write`] or
    /// [`FileError::Read`] when the folder fails; there is no file then.
    pub(super) fn save(
        &self,
        demonstration: &Demonstration,
        start_frame: &str,
        goal_frame: &str,
    ) -> Result<PathBuf, FileError> {
        let text = demonstration::to_text(demonstration, start_frame, goal_frame);
        let write = |path: &Path| {
            let mut draft = Draft::open(path, Existing::Keep)?;
            draft.put(&text)?;
            demonstration::read(draft.temporary(), start_frame, goal_frame)?;
            Ok(draft.keep()?)
        };
        for tries_left in (0..TRIES).rev() {
            let path = self.next()?;
            match write(&path) {
                Ok(()) => return Ok(path),
                // Somebody else was faster.
                Err(FileError::Write(WriteError::Exists { .. })) if tries_left > 0 => {}
                Err(error) => return Err(error),
            }
        }
        unreachable!("the last try returns")
    }

    /// The file of the next number.
    fn next(&self) -> Result<PathBuf, FileError> {
        Ok(self.path.join(format!("{:02}.json", self.last_number()? + 1)))
    }

    /// The greatest number that is the name of a JSON file, 0 without one.
    fn last_number(&self) -> Result<u64, FileError> {
        let unreadable = |source| FileError::Read { path: self.path.clone(), source };
        let mut last = 0;
        for entry in fs::read_dir(&self.path).map_err(unreadable)? {
            let name = entry.map_err(unreadable)?.file_name().to_string_lossy().into_owned();
            let number = name.strip_suffix(".json").and_then(|stem| stem.parse().ok());
            last = last.max(number.filter(|n| *n < u64::MAX).unwrap_or(0));
        }
        Ok(last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use tprmp_model::skill_model::{Manifold, Remarks};
    use tprmp_spatial::Pose;

    fn demonstration(points: i32) -> Demonstration {
        let at = |x| Pose { position: DVec3::new(x, 0.5 * x, 0.0), ..Pose::IDENTITY };
        Demonstration {
            name: String::new(),
            sha256: String::new(),
            skill: "planar".into(),
            manifold: Manifold::R2,
            sampling_time_s: 0.01,
            start: at(0.0),
            goal_frame: at(1.0),
            other_frames: std::collections::BTreeMap::new(),
            remarks: Remarks::default(),
            poses: (0..points).map(|i| at(f64::from(i) * 0.125)).collect(),
            gripper: None,
        }
    }

    #[test]
    fn files_are_numbered_after_what_is_there_and_nothing_is_replaced_or_left() {
        let path = std::env::temp_dir().join(format!("tprmp-record-file-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        let folder = Folder::open(&path.join("deeper")).unwrap();
        let save = |points| folder.save(&demonstration(points), "start", "end");
        let names = || {
            let mut names: Vec<_> = fs::read_dir(&folder.path)
                .unwrap()
                .map(|entry| entry.unwrap().file_name().into_string().unwrap())
                .collect();
            names.sort();
            names
        };
        assert!(save(12).unwrap().ends_with("01.json"));
        fs::write(folder.path.join("07.json"), "not mine").unwrap();
        fs::write(folder.path.join("pick_90.json"), "not numbered").unwrap();
        let written = save(12).unwrap();
        assert!(written.ends_with("08.json"));
        let read = demonstration::read(&written, "start", "end").unwrap();
        assert_eq!(read.poses, demonstration(12).poses);
        let refused = save(3).unwrap_err();
        assert!(matches!(refused, FileError::Input { .. }), "{refused}");
        assert_eq!(names(), ["01.json", "07.json", "08.json", "pick_90.json"]);
        assert_eq!(fs::read_to_string(folder.path.join("07.json")).unwrap(), "not mine");
        fs::remove_dir_all(&path).unwrap();
        assert!(matches!(save(12), Err(FileError::Read { .. })));
        fs::write(&path, "a file").unwrap();
        assert!(matches!(Folder::open(&path), Err(FileError::Write(_))));
        fs::remove_file(&path).unwrap();
    }
}
