//! Demonstrations from a live robot: an observer of the states and frames of an instance, whoever
//! publishes them.
//!
//! `recorder` is the whole of the decisions, fed with samples and free of I/O; `intake` checks what
//! arrives, `arm` makes a pose of it, `take` a demonstration, and `file` writes it. What is here
//! reads shared memory, and tells people.

mod arm;
mod file;
mod intake;
mod recorder;
mod take;

use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tprmp_messages::{
    Instance, OBSERVER_BUFFER, ObserverPorts, RobotState, ServiceError, name_bytes, stop_flag,
};
use tprmp_model::controller_config::{self, ConfigError};
use tprmp_robot::UrdfError;

use crate::file_error::FileError;
use crate::skill::Skill;
use arm::Arm;
use file::Folder;
use intake::{Fault, FramesIntake, Sight, StateIntake};
use recorder::{Event, Recorder, Stage};
use take::{Shown, Task};

/// Pause between two looks for states.
const PAUSE: Duration = Duration::from_micros(500);
/// Without a state for so long, the publisher counts as gone.
const SILENCE: Duration = Duration::from_secs(2);
/// What is waited for is told when it lasts so long.
const PATIENCE: Duration = Duration::from_millis(300);
/// Shortest and longest time between samples [s].
const SAMPLING_TIME_S: std::ops::RangeInclusive<f64> = 0.001..=0.1;

/// What `learner record` is asked for.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Configuration of the controller, e.g. config/controllers/ur5_pick.ron: it names the robot
    config: PathBuf,
    /// Skill file: it names the skill, its manifold, its frames and the tool
    #[arg(long, value_name = "FILE")]
    skill: PathBuf,
    /// Folder for the files 01.json, 02.json, …; made when it is missing, nothing in it is replaced
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Name that the publisher of states uses
    #[arg(long, default_value = "default")]
    instance: String,
    /// Time between samples [s]
    #[arg(long, value_name = "S", default_value_t = 0.01, value_parser = sampling_time)]
    sampling_time_s: f64,
    /// End after so many demonstrations
    #[arg(long, value_name = "N")]
    count: Option<u32>,
}

fn sampling_time(text: &str) -> Result<f64, String> {
    let (least, most) = SAMPLING_TIME_S.into_inner();
    text.parse()
        .ok()
        .filter(|time| SAMPLING_TIME_S.contains(time))
        .ok_or_else(|| format!("expected a time from {least} to {most} s"))
}

/// Why nothing can be recorded.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The skill file, the configuration, or the folder of demonstrations.
    #[error(transparent)]
    File(#[from] FileError),
    /// The controller's configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The robot's description.
    #[error(transparent)]
    Urdf(#[from] UrdfError),
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The signal handlers.
    #[error("signal handlers cannot be installed: {0}")]
    Signals(std::io::Error),
}

/// Records demonstrations until there are as many as asked for, or a signal ends it.
///
/// # Errors
/// [`RecordError`], naming file and key: configuration, skill file or URDF are wrong or do not
/// fit each other, the services cannot be opened, or the folder cannot be written.
pub fn record(options: &Options) -> Result<(), RecordError> {
    let config = controller_config::read(&options.config)?;
    let skill = Skill::read(&options.skill)?;
    if skill.tool_frame != config.robot.tool_link {
        let problem = format!(
            "expected the tool link of `{}`, `{}`, found `{}`",
            options.config.display(),
            config.robot.tool_link,
            skill.tool_frame
        );
        return Err(FileError::key(&options.skill, "tool_frame", problem).into());
    }
    let task = Task::new(&skill, options.sampling_time_s);
    let wire_name = |name: &String| {
        let key = match name {
            name if *name == skill.goal_frame => "goal_frame",
            name if *name == skill.start_frame => "start_frame",
            _ => "other_frames",
        };
        name_bytes(name).map_err(|fault| {
            FileError::key(&options.skill, key, format!("{fault}, found `{name}`"))
        })
    };
    let names = task.frames().map(wire_name).collect::<Result<Vec<_>, _>>()?;
    let arm = arm::read(&options.config, &config.robot)?;
    let folder = Folder::open(&options.out)?;
    let instance = Instance::new(&options.instance)?;
    let ports = instance.open_observer()?;
    let stop = stop_flag().map_err(RecordError::Signals)?;
    let session = Session {
        count: options.count.unwrap_or(u32::MAX),
        states: StateIntake::new(arm.joints()),
        frames: FramesIntake::new(names, skill.manifold),
        board: Board::new(&task, &options.instance),
        recorder: Recorder::new(task),
        skill,
        arm,
        folder,
        fault: None,
        written: 0,
    };
    session.run(&ports, &stop)
}

/// One run of `learner record`.
struct Session {
    count: u32,
    skill: Skill,
    arm: Box<dyn Arm>,
    states: StateIntake,
    frames: FramesIntake,
    recorder: Recorder,
    folder: Folder,
    board: Board,
    /// What was wrong with the newest state.
    fault: Option<Fault>,
    written: u32,
}

impl Session {
    fn run(mut self, ports: &ObserverPorts, stop: &AtomicBool) -> Result<(), RecordError> {
        let mut last_state: Option<Instant> = None;
        let mut gone = false;
        while !stop.load(Ordering::Relaxed) && self.written < self.count {
            // Bounded, so that a signal is seen whatever arrives.
            for _ in 0..OBSERVER_BUFFER {
                let Some(state) = ports.state.receive() else { break };
                // After the state: whoever sees a state finds frames at least as new.
                if let Some(frames) = ports.frames.receive() {
                    self.frames.take(&frames);
                }
                last_state = Some(Instant::now());
                gone = false;
                self.see(&state)?;
                if self.written == self.count {
                    break;
                }
            }
            if !gone && last_state.is_some_and(|last| last.elapsed() > SILENCE) {
                gone = true;
                self.states.forget();
                self.frames.forget();
                let silence = format!("no state arrived for {} s", SILENCE.as_secs());
                let event = self.recorder.interrupt(&silence);
                self.handle(event)?;
            }
            let status = match (last_state, self.fault) {
                (None, _) => Status::NoPublisher,
                _ if gone => Status::PublisherGone,
                (_, Some(fault)) => Status::Fault(fault),
                _ => Status::Stage(self.recorder.stage()),
            };
            self.board.tell(status, &self.frames);
            sleep(PAUSE);
        }
        let event = self.recorder.end();
        self.handle(event)?;
        tell(&format!("ended, {} recorded", demonstrations(self.written)));
        Ok(())
    }

    /// Takes in one state.
    fn see(&mut self, state: &RobotState) -> Result<(), RecordError> {
        let event = match self.states.take(state) {
            Ok(None) => return Ok(()),
            Ok(Some(skipped)) => {
                self.fault = None;
                let pose = self.arm.tool_pose(&state.position);
                let frames = self.frames.at(state.time_ns);
                self.recorder.observe(state.time_ns, pose, frames, skipped)
            }
            Err(fault) => {
                self.fault = Some(fault);
                self.recorder.interrupt(&fault.to_string())
            }
        };
        self.handle(event)
    }

    fn handle(&mut self, event: Option<Event>) -> Result<(), RecordError> {
        match event {
            None => {}
            Some(Event::Begun { tool_as_start: false }) => tell("recording"),
            Some(Event::Begun { tool_as_start: true }) => tell(&format!(
                "recording; frame `{}` is not published: the tool's pose at the start serves as such",
                self.skill.start_frame
            )),
            Some(Event::Refused(why)) => tell(&format!("not recorded: {why}")),
            Some(Event::Shown(shown)) => self.save(*shown)?,
        }
        Ok(())
    }

    fn save(&mut self, shown: Shown) -> Result<(), RecordError> {
        let Skill { start_frame, goal_frame, .. } = &self.skill;
        match self.folder.save(&shown.demonstration, start_frame, goal_frame) {
            Ok(path) => {
                self.written += 1;
                // As in [`tell`].
                let mut out = std::io::stdout();
                let _ = writeln!(out, "wrote      {}: {}", path.display(), shown.summary());
                for note in shown.notes {
                    let _ = writeln!(out, "note       {note}");
                }
                Ok(())
            }
            // What training would refuse is no demonstration; the next one may be.
            Err(FileError::Input { place, problem, .. }) => {
                tell(&format!("not recorded: {place}: {problem}"));
                Ok(())
            }
            Err(error) => Err(error.into()),
        }
    }
}

/// Who no longer listens does not end the session.
fn tell(text: &str) {
    let _ = writeln!(std::io::stderr(), "learner: {text}");
}

fn demonstrations(count: u32) -> String {
    format!("{count} demonstration{}", if count == 1 { "" } else { "s" })
}

/// Where the session stands.
#[derive(Clone, Copy, PartialEq)]
enum Status {
    NoPublisher,
    PublisherGone,
    Fault(Fault),
    Stage(Stage),
}

/// Tells what is waited for, once each time it changes and lasts.
struct Board {
    instance: String,
    /// Names of the frames, in their order.
    frames: Vec<String>,
    /// Newest status, and since when.
    status: Option<(Status, Instant)>,
    told: Option<Status>,
}

impl Board {
    fn new(task: &Task, instance: &str) -> Self {
        Self {
            instance: instance.into(),
            frames: task.frames().cloned().collect(),
            status: None,
            told: None,
        }
    }

    fn tell(&mut self, status: Status, frames: &FramesIntake) {
        let since = match self.status {
            Some((before, since)) if before == status => since,
            _ => Instant::now(),
        };
        self.status = Some((status, since));
        if self.told != Some(status) && since.elapsed() >= PATIENCE {
            self.told = Some(status);
            if let Some(text) = self.text(status, frames) {
                tell(&text);
            }
        }
    }

    fn text(&self, status: Status, frames: &FramesIntake) -> Option<String> {
        let frame = |name: &str, sight: Sight| {
            let others = match sight {
                Sight::Absent => format!(" (they are: {})", frames.published()),
                _ => String::new(),
            };
            format!("waiting for frame `{name}`, which {sight}{others}")
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
            Status::Stage(Stage::FrameUnseen(i, sight)) => frame(&self.frames[i], sight),
            Status::Stage(Stage::Ready) => "ready: waiting for the arm to move".into(),
            Status::Stage(Stage::Showing) => return None,
        })
    }
}
