//! `recordings`: writes demonstrations as a hand gives them.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use tprmp_experiments::people::hand::{Hand, Timing};
use tprmp_experiments::people::scene::Scene;
use tprmp_files::standard::exit_code;
use tprmp_files::{Existing, WriteError, errln, make_folder, outln, write};
use tprmp_learner::demonstration::to_text;

/// Write demonstrations as a hand gives them: at its own pace, with pauses and a tremor
#[derive(Parser)]
#[command(name = "recordings", version, about)]
struct Arguments {
    /// What is demonstrated
    #[arg(value_enum)]
    scene: Scene,
    /// Folder for the demonstrations
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// How many
    #[arg(long, default_value_t = 6)]
    count: usize,
    /// Seed of frames, pace and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    hand: Hand,
}

fn main() -> ExitCode {
    tprmp_files::report_panics("recordings", env!("CARGO_PKG_VERSION"));
    let arguments = Arguments::parse();
    if let Err(problem) = arguments.hand.check(arguments.count) {
        errln!("recordings: {problem}");
        return exit_code(false);
    }
    match record(&arguments) {
        Ok(()) => exit_code(true),
        Err(error) => {
            errln!("recordings: {error}");
            exit_code(false)
        }
    }
}

fn record(arguments: &Arguments) -> Result<(), WriteError> {
    let Arguments { scene, out, count, seed, force, hand } = arguments;
    make_folder(out)?;
    for demonstration in hand.demonstrate(*scene, Timing::AsRecorded, *count, *seed) {
        let path: PathBuf = Path::new(out).join(&demonstration.name);
        let text = to_text(&demonstration, "ee_start", "object");
        write(&path, text, Existing::unless(*force))?;
        outln!("wrote      {}", path.display());
    }
    Ok(())
}
