//! What each reason says to people.

use tprmp_messages::Reason;

/// Every reason but [`Reason::None`], in the order of their numbers.
const SENTENCES: &[(Reason, &str)] = &[
    (Reason::StateStale, "no robot state arrives any more"),
    (Reason::SequenceWentBack, "the state's sequence number went back"),
    (Reason::StateNotFinite, "the robot state holds a number that is not finite"),
    (Reason::JointCount, "the robot state has another number of joints than the robot"),
    (Reason::FrameMissing, "a frame that the skill needs is missing or marked invalid"),
    (
        Reason::FrameNotFinite,
        "a frame or an obstacle holds a number that is not finite, or far too large",
    ),
    (Reason::QuaternionNotUnit, "a frame's quaternion is not of unit length"),
    (
        Reason::ObstacleUnknown,
        "an obstacle is of a kind or mark that this controller does not know",
    ),
    (Reason::FramesStale, "no new frames arrive"),
    (Reason::ResolveFailed, "the policy could not be resolved here"),
    (Reason::CommandNotFinite, "the policy's command was not finite"),
    (Reason::StopRequested, "asked to stop"),
    (Reason::JointLimit, "a joint is outside its position limits"),
    (Reason::Overrun, "too many periods were missed in a row"),
    (
        Reason::StateUnbelievable,
        "a measured speed, or a jump of a position or velocity, is not believable",
    ),
    (Reason::GripperUnknown, "the gripper reports a state that this controller does not know"),
    (Reason::Blocked, "the arm stands still before an obstacle or before itself"),
    (Reason::Unreachable, "the arm stands still short of the goal"),
    (Reason::StateUnconfirmed, "a first robot state has arrived, those that follow confirm it"),
    (Reason::SequenceStuck, "robot states arrive, but their `sequence` does not grow"),
    (Reason::StateTimeStuck, "robot states arrive, but their `time_ns` does not grow"),
    (
        Reason::StateClock,
        "robot states arrive, but their `time_ns` is not about now on CLOCK_MONOTONIC: another \
         clock, another unit, late by more than loop.state_age_max_ns, or simulated time, for which \
         both sides need --lockstep",
    ),
    (
        Reason::VelocityUnbelievable,
        "the robot's positions do not change as its velocities say: a velocity that is not \
         measured, of another unit or sign, or joints in another order",
    ),
    (Reason::StatesLost, "too many robot states in a row are missing, by their `sequence`"),
    (
        Reason::CommandExpired,
        "the loop was held up for longer than a command lives, so the robot has braked on its own",
    ),
    (
        Reason::TwoSources,
        "the state's sequence number went back twice within a second: two sources publish states, \
         or one is started again and again",
    ),
    (Reason::ProtectiveStop, "the robot reports a protective stop"),
    (Reason::EmergencyStop, "the robot reports an emergency stop"),
    (Reason::HandGuiding, "the robot reports that it is guided by hand"),
    (Reason::RobotFault, "the robot reports a fault, or a `robot_mode` that there is not"),
    (Reason::SafetyStop, "the robot's safety system does not permit motion"),
    (Reason::StartNotRequested, "waiting for `controller ctl start`"),
    (Reason::HoldRequested, "a hold was asked for; `controller ctl start` goes on"),
    (
        Reason::EndedUnexpectedly,
        "the controller before this one ended without a stop, what it was doing is not known",
    ),
    (Reason::ArmElsewhere, "the arm is not yet at rest where its last commands ended"),
    (
        Reason::GripperHolds,
        "the gripper holds something that this controller did not grip; take it out",
    ),
    (Reason::JointOrder, "the robot state is of other joints, or of joints in another order"),
    (
        Reason::PositionsFrozen,
        "the arm is commanded to move, states arrive, and no position changes",
    ),
    (
        Reason::PublisherNotInLockstep,
        "states arrive that wait for no command, and this controller runs in lockstep: start both sides \
         with --lockstep, or both without",
    ),
    (
        Reason::FrameCount,
        "more frames are published than a message carries, or by more sources than there may be",
    ),
    (Reason::FrameFar, "a frame is farther from the base than any arm reaches"),
    (
        Reason::QuaternionOrder,
        "the start frame is where the tool is, with its quaternion in another order",
    ),
    (
        Reason::ObstacleCount,
        "more obstacles are published than a message carries, by one source or by all together",
    ),
    (Reason::ObstacleSize, "a size of an obstacle is zero or negative, or a radius beyond 20 m"),
    (Reason::ObstacleQuaternion, "an obstacle's quaternion is not of unit length"),
    (
        Reason::GripperNone,
        "the task grips, and the robot state says that there is no gripper: set `gripper_state` to open or \
         holding",
    ),
    (Reason::GripperAwaited, "at the goal, waiting for the gripper to hold"),
    (Reason::FrameTwice, "two sources publish the same frame, or have the same name"),
    (Reason::JointReturning, "a joint a little outside its position limits is moved back, slowly"),
    (Reason::StartElsewhere, "the start frame is published, and the tool that starts is elsewhere"),
];

/// The sentence of a reason; `None` where the policy is followed and makes progress.
#[must_use]
pub fn sentence(reason: Reason) -> Option<&'static str> {
    SENTENCES.iter().find(|(of, _)| *of == reason).map(|(_, text)| *text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_has_a_sentence_of_its_own() {
        let reasons: Vec<_> = SENTENCES.iter().map(|(reason, _)| *reason).collect();
        assert_eq!(reasons, Reason::ALL[1..]);
        let mut texts: Vec<_> = SENTENCES.iter().map(|(_, text)| *text).collect();
        texts.sort_unstable();
        texts.dedup();
        assert_eq!(texts.len(), reasons.len());
    }
}
