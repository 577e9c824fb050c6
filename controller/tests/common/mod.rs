//! What the tests over real ports have in common: settings of a robot with a skill, and a loop in a thread of
//! its own.

#![allow(dead_code, reason = "each test uses a part of it")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tprmp_controller::control::server::Shared;
use tprmp_controller::startup::{self, StartError, WithRobot};
use tprmp_controller::telemetry::RunOutcome;
use tprmp_controller::timing::pacing::Pacing;
use tprmp_messages::{Frame, Instance, JointCommand, RobotState, StatePublisherPorts, TaskFrames};
use tprmp_model::controller_config::ControllerConfig;

/// A file of the repository.
pub(crate) fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// A configuration, a model for it, and a state in which the robot stands still.
pub(crate) struct Setting {
    pub(crate) config: &'static str,
    pub(crate) model: &'static str,
    pub(crate) rest: &'static [f64],
    /// The skill's frames \[m\].
    pub(crate) frames: [(&'static str, [f64; 3]); 2],
}

pub(crate) const PLANE: Setting = Setting {
    config: "config/controllers/planar.ron",
    model: "learner/tests/golden/canonical_plane.ron",
    rest: &[0.1, 0.05],
    frames: [("start", [0.0, 0.0, 0.0]), ("end", [0.6, 0.3, 0.0])],
};
pub(crate) const POSES: Setting = Setting {
    config: "config/controllers/ur5_pick.ron",
    model: "learner/tests/golden/canonical_poses.ron",
    rest: &[-3.1, -1.5, 1.5, -1.5, -1.5, 0.0],
    frames: [("start", [0.4, 0.3, 0.3]), ("end", [0.5, -0.2, 0.1])],
};

impl Setting {
    /// The robot at rest.
    pub(crate) fn state(&self) -> RobotState {
        let joint_count = self.rest.len() as u32;
        let mut state = RobotState { joint_count, gripper_state: 1, ..Default::default() };
        state.position[..self.rest.len()].copy_from_slice(self.rest);
        state
    }

    /// The skill's frames, not rotated.
    pub(crate) fn frames(&self) -> TaskFrames {
        let mut frames = TaskFrames { frame_count: 2, ..Default::default() };
        for (frame, (name, position)) in frames.frames.iter_mut().zip(self.frames) {
            *frame = Frame::at(name, position).unwrap();
        }
        frames
    }
}

/// What a run came to.
pub(crate) struct Outcome {
    pub(crate) run: RunOutcome,
    pub(crate) ticks: u64,
}

struct Run {
    config_path: PathBuf,
    loaded: startup::Loaded,
    instance: Instance,
    pacing: Pacing,
    stop: Arc<AtomicBool>,
}

impl WithRobot for Run {
    type Output = Result<Outcome, StartError>;

    fn call<const N: usize>(self) -> Result<Outcome, StartError> {
        let mut cycle = startup::cycle::<N>(
            &self.config_path,
            &self.loaded,
            self.pacing,
            false,
            &self.instance,
            Shared::new(Arc::clone(&self.stop)),
        )?;
        let run = cycle.run(&self.stop);
        Ok(Outcome { run, ticks: cycle.telemetry().ticks })
    }
}

/// A loop that runs in a thread of its own.
pub(crate) struct Controller {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Outcome>,
}

impl Controller {
    /// Starts it.
    pub(crate) fn start(
        setting: &Setting,
        instance: &Instance,
        pacing: Pacing,
        edit: impl FnOnce(&mut ControllerConfig),
    ) -> Self {
        let config_path = file(setting.config);
        let loaded = startup::load_with(&config_path, edit, &[file(setting.model)], false).unwrap();
        let (stop, instance) = (Arc::new(AtomicBool::new(false)), instance.clone());
        let work = Run { config_path, loaded, instance, pacing, stop: Arc::clone(&stop) };
        let joints = setting.rest.len();
        let thread = std::thread::spawn(move || match joints {
            2 => work.call::<2>().unwrap(),
            _ => work.call::<6>().unwrap(),
        });
        Self { stop, thread }
    }

    /// Stops it while `publish` goes on with states.
    pub(crate) fn stop(self, mut publish: impl FnMut()) -> Outcome {
        self.stop.store(true, Ordering::Relaxed);
        while !self.thread.is_finished() {
            publish();
            std::thread::sleep(Duration::from_micros(100));
        }
        self.thread.join().unwrap()
    }
}

/// Waits for the command that answers the state of this number.
pub(crate) fn answer(ports: &StatePublisherPorts, sequence: u64) -> JointCommand {
    let start = Instant::now();
    loop {
        assert!(start.elapsed() < Duration::from_secs(60), "no answer from the controller");
        assert!(ports.state.update_connections() && ports.frames.update_connections());
        match ports.command.receive() {
            Some(command) if command.state_sequence == sequence => return *command,
            _ => std::thread::sleep(Duration::from_micros(20)),
        }
    }
}
