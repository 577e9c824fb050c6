//! External commands of the tool beside the skill: over real ports, in lockstep with an arm that does
//! exactly what it is commanded.

use std::path::Path;

use glam::DVec3;
use nalgebra::SVector;
use tprmp_controller::motion::limits::JointLimits;
use tprmp_controller::startup;
use tprmp_controller::timing::pacing::Pacing;
use tprmp_messages::{
    CommandMode, Instance, JointCommand, LifeCycle, Obstacle, ObstacleKind, Reason, ToolCommand,
};
use tprmp_model::controller_config::{self, ControllerConfig};
use tprmp_robot::{Chain, ControlPoints, Kinematics, forward_kinematics, point_position};

use crate::common::{Controller, Outcome, PLANE, POSES, Setting, answer, file};

const MS: u64 = 1_000_000;
/// The first states confirm each other: nothing is commanded before.
const CONFIRMING: u64 = 2;

/// What the arm was commanded, and how the controller ended.
struct Motion {
    commands: Vec<JointCommand>,
    last_life_cycle: LifeCycle,
    outcome: Outcome,
}

impl Motion {
    fn position<const N: usize>(&self, tick: usize) -> SVector<f64, N> {
        SVector::from_column_slice(&self.commands[tick].position[..N])
    }

    /// Largest change of a joint's acceleration from a tick to the next.
    fn jump_max(&self) -> f64 {
        let change = |pair: &[JointCommand]| {
            let joints = pair[0].acceleration.iter().zip(&pair[1].acceleration);
            joints.map(|(a, b)| (b - a).abs()).fold(0.0, f64::max)
        };
        self.commands.windows(2).map(change).fold(0.0, f64::max)
    }
}

/// Runs `ticks` of 1 ms. In each, `desired` is what is sent to the controller at that time \[ns\]; it is
/// `None` in a run in which nobody may command.
fn run(
    name: &str,
    setting: &Setting,
    edit: impl FnOnce(&mut ControllerConfig),
    obstacle: Option<Obstacle>,
    ticks: u64,
    desired: Option<&dyn Fn(u64, u64) -> Option<ToolCommand>>,
) -> Motion {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    let ports = instance.open_state_publisher().unwrap();
    let commander = desired.map(|desired| (desired, instance.open_tool_command().unwrap()));
    let controller = Controller::start(setting, &instance, Pacing::Lockstep, edit);
    let (mut state, mut frames) = (setting.state(), setting.frames());
    frames.obstacle_count = u32::from(obstacle.is_some());
    frames.obstacles[0] = obstacle.unwrap_or_default();
    let mut commands: Vec<JointCommand> = Vec::new();
    let mut step = || {
        if let Some(command) = commands.last() {
            (state.position, state.velocity) = (command.position, command.velocity);
        }
        state.sequence += 1;
        frames.sequence += 1;
        let time_ns = 1000 * MS + state.sequence * MS;
        (state.time_ns, frames.time_ns) = (time_ns, time_ns);
        let tick = state.sequence.saturating_sub(CONFIRMING);
        if let Some((desired, port)) = &commander
            && let Some(command) = (tick > 0).then(|| desired(tick, time_ns)).flatten()
        {
            assert!(port.command.publish(command));
        }
        assert!(ports.frames.publish(frames) && ports.state.publish(state));
        let command = answer(&ports, state.sequence);
        if tick > 0 {
            commands.push(command);
        }
    };
    (0..ticks + CONFIRMING).for_each(|_| step());
    let outcome = controller.stop(|| {
        state.sequence += 1;
        state.time_ns += MS;
        assert!(ports.state.publish(state));
    });
    assert_eq!(outcome.run.allocations, 0);
    assert_eq!(outcome.run.connections.allocations, 0);
    assert!(outcome.ticks >= ticks);
    let last_life_cycle = outcome.run.life_cycle;
    Motion { commands, last_life_cycle, outcome }
}

fn command(sequence: u64, time_ns: u64, linear_velocity: [f64; 3]) -> ToolCommand {
    ToolCommand { sequence, time_ns, linear_velocity, ..Default::default() }
}

fn robot<const N: usize>(setting: &Setting) -> (ControllerConfig, Chain<N>, ControlPoints) {
    let path = file(setting.config);
    let config = controller_config::read(&path).unwrap();
    let (chain, points) = startup::robot::<N>(Path::new(setting.config), &config).unwrap();
    (config, chain, points)
}

fn kinematics<const N: usize>(chain: &Chain<N>, position: &SVector<f64, N>) -> Kinematics<N> {
    let mut kinematics = Kinematics::new();
    forward_kinematics(chain, position, &mut kinematics);
    kinematics
}

/// Whether two arms were commanded the same, bit by bit.
fn same(one: &Motion, other: &Motion) -> bool {
    let text = |motion: &Motion| format!("{:?}", motion.commands);
    one.commands.len() == other.commands.len() && text(one) == text(other)
}

fn within_limits<const N: usize>(motion: &Motion, config: &ControllerConfig, chain: &Chain<N>) {
    let limits = JointLimits::new(chain, &config.robot);
    for command in &motion.commands {
        for i in 0..N {
            let (q, v, a) = (command.position[i], command.velocity[i], command.acceleration[i]);
            assert!(q >= chain.position_lower()[i] && q <= chain.position_upper()[i], "{q}");
            assert!(v.abs() <= limits.velocity_max[i] * (1.0 + 1e-12), "{v}");
            assert!(a.abs() <= limits.acceleration_max[i] * (1.0 + 1e-12), "{a}");
        }
    }
}

#[test]
fn a_command_moves_the_point_and_let_go_it_goes_on_to_its_goal() {
    let without = run("ext-none", &PLANE, |_| {}, None, 6000, None);
    let desired = |tick: u64, time_ns| {
        (300..800).contains(&tick).then(|| command(tick, time_ns, [0.0, -0.5, 0.0]))
    };
    let with = run("ext-plane", &PLANE, |_| {}, None, 6000, Some(&desired));
    let y = |motion: &Motion, tick| motion.position::<2>(tick)[1];
    assert!(y(&with, 790) < y(&without, 790) - 0.15, "{} {}", y(&with, 790), y(&without, 790));
    // The skill leans on it, the more the farther it is from its path.
    let speed = with.commands[790].velocity[1];
    assert!((-0.55..-0.2).contains(&speed), "{speed}");
    for motion in [&without, &with] {
        assert_eq!(motion.last_life_cycle, LifeCycle::Done);
        let away = motion.position::<2>(5999) - nalgebra::Vector2::new(0.6, 0.3);
        assert!(away.norm() < 0.003, "{away}");
        let modes = motion.commands.iter().map(|command| (command.mode, command.reason));
        let track = (CommandMode::Track.to_wire(), Reason::None.to_wire());
        assert!(modes.into_iter().all(|mode| mode == track));
    }
    // At once, d |v_c − v| of up to 8 m/s² would come from a tick to the next. Over the 50 ticks of the
    // fade, it is at most a fiftieth of that by the ratio of the inertias, which the model has up to 6.
    let (one, other) = (with.jump_max(), without.jump_max());
    assert!(one < other + 6.0 * 8.0 / 50.0, "{one} {other}");
    let (config, chain, _) = robot::<2>(&PLANE);
    within_limits(&with, &config, &chain);
}

#[test]
fn without_a_command_or_with_rubbish_the_arm_is_told_what_a_deaf_controller_tells_it() {
    for (name, setting) in [("plane", &PLANE), ("poses", &POSES)] {
        let go = |part: &str, desired: Option<&dyn Fn(u64, u64) -> Option<ToolCommand>>| {
            run(&format!("ext-{name}-{part}"), setting, |_| {}, None, 1500, desired)
        };
        let deaf = |config: &mut ControllerConfig| config.external = None;
        let deaf = run(&format!("ext-{name}-deaf"), setting, deaf, None, 1500, None);
        assert!(same(&deaf, &go("none", None)), "nobody commands");
        assert!(same(&deaf, &go("silent", Some(&|_, _| None))), "nobody commands");
        let rubbish = |tick: u64, time_ns: u64| {
            let good = command(tick, time_ns, [0.2, 0.2, 0.0]);
            Some(match tick % 5 {
                0 => command(tick, time_ns, [f64::NAN, 0.0, 0.0]),
                1 => ToolCommand { angular_velocity: [0.0, f64::INFINITY, 0.0], ..good },
                2 => ToolCommand { time_ns: time_ns - 200 * MS, ..good },
                3 => ToolCommand { time_ns: time_ns + 200 * MS, ..good },
                _ => ToolCommand { time_ns: u64::MAX, ..good },
            })
        };
        assert!(same(&deaf, &go("rubbish", Some(&rubbish))), "rubbish is sent");
        let good = |tick, time_ns| Some(command(tick, time_ns, [0.2, 0.2, 0.0]));
        assert!(!same(&deaf, &go("good", Some(&good))), "the comparison sees nothing");
    }
}

#[test]
fn a_huge_command_is_worth_the_maximum_and_no_limit_is_left() {
    let go = |name: &str, size: f64| {
        let desired = move |tick, time_ns| {
            let linear_velocity = [0.6 * size, -0.8 * size, 0.0];
            let angular_velocity = [0.0, 0.0, size];
            Some(ToolCommand { angular_velocity, ..command(tick, time_ns, linear_velocity) })
        };
        run(name, &POSES, |_| {}, None, 2000, Some(&desired))
    };
    let (config, chain, _) = robot::<6>(&POSES);
    let (huge, larger) = (go("ext-huge", 1e6), go("ext-larger", f64::MAX));
    within_limits(&huge, &config, &chain);
    let at =
        |motion: &Motion, tick| kinematics(&chain, &motion.position::<6>(tick)).tool_position();
    for tick in [100, 500, 1999] {
        assert!(at(&huge, tick).distance(at(&larger, tick)) < 1e-9);
    }
}

#[test]
fn a_command_leads_an_arm_s_tool_along_it() {
    let (config, chain, _) = robot::<6>(&POSES);
    let direction = DVec3::new(0.1, 0.15, 0.1);
    let desired = |tick: u64, time_ns| {
        (400..1000).contains(&tick).then(|| command(tick, time_ns, direction.to_array()))
    };
    let without = run("ext-arm-none", &POSES, |_| {}, None, 1200, None);
    let with = run("ext-arm", &POSES, |_| {}, None, 1200, Some(&desired));
    let tool =
        |motion: &Motion, tick| kinematics(&chain, &motion.position::<6>(tick)).tool_position();
    // The state of number 400 is answered in tick 399.
    assert_eq!(tool(&with, 398), tool(&without, 398));
    let along =
        |motion: &Motion| (tool(motion, 999) - tool(motion, 499)).dot(direction.normalize()) / 0.5;
    let (commanded, free) = (along(&with), along(&without));
    let asked = direction.length();
    assert!((commanded - asked).abs() < 0.5 * (free - asked).abs(), "{commanded} {free} {asked}");
    within_limits(&with, &config, &chain);
}

#[test]
fn a_command_into_an_obstacle_does_not_lead_there() {
    let ball = Obstacle {
        kind: ObstacleKind::Sphere.to_wire(),
        valid: 1,
        position: [0.1, -0.4, 0.0],
        quaternion: [1.0, 0.0, 0.0, 0.0],
        size: [0.1, 0.0, 0.0],
        ..Default::default()
    };
    // Always straight at it, however the point moves around it.
    let (_, _, points) = robot::<2>(&PLANE);
    let radius = points.as_slice()[0].radius + 0.1;
    let desired = |tick, time_ns| Some(command(tick, time_ns, [0.0, -5.0, 0.0]));
    let commanded = run("ext-ball", &PLANE, |_| {}, Some(ball), 4000, Some(&desired));
    let centre = nalgebra::Vector2::new(0.1, -0.4);
    let distances = (0..4000).map(|tick| (commanded.position::<2>(tick) - centre).norm());
    let least = distances.fold(f64::INFINITY, f64::min);
    assert!(least > radius, "{least} {radius}");
    assert!(least < radius + 0.3, "it did not come there: {least}");
}

#[test]
fn a_command_into_the_table_does_not_lead_an_arm_there() {
    let (config, chain, points) = robot::<6>(&POSES);
    let start = kinematics(&chain, &SVector::from_column_slice(&POSES.state().position[..6]));
    let height = |kinematics: &Kinematics<6>| {
        let wrist = points.as_slice().iter().filter(|point| point.joint >= 3);
        let lowest = wrist
            .map(|point| point_position(kinematics, point.joint, point.centre).z - point.radius);
        lowest.fold(f64::INFINITY, f64::min)
    };
    let table_m = height(&start) - 0.1;
    let table = Obstacle {
        kind: ObstacleKind::HalfSpace.to_wire(),
        valid: 1,
        position: [0.0, 0.0, table_m],
        quaternion: [1.0, 0.0, 0.0, 0.0],
        ..Default::default()
    };
    let desired = |tick, time_ns| Some(command(tick, time_ns, [0.0, 0.0, -1.0]));
    let commanded = run("ext-table", &POSES, |_| {}, Some(table), 4000, Some(&desired));
    let heights = (0..4000).map(|tick| height(&kinematics(&chain, &commanded.position::<6>(tick))));
    let least = heights.fold(f64::INFINITY, f64::min) - table_m;
    assert!(least > 0.0, "{least}");
    assert!(least < 0.05, "it did not come there: {least}");
    within_limits(&commanded, &config, &chain);
}

#[test]
fn an_arm_that_is_held_is_not_out_of_reach_and_goes_on_when_it_is_let_go() {
    // So heavy that the skill hardly moves the point.
    let edit = |config: &mut ControllerConfig| {
        config.external.as_mut().unwrap().linear_inertia_kg = 1e6;
    };
    let desired = |tick: u64, time_ns| (tick < 3000).then(|| command(tick, time_ns, [0.0; 3]));
    let motion = run("ext-held", &PLANE, edit, None, 8000, Some(&desired));
    let moved = (motion.position::<2>(2900) - motion.position::<2>(0)).norm();
    assert!(moved < 0.01, "it is not held: {moved}");
    assert!(motion.commands.iter().all(|command| command.reason == Reason::None.to_wire()));
    assert_eq!(motion.last_life_cycle, LifeCycle::Done);
    assert!(motion.outcome.ticks >= 8000);
}
