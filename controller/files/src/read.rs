//! Reads files of bounded size: nothing else than a file is read, and no more of it than is expected.

use std::fs::{File, FileType};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

/// Why the content of a path is not read, in an [`io::Error`]: whoever reports it names the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadProblem {
    /// A device, a pipe, a socket or a folder may never end, or wait for ever.
    #[error("expected a file, found {0}")]
    NotAFile(&'static str),
    /// There is more than any such file holds.
    #[error("expected at most {most} bytes, found {}", at_least(*found))]
    TooLarge {
        /// The bound \[bytes\].
        most: u64,
        /// The size \[bytes\]; `None` when the file grows, or does not say.
        found: Option<u64>,
    },
    /// It is no text.
    #[error("expected text in UTF-8, found something else from byte {0} on")]
    NotText(usize),
}

/// What is there in place of a file.
pub(crate) fn kind(found: FileType) -> &'static str {
    match found {
        _ if found.is_dir() => "a folder",
        _ if found.is_fifo() => "a pipe",
        _ if found.is_socket() => "a socket",
        _ => "a device",
    }
}

fn at_least(found: Option<u64>) -> String {
    found.map_or("more".into(), |found| found.to_string())
}

impl From<ReadProblem> for io::Error {
    fn from(problem: ReadProblem) -> Self {
        let kind = match problem {
            ReadProblem::NotAFile(_) => ErrorKind::InvalidInput,
            ReadProblem::TooLarge { .. } => ErrorKind::FileTooLarge,
            ReadProblem::NotText(_) => ErrorKind::InvalidData,
        };
        Self::new(kind, problem)
    }
}

/// The bytes of a file of at most `bytes_max`. Never waits for a peer, and takes no more memory than
/// the bound.
///
/// # Errors
/// The system's, or a [`ReadProblem`]: it is no file, or larger.
pub fn read(path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
    // A pipe that nobody writes to would be waited for when it is opened.
    let nonblocking = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
    let file = File::options().read(true).custom_flags(nonblocking).open(path)?;
    let metadata = file.metadata()?;
    if !metadata.is_file() {
        return Err(ReadProblem::NotAFile(kind(metadata.file_type())).into());
    }
    let too_large = |found| ReadProblem::TooLarge { most: bytes_max, found };
    if metadata.len() > bytes_max {
        return Err(too_large(Some(metadata.len())).into());
    }
    // It may have grown since; those of /proc say that they are empty.
    let mut bytes = Vec::with_capacity(usize::try_from(metadata.len()).unwrap_or(0) + 1);
    file.take(bytes_max + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > bytes_max {
        return Err(too_large(None).into());
    }
    Ok(bytes)
}

/// The text of a file of at most `bytes_max`, as [`read`].
///
/// # Errors
/// Those of [`read`], and [`ReadProblem::NotText`].
pub fn read_text(path: &Path, bytes_max: u64) -> io::Result<String> {
    let text = String::from_utf8(read(path, bytes_max)?);
    text.map_err(|error| ReadProblem::NotText(error.utf8_error().valid_up_to()).into())
}

/// The beginning of a parser's message, which may repeat whatever it met.
#[must_use]
pub fn shortened(message: &str) -> String {
    const CHARACTERS_MAX: usize = 500;
    match message.char_indices().nth(CHARACTERS_MAX) {
        Some((end, _)) => format!("{}…", &message[..end]),
        None => message.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(path: &str) -> String {
        read_text(Path::new(path), 4096).unwrap_err().to_string()
    }

    #[test]
    fn only_files_of_their_size_are_read() {
        assert_eq!(problem("/dev/zero"), "expected a file, found a device");
        assert_eq!(problem("/"), "expected a file, found a folder");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let text = |path: &Path| path.to_str().unwrap().to_owned();
        std::fs::write(&path, vec![b'a'; 4096]).unwrap();
        assert_eq!(read_text(&path, 4096).unwrap().len(), 4096);
        std::fs::write(&path, vec![b'a'; 4097]).unwrap();
        assert_eq!(problem(&text(&path)), "expected at most 4096 bytes, found 4097");
        // Terabytes that take no disk.
        File::create(&path).unwrap().set_len(1 << 42).unwrap();
        assert!(problem(&text(&path)).contains("found 4398046511104"));
        std::fs::write(&path, b"ab\xff").unwrap();
        assert!(problem(&text(&path)).contains("from byte 2 on"));
        // One of those that say they are empty.
        let maps = read(Path::new("/proc/self/maps"), 16).unwrap_err();
        assert_eq!(maps.kind(), ErrorKind::FileTooLarge);
        assert!(maps.to_string().ends_with("found more"));
        assert_eq!(read(Path::new("/no/such"), 1).unwrap_err().kind(), ErrorKind::NotFound);
    }

    #[test]
    fn a_long_message_is_shortened_between_characters() {
        assert_eq!(shortened("short"), "short");
        assert_eq!(shortened(&"ü".repeat(1000)).chars().count(), 501);
    }

    #[test]
    fn a_pipe_that_nobody_writes_to_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let mode = rustix::fs::Mode::from_raw_mode(0o600);
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, mode, 0).unwrap();
        assert_eq!(problem(pipe.to_str().unwrap()), "expected a file, found a pipe");
    }
}
