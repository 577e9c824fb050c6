//! The machine's clock.

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};

/// `CLOCK_MONOTONIC` \[ns\].
pub(crate) fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.cast_unsigned() * 1_000_000_000 + now.tv_nsec.cast_unsigned()
}

/// Sleeps until `CLOCK_MONOTONIC` reads `until_ns`; gives how late it became \[ns\].
pub(crate) fn sleep_until(until_ns: u64) -> u64 {
    let until = Timespec {
        tv_sec: (until_ns / 1_000_000_000).cast_signed(),
        tv_nsec: (until_ns % 1_000_000_000).cast_signed(),
    };
    // A signal that interrupts it is seen by the caller, in its flag.
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &until);
    monotonic_ns().saturating_sub(until_ns)
}
