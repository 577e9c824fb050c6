//! One way to be stopped for every program on the shared memory.

use core::sync::atomic::AtomicBool;
use std::io;
use std::sync::Arc;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};

/// A flag that the first SIGINT, SIGTERM or SIGHUP sets; the second ends the process at once, with
/// the exit code 1. Asked for after the ports are open, so that nothing replaces the handlers.
///
/// # Errors
/// When the handlers cannot be installed.
pub fn stop_flag() -> io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        // In this order: a signal ends the process only where one has set the flag before.
        register_conditional_shutdown(signal, 1, Arc::clone(&stop))?;
        register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}
