//! Whatever the policy wants and whatever is measured: no command leaves the limits.

use std::path::{Path, PathBuf};

use glam::DQuat;
use nalgebra::SVector;
use proptest::prelude::*;
use tprmp_controller::inputs::estimator::JointState;
use tprmp_controller::inputs::external::ExternalCommand;
use tprmp_controller::inputs::scene::Scene;
use tprmp_controller::motion::generator::{MotionGenerator, Setpoint};
use tprmp_controller::motion::limits::JointLimits;
use tprmp_controller::policy::{RobotPolicy, Task, TaskParameters};
use tprmp_controller::startup;
use tprmp_messages::{
    Frame, Obstacle, ObstacleKind, PublishedFrames, Reason, RobotState, TaskFrames, ToolCommand,
    name_bytes,
};
use tprmp_model::controller_config::{self, ControllerConfig};
use tprmp_robot::{Chain, Kinematics, forward_kinematics_with_velocity};

const N: usize = 6;
type Joints = SVector<f64, N>;

fn shipped() -> (ControllerConfig, Chain<N>) {
    let root: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let config = controller_config::read(&root.join("config/controllers/ur5_pick.ron")).unwrap();
    let chain = Chain::<N>::from_urdf(&config.robot.urdf, config.robot.selection()).unwrap();
    (config, chain)
}

/// What happens in a tick.
#[derive(Debug, Clone)]
enum Event {
    /// The policy wants this, as far as numbers go.
    Follow(Joints),
    /// A fault, with or without a measurement of the arm.
    Brake { measured: bool },
    /// The controller was held up.
    Gap,
}

/// How the measured arm relates to what was commanded.
#[derive(Debug, Clone)]
struct Measured {
    /// Added to the commanded position [rad] and velocity [rad/s].
    position: Joints,
    velocity: Joints,
    /// Put anywhere inside the robot's limits, as a fraction of their range.
    elsewhere: Option<[f64; N]>,
}

fn joints(range: f64) -> impl Strategy<Value = Joints> {
    prop::array::uniform6(-range..range).prop_map(Joints::from)
}

fn event() -> impl Strategy<Value = Event> {
    // From gentle to absurd: each decade equally likely, and now and then no number at all.
    let size = prop_oneof![40 => (-1.0..18.0_f64).prop_map(|e| 10_f64.powf(e)),
        1 => Just(f64::INFINITY), 1 => Just(f64::NAN)];
    prop_oneof![
        12 => (joints(1.0), size).prop_map(|(direction, size)| Event::Follow(direction * size)),
        2 => any::<bool>().prop_map(|measured| Event::Brake { measured }),
        1 => Just(Event::Gap),
    ]
}

fn measured() -> impl Strategy<Value = Measured> {
    let elsewhere =
        prop_oneof![30 => Just(None), 1 => prop::array::uniform6(0.0..=1.0).prop_map(Some)];
    (joints(0.02), joints(6.0), elsewhere).prop_map(|(position, velocity, elsewhere)| Measured {
        position,
        velocity,
        elsewhere,
    })
}

fn inside(
    setpoint: &Setpoint<N>,
    before: &mut Option<Setpoint<N>>,
    limits: &JointLimits<N>,
    chain: &Chain<N>,
    dt: f64,
) -> Result<(), TestCaseError> {
    let torque = setpoint.torques.motion + setpoint.torques.gravity;
    if let Some(before) = before.replace(*setpoint) {
        let (motion, last) = (&setpoint.motion, &before.motion);
        for (now, last, rate) in [
            (&motion.position, &last.position, &limits.velocity_max),
            (&motion.velocity, &last.velocity, &limits.acceleration_max),
            (&motion.acceleration, &last.acceleration, &limits.jerk_max),
            (&setpoint.torques.motion, &before.torques.motion, &limits.effort_rate_max),
            (&setpoint.torques.gravity, &before.torques.gravity, &limits.effort_rate_max),
        ] {
            for i in 0..N {
                let step = (now[i] - last[i]).abs();
                prop_assert!(step <= rate[i] * dt * (1.0 + 1e-6) + 1e-9, "{step} {}", rate[i] * dt);
            }
        }
    }
    for i in 0..N {
        let position = setpoint.motion.position[i];
        prop_assert!(
            position >= chain.position_lower()[i] && position <= chain.position_upper()[i]
        );
        prop_assert!(setpoint.motion.velocity[i].abs() <= limits.velocity_max[i] * (1.0 + 1e-12));
        prop_assert!(
            setpoint.motion.acceleration[i].abs() <= limits.acceleration_max[i] * (1.0 + 1e-12)
        );
        prop_assert!(torque[i].abs() <= limits.effort_max[i] * (1.0 + 1e-12));
        prop_assert!(setpoint.torques.gravity[i].abs() <= limits.effort_max[i]);
        prop_assert!(setpoint.torques.motion[i].is_finite());
    }
    Ok(())
}

/// Gains over many decades: from a policy of hardly any weight to one that outweighs all others.
fn decades() -> impl Strategy<Value = f64> {
    (-3.0..4.0_f64).prop_map(|e| 10_f64.powf(e))
}

/// A number as a broken publisher may send it.
fn number(range: f64) -> impl Strategy<Value = f64> {
    prop_oneof![60 => -range..range, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY),
        1 => Just(1e300), 1 => Just(-1e300), 1 => Just(1e-310)]
}

fn frame(name: &'static str) -> impl Strategy<Value = Frame> {
    let numbers = prop::collection::vec(number(2.0), 9);
    let rotation = (-4.0..4.0_f64, -4.0..4.0_f64, -4.0..4.0_f64);
    (numbers, rotation, prop_oneof![30 => Just(1), 1 => Just(0)]).prop_map(
        move |(n, rotation, valid)| {
            let rotation = DQuat::from_scaled_axis(rotation.into());
            Frame {
                name: name_bytes(name).unwrap(),
                valid,
                position: [n[0], n[1], n[2]],
                quaternion: [rotation.w, rotation.x, rotation.y, rotation.z],
                linear_velocity: [n[3], n[4], n[5]],
                angular_velocity: [n[6], n[7], n[8]],
                ..Default::default()
            }
        },
    )
}

fn obstacle() -> impl Strategy<Value = Obstacle> {
    let kind = 0..ObstacleKind::ALL.len() as u32;
    (kind, prop::collection::vec(number(1.0), 12)).prop_map(|(kind, n)| Obstacle {
        kind,
        valid: 1,
        position: [n[0], n[1], n[2]],
        quaternion: [1.0, 0.0, 0.0, 0.0],
        linear_velocity: [n[3], n[4], n[5]],
        angular_velocity: [n[9], n[10], n[11]],
        size: [n[6].abs(), n[7].abs(), n[8].abs()],
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Random gains and random messages, faulty ones too, through checks, policy, limits and torques.
    #[test]
    fn no_policy_and_no_message_lead_outside_the_limits(
        gains in prop::array::uniform8(decades()),
        start in prop::array::uniform6(0.0..=1.0_f64),
        messages in prop::collection::vec(
            (frame("start"), frame("end"), prop::collection::vec(obstacle(), 0..4),
                prop::collection::vec(number(4.0), N), prop::collection::vec(number(1.0), 6),
                1e-5..0.02_f64),
            1..40,
        ),
    ) {
        let root: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let config_path = root.join("config/controllers/ur5_pick.ron");
        let model = root.join("learner/tests/golden/canonical_poses.ron");
        let edit = |config: &mut ControllerConfig| {
            config.skill.linear_inertia_kg = gains[0];
            config.skill.angular_inertia_kg_m2 = gains[1];
            config.joint_damping.inertia = gains[2];
            config.joint_damping.damping_1_s = gains[3];
            config.external.as_mut().unwrap().linear_inertia_kg = gains[6];
            config.external.as_mut().unwrap().response_1_s = gains[7];
            config.impedance.natural_frequency_rad_s = gains[4].sqrt();
            config.impedance.damping_ratio = 0.5 * gains[5] / gains[4].sqrt();
        };
        let loaded = startup::load_with(&config_path, edit, &[model], false).unwrap();
        let (chain, points) = startup::robot::<N>(&config_path, &loaded.config).unwrap();
        let policy = RobotPolicy::new(chain, loaded.policies(), &points, &loaded.config);
        let chain = policy.chain();
        let limits = JointLimits::new(chain, &loaded.config.robot);
        let mut motion = MotionGenerator::new(limits, &loaded.config);
        let mut workspace = policy.workspace();
        let mut external = ExternalCommand::new(&loaded.config.external.unwrap());
        let names = ["start", "end"].map(|name| name_bytes(name).unwrap());
        let mut scene = Scene::new(names.into(), 1);
        let range = chain.position_upper() - chain.position_lower();
        let mut q = chain.position_lower() + range.component_mul(&Joints::from(start));
        let mut before = None;
        for (k, (first, second, obstacles, velocity, desired, dt)) in messages.into_iter().enumerate() {
            let mut state = RobotState { joint_count: N as u32, ..Default::default() };
            state.position[..N].copy_from_slice(q.as_slice());
            state.velocity[..N].copy_from_slice(&velocity);
            let time_ns = 1 + k as u64 * 1_000_000;
            let command = ToolCommand {
                sequence: 1 + k as u64,
                time_ns,
                linear_velocity: [desired[0], desired[1], desired[2]],
                angular_velocity: [desired[3], desired[4], desired[5]],
            };
            external.update(&command, time_ns);
            external.advance(time_ns, dt);
            let mut frames = TaskFrames {
                time_ns,
                frame_count: 2,
                obstacle_count: obstacles.len() as u32,
                ..Default::default()
            };
            frames.frames[..2].copy_from_slice(&[first, second]);
            frames.obstacles[..obstacles.len()].copy_from_slice(&obstacles);
            let published = PublishedFrames::of(&[&frames], time_ns, u64::MAX);
            let updated = scene.update(&published, &loaded.config.frame_observer);
            let measured = state.check(N).map(|[position, velocity]| JointState {
                position: Joints::from_column_slice(position),
                velocity: Joints::from_column_slice(velocity),
            });
            let decided = updated.and(measured).and_then(|state| {
                let parameters = TaskParameters {
                    frames: scene.frames(),
                    goal_frame: scene.goal_frame(),
                    obstacles: scene.obstacles(),
                    external: Some(&external),
                    dt_s: dt,
                };
                let (q, qd) = (&state.position, &state.velocity);
                policy
                    .evaluate(q, qd, &Task::Skill, &parameters, &mut workspace)
                    .map_err(|_| Reason::ResolveFailed)
                    .and_then(|decision| {
                        {
                            let closing_1_s = decision.proximity.closing_1_s;
                            motion.follow(chain, &state, &decision.acceleration, closing_1_s, dt)
                        }
                    })
            });
            let brake = |motion: &mut MotionGenerator<N>| motion.brake(chain, measured.ok(), false, dt);
            let setpoint = decided.ok().or_else(|| brake(&mut motion).map(|(setpoint, _)| setpoint));
            if let Some(setpoint) = setpoint {
                inside(&setpoint, &mut before, &limits, chain, dt)?;
                q = setpoint.motion.position;
            }
        }
    }

    /// A point an arm's length from the axis is driven at a wall as hard as the joint can.
    #[test]
    fn a_clearance_is_not_used_up_at_speed(
        room_m in 0.01..0.5_f64, joint in 0..N, arm_m in 0.1..1.0_f64, dt in 1e-3..4e-3_f64,
    ) {
        let (config, chain) = shipped();
        let limits = JointLimits::new(&chain, &config.robot);
        let mut motion = MotionGenerator::new(limits, &config);
        let mut state = JointState { position: Joints::zeros(), velocity: Joints::zeros() };
        state.position = (limits.position_lower + limits.position_upper) * 0.5;
        let begin = state.position[joint];
        let mut wanted = Joints::zeros();
        wanted[joint] = limits.acceleration_max[joint];
        let mut fastest: f64 = 0.0;
        for _ in 0..(6.0 / dt) as usize {
            let clearance_m = room_m - arm_m * (state.position[joint] - begin);
            let speed_m_s = arm_m * state.velocity[joint];
            fastest = fastest.max(speed_m_s);
            // What is left of it where the wall is: the speed that is stopped from within a millimetre.
            prop_assert!(clearance_m > 0.0 || speed_m_s < 0.15, "{speed_m_s} m/s");
            if clearance_m <= 0.0 {
                break;
            }
            let closing_1_s = speed_m_s / clearance_m.max(1e-3);
            let setpoint = motion.follow(&chain, &state, &wanted, closing_1_s, dt).unwrap();
            (state.position, state.velocity) = (setpoint.motion.position, setpoint.motion.velocity);
        }
        prop_assert!(fastest > 0.0);
    }

    /// However hard the joints are driven, no joint's origin and not the tool gets faster than the points may.
    #[test]
    fn no_point_is_faster_than_points_may_be(
        start in prop::array::uniform6(0.2..=0.8_f64),
        wanted in prop::collection::vec(joints(300.0), 1..8),
        speed_max_m_s in prop_oneof![Just(0.25), Just(1.5), 0.25..2.0_f64],
        dt in prop_oneof![Just(1e-3), 1e-3..4e-3_f64],
    ) {
        let (mut config, chain) = shipped();
        config.robot.point_limits.as_mut().unwrap().speed_max_m_s = speed_max_m_s;
        let limits = JointLimits::new(&chain, &config.robot);
        let mut motion = MotionGenerator::new(limits, &config);
        let range = limits.position_upper - limits.position_lower;
        let position = limits.position_lower + range.component_mul(&Joints::from(start));
        let mut state = JointState { position, velocity: Joints::zeros() };
        let mut kinematics = Kinematics::new();
        for wanted in &wanted {
            for _ in 0..(0.3 / dt) as usize {
                let setpoint = motion.follow(&chain, &state, wanted, 0.0, dt).unwrap();
                (state.position, state.velocity) = (setpoint.motion.position, setpoint.motion.velocity);
                forward_kinematics_with_velocity(&chain, &state.position, &state.velocity, &mut kinematics);
                let joints = kinematics.joint_velocities().map(|twist| twist.linear.length());
                let fastest = joints.fold(kinematics.tool_velocity.linear.length(), f64::max);
                prop_assert!(fastest <= speed_max_m_s, "{fastest} of {speed_max_m_s} m/s");
            }
        }
        // It is not stopped either.
        let slowed = motion.slowed();
        prop_assert!(slowed.point_speed == 0 || state.velocity.amax() > 0.0);
    }

    #[test]
    fn no_command_leaves_the_limits(
        start in prop::array::uniform6(0.0..=1.0_f64),
        dt in 1e-6..0.02_f64,
        ticks in prop::collection::vec((event(), measured()), 1..150),
    ) {
        let (config, chain) = shipped();
        let limits = JointLimits::new(&chain, &config.robot);
        let mut motion = MotionGenerator::new(limits, &config);
        let range = chain.position_upper() - chain.position_lower();
        let place = |fraction: &[f64; N]| chain.position_lower() + range.component_mul(&Joints::from(*fraction));
        let (mut q, mut qd) = (place(&start), Joints::zeros());
        let mut before = None;
        for (event, measured) in &ticks {
            if let Some(fraction) = &measured.elsewhere {
                q = place(fraction);
            }
            let ends = [*chain.position_lower(), *chain.position_upper()];
            let state = JointState {
                position: (q + measured.position).zip_zip_map(&ends[0], &ends[1], f64::clamp),
                velocity: qd + measured.velocity,
            };
            let setpoint = match event {
                Event::Follow(wanted) => {
                    let setpoint = motion.follow(&chain, &state, wanted, 10.0 * q[0].abs(), dt);
                    let finite = wanted.iter().all(|a| a.is_finite());
                    prop_assert_eq!(setpoint.is_ok(), finite);
                    let brake = |_| motion.brake(&chain, Some(state), false, dt).map(|(setpoint, _)| setpoint);
                    setpoint.map(Some).unwrap_or_else(brake)
                }
                Event::Brake { measured } => {
                    motion.brake(&chain, measured.then_some(state), false, dt).map(|(setpoint, _)| setpoint)
                }
                Event::Gap => {
                    motion.robot_brakes();
                    motion.brake(&chain, Some(state), true, dt).map(|(setpoint, _)| setpoint)
                }
            };
            if let Some(setpoint) = setpoint {
                inside(&setpoint, &mut before, &limits, &chain, dt)?;
                (q, qd) = (setpoint.motion.position, setpoint.motion.velocity);
            }
        }
    }

    /// From any speed, measured or blind, the reference is at rest within the time that its largest
    /// deceleration needs.
    #[test]
    fn braking_ends_in_bounded_time(
        start in prop::array::uniform6(0.2..0.8_f64),
        velocity in joints(5.0),
        measured in any::<bool>(),
        dt in 1e-4..5e-3_f64,
    ) {
        let (config, chain) = shipped();
        let limits = JointLimits::new(&chain, &config.robot);
        let mut motion = MotionGenerator::new(limits, &config);
        let range = chain.position_upper() - chain.position_lower();
        let position = chain.position_lower() + range.component_mul(&Joints::from(start));
        let state = JointState { position, velocity };
        // Pushed up to speed.
        for _ in 0..200 {
            prop_assert!(motion.follow(&chain, &state, &Joints::zeros(), 0.0, dt).is_ok());
        }
        let deceleration = config.stop.deceleration_fraction * limits.acceleration_max.min();
        let turned_s = limits.acceleration_max.component_div(&limits.jerk_max).max();
        let longest_s = limits.velocity_max.max() / deceleration + 4.0 * turned_s;
        let mut passed_s = 0.0;
        while !motion.reference_rests() {
            motion.brake(&chain, measured.then_some(state), false, dt);
            passed_s += dt;
            prop_assert!(passed_s <= longest_s + 3.0 * dt, "still moving after {passed_s} s");
        }
    }
}
