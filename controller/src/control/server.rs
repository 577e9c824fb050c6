//! A thread beside the loop: it answers requests, keeps the journal, and builds the policy of a new model. It
//! inherits nothing of the loop's priority when it is started before that is set.

use core::sync::atomic::{AtomicBool, Ordering};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use tprmp_files::errln;
use tprmp_messages::{
    ControlAnswer, ControlRequest, ControlServer, ControlVerb, Instance, LifeCycle, ServiceError,
    control_text,
};

use crate::control::journal::{Journal, SharedTask};
use crate::control::requests::{Requests, Setting};
use crate::detail::{SharedDetail, explain};
use crate::inputs::scene::Scene;
use crate::policy::{RobotPolicy, Workspace};
use crate::telemetry::SharedStatus;

/// How often the thread looks.
const PERIOD: Duration = Duration::from_millis(5);

/// A policy for the running loop, with all that belongs to it.
#[derive(Debug)]
pub struct Replacement<const N: usize> {
    /// The policy.
    pub policy: RobotPolicy<N>,
    /// Its workspace.
    pub workspace: Workspace<N>,
    /// The frames that it needs, none of them known yet.
    pub scene: Scene,
}

/// The loop's end of the exchange of policies: nothing is allocated or freed there.
#[derive(Debug)]
pub struct Exchange<const N: usize> {
    new: Receiver<Box<Replacement<N>>>,
    old: SyncSender<Box<Replacement<N>>>,
}

impl<const N: usize> Exchange<N> {
    /// Exchanges the policy for a new one where there is one, by `swap`.
    pub fn take(&self, swap: impl FnOnce(&mut Replacement<N>)) {
        if let Ok(mut replacement) = self.new.try_recv() {
            swap(&mut replacement);
            // There is room: the other side takes the old one before it sends a new one.
            if let Err(full) = self.old.try_send(replacement) {
                core::mem::forget(full);
            }
        }
    }
}

/// Builds the policy of models, the task's first; an error is a text for people.
pub type Build<const N: usize> = Box<dyn Fn(&[PathBuf]) -> Result<Replacement<N>, String> + Send>;

/// What the thread shares with the loop.
#[derive(Debug, Clone)]
pub struct Shared {
    /// What is asked of the loop.
    pub requests: Arc<Requests>,
    /// What the loop is doing.
    pub status: Arc<SharedStatus>,
    /// What was seen beside its reason.
    pub detail: Arc<SharedDetail>,
    /// What its task has come to.
    pub task: Arc<SharedTask>,
    /// Asks the loop to stop.
    pub stop: Arc<AtomicBool>,
}

impl Shared {
    /// Nothing was asked for, and nothing has happened yet.
    #[must_use]
    pub fn new(stop: Arc<AtomicBool>) -> Self {
        Self {
            requests: Arc::default(),
            status: Arc::default(),
            detail: Arc::default(),
            task: Arc::default(),
            stop,
        }
    }
}

/// The thread. Dropped, it ends; the journal stays unless [`Server::end`] says that all is well.
#[derive(Debug)]
pub struct Server {
    closed: Arc<AtomicBool>,
    well: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

struct Work<const N: usize> {
    shared: Shared,
    settable: BTreeMap<String, [f64; 2]>,
    build: Build<N>,
    new: SyncSender<Box<Replacement<N>>>,
    old: Receiver<Box<Replacement<N>>>,
    journal: Journal,
    journal_failed: bool,
}

impl Server {
    /// Opens the service and starts the thread. Gives the loop's end of the exchange of policies.
    ///
    /// # Errors
    /// When the service cannot be opened: a second controller of the same instance is one reason.
    pub fn start<const N: usize>(
        instance: &Instance,
        shared: Shared,
        journal: Journal,
        settable: BTreeMap<String, [f64; 2]>,
        build: Build<N>,
    ) -> Result<(Self, Exchange<N>), ServiceError> {
        let (new, take_new) = sync_channel(1);
        let (give_old, old) = sync_channel(1);
        let closed = Arc::new(AtomicBool::new(false));
        let well = Arc::new(AtomicBool::new(false));
        let (seen, ends_well) = (Arc::clone(&closed), Arc::clone(&well));
        let mut work = Work { shared, settable, build, new, old, journal, journal_failed: false };
        let instance = instance.clone();
        // Ports stay in the thread that opened them.
        let (opened, result) = sync_channel(1);
        let thread = thread::spawn(move || match instance.open_control_server() {
            Ok(server) => {
                let _ = opened.send(Ok(()));
                while !seen.load(Ordering::Relaxed) {
                    work.look(&server);
                    thread::sleep(PERIOD);
                }
                if ends_well.load(Ordering::Relaxed) {
                    work.journal.end();
                }
            }
            Err(error) => {
                let _ = opened.send(Err(error));
            }
        });
        result.recv().unwrap_or(Ok(()))?;
        let exchange = Exchange { new: take_new, old: give_old };
        Ok((Self { closed, well, thread: Some(thread) }, exchange))
    }
}

impl Server {
    /// Ends the thread, and the journal where nothing is left to look at.
    pub fn end(self, well: bool) {
        self.well.store(well, Ordering::Relaxed);
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.closed.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl<const N: usize> Work<N> {
    fn look(&mut self, server: &ControlServer) {
        server.serve(|request| self.answer(request));
        let _ = self.old.try_recv();
        let written = self.journal.update(&self.shared.task.load());
        if let (Err(error), false) = (&written, self.journal_failed) {
            errln!("controller: the journal cannot be written ({error}): the arm is not affected");
        }
        self.journal_failed = written.is_err();
    }

    fn answer(&mut self, request: &ControlRequest) -> ControlAnswer {
        let text = control_text(&request.text);
        let done = match ControlVerb::from_wire(request.verb) {
            None => Err(format!("request {} is unknown to this controller", request.verb)),
            Some(verb) => self.carry_out(verb, &text, request.value),
        };
        let (life_cycle, reason) = self.shared.status.read();
        let answer = match &done {
            Ok(text) => ControlAnswer::new(true, text),
            Err(text) => ControlAnswer::new(false, text),
        };
        ControlAnswer { life_cycle: life_cycle.to_wire(), reason: reason.to_wire(), ..answer }
    }

    fn carry_out(&mut self, verb: ControlVerb, text: &str, value: f64) -> Result<String, String> {
        let Shared { requests, status, stop, .. } = &self.shared;
        let (life_cycle, reason) = status.read();
        let is_fault = life_cycle == LifeCycle::Fault;
        let done = match verb {
            ControlVerb::Status => {
                let detail = self.shared.detail.read(reason).and_then(|seen| explain(&seen));
                let mode = status.mode().map(|mode| mode.to_string());
                let parts: Vec<_> = detail.into_iter().chain(mode).collect();
                return Ok(parts.join("; "));
            }
            ControlVerb::Start if is_fault => {
                return Err(format!("{reason:?} has to be reset first: `controller ctl reset`"));
            }
            ControlVerb::Start => {
                requests.start();
                "asked to go on".into()
            }
            ControlVerb::Hold => {
                requests.hold();
                "asked to decelerate and hold".into()
            }
            ControlVerb::Stop => {
                stop.store(true, Ordering::Relaxed);
                "asked to ramp down and leave".into()
            }
            ControlVerb::Reset if !is_fault => {
                return Err("there is no fault to reset".into());
            }
            ControlVerb::Reset => {
                requests.reset();
                format!("{reason:?} is forgotten; where it lasts it comes again")
            }
            ControlVerb::SwapModel => self.swap(text)?,
            ControlVerb::Set => self.set(text, value)?,
        };
        errln!("controller: ctl {verb:?}: {done}");
        Ok(done)
    }

    fn swap(&self, text: &str) -> Result<String, String> {
        let paths: Vec<PathBuf> = text.lines().map(|line| Path::new(line).into()).collect();
        let replacement = Box::new((self.build)(&paths)?);
        self.new
            .try_send(replacement)
            .map_err(|_| "the loop has not yet taken the last one: is it running?".to_owned())?;
        Ok(format!("the loop goes on with {}", text.replace('\n', ", ")))
    }

    fn set(&self, key: &str, value: f64) -> Result<String, String> {
        let bounds = self.settable.get(key);
        let Some((setting, [lower, upper])) = Setting::of_key(key).zip(bounds) else {
            let keys: Vec<_> = self.settable.keys().map(String::as_str).collect();
            return Err(format!("setting `{key}`: expected one of {}", keys.join(", ")));
        };
        if !(*lower..=*upper).contains(&value) {
            return Err(format!("setting `{key}`: expected {lower} to {upper}, found {value}"));
        }
        self.shared.requests.set(setting, value);
        Ok(format!("`{key}` goes to {value}"))
    }
}
