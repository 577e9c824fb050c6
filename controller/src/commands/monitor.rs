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
    let mut printed_mode = None;
    while !closed.load(Ordering::Relaxed) {
        let now = status.read();
        looks = if last == Some(now) { looks + 1 } else { 0 };
        last = Some(now);
        if looks >= LOOKS_MIN && printed != Some(now) {
            printed = Some(now);
            errln!("controller: {}", describe(now.0, now.1));
        }
        let mode = status.mode();
        if let Some(report) = mode.filter(|_| mode != printed_mode) {
            printed_mode = mode;
            errln!("controller: {report}");
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
        LifeCycle::Ready => "ready",
        LifeCycle::Fault => "holding still until `controller ctl reset`",
    };
    let why = match reason {
        Reason::None => return state.into(),
        Reason::StateStale => "no robot state arrives any more",
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
        Reason::StateUnbelievable => {
            "a measured speed, or a jump of a position or velocity, is not believable"
        }
        Reason::StateUnconfirmed => "a first robot state has arrived, those that follow confirm it",
        Reason::SequenceStuck => "robot states arrive, but their `sequence` does not grow",
        Reason::StateTimeStuck => "robot states arrive, but their `time_ns` does not grow",
        Reason::StateClock => {
            "robot states arrive, but their `time_ns` is not about now on CLOCK_MONOTONIC: another \
             clock, another unit, late by more than loop.state_age_max_ns, or simulated time, for which \
             both sides need --lockstep"
        }
        Reason::VelocityUnbelievable => {
            "the robot's positions do not change as its velocities say: a velocity that is not \
             measured, of another unit or sign, or joints in another order"
        }
        Reason::StatesLost => "too many robot states in a row are missing, by their `sequence`",
        Reason::CommandExpired => {
            "the loop was held up for longer than a command lives, so the robot has braked on its own"
        }
        Reason::TwoSources => {
            "the state's sequence number went back twice within a second: two sources publish states, \
             or one is started again and again"
        }
        Reason::ProtectiveStop => "the robot reports a protective stop",
        Reason::EmergencyStop => "the robot reports an emergency stop",
        Reason::HandGuiding => "the robot reports that it is guided by hand",
        Reason::RobotFault => "the robot reports a fault, or a `robot_mode` that there is not",
        Reason::SafetyStop => "the robot's safety system does not permit motion",
        Reason::StartNotRequested => "waiting for `controller ctl start`",
        Reason::HoldRequested => "a hold was asked for; `controller ctl start` goes on",
        Reason::EndedUnexpectedly => {
            "the controller before this one ended without a stop, what it was doing is not known"
        }
        Reason::GripperHolds => {
            "the gripper holds something that this controller did not grip; take it out"
        }
        Reason::ArmElsewhere => "the arm is not yet at rest where its last commands ended",
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
