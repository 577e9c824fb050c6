//! What a controller that did not end by itself was doing: a small file in the instance's folder that exists
//! while a controller runs. The loop only stores numbers; a thread beside it writes them.

use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::io;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use tprmp_files::{Existing, read_text, write};
use tprmp_spatial::Pose;

/// Largest journal \[bytes\].
const BYTES_MAX: u64 = 4096;

/// Why there is no journal.
#[derive(Debug, Error)]
#[error("journal `{path}` cannot be written: {source}")]
pub struct JournalError {
    path: PathBuf,
    source: io::Error,
}

/// What the task of a controller had come to.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Whether the gripper was told to grip.
    pub gripping: bool,
    /// Where what it holds was being lifted to: position \[m\], quaternion w, x, y, z.
    pub lift_goal: Option<[f64; 7]>,
}

impl Entry {
    /// The goal of the lift.
    #[must_use]
    pub fn goal(&self) -> Option<Pose> {
        let [x, y, z, qw, qx, qy, qz] = self.lift_goal?;
        let orientation = DQuat::from_xyzw(qx, qy, qz, qw);
        let holds = DVec3::new(x, y, z).is_finite() && (orientation.length() - 1.0).abs() < 1e-6;
        holds.then_some(Pose { position: DVec3::new(x, y, z), orientation })
    }
}

/// The entry of the running controller, for another thread: written and read without a lock.
#[derive(Debug, Default)]
pub struct SharedTask {
    gripping: AtomicBool,
    lifting: AtomicBool,
    goal: [AtomicU64; 7],
}

impl SharedTask {
    /// Stores what the task has come to. No lock, no allocation.
    pub fn store(&self, gripping: bool, goal: Option<&Pose>) {
        self.gripping.store(gripping, Ordering::Relaxed);
        if let Some(Pose { position, orientation: o }) = goal {
            let values = [position.x, position.y, position.z, o.w, o.x, o.y, o.z];
            for (slot, value) in self.goal.iter().zip(values) {
                slot.store(value.to_bits(), Ordering::Relaxed);
            }
        }
        // The goal does not change during a lift: who sees the mark sees all of it.
        self.lifting.store(goal.is_some(), Ordering::Release);
    }

    /// What was stored last.
    #[must_use]
    pub fn load(&self) -> Entry {
        let lifting = self.lifting.load(Ordering::Acquire);
        let goal = core::array::from_fn(|i| f64::from_bits(self.goal[i].load(Ordering::Relaxed)));
        Entry {
            gripping: self.gripping.load(Ordering::Relaxed),
            lift_goal: lifting.then_some(goal),
        }
    }
}

/// The file. It stays where nobody ends it.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    written: Entry,
}

impl Journal {
    /// Begins one in the instance's folder; gives what the last one says, where there is one: then that
    /// controller did not end by itself.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn begin(folder: &Path) -> Result<(Self, Option<Entry>), JournalError> {
        let path = folder.join("controller.journal");
        // What cannot be understood was left behind all the same.
        let last = path.exists().then(|| {
            let text = read_text(&path, BYTES_MAX).unwrap_or_default();
            serde_json::from_str(&text).unwrap_or_default()
        });
        let mut journal = Self { path, written: Entry::default() };
        match journal.write(&last.unwrap_or_default()) {
            Ok(()) => Ok((journal, last)),
            Err(source) => Err(JournalError { path: journal.path, source }),
        }
    }

    /// Writes an entry where it has changed.
    ///
    /// # Errors
    /// What the system says.
    pub fn update(&mut self, entry: &Entry) -> io::Result<()> {
        if *entry == self.written { Ok(()) } else { self.write(entry) }
    }

    /// The controller ends by itself: the file goes.
    pub fn end(self) {
        let _ = std::fs::remove_file(&self.path);
    }

    fn write(&mut self, entry: &Entry) -> io::Result<()> {
        let text = serde_json::to_string(entry).map_err(io::Error::other)?;
        write(&self.path, text, Existing::Replace).map_err(io::Error::other)?;
        self.written = *entry;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_controller_that_did_not_end_leaves_what_it_was_doing() {
        let folder = std::env::temp_dir().join(format!("tprmp-journal-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (mut journal, last) = Journal::begin(&folder).unwrap();
        assert_eq!(last, None);
        let task = SharedTask::default();
        let goal =
            Pose { position: DVec3::new(0.1, 0.2, 0.3), orientation: DQuat::from_rotation_x(0.4) };
        task.store(true, Some(&goal));
        journal.update(&task.load()).unwrap();
        // Killed.
        drop(journal);
        let (journal, last) = Journal::begin(&folder).unwrap();
        assert_eq!(last, Some(task.load()));
        assert_eq!(last.unwrap().goal(), Some(goal));
        journal.end();
        assert_eq!(Journal::begin(&folder).unwrap().1, None, "it ended by itself");
        write(&folder.join("controller.journal"), "rubbish", Existing::Replace).unwrap();
        assert_eq!(Journal::begin(&folder).unwrap().1, Some(Entry::default()));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
