//! `controller soak`: runs a controller for a given time beside a publisher that is killed and
//! started again at random, and judges what it did: no allocations, flat memory, a schedule that does
//! not drift, and the skill followed again after every restart.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use thiserror::Error;
use tprmp_files::{Existing, WriteError, make_folder, outln, try_out, write};
use tprmp_messages::{
    ControlRequest, ControlVerb, ControllerStatus, Instance, LifeCycle, Reason, ServiceError,
    StatusPort, stop_flag,
};

/// Files of a run.
const CONTROLLER_LOG: &str = "controller.log";
const PUBLISHER_LOG: &str = "publisher.log";
const SUMMARY: &str = "controller.json";
const RESULT: &str = "soak.json";
/// Pause between two looks.
const LOOK: Duration = Duration::from_millis(20);
/// Time between two looks at the memory.
const MEMORY: Duration = Duration::from_secs(1);
/// After a restart the skill has to be followed again within this time, on a busy machine too.
const PATIENCE: Duration = Duration::from_secs(60);
/// A publisher lives at least and at most so long, after the skill is followed \[s\].
const LIFE_S: core::ops::Range<f64> = 0.5..5.0;
/// Memory may differ by so much between the beginning and the end \[KiB\].
const GROWTH_MAX_KIB: i64 = 256;

/// Why a soak could not be run.
#[derive(Debug, Error)]
pub enum SoakError {
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The signal handlers.
    #[error("signal handlers cannot be installed: {0}")]
    Signals(std::io::Error),
    /// A program cannot be started.
    #[error("`{program}` cannot be started: {source}")]
    Start {
        /// The program.
        program: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A log cannot be continued.
    #[error("`{path}` cannot be written: {source}")]
    Log {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The controller ended too early, or left no summary.
    #[error("the controller ended by itself, see `{log}`")]
    ControllerEnded {
        /// What it said.
        log: PathBuf,
    },
    /// What was asked does not hold.
    #[error("it did not hold: {}", _0.join("; "))]
    Failed(Vec<String>),
}

/// What to run, and for how long.
#[derive(Debug, Args)]
pub struct Soak {
    /// Configuration, e.g. config/controllers/planar.ron.
    config: String,
    /// Model that `learner train` wrote.
    #[arg(long)]
    model: String,
    /// How long.
    #[arg(long, default_value_t = 10.0)]
    minutes: f64,
    /// Of the random times.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Name that publisher and controller share.
    #[arg(long, default_value = "soak")]
    instance: String,
    /// Folder for logs and results (soak.json).
    #[arg(long)]
    out: PathBuf,
    /// Replace another run's files in this folder.
    #[arg(long)]
    force: bool,
    /// The publisher's command line; `{seed}` stands for a number that is another at each start.
    #[arg(last = true, required = true, value_name = "PUBLISHER")]
    publisher: Vec<String>,
}

/// What was observed of the controller from outside.
#[derive(Debug, Default)]
struct Observed {
    first: Option<ControllerStatus>,
    last: Option<ControllerStatus>,
    /// Resident memory, once a second \[KiB\].
    memory_kib: Vec<i64>,
    starts: u64,
    killed: u64,
    /// Whether somebody has to look at the controller.
    fault: bool,
}

/// When the tick of a status was due \[ns\].
fn due_ns(status: &ControllerStatus) -> i128 {
    let late =
        status.wake_up_ns + status.receiving_ns + status.evaluation_ns + status.publishing_ns;
    i128::from(status.time_ns) - i128::from(late)
}

impl Observed {
    /// Receives what has been published; whether the skill was followed in the last of it.
    fn receive(&mut self, port: &StatusPort) -> bool {
        let mut followed = false;
        while let Some(status) = port.status.receive() {
            followed = status.ticks > 0 && status.reason == Reason::None.to_wire();
            self.fault = status.life_cycle == LifeCycle::Fault.to_wire();
            // A tick that skipped periods was due before them.
            if status.ticks > 0 && status.wake_up_ns < status.period_ns {
                self.first.get_or_insert(*status);
                self.last = Some(*status);
            }
        }
        followed
    }

    /// How far the schedule is from its periods \[ns\].
    fn drift_ns(&self) -> Option<i128> {
        let (first, last) = self.first.as_ref().zip(self.last.as_ref())?;
        let slot = |status: &ControllerStatus| i128::from(status.ticks + status.skipped_periods);
        let periods = slot(last) - slot(first);
        Some(due_ns(last) - due_ns(first) - periods * i128::from(last.period_ns))
    }

    /// Growth of the memory from the second fifth of the time to the last \[KiB\].
    fn growth_kib(&self) -> Option<i64> {
        let fifth = self.memory_kib.len() / 5;
        let most = |samples: &[i64]| samples.iter().max().copied();
        let begin = most(self.memory_kib.get(fifth..(2 * fifth).max(fifth + 1))?)?;
        Some(most(&self.memory_kib[self.memory_kib.len() - fifth.max(1)..])? - begin)
    }
}

fn resident_kib(process: u32) -> Option<i64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// Continues a log.
fn log(path: &Path) -> Result<File, SoakError> {
    let file = File::options().append(true).open(path);
    file.map_err(|source| SoakError::Log { path: path.into(), source })
}

fn interrupt(child: &Child) {
    if let Some(process) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
        // One that has ended already needs no interrupt.
        let _ = kill_process(process, Signal::INT);
    }
}

/// A process that does not outlive this one's interest in it.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Soak {
    /// Runs it and prints the result. Ctrl-C ends it early; what was observed until then is judged.
    ///
    /// # Errors
    /// When something could not be run, or when something did not hold.
    pub fn run(&self) -> Result<(), SoakError> {
        let stop = stop_flag().map_err(SoakError::Signals)?;
        self.make_files()?;
        let port = Instance::new(&self.instance)?.open_status()?;
        let log_path = self.out.join(CONTROLLER_LOG);
        let summary_path = self.out.join(SUMMARY);
        let ended = || SoakError::ControllerEnded { log: log_path.clone() };
        let mut controller = Guarded(self.start_controller(&log_path, &summary_path)?);
        let mut observed = Observed::default();
        self.restart_publishers(&mut controller.0, &port, &mut observed, &stop, &ended)?;
        // The last publisher is gone: the loop ends by itself, at rest or after the longest time.
        interrupt(&controller.0);
        let status = controller.0.wait().map_err(|_| ended())?;
        let summary = std::fs::read_to_string(&summary_path).ok();
        let summary: Option<Value> = summary.and_then(|text| serde_json::from_str(&text).ok());
        let summary = summary.filter(|_| status.success()).ok_or_else(ended)?;
        self.judge(&observed, &summary)
    }

    /// Makes the folder and empty logs in it; all or none.
    fn make_files(&self) -> Result<(), SoakError> {
        make_folder(&self.out)?;
        let existing = Existing::unless(self.force);
        for name in [CONTROLLER_LOG, PUBLISHER_LOG, SUMMARY, RESULT] {
            try_out(&self.out.join(name), existing)?;
        }
        for name in [CONTROLLER_LOG, PUBLISHER_LOG] {
            write(&self.out.join(name), "", existing)?;
        }
        Ok(())
    }

    fn duration_s(&self) -> f64 {
        60.0 * self.minutes
    }

    fn start_controller(&self, log_path: &Path, summary: &Path) -> Result<Child, SoakError> {
        let log = log(log_path)?;
        let program = std::env::current_exe()
            .map_err(|source| SoakError::Start { program: "controller".into(), source })?;
        let child = Command::new(&program)
            .arg("run")
            .args([&self.config, "--model", &self.model])
            .args(["--instance", &self.instance, "--reset", "--trigger", "periodic", "--summary"])
            .arg(summary)
            .stdin(Stdio::null())
            .stderr(log)
            .spawn();
        let program = program.display().to_string();
        child.map_err(|source| SoakError::Start { program, source })
    }

    fn start_publisher(&self, seed: u64) -> Result<Child, SoakError> {
        let path = self.out.join(PUBLISHER_LOG);
        let log = log(&path)?;
        let output = log.try_clone().map_err(|source| SoakError::Log { path, source })?;
        let seed = seed.to_string();
        let mut words = self.publisher.iter().map(|word| word.replace("{seed}", &seed));
        let program = words.next().unwrap_or_default();
        Command::new(&program)
            .args(words)
            .stdin(Stdio::null())
            .stdout(output)
            .stderr(log)
            .spawn()
            .map_err(|source| SoakError::Start { program, source })
    }

    /// Starts a publisher, waits until the skill is followed, ends it after a random time; again and
    /// again until the time is over.
    fn restart_publishers(
        &self,
        controller: &mut Child,
        port: &StatusPort,
        observed: &mut Observed,
        stop: &AtomicBool,
        ended: &dyn Fn() -> SoakError,
    ) -> Result<(), SoakError> {
        let control = Instance::new(&self.instance)?.open_control_client()?;
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let begin = Instant::now();
        let over =
            || begin.elapsed().as_secs_f64() >= self.duration_s() || stop.load(Ordering::Relaxed);
        let mut memory = Instant::now();
        while !over() {
            observed.starts += 1;
            let mut publisher = Guarded(self.start_publisher(self.seed + observed.starts)?);
            let started = Instant::now();
            let mut end = None;
            // Statuses of the old publisher's time may still wait.
            observed.receive(port);
            while !over() && end.is_none_or(|end| Instant::now() < end) {
                thread::sleep(LOOK);
                if observed.receive(port) && end.is_none() {
                    let life_s = random.random_range(LIFE_S);
                    end = Some(Instant::now() + Duration::from_secs_f64(life_s));
                }
                // A publisher that begins elsewhere moves the arm in no time: that is looked at.
                if observed.fault {
                    let reset = ControlRequest::new(ControlVerb::Reset, "", 0.0);
                    let _ = control.ask(&reset, MEMORY);
                }
                if memory.elapsed() >= MEMORY {
                    memory = Instant::now();
                    observed.memory_kib.extend(resident_kib(controller.id()));
                }
                if controller.try_wait().map_err(|_| ended())?.is_some() {
                    return Err(ended());
                }
                if end.is_none() && started.elapsed() > PATIENCE {
                    let text = format!("the skill is not followed after start {}", observed.starts);
                    return Err(SoakError::Failed(vec![text]));
                }
                if publisher.0.try_wait().is_ok_and(|status| status.is_some()) {
                    break;
                }
            }
            if random.random_bool(0.5) {
                observed.killed += 1;
                drop(publisher);
            } else {
                interrupt(&publisher.0);
                let asked = Instant::now();
                while publisher.0.try_wait().is_ok_and(|status| status.is_none())
                    && asked.elapsed() < PATIENCE
                {
                    thread::sleep(LOOK);
                }
            }
        }
        Ok(())
    }

    /// Prints and writes what came out.
    fn judge(&self, observed: &Observed, summary: &Value) -> Result<(), SoakError> {
        let allocations = summary["allocations"].as_u64();
        let (drift_ns, growth_kib) = (observed.drift_ns(), observed.growth_kib());
        let mut failures = Vec::new();
        if allocations != Some(0) {
            failures.push(format!("{} allocations in steady state", summary["allocations"]));
        }
        match drift_ns {
            Some(0) => {}
            Some(drift_ns) => failures.push(format!("the schedule drifted by {drift_ns} ns")),
            None => failures.push("no tick was in time".into()),
        }
        match growth_kib {
            Some(growth) if growth <= GROWTH_MAX_KIB => {}
            Some(growth) => failures.push(format!("memory grew by {growth} KiB")),
            None => failures.push("the memory was not observed".into()),
        }
        let result = json!({
            "duration_s": self.duration_s(),
            "seed": self.seed,
            "publisher_starts": observed.starts,
            "publisher_kills": observed.killed,
            "ticks": summary["ticks"],
            "deadline_misses": summary["deadline_misses"],
            "skipped_periods": summary["skipped_periods"],
            "allocations": allocations,
            "connections": summary["connections"],
            "page_faults": summary["page_faults"],
            "memory_kib": observed.memory_kib.last(),
            "memory_growth_kib": growth_kib,
            "schedule_drift_ns": drift_ns.map(|ns| ns as i64),
            "ticks_by_reason": summary["ticks_by_reason"],
            "failures": failures,
        });
        // The folder is this run's by now.
        write(&self.out.join(RESULT), format!("{result:#}\n"), Existing::Replace)?;
        outln!("{result:#}");
        if failures.is_empty() { Ok(()) } else { Err(SoakError::Failed(failures)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tick of slot `slot`, late by `late`, on a schedule whose periods are `stretch` ns too long.
    fn status(ticks: u64, skipped: u64, late: u64, stretch: u64) -> ControllerStatus {
        let period_ns = 1_000_000;
        ControllerStatus {
            ticks,
            skipped_periods: skipped,
            period_ns,
            wake_up_ns: late,
            evaluation_ns: 700,
            time_ns: 5_000 + (ticks + skipped) * (period_ns + stretch) + late + 700,
            ..Default::default()
        }
    }

    #[test]
    fn drift_is_observed_whatever_was_late_or_skipped() {
        let drift = |stretch| {
            let (first, last) = (status(3, 0, 40, stretch), status(1_000_000, 17, 90_000, stretch));
            Observed { first: Some(first), last: Some(last), ..Default::default() }.drift_ns()
        };
        assert_eq!(drift(0), Some(0));
        assert_eq!(drift(1), Some(1_000_014));
        assert_eq!(Observed::default().drift_ns(), None);
    }

    #[test]
    fn growth_compares_the_end_with_the_time_after_the_start() {
        let observed = |memory_kib: Vec<i64>| Observed { memory_kib, ..Default::default() };
        let flat: Vec<i64> =
            (0..100).map(|i| if i < 15 { 100 * i } else { 2000 + i % 3 }).collect();
        assert_eq!(observed(flat).growth_kib(), Some(0));
        assert_eq!(observed((0..100).collect()).growth_kib(), Some(99 - 39));
        assert_eq!(observed(vec![]).growth_kib(), None);
    }

    #[test]
    fn the_memory_of_a_process_is_read() {
        assert!(resident_kib(std::process::id()).unwrap() > 500);
    }
}
