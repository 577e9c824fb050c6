//! The clock of the loop, and the capabilities that the system grants it.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{ClockId, CpuSet, clock_nanosleep_absolute, sched_setaffinity};
use rustix::time::{Timespec, clock_gettime};
use thread_priority::unix::{
    RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};
use thread_priority::{ThreadPriority, ThreadPriorityValue};
use tprmp_model::controller_config::{Capability, RealTime};

/// Stack touched in advance, so that the loop meets no page fault there \[bytes\].
const STACK_BYTES: usize = 256 << 10;
const CPU_LATENCY: &str = "/dev/cpu_dma_latency";

/// `CLOCK_MONOTONIC` \[ns\].
#[must_use]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.cast_unsigned() * 1_000_000_000 + now.tv_nsec.cast_unsigned()
}

/// Sleeps until `CLOCK_MONOTONIC` reads `until_ns`, also when a signal interrupts it.
pub fn sleep_until(until_ns: u64) {
    let until = Timespec {
        tv_sec: (until_ns / 1_000_000_000).cast_signed(),
        tv_nsec: (until_ns % 1_000_000_000).cast_signed(),
    };
    while clock_nanosleep_absolute(ClockId::Monotonic, &until) == Err(rustix::io::Errno::INTR) {}
}

/// Waits busily until `CLOCK_MONOTONIC` reads `until_ns`. The caller bounds how long that is.
pub fn spin_until(until_ns: u64) {
    while monotonic_ns() < until_ns {
        core::hint::spin_loop();
    }
}

/// A capability that the system denied.
#[derive(Debug, Clone)]
pub struct Denied {
    /// What was asked for.
    pub capability: Capability,
    /// What the system said.
    pub error: String,
}

impl Denied {
    /// What it means for the loop.
    #[must_use]
    pub fn effect(&self) -> &'static str {
        match self.capability {
            Capability::FifoPriority => "the loop has no real-time priority",
            Capability::Cpu => "the loop is not kept on its core",
            Capability::LockMemory => "memory is not locked",
            Capability::CpuLatency => "cores may fall asleep deeply between ticks",
        }
    }

    /// What helps.
    #[must_use]
    pub fn remedy(&self) -> &'static str {
        match self.capability {
            Capability::FifoPriority => {
                "add `<user> - rtprio 99` to /etc/security/limits.conf and log in again, or give \
                 the binary CAP_SYS_NICE"
            }
            Capability::Cpu => {
                "set real_time.cpu to a core that this process may use, see `taskset -p $$`"
            }
            Capability::LockMemory => {
                "add `<user> - memlock unlimited` to /etc/security/limits.conf and log in again"
            }
            Capability::CpuLatency => {
                "let the user write to /dev/cpu_dma_latency, by a udev rule: \
                 KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\""
            }
        }
    }
}

impl std::fmt::Display for Denied {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}): {}", self.effect(), self.error, self.remedy())
    }
}

/// What stays granted while this lives.
#[derive(Debug)]
pub struct Granted {
    /// What the system denied.
    pub denied: Vec<Denied>,
    /// The kernel keeps the latency for as long as the file is open.
    _cpu_latency: Option<File>,
}

/// Asks the system for what the configuration wants, for the calling thread and the process.
#[must_use]
pub fn set_up(config: &RealTime) -> Granted {
    let mut denied = Vec::new();
    let mut note = |capability, result: Result<(), String>| {
        if let Err(error) = result {
            denied.push(Denied { capability, error });
        }
    };
    let mut held = None;
    if let Some(latency_us) = config.cpu_latency_max_us {
        let file = hold_cpu_latency(latency_us);
        note(Capability::CpuLatency, file.map(|file| held = Some(file)));
    }
    if let Some(cpu) = config.cpu {
        note(Capability::Cpu, pin(cpu));
    }
    touch_stack();
    if config.lock_memory {
        note(Capability::LockMemory, lock_memory());
    }
    // Last: what comes before may take its time.
    if let Some(priority) = config.fifo_priority {
        note(Capability::FifoPriority, fifo(priority));
    }
    Granted { denied, _cpu_latency: held }
}

/// Locks all memory of the process, now and in future.
fn lock_memory() -> Result<(), String> {
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|e| e.to_string())
}

/// Keeps the calling thread on one core.
fn pin(cpu: usize) -> Result<(), String> {
    if cpu >= CpuSet::MAX_CPU {
        return Err(format!("there is no core {cpu}"));
    }
    let mut set = CpuSet::new();
    set.set(cpu);
    sched_setaffinity(None, &set).map_err(|e| format!("core {cpu}: {e}"))
}

/// Gives the calling thread SCHED_FIFO with this priority.
fn fifo(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority).map_err(|e| format!("{e:?}"))?;
    set_thread_priority_and_policy(
        thread_native_id(),
        ThreadPriority::Crossplatform(value),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .map_err(|e| format!("{e:?}"))
}

/// Asks that cores wake up within this time, for as long as the file is open.
fn hold_cpu_latency(latency_us: u32) -> Result<File, String> {
    let text = |e: std::io::Error| format!("{CPU_LATENCY}: {e}");
    let mut file = OpenOptions::new().write(true).open(CPU_LATENCY).map_err(text)?;
    // The kernel wants a signed 32-bit number.
    let latency_us = i32::try_from(latency_us).unwrap_or(i32::MAX);
    file.write_all(&latency_us.to_ne_bytes()).map_err(text)?;
    Ok(file)
}

fn touch_stack() {
    let mut stack = [0_u8; STACK_BYTES];
    for byte in stack.iter_mut().step_by(4096) {
        *byte = 1;
    }
    core::hint::black_box(&stack);
}

/// Page faults of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageFaults {
    /// Answered from memory.
    pub minor: u64,
    /// Answered from a disk.
    pub major: u64,
}

impl PageFaults {
    /// Those of the calling thread since it began, `None` where the system does not say. Does not
    /// allocate, but reads a file: not for the loop.
    #[must_use]
    pub fn of_this_thread() -> Option<Self> {
        let mut text = [0_u8; 512];
        let mut file = File::open("/proc/thread-self/stat").ok()?;
        let length = file.read(&mut text).ok()?;
        Self::parse(core::str::from_utf8(&text[..length]).ok()?)
    }

    /// Fields 10 and 12 of proc_pid_stat(5); the second field is a name in parentheses that may hold
    /// anything.
    fn parse(stat: &str) -> Option<Self> {
        let mut fields = stat[stat.rfind(')')? + 1..].split_ascii_whitespace().skip(7);
        let minor = fields.next()?.parse().ok()?;
        let major = fields.nth(1)?.parse().ok()?;
        Some(Self { minor, major })
    }

    /// Those after `before`.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        Self { minor: self.minor - before.minor, major: self.major - before.major }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_faults_are_read_whatever_the_thread_is_called() {
        let text = "71 (a) b (c) R 1 71 71 34 71 4194304 1043 5 7 6 0 0 0 0 20 0 1 0";
        assert_eq!(PageFaults::parse(text), Some(PageFaults { minor: 1043, major: 7 }));
        assert_eq!(PageFaults::parse("71 (a) R 1 71"), None);
    }

    #[test]
    fn memory_that_is_touched_for_the_first_time_faults() {
        let before = PageFaults::of_this_thread().expect("Linux counts them");
        let memory = vec![0_u8; 64 << 20];
        let sum: u64 = memory.iter().step_by(4096).map(|byte| u64::from(*byte)).sum();
        let after = PageFaults::of_this_thread().expect("Linux counts them");
        assert_eq!(core::hint::black_box(sum), 0);
        // With huge pages fewer than one a page of 4 KiB.
        assert!(after.since(&before).minor >= 32, "{before:?} {after:?}");
    }

    #[test]
    fn a_sleep_and_a_spin_end_after_their_time_and_not_before() {
        for wait in [sleep_until, spin_until] {
            let until = monotonic_ns() + 2_000_000;
            wait(until);
            assert!(monotonic_ns() >= until);
        }
    }

    #[test]
    fn a_denied_capability_is_reported_with_its_remedy() {
        let error = pin(CpuSet::MAX_CPU).unwrap_err();
        let text = Denied { capability: Capability::Cpu, error }.to_string();
        assert!(text.contains("there is no core") && text.contains("real_time.cpu"), "{text}");
    }
}
