//! `learner`: demonstrations in, frozen model out.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::{Args, Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use tprmp_files::standard::{self, exit_code};
use tprmp_files::{Existing, errln, outln, printable, try_out, write};
use tprmp_learner::import::{Selection, import};
use tprmp_learner::mixture::components::Components;
use tprmp_learner::{plot, record, report, train};
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
    Train(TrainOptions),
    /// Print what a model file holds
    Inspect {
        /// Model file
        model: PathBuf,
    },
    /// Write demonstrations from a live robot, whoever publishes its state and frames
    ///
    /// A demonstration begins when the arm starts to move and ends when it has rested for a second;
    /// then the next one is waited for. Rest is judged by means over a window against the measured
    /// noise of joints and frames. Ctrl-C ends. Nothing is ever sent to the robot.
    Record(record::Options),
    /// Draw what a model has learned: pictures, and a page that shows them all
    Plot {
        /// Model file
        model: PathBuf,
        /// Folder of the demonstrations that the model was learned from
        #[arg(long, value_name = "FOLDER")]
        demonstrations: PathBuf,
        /// Folder to write the pictures to; made when it is missing
        #[arg(long, value_name = "FOLDER")]
        out: PathBuf,
    },
    /// Turn files of other formats into demonstration files
    ///
    /// Formats, by extension:
    ///   .csv   one demonstration: header with time_s and x_m, y_m [, z_m [, qw, qx, qy, qz]], or the
    ///          joints of --robot; its frames in NAME.frames.json: {"frames": {...}}
    ///   .npz   one demonstration: arrays time_s, poses, frames/NAME (x y z qw qx qy qz)
    ///   .npy   several demonstrations: demonstrations x samples x coordinates; NAME.array.json says
    ///          what they are
    ///   .mat   LASA handwriting: cells `demos` with pos, t, vel, dt, in mm
    ///   .json  several demonstrations in the thesis' layout
    /// A folder: all .csv, .npz, .npy and .mat in it.
    ///
    /// Recorded velocities (vx_m_s ..., velocities, vel) are compared with the sampling time.
    #[command(verbatim_doc_comment)]
    Import(Box<ImportOptions>),
}

#[derive(Args)]
struct TrainOptions {
    /// Skill file, e.g. config/skills/pick.ron
    skill: PathBuf,
    /// Model file to write
    #[arg(long)]
    out: PathBuf,
    /// Seed of all random numbers: the same input and seed give the same file, byte for byte
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Gaussians of the mixture: a number, or `auto` for the least Bayesian information
    /// criterion; by default the skill file's `mixture.components`
    #[arg(long, value_name = "auto|N", value_parser = count_or_auto)]
    components: Option<Count>,
    /// Numbers of Gaussians that `--components auto` tries
    #[arg(
        long,
        value_name = "LEAST..MOST",
        default_value = "2..20",
        value_parser = range,
        requires = "components"
    )]
    components_range: (usize, usize),
    /// Write a model that fails its certificate; the controller refuses it unless told otherwise
    #[arg(long)]
    allow_uncertified: bool,
}

#[derive(Args)]
struct ImportOptions {
    /// Files to import, or folders of them
    #[arg(required = true)]
    foreign: Vec<PathBuf>,
    /// Folder to write the demonstrations to; made when it is missing
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    selection: Selection,
    /// Replace demonstrations of the same names in the folder
    #[arg(long)]
    force: bool,
}

/// What `--components` says.
#[derive(Clone, Copy)]
enum Count {
    Auto,
    Number(usize),
}

fn count_or_auto(text: &str) -> Result<Count, String> {
    match text {
        "auto" => Ok(Count::Auto),
        _ => text.parse().map(Count::Number).map_err(|_| "expected `auto` or a number".into()),
    }
}

fn range(text: &str) -> Result<(usize, usize), String> {
    let ends = text.split_once("..").and_then(|(least, most)| {
        Some((least.parse().ok()?, most.trim_start_matches('=').parse().ok()?))
    });
    ends.filter(|(least, most)| least <= most)
        .ok_or_else(|| "expected two numbers, the smaller first, e.g. 2..20".into())
}

fn main() -> ExitCode {
    tprmp_files::report_panics("learner", env!("CARGO_PKG_VERSION"));
    match run(Arguments::parse().command) {
        Ok(()) => exit_code(true),
        Err(error) => {
            errln!("learner: {error}");
            exit_code(false)
        }
    }
}

/// What a command may fail with besides its own errors.
#[derive(Debug, thiserror::Error)]
enum CommandError {
    /// The learned skill fails its certificate.
    #[error(
        "the learned skill fails its certificate in {} point{}, first: {}; nothing was written. Heed the \
         warnings above; another `mixture.components` may help; the thesis' policy seldom holds a \
         certificate, `fit: Canonical` mostly does; --allow-uncertified writes the model all \
         the same",
        failures.len(),
        if failures.len() == 1 { "" } else { "s" },
        failures.first().map_or("", String::as_str)
    )]
    Uncertified {
        /// What failed.
        failures: Vec<String>,
    },
}

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn run(command: Command) -> Outcome {
    match command {
        Command::Train(options) => train(options)?,
        Command::Record(options) => record::record(&options)?,
        Command::Inspect { model } => print(&report::inspected(&skill_model::read(&model)?)),
        Command::Plot { model, demonstrations, out } => {
            print_written(&plot::plot(&model, &demonstrations, &out)?);
        }
        Command::Import(options) => {
            let existing = Existing::unless(options.force);
            let imported = import(&options.foreign, &options.out, &options.selection, existing)?;
            print_all("read", &imported.summary);
            print_all("warning", &imported.warnings);
            print_written(&imported.written);
        }
    }
    Ok(())
}

fn print(text: &str) {
    standard::out(format_args!("{text}"));
}

fn train(options: TrainOptions) -> Outcome {
    // Before the work: a model that cannot be written would be lost.
    try_out(&options.out, Existing::Replace)?;
    let (least, most) = options.components_range;
    let components = match options.components {
        None => Components::SkillFile,
        Some(Count::Number(count)) => Components::Count(count),
        Some(Count::Auto) => Components::Auto { least, most },
    };
    let mut progress = Progress::new();
    let show = &mut |done: &str| progress.show(done);
    let trained = train::train(&options.skill, components, options.seed, show)?;
    progress.finish();
    print(&report::trained(&trained));
    let failures = trained.model.failures();
    if !(failures.is_empty() || options.allow_uncertified) {
        return Err(CommandError::Uncertified { failures }.into());
    }
    skill_model::write(&trained.model, &options.out)?;
    print_written(std::slice::from_ref(&options.out));
    if let Some(choice) = &trained.choice {
        let path = options.out.with_extension("bic.svg");
        write(&path, plot::choice(choice), Existing::Replace)?;
        print_written(&[path]);
    }
    Ok(())
}

fn print_all(key: &str, lines: &[String]) {
    for line in lines {
        outln!("{key:<11}{}", printable(line));
    }
}

fn print_written(paths: &[PathBuf]) {
    for path in paths {
        outln!("wrote      {}", path.display());
    }
}

/// Shows on a terminal what is done, once it has taken longer than a second.
struct Progress {
    since: Instant,
    bar: Option<ProgressBar>,
}

impl Progress {
    const PATIENCE: Duration = Duration::from_secs(1);

    fn new() -> Self {
        Self { since: Instant::now(), bar: None }
    }

    fn show(&mut self, done: &str) {
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
