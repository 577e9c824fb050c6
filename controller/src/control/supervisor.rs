//! The life cycle: which faults pass, which have to be looked at by a person, and what the arm does meanwhile.

use tprmp_messages::{LifeCycle, Reason};
use tprmp_model::controller_config::{Fallback, Fallbacks, Start, Supervision};

use crate::control::requests::Requests;

/// What a reason is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The policy is followed.
    Following,
    /// The robot's state, or the robot itself.
    State,
    /// Frames and obstacles.
    Frames,
    /// The loop, the policy, or the gripper.
    Controller,
    /// Somebody's request.
    Request,
}

/// What a reason is about.
#[must_use]
pub fn kind(reason: Reason) -> Kind {
    match reason {
        Reason::None | Reason::Blocked | Reason::Unreachable | Reason::GripperAwaited => {
            Kind::Following
        }
        Reason::StateStale
        | Reason::SequenceWentBack
        | Reason::StateNotFinite
        | Reason::JointCount
        | Reason::JointLimit
        | Reason::JointReturning
        | Reason::StateUnbelievable
        | Reason::StateUnconfirmed
        | Reason::SequenceStuck
        | Reason::StateTimeStuck
        | Reason::StateClock
        | Reason::VelocityUnbelievable
        | Reason::StatesLost
        | Reason::CommandExpired
        | Reason::TwoSources
        | Reason::ProtectiveStop
        | Reason::EmergencyStop
        | Reason::HandGuiding
        | Reason::RobotFault
        | Reason::SafetyStop
        | Reason::ArmElsewhere
        | Reason::JointOrder
        | Reason::PositionsFrozen
        | Reason::PublisherNotInLockstep => Kind::State,
        Reason::FrameMissing
        | Reason::FrameNotFinite
        | Reason::QuaternionNotUnit
        | Reason::ObstacleUnknown
        | Reason::FramesStale
        | Reason::FrameCount
        | Reason::FrameFar
        | Reason::QuaternionOrder
        | Reason::StartElsewhere
        | Reason::ObstacleCount
        | Reason::ObstacleSize
        | Reason::ObstacleQuaternion
        | Reason::FrameTwice => Kind::Frames,
        Reason::ResolveFailed
        | Reason::CommandNotFinite
        | Reason::Overrun
        | Reason::GripperUnknown
        | Reason::GripperHolds
        | Reason::GripperNone
        | Reason::EndedUnexpectedly => Kind::Controller,
        Reason::StopRequested | Reason::StartNotRequested | Reason::HoldRequested => Kind::Request,
    }
}

/// The reason of this name.
#[must_use]
pub fn named(name: &str) -> Option<Reason> {
    Reason::ALL.iter().copied().find(|reason| format!("{reason:?}") == name)
}

/// Whether a reason can latch: what follows the policy, or was asked for, cannot.
#[must_use]
pub fn can_latch(reason: Reason) -> bool {
    !matches!(kind(reason), Kind::Following | Kind::Request)
}

/// Decides whether the arm may move.
#[derive(Debug)]
pub struct Supervisor {
    latching: [bool; Reason::ALL.len()],
    fallback: Fallbacks,
    /// A start was asked for, or need not be.
    started: bool,
    held: bool,
    latched: Option<Reason>,
}

impl Supervisor {
    /// A controller that begins.
    #[must_use]
    pub fn new(config: &Supervision) -> Self {
        let mut latching = [false; Reason::ALL.len()];
        for reason in config.latching.iter().filter_map(|name| named(name)) {
            latching[reason.to_wire() as usize] = true;
        }
        Self {
            latching,
            fallback: config.fallback.clone(),
            started: config.start == Start::Automatic,
            held: false,
            latched: None,
        }
    }

    /// Takes what was asked for since the last tick; whether somebody has looked, and the arm may go on.
    pub fn take(&mut self, requests: &Requests) -> bool {
        let reset = requests.take_reset();
        if reset {
            self.latched = None;
        }
        let go = requests.take_go();
        match go {
            Some(true) => (self.started, self.held) = (true, false),
            Some(false) => self.held = true,
            None => {}
        }
        reset || go == Some(true)
    }

    /// The policy is not followed for this reason.
    pub fn fail(&mut self, reason: Reason) {
        if self.latching[reason.to_wire() as usize] {
            self.latched.get_or_insert(reason);
        }
    }

    /// Whether nobody has looked yet at the end of the controller before this one.
    #[must_use]
    pub fn follows_a_crash(&self) -> bool {
        self.latched == Some(Reason::EndedUnexpectedly)
    }

    /// The fault that somebody has to look at.
    ///
    /// # Errors
    /// With its reason where there is one.
    pub fn check_fault(&self) -> Result<(), Reason> {
        self.latched.map_or(Ok(()), Err)
    }

    /// Whether somebody has to ask for a start; asked last, when all else is well.
    ///
    /// # Errors
    /// When that is so.
    pub fn check_request(&self) -> Result<(), Reason> {
        match (self.held, self.started) {
            (true, _) => Err(Reason::HoldRequested),
            (false, false) => Err(Reason::StartNotRequested),
            (false, true) => Ok(()),
        }
    }

    /// What the arm does at rest for this reason.
    #[must_use]
    pub fn fallback(&self, reason: Reason) -> &Fallback {
        match kind(reason) {
            Kind::Frames => &self.fallback.frames,
            Kind::Controller => &self.fallback.controller,
            Kind::Request if reason != Reason::StopRequested => &self.fallback.request,
            _ => &Fallback::Hold,
        }
    }

    /// The state of the life cycle, from the reason of a tick, where the task stands, and whether anything
    /// was commanded yet.
    #[must_use]
    pub fn life_cycle(&self, reason: Reason, task: LifeCycle, is_new: bool) -> LifeCycle {
        match reason {
            Reason::StopRequested => LifeCycle::Stopping,
            _ if kind(reason) == Kind::Following => task,
            _ if self.latched.is_some() => LifeCycle::Fault,
            Reason::StartNotRequested => LifeCycle::Ready,
            _ if is_new => LifeCycle::Waiting,
            _ => LifeCycle::Holding,
        }
    }
}
