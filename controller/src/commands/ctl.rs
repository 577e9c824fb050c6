//! `controller ctl`: asks a running controller for something, from another process.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};
use thiserror::Error;
use tprmp_files::outln;
use tprmp_messages::{
    ControlRequest, ControlVerb, Instance, LifeCycle, Reason, ServiceError, TEXT_CAPACITY,
    control_text,
};

use crate::commands::monitor::describe;

/// How long an answer may take: a model has to be read and checked.
const PATIENCE: Duration = Duration::from_secs(10);

/// Why nothing was done.
#[derive(Debug, Error)]
pub enum CtlError {
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// There is nobody to ask.
    #[error("no controller answers on instance `{0}`: start one, or name its --instance")]
    NoController(String),
    /// It was refused.
    #[error("refused: {0}")]
    Refused(String),
    /// A file is not there.
    #[error("model `{0}` cannot be read: {1}")]
    Model(PathBuf, std::io::Error),
    /// More than a request holds.
    #[error(
        "the models' paths have {0} bytes together, at most {TEXT_CAPACITY} fit into a request"
    )]
    TooLong(usize),
}

/// What to ask for.
#[derive(Debug, Args)]
pub struct Ctl {
    /// Name that publisher and controller share.
    #[arg(long, default_value = "default", global = true)]
    instance: String,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Tell how it is.
    Status,
    /// Go on, from waiting for a start or from a hold.
    Start,
    /// Decelerate to rest and hold, until a start.
    Hold,
    /// Ramp down to rest and leave.
    Stop,
    /// Somebody has looked at the fault: go on where its cause has gone.
    Reset,
    /// Follow another model of the same robot, without a stop. Given again for each of `additional_skills`.
    SwapModel {
        /// Model that `learner train` wrote.
        #[arg(required = true)]
        models: Vec<PathBuf>,
    },
    /// Change a gain that `supervision.settable` names, within its bounds, smoothly.
    Set {
        /// Key of the configuration.
        key: String,
        /// In its unit.
        #[arg(allow_negative_numbers = true)]
        value: f64,
    },
}

impl Ctl {
    /// Asks, and prints the answer.
    ///
    /// # Errors
    /// [`CtlError`].
    pub fn run(&self) -> Result<(), CtlError> {
        let plain = |verb| ControlRequest::new(verb, "", 0.0);
        let request = match &self.verb {
            Verb::Status => plain(ControlVerb::Status),
            Verb::Start => plain(ControlVerb::Start),
            Verb::Hold => plain(ControlVerb::Hold),
            Verb::Stop => plain(ControlVerb::Stop),
            Verb::Reset => plain(ControlVerb::Reset),
            Verb::Set { key, value } => ControlRequest::new(ControlVerb::Set, key, *value),
            Verb::SwapModel { models } => {
                let absolute = models.iter().map(|path| {
                    let found = path.canonicalize();
                    found.map_err(|error| CtlError::Model(path.clone(), error))
                });
                let paths: Vec<_> = absolute.collect::<Result<_, _>>()?;
                let lines: Vec<_> = paths.iter().map(|path| path.to_string_lossy()).collect();
                let text = lines.join("\n");
                if text.len() > TEXT_CAPACITY {
                    return Err(CtlError::TooLong(text.len()));
                }
                ControlRequest::new(ControlVerb::SwapModel, &text, 0.0)
            }
        };
        let client = Instance::new(&self.instance)?.open_control_client()?;
        let answer = client.ask(&request, PATIENCE);
        let answer = answer.ok_or_else(|| CtlError::NoController(self.instance.clone()))?;
        let text = control_text(&answer.text);
        if answer.accepted != 1 {
            return Err(CtlError::Refused(text));
        }
        let life_cycle = LifeCycle::from_wire(answer.life_cycle).unwrap_or_default();
        let reason = Reason::from_wire(answer.reason).unwrap_or_default();
        match (&self.verb, text.is_empty()) {
            (Verb::Status, false) => outln!("{}; {text}", describe(life_cycle, reason)),
            (_, true) => outln!("{}", describe(life_cycle, reason)),
            (_, false) => outln!("{text}"),
        }
        Ok(())
    }
}
