//! One way to be stopped for every program on the shared memory.

use core::sync::atomic::AtomicBool;
use std::io::{self, Read};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use signal_hook::low_level::pipe;

/// Signals that come within this time are one: launchers and supervisors send theirs to a process
/// and to its group.
const TOGETHER: Duration = Duration::from_millis(500);
/// Stack of the thread that waits for signals, which locked memory holds \[bytes\].
const STACK_BYTES: usize = 64 << 10;

/// A flag that the first SIGINT, SIGTERM or SIGHUP sets. Another one that comes at least half a
/// second later ends the process at once, with the exit code 1. Asked for after the ports are
/// open, so that nothing replaces the handlers, and before a real-time priority is set, which the
/// thread that measures the half second would inherit.
///
/// # Errors
/// When the handlers cannot be installed, or the thread cannot be started.
pub fn stop_flag() -> io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let last = Arc::new(AtomicBool::new(false));
    let (mut come, comes) = UnixStream::pair()?;
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        register_conditional_shutdown(signal, 1, Arc::clone(&last))?;
        register(signal, Arc::clone(&stop))?;
        pipe::register(signal, comes.try_clone()?)?;
    }
    thread::Builder::new().name("signals".into()).stack_size(STACK_BYTES).spawn(move || {
        // An error has no signal behind it: the next one is then the first again.
        if come.read_exact(&mut [0]).is_ok() {
            thread::sleep(TOGETHER);
            last.store(true, core::sync::atomic::Ordering::Relaxed);
        }
    })?;
    Ok(stop)
}
