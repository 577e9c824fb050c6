//! `learner`: demonstrations in, frozen model out.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use tprmp_learner::error::LearnerError;
use tprmp_learner::import::{Selection, import};
use tprmp_learner::{report, train};
use tprmp_model::skill_model;

/// Learns a skill from a few demonstrations.
///
/// Record or import some demonstrations (three are enough), train a model from them, and give the
/// model to the controller:
///
///     learner train config/skills/pick.ron --out target/pick.model.ron
///     learner inspect target/pick.model.ron
#[derive(Parser)]
#[command(version, verbatim_doc_comment)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Learn a model from a skill file and the demonstrations it names
    Train {
        /// Skill file, e.g. config/skills/pick.ron
        skill: PathBuf,
        /// Model file to write
        #[arg(long)]
        out: PathBuf,
        /// Seed of all random numbers: the same input and seed give the same file, byte for byte
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Print what a model file holds
    Inspect {
        /// Model file
        model: PathBuf,
    },
    /// Turn a JSON file of several demonstrations in the thesis' layout into demonstration files
    Import {
        /// File to import
        foreign: PathBuf,
        /// Folder to write the demonstrations to; made when it is missing
        #[arg(long)]
        out: PathBuf,
        /// Name of the skill; by default the one in the file
        #[arg(long)]
        skill: Option<String>,
        /// Only the demonstrations with this tag
        #[arg(long)]
        tag: Option<String>,
    },
}

fn main() -> ExitCode {
    match run(Arguments::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("learner: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<(), LearnerError> {
    match command {
        Command::Train { skill, out, seed } => {
            let mut progress = Progress::new();
            let trained = train::train(&skill, seed, &mut |done| progress.tell(done))?;
            progress.finish();
            skill_model::write(&trained.model, &out)?;
            print!("{}", report::trained(&trained));
            println!("wrote      {}", out.display());
        }
        Command::Inspect { model } => {
            print!("{}", report::inspected(&skill_model::read(&model)?));
        }
        Command::Import { foreign, out, skill, tag } => {
            for path in import(&foreign, &out, &Selection { skill, tag })? {
                println!("wrote      {}", path.display());
            }
        }
    }
    Ok(())
}

/// Tells on a terminal what is done, once it has taken longer than a second.
struct Progress {
    since: Instant,
    bar: Option<ProgressBar>,
}

impl Progress {
    const PATIENCE: Duration = Duration::from_secs(1);

    fn new() -> Self {
        Self { since: Instant::now(), bar: None }
    }

    fn tell(&mut self, done: &str) {
        if self.since.elapsed() < Self::PATIENCE {
            return;
        }
        let bar = self.bar.get_or_insert_with(|| {
            let style = ProgressStyle::with_template("{spinner} {elapsed} {msg}");
            ProgressBar::new_spinner().with_style(style.expect("the template is well formed"))
        });
        bar.set_message(format!("done: {done}"));
        bar.tick();
    }

    fn finish(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}
