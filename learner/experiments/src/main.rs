//! `experiments`: compares policies on a set of demonstrations and writes a report.

use std::process::ExitCode;

use clap::Parser;
use tprmp_experiments::run::{Options, run};
use tprmp_files::errln;
use tprmp_files::standard::{exit_code, out};

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
            out(format_args!("{text}"));
            exit_code(true)
        }
        Err(error) => {
            errln!("experiments: {error}");
            exit_code(false)
        }
    }
}
