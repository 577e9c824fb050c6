//! Frames from several sources: the newest message of each is kept, and each frame belongs to one of them.
//!
//! Every source has a publisher of its own in the service of frames, with memory and a buffer of its own: one that
//! is slow, faster than the others, killed or started again does not concern them. It is known by its
//! [`TaskFrames::source`], so that one that comes back is the same.

use iceoryx2::identifiers::UniquePublisherId;

use crate::bounds::FRAME_SOURCES_MAX;
use crate::checks::unpadded;
use crate::messages::{Frame, NAME_CAPACITY, Reason, TaskFrames};
use crate::ports::{Sample, Subscriber};

/// So many messages are received at once at most: a source that publishes without a pause holds nobody up.
const RECEIVED_MAX: usize = 2 * FRAME_SOURCES_MAX;

type Name = [u8; NAME_CAPACITY];

/// A source, with its newest message as a view into shared memory.
#[derive(Debug)]
struct Source {
    newest: Sample<TaskFrames>,
    port: UniquePublisherId,
    /// The publisher that had this name before.
    before: Option<UniquePublisherId>,
    /// When the one before was heard again: two publishers have this name \[ns\].
    twice_ns: Option<u64>,
}

/// The newest message of each source. Bounded: nothing is allocated.
#[derive(Debug, Default)]
pub struct FrameSources {
    sources: [Option<Source>; FRAME_SOURCES_MAX],
    age_max_ns: u64,
    /// A source that found no place, and when.
    left_out: Option<(Name, u64)>,
}

impl FrameSources {
    /// None yet; what is older than `age_max_ns` \[ns\] is stale.
    #[must_use]
    pub fn new(age_max_ns: u64) -> Self {
        Self { age_max_ns, ..Self::default() }
    }

    /// Receives what sources have published, at the time `now_ns` \[ns\]; whether there was something. No
    /// allocation once connections stand.
    pub fn receive(&mut self, port: &Subscriber<TaskFrames>, now_ns: u64) -> bool {
        for received in 0..RECEIVED_MAX {
            let Some(message) = port.receive() else { return received > 0 };
            self.update(message, now_ns);
        }
        true
    }

    fn update(&mut self, newest: Sample<TaskFrames>, now_ns: u64) {
        let port = newest.origin();
        let Some(place) = self.place(&newest.source, port, now_ns) else {
            self.left_out = Some((newest.source, now_ns));
            return;
        };
        let place = &mut self.sources[place];
        let (mut before, mut twice_ns) = (None, None);
        if let Some(source) = place.as_ref().filter(|source| source.newest.source == newest.source)
        {
            (before, twice_ns) = (source.before, source.twice_ns);
            if source.port != port {
                twice_ns = if before == Some(port) { Some(now_ns) } else { twice_ns };
                before = Some(source.port);
            }
        }
        *place = Some(Source { newest, port, before, twice_ns });
    }

    /// The place of a source: its own, a free one, or that of one which is stale and is not known to have seen
    /// obstacles.
    fn place(&self, name: &Name, port: UniquePublisherId, now_ns: u64) -> Option<usize> {
        let find = |wanted: &dyn Fn(&Source) -> bool| {
            self.sources.iter().position(|source| source.as_ref().is_some_and(wanted))
        };
        let view = self.at(now_ns);
        find(&|source| source.newest.source == *name)
            .or_else(|| find(&|source| source.port == port))
            .or_else(|| self.sources.iter().position(Option::is_none))
            .or_else(|| {
                find(&|source| !view.is_fresh(&source.newest) && source.newest.obstacle_count == 0)
            })
    }

    /// What is published at the time `now_ns` \[ns\].
    #[must_use]
    pub fn at(&self, now_ns: u64) -> PublishedFrames<'_> {
        let recent = |since_ns: u64| now_ns.abs_diff(since_ns) <= self.age_max_ns;
        let mut sources = self.sources.iter().flatten();
        PublishedFrames {
            messages: core::array::from_fn(|i| self.sources[i].as_ref().map(|s| &*s.newest)),
            named_twice: sources
                .find(|source| source.twice_ns.is_some_and(recent))
                .map(|source| source.newest.source),
            left_out: self.left_out.filter(|(_, since_ns)| recent(*since_ns)).map(|(name, _)| name),
            now_ns,
            age_max_ns: self.age_max_ns,
        }
    }
}

/// The newest message of each source, as they are at one time.
#[derive(Debug, Clone, Copy)]
pub struct PublishedFrames<'a> {
    messages: [Option<&'a TaskFrames>; FRAME_SOURCES_MAX],
    named_twice: Option<Name>,
    left_out: Option<Name>,
    now_ns: u64,
    age_max_ns: u64,
}

/// A frame, and the message of the source to which it belongs.
#[derive(Debug, Clone, Copy)]
pub struct Claim<'a> {
    /// The frame.
    pub frame: &'a Frame,
    /// Its source's message.
    pub message: &'a TaskFrames,
}

impl<'a> PublishedFrames<'a> {
    /// These messages, each of a source of its own, at the time `now_ns` \[ns\]; what is older than `age_max_ns` is
    /// stale. Those beyond [`FRAME_SOURCES_MAX`] are left out.
    #[must_use]
    pub fn of(messages: &[&'a TaskFrames], now_ns: u64, age_max_ns: u64) -> Self {
        Self {
            messages: core::array::from_fn(|i| messages.get(i).copied()),
            named_twice: None,
            left_out: messages.get(FRAME_SOURCES_MAX).map(|message| message.source),
            now_ns,
            age_max_ns,
        }
    }

    /// The newest message of each source.
    pub fn messages(&self) -> impl Iterator<Item = &'a TaskFrames> + use<'a> {
        self.messages.into_iter().flatten()
    }

    /// A name that two publishers have.
    #[must_use]
    pub fn named_twice(&self) -> Option<&Name> {
        self.named_twice.as_ref()
    }

    /// A source too many.
    #[must_use]
    pub fn left_out(&self) -> Option<&Name> {
        self.left_out.as_ref()
    }

    /// How old a message is, or how far ahead \[ns\].
    #[must_use]
    pub fn age_ns(&self, message: &TaskFrames) -> u64 {
        self.now_ns.abs_diff(message.time_ns)
    }

    /// The time at which they are looked at \[ns\].
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// How old a message may be \[ns\].
    #[must_use]
    pub fn age_max_ns(&self) -> u64 {
        self.age_max_ns
    }

    /// Whether a message is no older than it may be.
    #[must_use]
    pub fn is_fresh(&self, message: &TaskFrames) -> bool {
        self.age_ns(message) <= self.age_max_ns
    }

    /// Everybody who publishes a frame of this name, valid or not.
    pub fn claims(&self, name: &Name) -> impl Iterator<Item = Claim<'a>> + use<'a> {
        let name = *name;
        self.messages().flat_map(move |message| {
            let frames = message.listed().unwrap_or(&[]).iter();
            let named = frames.filter(move |frame| frame.name == name);
            named.map(move |frame| Claim { frame, message })
        })
    }

    /// The frame of this name, as its source has it. A stale one counts only where nobody else publishes the
    /// frame: another source may carry on what one has left.
    ///
    /// # Errors
    /// [`Reason::FrameMissing`] where nobody does, [`Reason::FrameTwice`] where two do.
    pub fn find(&self, name: &Name) -> Result<Claim<'a>, Reason> {
        let mut fresh = self.claims(name).filter(|claim| self.is_fresh(claim.message));
        match (fresh.next(), fresh.next()) {
            (Some(claim), None) => Ok(claim),
            (Some(_), Some(_)) => Err(Reason::FrameTwice),
            _ => self.claims(name).next().ok_or(Reason::FrameMissing),
        }
    }

    /// The first stale thing that counts, where these frames are needed: one of them, or obstacles, which are there
    /// whoever no longer sees them.
    #[must_use]
    pub fn stale(&self, needed: &[Name]) -> Option<(Option<Name>, &'a TaskFrames)> {
        let frame = needed.iter().find_map(|name| {
            let message = self.find(name).ok()?.message;
            (!self.is_fresh(message)).then_some((Some(*name), message))
        });
        let lists_obstacles = |message: &&TaskFrames| message.obstacle_count > 0;
        let obstacles =
            || self.messages().filter(lists_obstacles).find(|message| !self.is_fresh(message));
        frame.or_else(|| obstacles().map(|message| (None, message)))
    }
}

/// A source in words: ``source `camera` ``.
#[must_use]
pub fn source_text(name: &Name) -> String {
    match core::str::from_utf8(unpadded(name)) {
        Ok("") => "the source without a name".into(),
        Ok(text) => format!("source `{text}`"),
        Err(_) => "a source whose name is no UTF-8".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checks::name_bytes;
    use crate::{Instance, ServiceError};

    const MS: u64 = 1_000_000;

    fn message(source: &str, frame: &str, time_ns: u64) -> TaskFrames {
        let mut message = TaskFrames { frame_count: 1, time_ns, ..Default::default() };
        if !source.is_empty() {
            message.source = name_bytes(source).unwrap();
        }
        message.frames[0] = Frame::at(frame, [0.0; 3]).unwrap();
        message
    }

    fn instance(test: &str) -> Instance {
        Instance::new(&format!("{test}-{}", std::process::id())).unwrap()
    }

    #[test]
    fn each_source_has_its_newest_message_whatever_their_rates() {
        let instance = instance("sources-rates");
        let (robot, camera) =
            (instance.open_state_publisher().unwrap(), instance.open_frame_source().unwrap());
        let reader = instance.open_controller().unwrap();
        let mut sources = FrameSources::new(100 * MS);
        assert!(!sources.receive(&reader.frames, 0));
        assert!(camera.frames.publish(message("camera", "object", MS)));
        for time in 1..=50 {
            assert!(robot.frames.publish(message("", "start", time * MS)));
            assert!(sources.receive(&reader.frames, time * MS));
        }
        let published = sources.at(50 * MS);
        let time = |name| published.find(&name_bytes(name).unwrap()).unwrap().message.time_ns;
        assert_eq!((time("start"), time("object")), (50 * MS, MS));
        assert!(published.stale(&[name_bytes("object").unwrap()]).is_none());
        let (name, stale) = sources.at(102 * MS).stale(&[name_bytes("object").unwrap()]).unwrap();
        assert_eq!((name, stale.time_ns), (name_bytes("object").ok(), MS));
    }

    #[test]
    fn a_source_that_comes_back_is_the_same_and_two_of_a_name_are_found() {
        let instance = instance("sources-back");
        let reader = instance.open_frames().unwrap();
        let mut sources = FrameSources::new(100 * MS);
        let one = instance.open_frame_source().unwrap();
        assert!(one.frames.publish(message("camera", "object", MS)));
        assert!(sources.receive(&reader.frames, MS));
        let other = instance.open_frame_source().unwrap();
        assert!(other.frames.publish(message("camera", "object", 2 * MS)));
        assert!(sources.receive(&reader.frames, 2 * MS));
        let published = sources.at(2 * MS);
        assert_eq!((published.messages().count(), published.named_twice()), (1, None));
        assert!(one.frames.publish(message("camera", "object", 3 * MS)));
        assert!(sources.receive(&reader.frames, 3 * MS));
        assert_eq!(sources.at(3 * MS).named_twice().copied(), name_bytes("camera").ok());
        drop(one);
        for time in [200, 400] {
            assert!(other.frames.publish(message("camera", "object", time * MS)));
            assert!(sources.receive(&reader.frames, time * MS));
        }
        assert_eq!(sources.at(400 * MS).named_twice(), None);
    }

    #[test]
    fn a_frame_belongs_to_one_source_and_is_carried_on_by_another() {
        let object = name_bytes("object").unwrap();
        let (a, b) = (message("a", "object", MS), message("b", "object", 90 * MS));
        let at = |now_ns| PublishedFrames::of(&[&a, &b], now_ns, 100 * MS);
        assert_eq!(at(90 * MS).find(&object).unwrap_err(), Reason::FrameTwice);
        assert_eq!(at(150 * MS).find(&object).unwrap().message.source, b.source);
        assert_eq!(at(300 * MS).stale(&[object]).unwrap().1.source, a.source);
        let other = name_bytes("other").unwrap();
        assert_eq!(at(90 * MS).find(&other).unwrap_err(), Reason::FrameMissing);
    }

    #[test]
    fn a_frame_that_stands_twice_in_one_message_is_believed_neither_time() {
        let object = name_bytes("object").unwrap();
        let mut a = message("a", "object", MS);
        (a.frames[1], a.frame_count) = (a.frames[0], 2);
        let found =
            PublishedFrames::of(&[&a], MS, 100 * MS).find(&object).map(|claim| claim.message);
        assert_eq!(found.unwrap_err(), Reason::FrameTwice);
    }

    #[test]
    fn stale_obstacles_count_and_frames_of_no_use_do_not() {
        let mut table = message("table", "corner", MS);
        let at = |table: &TaskFrames| {
            PublishedFrames::of(&[table], 200 * MS, 100 * MS).stale(&[]).is_some()
        };
        assert!(!at(&table));
        table.obstacle_count = 1;
        assert!(at(&table));
    }

    #[test]
    fn a_source_too_many_is_refused_and_a_dead_one_gives_its_place_away() {
        let instance = instance("sources-many");
        let reader = instance.open_frames().unwrap();
        let mut sources = FrameSources::new(100 * MS);
        let mut open: Vec<_> =
            (0..FRAME_SOURCES_MAX).map(|_| instance.open_frame_source().unwrap()).collect();
        let error = instance.open_frame_source().unwrap_err();
        assert!(matches!(error, ServiceError::TooManySources(_)), "{error}");
        for (number, source) in open.iter().enumerate() {
            assert!(source.frames.publish(message(&format!("source-{number}"), "object", MS)));
        }
        assert!(sources.receive(&reader.frames, MS));
        drop(open.remove(0));
        let late = instance.open_frame_source().unwrap();
        assert!(late.frames.publish(message("late", "late", 2 * MS)));
        assert!(sources.receive(&reader.frames, 2 * MS));
        assert_eq!(sources.at(2 * MS).left_out().copied(), name_bytes("late").ok());
        assert!(late.frames.publish(message("late", "late", 200 * MS)));
        assert!(sources.receive(&reader.frames, 200 * MS));
        assert!(sources.at(200 * MS).left_out().is_none());
        assert!(sources.at(200 * MS).find(&name_bytes("late").unwrap()).is_ok());
    }
}
