//! Small motions of a robot by the commands of a controller, with everything that was measured meanwhile.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::SVector;
use tprmp_messages::{
    CommandMode, ControllerPorts, JointCommand, Reason, RobotMode, RobotState, STATE_BUFFER,
};
use tprmp_model::controller_config::ControllerConfig;
use tprmp_robot::{Chain, JointKind};

use crate::inputs::estimator::JointState;
use crate::inputs::turns::{ContinuousJoints, add_turns};
use crate::motion::generator::MotionGenerator;
use crate::motion::limits::JointLimits;
use crate::motion::profile::JointMotion;
use crate::timing::realtime::{monotonic_ns, sleep_until};

/// How far a joint is moved: 2° …
const AMPLITUDE_RAD: f64 = 2.0 * core::f64::consts::PI / 180.0;
/// … or so much \[m\].
const AMPLITUDE_M: f64 = 0.01;
/// How fast a joint is led to where it shall be \[1/s\].
const RATE_1_S: f64 = 25.0;
/// A joint that is farther than this multiple of the amplitude from where it shall be ends the motion.
const ASTRAY: f64 = 0.75;
/// A joint that is so fast ends the motion \[rad/s or m/s\].
const SPEED_MAX: f64 = 1.0;
/// A state that is older than this ends the motion \[ns\].
const STATE_AGE_MAX_NS: u64 = 1_000_000_000;

/// What was measured at a tick, and commanded.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment<const N: usize> {
    /// Stamp of the state \[ns\].
    pub(super) time_ns: u64,
    /// Measured \[rad or m\].
    pub(super) position: SVector<f64, N>,
    /// Measured \[rad/s or m/s\].
    pub(super) velocity: SVector<f64, N>,
    /// Measured \[N m or N\].
    pub(super) torque: SVector<f64, N>,
    /// Commanded, without gravity \[N m or N\].
    pub(super) commanded_torque: SVector<f64, N>,
}

impl<const N: usize> Moment<N> {
    /// What a state says, under commanded torques without gravity \[N m or N\].
    pub(super) fn of(state: &RobotState, commanded_torque: SVector<f64, N>) -> Self {
        let list = |values: &[f64; 8]| SVector::from_column_slice(&values[..N]);
        Self {
            time_ns: state.time_ns,
            position: list(&state.position),
            velocity: list(&state.velocity),
            torque: list(&state.torque),
            commanded_torque,
        }
    }
}

/// Why a motion was ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Broken {
    /// States no longer arrive.
    Stale,
    /// A joint is elsewhere than it shall be, by so much \[rad or m\].
    Astray(usize, f64),
    /// A joint says that it is so fast \[rad/s or m/s\].
    Fast(usize, f64),
    /// The arm could not be held before the motion.
    NotHeld,
    /// The robot says that it does not permit motion: `robot_mode` and `safety_stop`.
    Refused(u32, u32),
    /// A state is refused for what is in it.
    Faulty(Reason),
    /// A signal has come.
    Interrupted,
}

/// A motion of one joint on a path without a jerk at its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path {
    /// Which joint.
    pub(super) joint: usize,
    /// From and to, relative to where the arm was found \[rad or m\].
    pub(super) offsets: [f64; 2],
    /// How long it takes \[s\].
    pub(super) duration_s: f64,
}

impl Path {
    /// Offset, velocity and acceleration after a time \[s\].
    fn at(&self, time_s: f64) -> [f64; 3] {
        let s = (time_s / self.duration_s).clamp(0.0, 1.0);
        let [from, to] = self.offsets;
        let (length, t) = (to - from, self.duration_s);
        [
            from + length * s * s * s * (10.0 + s * (6.0 * s - 15.0)),
            length / t * 30.0 * s * s * (1.0 - s) * (1.0 - s),
            length / (t * t) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
        ]
    }
}

/// How far joint `i` is moved \[rad or m\], to either side.
pub(super) fn amplitude<const N: usize>(chain: &Chain<N>, i: usize) -> f64 {
    match chain.joint_kind(i) {
        Some(JointKind::Prismatic) => AMPLITUDE_M,
        _ => AMPLITUDE_RAD,
    }
}

/// Moves the arm.
#[derive(Debug)]
pub(super) struct Mover<'a, const N: usize> {
    ports: ControllerPorts,
    chain: &'a Chain<N>,
    motion: MotionGenerator<N>,
    period_ns: u64,
    lifetime_ns: u64,
    due_ns: u64,
    command: JointCommand,
    state: Option<(RobotState, u64)>,
    /// Which joints rotate without an end, and by how many turns they went on beyond what is reported.
    continuous: ContinuousJoints<N>,
    turns: SVector<f64, N>,
    last: Option<JointMotion<N>>,
    /// Where the arm was found.
    home: Option<SVector<f64, N>>,
    /// Whether a signal has come.
    stop: Arc<AtomicBool>,
    /// Since the last [`Mover::forget`].
    pub(super) trace: Vec<Moment<N>>,
}

impl<'a, const N: usize> Mover<'a, N> {
    /// An arm that was not yet moved.
    pub(super) fn new(
        ports: ControllerPorts,
        chain: &'a Chain<N>,
        config: &ControllerConfig,
        stop: &Arc<AtomicBool>,
    ) -> Self {
        let limits = JointLimits::new(chain, &config.robot);
        Self {
            ports,
            chain,
            motion: MotionGenerator::new(limits, config),
            period_ns: config.cycle.period_ns,
            lifetime_ns: config.cycle.command_lifetime_ns,
            due_ns: monotonic_ns(),
            command: JointCommand { joint_count: N as u32, ..Default::default() },
            state: None,
            continuous: ContinuousJoints::of(chain),
            turns: SVector::zeros(),
            last: None,
            home: None,
            stop: Arc::clone(stop),
            trace: Vec::new(),
        }
    }

    /// How far joint `i` is moved \[rad or m\]: towards the middle of its range.
    #[must_use]
    pub(super) fn amplitude(&self, i: usize) -> f64 {
        let size = amplitude(self.chain, i);
        let [lower, upper] = &self.motion.limits().position_end;
        let at = self.home.map_or(0.0, |home| home[i]);
        if at > 0.5 * (lower[i] + upper[i]) { -size } else { size }
    }

    /// Where the newest state says that the joints are, relative to where they were found \[rad or m\].
    #[must_use]
    pub(super) fn offset(&self) -> Option<SVector<f64, N>> {
        Some(self.measured()?.position - self.home?)
    }

    /// Forgets what was measured so far.
    pub(super) fn forget(&mut self) {
        self.trace.clear();
    }

    fn measured(&self) -> Option<JointState<N>> {
        let (state, _) = self.state.as_ref()?;
        let [position, velocity] =
            [state.position, state.velocity].map(|values| SVector::from_column_slice(&values[..N]));
        Some(JointState { position, velocity })
    }

    /// Waits for the next tick and receives what has come.
    fn look(&mut self) {
        self.due_ns = (self.due_ns + self.period_ns).max(monotonic_ns());
        sleep_until(self.due_ns);
        let _ = self.ports.update_connections();
        for _ in 0..STATE_BUFFER {
            let Some(sample) = self.ports.state.receive() else { break };
            let mut state = *sample;
            let reported = SVector::from_column_slice(&state.position[..N]);
            let before = self.measured().map_or(reported, |before| before.position);
            self.turns = self.continuous.since(&before, &reported);
            for i in 0..N {
                state.position[i] = add_turns(reported[i], self.turns[i]);
            }
            let commanded = SVector::from_column_slice(&self.command.torque[..N]);
            self.trace.push(Moment::of(&state, commanded));
            self.state = Some((state, monotonic_ns()));
        }
    }

    fn publish(&mut self, mode: CommandMode, reason: Reason) {
        let now_ns = monotonic_ns();
        let command = &mut self.command;
        command.sequence += 1;
        command.state_sequence = self.state.map_or(0, |(state, _)| state.sequence);
        (command.time_ns, command.expiry_ns) = (now_ns, now_ns + self.lifetime_ns);
        (command.mode, command.reason) = (mode.to_wire(), reason.to_wire());
        // In the turn in which the robot counts.
        let mut command = *command;
        for i in 0..N {
            command.position[i] = add_turns(command.position[i], -self.turns[i]);
        }
        let _ = self.ports.command.publish(command);
    }

    fn set(&mut self, setpoint: &crate::motion::generator::Setpoint<N>) {
        self.last = Some(setpoint.motion);
        setpoint.write(&mut self.command);
    }

    fn period_s(&self) -> f64 {
        self.period_ns as f64 * 1e-9
    }

    /// Brings the arm to rest where it is and holds it for so long \[s\].
    ///
    /// # Errors
    /// Where it cannot be held.
    pub(super) fn hold(&mut self, duration_s: f64) -> Result<(), Broken> {
        let begun_ns = monotonic_ns();
        let mut held_ns = 0;
        while monotonic_ns() - begun_ns < 5_000_000_000 {
            if self.stop.load(Ordering::Relaxed) {
                return Err(Broken::Interrupted);
            }
            self.look();
            let measured = self.measured();
            let (mode, held) = match self.motion.brake(self.chain, measured, false, self.period_s())
            {
                Some((setpoint, mode)) => {
                    self.set(&setpoint);
                    (mode, measured.is_some_and(|state| self.motion.may_follow(&state)))
                }
                None => (CommandMode::Stop, false),
            };
            self.publish(mode, Reason::HoldRequested);
            held_ns = if held { held_ns + self.period_ns } else { 0 };
            if held_ns as f64 * 1e-9 >= duration_s {
                let position = measured.map(|state| state.position);
                self.home = self.home.or(position);
                return Ok(());
            }
        }
        Err(Broken::NotHeld)
    }

    /// Moves along a path for so long \[s\] from its beginning, under commands of this mode, and looks after
    /// the arm where that mode is to be obeyed.
    ///
    /// # Errors
    /// Why it was ended.
    pub(super) fn go(
        &mut self,
        path: &Path,
        from_s: f64,
        to_s: f64,
        mode: CommandMode,
    ) -> Result<(), Broken> {
        let mut time_s = from_s;
        while time_s < to_s {
            self.look();
            let measured = self.measured().ok_or(Broken::Stale)?;
            let [offset, velocity, acceleration] = path.at(time_s);
            if mode == CommandMode::Track {
                self.look_after(path, offset, &measured)?;
            }
            let home = self.home.unwrap_or(measured.position);
            let reference = self.last.unwrap_or(JointMotion::at_rest(measured.position));
            let mut wanted = (home - reference.position) * (RATE_1_S * RATE_1_S)
                - reference.velocity * (2.0 * RATE_1_S);
            wanted[path.joint] +=
                offset * RATE_1_S * RATE_1_S + velocity * 2.0 * RATE_1_S + acceleration;
            let dt = self.period_s();
            let follow = self.motion.follow(self.chain, &measured, &wanted, 0.0, dt);
            if let Ok(setpoint) = follow {
                self.set(&setpoint);
            }
            self.publish(mode, Reason::None);
            time_s += dt;
        }
        Ok(())
    }

    fn look_after(&self, path: &Path, offset: f64, measured: &JointState<N>) -> Result<(), Broken> {
        let (state, received_ns) = self.state.as_ref().ok_or(Broken::Stale)?;
        if self.stop.load(Ordering::Relaxed) {
            return Err(Broken::Interrupted);
        }
        if (state.robot_mode, state.safety_stop) != (RobotMode::Running.to_wire(), 0) {
            return Err(Broken::Refused(state.robot_mode, state.safety_stop));
        }
        state.check(N).map_err(Broken::Faulty)?;
        if monotonic_ns().saturating_sub(*received_ns) > STATE_AGE_MAX_NS {
            return Err(Broken::Stale);
        }
        let home = self.home.unwrap_or(measured.position);
        for i in 0..N {
            let shall = if i == path.joint { home[i] + offset } else { home[i] };
            let astray = measured.position[i] - shall;
            if astray.abs() > ASTRAY * self.amplitude(i).abs() {
                return Err(Broken::Astray(i, measured.position[i] - home[i]));
            }
            if measured.velocity[i].abs() > SPEED_MAX {
                return Err(Broken::Fast(i, measured.velocity[i]));
            }
        }
        Ok(())
    }

    /// Publishes nothing for so long \[s\], and watches.
    pub(super) fn watch(&mut self, duration_s: f64) {
        let ticks = (duration_s / self.period_s()) as u64;
        for _ in 0..ticks {
            self.look();
        }
        self.motion.robot_brakes();
    }

    /// Tells the robot that the controller leaves.
    pub(super) fn leave(mut self) {
        (self.command.velocity, self.command.acceleration) = Default::default();
        for _ in 0..20 {
            self.look();
            self.publish(CommandMode::Stop, Reason::StopRequested);
        }
    }
}
