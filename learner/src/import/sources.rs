//! What is to be read of the files and folders that are named.

use std::path::{Path, PathBuf};

use super::lerobot::INFO;
use crate::file_error::FileError;

/// Most files of an import.
const FILES_MAX: usize = 1000;
/// Most entries of a folder that are looked at.
const ENTRIES_MAX: usize = 100_000;
/// Files of a folder that are read. Files of the thesis' layout have to be named: any `.json` may lie there.
const EXTENSIONS: [&str; 4] = ["csv", "npz", "npy", "mat"];

/// The files to read, in order.
pub(super) struct Sources {
    pub(super) files: Vec<PathBuf>,
    /// What is said of files of folders that are not read.
    pub(super) skipped: Vec<String>,
}

impl Sources {
    /// Finds them. Folders are not searched deeper.
    pub(super) fn find(named: &[impl AsRef<Path>]) -> Result<Self, FileError> {
        let mut found = Self { files: Vec::new(), skipped: Vec::new() };
        for path in named.iter().map(AsRef::as_ref) {
            if path.is_dir() && !is_lerobot(path) {
                found.add_folder(path)?;
            } else {
                found.files.push(path.into());
            }
            if found.files.len() > FILES_MAX {
                let problem = format!("expected at most {FILES_MAX} files at once, found more");
                return Err(FileError::input(path, "import", problem));
            }
        }
        Ok(found)
    }

    fn add_folder(&mut self, folder: &Path) -> Result<(), FileError> {
        let unreadable = |source| FileError::Read { path: folder.into(), source };
        let (mut files, mut hidden, mut foreign) = (Vec::new(), 0, 0);
        for (i, entry) in std::fs::read_dir(folder).map_err(unreadable)?.enumerate() {
            if i == ENTRIES_MAX {
                let problem = format!("expected at most {ENTRIES_MAX} entries, found more");
                return Err(FileError::input(folder, "folder", problem));
            }
            let path = entry.map_err(unreadable)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_beside = [".frames.json", ".array.json"].iter().any(|end| name.ends_with(end));
            let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
            if name.starts_with('.') {
                hidden += 1;
            } else if EXTENSIONS.contains(&&*extension) && path.is_file() {
                files.push(path);
            } else if !is_beside {
                foreign += 1;
            }
        }
        if files.is_empty() {
            let known = EXTENSIONS.join(", .");
            let problem = format!("expected files .{known} or a LeRobot folder, found none");
            return Err(FileError::input(folder, "folder", problem));
        }
        if hidden + foreign > 0 {
            self.skipped.push(format!(
                "{}: skipped {hidden} hidden and {foreign} foreign files or folders",
                folder.display()
            ));
        }
        files.sort();
        self.files.extend(files);
        Ok(())
    }
}

/// Whether a path is a folder of a LeRobot data set.
pub(super) fn is_lerobot(path: &Path) -> bool {
    path.join(INFO).exists()
}
