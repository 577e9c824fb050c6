//! What the loop measures about itself, in storage that exists before it starts.

use core::sync::atomic::{AtomicU32, Ordering};

use hdrhistogram::Histogram;
use serde_json::{Value, json};
use tprmp_messages::{LifeCycle, Reason};

use crate::detail::{Detail, SharedDetail, Snapshot, explain};
use crate::motion::caution::Slowed;
use crate::peers::Connections;
use crate::skill_leaf::Choice;
use crate::task::rounds::RoundsReport;
use crate::timing::realtime::PageFaults;

/// Longest time the histograms resolve \[ns\].
const TIME_MAX_NS: u64 = 10_000_000_000;
/// So many of the slowest ticks are kept with all their times.
const WORST_TICKS: usize = 16;

/// The times of one tick, one after the other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TickTimes {
    /// How late it woke up \[ns\].
    pub wake_up_ns: u64,
    /// Age of the state it used when it woke up, `None` without one \[ns\].
    pub state_age_ns: Option<u64>,
    /// From the wake-up until the messages are received; connecting to a new peer is part of it
    /// \[ns\].
    pub receiving_ns: u64,
    /// Checks, policy, limits and torques \[ns\].
    pub evaluation_ns: u64,
    /// Publishing the command \[ns\].
    pub publishing_ns: u64,
}

impl TickTimes {
    /// From the wake-up to the command's publication \[ns\].
    #[must_use]
    pub fn compute_ns(&self) -> u64 {
        self.receiving_ns + self.evaluation_ns + self.publishing_ns
    }

    /// From when the tick was due to the command's publication \[ns\].
    #[must_use]
    pub fn response_ns(&self) -> u64 {
        self.wake_up_ns.saturating_add(self.compute_ns())
    }
}

/// A tick and what came of it.
#[derive(Debug, Clone, Copy, Default)]
pub struct TickRecord {
    /// When the command was published \[ns\].
    pub time_ns: u64,
    /// Its times.
    pub times: TickTimes,
    /// Whether it ended after its deadline, or periods passed without one.
    pub missed: bool,
    /// Periods that passed without a tick before it.
    pub skipped: u64,
    /// Why the policy was not followed.
    pub reason: Reason,
}

/// The slowest ticks so far, the slowest first: a flight recorder of fixed size.
#[derive(Debug)]
struct WorstTicks {
    /// By what they are compared.
    time_ns: fn(&TickTimes) -> u64,
    /// Number and tick; the first `count` are in use.
    ticks: [(u64, TickRecord); WORST_TICKS],
    count: usize,
}

impl WorstTicks {
    fn new(time_ns: fn(&TickTimes) -> u64) -> Self {
        Self { time_ns, ticks: [(0, TickRecord::default()); WORST_TICKS], count: 0 }
    }

    fn record(&mut self, number: u64, tick: &TickRecord) {
        let time_ns = (self.time_ns)(&tick.times);
        let slower = |(_, other): &(u64, TickRecord)| (self.time_ns)(&other.times) >= time_ns;
        let place = self.ticks[..self.count].partition_point(slower);
        if place == WORST_TICKS {
            return;
        }
        self.count = (self.count + 1).min(WORST_TICKS);
        self.ticks[place..self.count].rotate_right(1);
        self.ticks[place] = (number, *tick);
    }

    fn summary(&self) -> Value {
        let tick = |(number, tick): &(u64, TickRecord)| {
            json!({
                "tick": number,
                "time_ns": tick.time_ns,
                "wake_up_us": microseconds(tick.times.wake_up_ns),
                "state_age_us": tick.times.state_age_ns.map(microseconds),
                "receiving_us": microseconds(tick.times.receiving_ns),
                "evaluation_us": microseconds(tick.times.evaluation_ns),
                "publishing_us": microseconds(tick.times.publishing_ns),
                "missed": tick.missed,
                "skipped_periods": tick.skipped,
                "reason": format!("{:?}", tick.reason),
            })
        };
        self.ticks[..self.count].iter().map(tick).collect()
    }
}

/// How a run came out.
#[derive(Debug, Clone, Copy)]
pub struct RunOutcome {
    /// Where the task stood before the stop.
    pub life_cycle: LifeCycle,
    /// States that are missing between those that arrived.
    pub states_lost: u64,
    /// Heap allocations inside the loop, without those that connected a peer.
    pub allocations: u64,
    /// Connections made inside the loop.
    pub connections: Connections,
    /// In which mode the task's skill was done, where it has several.
    pub mode: Option<ModeReport>,
    /// How a periodic skill went round; `None` for one that goes to a goal.
    pub rounds: Option<RoundsReport>,
    /// In how many ticks limits of what is near, of points and of power have slowed the arm down.
    pub slowed: Slowed,
    /// Page faults inside the loop, `None` where the system does not say.
    pub page_faults: Option<PageFaults>,
}

/// Life cycle and reason of the loop, for other threads: written and read without a lock.
#[derive(Debug, Default)]
pub struct SharedStatus {
    life_cycle: AtomicU32,
    reason: AtomicU32,
    choice: SharedChoice,
}

/// Which mode the task's skill is done in, and why. All zero where it has one only.
#[derive(Debug, Default)]
struct SharedChoice {
    /// Its number, from 1.
    mode: AtomicU32,
    modes: AtomicU32,
    /// 1 where the arm can follow it, 2 where it is free, 3 for both.
    prospect: AtomicU32,
    distance_mm: AtomicU32,
    out_of_reach: AtomicU32,
    blocked: AtomicU32,
}

/// Which mode the task's skill is done in, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModeReport {
    /// Its number, from 1.
    pub mode: u32,
    /// Of how many.
    pub modes: u32,
    /// Whether the arm can follow it.
    pub reachable: bool,
    /// Whether nothing is in the way.
    pub free: bool,
    /// How far the tool was from its path \[mm\].
    pub distance_mm: u32,
    /// Of all modes, how many the arm cannot follow, …
    pub out_of_reach: u32,
    /// … and how many others an obstacle is in the way of.
    pub blocked: u32,
}

impl std::fmt::Display for ModeReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { mode, modes, distance_mm, .. } = self;
        write!(f, "mode {mode} of {modes}: {distance_mm} mm from its path")?;
        f.write_str(match (self.reachable, self.free) {
            (true, true) => ", which the arm can follow and which is free",
            (true, false) => ", which the arm can follow; an obstacle is in the way of each mode",
            (false, _) => "; the arm can follow none of them to its end",
        })?;
        match (self.reachable, self.free, self.out_of_reach, self.blocked) {
            (false, ..) | (_, _, 0, 0) | (_, false, 0, _) => Ok(()),
            (_, true, beyond, blocked) if blocked > 0 => {
                write!(f, " ({beyond} out of reach, {blocked} with an obstacle in the way)")
            }
            (_, _, beyond, _) => write!(f, " ({beyond} out of reach)"),
        }
    }
}

impl SharedStatus {
    /// Stores life cycle and reason. No lock, no allocation.
    pub fn write(&self, life_cycle: LifeCycle, reason: Reason) {
        self.life_cycle.store(life_cycle.to_wire(), Ordering::Relaxed);
        self.reason.store(reason.to_wire(), Ordering::Relaxed);
    }

    /// Stores in which mode the task's skill is done. No lock, no allocation.
    pub fn write_choice(&self, choice: Option<&Choice>) {
        let Some(choice) = choice.filter(|choice| choice.modes > 1) else { return };
        let Choice { mode, modes, prospect, out_of_reach, blocked } = choice;
        let SharedChoice { mode: number, modes: count, prospect: verdict, distance_mm, .. } =
            &self.choice;
        self.choice.out_of_reach.store(*out_of_reach as u32, Ordering::Relaxed);
        self.choice.blocked.store(*blocked as u32, Ordering::Relaxed);
        let bits = u32::from(prospect.is_reachable()) + 2 * u32::from(prospect.is_free());
        distance_mm.store((1e3 * prospect.distance_m) as u32, Ordering::Relaxed);
        verdict.store(bits, Ordering::Relaxed);
        count.store(*modes as u32, Ordering::Relaxed);
        number.store(*mode as u32 + 1, Ordering::Release);
    }

    /// In which mode the task's skill is done; `None` where it has one only, and before it was decided.
    #[must_use]
    pub fn mode(&self) -> Option<ModeReport> {
        let SharedChoice { mode, modes, prospect, distance_mm, out_of_reach, blocked } =
            &self.choice;
        let mode = mode.load(Ordering::Acquire);
        let bits = prospect.load(Ordering::Relaxed);
        (mode > 0).then(|| ModeReport {
            mode,
            modes: modes.load(Ordering::Relaxed),
            reachable: bits & 1 != 0,
            free: bits & 2 != 0,
            distance_mm: distance_mm.load(Ordering::Relaxed),
            out_of_reach: out_of_reach.load(Ordering::Relaxed),
            blocked: blocked.load(Ordering::Relaxed),
        })
    }

    /// What was stored last.
    #[must_use]
    pub fn read(&self) -> (LifeCycle, Reason) {
        let life_cycle = LifeCycle::from_wire(self.life_cycle.load(Ordering::Relaxed));
        let reason = Reason::from_wire(self.reason.load(Ordering::Relaxed));
        (life_cycle.unwrap_or_default(), reason.unwrap_or_default())
    }
}

/// Histograms and counters of a run.
#[derive(Debug)]
pub struct Telemetry {
    tick: Histogram<u64>,
    wake_up: Histogram<u64>,
    state_age: Histogram<u64>,
    receiving: Histogram<u64>,
    evaluation: Histogram<u64>,
    publishing: Histogram<u64>,
    worst: WorstTicks,
    longest: WorstTicks,
    reasons: [u64; Reason::ALL.len()],
    /// The last one of each reason.
    details: [Detail; Reason::ALL.len()],
    /// Ticks so far.
    pub ticks: u64,
    /// Ticks that ended after their deadline or came after skipped periods.
    pub deadline_misses: u64,
    /// Periods that passed without a tick.
    pub skipped_periods: u64,
}

impl Telemetry {
    /// Empty histograms. Allocates: at start-up only.
    #[must_use]
    pub fn new() -> Self {
        let histogram = || {
            let mut histogram = Histogram::new_with_bounds(1, TIME_MAX_NS, 3)
                .expect("the bounds are constants that hdrhistogram accepts");
            // Writes to all its memory, so that no tick is the first to touch a page of it.
            histogram.reset();
            histogram
        };
        Self {
            tick: histogram(),
            wake_up: histogram(),
            state_age: histogram(),
            receiving: histogram(),
            evaluation: histogram(),
            publishing: histogram(),
            worst: WorstTicks::new(TickTimes::response_ns),
            longest: WorstTicks::new(TickTimes::compute_ns),
            reasons: [0; Reason::ALL.len()],
            details: [Detail::default(); Reason::ALL.len()],
            ticks: 0,
            deadline_misses: 0,
            skipped_periods: 0,
        }
    }

    /// Keeps what was seen beside a reason. No allocation.
    pub fn note(&mut self, detail: &Detail) {
        self.details[detail.reason.to_wire() as usize] = *detail;
    }

    /// What was seen beside each reason the last time, in words, by the reason's name.
    #[must_use]
    pub fn details(&self, shared: &SharedDetail) -> Value {
        let texts = self.details.iter().filter_map(|detail| {
            let newest = shared.read(detail.reason);
            let older = || Snapshot {
                detail: *detail,
                joints: shared.joints().to_vec(),
                ..Snapshot::default()
            };
            let text = explain(&newest.unwrap_or_else(older))?;
            Some((format!("{:?}", detail.reason), text.into()))
        });
        Value::Object(texts.collect())
    }

    /// Records a tick. No allocation.
    pub fn record(&mut self, tick: &TickRecord) {
        self.ticks += 1;
        self.deadline_misses += u64::from(tick.missed);
        self.skipped_periods += tick.skipped;
        self.reasons[tick.reason.to_wire() as usize] += 1;
        let times = &tick.times;
        self.tick.saturating_record(times.compute_ns());
        self.wake_up.saturating_record(times.wake_up_ns);
        self.receiving.saturating_record(times.receiving_ns);
        self.evaluation.saturating_record(times.evaluation_ns);
        self.publishing.saturating_record(times.publishing_ns);
        if let Some(age) = times.state_age_ns {
            self.state_age.saturating_record(age);
        }
        self.worst.record(self.ticks, tick);
        self.longest.record(self.ticks, tick);
    }

    /// The run in numbers, for people and programs.
    #[must_use]
    pub fn summary(&self, outcome: &RunOutcome) -> Value {
        let reasons: serde_json::Map<String, Value> = Reason::ALL
            .iter()
            .map(|r| (format!("{r:?}"), self.reasons[r.to_wire() as usize]))
            .filter(|(_, ticks)| *ticks > 0)
            .map(|(name, ticks)| (name, ticks.into()))
            .collect();
        let mut summary = json!({
            "life_cycle": format!("{:?}", outcome.life_cycle),
            "mode": outcome.mode.map(|mode| json!({
                "number": mode.mode,
                "of": mode.modes,
                "reachable": mode.reachable,
                "free": mode.free,
                "distance_mm": mode.distance_mm,
            })),
            "rounds": outcome.rounds.map(|rounds| json!({
                "done": rounds.done,
                "period_s": rounds.last.map(|last| last.period_s),
                "beside_max_mm": rounds.last.map(|last| 1e3 * last.beside_max_m),
            })),
            "ticks": self.ticks,
            "deadline_misses": self.deadline_misses,
            "skipped_periods": self.skipped_periods,
            "states_lost": outcome.states_lost,
            "slowed_ticks": {
                "clearance": outcome.slowed.clearance,
                "point_speed": outcome.slowed.point_speed,
                "point_acceleration": outcome.slowed.point_acceleration,
                "power": outcome.slowed.power,
            },
            "allocations": outcome.allocations,
            "connections": {
                "count": outcome.connections.count,
                "allocations": outcome.connections.allocations,
                "total_us": microseconds(outcome.connections.total_ns),
                "longest_us": microseconds(outcome.connections.longest_ns),
            },
            "page_faults": outcome.page_faults.map(|faults| json!({
                "minor": faults.minor,
                "major": faults.major,
            })),
            "ticks_by_reason": reasons,
            "worst_ticks": self.worst.summary(),
            "longest_ticks": self.longest.summary(),
            "histograms": {},
        });
        for (name, histogram) in [
            ("tick_us", &self.tick),
            ("wake_up_us", &self.wake_up),
            ("state_age_us", &self.state_age),
            ("receiving_us", &self.receiving),
            ("evaluation_us", &self.evaluation),
            ("publishing_us", &self.publishing),
        ] {
            summary[name] = percentiles(histogram);
            summary["histograms"][name] = buckets(histogram);
        }
        summary
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

    const RUNNING: RunOutcome = RunOutcome {
        slowed: Slowed { clearance: 0, point_speed: 0, point_acceleration: 0, power: 0 },
        mode: None,
        rounds: None,
        states_lost: 0,
        life_cycle: LifeCycle::Running,
        allocations: 0,
        connections: Connections { count: 0, allocations: 0, total_ns: 0, longest_ns: 0 },
        page_faults: None,
    };

    fn tick(evaluation_ns: u64) -> TickRecord {
        let times = TickTimes {
            wake_up_ns: 10,
            state_age_ns: Some(5),
            receiving_ns: 100,
            evaluation_ns,
            publishing_ns: 50,
        };
        TickRecord { times, ..Default::default() }
    }

    #[test]
    fn a_summary_counts_every_tick_once() {
        let mut telemetry = Telemetry::new();
        for i in 1..=1000_u64 {
            let reason = if i % 10 == 0 { Reason::StateStale } else { Reason::None };
            let skipped = if i == 1000 { 3 } else { 0 };
            telemetry.record(&TickRecord { missed: i > 990, reason, skipped, ..tick(1000 * i) });
        }
        let mut connections = Connections::default();
        connections.add(37, 45_000);
        connections.add(20, 15_000);
        let outcome = RunOutcome {
            slowed: Slowed { clearance: 3, ..Slowed::default() },
            states_lost: 7,
            life_cycle: LifeCycle::Done,
            mode: None,
            rounds: None,
            allocations: 3,
            connections,
            page_faults: Some(PageFaults { minor: 2, major: 1 }),
        };
        let summary = telemetry.summary(&outcome);
        assert_eq!(summary["life_cycle"], "Done");
        assert_eq!(summary["ticks"], 1000);
        assert_eq!(summary["deadline_misses"], 10);
        assert_eq!(summary["skipped_periods"], 3);
        assert_eq!(summary["allocations"], 3);
        let connections =
            json!({"count": 2, "allocations": 57, "total_us": 60.0, "longest_us": 45.0});
        assert_eq!(summary["connections"], connections);
        assert_eq!(summary["page_faults"], json!({"minor": 2, "major": 1}));
        assert_eq!(summary["ticks_by_reason"]["StateStale"], 100);
        let p50 = |name: &str| summary[name]["p50"].as_f64().unwrap();
        assert!((p50("tick_us") - 500.15).abs() < 2.0, "{}", p50("tick_us"));
        assert!((p50("evaluation_us") - 500.0).abs() < 2.0, "{}", p50("evaluation_us"));
        assert!((p50("publishing_us") - 0.05).abs() < 1e-3, "{}", p50("publishing_us"));
        for name in ["tick_us", "wake_up_us", "state_age_us", "receiving_us", "evaluation_us"] {
            let buckets = summary["histograms"][name].as_array().unwrap();
            let counts: u64 = buckets.iter().map(|b| b[1].as_u64().unwrap()).sum();
            assert_eq!(counts, 1000, "{name}");
        }
    }

    #[test]
    fn the_worst_ticks_are_kept_in_order_with_their_numbers() {
        let mut telemetry = Telemetry::new();
        // Each of 0 … 99 once, in a mixed order.
        for i in 0..100_u64 {
            telemetry.record(&tick(i * 37 % 100 * 1000));
        }
        let summary = telemetry.summary(&RUNNING);
        let worst = summary["worst_ticks"].as_array().unwrap();
        assert_eq!(worst.len(), WORST_TICKS);
        for (k, tick) in worst.iter().enumerate() {
            let evaluation = 99 - k as u64;
            assert_eq!(tick["evaluation_us"], evaluation as f64, "{tick}");
            let number = tick["tick"].as_u64().unwrap();
            assert_eq!((number - 1) * 37 % 100, evaluation, "{tick}");
            assert_eq!(tick["receiving_us"], 0.1, "{tick}");
        }
    }

    #[test]
    fn a_late_wake_up_does_not_hide_a_long_computation() {
        let mut telemetry = Telemetry::new();
        telemetry.record(&tick(500_000));
        for _ in 0..2 * WORST_TICKS {
            let mut late = tick(1000);
            late.times.wake_up_ns = 5_000_000;
            telemetry.record(&late);
        }
        let summary = telemetry.summary(&RUNNING);
        assert_eq!(summary["worst_ticks"][0]["wake_up_us"], 5000.0);
        assert_eq!(summary["longest_ticks"][0]["evaluation_us"], 500.0);
    }

    #[test]
    fn the_shared_status_keeps_what_was_written() {
        let status = SharedStatus::default();
        status.write(LifeCycle::Holding, Reason::FramesStale);
        assert_eq!(status.read(), (LifeCycle::Holding, Reason::FramesStale));
    }
}
