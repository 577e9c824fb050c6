//! `controller conformance`: a kit that a stranger runs on his own state publisher.

use std::io::BufRead;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use thiserror::Error;
use tprmp_files::outln;
use tprmp_messages::{Instance, NAME_CAPACITY, ServiceError};
use tprmp_model::controller_config::{self, ConfigError, ControllerConfig};

use crate::conformance::Kit;
use crate::startup::{self, StartError, WithRobot};

/// Why a publisher was not looked at, or does not keep the contract.
#[derive(Debug, Error)]
pub enum ConformanceError {
    /// The files, or the robot.
    #[error(transparent)]
    Start(#[from] StartError),
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// Checks have failed.
    #[error("{0} checks failed; the remedies stand beside them")]
    Failed(usize),
}

impl From<ConfigError> for ConformanceError {
    fn from(error: ConfigError) -> Self {
        Self::Start(error.into())
    }
}

/// What to look at.
#[derive(Debug, Args)]
pub struct Conformance {
    /// Configuration of the robot, e.g. config/controllers/ur5_pick.ron.
    config: PathBuf,
    /// Name that publisher and controller share.
    #[arg(long, default_value = "default")]
    instance: String,
    /// Compare the frames with those that this model needs.
    #[arg(long)]
    model: Option<PathBuf>,
    /// How long to look without a motion [s].
    #[arg(long, default_value_t = 3)]
    seconds: u8,
    /// Move each joint by 2° or 10 mm, too; asked on the terminal before each motion.
    #[arg(long = "move")]
    moves: bool,
    /// Do not ask: somebody watches the arm.
    #[arg(long, requires = "moves")]
    yes: bool,
    /// Be the controller that is killed in a motion.
    #[arg(long, hide = true)]
    killed_in_motion: bool,
}

struct Work<'a> {
    conformance: &'a Conformance,
    config: &'a ControllerConfig,
    needed: Vec<[u8; NAME_CAPACITY]>,
}

impl Conformance {
    /// Looks, prints a table, and fails where a check has.
    ///
    /// # Errors
    /// [`ConformanceError`].
    pub fn run(&self) -> Result<(), ConformanceError> {
        let config = controller_config::read(&self.config)?;
        let mut needed = Vec::new();
        if let Some(model) = &self.model {
            let skills = startup::load_skills(&self.config, config.clone(), &[model], true)?.skills;
            let frames = skills.iter().flat_map(|skill| skill.frames(config.start_frame));
            needed.extend(frames.filter(|(_, at_tool)| !at_tool).map(|(name, _)| name));
        }
        startup::with_robot(
            &self.config,
            &config,
            Work { conformance: self, config: &config, needed },
        )?
    }

    fn confirm(&self, what: &str) -> bool {
        if self.yes {
            return true;
        }
        outln!("           {what}: `y` and Enter, anything else leaves it");
        let mut line = String::new();
        let read = std::io::stdin().lock().read_line(&mut line);
        read.is_ok() && line.trim() == "y"
    }
}

impl WithRobot for Work<'_> {
    type Output = Result<(), ConformanceError>;

    fn call<const N: usize>(self) -> Result<(), ConformanceError> {
        let Self { conformance, config, needed } = self;
        let (chain, _) = startup::robot::<N>(&conformance.config, config)?;
        let instance = Instance::new(&conformance.instance)?;
        let kit = Kit {
            config,
            config_path: &conformance.config,
            chain: &chain,
            instance: &instance,
            needed,
            duration: Duration::from_secs(conformance.seconds.max(1).into()),
            moves: conformance.moves,
        };
        if conformance.killed_in_motion {
            return Ok(kit.die_in_motion()?);
        }
        match kit.run(&|what| conformance.confirm(what)) {
            0 => Ok(()),
            failed => Err(ConformanceError::Failed(failed)),
        }
    }
}
