//! Whether a state publisher keeps the contract: looked at without a motion first, then, where that is asked for,
//! in small motions. The words of [`table::Check`] are the lines.

mod motions;
mod mover;
mod recording;
mod scene;
mod states;
pub mod table;

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use nalgebra::SVector;
use rustix::process::{Signal, getpid, kill_process};
use tprmp_messages::{CommandMode, Instance, NAME_CAPACITY, RobotState, ServiceError, stop_flag};
use tprmp_model::controller_config::ControllerConfig;
use tprmp_robot::Chain;

use crate::conformance::motions::{Motions, rests};
use crate::conformance::mover::{Moment, Mover, Path as Way, amplitude};
use crate::conformance::recording::{Received, Recording};
use crate::conformance::states::States;
use crate::conformance::table::{Check, Table, Verdict};
use crate::inputs::turns::ContinuousJoints;
use crate::timing::realtime::monotonic_ns;

/// A killed controller is looked after for so long.
const AFTER_KILL: Duration = Duration::from_millis(1500);
/// Whether it was killed is looked for so often.
const LOOK: Duration = Duration::from_millis(5);

/// What is looked at, and how.
#[derive(Debug)]
pub struct Kit<'a, const N: usize> {
    /// The configuration.
    pub config: &'a ControllerConfig,
    /// Its file.
    pub config_path: &'a Path,
    /// The robot.
    pub chain: &'a Chain<N>,
    /// Where the publisher is.
    pub instance: &'a Instance,
    /// The frames that a skill needs, where one is named.
    pub needed: Vec<[u8; NAME_CAPACITY]>,
    /// How long is looked without a motion.
    pub duration: Duration,
    /// Whether motions are made.
    pub moves: bool,
}

impl<const N: usize> Kit<'_, N> {
    /// Looks at everything; how many checks have failed. `confirm` is asked before each motion.
    pub fn run(&self, confirm: &dyn Fn(&str) -> bool) -> usize {
        let mut table = Table::default();
        let ports = match self.instance.open_controller() {
            Ok(ports) => ports,
            Err(error) => {
                table.add(Check::Services, Verdict::Failed(error.to_string()));
                table.skip_rest("the services cannot be opened");
                return table.failed();
            }
        };
        let name = self.instance.name();
        table.add(Check::Services, Verdict::Passed(format!("open, of instance `{name}`")));
        let recording = Recording::take(&ports.state, Some(&ports.frames), self.duration)
            .unwrapped(&ContinuousJoints::of(self.chain));
        let Recording { states, frames } = &recording;
        States { config: self.config, chain: self.chain, states }.judge(&mut table);
        scene::judge(&mut table, self.config, frames, &self.needed);
        if table.failed() > 0 {
            table.skip_rest("nothing is moved where a check has failed");
        } else if !self.moves {
            table.skip_rest("a motion: --move");
        } else {
            let stop = match stop_flag() {
                Ok(stop) => stop,
                Err(error) => {
                    table.skip_rest(&format!("signals cannot be handled: {error}"));
                    return table.failed() + 1;
                }
            };
            let mut mover = Mover::new(ports, self.chain, self.config, &stop);
            let motions = Motions { config: self.config, confirm };
            if motions.judge(&mut mover, &mut table) {
                let _ = mover.hold(0.2);
                // Without a last command: the next controller is killed.
                drop(mover);
                self.killed(&mut table, confirm);
            } else {
                mover.leave();
                table.skip_rest("nothing more is moved where a motion has failed");
            }
        }
        table.failed()
    }

    /// Lets a controller of its own process be killed in a motion.
    fn killed(&self, table: &mut Table, confirm: &dyn Fn(&str) -> bool) {
        if !confirm("joint 1 moves by half of 2° or 10 mm, then its controller is killed") {
            table.add(Check::Killed, Verdict::NotTried("not confirmed".into()));
            return;
        }
        let verdict = match self.kill() {
            Ok([before, after]) => judge_killed(&before, &after, amplitude(self.chain, 0)),
            Err(text) => Verdict::NotTried(text),
        };
        table.add(Check::Killed, verdict);
        if let Ok(ports) = self.instance.open_controller() {
            Mover::new(ports, self.chain, self.config, &Arc::default()).leave();
        }
    }

    /// What was measured until the controller was killed, and after that.
    fn kill(&self) -> Result<[Vec<Moment<N>>; 2], String> {
        let said = |error: &dyn core::fmt::Display| error.to_string();
        let observer = self.instance.open_observer().map_err(|error| said(&error))?;
        let program = std::env::current_exe().map_err(|error| said(&error))?;
        let mut child = Command::new(program)
            .arg("conformance")
            .arg(self.config_path)
            .args(["--instance", self.instance.name(), "--move", "--yes", "--killed-in-motion"])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .map_err(|error| said(&error))?;
        let mut states = Vec::new();
        while child.try_wait().map_err(|error| said(&error))?.is_none() {
            let taken = Recording::take(&observer.state, None, LOOK);
            states.extend(taken.states);
        }
        // It was killed since the last look but one.
        let killed_ns = monotonic_ns().saturating_sub(2 * LOOK.as_nanos() as u64);
        states.extend(Recording::take(&observer.state, None, AFTER_KILL).states);
        drop(observer);
        let _ = self.instance.clean();
        let recording = Recording { states, frames: Vec::new() };
        let Recording { states, .. } = recording.unwrapped(&ContinuousJoints::of(self.chain));
        let moment = |state: &Received<RobotState>| Moment::of(&state.message, SVector::zeros());
        let (before, after): (Vec<_>, Vec<_>) = states.iter().partition(|s| s.at_ns < killed_ns);
        match (before.is_empty(), after.is_empty()) {
            (false, false) => {
                Ok([before, after].map(|part| part.into_iter().map(moment).collect()))
            }
            _ => Err("no state came meanwhile".into()),
        }
    }

    /// Moves the first joint and is killed half way: the other process looks at what the robot does.
    ///
    /// # Errors
    /// Where the services cannot be opened.
    pub fn die_in_motion(&self) -> Result<(), ServiceError> {
        let mut mover =
            Mover::new(self.instance.open_controller()?, self.chain, self.config, &Arc::default());
        if mover.hold(0.3).is_ok() {
            let way = Way { joint: 0, offsets: [0.0, mover.amplitude(0)], duration_s: 0.6 };
            let _ = mover.go(&way, 0.0, 0.3, CommandMode::Track);
            let _ = kill_process(getpid(), Signal::KILL);
        }
        Ok(())
    }
}

/// Whether the arm that moved before came to rest soon after its controller was killed.
fn judge_killed<const N: usize>(
    before: &[Moment<N>],
    after: &[Moment<N>],
    amplitude: f64,
) -> Verdict {
    if before.iter().all(|moment| moment.position[0] == before[0].position[0]) {
        return Verdict::NotTried("the arm did not move before".into());
    }
    // It was killed half way, whenever that was noticed.
    let mut half = before[0];
    let moved = after.last().map_or(0.0, |last| last.position[0] - half.position[0]);
    half.position[0] += 0.5 * amplitude * moved.signum();
    let trace: Vec<_> = core::iter::once(half).chain(after.iter().copied()).collect();
    rests(&trace, 0, amplitude).map_or_else(Verdict::Failed, Verdict::Passed)
}
