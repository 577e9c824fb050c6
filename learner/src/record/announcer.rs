//! Reports on standard error what a session waits for.

use std::time::{Duration, Instant};

use tprmp_files::errln;

use super::intake::{Fault, FramesIntake, Unusable};
use super::recorder::Stage;
use super::recording::Task;

/// What is waited for is announced when it lasts so long.
const PATIENCE: Duration = Duration::from_millis(300);

/// Writes a line.
pub(super) fn announce(text: &str) {
    errln!("learner: {text}");
}

/// What the session waits for.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Status {
    NoPublisher,
    PublisherGone,
    Fault(Fault),
    Stage(Stage),
}

/// Announces what is waited for, once each time it changes and lasts.
pub(super) struct Announcer {
    instance: String,
    /// Names of the frames, in their order.
    frames: Vec<String>,
    /// Newest status, and since when.
    status: Option<(Status, Instant)>,
    announced: Option<Status>,
}

impl Announcer {
    pub(super) fn new(task: &Task, instance: &str) -> Self {
        Self {
            instance: instance.into(),
            frames: task.frames().cloned().collect(),
            status: None,
            announced: None,
        }
    }

    pub(super) fn update(&mut self, status: Status, frames: &FramesIntake) {
        let since = match self.status {
            Some((before, since)) if before == status => since,
            _ => Instant::now(),
        };
        self.status = Some((status, since));
        if self.announced != Some(status) && since.elapsed() >= PATIENCE {
            self.announced = Some(status);
            if let Some(text) = self.text(status, frames) {
                announce(&text);
            }
        }
    }

    fn text(&self, status: Status, frames: &FramesIntake) -> Option<String> {
        let frame = |name: &str, why: Unusable| {
            let others = match why {
                Unusable::Absent => format!(" (they are: {})", frames.published()),
                _ => String::new(),
            };
            format!("waiting for frame `{name}`, which {why}{others}")
        };
        Some(match status {
            Status::NoPublisher => {
                format!("instance `{}`: waiting for a state of the robot", self.instance)
            }
            Status::PublisherGone => {
                format!("the publisher is gone: waiting for it on instance `{}`", self.instance)
            }
            Status::Fault(fault) => format!("waiting for sound states: {fault}"),
            Status::Stage(Stage::Unsettled) => "waiting for the arm to come to rest".into(),
            Status::Stage(Stage::FrameMissing(i, why)) => frame(&self.frames[i], why),
            Status::Stage(Stage::Ready) => "ready: waiting for the arm to move".into(),
            Status::Stage(Stage::Recording) => return None,
        })
    }
}
