//! One run of `learner record`: reads shared memory until there are demonstrations enough.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tprmp_files::outln;
use tprmp_messages::{
    FrameSources, GripperState, Instance, OBSERVER_BUFFER, ObserverPorts, RobotState, name_bytes,
    stop_flag,
};
use tprmp_model::controller_config;

use super::announcer::{Announcer, Status, View};
use super::arm::{self, Arm};
use super::error::RecordError;
use super::folder::Folder;
use super::intake::{FRAMES_AGE_MAX_NS, Fault, FramesIntake, StateIntake};
use super::joint_noise::JointNoise;
use super::options::Options;
use super::recorder::{Event, Recorder};
use super::recording::{Recorded, Task};
use super::rest::Sample;
use crate::demonstration::Grip;
use crate::file_error::FileError;
use crate::skill::Skill;

/// Pause between two looks for states.
const PAUSE: Duration = Duration::from_micros(500);
/// Without a state for so long, the publisher counts as gone.
const SILENCE: Duration = Duration::from_secs(2);

/// Records demonstrations until there are as many as asked for, or a signal ends it.
///
/// # Errors
/// [`RecordError`], naming file and key: configuration, skill file or URDF are wrong or do not
/// fit each other, the services cannot be opened, or the folder cannot be written.
pub fn record(options: &Options) -> Result<(), RecordError> {
    let config = controller_config::read(&options.config)?;
    let skill = Skill::read(&options.skill)?;
    if skill.proposes_frames {
        let problem = "expected the names of the frames to record, found `Auto`: list them, and put `Auto` back to \
                       learn";
        return Err(FileError::key(&options.skill, "other_frames", problem).into());
    }
    if skill.tool_frame != config.robot.tool_frame() {
        let problem = format!(
            "expected the tool link of `{}`, `{}`, found `{}`",
            options.config.display(),
            config.robot.tool_frame(),
            skill.tool_frame
        );
        return Err(FileError::key(&options.skill, "tool_frame", problem).into());
    }
    let task = Task::new(&skill, options.sampling_time_s, options.bounds);
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
        joint_noise: JointNoise::default(),
        sources: FrameSources::new(FRAMES_AGE_MAX_NS),
        frames: FramesIntake::new(names, skill.manifold),
        announcer: Announcer::new(&task, &options.instance),
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
    joint_noise: JointNoise,
    sources: FrameSources,
    frames: FramesIntake,
    recorder: Recorder,
    folder: Folder,
    announcer: Announcer,
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
                // After the state, so that the frames are at least as new.
                if self.sources.receive(&ports.frames, state.time_ns) {
                    self.frames.update(&self.sources.at(state.time_ns));
                }
                last_state = Some(Instant::now());
                gone = false;
                self.update(&state)?;
                if self.written == self.count {
                    break;
                }
            }
            if !gone && last_state.is_some_and(|last| last.elapsed() > SILENCE) {
                gone = true;
                self.states.forget();
                self.frames.forget();
                self.joint_noise.forget();
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
            let (recorder, arm) = (&self.recorder, &*self.arm);
            self.announcer.update(status, &self.frames, || View {
                observation: recorder.observation(),
                joint_noise: self.joint_noise.extent(arm),
            });
            sleep(PAUSE);
        }
        let event = self.recorder.end();
        self.handle(event)?;
        self.announcer.announce(&format!("ended, {} recorded", demonstrations(self.written)));
        Ok(())
    }

    /// Handles one state.
    fn update(&mut self, state: &RobotState) -> Result<(), RecordError> {
        let event = match self.states.check(state) {
            Ok(None) => return Ok(()),
            Ok(Some(skipped)) => {
                self.fault = None;
                self.joint_noise.update(&state.position);
                let pose = self.arm.tool_pose(&state.position);
                let frames = self.frames.at(state.time_ns);
                let grip = grip(state.gripper_state);
                let sample = Sample { time_ns: state.time_ns, pose, grip };
                self.recorder.observe(sample, frames, skipped)
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
            Some(Event::Begun { tool_as_start: false }) => self.announcer.announce("recording"),
            Some(Event::Begun { tool_as_start: true }) => self.announcer.announce(&format!(
                "recording; frame `{}` is not published: the tool's pose at the start serves as such",
                self.skill.start_frame
            )),
            Some(Event::Refused(why)) => self.announcer.announce(&format!("not recorded: {why}")),
            Some(Event::Recorded(recorded)) => self.save(*recorded)?,
        }
        Ok(())
    }

    fn save(&mut self, recorded: Recorded) -> Result<(), RecordError> {
        let Skill { start_frame, goal_frame, .. } = &self.skill;
        match self.folder.save(&recorded.demonstration, start_frame, goal_frame) {
            Ok(path) => {
                self.written += 1;
                self.announcer.beside(|| {
                    outln!("wrote      {}: {}", path.display(), recorded.summary());
                    for note in &recorded.notes {
                        outln!("note       {note}");
                    }
                });
                Ok(())
            }
            // What training would refuse is no demonstration; the next one may be.
            Err(FileError::Input { place, problem, .. }) => {
                self.announcer.announce(&format!("not recorded: {place}: {problem}"));
                Ok(())
            }
            Err(error) => Err(error.into()),
        }
    }
}

/// What a gripper senses, where it is known.
fn grip(state: u32) -> Option<Grip> {
    match GripperState::from_wire(state)? {
        GripperState::None => None,
        GripperState::Open => Some(Grip::Open),
        GripperState::Holding => Some(Grip::Closed),
    }
}

fn demonstrations(count: u32) -> String {
    format!("{count} demonstration{}", if count == 1 { "" } else { "s" })
}
