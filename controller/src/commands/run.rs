//! `controller run`: runs a skill until it is stopped, or its task is done.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use thiserror::Error;
use tprmp_files::{Existing, WriteError, errln, try_out, write};
use tprmp_messages::{Instance, LifeCycle, ServiceError, stop_flag};
use tprmp_model::controller_config::ControllerConfig;

use crate::commands::monitor::Monitor;
use crate::commands::overrides::Overrides;
use crate::control::journal::{Journal, JournalError};
use crate::control::server::{Build, Server, Shared};
use crate::startup::{self, Loaded, StartError, WithRobot};
use crate::timing::pacing::Pacing;
use crate::timing::realtime::{self, Denied, Granted};

/// Why a skill was not run, or not to the end.
#[derive(Debug, Error)]
pub enum RunError {
    /// The files, or the robot.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The journal.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The signal handlers.
    #[error("signal handlers cannot be installed: {0}")]
    Signals(std::io::Error),
    /// A required capability is missing.
    #[error("key `real_time.required` names {:?}, which the system denies: {_0}", _0.capability)]
    Denied(Denied),
    /// The summary.
    #[error("--summary: {0}")]
    Summary(WriteError),
}

/// What to run.
#[derive(Debug, Args)]
pub struct Run {
    /// Configuration, e.g. config/controllers/ur5_pick.ron.
    config: PathBuf,
    /// Model that `learner train` wrote. Given again for each entry of `additional_skills`: the skills act
    /// together, and the first is the task.
    #[arg(long, required = true)]
    model: Vec<PathBuf>,
    /// Name that publisher and controller share.
    #[arg(long, default_value = "default")]
    instance: String,
    /// Write what the loop measured about itself to this file, as JSON.
    #[arg(long)]
    summary: Option<PathBuf>,
    /// One tick a state, on the clock of the states: exact on a busy machine.
    #[arg(long)]
    lockstep: bool,
    /// Leave once the task has been done for a second.
    #[arg(long)]
    until_done: bool,
    /// Go on although the controller before this one ended without a stop: somebody has looked.
    #[arg(long)]
    reset: bool,
    /// Run a model that failed its certificate.
    #[arg(long)]
    allow_uncertified: bool,
    #[command(flatten)]
    overrides: Overrides,
}

struct Work<'a> {
    run: &'a Run,
    loaded: Loaded,
    instance: Instance,
    pacing: Pacing,
}

impl Run {
    /// Runs it.
    ///
    /// # Errors
    /// [`RunError`]; nothing has moved, unless it is the summary that cannot be written.
    pub fn run(&self) -> Result<(), RunError> {
        let edit = |config: &mut _| self.overrides.apply(config);
        let loaded = startup::load_with(&self.config, edit, &self.model, self.allow_uncertified)?;
        let instance = Instance::new(&self.instance)?;
        let config = loaded.config.clone();
        let pacing =
            if self.lockstep { Pacing::Lockstep } else { Pacing::RealTime(config.cycle.trigger) };
        startup::with_robot(&self.config, &config, Work { run: self, loaded, instance, pacing })?
    }

    /// What builds the policies of other models while the loop runs.
    fn builder<const N: usize>(&self, config: ControllerConfig) -> Build<N> {
        let (path, allow_uncertified) = (self.config.clone(), self.allow_uncertified);
        Box::new(move |models| {
            let new = startup::load_skills(&path, config.clone(), models, allow_uncertified)
                .and_then(|loaded| startup::replacement::<N>(&path, &loaded));
            new.map_err(|error| error.to_string())
        })
    }
}

impl WithRobot for Work<'_> {
    type Output = Result<(), RunError>;

    fn call<const N: usize>(self) -> Result<(), RunError> {
        let Self { run, loaded, instance, pacing } = self;
        if let Some(path) = &run.summary {
            // Before anything moves: a summary that cannot be written would be lost.
            try_out(path, Existing::Replace).map_err(RunError::Summary)?;
        }
        let Loaded { config, .. } = &loaded;
        let real_time = &config.real_time;
        print_faults(&loaded);
        let names: Vec<_> =
            loaded.skills.iter().map(|skill| format!("`{}`", skill.model.skill)).collect();
        let shared = Shared::new(stop_flag().map_err(RunError::Signals)?);
        let (path, done) = (&run.config, run.until_done);
        let cycle = startup::cycle::<N>(path, &loaded, pacing, done, &instance, shared.clone())?;
        let (journal, last) = Journal::begin(&instance.folder())?;
        if let Some(entry) = &last {
            // What it was doing stays known until the loop goes on.
            shared.task.store(entry.gripping, entry.goal().as_ref());
        }
        let (server, exchange) = Server::start(
            &instance,
            shared.clone(),
            journal,
            config.supervision.settable.clone(),
            run.builder(config.clone()),
        )?;
        let is_well = last.is_none() || run.reset;
        let mut cycle = match last {
            Some(entry) => cycle.after(entry, run.reset),
            None => cycle,
        }
        .exchanging(exchange);
        errln!(
            "controller: skill {}, {N} joints, instance `{}`: waiting for state and frames",
            names.join(" with "),
            instance.name()
        );
        // Before the loop's priority is set, which a thread would inherit.
        let monitor = Monitor::start(Arc::clone(&shared.status), Arc::clone(&shared.detail));
        let granted = (pacing != Pacing::Lockstep).then(|| realtime::set_up(real_time));
        for denied in granted.iter().flat_map(|granted: &Granted| &granted.denied) {
            if real_time.required.contains(&denied.capability) {
                server.end(is_well);
                return Err(RunError::Denied(denied.clone()));
            }
            errln!("controller: {denied}");
        }
        let outcome = cycle.run(&shared.stop);
        drop((monitor, granted));
        server.end(!cycle.follows_a_crash());
        let mut summary = cycle.telemetry().summary(&outcome);
        summary["seen_by_reason"] = cycle.telemetry().details(&shared.detail);
        report(&summary, outcome.life_cycle);
        run.summary.as_deref().map_or(Ok(()), |path| write_summary(path, &summary))
    }
}

/// Which models are run although they failed their certificate, and which are given fewer frames.
fn print_faults(loaded: &Loaded) {
    for model in loaded.skills.iter().map(|skill| &skill.model) {
        let count = model.failures().len();
        if count > 0 {
            let name = &model.skill;
            errln!("controller: the model of `{name}` fails its certificate in {count} points");
        }
        if let Some(text) = model.fewer_frames() {
            errln!("controller: {text}");
        }
    }
}

fn write_summary(path: &Path, summary: &serde_json::Value) -> Result<(), RunError> {
    write(path, format!("{summary:#}\n"), Existing::Replace).map_err(RunError::Summary)
}

/// The last line: where the task stood when the controller left, and how the loop did.
fn report(summary: &serde_json::Value, life_cycle: LifeCycle) {
    let ticks = summary["ticks"].as_u64().unwrap_or(0);
    if ticks == 0 {
        errln!("controller: stopped; no state and frames had arrived, nothing was moved");
        return;
    }
    let time = |percentile: &str| summary["tick_us"][percentile].as_f64().unwrap_or(0.0);
    errln!(
        "controller: stopped, the task was {}; {ticks} ticks, {} deadlines missed, {} allocations \
         in the loop, tick p50 {:.1} µs, p99 {:.1} µs, max {:.1} µs",
        match life_cycle {
            LifeCycle::Done => "done",
            _ => "not done",
        },
        summary["deadline_misses"],
        summary["allocations"],
        time("p50"),
        time("p99"),
        time("max"),
    );
}
