//! The command line of the planar simulator.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

mod clock;
mod drawings;
mod episode;
mod error;
mod log;
mod pictures;
mod record;
mod report;
mod run;
mod scene;
mod shape;
mod spline;
mod world;

use error::SimError;
use log::Outcome;
use run::Options;
use scene::Scene;
use tprmp_files::standard::exit_code;
use tprmp_files::{Existing, errln};

/// A native simulator of a point in the plane: no Python needed.
///
/// It publishes the point's state, the moving goal and an obstacle over shared memory, and obeys
/// the controller's commands. In two terminals:
///
///   planar-sim run --seed 1 --out target/demo-planar
///
///   controller run config/controllers/planar.ron --model MODEL --until-done \
///     --summary target/demo-planar/controller.json
///
/// and afterwards `planar-sim report target/demo-planar`.
#[derive(Debug, Parser)]
#[command(version, name = "planar-sim", verbatim_doc_comment)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run the simulator live, beside a controller, until the task is done.
    ///
    /// The point waits, braked, for the controller's first command. Ctrl-C ends the run and still
    /// writes the log; another Ctrl-C, half a second later or more, leaves at once.
    Run {
        /// Where the goal and the obstacle are and how they move; the same seed, the same run.
        #[arg(long)]
        seed: u64,
        /// Folder for the log (log.csv, bridge.json).
        #[arg(long)]
        out: PathBuf,
        /// Name that publisher and controller share.
        #[arg(long, default_value = "default")]
        instance: String,
        /// Simulated clock, one command a state: exact on a busy machine. The controller needs
        /// the same flag.
        #[arg(long)]
        lockstep: bool,
        /// Also push the point, for a short time.
        #[arg(long)]
        push: bool,
        /// Write the raw bytes of every command to this file.
        #[arg(long, value_name = "FILE", requires = "lockstep")]
        record_commands: Option<PathBuf>,
        /// Replace another run's files.
        #[arg(long)]
        force: bool,
        /// Scene file.
        #[arg(long, default_value = "config/scenes/planar.json")]
        scene: PathBuf,
    },
    /// Report on a run: a table, DIR/result.json and DIR/report.html with pictures.
    ///
    /// Reads log.csv and bridge.json of `planar-sim run --out DIR` and controller.json of
    /// `controller run --summary DIR/controller.json`. The exit code is 1 when the run failed.
    Report {
        /// Folder of the run.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Write the scripted expert's demonstrations, from which `learner train` learns the skill.
    Record {
        /// Folder for the files 01.json, 02.json, …
        #[arg(long)]
        out: PathBuf,
        /// What the expert varies; the same seed gives the same files.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Replace demonstrations of the same names in the folder.
        #[arg(long)]
        force: bool,
        /// Scene file.
        #[arg(long, default_value = "config/scenes/planar.json")]
        scene: PathBuf,
    },
    /// Write the scripted expert's demonstrations of drawings: waypoints in a file, one skill each.
    ///
    /// A folder a skill. To add a drawing, add its name and waypoints to the file; the others'
    /// demonstrations stay as they are.
    Draw {
        /// Drawings file.
        #[arg(long, default_value = "config/drawings.json")]
        drawings: PathBuf,
        /// Folder for the skills' folders.
        #[arg(long)]
        out: PathBuf,
        /// What the expert varies; the same seed gives the same files.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Replace demonstrations of the same names in the folders.
        #[arg(long)]
        force: bool,
    },
}

fn main() -> ExitCode {
    tprmp_files::report_panics("planar-sim", env!("CARGO_PKG_VERSION"));
    match execute(Arguments::parse().command) {
        Ok(success) => exit_code(success),
        Err(error) => {
            errln!("planar-sim: {error}");
            exit_code(false)
        }
    }
}

/// Runs a command; gives whether what it ran or judged succeeded.
fn execute(command: Command) -> Result<bool, SimError> {
    match command {
        Command::Run { seed, out, instance, lockstep, push, record_commands, force, scene } => {
            let existing = Existing::unless(force);
            let options =
                Options { seed, out, instance, lockstep, push, record_commands, existing };
            let outcome = run::run(&Scene::read(&scene)?, &options)?;
            Ok(matches!(outcome, Outcome::Done | Outcome::Interrupted))
        }
        Command::Report { folder } => report::report(&folder),
        Command::Record { out, seed, force, scene } => {
            record::record(&Scene::read(&scene)?, seed, &out, Existing::unless(force))?;
            Ok(true)
        }
        Command::Draw { drawings, out, seed, force } => {
            drawings::draw(&drawings, seed, &out, Existing::unless(force))?;
            Ok(true)
        }
    }
}
