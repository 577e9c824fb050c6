//! The command line of the controller.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{Parser, Subcommand};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use tprmp_controller::allocation::CountingAllocator;
use tprmp_controller::cycle::Pace;
use tprmp_controller::monitor::Monitor;
use tprmp_controller::startup::{self, StartError, WithRobot};
use tprmp_controller::{check, realtime};
use tprmp_messages::{Instance, LAYOUT, LifeCycle};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Runs a learned skill on a robot, in a hard loop over shared memory.
///
/// Start a state publisher on the same instance (`sim-bridge run`, `planar-sim run`, the driver of
/// a real robot), then `controller run`. Stop it with Ctrl-C: the arm ramps down to rest; a second
/// Ctrl-C leaves at once.
#[derive(Debug, Parser)]
#[command(version, name = "controller")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a skill: waits for robot state and task frames, then publishes joint commands.
    Run {
        /// Configuration, e.g. config/controllers/ur5_pick.ron.
        config: PathBuf,
        /// Model that `learner train` wrote.
        #[arg(long)]
        model: PathBuf,
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
        /// Run a model that failed its certificate.
        #[arg(long)]
        allow_uncertified: bool,
    },
    /// Check configuration, robot and model, and what this machine lacks for real time.
    Check {
        /// Configuration, e.g. config/controllers/ur5_pick.ron.
        config: PathBuf,
        /// Model that `learner train` wrote.
        #[arg(long)]
        model: Option<PathBuf>,
    },
    /// Print the layout of the shared-memory messages as JSON, for mirrors in other languages.
    Layout,
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Run {
            config,
            model,
            instance,
            summary,
            lockstep,
            until_done,
            allow_uncertified,
        } => startup::load(&config, &model, allow_uncertified).and_then(|loaded| {
            run(&config, loaded, &instance, summary.as_deref(), lockstep, until_done)
        }),
        Command::Check { config, model } => check::check(&config, model.as_deref()),
        Command::Layout => {
            print_layout();
            Ok(())
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("controller: {error}");
            ExitCode::FAILURE
        }
    }
}

struct Run<'a> {
    config_path: &'a Path,
    loaded: startup::Loaded,
    instance: Instance,
    pace: Pace,
    until_done: bool,
    summary: Option<&'a Path>,
}

fn run(
    config_path: &Path,
    loaded: startup::Loaded,
    instance: &str,
    summary: Option<&Path>,
    lockstep: bool,
    until_done: bool,
) -> Result<(), StartError> {
    let instance = Instance::new(instance)?;
    let config = loaded.config.clone();
    let pace = if lockstep { Pace::Lockstep } else { Pace::RealTime(config.cycle.trigger) };
    startup::with_robot(
        config_path,
        &config,
        Run { config_path, loaded, instance, pace, until_done, summary },
    )
}

impl WithRobot for Run<'_> {
    type Output = ();

    fn call<const N: usize>(self) -> Result<(), StartError> {
        if let Some(path) = self.summary {
            // Before anything moves: a summary that cannot be written would be lost.
            startup::try_summary(path)?;
        }
        let real_time = self.loaded.config.real_time;
        let failures = self.loaded.model.certificate.failures.len();
        if failures > 0 {
            eprintln!("controller: this model fails its certificate in {failures} points");
        }
        let skill = self.loaded.model.skill.clone();
        let mut cycle = startup::cycle::<N>(
            self.config_path,
            self.loaded,
            self.pace,
            self.until_done,
            &self.instance,
        )?;
        // After the ports exist, so that nothing replaces the handlers.
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            flag::register_conditional_shutdown(signal, 1, Arc::clone(&stop))
                .and_then(|_| flag::register(signal, Arc::clone(&stop)))
                .map_err(StartError::Signals)?;
        }
        eprintln!(
            "controller: skill `{skill}`, {N} joints, instance `{}`: waiting for state and frames",
            self.instance.name()
        );
        // Before the loop's priority is set, which a thread would inherit.
        let monitor = Monitor::start(cycle.board());
        if self.pace != Pace::Lockstep {
            for refused in realtime::set_up(&real_time) {
                eprintln!("controller: {refused}");
            }
        }
        let ending = cycle.run(&stop);
        drop(monitor);
        let summary = cycle.telemetry().summary(ending.allocations, ending.life_cycle);
        report(&summary, ending.life_cycle);
        self.summary.map_or(Ok(()), |path| startup::write_summary(path, &summary))
    }
}

/// The last line: where the task stood when the controller left, and how the loop did.
fn report(summary: &serde_json::Value, life_cycle: LifeCycle) {
    let ticks = summary["ticks"].as_u64().unwrap_or(0);
    if ticks == 0 {
        eprintln!("controller: stopped; no state and frames had arrived, nothing was moved");
        return;
    }
    let time = |percentile: &str| summary["tick_us"][percentile].as_f64().unwrap_or(0.0);
    eprintln!(
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

fn print_layout() {
    let fields: Vec<_> = LAYOUT
        .iter()
        .map(|f| {
            serde_json::json!({
                "message": f.message, "field": f.field, "offset": f.offset, "size": f.size,
            })
        })
        .collect();
    let _ = writeln!(std::io::stdout(), "{}", serde_json::Value::from(fields));
}
