//! What a program prints when it has a fault itself: input never panics, but if something does, whoever
//! meets it shall know what to do.

use std::io::Write;
use std::panic::PanicHookInfo;

/// Prints a request for a report in place of a backtrace when a thread of this program panics. The exit
/// code of a panic in the main thread is 101.
pub fn report_panics(program: &'static str, version: &'static str) {
    std::panic::set_hook(Box::new(move |info| {
        // Where nobody reads it, the exit code says so.
        let _ = std::io::stderr().write_all(message(program, version, info).as_bytes());
    }));
}

fn message(program: &str, version: &str, info: &PanicHookInfo<'_>) -> String {
    let payload = info.payload();
    let text = payload.downcast_ref::<String>().map(String::as_str);
    let what = text.or(payload.downcast_ref::<&str>().copied()).unwrap_or("no text");
    let place = info.location().map_or("an unknown place".into(), ToString::to_string);
    format!(
        "{program}: this is a fault of the program, not of its input: {what} ({program} {version}, \
         {place}). Please report these lines, with the command and the files it was given.\n"
    )
}
