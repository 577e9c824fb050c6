//! The clock of the loop, and what the system grants it.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};
use thread_priority::unix::{
    RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};
use thread_priority::{ThreadPriority, ThreadPriorityValue};
use tprmp_model::controller_config::RealTime;

/// Stack touched in advance, so that the loop meets no page fault there \[bytes\].
const STACK_BYTES: usize = 256 << 10;

/// `CLOCK_MONOTONIC` \[ns\].
#[must_use]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.cast_unsigned() * 1_000_000_000 + now.tv_nsec.cast_unsigned()
}

/// Sleeps until `CLOCK_MONOTONIC` reads `until_ns`, or a signal arrives.
pub fn sleep_until(until_ns: u64) {
    let until = Timespec {
        tv_sec: (until_ns / 1_000_000_000).cast_signed(),
        tv_nsec: (until_ns % 1_000_000_000).cast_signed(),
    };
    // Interrupted by a signal: the caller looks at the clock and at its stop flag.
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &until);
}

/// Asks the system for what the configuration wants. Returns a sentence for each thing that was
/// refused, with its remedy: the loop then runs without it.
#[must_use]
pub fn set_up(config: &RealTime) -> Vec<String> {
    let mut refused = Vec::new();
    if config.lock_memory
        && let Err(error) = lock_memory()
    {
        refused.push(format!(
            "memory is not locked ({error}): allow it with `ulimit -l unlimited`, or \
             `<user> - memlock unlimited` in /etc/security/limits.conf"
        ));
    }
    touch_stack();
    if let Some(priority) = config.fifo_priority
        && let Err(error) = fifo(priority)
    {
        refused.push(format!(
            "the loop has no real-time priority ({error}): allow it with \
             `<user> - rtprio 99` in /etc/security/limits.conf, or CAP_SYS_NICE"
        ));
    }
    refused
}

/// Locks all memory of the process, now and in future.
pub(crate) fn lock_memory() -> rustix::io::Result<()> {
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
}

/// Gives the calling thread SCHED_FIFO with this priority.
pub(crate) fn fifo(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority).map_err(|e| format!("{e:?}"))?;
    set_thread_priority_and_policy(
        thread_native_id(),
        ThreadPriority::Crossplatform(value),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .map_err(|e| format!("{e:?}"))
}

fn touch_stack() {
    let mut stack = [0_u8; STACK_BYTES];
    for byte in stack.iter_mut().step_by(4096) {
        *byte = 1;
    }
    core::hint::black_box(&stack);
}
