//! The newest detail, for other threads: written by the loop without a lock or an allocation, read again where it
//! was being written.

use core::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
use std::sync::OnceLock;

use tprmp_messages::{NAME_CAPACITY, Reason, name_str};

use crate::detail::seen::{About, Detail};

/// Words of a name.
const WORDS: usize = NAME_CAPACITY / 8;
/// Most names of a list; those beyond are left out.
const NAMES_MAX: usize = 16;
/// So often a detail that is being written is read again.
const READS: u32 = 100;

type Name = [u8; NAME_CAPACITY];

/// Names of frames.
#[derive(Debug, Default)]
struct SharedNames {
    count: AtomicU32,
    words: [[AtomicU64; WORDS]; NAMES_MAX],
}

impl SharedNames {
    fn store<'a>(&self, names: impl Iterator<Item = &'a Name>) {
        let mut count = 0;
        for (words, name) in self.words.iter().zip(names) {
            store(words, name);
            count += 1;
        }
        self.count.store(count, Ordering::Relaxed);
    }

    fn load(&self) -> Vec<String> {
        let count = self.count.load(Ordering::Relaxed) as usize;
        let text = |words| name_str(&load(words)).unwrap_or("(no UTF-8)").to_owned();
        self.words.iter().take(count).map(text).collect()
    }
}

fn store(words: &[AtomicU64; WORDS], name: &Name) {
    for (word, bytes) in words.iter().zip(name.as_chunks::<8>().0) {
        word.store(u64::from_ne_bytes(*bytes), Ordering::Relaxed);
    }
}

fn load(words: &[AtomicU64; WORDS]) -> Name {
    let mut name = [0; NAME_CAPACITY];
    for (bytes, word) in name.as_chunks_mut::<8>().0.iter_mut().zip(words) {
        *bytes = word.load(Ordering::Relaxed).to_ne_bytes();
    }
    name
}

/// The newest detail and the names that it may be about.
#[derive(Debug, Default)]
pub struct SharedDetail {
    /// Odd while it is being written.
    version: AtomicU64,
    reason: AtomicU32,
    about: AtomicU32,
    index: AtomicU32,
    name: [AtomicU64; WORDS],
    sources: [[AtomicU64; WORDS]; 2],
    /// As bits.
    numbers: [AtomicU64; 3],
    needed: SharedNames,
    found: SharedNames,
    joints: OnceLock<Vec<String>>,
}

/// A detail and the names that it may be about, as they were at one time.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    /// What was seen.
    pub detail: Detail,
    /// The robot's joints.
    pub joints: Vec<String>,
    /// The frames that the skills need.
    pub needed: Vec<String>,
    /// The frames that were published.
    pub found: Vec<String>,
}

impl SharedDetail {
    /// Names the robot's joints, once, at start-up.
    pub fn name_joints(&self, joints: &[String]) {
        let _ = self.joints.set(joints.to_vec());
    }

    /// Stores a detail, the frames that are needed and those that were found. No lock, no allocation.
    pub fn write<'a>(
        &self,
        detail: &Detail,
        needed: &[Name],
        found: impl Iterator<Item = &'a Name>,
    ) {
        self.version.fetch_add(1, Ordering::Relaxed);
        fence(Ordering::Release);
        self.reason.store(detail.reason.to_wire(), Ordering::Relaxed);
        self.about.store(detail.about as u32, Ordering::Relaxed);
        self.index.store(detail.index, Ordering::Relaxed);
        store(&self.name, &detail.name);
        for (words, name) in self.sources.iter().zip(&detail.sources) {
            store(words, name);
        }
        let [least, most] = detail.expected;
        for (number, value) in self.numbers.iter().zip([detail.seen, least, most]) {
            number.store(value.to_bits(), Ordering::Relaxed);
        }
        self.needed.store(needed.iter());
        self.found.store(found);
        self.version.fetch_add(1, Ordering::Release);
    }

    /// What was stored last, where it is about this reason.
    #[must_use]
    pub fn read(&self, reason: Reason) -> Option<Snapshot> {
        for _ in 0..READS {
            let before = self.version.load(Ordering::Acquire);
            let snapshot = self.load();
            fence(Ordering::Acquire);
            if before.is_multiple_of(2) && self.version.load(Ordering::Relaxed) == before {
                return (snapshot.detail.reason == reason).then_some(snapshot);
            }
            std::thread::yield_now();
        }
        None
    }

    fn load(&self) -> Snapshot {
        let number = |i: usize| f64::from_bits(self.numbers[i].load(Ordering::Relaxed));
        let about = About::ALL.get(self.about.load(Ordering::Relaxed) as usize);
        let detail = Detail {
            reason: Reason::from_wire(self.reason.load(Ordering::Relaxed)).unwrap_or_default(),
            about: about.copied().unwrap_or_default(),
            index: self.index.load(Ordering::Relaxed),
            name: load(&self.name),
            sources: [0, 1].map(|i| load(&self.sources[i])),
            seen: number(0),
            expected: [number(1), number(2)],
        };
        let joints = self.joints.get().cloned().unwrap_or_default();
        Snapshot { detail, joints, needed: self.needed.load(), found: self.found.load() }
    }

    /// The robot's joints; none before they were named.
    #[must_use]
    pub fn joints(&self) -> &[String] {
        self.joints.get().map_or(&[], Vec::as_slice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_messages::name_bytes;

    #[test]
    fn a_detail_survives_its_storage() {
        let shared = SharedDetail::default();
        shared.name_joints(&["shoulder".into()]);
        let name = |name| name_bytes(name).unwrap();
        let needed = [name("object")];
        let detail = Detail::new(Reason::FrameMissing, About::FrameFar, f64::NAN, [1.0, -2.0]);
        let detail = detail.at(3).named(&needed[0]).of_source(&name("camera"));
        shared.write(&detail, &needed, [name("Object"), name("start")].iter());
        assert!(shared.read(Reason::JointLimit).is_none());
        let read = shared.read(Reason::FrameMissing).unwrap();
        assert_eq!((read.detail.about, read.detail.index), (About::FrameFar, 3));
        assert!(read.detail.seen.is_nan() && read.detail.expected == [1.0, -2.0]);
        assert_eq!(name_str(&read.detail.name), Some("object"));
        assert_eq!(read.detail.sources, detail.sources);
        assert_eq!((read.joints, read.needed), (vec!["shoulder".into()], vec!["object".into()]));
        assert_eq!(read.found, ["Object", "start"]);
    }
}
