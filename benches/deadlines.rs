//! Missed deadlines of the real controller, by rate, load, wait and scheduler; each row in
//! alternation with `cyclictest` on the same core, and with the time that the hypervisor took.
//!
//! A publisher is kept on one core, the controller on another. A deadline is missed when the command
//! is not out within a period of the tick's due time; `cyclictest` misses when it wakes up later
//! than that.
//!
//! /proc/stat counts steal in steps of 10 ms, so that a short theft is not seen. How often a thread of
//! the same priority that only looks at the clock loses as much time is what a slow tick is compared with.

use std::time::Duration;

use clap::{Parser, ValueEnum};
use serde_json::{Map, Value, json};
use tprmp_bench::controller::{Controller, Settings, Trigger};
use tprmp_bench::cyclictest::{self, Lateness};
use tprmp_bench::machine::{self, Cores, StealWatch};
use tprmp_bench::results::{self, Verdict};
use tprmp_bench::robot::Skill;
use tprmp_bench::role::{Helper, Role};
use tprmp_bench::statistics::{Buckets, Misses, compare_misses, rounded};
use tprmp_bench::{FIFO_PRIORITY, Fallible};
use tprmp_messages::Instance;

const RATES_HZ: [u64; 6] = [250, 500, 1000, 2000, 4000, 10_000];
/// The rate at which misses are judged \[Hz\].
const JUDGED_HZ: u64 = 1000;
/// Longest spin \[ns\]; never more than half a period.
const SPIN_NS: u64 = 80_000;
/// Evaluation and publishing of a tick take at most so long \[µs\].
const COMPUTE_MAX_US: f64 = 100.0;
/// The controller's misses are at most so many times cyclictest's.
const MISS_FACTOR: f64 = 1.2;
/// Gaps are looked for during such a part of a block.
const GAPS_FRACTION: f64 = 0.25;
/// So many of the worst ticks stay in a row.
const WORST_TICKS: usize = 8;
/// Phases of a tick in the controller's summary.
const PHASES: [&str; 5] = ["wake_up", "state_age", "receiving", "evaluation", "publishing"];

/// Deadline misses.
#[derive(Debug, Parser)]
struct Arguments {
    /// 10⁵ cycles in each row at 1 kHz and above: two hours.
    #[arg(long)]
    full: bool,
    /// Rates \[Hz\].
    #[arg(long, value_delimiter = ',', default_values_t = RATES_HZ)]
    rates: Vec<u64>,
    /// Loads.
    #[arg(long, value_delimiter = ',', default_values = ["idle", "neighbour", "both"])]
    loads: Vec<Load>,
    /// Schedulers.
    #[arg(long, value_delimiter = ',', default_values = ["other", "fifo"])]
    schedulers: Vec<Scheduler>,
    /// How the loop waits.
    #[arg(long, value_delimiter = ',', default_values = ["sleep", "spin"])]
    waits: Vec<Wait>,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Load {
    /// Publisher and controller alone.
    Idle,
    /// A busy process on the publisher's core.
    Neighbour,
    /// A busy process on each of the two cores.
    Both,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Scheduler {
    /// SCHED_OTHER.
    Other,
    /// SCHED_FIFO.
    Fifo,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Wait {
    /// Sleeps until a tick is due.
    Sleep,
    /// Sleeps until shortly before, then spins.
    Spin,
}

impl Load {
    fn text(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Neighbour => "other core busy",
            Self::Both => "both cores busy",
        }
    }

    fn start(self, cores: Cores) -> Fallible<Vec<Helper>> {
        let busy: &[usize] = match self {
            Self::Idle => &[],
            Self::Neighbour => &[cores.publisher],
            Self::Both => &[cores.publisher, cores.controller],
        };
        busy.iter().map(|cpu| Role::Neighbour { cpu: *cpu }.start()).collect()
    }
}

impl Scheduler {
    fn text(self) -> &'static str {
        match self {
            Self::Other => "SCHED_OTHER",
            Self::Fifo => "SCHED_FIFO",
        }
    }

    fn fifo_priority(self) -> Option<u8> {
        (self == Self::Fifo).then_some(FIFO_PRIORITY)
    }
}

impl Wait {
    fn text(self) -> &'static str {
        match self {
            Self::Sleep => "sleep",
            Self::Spin => "sleep+spin",
        }
    }
}

/// What a row is about.
#[derive(Debug, Clone, Copy)]
struct Case {
    rate_hz: u64,
    load: Load,
    wait: Wait,
    scheduler: Scheduler,
}

impl Case {
    fn period_ns(self) -> u64 {
        1_000_000_000 / self.rate_hz
    }

    fn spin_ns(self) -> u64 {
        match self.wait {
            Wait::Sleep => 0,
            Wait::Spin => SPIN_NS.min(self.period_ns() / 2),
        }
    }

    fn name(self) -> String {
        let Self { rate_hz, load, wait, scheduler } = self;
        format!("{rate_hz} Hz, {}, {}, {}", load.text(), wait.text(), scheduler.text())
    }

    /// Number of alternations, and how long each side of one lasts \[s\].
    fn blocks(self, full: bool) -> (u32, f64) {
        if full {
            let seconds = if self.rate_hz >= 1000 { 1e5 / self.rate_hz as f64 } else { 30.0 };
            (4, seconds.max(20.0) / 4.0)
        } else {
            (1, 0.6)
        }
    }
}

/// A tick of the controller's flight recorder.
#[derive(Debug, Clone)]
struct SlowTick {
    time_ns: u64,
    response_us: f64,
    compute_us: f64,
    stolen: bool,
    phases: Value,
}

/// What was found in the blocks of a row.
struct Found {
    case: Case,
    phases: [Buckets; PHASES.len()],
    max_us: [f64; PHASES.len()],
    misses: Misses,
    skipped: u64,
    not_followed: u64,
    steal_ms: u64,
    worst: Vec<SlowTick>,
    cyclictest: Option<Lateness>,
    cyclictest_steal_ms: u64,
    /// Gaps without steal that would make a tick slow.
    gaps: u64,
    looked_ns: u64,
}

impl Found {
    fn new(case: Case) -> Self {
        Self {
            case,
            phases: Default::default(),
            max_us: [0.0; PHASES.len()],
            misses: Misses::default(),
            skipped: 0,
            not_followed: 0,
            steal_ms: 0,
            worst: Vec::new(),
            cyclictest: None,
            cyclictest_steal_ms: 0,
            gaps: 0,
            looked_ns: 0,
        }
    }

    /// Takes in the controller's summary of a block.
    fn add(&mut self, summary: &Value, steal: &machine::StealLog) -> Option<()> {
        for (i, phase) in PHASES.iter().enumerate() {
            let key = format!("{phase}_us");
            self.phases[i].add(&Buckets::from_json(&summary["histograms"][&key])?);
            self.max_us[i] = self.max_us[i].max(summary[&key]["max"].as_f64()?);
        }
        let late = summary["deadline_misses"].as_u64()?;
        let cycles = summary["ticks"].as_u64()?;
        self.misses.add(Misses { late, cycles });
        self.skipped += summary["skipped_periods"].as_u64()?;
        let followed = summary["ticks_by_reason"]["None"].as_u64().unwrap_or(0);
        self.not_followed += cycles - followed;
        self.steal_ms += steal.total_ms();
        // The slowest answers and the longest computations; a tick may be both.
        for tick in ["worst_ticks", "longest_ticks"]
            .iter()
            .filter_map(|key| summary[key].as_array())
            .flatten()
        {
            let us = |key: &str| tick[key].as_f64();
            let compute_us = us("evaluation_us")? + us("publishing_us")?;
            let time_ns = tick["time_ns"].as_u64()?;
            if self.worst.iter().any(|t| t.time_ns == time_ns) {
                continue;
            }
            let stolen = steal.near(time_ns);
            let mut phases = tick.clone();
            phases["steal"] = stolen.into();
            self.worst.push(SlowTick {
                time_ns,
                response_us: us("wake_up_us")? + us("receiving_us")? + compute_us,
                compute_us,
                stolen,
                phases,
            });
        }
        Some(())
    }

    /// Ticks that computed too long: all of them, and those known to be without steal.
    fn slow(&self) -> (u64, u64) {
        let [.., evaluation, publishing] = &self.phases;
        let slow = |t: &&SlowTick| t.compute_us > COMPUTE_MAX_US;
        let recorded = self.worst.iter().filter(slow).count() as u64;
        let in_buckets = evaluation.above(COMPUTE_MAX_US).max(publishing.above(COMPUTE_MAX_US));
        let unexplained = self.worst.iter().filter(slow).filter(|t| !t.stolen).count() as u64;
        (recorded.max(in_buckets), unexplained)
    }

    /// What evaluation and publishing mostly take \[µs\].
    fn compute_us(&self) -> f64 {
        self.phases[3].quantile(0.5) + self.phases[4].quantile(0.5)
    }

    fn misses_verdict(&self) -> Option<Verdict> {
        let reference = self.cyclictest.as_ref()?.misses;
        (self.case.rate_hz == JUDGED_HZ)
            .then(|| compare_misses(self.misses, reference, MISS_FACTOR))
    }

    fn row(&self) -> Value {
        let case = self.case;
        let mut row = Map::new();
        for (key, value) in [
            ("name", json!(case.name())),
            ("rate_hz", json!(case.rate_hz)),
            ("load", json!(case.load.text())),
            ("wait", json!(case.wait.text())),
            ("spin_us", json!(case.spin_ns() / 1000)),
            ("scheduler", json!(case.scheduler.text())),
            ("cycles", json!(self.misses.cycles)),
            ("misses", json!(self.misses.late)),
            ("skipped_periods", json!(self.skipped)),
            ("policy_not_followed", json!(self.not_followed)),
            ("steal_ms", json!(self.steal_ms)),
            ("slow_ticks", json!(self.slow().0)),
            ("slow_ticks_without_steal", json!(self.slow().1)),
            ("gaps_without_steal", json!(self.gaps)),
            ("gaps_looked_ms", json!(self.looked_ns / 1_000_000)),
        ] {
            row.insert(key.into(), value);
        }
        let mut histograms = Map::new();
        for (i, phase) in PHASES.iter().enumerate() {
            // What can be compared with cyclictest is the row's own.
            let prefix = if i == 0 { String::new() } else { format!("{phase}_") };
            row.extend(self.phases[i].percentiles(&prefix));
            row.insert(format!("{prefix}max_us"), rounded(self.max_us[i]));
            histograms.insert((*phase).into(), self.phases[i].to_json());
        }
        if let Some(reference) = &self.cyclictest {
            row.extend(reference.buckets.percentiles("cyclictest_"));
            row.insert("cyclictest_max_us".into(), rounded(reference.max_us));
            row.insert("cyclictest_misses".into(), reference.misses.late.into());
            row.insert("cyclictest_cycles".into(), reference.misses.cycles.into());
            row.insert("cyclictest_steal_ms".into(), self.cyclictest_steal_ms.into());
            histograms.insert("cyclictest".into(), reference.buckets.to_json());
        }
        row.insert("histograms_us".into(), histograms.into());
        let worst = self.worst.iter().take(WORST_TICKS).map(|t| t.phases.clone());
        row.insert("worst_ticks".into(), worst.collect());
        if let Some(verdict) = self.misses_verdict() {
            row.insert("verdict".into(), json!(verdict));
        }
        row.into()
    }
}

fn measure(case: Case, cores: Cores, full: bool, compared: bool) -> Fallible<Found> {
    let instance = format!("bench-deadlines-{}", std::process::id());
    let (skill, fifo_priority) = (Skill::Pick, case.scheduler.fifo_priority());
    let period_ns = case.period_ns();
    let _publisher = Role::Publisher {
        skill,
        instance: instance.clone(),
        period_ns,
        cpu: cores.publisher,
        fifo_priority,
    }
    .start()?;
    let mut found = Found::new(case);
    let (blocks, block_s) = case.blocks(full);
    let cpu = cores.controller;
    for _ in 0..blocks {
        let steal = StealWatch::start(cpu);
        let settings = Settings {
            skill,
            trigger: Trigger::Periodic,
            period_ns,
            spin_ns: case.spin_ns(),
            fifo_priority,
            cpu,
        };
        let status = Instance::new(&instance)?.open_status()?;
        let mut controller = Controller::start(&settings, &instance)?;
        let cycles = (block_s * case.rate_hz as f64).ceil() as u64;
        // Periods that are missed are not caught up with: that takes longer.
        controller.wait_for_ticks(&status, cycles, Duration::from_secs_f64(2.0 * block_s))?;
        let summary = controller.stop()?;
        found.add(&summary, &steal.stop()).ok_or("a summary of the controller lacks a number")?;
        let steal = StealWatch::start(cpu);
        let least_us = COMPUTE_MAX_US - found.compute_us().min(COMPUTE_MAX_US / 2.0);
        let lasting = Duration::from_secs_f64(GAPS_FRACTION * block_s);
        let gaps = machine::gaps(cpu, fifo_priority, lasting, (least_us * 1e3) as u64)?;
        let steal = steal.stop();
        found.gaps += gaps.ends_ns.iter().filter(|end_ns| !steal.near(**end_ns)).count() as u64;
        found.looked_ns += gaps.looked_ns;
        if compared {
            let steal = StealWatch::start(cpu);
            let period_us = period_ns / 1000;
            let lateness =
                cyclictest::run(&cyclictest::Settings { cpu, period_us, cycles, fifo_priority })?;
            found.cyclictest.get_or_insert_default().add(&lateness);
            found.cyclictest_steal_ms += steal.stop().total_ms();
        }
    }
    found.worst.sort_by(|a, b| b.response_us.total_cmp(&a.response_us));
    Ok(found)
}

/// The promises, over all rows of a scheduler.
fn verdicts(rows: &[Found], scheduler: Scheduler) -> Vec<(String, Verdict)> {
    let of_it: Vec<_> = rows.iter().filter(|r| r.case.scheduler == scheduler).collect();
    if of_it.is_empty() {
        return Vec::new();
    }
    let name = scheduler.text();
    let ticks: u64 = of_it.iter().map(|r| r.misses.cycles).sum();
    let (slow, unexplained) =
        of_it.iter().map(|r| r.slow()).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    let longest = of_it.iter().flat_map(|r| &r.worst).filter(|t| !t.stolen);
    let longest_us = longest.map(|t| t.compute_us).fold(0.0, f64::max);
    let computed_us: f64 = of_it.iter().map(|r| r.compute_us() * r.misses.cycles as f64).sum();
    let (gaps, looked_ns) =
        of_it.iter().fold((0, 0), |sum, r| (sum.0 + r.gaps, sum.1 + r.looked_ns));
    // Exposure in microseconds: the time in which a theft makes a slow tick, or a gap.
    let ours = Misses { late: unexplained, cycles: computed_us as u64 };
    let machine = Misses { late: gaps, cycles: looked_ns / 1000 };
    let holds = match compare_misses(ours, machine, 1.0).holds {
        _ if unexplained == 0 => Some(true),
        Some(false) => Some(false),
        // The machine does that by itself.
        _ => None,
    };
    let mut verdicts = vec![(
        format!("evaluation and publishing, {name}"),
        Verdict {
            must: format!("≤ {COMPUTE_MAX_US} µs in every tick without steal"),
            found: format!(
                "{slow} of {ticks} ticks took longer, {unexplained} of them without steal within 0.1 s; \
                 the longest tick without steal {longest_us:.0} µs. As much time was lost {gaps} times in \
                 {:.1} s of looking at the clock, without steal; the ticks computed for {:.1} s",
                looked_ns as f64 * 1e-9,
                computed_us * 1e-6
            ),
            holds,
        },
    )];
    let judged: Vec<_> = of_it.iter().filter(|r| r.case.rate_hz == JUDGED_HZ).collect();
    let references: Vec<_> = judged.iter().filter_map(|r| r.cyclictest.as_ref()).collect();
    if !references.is_empty() {
        let ours = judged.iter().map(|r| r.misses).sum();
        let theirs = references.iter().map(|r| r.misses).sum();
        let verdict = compare_misses(ours, theirs, MISS_FACTOR);
        verdicts.push((format!("misses at {JUDGED_HZ} Hz, {name}"), verdict));
    }
    verdicts
}

const HEAD: [&str; 12] = [
    "deadlines [µs]",
    "cycles",
    "misses",
    "cyclic",
    "steal ms",
    "p50",
    "p99",
    "p99.9",
    "wake-up",
    "state",
    "evaluate",
    "publish",
];

/// A line of the table: quantiles are of the wake-up, the last four are the worst of each phase.
fn print_cells(cells: [impl std::fmt::Display; 12]) {
    let [name, cells @ ..] = cells;
    let cells = cells.map(|cell| format!("{cell:>8}"));
    let (counts, times) = cells.split_at(4);
    let (quantiles, worst) = times.split_at(3);
    let groups = [counts, quantiles, worst].map(<[String]>::concat);
    println!("{name:<46}{}", groups.join(" |"));
}

fn print_row(found: &Found) {
    let theirs = found.cyclictest.as_ref().map_or("-".into(), |c| c.misses.late.to_string());
    let [p50, p99, p999] = [0.5, 0.99, 0.999].map(|fraction| found.phases[0].quantile(fraction));
    let [wake_up, state_age, _, evaluation, publishing] = found.max_us;
    let counts = [found.misses.cycles, found.misses.late, found.steal_ms].map(|n| n.to_string());
    let [cycles, late, steal_ms] = counts;
    let times = [p50, p99, p999, wake_up, state_age, evaluation, publishing];
    let [p50, p99, p999, a, b, c, d] = times.map(|us| format!("{us:.1}"));
    print_cells([found.case.name(), cycles, late, theirs, steal_ms, p50, p99, p999, a, b, c, d]);
}

fn main() -> Fallible<()> {
    if Role::play_if_asked()? {
        return Ok(());
    }
    let mut arguments = Arguments::parse();
    if let Some(rate) = arguments.rates.iter().find(|r| !(50..=20_000).contains(*r)) {
        return Err(format!("--rates: expected 50 to 20000 Hz, found {rate}").into());
    }
    let cores = machine::cores()?;
    if let Some(refused) = machine::fifo_refused()
        && arguments.schedulers.contains(&Scheduler::Fifo)
    {
        println!("deadlines: the rows of SCHED_FIFO are skipped: it was refused ({refused})");
        arguments.schedulers.retain(|s| *s != Scheduler::Fifo);
    }
    let refused = cyclictest::refused(cores.controller);
    let compared = refused.is_none();
    if let Some(refused) = refused {
        println!(
            "deadlines: without cyclictest, which cannot be run ({refused}): misses cannot be \
             separated from what the machine does"
        );
    }
    let mut cases = Vec::new();
    for load in &arguments.loads {
        for scheduler in &arguments.schedulers {
            for wait in &arguments.waits {
                for rate_hz in &arguments.rates {
                    let (load, scheduler, wait) = (*load, *scheduler, *wait);
                    cases.push(Case { rate_hz: *rate_hz, load, wait, scheduler });
                }
            }
        }
    }
    let full = arguments.full;
    let sides = if compared { 2.0 } else { 1.0 };
    let row_s = |c: &Case| {
        let (blocks, block_s) = c.blocks(full);
        f64::from(blocks) * ((sides + GAPS_FRACTION) * block_s + 1.3)
    };
    let seconds: f64 = cases.iter().map(row_s).sum();
    println!(
        "deadlines: {} rows, about {:.0} minutes; publisher on core {}, controller on core {}",
        cases.len(),
        (seconds / 60.0).ceil(),
        cores.publisher,
        cores.controller
    );
    let machine = machine::description();
    print_cells(HEAD);
    let mut found: Vec<Found> = Vec::new();
    for load in &arguments.loads {
        let _neighbours = load.start(cores)?;
        for case in cases.iter().filter(|c| c.load == *load) {
            let row = measure(*case, cores, full, compared)?;
            print_row(&row);
            found.push(row);
        }
    }
    let mut rows = vec![machine];
    rows.extend(found.iter().map(Found::row));
    for scheduler in [Scheduler::Other, Scheduler::Fifo] {
        for (name, verdict) in verdicts(&found, scheduler) {
            println!("{name}: {}: {} ({})", verdict.must, verdict.word(), verdict.found);
            rows.push(json!({ "name": name, "verdict": verdict }));
        }
    }
    results::replace("deadlines", &rows)?;
    Ok(())
}
