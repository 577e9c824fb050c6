//! The command line of the controller.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use tprmp_controller::commands::monitor::Monitor;
use tprmp_controller::commands::overrides::Overrides;
use tprmp_controller::commands::soak::Soak;
use tprmp_controller::commands::{check, top};
use tprmp_controller::startup::{self, StartError, WithRobot};
use tprmp_controller::timing::allocation::CountingAllocator;
use tprmp_controller::timing::pacing::Pace;
use tprmp_controller::timing::realtime;
use tprmp_messages::{Instance, LAYOUT, LifeCycle, stop_flag};

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
    Run(RunArguments),
    /// Check configuration, robot and model, and what this machine lacks for real time.
    Check {
        /// Configuration, e.g. config/controllers/ur5_pick.ron.
        config: PathBuf,
        /// Model that `learner train` wrote.
        #[arg(long)]
        model: Vec<PathBuf>,
    },
    /// Show how a running controller is doing: its state, counters and the times of its ticks.
    ///
    /// It only reads what the controller publishes anyway. Ctrl-C ends it.
    Top {
        /// Name that publisher and controller share.
        #[arg(long, default_value = "default")]
        instance: String,
        /// Show it once and leave.
        #[arg(long)]
        once: bool,
    },
    /// Run a controller for a long time beside a publisher that is killed and started again at random.
    ///
    /// Judged are allocations, memory and schedule. The exit code is 1 when something does not hold.
    Soak(SoakArguments),
    /// Print the layout of the shared-memory messages as JSON, for mirrors in other languages.
    Layout,
}

#[derive(Debug, Args)]
struct RunArguments {
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
    /// Run a model that failed its certificate.
    #[arg(long)]
    allow_uncertified: bool,
    #[command(flatten)]
    overrides: Overrides,
}

#[derive(Debug, Args)]
struct SoakArguments {
    /// Configuration, e.g. config/controllers/planar.ron.
    config: String,
    /// Model that `learner train` wrote.
    #[arg(long)]
    model: String,
    /// How long.
    #[arg(long, default_value_t = 10.0)]
    minutes: f64,
    /// Of the random times.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Name that publisher and controller share.
    #[arg(long, default_value = "soak")]
    instance: String,
    /// Folder for logs and results (soak.json).
    #[arg(long)]
    out: PathBuf,
    /// The publisher's command line; `{seed}` stands for a number that is another at each start.
    #[arg(last = true, required = true, value_name = "PUBLISHER")]
    publisher: Vec<String>,
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Run(arguments) => run(&arguments),
        Command::Check { config, model } => check::check(&config, &model),
        Command::Top { instance, once } => top::top(&instance, once),
        Command::Soak(arguments) => soak(arguments),
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

fn soak(arguments: SoakArguments) -> Result<(), StartError> {
    let SoakArguments { config, model, minutes, seed, instance, out, publisher } = arguments;
    let controller = vec![config, "--model".into(), model];
    Soak { controller, publisher, instance, duration_s: 60.0 * minutes, seed, out }.run()
}

struct Run<'a> {
    arguments: &'a RunArguments,
    loaded: startup::Loaded,
    instance: Instance,
    pace: Pace,
}

fn run(arguments: &RunArguments) -> Result<(), StartError> {
    let edit = |config: &mut _| arguments.overrides.apply(config);
    let (path, model) = (&arguments.config, &arguments.model);
    let loaded = startup::load_with(path, edit, model, arguments.allow_uncertified)?;
    let instance = Instance::new(&arguments.instance)?;
    let config = loaded.config.clone();
    let pace =
        if arguments.lockstep { Pace::Lockstep } else { Pace::RealTime(config.cycle.trigger) };
    startup::with_robot(path, &config, Run { arguments, loaded, instance, pace })
}

impl WithRobot for Run<'_> {
    type Output = ();

    fn call<const N: usize>(self) -> Result<(), StartError> {
        let Self { arguments, loaded, instance, pace } = self;
        if let Some(path) = &arguments.summary {
            // Before anything moves: a summary that cannot be written would be lost.
            startup::try_summary(path)?;
        }
        let real_time = loaded.config.real_time.clone();
        for skill in &loaded.skills {
            let (name, failures) = (&skill.model.skill, &skill.model.certificate.failures);
            if !failures.is_empty() {
                let count = failures.len();
                eprintln!(
                    "controller: the model of `{name}` fails its certificate in {count} points"
                );
            }
        }
        let names: Vec<_> =
            loaded.skills.iter().map(|skill| format!("`{}`", skill.model.skill)).collect();
        let mut cycle =
            startup::cycle::<N>(&arguments.config, loaded, pace, arguments.until_done, &instance)?;
        let stop = stop_flag().map_err(StartError::Signals)?;
        eprintln!(
            "controller: skill {}, {N} joints, instance `{}`: waiting for state and frames",
            names.join(" with "),
            instance.name()
        );
        // Before the loop's priority is set, which a thread would inherit.
        let monitor = Monitor::start(cycle.board());
        let granted = (pace != Pace::Lockstep).then(|| realtime::set_up(&real_time));
        for refusal in granted.iter().flat_map(|granted| &granted.refused) {
            if real_time.required.contains(&refusal.grant) {
                return Err(StartError::Refused(refusal.clone()));
            }
            eprintln!("controller: {refusal}");
        }
        let ending = cycle.run(&stop);
        drop((monitor, granted));
        let summary = cycle.telemetry().summary(&ending);
        report(&summary, ending.life_cycle);
        let path = arguments.summary.as_deref();
        path.map_or(Ok(()), |path| startup::write_summary(path, &summary))
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
