//! Where the files of an instance lie, whose they are, and the removal of those that nobody uses.

use core::time::Duration;
use std::fs;
use std::io::{self, BufRead};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use iceoryx2::prelude::*;
use rustix::fs::{FlockOperation, Mode, OFlags, flock, open};
use rustix::io::Errno;

use crate::error::ServiceError;
use crate::shared_memory::FOLDER;

/// Pause between two tries for the lock, and how many there are: opening an instance takes milliseconds.
const LOCK_PAUSE: Duration = Duration::from_millis(5);
const LOCK_TRIES_MAX: u32 = 2000;
/// How long another process may take to remove what a dead one left.
const CLEAN_TIMEOUT: Duration = Duration::from_secs(2);

/// Permissions of a file until iceoryx2 has initialised it.
const UNFINISHED_MODE: u32 = 0o200;

/// What the names of an instance's files in `/dev/shm` begin with: the prefix of iceoryx2's configuration.
pub const PREFIX: &str = "tprmp_<user id>_<instance>_";
/// The folder of an instance: the root path of iceoryx2's configuration.
pub const ROOT: &str = "/tmp/tprmp-<user id>/<instance>/";

/// The folder of a user's instances: `/tmp/tprmp-<user id>`.
pub(crate) fn user_folder(user: u32) -> PathBuf {
    format!("/tmp/tprmp-{user}").into()
}

/// What the names of a user's files in shared memory begin with: `tprmp_<user id>_`.
fn user_prefix(user: u32) -> String {
    format!("tprmp_{user}_")
}

/// The files of one instance.
#[derive(Debug, Clone)]
pub(crate) struct Files {
    user: u32,
    /// `tprmp_<user id>_<name>_`, in `/dev/shm`.
    pub(crate) prefix: String,
    /// `/tmp/tprmp-<user id>/<name>`.
    pub(crate) folder: PathBuf,
}

/// What was removed of an instance, and what was not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cleaned {
    /// Files removed from shared memory.
    pub shared_files: usize,
    /// What they took \[bytes\].
    pub shared_bytes: u64,
    /// Files and folders removed from the instance's folder.
    pub paths: usize,
    /// Nodes of living processes, whose files stay.
    pub living: usize,
}

/// Held while an instance is opened, closed or cleaned: one at a time of each user.
#[derive(Debug)]
pub(crate) struct Lock(#[expect(dead_code, reason = "closing it unlocks")] OwnedFd);

impl Files {
    pub(crate) fn new(name: &str) -> Self {
        let user = rustix::process::getuid().as_raw();
        Self {
            user,
            prefix: format!("{}{name}_", user_prefix(user)),
            folder: user_folder(user).join(name),
        }
    }

    /// Makes the folders where they are missing, checks whose everything is, and keeps everybody else
    /// out until the lock is dropped.
    pub(crate) fn claim(&self) -> Result<Lock, ServiceError> {
        let lock = self.lock()?;
        self.claim_folder(&self.folder)?;
        self.check_contents(&self.folder)?;
        for path in self.shared() {
            self.check(&path)?;
            // Who is killed while it creates one leaves it so, and iceoryx2 would wait for it for ever.
            if is_unfinished(&path) {
                removed(&path, fs::remove_file(&path))?;
            }
        }
        Ok(lock)
    }

    /// The lock of this user's instances.
    fn lock(&self) -> Result<Lock, ServiceError> {
        let folder = user_folder(self.user);
        let file = self.claim_folder(&folder)?;
        for _ in 0..LOCK_TRIES_MAX {
            match flock(&file, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => return Ok(Lock(file)),
                Err(Errno::WOULDBLOCK | Errno::INTR) => std::thread::sleep(LOCK_PAUSE),
                Err(error) => {
                    return Err(ServiceError::Folder { path: folder, source: error.into() });
                }
            }
        }
        Err(ServiceError::Locked(folder))
    }

    /// Makes a folder of this user's own, or checks that it is one.
    fn claim_folder(&self, path: &Path) -> Result<OwnedFd, ServiceError> {
        let failed = |source| ServiceError::Folder { path: path.into(), source };
        match fs::DirBuilder::new().mode(0o700).create(path) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                return Err(failed(error));
            }
            _ => {}
        }
        self.check(path)?;
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        open(path, flags, Mode::empty()).map_err(|error| match error {
            Errno::NOTDIR | Errno::LOOP => ServiceError::NoFolder(path.into()),
            other => failed(other.into()),
        })
    }

    /// Whether a file or folder is this user's, and nobody else can write it. One that has gone is.
    fn check(&self, path: &Path) -> Result<(), ServiceError> {
        let about = match fs::symlink_metadata(path) {
            Ok(about) => about,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(source) => return Err(ServiceError::Folder { path: path.into(), source }),
        };
        let (owner, mode) = (about.uid(), about.mode() & 0o777);
        if owner != self.user {
            return Err(ServiceError::Foreign { path: path.into(), owner, user: self.user });
        }
        if mode & 0o022 != 0 && !about.is_symlink() {
            return Err(ServiceError::OpenToOthers { path: path.into(), mode });
        }
        Ok(())
    }

    /// Checks all that lies in a folder; no folder in it is deeper than those of its nodes.
    fn check_contents(&self, folder: &Path) -> Result<(), ServiceError> {
        for path in contents(folder) {
            self.check(&path)?;
        }
        Ok(())
    }

    /// This instance's files in shared memory.
    pub(crate) fn shared(&self) -> Vec<PathBuf> {
        shared_files(&self.prefix)
    }

    /// Removes what iceoryx2 leaves of an instance without nodes: a counter of 16 bytes in
    /// shared memory and empty folders. A folder that is in use is not empty, and stays.
    pub(crate) fn remove_leftovers(&self) {
        // Nobody may be between reading the counter and having a node. Without the lock it all stays.
        let Ok(_lock) = self.lock() else { return };
        let nodes = self.folder.join("nodes");
        if fs::read_dir(&nodes).is_ok_and(|mut entries| entries.next().is_some()) {
            return;
        }
        for path in self.shared() {
            if path.extension().is_some_and(|extension| extension == "global_mgmt") {
                // Another process may have been faster: then it is gone already.
                let _ = fs::remove_file(path);
            }
        }
        for folder in [nodes, self.folder.join("services"), self.folder.clone()] {
            let _ = fs::remove_dir(folder);
        }
    }

    /// Removes what processes that were killed left behind, and nothing of the living.
    pub(crate) fn clean(&self, config: &Config) -> Result<Cleaned, ServiceError> {
        let lock = self.lock()?;
        let is_there = self.folder.symlink_metadata().is_ok();
        if is_there {
            self.claim_folder(&self.folder)?;
            self.check_contents(&self.folder)?;
        }
        let (shared, paths) = (self.shared(), contents(&self.folder).len() + usize::from(is_there));
        let sizes: Vec<_> = shared.iter().map(|path| reserved_bytes(path)).collect();
        // iceoryx2 tells the dead from the living by a lock on a node's file, which ends with its process.
        Node::<ipc::Service>::blocking_cleanup_dead_nodes(config, CLEAN_TIMEOUT);
        // A node's files in /tmp may have been removed from under a living process: its memory is mapped. Nodes of
        // another prefix, of another version of these programs, are not listed: they lock their files all the same.
        let used = is_mapped(&self.prefix) || is_locked(&contents(&self.folder));
        let living = living_nodes(config).max(usize::from(used));
        if living == 0 {
            for path in self.shared() {
                self.check(&path)?;
                removed(&path, fs::remove_file(&path))?;
            }
            removed(&self.folder, fs::remove_dir_all(&self.folder))?;
        }
        drop(lock);
        let gone = shared.iter().zip(sizes).filter(|(path, _)| path.symlink_metadata().is_err());
        let left = contents(&self.folder).len() + usize::from(self.folder.exists());
        let mut cleaned =
            Cleaned { living, paths: paths.saturating_sub(left), ..Cleaned::default() };
        for (_, bytes) in gone {
            cleaned.shared_files += 1;
            cleaned.shared_bytes += bytes;
        }
        Ok(cleaned)
    }
}

/// The names of all instances of which this user has files, in order.
pub(crate) fn names_with_files() -> Vec<String> {
    let user = rustix::process::getuid().as_raw();
    let prefix = user_prefix(user);
    let in_memory = shared_files(&prefix).into_iter().filter_map(|path| {
        let name = path.file_name()?.to_str()?.strip_prefix(&prefix)?.split_once('_')?.0;
        Some(name.to_string())
    });
    let folders = fs::read_dir(user_folder(user)).into_iter().flatten().flatten();
    let in_folders = folders.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<_> = in_memory.chain(in_folders).collect();
    names.sort();
    names.dedup();
    names
}

fn shared_files(prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(FOLDER).into_iter().flatten().flatten();
    entries
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix))
        .map(|entry| entry.path())
        .collect()
}

/// All that lies in a folder, in the folders of it, and so on; links are not followed. A folder is its
/// parent's, so that the loop ends.
fn contents(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut next) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(folder) = next.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                next.push(entry.path());
            }
            found.push(entry.path());
        }
    }
    found
}

/// Whether this is a file of a node or service that is not initialised. Programs of this repository create
/// those under the lock only; a connection may just be created.
fn is_unfinished(path: &Path) -> bool {
    let extensions = ["global_mgmt", "dynamic"];
    path.extension().is_some_and(|extension| extensions.iter().any(|e| extension == *e))
        && path.symlink_metadata().is_ok_and(|about| about.mode() & 0o777 == UNFINISHED_MODE)
}

/// What a file takes \[bytes\]; nothing when it has gone.
fn reserved_bytes(path: &Path) -> u64 {
    path.symlink_metadata().map_or(0, |about| about.blocks() * 512)
}

/// The result of removing a file or folder. One that has gone already is as wanted.
fn removed(path: &Path, result: io::Result<()>) -> Result<(), ServiceError> {
    match result {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(ServiceError::Folder { path: path.into(), source })
        }
        _ => Ok(()),
    }
}

/// How many nodes are alive, or may be.
fn living_nodes(config: &Config) -> usize {
    let mut living = 0;
    let listed = Node::<ipc::Service>::list(config, |node| {
        living += usize::from(matches!(node, NodeState::Alive(_) | NodeState::Inaccessible(_)));
        CallbackProgression::Continue
    });
    // What cannot be listed may be alive.
    living + usize::from(listed.is_err())
}

/// Whether a process of this user has mapped shared memory of this prefix.
fn is_mapped(prefix: &str) -> bool {
    let mapped = format!("{FOLDER}/{prefix}");
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    processes.filter_map(|process| fs::File::open(process.path().join("maps")).ok()).any(|maps| {
        let mut lines = io::BufReader::new(maps).lines().map_while(Result::ok);
        lines.any(|line| line.contains(&mapped) && !line.ends_with("(deleted)"))
    })
}

/// Whether a process locks one of these files, see `/proc/locks`.
fn is_locked(paths: &[PathBuf]) -> bool {
    let inode = |path: &PathBuf| path.symlink_metadata().map(|about| about.ino()).ok();
    let inodes: Vec<_> = paths.iter().filter_map(inode).collect();
    let locks = fs::read_to_string("/proc/locks").unwrap_or_default();
    let locked = |line: &str| {
        line.split_whitespace().find_map(|word| word.splitn(3, ':').nth(2)?.parse().ok())
    };
    locks.lines().filter_map(locked).any(|inode: u64| inodes.contains(&inode))
}
