//! A disk without room: in a process of its own, whose files may not grow beyond a bound.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tprmp_files::{Existing, WriteError, write};

#[test]
fn what_was_there_stays_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("log.csv");
    write(&file, "before", Existing::Replace).unwrap();
    // The system's way to say that there is no more room is a signal, too.
    let full = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::clone(&full)).unwrap();
    let limit = getrlimit(Resource::Fsize);
    setrlimit(Resource::Fsize, Rlimit { current: Some(1000), ..limit }).unwrap();
    let error = write(&file, [b'x'; 2000], Existing::Replace).unwrap_err();
    setrlimit(Resource::Fsize, limit).unwrap();
    assert!(full.load(Ordering::Relaxed));
    assert!(matches!(error, WriteError::System { .. }));
    assert!(error.to_string().contains("log.csv` cannot be written: File too large"), "{error}");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "before");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}
