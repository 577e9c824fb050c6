//! What a publisher sends in a few seconds.

use std::time::{Duration, Instant};

use nalgebra::SVector;
use tprmp_messages::{FRAME_SOURCES_MAX, RobotState, Subscriber, TaskFrames};

use crate::inputs::turns::{ContinuousJoints, add_turns};
use crate::timing::realtime::monotonic_ns;

/// How long a first state is waited for.
const PATIENCE: Duration = Duration::from_secs(5);
/// Pause between two looks.
const LOOK: Duration = Duration::from_micros(200);

/// A message, and when it was received.
#[derive(Debug, Clone, Copy)]
pub(super) struct Received<M> {
    /// The message.
    pub(super) message: M,
    /// On CLOCK_MONOTONIC \[ns\].
    pub(super) at_ns: u64,
}

/// What was received.
#[derive(Debug, Default)]
pub(super) struct Recording {
    /// States, in the order in which they came.
    pub(super) states: Vec<Received<RobotState>>,
    /// The newest frames of each source; a message each time they were looked for and had changed.
    pub(super) frames: Vec<Received<TaskFrames>>,
}

impl Recording {
    /// Lets joints that rotate without an end go on where their report leaps by whole turns.
    pub(super) fn unwrapped<const N: usize>(mut self, continuous: &ContinuousJoints<N>) -> Self {
        let list = |state: &RobotState| SVector::from_column_slice(&state.position[..N]);
        let mut last: Option<SVector<f64, N>> = None;
        for Received { message, .. } in &mut self.states {
            let reported = list(message);
            let turns = continuous.since(&last.unwrap_or(reported), &reported);
            for i in 0..N {
                message.position[i] = add_turns(reported[i], turns[i]);
            }
            last = Some(list(message));
        }
        self
    }

    /// Records for so long once a first state has come.
    pub(super) fn take(
        state: &Subscriber<RobotState>,
        frames: Option<&Subscriber<TaskFrames>>,
        duration: Duration,
    ) -> Self {
        let mut recording = Self::default();
        let begun = Instant::now();
        let mut first: Option<Instant> = None;
        while first.map_or(begun.elapsed() < PATIENCE, |first| first.elapsed() < duration) {
            let connected =
                state.update_connections() && frames.is_none_or(Subscriber::update_connections);
            while let Some(sample) = state.receive().filter(|_| connected) {
                recording.states.push(Received { message: *sample, at_ns: monotonic_ns() });
                first.get_or_insert_with(Instant::now);
            }
            for _ in 0..FRAME_SOURCES_MAX {
                let Some(sample) = frames.and_then(Subscriber::receive) else { break };
                recording.frames.push(Received { message: *sample, at_ns: monotonic_ns() });
            }
            std::thread::sleep(LOOK);
        }
        recording
    }
}
