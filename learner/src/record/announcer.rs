//! Reports on standard error what a session sees and waits for: on a terminal in a line that is kept
//! up to date, elsewhere in a line each time something else is waited for.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use tprmp_files::{errln, printable};

use super::frame_rest::RestingFrame;
use super::intake::{Fault, FramesIntake, Unusable};
use super::recorder::{Observation, Stage};
use super::recording::Task;
use super::rest::Motion;
use super::statistics::Extent;

/// What is waited for is announced when it lasts so long.
const PATIENCE: Duration = Duration::from_millis(300);
/// On a terminal the line is brought up to date so often.
const REFRESH: Duration = Duration::from_millis(200);

/// What the session waits for.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Status {
    NoPublisher,
    PublisherGone,
    Fault(Fault),
    Stage(Stage),
}

/// What the session sees.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct View {
    pub(super) observation: Observation,
    /// Standard deviation of the noisiest joint [m], [rad].
    pub(super) joint_noise: Extent,
}

/// Announces what is waited for, once each time it changes and lasts.
pub(super) struct Announcer {
    instance: String,
    /// Names of the frames, in their order.
    frames: Vec<String>,
    rest_s: f64,
    /// Newest status, and since when.
    status: Option<(Status, Instant)>,
    announced: Option<Status>,
    /// The line on a terminal; hidden where there is none.
    line: ProgressBar,
    refreshed: Option<Instant>,
}

impl Announcer {
    pub(super) fn new(task: &Task, instance: &str) -> Self {
        let style =
            ProgressStyle::with_template("{wide_msg}").expect("the template is well formed");
        Self {
            instance: instance.into(),
            frames: task.frames().cloned().collect(),
            rest_s: task.bounds.rest_s,
            status: None,
            announced: None,
            line: ProgressBar::new_spinner().with_style(style),
            refreshed: None,
        }
    }

    /// Writes a line of its own.
    pub(super) fn announce(&self, text: &str) {
        self.beside(|| errln!("learner: {text}"));
    }

    /// Writes something while the line is not on the terminal.
    pub(super) fn beside(&self, write: impl FnOnce()) {
        self.line.suspend(write);
    }

    /// Handles what is waited for; `view` is asked for when it is needed.
    pub(super) fn update(
        &mut self,
        status: Status,
        frames: &FramesIntake,
        view: impl FnOnce() -> View,
    ) {
        let since = match self.status {
            Some((before, since)) if before == status => since,
            _ => Instant::now(),
        };
        self.status = Some((status, since));
        if self.line.is_hidden() {
            if self.announced != Some(status) && since.elapsed() >= PATIENCE {
                self.announced = Some(status);
                // That a demonstration has begun is announced at once.
                if status != Status::Stage(Stage::Recording) {
                    self.announce(&self.text(status, frames, &view()));
                }
            }
        } else if self.refreshed.is_none_or(|at| at.elapsed() >= REFRESH) {
            self.refreshed = Some(Instant::now());
            let text = self.text(status, frames, &view());
            self.line.set_message(printable(&text));
            self.line.tick();
        }
    }

    /// What is waited for, and what is seen of it.
    fn text(&self, status: Status, frames: &FramesIntake, view: &View) -> String {
        match status {
            Status::NoPublisher => {
                format!("instance `{}`: waiting for a state of the robot", self.instance)
            }
            Status::PublisherGone => {
                format!("the publisher is gone: waiting for it on instance `{}`", self.instance)
            }
            Status::Fault(fault) => format!("waiting for sound states: {fault}"),
            Status::Stage(stage) => {
                let waiting = self.waiting(stage, frames, &view.observation);
                let goal =
                    view.observation.goal.filter(|_| !matches!(stage, Stage::FrameMissing(0, _)));
                format!("{waiting}{}", seen(view, goal))
            }
        }
    }

    fn waiting(&self, stage: Stage, frames: &FramesIntake, seen: &Observation) -> String {
        match stage {
            Stage::Unsettled => self.unsettled(seen.motion.as_ref()),
            Stage::FrameMissing(i, why) => {
                let others = match why {
                    Unusable::Absent => format!(" (they are: {})", frames.published()),
                    _ => String::new(),
                };
                format!("waiting for frame `{}`, which {why}{others}", self.frames[i])
            }
            Stage::FrameMoves(i) => {
                let role = if i == 0 { "goal frame" } else { "frame" };
                let drift = seen.drift.map(|drift| above(drift.moved, drift.bound, ""));
                format!("{role} `{}` moves: {}", self.frames[i], drift.unwrap_or_default())
            }
            Stage::Ready => "ready: waiting for the arm to move".into(),
            Stage::Recording => {
                let recording_s = seen.recording_ns.unwrap_or_default() as f64 * 1e-9;
                format!("recording, {recording_s:.1} s{}", self.rested(seen.motion.as_ref()))
            }
        }
    }

    fn unsettled(&self, motion: Option<&Motion>) -> String {
        let waiting = "waiting for the arm to rest";
        match motion {
            None => format!("{waiting}: too few states yet"),
            Some(motion) if motion.moves() => {
                format!("{waiting}: {}", above(motion.speed, motion.bound, "/s"))
            }
            motion => format!("{waiting}{}", self.rested(motion)),
        }
    }

    /// How long the tool has rested; nothing while it moves.
    fn rested(&self, motion: Option<&Motion>) -> String {
        let rests_ns = motion.and_then(|motion| motion.rests_ns);
        rests_ns.map_or_else(String::new, |ns| {
            format!("; it has rested for {:.1} of {:.1} s", ns as f64 * 1e-9, self.rest_s)
        })
    }
}

/// What is beyond its bound; `per` is the time's part of the unit.
fn above(found: Extent, bound: Extent, per: &str) -> String {
    let mut parts = Vec::new();
    if found.m > bound.m {
        parts.push(format!("{:.4} m{per} above {:.4}", found.m, bound.m));
    }
    if found.rad > bound.rad {
        parts.push(format!("{:.3} rad{per} above {:.3}", found.rad, bound.rad));
    }
    parts.join(", ")
}

/// Speed of the tool and its bound, noise of joints, tool and goal frame.
fn seen(view: &View, goal: Option<RestingFrame>) -> String {
    let Some(Motion { speed, bound, noise, .. }) = view.observation.motion else {
        return String::new();
    };
    let goal = goal.map_or_else(String::new, |frame| format!(", goal {}", small(frame.noise)));
    format!(
        " [tool {:.4} m/s of {:.4}, {:.3} rad/s of {:.3}; noise: joints {}, tool {}{goal}]",
        speed.m,
        bound.m,
        speed.rad,
        bound.rad,
        small(view.joint_noise),
        small(noise)
    )
}

/// A small length, a small angle, or both.
fn small(extent: Extent) -> String {
    let Extent { m, rad } = extent.scaled(1e3);
    match (m > 0.0, rad > 0.0) {
        (false, false) => "none".into(),
        (true, false) => format!("{m:.2} mm"),
        (false, true) => format!("{rad:.2} mrad"),
        (true, true) => format!("{m:.2} mm {rad:.2} mrad"),
    }
}

/// The line does not stay on the terminal.
impl Drop for Announcer {
    fn drop(&mut self) {
        self.line.finish_and_clear();
    }
}
