//! Decides what is a demonstration: a motion of the tool between two rests, with frames that rest.
//!
//! ```text
//! Unsettled ── the arm rests ──► Ready ── it moves, frames are there ─► Recording
//!     ▲                            ▲                                       │
//!     │                            └──────── it rests: a demonstration ────┤
//!     └──── a fault, a frame that moves, a motion without frames ──────────┘
//! ```
//!
//! Rest is judged by statistics over windows of time (`rest`, `frame_rest`), never by one sample. After
//! a refusal the arm has to rest first, so that no second half of a motion counts as a whole one.

use tprmp_model::skill_model::FRAME_CAPACITY;

use super::frame_rest::{Drift, FramesRest, RestingFrame};
use super::intake::{Frames, NO_FRAMES, Unusable};
use super::recording::{Recorded, Recording, Task};
use super::rest::{Motion, Sample, ToolRest};
use crate::demonstration::DURATION_MAX_S;

/// Longer motions are given up [ns].
const DURATION_MAX_NS: u64 = (DURATION_MAX_S * 1e9) as u64;

/// What has come of a sample.
#[derive(Debug)]
pub(super) enum Event {
    /// A demonstration has begun; whether the tool's pose serves as the start frame.
    Begun { tool_as_start: bool },
    /// A demonstration has ended.
    Recorded(Box<Recorded>),
    /// A motion is no demonstration, for this reason.
    Refused(String),
}

/// What the recorder waits for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Stage {
    /// For the arm to rest.
    Unsettled,
    /// For a usable frame, by its place in [`Task::frames`].
    FrameMissing(usize, Unusable),
    /// For a frame to rest, by its place in [`Task::frames`].
    FrameMoves(usize),
    /// For the arm to move.
    Ready,
    /// For the arm to rest again: a demonstration is under way.
    Recording,
}

#[derive(Debug)]
enum Phase {
    Unsettled,
    Ready,
    Recording(Box<Recording>),
}

/// What the recorder sees, for people.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Observation {
    /// Of the tool; `None` until there is a window of states.
    pub(super) motion: Option<Motion>,
    /// The goal frame; `None` when it is not usable.
    pub(super) goal: Option<RestingFrame>,
    /// The frame that moves, if one does.
    pub(super) drift: Option<Drift>,
    /// How long the demonstration under way is [ns].
    pub(super) recording_ns: Option<u64>,
}

/// The state machine. It is fed with samples whose times grow, and knows no clock.
#[derive(Debug)]
pub(super) struct Recorder {
    task: Task,
    phase: Phase,
    frames: Frames,
    tool: ToolRest,
    frames_rest: FramesRest,
    /// How far each frame goes; `None` for one that has not been usable for long enough.
    drifts: [Option<Drift>; FRAME_CAPACITY],
}

impl Recorder {
    pub(super) fn new(task: Task) -> Self {
        Self {
            phase: Phase::Unsettled,
            frames: NO_FRAMES,
            tool: ToolRest::new(task.manifold, task.bounds),
            frames_rest: FramesRest::new(task.bounds),
            drifts: [None; FRAME_CAPACITY],
            task,
        }
    }

    /// What is waited for.
    pub(super) fn stage(&self) -> Stage {
        match self.phase {
            Phase::Unsettled => Stage::Unsettled,
            Phase::Recording(_) => Stage::Recording,
            Phase::Ready => match (self.missing(), self.moving()) {
                (Some((i, _, why)), _) => Stage::FrameMissing(i, why),
                (None, Some((i, _))) => Stage::FrameMoves(i),
                (None, None) => Stage::Ready,
            },
        }
    }

    /// What is seen. Costs a mean over a window.
    pub(super) fn observation(&self) -> Observation {
        let newest_ns = self.tool.newest_ns().unwrap_or_default();
        let recording_ns = match &self.phase {
            Phase::Recording(recording) => Some(newest_ns - recording.begun_ns),
            Phase::Unsettled | Phase::Ready => None,
        };
        Observation {
            motion: self.tool.motion().copied(),
            goal: self.frames_rest.resting(0),
            drift: self.moving().map(|(_, drift)| drift),
            recording_ns,
        }
    }

    /// The first frame that is needed and cannot be used: its place, its name, and why.
    fn missing(&self) -> Option<(usize, &str, Unusable)> {
        let required = self.task.required_frames.len();
        let mut frames = self.task.frames().zip(self.frames).enumerate();
        frames.find_map(|(i, (name, status))| match status {
            Err(Unusable::Absent) if i >= required => None,
            Err(why) => Some((i, name.as_str(), why)),
            Ok(_) if self.drifts[i].is_none() => Some((i, name.as_str(), Unusable::New)),
            Ok(_) => None,
        })
    }

    /// The first frame that moves: its place, and how far it goes.
    fn moving(&self) -> Option<(usize, Drift)> {
        let drifts = self.drifts.iter().enumerate();
        drifts.filter_map(|(i, drift)| Some((i, (*drift)?))).find(|(_, drift)| drift.moves())
    }

    /// Handles where the tool was, later than the sample before, and what is known of the frames;
    /// `skipped` states are missing before it.
    pub(super) fn observe(
        &mut self,
        sample: Sample,
        frames: Frames,
        skipped: u64,
    ) -> Option<Event> {
        let time_ns = sample.time_ns;
        let elapsed_ns = self.tool.newest_ns().map_or(0, |last| time_ns - last);
        let judged = self.tool.update(sample);
        self.frames = frames;
        self.frames_rest.update(time_ns, &frames);
        if let Phase::Recording(recording) = &mut self.phase {
            recording.add(sample, &frames, elapsed_ns, skipped);
        }
        if judged { self.decide(*self.tool.motion()?) } else { None }
    }

    /// Goes on to the next phase, when it is time.
    fn decide(&mut self, motion: Motion) -> Option<Event> {
        let rested = motion.rests_ns.is_some_and(|ns| ns >= self.task.bounds.rest_ns());
        match &self.phase {
            Phase::Unsettled if rested => {
                self.judge_frames();
                self.phase = Phase::Ready;
                None
            }
            Phase::Unsettled => None,
            Phase::Ready => {
                self.judge_frames();
                motion.moves().then(|| self.begin(&motion))
            }
            Phase::Recording(_) if rested => self.finish(Phase::Ready),
            Phase::Recording(recording) => {
                let why = self.broken_off(recording, &motion)?;
                self.interrupt(&why)
            }
        }
    }

    fn judge_frames(&mut self) {
        for i in 0..self.task.frames().count() {
            self.drifts[i] = self.frames_rest.drift(i);
        }
    }

    /// Why the demonstration under way is none, when it is none.
    fn broken_off(&self, recording: &Recording, motion: &Motion) -> Option<String> {
        if recording.duration_ns() > DURATION_MAX_NS {
            let minutes = DURATION_MAX_NS / 60_000_000_000;
            return Some(format!("it takes longer than {minutes} minutes"));
        }
        if !motion.moves() {
            return None;
        }
        let mut frames = self.task.frames().zip(&recording.frames).enumerate();
        frames.find_map(|(i, (name, rested))| {
            let drift = self.frames_rest.drift_from(i, rested.as_ref()?)?;
            drift.moves().then(|| {
                format!(
                    "frame `{name}` {} while the arm did; the frames of a demonstration rest",
                    moved(&drift)
                )
            })
        })
    }

    /// Something happened that no demonstration survives; the next sample may be any.
    pub(super) fn interrupt(&mut self, why: &str) -> Option<Event> {
        self.tool.forget();
        self.frames_rest.forget();
        self.drifts = [None; FRAME_CAPACITY];
        match std::mem::replace(&mut self.phase, Phase::Unsettled) {
            Phase::Recording(_) => Some(Event::Refused(why.into())),
            Phase::Unsettled | Phase::Ready => None,
        }
    }

    /// No more samples follow: what is under way is finished as it is.
    pub(super) fn end(&mut self) -> Option<Event> {
        self.finish(Phase::Unsettled)
    }

    /// The arm begins to move.
    fn begin(&mut self, motion: &Motion) -> Event {
        if let Some(why) = self.unready() {
            self.phase = Phase::Unsettled;
            return Event::Refused(format!("the arm moves, but {why}"));
        }
        let begun_ns = self.tool.newest_ns().unwrap_or_default();
        let usable = |i: usize| self.frames[i].ok().and_then(|_| self.frames_rest.resting(i));
        let frames = std::array::from_fn(usable);
        let recording = Recording {
            samples: self.tool.samples_since(motion.rested_since_ns.unwrap_or(begun_ns)),
            begun_ns,
            noise: motion.noise,
            frames,
            missing_ns: [0; FRAME_CAPACITY],
            skipped: 0,
        };
        self.phase = Phase::Recording(Box::new(recording));
        // What is needed is there, so that only a start frame can be missing.
        Event::Begun { tool_as_start: frames[..self.task.frames().count()].contains(&None) }
    }

    /// Why no demonstration can begin, when none can.
    fn unready(&self) -> Option<String> {
        if let Some((_, name, why)) = self.missing() {
            return Some(format!("frame `{name}` {why}"));
        }
        let (i, drift) = self.moving()?;
        let name = self.task.frames().nth(i)?;
        let rest_s = self.task.bounds.rest_s;
        Some(format!("frame `{name}` {} within {rest_s} s; let it rest before", moved(&drift)))
    }

    /// Ends the demonstration under way.
    fn finish(&mut self, next: Phase) -> Option<Event> {
        let Phase::Recording(recording) = std::mem::replace(&mut self.phase, next) else {
            return None;
        };
        Some(match recording.finish(&self.task) {
            Ok(recorded) => Event::Recorded(Box::new(recorded)),
            Err(why) => Event::Refused(why),
        })
    }
}

/// How far a frame moved; goes on after its name.
fn moved(drift: &Drift) -> String {
    format!("moved by {:.1} mm and {:.1}°", drift.moved.m * 1e3, drift.moved.rad.to_degrees())
}

#[cfg(test)]
mod tests;
