//! Writes files so that a reader meets a whole one or none, and only files are replaced.

use std::ffi::OsString;
use std::fs::{self, File, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::printable::printable;
use crate::read::kind;

/// Symbolic links are followed so often, as by the system.
const LINKS_MAX: usize = 40;
/// Permissions of a new file, less the umask.
const MODE: u32 = 0o666;

/// What becomes of a file that is there already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// It is replaced, and its permissions stay.
    Replace,
    /// It stays, and nothing is written.
    Keep,
}

impl Existing {
    /// What `--force` means.
    #[must_use]
    pub fn unless(force: bool) -> Self {
        if force { Self::Replace } else { Self::Keep }
    }
}

/// Why a file was not written; it is as it was before, and no other is left.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// Nothing else than a file is replaced.
    #[error(
        "{} cannot be written: it is {kind}; name a file that is there, or a new one",
        quoted(path)
    )]
    NotAFile {
        /// The path that was asked for.
        path: PathBuf,
        /// What is there.
        kind: &'static str,
    },
    /// Somebody else's file.
    #[error(
        "{} is there already and stays as it is: name another place, or give --force to replace it",
        quoted(path)
    )]
    Exists {
        /// The path that was asked for.
        path: PathBuf,
    },
    /// The system refuses.
    #[error("{} cannot be written: {source}", quoted(path))]
    System {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

impl WriteError {
    fn system(path: &Path) -> impl Fn(io::Error) -> Self {
        move |source| Self::System { path: path.into(), source }
    }
}

/// A path in a message.
fn quoted(path: &Path) -> String {
    format!("`{}`", printable(&path.to_string_lossy()))
}

/// Writes a file: there is a whole one afterwards, also after a loss of power, or what was there before.
///
/// # Errors
/// [`WriteError`]: something else than a file is there, a file is there that is to be kept, or the
/// system refuses (no such folder, no permission, disk full).
pub fn write(path: &Path, content: impl AsRef<[u8]>, existing: Existing) -> Result<(), WriteError> {
    let mut draft = Draft::open(path, existing)?;
    draft.put(content)?;
    draft.keep()
}

/// Whether a file could be written: tries it beside the file, and touches nothing.
///
/// # Errors
/// Those of [`write()`].
pub fn try_out(path: &Path, existing: Existing) -> Result<(), WriteError> {
    Draft::open(path, existing).map(drop)
}

/// Makes a folder where it is missing, and those above it.
///
/// # Errors
/// [`WriteError::System`].
pub fn make_folder(path: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(path).map_err(WriteError::system(path))
}

/// A file that is being written, under a temporary name beside its own. Dropped, it is gone.
#[derive(Debug)]
pub struct Draft {
    file: NamedTempFile,
    /// As it was asked for.
    path: PathBuf,
    /// Where it is: the end of all symbolic links.
    target: PathBuf,
    existing: Existing,
}

impl Draft {
    /// Begins a file.
    ///
    /// # Errors
    /// Those of [`write()`].
    pub fn open(path: &Path, existing: Existing) -> Result<Self, WriteError> {
        let target = target(path)?;
        let there = there(path, existing)?;
        let mut prefix = OsString::from(".");
        prefix.push(target.file_name().unwrap_or_default());
        // Room for what is appended to a name of the greatest length.
        let prefix: String = prefix.to_string_lossy().chars().take(50).collect::<String>() + ".";
        let file = tempfile::Builder::new()
            .prefix(&prefix)
            .suffix(".partial")
            .permissions(Permissions::from_mode(MODE))
            .tempfile_in(folder(&target))
            .map_err(WriteError::system(path))?;
        if let Some(there) = there {
            let kept = file.as_file().set_permissions(there.permissions());
            kept.map_err(WriteError::system(path))?;
        }
        Ok(Self { file, path: path.into(), target, existing })
    }

    /// Where it is until it is kept.
    #[must_use]
    pub fn temporary(&self) -> &Path {
        self.file.path()
    }

    /// Adds to the file.
    ///
    /// # Errors
    /// [`WriteError::System`], e.g. when the disk is full.
    pub fn put(&mut self, content: impl AsRef<[u8]>) -> Result<(), WriteError> {
        let written = self.file.as_file_mut().write_all(content.as_ref());
        written.map_err(WriteError::system(&self.path))
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// Those of [`write()`].
    pub fn keep(self) -> Result<(), WriteError> {
        let Self { file, path, target, existing } = self;
        let failed = WriteError::system(&path);
        file.as_file().sync_all().map_err(&failed)?;
        // Once more: much may have happened since.
        there(&path, existing)?;
        let kept = match existing {
            Existing::Replace => file.persist(&target),
            Existing::Keep => file.persist_noclobber(&target),
        };
        match kept {
            Ok(_) => {
                File::open(folder(&target)).and_then(|folder| folder.sync_all()).map_err(failed)
            }
            Err(error) if error.error.kind() == io::ErrorKind::AlreadyExists => {
                Err(WriteError::Exists { path: path.clone() })
            }
            Err(error) => Err(failed(error.error)),
        }
    }
}

/// The end of all symbolic links, whether there is anything or not.
fn target(path: &Path) -> Result<PathBuf, WriteError> {
    let mut target = path.to_path_buf();
    for _ in 0..LINKS_MAX {
        match fs::read_link(&target) {
            Ok(link) => target = folder(&target).join(link),
            Err(_) => return Ok(target),
        }
    }
    Err(WriteError::system(path)(io::Error::other("too many symbolic links")))
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// What is there at the end of all links, when it may be replaced.
fn there(path: &Path, existing: Existing) -> Result<Option<fs::Metadata>, WriteError> {
    let there = match fs::metadata(path) {
        Ok(there) => there,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(WriteError::system(path)(error)),
    };
    if !there.is_file() {
        let kind = kind(there.file_type());
        return Err(WriteError::NotAFile { path: path.into(), kind });
    }
    match existing {
        Existing::Replace => Ok(Some(there)),
        Existing::Keep => Err(WriteError::Exists { path: path.into() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    use std::os::unix::fs::symlink;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_whole_and_keeps_its_permissions() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("model.ron");
        write(&file, "first", Existing::Keep).unwrap();
        assert!(matches!(write(&file, "x", Existing::Keep), Err(WriteError::Exists { .. })));
        assert_eq!(fs::read_to_string(&file).unwrap(), "first");
        fs::set_permissions(&file, Permissions::from_mode(0o604)).unwrap();
        let reader = File::open(&file).unwrap();
        write(&file, "second", Existing::Replace).unwrap();
        assert_eq!(
            io::read_to_string(reader).unwrap(),
            "first",
            "who reads meets the old one, whole"
        );
        assert_eq!(fs::read_to_string(&file).unwrap(), "second");
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o604);
        assert_eq!(names(folder.path()), ["model.ron"]);
    }

    /// A device node takes a privilege to make; without it the pipe is all there is.
    #[test]
    fn devices_pipes_sockets_and_folders_stay_what_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name| folder.path().join(name);
        mknodat(CWD, path("pipe"), FileType::Fifo, Mode::RWXU, 0).unwrap();
        fs::create_dir(path("folder")).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(path("socket")).unwrap();
        let device = mknodat(
            CWD,
            path("device"),
            FileType::CharacterDevice,
            Mode::RWXU,
            rustix::fs::makedev(1, 3),
        );
        for name in ["device", "folder", "pipe", "socket"] {
            if name == "device" && device.is_err() {
                continue;
            }
            let before = fs::metadata(path(name)).unwrap().file_type();
            symlink(path(name), path("link")).unwrap();
            for asked in [name, "link"] {
                let refused = write(&path(asked), "x", Existing::Replace).unwrap_err().to_string();
                assert!(refused.contains(&format!("it is a {name}")), "{refused}");
            }
            assert_eq!(fs::metadata(path(name)).unwrap().file_type(), before);
            fs::remove_file(path("link")).unwrap();
        }
        let shared = write(Path::new("/dev/null"), "x", Existing::Replace).unwrap_err().to_string();
        assert!(shared.contains("`/dev/null` cannot be written: it is a device"), "{shared}");
    }

    #[test]
    fn a_link_stays_and_its_target_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name| folder.path().join(name);
        fs::create_dir(path("elsewhere")).unwrap();
        symlink("elsewhere/model.ron", path("b")).unwrap();
        symlink("b", path("a")).unwrap();
        for content in ["of a new file", "of one that is there"] {
            write(&path("a"), content, Existing::Replace).unwrap();
            assert_eq!(fs::read_to_string(path("elsewhere/model.ron")).unwrap(), content);
            assert_eq!(fs::read_link(path("a")).unwrap(), Path::new("b"));
        }
        assert_eq!(names(&path("elsewhere")), ["model.ron"]);
        symlink("loop", path("loop")).unwrap();
        assert!(matches!(
            write(&path("loop"), "", Existing::Replace),
            Err(WriteError::System { .. })
        ));
    }

    #[test]
    fn a_draft_that_is_dropped_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("log.csv");
        write(&file, "before", Existing::Replace).unwrap();
        try_out(&file, Existing::Replace).unwrap();
        let mut draft = Draft::open(&file, Existing::Replace).unwrap();
        draft.put("half a").unwrap();
        assert_eq!(names(folder.path()).len(), 2);
        drop(draft);
        assert_eq!(names(folder.path()), ["log.csv"]);
        assert_eq!(fs::read_to_string(&file).unwrap(), "before");
        // Somebody else's file that came in the meantime stays.
        let new = folder.path().join("new");
        let draft = Draft::open(&new, Existing::Keep).unwrap();
        fs::write(&new, "theirs").unwrap();
        assert!(matches!(draft.keep(), Err(WriteError::Exists { .. })));
        assert_eq!(names(folder.path()), ["log.csv", "new"]);
        let nowhere = write(&folder.path().join("no/such"), "", Existing::Replace).unwrap_err();
        assert!(
            nowhere.to_string().contains("no/such` cannot be written: No such file"),
            "{nowhere}"
        );
    }
}
