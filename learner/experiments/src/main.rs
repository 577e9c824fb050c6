//! `experiments`: compares policies on a set of demonstrations and writes a report.

use std::io::Write as _;
use std::process::ExitCode;

use clap::Parser;
use tprmp_experiments::run::{Options, run};

/// Repeat the thesis' experiments, and harder ones, on a set of demonstrations
#[derive(Parser)]
#[command(name = "experiments", version, about)]
struct Arguments {
    #[command(flatten)]
    options: Options,
}

fn main() -> ExitCode {
    tprmp_files::report_panics("experiments", env!("CARGO_PKG_VERSION"));
    match run(&Arguments::parse().options) {
        Ok(text) => {
            // A reader that has gone away is no reason to fail: the report is written.
            let _ = std::io::stdout().write_all(text.as_bytes());
            ExitCode::SUCCESS
        }
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "experiments: {error}");
            ExitCode::FAILURE
        }
    }
}
