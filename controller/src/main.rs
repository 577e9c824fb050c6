//! The command line of the controller.

use std::fmt::Display;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use tprmp_controller::commands::conformance::Conformance;
use tprmp_controller::commands::cover::CoverLinks;
use tprmp_controller::commands::ctl::Ctl;
use tprmp_controller::commands::frames::Frames;
use tprmp_controller::commands::init::Init;
use tprmp_controller::commands::layout::Layout;
use tprmp_controller::commands::run::Run;
use tprmp_controller::commands::soak::Soak;
use tprmp_controller::commands::{check, clean, top};
use tprmp_controller::timing::allocation::CountingAllocator;
use tprmp_files::errln;
use tprmp_files::standard::exit_code;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Runs a learned skill on a robot, in a hard loop over shared memory.
///
/// Start a state publisher on the same instance (`sim-bridge run`, `planar-sim run`, the driver of
/// a real robot), then `controller run`. Stop it with Ctrl-C: the arm ramps down to rest; another
/// Ctrl-C, half a second later or more, leaves at once.
#[derive(Debug, Parser)]
#[command(version, name = "controller")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Write a whole configuration for the arm of a URDF, each number with the reason for it.
    ///
    /// What the description lacks is a default, and is told: look at it before the arm moves.
    Init(Box<Init>),
    /// Run a skill: waits for robot state and task frames, then publishes joint commands.
    Run(Run),
    /// Check configuration, robot and model, and what this machine lacks for real time.
    Check {
        /// Configuration, e.g. config/controllers/ur5_pick.ron.
        config: PathBuf,
        /// Model that `learner train` wrote.
        #[arg(long)]
        model: Vec<PathBuf>,
    },
    /// Cover the links of an arm with spheres, from the meshes of its URDF: the control points of a configuration.
    ///
    /// The exit code is 1 when the mesh of a link is missing, unless the link is exempt.
    Cover(CoverLinks),
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
    /// Ask a running controller: how it is, to start, hold, stop, reset a fault, swap its model or set a gain.
    Ctl(Ctl),
    /// Remove what killed processes left behind, in shared memory and in /tmp; nothing of the living.
    Clean {
        /// Name that publisher and controller share; without it all instances of this user.
        #[arg(long)]
        instance: Option<String>,
    },
    /// Publish frames and obstacles that stand still, as a source beside the state publisher.
    ///
    /// Ctrl-C ends it: then they are too old, and the arm stops where it needs them.
    Frames(Frames),
    /// Run a controller for a long time beside a publisher that is killed and started again at random.
    ///
    /// Judged are allocations, memory and schedule. The exit code is 1 when something does not hold.
    Soak(Soak),
    /// Look whether a state publisher keeps the contract: without a motion, and with --move by small motions.
    ///
    /// The exit code is 1 when a check fails; its remedy stands beside it.
    Conformance(Conformance),
    /// Print what is in shared memory, for publishers in other languages: types, sizes, names, values and bounds.
    Layout(Layout),
}

fn main() -> ExitCode {
    tprmp_files::report_panics("controller", env!("CARGO_PKG_VERSION"));
    match Arguments::parse().command {
        Command::Init(init) => exit(init.run()),
        Command::Run(run) => exit(run.run()),
        Command::Check { config, model } => exit(check::check(&config, &model)),
        Command::Cover(cover) => exit(cover.run()),
        Command::Top { instance, once } => exit(top::top(&instance, once)),
        Command::Ctl(ctl) => exit(ctl.run()),
        Command::Clean { instance } => exit(clean::clean(instance.as_deref())),
        Command::Frames(frames) => exit(frames.run()),
        Command::Soak(soak) => exit(soak.run()),
        Command::Conformance(conformance) => exit(conformance.run()),
        Command::Layout(layout) => {
            layout.run();
            exit_code(true)
        }
    }
}

fn exit(result: Result<(), impl Display>) -> ExitCode {
    match result {
        Ok(()) => exit_code(true),
        Err(error) => {
            errln!("controller: {error}");
            exit_code(false)
        }
    }
}
