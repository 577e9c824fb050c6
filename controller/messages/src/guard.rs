//! The receiving side: which commands a robot obeys, and how it comes to rest when it does not.
//!
//! A [`CommandGuard`] stands between the port of commands and the robot. Each tick it is given the time,
//! the command that has come since the last tick, if one has, and the robot's state, and gives an
//! [`Action`]. Its rules and numbers stand in `COMMANDS.md` of this crate; `sim_bridge/guard.py` has the
//! same ones for Python, and both are tested to give the same verdicts, bit for bit.
//!
//! ```
//! use tprmp_messages::{Action, Bounds, CommandGuard, CommandMode, JointBounds, JointCommand, RobotState};
//!
//! let bounds = Bounds { joints: Some(JointBounds::same(2.0, 20.0, 10.0)), ..Bounds::default() };
//! let mut guard = CommandGuard::new(2, bounds);
//! let state = RobotState { sequence: 7, joint_count: 2, ..Default::default() };
//! assert!(matches!(guard.judge(0, None, &state), Action::Brake(_)));
//! let command = JointCommand {
//!     sequence: 1,
//!     state_sequence: 7,
//!     expiry_ns: u64::MAX, // counts for 100 ms all the same
//!     mode: CommandMode::Track.to_wire(),
//!     joint_count: 2,
//!     ..Default::default()
//! };
//! assert!(matches!(guard.judge(0, Some(&command), &state), Action::Obey(_)));
//! assert!(matches!(guard.judge(100_000_000, None, &state), Action::Brake(_)));
//! println!("{}", guard.last_fault().unwrap()); // command 1 has expired …
//! ```

use core::f64::consts::{PI, TAU};
use core::fmt;

use crate::messages::{
    CommandMode, GripperCommand, JOINT_CAPACITY, JointCommand, Reason, RobotState,
};

/// Numbers of a robot's joints, the first ones in use.
type Joints = [f64; JOINT_CAPACITY];

/// How far a command may be stamped in the future: the receiver may have read its clock before the
/// command came \[ns\].
const AHEAD_MAX_NS: u64 = 1_000_000;
/// Steps are measured against at least this time between two commands \[ns\].
const STEP_MIN_NS: u64 = 1_000_000;
/// How many times a joint's speed and acceleration bounds setpoints may step by. Generous: what is to be
/// found is a jump, and a reference that gives way to a push moves faster than the joint.
const STEP_FACTOR: f64 = 2.0;

/// What the joints can do, for a robot with a position or velocity interface; all positive.
#[derive(Debug, Clone, Copy)]
pub struct JointBounds {
    /// Greatest speed \[rad/s or m/s\].
    pub speed_max: Joints,
    /// Greatest acceleration \[rad/s² or m/s²\].
    pub acceleration_max: Joints,
    /// How hard the robot brakes \[rad/s² or m/s²\].
    pub deceleration: Joints,
    /// Joints that rotate without an end: steps of theirs are measured modulo a turn, as a robot that reports them
    /// within one is commanded.
    pub continuous: [bool; JOINT_CAPACITY],
}

impl JointBounds {
    /// The same for all joints, none of them continuous: speed \[rad/s or m/s\], acceleration and deceleration
    /// \[rad/s² or m/s²\].
    #[must_use]
    pub const fn same(speed_max: f64, acceleration_max: f64, deceleration: f64) -> Self {
        Self {
            speed_max: [speed_max; JOINT_CAPACITY],
            acceleration_max: [acceleration_max; JOINT_CAPACITY],
            deceleration: [deceleration; JOINT_CAPACITY],
            continuous: [false; JOINT_CAPACITY],
        }
    }
}

/// What a command is held against.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// How long a command counts at most, whatever its expiry, after its own time and after it was
    /// received \[ns\].
    pub lifetime_max_ns: u64,
    /// How many states may have been published since the one that a command answers.
    pub state_lag_max: u64,
    /// How far from the measured state obeying may begin, as a time: what a joint moves in it at its
    /// greatest speed, and gains with its greatest acceleration. No less than the controller's
    /// `reference_time_constant_s`: by that much a held arm is behind \[s\].
    pub resume_s: f64,
    /// What the joints can do. `None` for a torque interface: its setpoints are not checked for steps,
    /// and it brakes by torques of its own.
    pub joints: Option<JointBounds>,
}

impl Default for Bounds {
    fn default() -> Self {
        Self { lifetime_max_ns: 100_000_000, state_lag_max: 100, resume_s: 0.1, joints: None }
    }
}

/// Where the joints shall be, and how fast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// \[rad or m\].
    pub position: Joints,
    /// \[rad/s or m/s\].
    pub velocity: Joints,
}

/// What the robot shall do until the next tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// Obey [`CommandGuard::command`]. Between two commands the position goes on with the velocity.
    Obey(Setpoint),
    /// Brake: along the last obeyed velocity to rest, and hold. A torque interface is given where it is
    /// measured to be, and brakes by itself.
    Brake(Setpoint),
}

impl Action {
    /// The setpoint of a position or velocity interface.
    #[must_use]
    pub fn setpoint(&self) -> &Setpoint {
        let (Self::Obey(setpoint) | Self::Brake(setpoint)) = self;
        setpoint
    }
}

macro_rules! causes {
    ($($(#[$meta:meta])* $variant:ident = $name:literal),+ $(,)?) => {
        /// What is wrong with a command. All but the last two make the robot brake.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Cause { $($(#[$meta])* $variant),+ }

        impl Cause {
            /// Every cause, in the order of the checks.
            pub const ALL: &[Self] = &[$(Self::$variant),+];
            /// Its name in reports.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }
        }
    };
}

causes! {
    /// It is for another number of joints.
    JointCount = "joint_count",
    /// Its mode is unknown.
    Mode = "mode",
    /// It is stamped in the future.
    Ahead = "ahead",
    /// It has expired: before it came, or obeyed and without a successor.
    Expired = "expired",
    /// Its sequence number does not grow while the last command counts.
    Sequence = "sequence",
    /// It answers a state that was not published yet.
    StateAhead = "state_ahead",
    /// It answers a state before the last [`Bounds::state_lag_max`].
    StateOld = "state_old",
    /// A number is not finite.
    NotFinite = "not_finite",
    /// Position or velocity step further than the joint's bounds allow.
    Step = "step",
    /// Obeying would begin elsewhere than the robot is.
    Elsewhere = "elsewhere",
    /// The reason is unknown. Only counted.
    Reason = "reason",
    /// The gripper command is unknown: the last one stays. Only counted.
    Gripper = "gripper",
}

/// What is wrong with a command, with the numbers; as text, what leads to the cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandFault {
    /// What is wrong.
    pub cause: Cause,
    /// Sequence number of the command.
    pub sequence: u64,
    /// The joint, counted from 0, where it is one of them.
    pub joint: usize,
    /// What was found; the unit depends on the cause.
    pub found: f64,
    /// What was expected, or the most that may be.
    pub expected: f64,
}

impl fmt::Display for CommandFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cause, sequence, joint, found, expected } = self;
        write!(f, "command {sequence} ")?;
        match cause {
            Cause::JointCount => write!(
                f,
                "is for {found} joints, this robot has {expected}: the controller's configuration is \
                 another robot's"
            ),
            Cause::Mode => {
                write!(f, "has the unknown mode {found}: both sides must be of one version")
            }
            Cause::Ahead => write!(
                f,
                "is stamped {:.3} s in the future: both sides must read CLOCK_MONOTONIC in ns, or both \
                 run in lockstep",
                found * 1e-9
            ),
            Cause::Expired => write!(
                f,
                "has expired {:.3} s ago, and no newer one has come: the controller has ended, is held \
                 up, or its clock is another one",
                found * 1e-9
            ),
            Cause::Sequence => write!(
                f,
                "comes after command {expected}, which still counts: two controllers, or one that was \
                 started again and is obeyed in a moment"
            ),
            Cause::StateAhead => write!(
                f,
                "answers state {found}, the newest is {expected}: it is meant for another publisher, or \
                 for this one before it was started again"
            ),
            Cause::StateOld => write!(
                f,
                "answers a state {found} states before the newest, at most {expected} may be: the \
                 controller receives no states"
            ),
            Cause::NotFinite => write!(f, "has a number of joint {joint} that is not finite"),
            Cause::Step => write!(
                f,
                "steps by {found:.4} at joint {joint} (position or velocity), at most {expected:.4} may \
                 be: the bounds of this robot are tighter than the controller's, or the setpoint jumps"
            ),
            Cause::Elsewhere => write!(
                f,
                "begins {found:.4} from where joint {joint} is measured (position or velocity), at most \
                 {expected:.4} may be: the controller must begin from the measured state"
            ),
            Cause::Reason => write!(f, "has the unknown reason {found}, which changes nothing"),
            Cause::Gripper => {
                write!(f, "has the unknown gripper command {found}: the gripper stays as it is")
            }
        }
    }
}

impl std::error::Error for CommandFault {}

/// How often each cause was found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts([u64; Cause::ALL.len()]);

impl Counts {
    /// How often this one was.
    #[must_use]
    pub fn of(&self, cause: Cause) -> u64 {
        self.0[cause as usize]
    }

    /// Each cause that was found, and how often.
    pub fn found(&self) -> impl Iterator<Item = (Cause, u64)> {
        let all = Cause::ALL.iter().map(|cause| (*cause, self.of(*cause)));
        all.filter(|(_, count)| *count > 0)
    }
}

/// Judges commands for a robot that obeys them: see the [module](self).
///
/// Of fixed size: no allocation. Whatever the bits of a command are, it does not panic.
#[derive(Debug, Clone, Copy)]
pub struct CommandGuard {
    joints: usize,
    bounds: Bounds,
    /// The last command that held, when it came, and until when it counts \[ns\].
    command: JointCommand,
    received_ns: u64,
    valid_until_ns: u64,
    obeys: bool,
    gripper: GripperCommand,
    /// What was last to be done, and when \[ns\]; `None` before the first tick.
    last: Option<(Setpoint, u64)>,
    /// Where braking began, and when \[ns\].
    brake: Option<(Setpoint, u64)>,
    counts: Counts,
    fault: Option<CommandFault>,
}

impl CommandGuard {
    /// Guards a robot of `joints` joints.
    ///
    /// # Panics
    /// When that is none, or more than a message carries, or a bound of a joint is not positive.
    #[must_use]
    pub fn new(joints: usize, bounds: Bounds) -> Self {
        assert!((1..=JOINT_CAPACITY).contains(&joints), "1 to {JOINT_CAPACITY} joints: {joints}");
        if let Some(b) = &bounds.joints {
            let all = [b.speed_max, b.acceleration_max, b.deceleration];
            let positive = all.iter().all(|list| list[..joints].iter().all(|bound| *bound > 0.0));
            assert!(positive, "bounds of joints are positive: {b:?}");
        }
        Self {
            joints,
            bounds,
            command: JointCommand::default(),
            received_ns: 0,
            valid_until_ns: 0,
            obeys: false,
            gripper: GripperCommand::default(),
            last: None,
            brake: None,
            counts: Counts::default(),
            fault: None,
        }
    }

    /// What the robot shall do from `now_ns` \[ns\] until the next tick.
    ///
    /// * `new`    the command that has come since the last tick, if one has; each once
    /// * `state`  the newest published state: its sequence number, positions and velocities count
    ///
    /// All times are on one clock, that of the states. Hot path: no allocation, never panics.
    pub fn judge(&mut self, now_ns: u64, new: Option<&JointCommand>, state: &RobotState) -> Action {
        if let Some(command) = new {
            match self.check(now_ns, command, state) {
                Ok(mode) => self.accept(now_ns, command, mode),
                Err(fault) => self.refuse(fault),
            }
        }
        if self.obeys && now_ns >= self.valid_until_ns {
            let age_ns = now_ns - self.valid_until_ns;
            self.refuse(fault(Cause::Expired, &self.command, age_ns as f64, 0.0));
        }
        let setpoint =
            if self.obeys { self.go_on(now_ns) } else { self.come_to_rest(now_ns, state) };
        self.last = Some((setpoint, now_ns));
        if self.obeys { Action::Obey(setpoint) } else { Action::Brake(setpoint) }
    }

    /// The last command that held: what is obeyed, where [`Action::Obey`] says so.
    #[must_use]
    pub fn command(&self) -> &JointCommand {
        &self.command
    }

    /// What the gripper shall do: what a command that held said last. Braking does not let go.
    #[must_use]
    pub fn gripper(&self) -> GripperCommand {
        self.gripper
    }

    /// How often each cause was found.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// What was found last.
    #[must_use]
    pub fn last_fault(&self) -> Option<&CommandFault> {
        self.fault.as_ref()
    }

    fn note(&mut self, fault: CommandFault) {
        self.counts.0[fault.cause as usize] += 1;
        self.fault = Some(fault);
    }

    fn refuse(&mut self, fault: CommandFault) {
        self.obeys = false;
        self.note(fault);
    }

    fn accept(&mut self, now_ns: u64, command: &JointCommand, mode: CommandMode) {
        self.command = *command;
        self.received_ns = now_ns;
        self.valid_until_ns = self.valid_until_ns(now_ns, command);
        self.obeys = mode != CommandMode::Stop;
        if Reason::from_wire(command.reason).is_none() {
            self.note(fault(Cause::Reason, command, command.reason.into(), 0.0));
        }
        match GripperCommand::from_wire(command.gripper_command) {
            Some(gripper) => self.gripper = gripper,
            None => self.note(fault(Cause::Gripper, command, command.gripper_command.into(), 0.0)),
        }
    }

    fn valid_until_ns(&self, received_ns: u64, command: &JointCommand) -> u64 {
        let most = command.time_ns.min(received_ns).saturating_add(self.bounds.lifetime_max_ns);
        command.expiry_ns.min(most)
    }

    fn check(
        &self,
        now_ns: u64,
        command: &JointCommand,
        state: &RobotState,
    ) -> Result<CommandMode, CommandFault> {
        let failed = |cause, found: f64, expected: f64| Err(fault(cause, command, found, expected));
        if command.joint_count as usize != self.joints {
            return failed(Cause::JointCount, command.joint_count.into(), self.joints as f64);
        }
        let Some(mode) = CommandMode::from_wire(command.mode) else {
            return failed(Cause::Mode, command.mode.into(), 0.0);
        };
        let ahead_ns = command.time_ns.saturating_sub(now_ns);
        if ahead_ns > AHEAD_MAX_NS {
            return failed(Cause::Ahead, ahead_ns as f64, AHEAD_MAX_NS as f64);
        }
        let valid_until_ns = self.valid_until_ns(now_ns, command);
        if now_ns >= valid_until_ns {
            return failed(Cause::Expired, (now_ns - valid_until_ns) as f64, 0.0);
        }
        if command.sequence <= self.command.sequence && now_ns < self.valid_until_ns {
            return failed(Cause::Sequence, command.sequence as f64, self.command.sequence as f64);
        }
        if mode == CommandMode::Stop {
            // It asks for nothing that could be wrong.
            return Ok(mode);
        }
        let (answered, newest) = (command.state_sequence, state.sequence);
        if answered > newest {
            return failed(Cause::StateAhead, answered as f64, newest as f64);
        }
        if answered == 0 || newest - answered > self.bounds.state_lag_max {
            let most = self.bounds.state_lag_max as f64;
            return failed(Cause::StateOld, (newest - answered) as f64, most);
        }
        self.check_numbers(command)?;
        self.check_step(command, state)?;
        Ok(mode)
    }

    fn check_numbers(&self, command: &JointCommand) -> Result<(), CommandFault> {
        let c = command;
        for list in [&c.position, &c.velocity, &c.acceleration, &c.torque, &c.gravity_torque] {
            for (joint, number) in list[..self.joints].iter().enumerate() {
                if !number.is_finite() {
                    return Err(CommandFault { joint, ..fault(Cause::NotFinite, c, *number, 0.0) });
                }
            }
        }
        Ok(())
    }

    /// Holds position and velocity against the last command where that is obeyed, against the measured
    /// state otherwise.
    fn check_step(&self, command: &JointCommand, state: &RobotState) -> Result<(), CommandFault> {
        let Some(bounds) = &self.bounds.joints else { return Ok(()) };
        let (cause, position, velocity, reach_s) = if self.obeys {
            let since_ns = command.time_ns.saturating_sub(self.command.time_ns);
            let since_ns = since_ns.min(self.bounds.lifetime_max_ns).max(STEP_MIN_NS);
            let reach_s = STEP_FACTOR * (since_ns as f64 * 1e-9);
            (Cause::Step, &self.command.position, &self.command.velocity, reach_s)
        } else {
            (Cause::Elsewhere, &state.position, &state.velocity, self.bounds.resume_s)
        };
        for joint in 0..self.joints {
            let speed = bounds.speed_max[joint];
            let (p, v) = (command.position[joint], command.velocity[joint]);
            let mut step = (p - position[joint]).abs();
            if bounds.continuous[joint] && step > PI {
                step = (step - TAU).abs();
            }
            for (cause, found, most) in [
                (cause, step, speed * reach_s),
                (cause, (v - velocity[joint]).abs(), bounds.acceleration_max[joint] * reach_s),
                (Cause::Step, v.abs(), STEP_FACTOR * speed),
            ] {
                // So that what is measured as not a number is refused, too.
                let within = found <= most;
                if !within {
                    return Err(CommandFault { joint, ..fault(cause, command, found, most) });
                }
            }
        }
        Ok(())
    }

    /// The command, carried on with its velocity since it came.
    fn go_on(&mut self, now_ns: u64) -> Setpoint {
        self.brake = None;
        let Setpoint { mut position, velocity } =
            Setpoint { position: self.command.position, velocity: self.command.velocity };
        if self.bounds.joints.is_some() {
            let since_s = now_ns.saturating_sub(self.received_ns) as f64 * 1e-9;
            for joint in 0..self.joints {
                position[joint] += velocity[joint] * since_s;
            }
        }
        Setpoint { position, velocity }
    }

    /// All joints arrive at rest together, the hardest-braked one with its deceleration: from p₀ and v₀
    /// for the time T = max |v₀ᵢ|/dᵢ, p(t) = p₀ + v₀ (t − t²/2T) and v(t) = v₀ (1 − t/T).
    fn come_to_rest(&mut self, now_ns: u64, state: &RobotState) -> Setpoint {
        let measured = Setpoint { position: state.position, velocity: state.velocity };
        let Some(bounds) = &self.bounds.joints else {
            return Setpoint { velocity: [0.0; JOINT_CAPACITY], ..measured };
        };
        let begin = self.last.unwrap_or((measured, now_ns));
        let (from, since_ns) = *self.brake.get_or_insert(begin);
        let time_s = now_ns.saturating_sub(since_ns) as f64 * 1e-9;
        let mut duration_s = 0.0;
        for joint in 0..self.joints {
            let needed_s = from.velocity[joint].abs() / bounds.deceleration[joint];
            if needed_s > duration_s {
                duration_s = needed_s;
            }
        }
        let (path_s, fraction) = if time_s < duration_s {
            (time_s - time_s * time_s / (2.0 * duration_s), 1.0 - time_s / duration_s)
        } else {
            (0.5 * duration_s, 0.0)
        };
        let mut to = Setpoint { position: from.position, velocity: [0.0; JOINT_CAPACITY] };
        for joint in 0..self.joints {
            to.position[joint] += from.velocity[joint] * path_s;
            to.velocity[joint] = from.velocity[joint] * fraction;
        }
        to
    }
}

fn fault(cause: Cause, command: &JointCommand, found: f64, expected: f64) -> CommandFault {
    CommandFault { cause, sequence: command.sequence, joint: 0, found, expected }
}
