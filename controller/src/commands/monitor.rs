//! Shows the user what the loop is doing, from a thread of its own: the loop only stores numbers.

use core::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use tprmp_files::errln;
use tprmp_messages::{LifeCycle, Reason};

use crate::telemetry::SharedStatus;

/// How often the monitor looks.
const PERIOD: Duration = Duration::from_millis(100);
/// A reason shorter than this many looks is not worth a line: 0.3 s.
const LOOKS_MIN: u32 = 3;

/// A thread that prints every change that lasts.
#[derive(Debug)]
pub struct Monitor {
    closed: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Monitor {
    /// Starts the thread. It inherits nothing of the loop's priority when it is started before
    /// that is set.
    #[must_use]
    pub fn start(status: Arc<SharedStatus>) -> Self {
        let closed = Arc::new(AtomicBool::new(false));
        let watched = Arc::clone(&closed);
        Self { closed, thread: Some(thread::spawn(move || watch(&status, &watched))) }
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.closed.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn watch(status: &SharedStatus, closed: &AtomicBool) {
    let (mut printed, mut last, mut looks) = (None, None, 0);
    while !closed.load(Ordering::Relaxed) {
        let now = status.read();
        looks = if last == Some(now) { looks + 1 } else { 0 };
        last = Some(now);
        if looks >= LOOKS_MIN && printed != Some(now) {
            printed = Some(now);
            errln!("controller: {}", describe(now.0, now.1));
        }
        thread::sleep(PERIOD);
    }
}

/// A sentence for people.
#[must_use]
pub fn describe(life_cycle: LifeCycle, reason: Reason) -> String {
    let state = match life_cycle {
        LifeCycle::Waiting => "waiting",
        LifeCycle::Running => "following the skill",
        LifeCycle::Lifting => "lifting",
        LifeCycle::Done => "done",
        LifeCycle::Holding => "holding still",
        LifeCycle::Stopping => "stopping",
    };
    let why = match reason {
        Reason::None => return state.into(),
        Reason::StateStale => "no new robot state arrives; in lockstep, both sides need --lockstep",
        Reason::SequenceWentBack => "the state's sequence number went back",
        Reason::StateNotFinite => "the robot state holds a number that is not finite",
        Reason::JointCount => "the robot state has another number of joints than the robot",
        Reason::FrameMissing => "a frame that the skill needs is missing or marked invalid",
        Reason::FrameNotFinite => "a frame or an obstacle holds a number that is not finite",
        Reason::QuaternionNotUnit => "a frame's quaternion is not of unit length",
        Reason::ObstacleUnknown => "an obstacle is of a kind that this controller does not know",
        Reason::FramesStale => "no new frames arrive",
        Reason::ResolveFailed => "the policy could not be resolved here",
        Reason::CommandNotFinite => "the policy's command was not finite",
        Reason::StopRequested => "asked to stop",
        Reason::JointLimit => "a joint is outside its position limits",
        Reason::Overrun => "too many periods were missed in a row",
        Reason::StateUnbelievable => "a measured speed or a jump of a position is not believable",
        Reason::GripperUnknown => "the gripper reports a state that this controller does not know",
        Reason::Blocked => "the arm stands still before an obstacle or before itself",
        Reason::Unreachable => "the arm stands still short of the goal",
    };
    format!("{state}: {why}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_has_a_sentence_of_its_own() {
        let mut sentences: Vec<_> =
            Reason::ALL.iter().map(|r| describe(LifeCycle::Holding, *r)).collect();
        sentences.sort();
        sentences.dedup();
        assert_eq!(sentences.len(), Reason::ALL.len());
    }
}
