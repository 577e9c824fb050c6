//! What the loop measures about itself, in storage that exists before it starts.

use hdrhistogram::Histogram;
use serde_json::{Value, json};
use tprmp_messages::{LifeCycle, Reason};

/// Longest time the histograms tell apart \[ns\].
const TIME_MAX_NS: u64 = 10_000_000_000;

/// Histograms and counters of a run.
#[derive(Debug)]
pub struct Telemetry {
    compute: Histogram<u64>,
    wake_up: Histogram<u64>,
    state_age: Histogram<u64>,
    reasons: [u64; Reason::ALL.len()],
    /// Ticks so far.
    pub ticks: u64,
    /// Ticks that ended after their deadline.
    pub deadline_misses: u64,
}

/// The times of one tick.
#[derive(Debug, Clone, Copy)]
pub struct TickTimes {
    /// How late it woke up \[ns\].
    pub wake_up_ns: u64,
    /// Age of the state it used, `None` without one \[ns\].
    pub state_age_ns: Option<u64>,
    /// From wake-up to the command's publication \[ns\].
    pub compute_ns: u64,
}

impl Telemetry {
    /// Empty histograms. Allocates: at start-up only.
    #[must_use]
    pub fn new() -> Self {
        let histogram = || {
            Histogram::new_with_bounds(1, TIME_MAX_NS, 3)
                .expect("the bounds are constants that hdrhistogram accepts")
        };
        Self {
            compute: histogram(),
            wake_up: histogram(),
            state_age: histogram(),
            reasons: [0; Reason::ALL.len()],
            ticks: 0,
            deadline_misses: 0,
        }
    }

    /// Records a tick. No allocation.
    pub fn record(&mut self, times: &TickTimes, missed: bool, reason: Reason) {
        self.ticks += 1;
        self.deadline_misses += u64::from(missed);
        self.reasons[reason.to_wire() as usize] += 1;
        self.compute.saturating_record(times.compute_ns);
        self.wake_up.saturating_record(times.wake_up_ns);
        if let Some(age) = times.state_age_ns {
            self.state_age.saturating_record(age);
        }
    }

    /// The run in numbers, for people and programs.
    #[must_use]
    pub fn summary(&self, allocations: u64, last: LifeCycle) -> Value {
        let reasons: serde_json::Map<String, Value> = Reason::ALL
            .iter()
            .map(|r| (format!("{r:?}"), self.reasons[r.to_wire() as usize]))
            .filter(|(_, ticks)| *ticks > 0)
            .map(|(name, ticks)| (name, ticks.into()))
            .collect();
        json!({
            "life_cycle": format!("{last:?}"),
            "ticks": self.ticks,
            "deadline_misses": self.deadline_misses,
            "allocations": allocations,
            "tick_us": percentiles(&self.compute),
            "wake_up_us": percentiles(&self.wake_up),
            "state_age_us": percentiles(&self.state_age),
            "ticks_by_reason": reasons,
            "histograms": {
                "tick_us": buckets(&self.compute),
                "wake_up_us": buckets(&self.wake_up),
                "state_age_us": buckets(&self.state_age),
            },
        })
    }
}

impl Default for Telemetry {
    fn default() -> Self {
        Self::new()
    }
}

fn microseconds(ns: u64) -> f64 {
    ns as f64 * 1e-3
}

fn percentiles(histogram: &Histogram<u64>) -> Value {
    json!({
        "p50": microseconds(histogram.value_at_quantile(0.5)),
        "p99": microseconds(histogram.value_at_quantile(0.99)),
        "p999": microseconds(histogram.value_at_quantile(0.999)),
        "max": microseconds(histogram.max()),
    })
}

/// Logarithmic buckets, eight an octave: `[upper bound in µs, count]`.
fn buckets(histogram: &Histogram<u64>) -> Value {
    let mut merged: Vec<(f64, u64)> = Vec::new();
    for value in histogram.iter_recorded() {
        let octaves = (microseconds(value.value_iterated_to()).max(0.01).log2() * 8.0).ceil() / 8.0;
        let upper = octaves.exp2();
        match merged.last_mut() {
            Some((last, count)) if (*last - upper).abs() < 1e-9 => {
                *count += value.count_since_last_iteration();
            }
            _ => merged.push((upper, value.count_since_last_iteration())),
        }
    }
    json!(merged)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_counts_every_tick_once() {
        let mut telemetry = Telemetry::new();
        for i in 1..=1000_u64 {
            let times =
                TickTimes { wake_up_ns: 10 * i, state_age_ns: Some(5), compute_ns: 1000 * i };
            let reason = if i % 10 == 0 { Reason::StateStale } else { Reason::None };
            telemetry.record(&times, i > 990, reason);
        }
        let summary = telemetry.summary(3, LifeCycle::Done);
        assert_eq!(summary["ticks"], 1000);
        assert_eq!(summary["deadline_misses"], 10);
        assert_eq!(summary["allocations"], 3);
        assert_eq!(summary["ticks_by_reason"]["StateStale"], 100);
        let p50 = summary["tick_us"]["p50"].as_f64().unwrap();
        assert!((p50 - 500.0).abs() < 2.0, "{p50}");
        let counts: u64 = summary["histograms"]["tick_us"]
            .as_array()
            .unwrap()
            .iter()
            .map(|b| b[1].as_u64().unwrap())
            .sum();
        assert_eq!(counts, 1000);
    }
}
