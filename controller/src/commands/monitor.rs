//! Shows the user what the loop is doing, from a thread of its own: the loop only stores numbers.

use core::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use tprmp_files::errln;
use tprmp_messages::{LifeCycle, Reason};

use crate::commands::sentences::sentence;
use crate::detail::{SharedDetail, explain};
use crate::telemetry::SharedStatus;

/// How often the monitor looks.
const PERIOD: Duration = Duration::from_millis(100);
/// A reason shorter than this many looks is not worth a line: 0.3 s.
const LOOKS_MIN: u32 = 3;

/// A thread that prints every change that lasts.
#[derive(Debug)]
pub struct Monitor {
    closed: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Monitor {
    /// Starts the thread. It inherits nothing of the loop's priority when it is started before
    /// that is set.
    #[must_use]
    pub fn start(status: Arc<SharedStatus>, detail: Arc<SharedDetail>) -> Self {
        let closed = Arc::new(AtomicBool::new(false));
        let watched = Arc::clone(&closed);
        Self { closed, thread: Some(thread::spawn(move || watch(&status, &detail, &watched))) }
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.closed.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn watch(status: &SharedStatus, detail: &SharedDetail, closed: &AtomicBool) {
    let (mut printed, mut last, mut looks) = (None, None, 0);
    let mut printed_mode = None;
    while !closed.load(Ordering::Relaxed) {
        let now = status.read();
        looks = if last == Some(now) { looks + 1 } else { 0 };
        last = Some(now);
        if looks >= LOOKS_MIN && printed != Some(now) {
            printed = Some(now);
            let seen = detail.read(now.1).and_then(|seen| explain(&seen));
            let seen = seen.map_or(String::new(), |text| format!("; {text}"));
            errln!("controller: {}{seen}", describe(now.0, now.1));
        }
        let mode = status.mode();
        if let Some(report) = mode.filter(|_| mode != printed_mode) {
            printed_mode = mode;
            errln!("controller: {report}");
        }
        thread::sleep(PERIOD);
    }
}

/// A sentence for people.
#[must_use]
pub fn describe(life_cycle: LifeCycle, reason: Reason) -> String {
    let state = match life_cycle {
        LifeCycle::Waiting => "waiting",
        LifeCycle::Running => "following the skill",
        LifeCycle::Lifting => "lifting",
        LifeCycle::Done => "done",
        LifeCycle::Holding => "holding still",
        LifeCycle::Stopping => "stopping",
        LifeCycle::Ready => "ready",
        LifeCycle::Fault => "holding still until `controller ctl reset`",
    };
    sentence(reason).map_or(state.into(), |why| format!("{state}: {why}"))
}
