//! The real controller, in a process of its own, with settings of a benchmark's.

use std::env;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tprmp_messages::StatusPort;

use crate::robot::Skill;
use crate::{Fallible, results};

/// A controller may take so long to start, and to leave when it is asked to.
const PATIENCE: Duration = Duration::from_secs(20);
/// Pause between two looks at how far it is.
const LOOK: Duration = Duration::from_millis(50);

/// What wakes the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trigger {
    /// Its own schedule.
    Periodic,
    /// Each new state.
    OnState,
    /// Each new state, on the clock of the states.
    Lockstep,
}

/// What a benchmark varies; the rest is as in the shipped configuration.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What to run.
    pub skill: Skill,
    /// What wakes it.
    pub trigger: Trigger,
    /// Period of the schedule, and deadline of a tick \[ns\].
    pub period_ns: u64,
    /// How long it may spin instead of sleeping \[ns\].
    pub spin_ns: u64,
    /// Real-time priority.
    pub fifo_priority: Option<u8>,
    /// Core of the loop.
    pub cpu: usize,
}

/// A controller that runs.
#[derive(Debug)]
pub struct Controller {
    child: Child,
    summary: PathBuf,
    log: PathBuf,
}

/// The folder of the program that runs is `target/release/deps`.
fn program(name: &str) -> Fallible<PathBuf> {
    let here = env::current_exe()?;
    let path = here.ancestors().nth(2).unwrap_or(Path::new("")).join(name);
    if path.exists() { Ok(path) } else { Err(missing(&path)) }
}

fn missing(path: &Path) -> Box<dyn std::error::Error> {
    format!("`{}` is missing: `make bench` makes it", path.display()).into()
}

fn text_of(log: &Path) -> String {
    fs::read_to_string(log).unwrap_or_default()
}

impl Controller {
    /// Starts it on an instance.
    ///
    /// # Errors
    /// When the program or the trained model is missing.
    pub fn start(settings: &Settings, instance: &str) -> Fallible<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let model = results::folder().join(format!("{}.model.ron", settings.skill.name()));
        if !model.exists() {
            return Err(missing(&model));
        }
        let summary = results::folder().join("controller.json");
        let log = results::folder().join("controller.log");
        if summary.exists() {
            fs::remove_file(&summary)?;
        }
        let priority = settings.fifo_priority.map_or("none".into(), |p| p.to_string());
        let mut command = Command::new(program("controller")?);
        command
            // Times are measured, not motions: a model with the asked number of components will do.
            .args(["run", "--allow-uncertified"])
            .arg(root.join(settings.skill.controller()))
            .arg("--model")
            .arg(model)
            .arg("--summary")
            .arg(&summary)
            .args(["--instance", instance])
            .args(["--period-ns", &settings.period_ns.to_string()])
            .args(["--spin-ns", &settings.spin_ns.to_string()])
            .args(["--fifo-priority", &priority])
            .args(["--cpu", &settings.cpu.to_string()]);
        match settings.trigger {
            Trigger::Periodic => command.args(["--trigger", "periodic"]),
            Trigger::OnState => command.args(["--trigger", "on-state"]),
            Trigger::Lockstep => command.arg("--lockstep"),
        };
        let child = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(&log)?)
            .spawn()?;
        Ok(Self { child, summary, log })
    }

    /// Waits until it has run for so many ticks, or for so long since its first one.
    ///
    /// # Errors
    /// When no tick comes, or it leaves: with its log.
    pub fn wait_for_ticks(
        &mut self,
        status: &StatusPort,
        ticks: u64,
        longest: Duration,
    ) -> Fallible<()> {
        let started = Instant::now();
        let mut first = None;
        loop {
            let newest = core::iter::from_fn(|| status.status.receive()).last();
            let ran = newest.map_or(0, |status| status.ticks);
            if ran > 0 {
                first.get_or_insert_with(Instant::now);
            }
            if ran >= ticks || first.is_some_and(|first| first.elapsed() > longest) {
                return Ok(());
            }
            if first.is_none() && started.elapsed() > PATIENCE {
                return Err(
                    format!("the controller does not start:\n{}", text_of(&self.log)).into()
                );
            }
            if let Some(exit) = self.child.try_wait()? {
                return Err(format!("the controller left ({exit}):\n{}", text_of(&self.log)).into());
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Asks it to leave; gives what it measured about itself.
    ///
    /// # Errors
    /// When it had left before, does not leave, or left no summary: with its log.
    pub fn stop(mut self) -> Fallible<Value> {
        if let Some(status) = self.child.try_wait()? {
            return Err(format!("the controller left ({status}):\n{}", text_of(&self.log)).into());
        }
        kill_process(Pid::from_child(&self.child), Signal::INT)?;
        let asked = Instant::now();
        while self.child.try_wait()?.is_none() {
            if asked.elapsed() > PATIENCE {
                let log = text_of(&self.log);
                return Err(format!("the controller does not leave when asked:\n{log}").into());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let text = fs::read_to_string(&self.summary)
            .map_err(|e| format!("`{}`: {e}\n{}", self.summary.display(), text_of(&self.log)))?;
        Ok(serde_json::from_str(&text)?)
    }
}

impl Drop for Controller {
    /// It must not outlive a benchmark that failed.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
