//! What the machine grants, and what it takes away.

use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rustix::thread::{CpuSet, sched_getaffinity};
use serde_json::{Value, json};
use tprmp_controller::timing::realtime::{self, Granted, monotonic_ns};
use tprmp_model::controller_config::RealTime;

use crate::{FIFO_PRIORITY, Fallible};

/// Unit of the times in /proc/stat: `USER_HZ` is 100 a second.
const STAT_UNIT_MS: u64 = 10;
const SAMPLE: Duration = Duration::from_millis(10);
/// Stolen time shows up in /proc/stat some time after it was taken \[ns\].
const ACCOUNTED_WITHIN_NS: u64 = 100_000_000;

/// The kernel stops a thread of real-time priority that never sleeps: it looks and sleeps alternately
/// \[ns\].
const GAP_LOOK_NS: u64 = 500_000;
const GAPS_MAX: usize = 100_000;

/// The two cores that the parties are kept on.
#[derive(Debug, Clone, Copy)]
pub struct Cores {
    /// Of the publisher of states.
    pub publisher: usize,
    /// Of the controller, and of whatever it is compared with.
    pub controller: usize,
}

/// The first and the last core that this process may use.
///
/// # Errors
/// When there is only one: then publisher and controller would measure each other's absence.
pub fn cores() -> Fallible<Cores> {
    let allowed = sched_getaffinity(None)?;
    let mut cores = (0..CpuSet::MAX_CPU).filter(|cpu| allowed.is_set(*cpu));
    match (cores.next(), cores.next_back()) {
        (Some(publisher), Some(controller)) => Ok(Cores { publisher, controller }),
        _ => {
            Err("two cores are needed, for a publisher and a controller; this process may use one"
                .into())
        }
    }
}

/// Keeps the calling thread on a core, with memory locked and a real-time priority if one is given.
/// What is refused is in the result, which has to live as long as the thread measures.
pub fn enter(cpu: usize, fifo_priority: Option<u8>) -> Granted {
    realtime::set_up(&RealTime {
        fifo_priority,
        cpu: Some(cpu),
        lock_memory: fifo_priority.is_some(),
        cpu_latency_max_us: fifo_priority.map(|_| 0),
        required: Vec::new(),
    })
}

/// Why this process gets no real-time priority; `None` when it does.
pub fn fifo_refused() -> Option<String> {
    let attempt = || {
        let granted = realtime::set_up(&RealTime {
            fifo_priority: Some(FIFO_PRIORITY),
            cpu: None,
            lock_memory: false,
            cpu_latency_max_us: None,
            required: Vec::new(),
        });
        granted.denied.first().map(|denied| format!("{}; {}", denied.error, denied.remedy()))
    };
    // In a thread of its own, which takes the priority with it.
    thread::spawn(attempt).join().unwrap_or_else(|_| Some("the attempt failed".into()))
}

/// The machine as a row: what figures are worth depends on it.
pub fn description() -> Value {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let cpu_info = read("/proc/cpuinfo");
    let cpu = cpu_info.lines().find_map(|line| line.strip_prefix("model name"));
    let version = read("/proc/version");
    let real_time = read("/sys/kernel/realtime").trim() == "1";
    json!({
        "name": "machine",
        "cpu": cpu.map_or("", |text| text.trim_start_matches([' ', '\t', ':'])),
        "cores": thread::available_parallelism().map_or(0, usize::from),
        "kernel": version.split(" (").next().unwrap_or_default(),
        "preempt_rt": real_time,
        "virtual_machine": cpu_info.contains(" hypervisor"),
        "load_average": load_average(),
        "sched_rt_runtime_us": read("/proc/sys/kernel/sched_rt_runtime_us").trim(),
    })
}

/// Processes that wanted to run, averaged over the last minute.
pub fn load_average() -> Option<f64> {
    fs::read_to_string("/proc/loadavg").ok()?.split(' ').next()?.parse().ok()
}

/// Reads again and again how much time the hypervisor took from each core.
#[derive(Debug)]
pub struct StealWatch {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<StealLog>,
}

/// What a [`StealWatch`] saw of one core: times \[ns\] and counts \[ms\].
#[derive(Debug, Default)]
pub struct StealLog(Vec<(u64, u64)>);

impl StealWatch {
    /// Watches a core from now on.
    pub fn start(cpu: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let asked = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let mut log = StealLog::default();
            while !asked.load(Ordering::Relaxed) {
                log.sample(cpu);
                thread::sleep(SAMPLE);
            }
            log.sample(cpu);
            log
        });
        Self { stop, thread }
    }

    /// Ends the watch. Waits for what happened last to be accounted.
    pub fn stop(self) -> StealLog {
        thread::sleep(Duration::from_nanos(ACCOUNTED_WITHIN_NS));
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or_default()
    }
}

impl StealLog {
    fn sample(&mut self, cpu: usize) {
        let text = fs::read_to_string("/proc/stat").unwrap_or_default();
        if let Some(units) = stolen(&text, cpu) {
            self.0.push((monotonic_ns(), units * STAT_UNIT_MS));
        }
    }

    /// Time stolen from the core during the watch \[ms\].
    pub fn total_ms(&self) -> u64 {
        match (self.0.first(), self.0.last()) {
            (Some(first), Some(last)) => last.1 - first.1,
            _ => 0,
        }
    }

    /// Whether time was stolen about then, on `CLOCK_MONOTONIC`.
    pub fn near(&self, time_ns: u64) -> bool {
        let before = self.0.iter().rfind(|(t, _)| t + ACCOUNTED_WITHIN_NS < time_ns);
        let after = self.0.iter().find(|(t, _)| *t > time_ns + ACCOUNTED_WITHIN_NS);
        let before = before.or(self.0.first()).map(|(_, ms)| ms);
        let after = after.or(self.0.last()).map(|(_, ms)| ms);
        before != after
    }
}

/// Time that was taken from a thread which only looks at the clock: by the hypervisor, interrupts or
/// the scheduler.
#[derive(Debug, Default)]
pub struct Gaps {
    /// How long it looked \[ns\].
    pub looked_ns: u64,
    /// When a gap ended, on `CLOCK_MONOTONIC` \[ns\].
    pub ends_ns: Vec<u64>,
}

/// Looks for gaps in the time that a thread gets on a core, half of the time and for so long.
///
/// # Errors
/// When the thread fails.
pub fn gaps(
    cpu: usize,
    fifo_priority: Option<u8>,
    lasting: Duration,
    least_ns: u64,
) -> Fallible<Gaps> {
    let look = move || {
        let _granted = enter(cpu, fifo_priority);
        let mut gaps = Gaps { looked_ns: 0, ends_ns: Vec::with_capacity(GAPS_MAX) };
        let end_ns = monotonic_ns() + lasting.as_nanos() as u64;
        while monotonic_ns() < end_ns {
            let from_ns = monotonic_ns();
            let mut before_ns = from_ns;
            while before_ns < from_ns + GAP_LOOK_NS {
                let now_ns = monotonic_ns();
                if now_ns - before_ns >= least_ns && gaps.ends_ns.len() < GAPS_MAX {
                    gaps.ends_ns.push(now_ns);
                }
                before_ns = now_ns;
            }
            gaps.looked_ns += before_ns - from_ns;
            realtime::sleep_until(before_ns + GAP_LOOK_NS);
        }
        gaps
    };
    thread::spawn(look).join().map_err(|_| "looking for gaps failed".into())
}

/// The eighth number of a core's line in /proc/stat [`proc_stat(5)`].
fn stolen(stat: &str, cpu: usize) -> Option<u64> {
    let line = stat.lines().find_map(|line| line.strip_prefix(&format!("cpu{cpu} ")))?;
    line.split_ascii_whitespace().nth(7)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stolen_time_is_read_from_the_right_core_and_column() {
        let stat = "cpu  9 9 9 9 9 9 9 9 9 9\ncpu0 1 2 3 4 5 6 7 80 9 10\ncpu1 1 2 3 4 5 6 7 81 0 0\n\
                    cpu10 1 2 3 4 5 6 7 90 0 0\n";
        assert_eq!(stolen(stat, 1), Some(81));
        assert_eq!(stolen(stat, 10), Some(90));
        assert_eq!(stolen(stat, 2), None);
    }

    #[test]
    fn steal_is_near_a_tick_only_within_the_time_it_takes_to_be_accounted() {
        let ms = |t: u64| t * 1_000_000;
        let log = StealLog((0..100).map(|i| (ms(10 * i), if i > 50 { 20 } else { 0 })).collect());
        assert_eq!(log.total_ms(), 20);
        assert!(log.near(ms(500)) && log.near(ms(420)) && log.near(ms(600)));
        assert!(!log.near(ms(300)) && !log.near(ms(700)));
        assert!(!StealLog::default().near(0));
    }
}
