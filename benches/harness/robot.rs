//! A robot that follows every command exactly, between frames and obstacles that move: the publisher
//! of states. The policy has work in every tick, and no dynamics stand between the parties.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, TAU};

use serde::{Deserialize, Serialize};
use tprmp_controller::timing::realtime::monotonic_ns;
use tprmp_messages::{
    CommandMode, Frame, GripperState, JOINT_CAPACITY, Obstacle, ObstacleKind, RobotState,
    StatePublisherPorts, TaskFrames, name_bytes,
};

/// A shipped skill and its configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Skill {
    /// A point in the plane.
    Planar,
    /// The UR5's pick.
    Pick,
}

/// Frames and obstacles move on circles at this speed \[rad/s\].
const SPEED_RAD_S: f64 = 0.9;
/// Where the UR5 starts, and its tool's pose there \[rad, m\].
const PICK_POSITION: [f64; 6] = [-2.7416, -FRAC_PI_2, FRAC_PI_2, -FRAC_PI_2, -FRAC_PI_2, 0.4];
const PICK_TOOL: ([f64; 3], [f64; 4]) =
    ([0.405_96, 0.290_14, 0.311_86], [0.0, FRAC_1_SQRT_2, -FRAC_1_SQRT_2, 0.0]);
const NO_ROTATION: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

impl Skill {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Planar, Self::Pick];

    /// Its name, also of its skill file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Planar => "planar",
            Self::Pick => "pick",
        }
    }

    /// Its controller's configuration, inside the repository.
    pub fn controller(self) -> &'static str {
        match self {
            Self::Planar => "config/controllers/planar.ron",
            Self::Pick => "config/controllers/ur5_pick.ron",
        }
    }

    fn start(self) -> RobotState {
        let start: &[f64] = match self {
            Self::Planar => &[-1.2, 0.0],
            Self::Pick => &PICK_POSITION,
        };
        let mut position = [0.0; JOINT_CAPACITY];
        position[..start.len()].copy_from_slice(start);
        RobotState {
            joint_count: start.len() as u32,
            // The object is never held, so that the skill goes on for ever.
            gripper_state: GripperState::Open.to_wire(),
            position,
            ..Default::default()
        }
    }

    /// Frames and obstacles, after a time \[s\].
    fn scene(self, time_s: f64) -> TaskFrames {
        let angle = (SPEED_RAD_S * time_s) % TAU;
        let circle = |centre: [f64; 3], radius: f64| {
            let (sin, cos) = angle.sin_cos();
            let speed = radius * SPEED_RAD_S;
            let [x, y, z] = centre;
            ([x + radius * cos, y + radius * sin, z], [-speed * sin, speed * cos, 0.0])
        };
        let frame = |name: &str, (position, linear_velocity), quaternion| Frame {
            name: name_bytes(name).unwrap_or_default(),
            valid: 1,
            position,
            quaternion,
            linear_velocity,
            ..Default::default()
        };
        let obstacle = |kind: ObstacleKind, (position, linear_velocity), radius: f64| Obstacle {
            kind: kind.to_wire(),
            valid: 1,
            position,
            quaternion: NO_ROTATION,
            linear_velocity,
            angular_velocity: [0.0; 3],
            size: [radius, 0.0, 0.0],
        };
        let still = |position: [f64; 3]| (position, [0.0; 3]);
        let mut scene = TaskFrames { frame_count: 2, ..Default::default() };
        match self {
            Self::Planar => {
                scene.frames[0] = frame("start", still([-1.2, 0.0, 0.0]), NO_ROTATION);
                scene.frames[1] = frame("end", circle([1.0, 0.0, 0.0], 0.2), NO_ROTATION);
                let sphere = circle([0.0, 0.9, 0.0], 0.2);
                scene.obstacles[0] = obstacle(ObstacleKind::Sphere, sphere, 0.1);
                scene.obstacle_count = 1;
            }
            Self::Pick => {
                let (position, quaternion) = PICK_TOOL;
                scene.frames[0] = frame("ee_start", still(position), quaternion);
                scene.frames[1] = frame("object", circle([0.5, -0.25, 0.03], 0.15), NO_ROTATION);
                let sphere = circle([0.48, 0.0, 0.25], 0.05);
                scene.obstacles[0] = obstacle(ObstacleKind::Sphere, sphere, 0.06);
                scene.obstacles[1] = obstacle(ObstacleKind::HalfSpace, still([0.0; 3]), 0.0);
                scene.obstacle_count = 2;
            }
        }
        scene
    }
}

/// The robot and its surroundings.
#[derive(Debug)]
pub struct Robot {
    skill: Skill,
    state: RobotState,
    started_ns: u64,
}

impl Robot {
    /// At the skill's start.
    pub fn new(skill: Skill) -> Self {
        Self { skill, state: skill.start(), started_ns: monotonic_ns() }
    }

    /// Is where the newest command wants it, if there is a new one; gives the state it answers.
    pub fn obey(&mut self, ports: &StatePublisherPorts) -> Option<u64> {
        let command = ports.command.receive()?;
        if command.mode == CommandMode::Stop.to_wire() {
            self.state.velocity = [0.0; JOINT_CAPACITY];
        } else {
            self.state.position = command.position;
            self.state.velocity = command.velocity;
        }
        Some(command.state_sequence)
    }

    /// Publishes frames and obstacles, then the state. Gives the state's sequence number and when
    /// it was handed over \[ns\].
    pub fn publish(&mut self, ports: &StatePublisherPorts) -> (u64, u64) {
        let sequence = self.state.sequence + 1;
        let now_ns = monotonic_ns();
        let time_s = (now_ns - self.started_ns) as f64 * 1e-9;
        let frames = TaskFrames { sequence, time_ns: now_ns, ..self.skill.scene(time_s) };
        let _ = ports.frames.publish(frames);
        let handed_over_ns = monotonic_ns();
        self.state.sequence = sequence;
        self.state.time_ns = handed_over_ns;
        let _ = ports.state.publish(self.state);
        (sequence, handed_over_ns)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::SVector;
    use tprmp_controller::startup;
    use tprmp_model::controller_config;
    use tprmp_robot::{Kinematics, forward_kinematics_with_velocity};

    use super::*;

    #[test]
    fn the_start_frame_is_where_the_tool_starts() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join(Skill::Pick.controller());
        let read = controller_config::read(&config).unwrap();
        let (chain, _) = startup::robot::<6>(&config, &read).unwrap();
        let mut kinematics = Kinematics::new();
        let (q, qd) = (SVector::from(PICK_POSITION), SVector::zeros());
        forward_kinematics_with_velocity(&chain, &q, &qd, &mut kinematics);
        let apart = kinematics.tool_position() - glam::DVec3::from(PICK_TOOL.0);
        assert!(apart.length() < 1e-4, "{apart}");
    }
}
