//! One run of an arm beside a controller, in lockstep.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use glam::DVec3;
use nalgebra::SVector;
use tprmp_messages::{
    CommandMode, Frame, Instance, JointCommand, Obstacle, ObstacleKind, RobotState,
    StatePublisherPorts, TaskFrames, joint_names_hash,
};
use tprmp_model::skill_model::SkillModel;
use tprmp_robot::{Chain, Kinematics, forward_kinematics};
use tprmp_spatial::Pose;

use crate::world::Meshes;

/// Between two states \[s\].
const STEP_S: f64 = 0.002;
/// Longest run \[s\].
const TIME_MAX_S: f64 = 20.0;
/// Contacts are looked for once in so many states.
const LOOK_EVERY: u64 = 10;
/// Longest wait for the controller.
const PATIENCE: Duration = Duration::from_secs(60);

/// What is run.
pub(crate) struct Episode<'a, const N: usize> {
    pub(crate) chain: &'a Chain<N>,
    pub(crate) meshes: &'a Meshes,
    pub(crate) model: &'a SkillModel,
    pub(crate) home: SVector<f64, N>,
    /// Pose of the goal frame.
    pub(crate) goal: Pose,
    /// Pose of the tool at the goal.
    pub(crate) tool_goal: Pose,
    /// Ball beside the path: centre and radius \[m\].
    pub(crate) ball: (DVec3, f64),
    /// Height of the table \[m\].
    pub(crate) table_m: f64,
}

/// The files of a run.
pub(crate) struct Files<'a> {
    pub(crate) controller: &'a Path,
    pub(crate) config: &'a Path,
    pub(crate) model: &'a Path,
    pub(crate) summary: &'a Path,
}

/// What came out.
#[derive(Debug, Clone)]
pub(crate) struct Outcome {
    pub(crate) is_done: bool,
    pub(crate) time_s: f64,
    pub(crate) distance_mm: f64,
    pub(crate) angle_deg: f64,
    pub(crate) contacts: Vec<String>,
    /// Where the joints ended \[rad or m\].
    pub(crate) joints: Vec<f64>,
    pub(crate) said: String,
}

impl Outcome {
    /// Whether the goal was reached, without a contact.
    pub(crate) fn holds(&self) -> bool {
        self.is_done && self.distance_mm <= 3.0 && self.angle_deg <= 1.0 && self.contacts.is_empty()
    }
}

impl<const N: usize> Episode<'_, N> {
    /// Runs it.
    pub(crate) fn run(&self, name: &str, files: &Files<'_>) -> Result<Outcome, String> {
        let instance = Instance::new(name).map_err(|error| error.to_string())?;
        let ports = instance.open_state_publisher().map_err(|error| error.to_string())?;
        let mut controller = Command::new(files.controller)
            .arg("run")
            .arg(files.config)
            .arg("--model")
            .arg(files.model)
            .args(["--lockstep", "--until-done", "--instance", name, "--summary"])
            .arg(files.summary)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| format!("{}: {error}", files.controller.display()))?;
        let outcome = self.lockstep(&ports, &mut controller);
        // It leaves its summary when it is asked to stop.
        let id = rustix::process::Pid::from_child(&controller);
        let _ = rustix::process::kill_process(id, rustix::process::Signal::TERM);
        let said = controller.wait_with_output().map_err(|error| error.to_string())?;
        let mut outcome = outcome?;
        let said = String::from_utf8_lossy(&said.stderr);
        let before = said.lines().rev().find(|line| !line.contains("stopped"));
        outcome.said = before.unwrap_or_default().into();
        Ok(outcome)
    }

    fn lockstep(
        &self,
        ports: &StatePublisherPorts,
        controller: &mut Child,
    ) -> Result<Outcome, String> {
        let mut state = RobotState {
            joint_count: N as u32,
            joint_names_hash: joint_names_hash(self.chain.joint_names()),
            gripper_state: 1,
            ..RobotState::default()
        };
        let mut kinematics = Kinematics::new();
        forward_kinematics(self.chain, &self.home, &mut kinematics);
        let mut frames = self.frames()?;
        state.position[..N].copy_from_slice(self.home.as_slice());
        let (mut contacts, mut is_done) = (Vec::<String>::new(), false);
        while state.time_ns < (TIME_MAX_S * 1e9) as u64 {
            state.sequence += 1;
            state.time_ns += (STEP_S * 1e9) as u64;
            frames.sequence = state.sequence;
            frames.time_ns = state.time_ns;
            if !ports.frames.publish(frames) {
                return Err("frames were not published".into());
            }
            if !ports.state.publish(state) {
                return Err("a state was not published".into());
            }
            let Some(command) = answer(ports, state.sequence, controller)? else {
                is_done = true;
                break;
            };
            if command.mode != CommandMode::Stop.to_wire() {
                state.position = command.position;
                state.velocity = command.velocity;
            } else {
                state.velocity = Default::default();
            }
            forward_kinematics(self.chain, &position(&state), &mut kinematics);
            if state.sequence.is_multiple_of(LOOK_EVERY) {
                for contact in self.meshes.contacts(&kinematics, self.ball, self.table_m) {
                    if !contacts.contains(&contact) {
                        contacts.push(contact);
                    }
                }
            }
        }
        let tool = kinematics.tool_pose();
        let aside = (self.tool_goal.position - tool.position).to_array();
        let turned = self.tool_goal.rotation_from(&tool).to_array();
        // In what the skill decides about.
        let length = |part: [f64; 3], first: usize| {
            let decided = |axis: &usize| self.model.manifold.moved().contains(&(axis + first));
            (0..3).filter(decided).map(|axis| part[axis] * part[axis]).sum::<f64>().sqrt()
        };
        Ok(Outcome {
            is_done,
            time_s: state.time_ns as f64 * 1e-9,
            distance_mm: 1e3 * length(aside, 0),
            // The sum of nothing is −0.
            angle_deg: length(turned, 3).to_degrees() + 0.0,
            contacts,
            joints: state.position[..N].to_vec(),
            said: String::new(),
        })
    }

    fn frames(&self) -> Result<TaskFrames, String> {
        // The controller finds by itself where the tool starts.
        let mut frames = TaskFrames { frame_count: 1, obstacle_count: 2, ..TaskFrames::default() };
        let goal = Frame::at(&self.model.goal_frame, self.goal.position.into());
        let q = self.goal.orientation;
        frames.frames[0] =
            Frame { quaternion: [q.w, q.x, q.y, q.z], ..goal.map_err(|error| error.to_string())? };
        let upright = [1.0, 0.0, 0.0, 0.0];
        frames.obstacles[0] = Obstacle {
            kind: ObstacleKind::Sphere.to_wire(),
            valid: 1,
            position: self.ball.0.into(),
            quaternion: upright,
            size: [self.ball.1, 0.0, 0.0],
            ..Obstacle::default()
        };
        frames.obstacles[1] = Obstacle {
            kind: ObstacleKind::HalfSpace.to_wire(),
            valid: 1,
            position: [0.0, 0.0, self.table_m],
            quaternion: upright,
            ..Obstacle::default()
        };
        Ok(frames)
    }
}

fn position<const N: usize>(state: &RobotState) -> SVector<f64, N> {
    SVector::from_fn(|i, _| state.position[i])
}

/// The command that answers a state; `None` once the controller has ended.
fn answer(
    ports: &StatePublisherPorts,
    sequence: u64,
    controller: &mut Child,
) -> Result<Option<JointCommand>, String> {
    let begun = Instant::now();
    loop {
        let _ = ports.state.update_connections();
        let _ = ports.frames.update_connections();
        match ports.command.receive() {
            Some(command) if command.state_sequence == sequence => return Ok(Some(*command)),
            Some(_) => {}
            None if begun.elapsed() > PATIENCE => {
                return Err("no answer from the controller".into());
            }
            None => {
                let ended = controller.try_wait().map_err(|error| error.to_string())?;
                match ended {
                    Some(status) if status.success() => return Ok(None),
                    Some(status) => return Err(format!("the controller ended with {status}")),
                    None => std::thread::sleep(Duration::from_micros(20)),
                }
            }
        }
    }
}
