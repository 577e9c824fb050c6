//! What the tool carries: torques that hold it, and an object that keeps clear while the gripper holds it. The arm is
//! simulated with the mass on it, or does what it is commanded.

use glam::DVec3;
use nalgebra::SVector;
use tprmp_controller::inputs::estimator::JointState;
use tprmp_controller::motion::generator::MotionGenerator;
use tprmp_controller::motion::limits::JointLimits;
use tprmp_controller::timing::pacing::Pacing;
use tprmp_messages::{CommandMode, GripperState, Instance, JointCommand, Obstacle, ObstacleKind};
use tprmp_model::controller_config::{self, ControllerConfig, Gripped, Payload, Sphere};
use tprmp_robot::{Chain, Kinematics, forward_dynamics, forward_kinematics};
use tprmp_spatial::Pose;

use crate::common::{Controller, POSES, answer, file};

const N: usize = 6;
type Joints = SVector<f64, N>;
const MS: u64 = 1_000_000;
const LOAD: Payload = Payload { mass_kg: 1.5, centre_m: [0.0, 0.0, 0.06] };

fn config(payload: Option<Payload>) -> ControllerConfig {
    controller_config::read_with(&file(POSES.config), |config| config.robot.payload = payload)
        .unwrap()
}

fn chain(config: &ControllerConfig) -> Chain<N> {
    Chain::from_urdf(&config.robot.urdf, config.robot.selection()).unwrap()
}

fn tool(chain: &Chain<N>, q: &Joints) -> Pose {
    let mut kinematics = Kinematics::new();
    forward_kinematics(chain, q, &mut kinematics);
    kinematics.tool_pose()
}

const TICKS: usize = 4000;

/// How far the tool has sunk in the second half of four seconds in which an arm is held at rest \[m\], and the largest step
/// of a torque from a tick to the next \[N m\]. From `loaded_at` on its tool carries the load.
fn sinks(known: Option<Payload>, gripped: Option<Payload>, loaded_at: usize) -> (f64, f64) {
    let mut config = config(known);
    // What finds an unknown load in time is left out: what is known shows.
    config.disturbance = None;
    let (ours, bare, loaded) =
        (chain(&config), chain(&self::config(None)), chain(&self::config(Some(LOAD))));
    let gravity = config.robot.gravity_m_s2.into();
    let limits = JointLimits::new(&ours, &config.robot);
    config.gripped = gripped.map(|Payload { mass_kg, centre_m }| Gripped {
        mass_kg,
        centre_m,
        spheres: vec![],
        obstacle_within_m: 0.0,
    });
    let mut motion = MotionGenerator::new(limits, &config).gripping(&ours, &config);
    let start = Joints::from([-2.7, -1.2, 1.2, -1.6, -1.6, 0.4]);
    let mut state = JointState { position: start, velocity: Joints::zeros() };
    let (dt, mut step, mut before) = (1e-3, 0.0_f64, None);
    let mut mean = Joints::zeros();
    for tick in 0..TICKS {
        let holds = tick >= loaded_at;
        motion.hold(holds, dt);
        let (setpoint, _) = motion.brake(&ours, Some(state), false, dt).unwrap();
        let torques = setpoint.torques.motion + setpoint.torques.gravity;
        step = step.max(before.map_or(0.0, |before: Joints| (torques - before).amax()));
        before = Some(torques);
        let plant = if holds { &loaded } else { &bare };
        let JointState { position, velocity } = &mut state;
        let acceleration = forward_dynamics(plant, position, velocity, &torques, gravity).unwrap();
        *velocity += acceleration * dt;
        *position += *velocity * dt;
        if tick >= TICKS / 2 {
            mean += *position / (TICKS - TICKS / 2) as f64;
        }
    }
    ((tool(&ours, &mean).position - tool(&ours, &start).position).length(), step)
}

#[test]
fn a_known_load_does_not_sink_and_an_unknown_one_does() {
    let (unknown, _) = sinks(None, None, 0);
    let (known, _) = sinks(Some(LOAD), None, 0);
    let (gripped, _) = sinks(None, Some(LOAD), 0);
    println!("unknown {unknown} m, known {known} m, gripped {gripped} m");
    assert!(unknown > 1e-3, "{unknown}");
    assert!(known < 0.01 * unknown, "{known}");
    assert!(gripped < 0.01 * unknown, "{gripped}");
}

#[test]
fn the_torque_for_what_is_gripped_is_faded_in() {
    let (unknown, _) = sinks(None, None, 500);
    let (known, step) = sinks(None, Some(LOAD), 500);
    println!("unknown {unknown} m, known {known} m, {step} N m");
    assert!(known < 0.01 * unknown, "{known} {unknown}");
    // 1.5 kg at less than a metre, in 50 ms.
    assert!(step < 1.5 * 9.81 / 50.0 * 1.5, "{step}");
}

const OBJECT: Sphere = Sphere { position_m: [0.0, 0.0, 0.09], radius_m: 0.05 };
const BALL_RADIUS: f64 = 0.03;

fn gripped() -> Gripped {
    Gripped {
        mass_kg: 0.0,
        centre_m: OBJECT.position_m,
        spheres: vec![OBJECT],
        obstacle_within_m: 0.02,
    }
}

/// A ball at rest, or one that is where the object is \[m\].
#[derive(Clone, Copy)]
enum Ball {
    None,
    At(DVec3),
    Object,
}

/// Runs the skill with a gripper that holds something; what the arm was commanded.
fn run(name: &str, gripped: Option<Gripped>, ball: Ball) -> Vec<JointCommand> {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    let ports = instance.open_state_publisher().unwrap();
    let controller = Controller::start(&POSES, &instance, Pacing::Lockstep, |config| {
        (config.gripped, config.lift, config.approach) = (gripped, None, None);
    });
    let chain = chain(&config(None));
    let (mut state, mut frames) = (POSES.state(), POSES.frames());
    state.gripper_state = GripperState::Holding.to_wire();
    let mut commands: Vec<JointCommand> = Vec::new();
    for _ in 0..6000 {
        if let Some(command) = commands.last().filter(|c| c.mode == CommandMode::Track.to_wire()) {
            (state.position, state.velocity) = (command.position, command.velocity);
        }
        state.sequence += 1;
        frames.sequence += 1;
        let time_ns = 1000 * MS + state.sequence * MS;
        (state.time_ns, frames.time_ns) = (time_ns, time_ns);
        let object = object(&chain, &state.position);
        let place = match ball {
            Ball::None => None,
            Ball::At(place) => Some(place),
            Ball::Object => Some(object),
        };
        frames.obstacle_count = u32::from(place.is_some());
        frames.obstacles[0] = Obstacle {
            kind: ObstacleKind::Sphere.to_wire(),
            valid: 1,
            position: place.unwrap_or_default().to_array(),
            quaternion: [1.0, 0.0, 0.0, 0.0],
            size: [BALL_RADIUS, 0.0, 0.0],
            ..Default::default()
        };
        assert!(ports.frames.publish(frames) && ports.state.publish(state));
        commands.push(answer(&ports, state.sequence));
    }
    let outcome = controller.stop(|| {
        state.sequence += 1;
        state.time_ns += MS;
        assert!(ports.state.publish(state));
    });
    assert_eq!(outcome.run.allocations, 0);
    commands
}

/// Centre of the object \[m\].
fn object(chain: &Chain<N>, position: &[f64]) -> DVec3 {
    let q = Joints::from_column_slice(&position[..N]);
    tool(chain, &q).transform_point(OBJECT.position_m.into())
}

/// The least clearance of the object from a ball at rest \[m\], while the arm follows.
fn clearance(commands: &[JointCommand], ball: DVec3) -> f64 {
    let chain = chain(&config(None));
    let clearance = |command: &JointCommand| {
        object(&chain, &command.position).distance(ball) - OBJECT.radius_m - BALL_RADIUS
    };
    let followed = commands.iter().filter(|c| c.mode == CommandMode::Track.to_wire());
    followed.map(clearance).fold(f64::INFINITY, f64::min)
}

fn apart(one: &[JointCommand], other: &[JointCommand]) -> f64 {
    let pair = |(a, b): (&JointCommand, &JointCommand)| {
        a.position.iter().zip(&b.position).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    one.iter().zip(other).map(pair).fold(0.0, f64::max)
}

#[test]
fn what_is_held_keeps_clear_of_what_the_bare_tool_passes() {
    let free = run("held-free", None, Ball::None);
    // A ball under the middle of the path, where the object would pass.
    let chain = chain(&config(None));
    let tool =
        |command: &JointCommand| tool(&chain, &Joints::from_column_slice(&command.position[..N]));
    let goal = |commands: &[JointCommand]| tool(&commands[commands.len() - 1]).position;
    let (start, end) = (tool(&free[10]).position, goal(&free));
    let is_halfway = |tool: &Pose| tool.position.distance(end) < 0.5 * start.distance(end);
    let middle = free.iter().map(tool).find(is_halfway);
    let ball = middle.unwrap().transform_point(DVec3::new(0.0, 0.0, 0.15));
    let bare = run("held-bare", None, Ball::At(ball));
    let held = run("held-object", Some(gripped()), Ball::At(ball));
    let [would, keeps] = [&bare, &held].map(|commands| clearance(commands, ball));
    let beside = goal(&held).distance(goal(&free));
    let step = held.windows(2).map(|w| {
        let joints = w[0].acceleration.iter().zip(&w[1].acceleration);
        joints.map(|(a, b)| (b - a).abs()).fold(0.0, f64::max)
    });
    let step = step.fold(0.0, f64::max);
    println!(
        "{start} to {end}: clearance without {would} m, with {keeps} m; {beside} m beside the goal; steps {step} rad/s²"
    );
    assert!(would < -0.01, "the bare tool does not pass so close: {would}");
    assert!(keeps > 0.0, "{keeps}");
    assert!(beside < 0.005, "{beside}");
    assert!(step < 3.0, "commands jump: {step}");
}

#[test]
fn the_obstacle_that_is_held_is_none() {
    let free = run("own-free", Some(gripped()), Ball::None);
    let own = run("own-object", Some(gripped()), Ball::Object);
    let unaware = Gripped { obstacle_within_m: 0.0, ..gripped() };
    let fought = run("own-fought", Some(unaware), Ball::Object);
    let [own, fought] = [own, fought].map(|commands| apart(&free, &commands));
    println!("own {own} rad, fought {fought} rad");
    assert!(own < 1e-9, "{own}");
    assert!(fought > 0.05, "{fought}");
}
