//! What is left of xacro in a file, and its expansion by PyPI's xacro: a program of its own, for a bounded
//! time, with a bounded output, and without a shell.

use std::io::{self, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::error::UrdfErrorKind as Kind;
use crate::xml::Element;

/// Longest time that xacro may take; that of a humanoid takes two seconds.
const DURATION_MAX: Duration = Duration::from_secs(30);
/// Most that is read of its messages [bytes].
const MESSAGE_MAX: u64 = 4096;
/// Pause between two looks at whether it has ended.
const PAUSE: Duration = Duration::from_millis(5);

/// Elements that no chain needs, whatever stands in them.
const UNUSED: [&str; 4] = ["visual", "material", "gazebo", "transmission"];

/// The first place that xacro has to expand: its line and what stands there.
pub(crate) fn left_in(root: &Element) -> Option<(usize, String)> {
    let mut open = vec![root];
    while let Some(element) = open.pop() {
        if element.name.starts_with("xacro:") {
            return Some((element.line, format!("<{}>", element.name)));
        }
        let has_left = |text: &str| text.contains("${") || text.contains("$(");
        if let Some((key, value)) = element.attributes.iter().find(|(_, value)| has_left(value)) {
            let found = format!("{key}=\"{value}\" in <{}>", element.name);
            return Some((element.line, tprmp_files::shortened(&found)));
        }
        let used = |child: &&Element| !UNUSED.contains(&child.name.as_str());
        open.extend(element.children.iter().rev().filter(used));
    }
    None
}

/// The fault of a file that has to be expanded.
pub(crate) fn unexpanded(file: &Path, found: String) -> Kind {
    let urdf = file.with_extension("expanded.urdf");
    Kind::Xacro { found, file: file.to_owned(), urdf }
}

/// The text that xacro makes of a file, at most of `bytes_max`.
///
/// # Errors
/// When there is no xacro, or it fails, takes too long or writes too much.
pub(crate) fn expand(file: &Path, found: String, bytes_max: u64) -> Result<String, Kind> {
    let failed = |said: String| Kind::XacroFailed { said: tprmp_files::shortened(&said) };
    let program = |name: &str, first: &[&str]| {
        let mut command = Command::new(name);
        command.args(first).arg(file);
        command
    };
    let module = "import sys, xacro; sys.argv[0] = 'xacro'; xacro.main()";
    for mut command in [program("xacro", &[]), program("python3", &["-c", module])] {
        let Ok(child) = started(&mut command) else { continue };
        return match outcome(child, bytes_max, DURATION_MAX)
            .map_err(|error| failed(error.to_string()))?
        {
            Outcome::Late => Err(failed(format!("no end within {} s", DURATION_MAX.as_secs()))),
            Outcome::Ended { text, .. } if text.len() as u64 > bytes_max => {
                Err(failed(format!("more than {bytes_max} bytes")))
            }
            Outcome::Ended { succeeded: true, text, .. } => Ok(text),
            Outcome::Ended { said, .. } if said.contains("No module named 'xacro'") => break,
            Outcome::Ended { said, .. } => Err(failed(said.trim().to_owned())),
        };
    }
    Err(unexpanded(file, found))
}

fn started(command: &mut Command) -> io::Result<Child> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()
}

/// What became of a program.
enum Outcome {
    /// It was ended after its time.
    Late,
    /// It ended: what it wrote, and what it said.
    Ended { succeeded: bool, text: String, said: String },
}

fn outcome(mut child: Child, bytes_max: u64, duration_max: Duration) -> io::Result<Outcome> {
    let out = read_beside(child.stdout.take(), bytes_max);
    let said = read_beside(child.stderr.take(), MESSAGE_MAX);
    let start = Instant::now();
    let succeeded = loop {
        match child.try_wait()? {
            Some(status) => break status.success(),
            None if start.elapsed() < duration_max => thread::sleep(PAUSE),
            None => {
                child.kill()?;
                child.wait()?;
                return Ok(Outcome::Late);
            }
        }
    };
    let text = |thread: JoinHandle<io::Result<Vec<u8>>>| {
        let bytes = thread.join().expect("reading a pipe does not panic")?;
        Ok::<_, io::Error>(String::from_utf8_lossy(&bytes).into_owned())
    };
    Ok(Outcome::Ended { succeeded, text: text(out)?, said: text(said)? })
}

/// Reads a pipe to its end. One byte more than `bytes_max` says that there are too many; whoever writes
/// more finds it closed.
fn read_beside<R: Read + Send + 'static>(
    pipe: Option<R>,
    bytes_max: u64,
) -> JoinHandle<io::Result<Vec<u8>>> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        pipe.map_or(Ok(0), |pipe| pipe.take(bytes_max + 1).read_to_end(&mut bytes))?;
        Ok(bytes)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str, bytes_max: u64, duration_max: Duration) -> Outcome {
        let child = started(Command::new("sh").args(["-c", script])).unwrap();
        outcome(child, bytes_max, duration_max).unwrap()
    }

    #[test]
    fn a_program_is_ended_after_its_time() {
        let late = shell("exec sleep 600", 10, Duration::from_millis(20));
        assert!(matches!(late, Outcome::Late));
    }

    #[test]
    fn what_it_writes_is_read_up_to_the_bound_and_no_further() {
        let Outcome::Ended { text, .. } = shell("yes", 1000, DURATION_MAX) else { panic!("late") };
        assert_eq!(text.len(), 1001);
    }

    #[test]
    fn success_and_messages_are_told_apart() {
        let Outcome::Ended { succeeded, text, said } =
            shell("echo out; echo said >&2; exit 3", 1000, DURATION_MAX)
        else {
            panic!("late")
        };
        assert_eq!((succeeded, text.as_str(), said.as_str()), (false, "out\n", "said\n"));
    }
}
