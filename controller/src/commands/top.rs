//! `controller top`: how a running controller is doing, from another process. It reads the status
//! that the controller publishes anyway; the controller waits for nobody who reads.

use std::io::{self, Write};
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use console::Term;
use hdrhistogram::Histogram;
use thiserror::Error;
use tprmp_messages::{
    ControllerStatus, FrameSources, FramesPort, Instance, LifeCycle, PublishedFrames, Reason,
    ServiceError, StatusPort, TaskFrames, name_str, source_text, stop_flag,
};

use crate::commands::monitor::describe;
use crate::timing::realtime::monotonic_ns;

/// Time between two pictures; the percentiles are those of the ticks in between.
const REFRESH: Duration = Duration::from_millis(500);
/// Pause between two looks for statuses: shorter than what a full buffer holds at 2 kHz.
const LOOK: Duration = Duration::from_millis(50);
/// A controller that publishes nothing for so long is not running.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest time the histograms resolve \[ns\].
const TIME_MAX_NS: u64 = 10_000_000_000;

/// Why there is nothing to show.
#[derive(Debug, Error)]
pub enum TopError {
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The signal handlers.
    #[error("signal handlers cannot be installed: {0}")]
    Signals(io::Error),
    /// There is nobody to look at.
    #[error("no controller runs on instance `{0}`: start one, or name its --instance")]
    NoController(String),
}

/// A time of a tick: its name and where it stands in the status.
type TickTime = (&'static str, fn(&ControllerStatus) -> u64);

const TICK_TIMES: [TickTime; 6] = [
    ("wake-up", |s| s.wake_up_ns),
    ("age of the state", |s| s.state_age_ns),
    ("receiving", |s| s.receiving_ns),
    ("evaluation", |s| s.evaluation_ns),
    ("publishing", |s| s.publishing_ns),
    ("tick", |s| s.receiving_ns + s.evaluation_ns + s.publishing_ns),
];

/// What was received between two pictures.
struct Window {
    first: Option<ControllerStatus>,
    last: Option<ControllerStatus>,
    histograms: [Histogram<u64>; TICK_TIMES.len()],
}

impl Window {
    fn new() -> Self {
        let histogram = |_| {
            Histogram::new_with_bounds(1, TIME_MAX_NS, 3)
                .expect("the bounds are constants that hdrhistogram accepts")
        };
        Self { first: None, last: None, histograms: core::array::from_fn(histogram) }
    }

    fn add(&mut self, status: &ControllerStatus) {
        self.first.get_or_insert(*status);
        self.last = Some(*status);
        for (histogram, (_, time)) in self.histograms.iter_mut().zip(TICK_TIMES) {
            histogram.saturating_record(time(status));
        }
    }

    /// The picture, line by line.
    fn lines(&self, instance: &str) -> Vec<String> {
        let (Some(first), Some(last)) = (&self.first, &self.last) else { return Vec::new() };
        let life_cycle = LifeCycle::from_wire(last.life_cycle).unwrap_or_default();
        let reason = Reason::from_wire(last.reason).unwrap_or_default();
        let seconds = last.time_ns.saturating_sub(first.time_ns) as f64 * 1e-9;
        let rate = (last.ticks.saturating_sub(first.ticks)) as f64 / seconds;
        let rate = if rate.is_finite() { format!("{rate:.0} Hz") } else { "–".into() };
        let mut lines = vec![
            format!("instance `{instance}`: {}", describe(life_cycle, reason)),
            format!(
                "ticks {} at {rate}, period {:.0} µs; {} deadlines missed, {} periods skipped, \
                 {} states lost",
                last.ticks,
                last.period_ns as f64 * 1e-3,
                last.deadline_misses,
                last.skipped_periods,
                last.states_lost
            ),
            format!(
                "allocations in the loop {}, peers connected {}",
                last.allocations, last.connections
            ),
        ];
        let goal = [last.goal_distance_m * 1e3, last.goal_angle_rad.to_degrees(), last.energy_j];
        if goal.iter().all(|v| v.is_finite()) {
            let [distance, angle, energy] = goal;
            lines.push(format!("goal {distance:.1} mm and {angle:.1}° away, energy {energy:.4} J"));
        }
        lines.push(format!(
            "{:<18}{:>10}{:>10}{:>10}{:>10}",
            "time of a tick, µs", "last", "p50", "p99", "max"
        ));
        for (histogram, (name, time)) in self.histograms.iter().zip(TICK_TIMES) {
            let us = |ns: u64| ns as f64 * 1e-3;
            lines.push(format!(
                "{name:<18}{:>10.1}{:>10.1}{:>10.1}{:>10.1}",
                us(time(last)),
                us(histogram.value_at_quantile(0.5)),
                us(histogram.value_at_quantile(0.99)),
                us(histogram.max())
            ));
        }
        lines
    }
}

/// A line for each source of frames: how old its newest message is, and what is in it.
fn source_lines(published: &PublishedFrames<'_>) -> Vec<String> {
    let line = |message: &TaskFrames| {
        let TaskFrames { source, obstacle_count, .. } = message;
        let frames = message.listed().unwrap_or(&[]).iter();
        let names: Vec<_> = frames.map(|frame| name_str(&frame.name).unwrap_or("?")).collect();
        format!(
            "{}, {:.1} ms old: frames {}; {obstacle_count} obstacles",
            source_text(source),
            published.age_ns(message) as f64 * 1e-6,
            if names.is_empty() { "none".into() } else { names.join(", ") }
        )
    };
    published.messages().map(line).collect()
}

/// Receives what has been published in the meantime; `false` when nothing was.
fn receive(port: &StatusPort, window: &mut Window) -> bool {
    let mut any = false;
    while let Some(status) = port.status.receive() {
        window.add(&status);
        any = true;
    }
    any
}

/// Shows the controller of an instance, again and again or `once`, until it is no longer there or a
/// signal ends it: the port is closed in any case, so that nothing stays in shared memory.
///
/// # Errors
/// When no controller publishes on this instance, or the terminal cannot be written.
pub fn top(instance: &str, once: bool) -> Result<(), TopError> {
    let opened = Instance::new(instance)?;
    let (port, frames): (_, FramesPort) = (opened.open_status()?, opened.open_frames()?);
    let mut sources = FrameSources::new(u64::MAX);
    let stop = stop_flag().map_err(TopError::Signals)?;
    let terminal = Term::stdout();
    let mut window = Window::new();
    let mut drawn = 0;
    let (mut picture, mut heard) = (Instant::now(), Instant::now());
    while !stop.load(Ordering::Relaxed) {
        thread::sleep(LOOK);
        sources.receive(&frames.frames, monotonic_ns());
        if receive(&port, &mut window) {
            heard = Instant::now();
        } else if heard.elapsed() > PATIENCE {
            return Err(TopError::NoController(instance.into()));
        }
        if picture.elapsed() < REFRESH || window.last.is_none() {
            continue;
        }
        let mut lines = window.lines(instance);
        lines.extend(source_lines(&sources.at(monotonic_ns())));
        if draw(&terminal, drawn, &lines).is_err() {
            // A reader that has gone away, as in `controller top … | head`, is no reason to fail.
            return Ok(());
        }
        if once {
            return Ok(());
        }
        drawn = lines.len();
        window = Window::new();
        picture = Instant::now();
    }
    Ok(())
}

/// Replaces the picture drawn before; where the output is no terminal, writes one below the other.
fn draw(terminal: &Term, drawn: usize, lines: &[String]) -> io::Result<()> {
    if terminal.is_term() {
        terminal.clear_last_lines(drawn)?;
    }
    let mut terminal = terminal;
    writeln!(terminal, "{}", lines.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_messages::Frame;

    #[test]
    fn each_source_of_frames_has_a_line() {
        let mut camera = TaskFrames::of_source("camera").unwrap();
        (camera.frame_count, camera.obstacle_count) = (1, 2);
        camera.frames[0] = Frame::at("object", [0.0; 3]).unwrap();
        let robot = TaskFrames { time_ns: 8_000_000, ..Default::default() };
        let published = PublishedFrames::of(&[&camera, &robot], 10_000_000, 0);
        assert_eq!(
            source_lines(&published),
            [
                "source `camera`, 10.0 ms old: frames object; 2 obstacles",
                "the source without a name, 2.0 ms old: frames none; 0 obstacles"
            ]
        );
    }

    #[test]
    fn a_picture_shows_state_rate_counters_and_times() {
        let mut window = Window::new();
        for tick in 1..=101_u64 {
            window.add(&ControllerStatus {
                time_ns: tick * 1_000_000,
                life_cycle: LifeCycle::Holding.to_wire(),
                reason: Reason::FramesStale.to_wire(),
                ticks: tick,
                deadline_misses: 3,
                period_ns: 1_000_000,
                connections: 2,
                receiving_ns: 1_000,
                evaluation_ns: tick * 1_000,
                publishing_ns: 2_000,
                goal_distance_m: 0.25,
                ..Default::default()
            });
        }
        let lines = window.lines("demo");
        assert_eq!(lines[0], "instance `demo`: holding still: no new frames arrive");
        assert!(lines[1].starts_with("ticks 101 at 1000 Hz, period 1000 µs; 3 deadlines missed"));
        assert_eq!(lines[2], "allocations in the loop 0, peers connected 2");
        assert_eq!(lines[3], "goal 250.0 mm and 0.0° away, energy 0.0000 J");
        let evaluation: Vec<&str> = lines[8].split_whitespace().collect();
        assert_eq!(evaluation[..3], ["evaluation", "101.0", "51.0"], "{}", lines[8]);
        let tick: Vec<&str> = lines[10].split_whitespace().collect();
        assert_eq!(tick[..2], ["tick", "104.0"], "{}", lines[10]);
    }
}
