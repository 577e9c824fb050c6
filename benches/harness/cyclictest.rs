//! `cyclictest` of rt-tests: how late a thread wakes up that does nothing else.

use std::fs;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::statistics::{Buckets, Misses};
use crate::{Fallible, results};

/// Later wake-ups are counted together \[µs\].
const LATEST_US: u64 = 100_000;

/// What it is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Core.
    pub cpu: usize,
    /// Time between two wake-ups \[µs\].
    pub period_us: u64,
    /// Number of wake-ups.
    pub cycles: u64,
    /// Real-time priority.
    pub fifo_priority: Option<u8>,
}

/// What it found.
#[derive(Debug, Clone, Default)]
pub struct Lateness {
    /// Times by which it woke up late.
    pub buckets: Buckets,
    /// Wake-ups that were later than the period.
    pub misses: Misses,
    /// The latest \[µs\].
    pub max_us: f64,
}

/// Why it cannot be run here; `None` when it can.
pub fn refused(cpu: usize) -> Option<String> {
    let settings = Settings { cpu, period_us: 1000, cycles: 1, fifo_priority: None };
    // It asks for real-time rights before it looks at its options.
    let mut attempt = command(&settings);
    match attempt.stdin(Stdio::null()).output() {
        Ok(output) if output.status.success() => None,
        Ok(output) => Some(format!("it ends with: {}", first_line(&output.stderr))),
        Err(error) => Some(format!("{error}; Debian and Ubuntu have it in the package rt-tests")),
    }
}

fn first_line(text: &[u8]) -> String {
    String::from_utf8_lossy(text).trim().lines().next().unwrap_or_default().into()
}

fn command(settings: &Settings) -> Command {
    let mut command = Command::new("cyclictest");
    command
        .args(["--quiet", "--threads=1", "--histfile=/dev/null"])
        .arg(format!("--affinity={}", settings.cpu))
        .arg(format!("--interval={}", settings.period_us))
        .arg(format!("--loops={}", settings.cycles))
        .arg(format!("--histogram={LATEST_US}"));
    match settings.fifo_priority {
        Some(priority) => {
            command.arg("--mlockall").arg("--policy=fifo").arg(format!("--priority={priority}"))
        }
        // As the controller without a priority: it does not tune the system.
        None => command.args(["--policy=other", "--default-system"]),
    };
    command
}

/// Runs it.
///
/// # Errors
/// When it fails, with its first line of error, or writes something else than expected.
pub fn run(settings: &Settings) -> Fallible<Lateness> {
    let report = results::folder().join("cyclictest.json");
    let mut command = command(settings);
    command.arg(format!("--json={}", report.display()));
    let output = command.stdin(Stdio::null()).output()?;
    if !output.status.success() {
        let error = first_line(&output.stderr);
        return Err(format!("cyclictest failed ({}): {error}", output.status).into());
    }
    let json = serde_json::from_str(&fs::read_to_string(&report)?)?;
    parse(&json, settings.period_us)
        .ok_or_else(|| format!("`{}`: expected a thread's histogram", report.display()).into())
}

fn parse(report: &Value, period_us: u64) -> Option<Lateness> {
    let thread = report.get("thread")?.get("0")?;
    let cycles = thread.get("cycles")?.as_u64()?;
    let max_us = thread.get("max")?.as_f64()?;
    // Whole microseconds, rounded down.
    let bucket =
        |(us, count): (&String, &Value)| Some((us.parse::<f64>().ok()? + 1.0, count.as_u64()?));
    let mut pairs: Vec<_> =
        thread.get("histogram")?.as_object()?.iter().map(bucket).collect::<Option<_>>()?;
    let counted: u64 = pairs.iter().map(|(_, count)| count).sum();
    pairs.push((max_us.max(LATEST_US as f64) + 1.0, cycles.saturating_sub(counted)));
    let buckets = Buckets::new(pairs);
    let misses = Misses { late: buckets.above(period_us as f64), cycles };
    Some(Lateness { buckets, misses, max_us })
}

impl Lateness {
    /// Adds those of another run.
    pub fn add(&mut self, other: &Self) {
        self.buckets.add(&other.buckets);
        self.misses.add(other.misses);
        self.max_us = self.max_us.max(other.max_us);
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn late_wake_ups_are_counted_also_beyond_the_histogram() {
        let report = json!({ "thread": { "0": {
            "histogram": { "7": 90, "999": 3, "1000": 2, "5000": 1 },
            "cycles": 98, "min": 7, "max": 123_456, "avg": 30.0,
        } } });
        let found = parse(&report, 1000).unwrap();
        assert_eq!((found.misses.late, found.misses.cycles), (5, 98));
        assert_eq!(found.max_us, 123_456.0);
        assert_eq!(found.buckets.total(), 98);
        assert!(parse(&json!({ "thread": {} }), 1000).is_none());
    }
}
