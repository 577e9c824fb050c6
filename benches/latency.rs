//! From a state's publication to the answering command's reception, through the real controller in
//! another process; side by side with a bare ping-pong of the same messages over the same services.
//!
//! The blocks of the cases alternate, so that each sees the same machine. The publisher's period is
//! a thousandth longer than the controller's: with a schedule of its own, the controller meets states
//! of every age.

use clap::Parser;
use hdrhistogram::Histogram;
use serde_json::{Map, Value, json};
use tprmp_bench::controller::{Controller, Settings, Trigger};
use tprmp_bench::machine::{self, Cores, StealWatch};
use tprmp_bench::results::{self, Verdict};
use tprmp_bench::robot::{Robot, Skill};
use tprmp_bench::role::Role;
use tprmp_bench::statistics::{Buckets, rounded};
use tprmp_bench::{FIFO_PRIORITY, Fallible};
use tprmp_controller::timing::realtime::{monotonic_ns, sleep_until};
use tprmp_messages::{Instance, StatePublisherPorts};

const PERIOD_NS: u64 = 1_000_000;
const PUBLISHER_PERIOD_NS: u64 = PERIOD_NS + PERIOD_NS / 1000;
/// How long a controller that spins may do so in each period \[ns\].
const SPIN_NS: u64 = 100_000;
/// Round trips without a pause, in each period.
const BURST: usize = 100;
/// Exchanges before the measurement.
const WARM_UP: usize = 100;
/// An answer that takes longer is lost \[ns\].
const LOST_NS: u64 = 20_000_000;
/// Longest time until the first answer \[ns\].
const FIRST_ANSWER_NS: u64 = 20_000_000_000;
/// Phases of a tick in the controller's summary, and the whole of it.
const PHASES: [&str; 4] = ["receiving", "evaluation", "publishing", "tick"];
/// What the loop may add to a ping-pong and a tick \[µs\].
const MARGIN_US: f64 = 2.0;

/// A controller in lockstep asks for no priority and no core: its clock is that of the states.
const LOCKSTEP_SCHEDULER: &str = "SCHED_OTHER";

/// Latency between processes.
#[derive(Debug, Parser)]
struct Arguments {
    /// Longer blocks and more of them: half an hour.
    #[arg(long)]
    full: bool,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// Who answers.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Other {
    PingPong { burst: usize },
    Controller { skill: Skill, trigger: Trigger, spin_ns: u64 },
}

struct Case {
    name: String,
    other: Other,
    latency: Histogram<u64>,
    lost: u64,
    steal_ms: u64,
    /// Medians of the blocks, phase by phase, as the controller measured them \[µs\].
    medians_us: [Vec<f64>; PHASES.len()],
}

impl Case {
    fn new(name: String, other: Other) -> Fallible<Self> {
        Ok(Self {
            name,
            other,
            latency: Histogram::new_with_bounds(1, 60_000_000_000, 3)?,
            lost: 0,
            steal_ms: 0,
            medians_us: Default::default(),
        })
    }

    fn quantile_us(&self, fraction: f64) -> f64 {
        self.latency.value_at_quantile(fraction) as f64 * 1e-3
    }
}

fn cases() -> Fallible<Vec<Case>> {
    let mut cases = vec![
        Case::new("ping-pong, once a period".into(), Other::PingPong { burst: 1 })?,
        Case::new("ping-pong, without a pause".into(), Other::PingPong { burst: BURST })?,
    ];
    for skill in Skill::ALL {
        for (name, trigger, spin_ns) in [
            ("periodic", Trigger::Periodic, 0),
            ("on state, polling", Trigger::OnState, 0),
            ("on state, spinning", Trigger::OnState, SPIN_NS),
            ("lockstep, polling", Trigger::Lockstep, 0),
            ("lockstep, spinning", Trigger::Lockstep, SPIN_NS),
        ] {
            let name = format!("{}, {name}", skill.name());
            cases.push(Case::new(name, Other::Controller { skill, trigger, spin_ns })?);
        }
    }
    Ok(cases)
}

/// How the parties of a run are placed, and how long a block lasts.
struct Set {
    cores: Cores,
    fifo_priority: Option<u8>,
    block_ns: u64,
}

fn block(case: &mut Case, set: &Set) -> Fallible<()> {
    let instance = format!("bench-latency-{}", std::process::id());
    let (cpu, fifo_priority) = (set.cores.controller, set.fifo_priority);
    let steal = StealWatch::start(cpu);
    match case.other {
        Other::PingPong { burst } => {
            // Once a period it sleeps as a controller does that spins.
            let sleep_ns = if burst == 1 { PERIOD_NS - SPIN_NS } else { 0 };
            let _pong =
                Role::Pong { instance: instance.clone(), sleep_ns, cpu, fifo_priority }.start()?;
            exchange(case, &instance, Skill::Pick, burst, set)?;
        }
        Other::Controller { skill, trigger, spin_ns } => {
            let settings =
                Settings { skill, trigger, period_ns: PERIOD_NS, spin_ns, fifo_priority, cpu };
            let controller = Controller::start(&settings, &instance)?;
            let exchanged = exchange(case, &instance, skill, 1, set);
            // First: the log of a controller that left explains more than the lack of answers.
            let summary = controller.stop()?;
            exchanged?;
            for (phase, medians) in PHASES.iter().zip(&mut case.medians_us) {
                let median = summary[format!("{phase}_us")]["p50"].as_f64();
                medians.push(median.ok_or("a summary of the controller lacks a time")?);
            }
        }
    }
    case.steal_ms += steal.stop().total_ms();
    Ok(())
}

/// Publishes states and waits for their answers, in a thread with the priority of the other side.
fn exchange(
    case: &mut Case,
    instance: &str,
    skill: Skill,
    burst: usize,
    set: &Set,
) -> Fallible<()> {
    let (core, priority, block_ns) = (set.cores.publisher, set.fifo_priority, set.block_ns);
    std::thread::scope(|scope| {
        let publisher = scope.spawn(|| {
            let ports = Instance::new(instance)
                .and_then(|instance| instance.open_state_publisher())
                .map_err(|error| error.to_string())?;
            let _granted = machine::enter(core, priority);
            let mut robot = Robot::new(skill);
            let started_ns = monotonic_ns();
            let (mut due_ns, mut answered, mut end_ns) = (started_ns, 0, u64::MAX);
            while due_ns < end_ns {
                let missed = monotonic_ns().saturating_sub(due_ns) / PUBLISHER_PERIOD_NS;
                due_ns += (missed + 1) * PUBLISHER_PERIOD_NS;
                sleep_until(due_ns);
                for i in 0..burst {
                    let answer = answer(&mut robot, &ports);
                    answered += usize::from(answer.is_some());
                    if answered == WARM_UP && end_ns == u64::MAX {
                        end_ns = monotonic_ns() + block_ns;
                    }
                    // The first of a burst finds the other side half asleep.
                    if answered > WARM_UP && (burst == 1 || i > 0) {
                        case.lost += u64::from(answer.is_none());
                        case.latency.saturating_record(answer.unwrap_or(LOST_NS));
                    }
                }
                if answered == 0 && due_ns > started_ns + FIRST_ANSWER_NS {
                    return Err(format!("{}: no answer to any state", case.name));
                }
            }
            Ok(())
        });
        publisher.join().map_err(|_| "the publisher panicked")?.map_err(Into::into)
    })
}

/// Publishes a state and spins until the command that answers it has come: how long that took
/// \[ns\].
fn answer(robot: &mut Robot, ports: &StatePublisherPorts) -> Option<u64> {
    let (sequence, published_ns) = robot.publish(ports);
    loop {
        let answered = robot.obey(ports);
        let elapsed_ns = monotonic_ns() - published_ns;
        if answered == Some(sequence) {
            return Some(elapsed_ns);
        }
        if elapsed_ns > LOST_NS {
            return None;
        }
        core::hint::spin_loop();
    }
}

fn median(values: &[f64]) -> f64 {
    tprmp_drawing::quantile(values, 0.5).unwrap_or(f64::NAN)
}

/// The promise is about the loop that spins for its states.
fn verdict(case: &Case, ping_pong_us: f64) -> Option<Verdict> {
    let spins = |trigger, spin_ns| trigger == Trigger::OnState && spin_ns > 0;
    let Other::Controller { trigger, spin_ns, .. } = case.other else { return None };
    if !spins(trigger, spin_ns) {
        return None;
    }
    let [_, evaluation_us, _, tick_us] = case.medians_us.each_ref().map(|m| median(m));
    let (found, limit) = (case.quantile_us(0.5), ping_pong_us + tick_us + MARGIN_US);
    Some(Verdict {
        must: "p50 ≤ ping-pong + one tick + 2 µs".into(),
        found: format!(
            "{found:.1} µs, limit {ping_pong_us:.1} + {tick_us:.1} + {MARGIN_US:.0} = {limit:.1} µs; \
             receiving and publishing are part of the tick: beyond ping-pong and evaluation it takes \
             {:.1} µs",
            found - ping_pong_us - evaluation_us
        ),
        holds: Some(found <= limit),
    })
}

fn row(case: &Case, ping_pong_us: f64, scheduler: &str) -> Value {
    let mut row = Map::new();
    let mut set = |key: &str, value: Value| row.insert(key.into(), value);
    set("name", case.name.clone().into());
    set("period_us", json!(PERIOD_NS / 1000));
    let mut placed = scheduler;
    if let Other::Controller { skill, trigger, spin_ns } = case.other {
        if trigger == Trigger::Lockstep {
            placed = LOCKSTEP_SCHEDULER;
        }
        set("skill", skill.name().into());
        set("trigger", format!("{trigger:?}").into());
        set("spin_us", json!(spin_ns / 1000));
        for (phase, medians) in PHASES.iter().zip(&case.medians_us) {
            set(&format!("{phase}_p50_us"), rounded(median(medians)));
        }
    }
    set("scheduler", placed.into());
    for (key, fraction) in [("p50_us", 0.5), ("p99_us", 0.99), ("p999_us", 0.999), ("max_us", 1.0)]
    {
        set(key, rounded(case.quantile_us(fraction)));
    }
    set("ping_pong_p50_us", rounded(ping_pong_us));
    set("ratio_p50", rounded(case.quantile_us(0.5) / ping_pong_us));
    set("cycles", case.latency.len().into());
    set("lost", case.lost.into());
    set("steal_ms", case.steal_ms.into());
    set("histograms_us", json!({ "latency": Buckets::from_histogram(&case.latency).to_json() }));
    if let Some(verdict) = verdict(case, ping_pong_us) {
        set("verdict", json!(verdict));
    }
    row.into()
}

fn main() -> Fallible<()> {
    if Role::play_if_asked()? {
        return Ok(());
    }
    let arguments = Arguments::parse();
    let refused = machine::fifo_refused();
    let fifo_priority = refused.is_none().then_some(FIFO_PRIORITY);
    let scheduler = if fifo_priority.is_some() { "SCHED_FIFO" } else { "SCHED_OTHER" };
    if let Some(refused) = refused {
        println!("latency: without SCHED_FIFO, which was refused ({refused})");
    }
    let (rounds, block_ns) = if arguments.full { (10, 15_000_000_000) } else { (3, 1_000_000_000) };
    let set = Set { cores: machine::cores()?, fifo_priority, block_ns };
    let mut cases = cases()?;
    println!(
        "latency: {} cases × {rounds} blocks of {} s, {scheduler}, publisher on core {}, controller \
         on core {}",
        cases.len(),
        block_ns / 1_000_000_000,
        set.cores.publisher,
        set.cores.controller
    );
    let machine = machine::description();
    for round in 1..=rounds {
        for case in &mut cases {
            block(case, &set)?;
            println!("  {round}/{rounds} {:<28} p50 {:>8.1} µs", case.name, case.quantile_us(0.5));
        }
    }
    let ping_pong_us = cases[0].quantile_us(0.5);
    println!(
        "{:<28} {:>8} {:>8} {:>8} {:>8} {:>7} {:>6} {:>8}",
        "latency [µs]", "p50", "p99", "p99.9", "max", "ratio", "lost", "steal ms"
    );
    for case in &cases {
        let [p50, p99, p999, max] =
            [0.5, 0.99, 0.999, 1.0].map(|fraction| case.quantile_us(fraction));
        println!(
            "{:<28} {p50:>8.1} {p99:>8.1} {p999:>8.1} {max:>8.1} {:>7.2} {:>6} {:>8}",
            case.name,
            p50 / ping_pong_us,
            case.lost,
            case.steal_ms
        );
        if let Some(verdict) = verdict(case, ping_pong_us) {
            println!("  {}: {} ({})", verdict.must, verdict.word(), verdict.found);
        }
    }
    let mut rows = vec![machine];
    rows.extend(cases.iter().map(|case| row(case, ping_pong_us, scheduler)));
    results::replace("latency", &rows)?;
    Ok(())
}
