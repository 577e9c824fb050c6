//! Standard output and standard error, whether somebody reads them or not.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write, stderr, stdout};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::printable::printable;

/// Whether something else than a missing reader kept a text from standard output.
static LOST: AtomicBool = AtomicBool::new(false);

/// Writes text to standard output, with control characters escaped. A reader that has gone away,
/// as in `learner inspect … | head`, is no reason to fail; anything else is reported on standard
/// error when it first happens, and [`exit_code`] tells it.
pub fn out(text: Arguments<'_>) {
    if let Err(error) = write(&mut stdout(), text)
        && !LOST.swap(true, Ordering::Relaxed)
    {
        let program = std::env::args_os().next().map(PathBuf::from).unwrap_or_default();
        let program = program.file_name().unwrap_or_default().to_string_lossy();
        err(format_args!("{program}: standard output cannot be written: {error}\n"));
    }
}

/// Writes text to standard error, with control characters escaped. Where nobody reads it, the
/// exit code tells.
pub fn err(text: Arguments<'_>) {
    let _ = write(&mut stderr(), text);
}

fn write(to: &mut dyn Write, text: Arguments<'_>) -> io::Result<()> {
    match to.write_all(printable(&text.to_string()).as_bytes()).and_then(|()| to.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}

/// Success, unless something failed or a text was lost.
#[must_use]
pub fn exit_code(success: bool) -> ExitCode {
    if success && !LOST.load(Ordering::Relaxed) { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// `println!` that never panics and moves no cursor: see [`standard::out`](crate::standard::out).
#[macro_export]
macro_rules! outln {
    ($($text:tt)*) => { $crate::standard::out(format_args!("{}\n", format_args!($($text)*))) };
}

/// `eprintln!` that never panics and moves no cursor: see [`standard::err`](crate::standard::err).
#[macro_export]
macro_rules! errln {
    ($($text:tt)*) => { $crate::standard::err(format_args!("{}\n", format_args!($($text)*))) };
}
