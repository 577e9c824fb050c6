//! Checks of what arrives: nothing unchecked goes further.

use glam::{DQuat, DVec3};
use tprmp_messages::{
    Frame, NAME_CAPACITY, PublishedFrames, QUATERNION_TOLERANCE, Reason, RobotState, name_str,
};
use tprmp_model::skill_model::{FRAME_CAPACITY, Manifold};
use tprmp_spatial::Pose;

/// Two states farther apart than this do not show how the arm moved in between [ns].
pub(super) const GAP_MAX_NS: u64 = 100_000_000;
/// Of states that follow each other faster, not every one is kept [ns]: what a demonstration holds
/// is bounded.
const STEP_MIN_NS: u64 = 400_000;
/// Older frames are not used [ns].
pub(super) const FRAMES_AGE_MAX_NS: u64 = 1_000_000_000;
/// How far a frame of a planar skill may lie off the plane [m]: files are written with six decimals.
const OFF_PLANE_MAX_M: f64 = 5e-7;

/// What is wrong with a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Fault {
    #[error("a state has {found} joints, the robot's description has {expected}")]
    JointCount { expected: usize, found: u32 },
    #[error("a joint position is not finite")]
    NotFinite,
    #[error("the sequence number went back, so the publisher was started again")]
    SequenceWentBack,
    #[error("the time stamp of the states went back")]
    TimeWentBack,
    #[error("more than {} s lie between two states", GAP_MAX_NS as f64 * 1e-9)]
    Gap,
}

/// Checks states, one after the other.
#[derive(Debug)]
pub(super) struct StateIntake {
    joints: usize,
    /// Sequence number and time of the newest state [ns].
    last: Option<(u64, u64)>,
    /// Time of the newest state that was kept [ns].
    kept_ns: Option<u64>,
    /// Sequence numbers skipped since then.
    skipped: u64,
}

impl StateIntake {
    pub(super) fn new(joints: usize) -> Self {
        Self { joints, last: None, kept_ns: None, skipped: 0 }
    }

    /// The next state may be anything.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.joints);
    }

    /// Checks a state. Gives the sequence numbers that were skipped before it; `None` when it is not
    /// new, because it was measured at the time of another one.
    ///
    /// # Errors
    /// What is wrong with it. The one after it is compared with it all the same.
    pub(super) fn check(&mut self, state: &RobotState) -> Result<Option<u64>, Fault> {
        let before = self.last.replace((state.sequence, state.time_ns));
        let result = self.compare(state, before);
        if result.is_err() {
            self.kept_ns = None;
            self.skipped = 0;
        }
        result
    }

    fn compare(
        &mut self,
        state: &RobotState,
        before: Option<(u64, u64)>,
    ) -> Result<Option<u64>, Fault> {
        state.check_positions(self.joints).map_err(|reason| match reason {
            Reason::JointCount => {
                Fault::JointCount { expected: self.joints, found: state.joint_count }
            }
            _ => Fault::NotFinite,
        })?;
        if let Some((sequence, time_ns)) = before {
            if state.sequence < sequence {
                return Err(Fault::SequenceWentBack);
            }
            if state.time_ns < time_ns {
                return Err(Fault::TimeWentBack);
            }
            if state.time_ns - time_ns > GAP_MAX_NS {
                return Err(Fault::Gap);
            }
            self.skipped += (state.sequence - sequence).saturating_sub(1);
        }
        if self.kept_ns.is_some_and(|kept| state.time_ns - kept < STEP_MIN_NS) {
            return Ok(None);
        }
        self.kept_ns = Some(state.time_ns);
        Ok(Some(std::mem::take(&mut self.skipped)))
    }
}

/// Why a frame cannot be used; as text it goes on after "a frame, which".
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Unusable {
    #[error("is not there: no task frames are published")]
    Nothing,
    #[error("is not among the published frames")]
    Absent,
    #[error("is published by two sources")]
    Twice,
    #[error("is published as invalid")]
    Invalid,
    #[error("has a number that is not finite")]
    NotFinite,
    #[error("has a quaternion that is not of unit length")]
    NotUnit,
    #[error("is not in the plane: a planar skill has frames with z = 0, rotated about z")]
    NotPlanar,
    #[error("is older than the state by more than a second")]
    Stale,
    #[error("has not been in sight for long enough to know that it rests")]
    New,
}

/// X_BF of a frame.
pub(super) type FrameStatus = Result<Pose, Unusable>;

/// What is known of the frames of a skill, in the order of their names; beyond them there is
/// nothing.
pub(super) type Frames = [FrameStatus; FRAME_CAPACITY];

/// No frames have been published.
pub(super) const NO_FRAMES: Frames = [Err(Unusable::Nothing); FRAME_CAPACITY];

/// Checks frames and keeps the newest.
#[derive(Debug)]
pub(super) struct FramesIntake {
    names: Vec<[u8; NAME_CAPACITY]>,
    planar: bool,
    newest: Frames,
    /// When each of them was measured.
    times_ns: [u64; FRAME_CAPACITY],
    published: Vec<[u8; NAME_CAPACITY]>,
}

impl FramesIntake {
    /// `names` of the skill's frames.
    ///
    /// # Panics
    /// When there are more than [`FRAME_CAPACITY`].
    pub(super) fn new(names: Vec<[u8; NAME_CAPACITY]>, manifold: Manifold) -> Self {
        assert!(names.len() <= FRAME_CAPACITY, "frames of a skill");
        Self {
            names,
            planar: manifold == Manifold::R2,
            newest: NO_FRAMES,
            times_ns: [0; FRAME_CAPACITY],
            published: Vec::with_capacity(tprmp_messages::FRAME_CAPACITY),
        }
    }

    /// Nothing has been published.
    pub(super) fn forget(&mut self) {
        self.newest = NO_FRAMES;
        self.published.clear();
    }

    /// Handles what all sources have published.
    pub(super) fn update(&mut self, published: &PublishedFrames<'_>) {
        for (i, name) in self.names.iter().enumerate() {
            (self.newest[i], self.times_ns[i]) = match published.find(name) {
                Ok(found) => (status(found.frame, self.planar), found.message.time_ns),
                Err(Reason::FrameTwice) => (Err(Unusable::Twice), self.times_ns[i]),
                Err(_) => (Err(Unusable::Absent), self.times_ns[i]),
            };
        }
        self.published.clear();
        let frames = published.messages().flat_map(|message| message.listed().unwrap_or(&[]));
        self.published.extend(frames.map(|f| f.name));
    }

    /// The frames as they count for a state of this time [ns].
    pub(super) fn at(&self, state_ns: u64) -> Frames {
        core::array::from_fn(|i| match self.newest[i] {
            Ok(_) if state_ns.saturating_sub(self.times_ns[i]) > FRAMES_AGE_MAX_NS => {
                Err(Unusable::Stale)
            }
            status => status,
        })
    }

    /// Names of all published frames, for people.
    pub(super) fn published(&self) -> String {
        let names = self.published.iter().map(|name| name_str(name).unwrap_or("?"));
        let names: Vec<_> = names.map(|name| format!("`{name}`")).collect();
        if names.is_empty() { "none".into() } else { names.join(", ") }
    }
}

fn status(frame: &Frame, planar: bool) -> FrameStatus {
    frame.check_pose().map_err(|reason| match reason {
        Reason::FrameMissing => Unusable::Invalid,
        Reason::FrameNotFinite => Unusable::NotFinite,
        _ => Unusable::NotUnit,
    })?;
    let [w, x, y, z] = frame.quaternion;
    let mut position = DVec3::from(frame.position);
    let mut orientation = DQuat::from_xyzw(x, y, z, w);
    if planar {
        if position.z.abs() > OFF_PLANE_MAX_M || x.hypot(y) > QUATERNION_TOLERANCE {
            return Err(Unusable::NotPlanar);
        }
        position.z = 0.0;
        orientation = DQuat::from_xyzw(0.0, 0.0, z, w);
    }
    Ok(Pose { position, orientation: orientation.normalize() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_messages::{TaskFrames, name_bytes};

    fn state(sequence: u64, time_ns: u64) -> RobotState {
        RobotState { sequence, time_ns, joint_count: 2, ..Default::default() }
    }

    #[test]
    fn every_faulty_state_has_its_fault_and_the_next_good_one_is_kept() {
        type Edit = fn(&mut RobotState);
        let cases: [(Edit, Fault); 5] = [
            (|s| s.joint_count = 3, Fault::JointCount { expected: 2, found: 3 }),
            (|s| s.position[1] = f64::NAN, Fault::NotFinite),
            (|s| s.sequence = 4, Fault::SequenceWentBack),
            (|s| s.time_ns -= 2_000_000, Fault::TimeWentBack),
            (|s| s.time_ns += GAP_MAX_NS, Fault::Gap),
        ];
        for (edit, fault) in cases {
            let mut intake = StateIntake::new(2);
            assert_eq!(intake.check(&state(10, 1_000_000_000)), Ok(Some(0)));
            let mut bad = state(11, 1_001_000_000);
            edit(&mut bad);
            assert_eq!(intake.check(&bad), Err(fault));
            let next = state(bad.sequence + 1, bad.time_ns + 1_000_000);
            assert_eq!(intake.check(&next), Ok(Some(0)), "{fault:?}");
        }
    }

    #[test]
    fn skipped_numbers_are_counted_and_repeated_measurements_are_skipped() {
        let mut intake = StateIntake::new(2);
        // What is beyond the joints does not count.
        let mut first = state(1, 0);
        first.position[2] = f64::NAN;
        assert_eq!(intake.check(&first), Ok(Some(0)));
        assert_eq!(intake.check(&state(4, 1_000_000)), Ok(Some(2)));
        assert_eq!(intake.check(&state(6, 1_000_000)), Ok(None));
        assert_eq!(intake.check(&state(7, 1_100_000)), Ok(None));
        assert_eq!(intake.check(&state(8, 2_000_000)), Ok(Some(1)));
        intake.forget();
        assert_eq!(intake.check(&state(1, 0)), Ok(Some(0)));
    }

    #[test]
    fn every_defect_of_a_frame_is_found() {
        type Edit = fn(&mut TaskFrames);
        let cases: [(Edit, FrameStatus); 7] = [
            (|m| m.frame_count = 1, Err(Unusable::Absent)),
            (|m| m.frames[1].name[0] = b'x', Err(Unusable::Absent)),
            (|m| m.frames[1].valid = 0, Err(Unusable::Invalid)),
            (|m| m.frames[1].position[0] = f64::INFINITY, Err(Unusable::NotFinite)),
            (|m| m.frames[1].quaternion = [0.9, 0.0, 0.0, 0.0], Err(Unusable::NotUnit)),
            (|m| m.frames[1].position[2] = 0.01, Err(Unusable::NotPlanar)),
            (|m| m.frames[1].quaternion = [0.0, 1.0, 0.0, 0.0], Err(Unusable::NotPlanar)),
        ];
        let names = ["start", "end"].map(|name| name_bytes(name).unwrap());
        let frame =
            |name| Frame { name, valid: 1, quaternion: [1.0, 0.0, 0.0, 0.0], ..Default::default() };
        let usable = Ok(Pose::IDENTITY);
        let mut good = TaskFrames { frame_count: 2, time_ns: 5, ..Default::default() };
        good.frames[..2].copy_from_slice(&names.map(frame));
        let mut intake = FramesIntake::new(names.to_vec(), Manifold::R2);
        assert_eq!(intake.at(0), NO_FRAMES);
        fn alone(message: &TaskFrames) -> PublishedFrames<'_> {
            PublishedFrames::of(&[message], message.time_ns, FRAMES_AGE_MAX_NS)
        }
        for (edit, expected) in cases {
            let mut message = good;
            edit(&mut message);
            intake.update(&alone(&message));
            assert_eq!(intake.at(5)[..3], [usable, expected, Err(Unusable::Nothing)]);
        }
        intake.update(&alone(&good));
        let twice = [&good, &TaskFrames::of_source("other").unwrap()];
        intake.update(&PublishedFrames::of(&twice, 5, FRAMES_AGE_MAX_NS));
        assert_eq!(intake.at(5)[0], usable);
        let twice = [&good, &TaskFrames { source: names[0], ..good }];
        intake.update(&PublishedFrames::of(&twice, 5, FRAMES_AGE_MAX_NS));
        assert_eq!(intake.at(5)[0], Err(Unusable::Twice));
        intake.update(&alone(&good));
        assert_eq!(intake.at(5 + FRAMES_AGE_MAX_NS)[1], usable);
        assert_eq!(intake.at(6 + FRAMES_AGE_MAX_NS)[1], Err(Unusable::Stale));
        assert_eq!(intake.published(), "`start`, `end`");
        intake.forget();
        assert_eq!((intake.at(5), intake.published()), (NO_FRAMES, "none".into()));
    }
}
