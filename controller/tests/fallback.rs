//! What the arm does at rest while a fault lasts, as the configuration says: over real ports, in lockstep with
//! an arm that does exactly what it is commanded, or is pushed.

use tprmp_controller::timing::pacing::Pacing;
use tprmp_messages::{CommandMode, Instance, JointCommand, Reason, RobotState, TaskFrames};
use tprmp_model::controller_config::{ControllerConfig, Fallback, PostureLeaf, Start};

use crate::common::{Controller, Outcome, PLANE, POSES, Setting, answer};

const MS: u64 = 1_000_000;

/// What happens in a tick: edits the robot as it is, and what is published of it.
type Edit = dyn Fn(u64, &mut RobotState, &mut TaskFrames);

/// The commands of `ticks` of 2 ms; a command that says `Stop` leaves the arm where it is.
fn run(
    name: &str,
    setting: &Setting,
    ticks: u64,
    fallback: impl FnOnce(&mut ControllerConfig),
    edit: &Edit,
) -> Vec<JointCommand> {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    let ports = instance.open_state_publisher().unwrap();
    let controller = Controller::start(setting, &instance, Pacing::Lockstep, fallback);
    let (mut state, mut frames) = (setting.state(), setting.frames());
    let mut commands: Vec<JointCommand> = Vec::new();
    for tick in 0..ticks {
        if let Some(command) = commands.last()
            && command.mode != CommandMode::Stop.to_wire()
        {
            (state.position, state.velocity) = (command.position, command.velocity);
        }
        state.sequence += 1;
        frames.sequence += 1;
        let time_ns = 1000 * MS + state.sequence * 2 * MS;
        (state.time_ns, frames.time_ns) = (time_ns, time_ns);
        edit(tick, &mut state, &mut frames);
        assert!(ports.frames.publish(frames) && ports.state.publish(state));
        commands.push(answer(&ports, state.sequence));
    }
    let Outcome { run, ticks: counted } = controller.stop(|| {
        state.sequence += 1;
        state.time_ns += 2 * MS;
        assert!(ports.state.publish(state));
    });
    assert_eq!(run.allocations, 0);
    assert!(counted >= ticks);
    let joints = commands[0].joint_count as usize;
    for pair in
        commands.windows(2).filter(|_| joints == 6).filter(|pair| pair[0].position != [0.0; 8])
    {
        for i in 0..6 {
            let step = |field: fn(&JointCommand) -> [f64; 8]| {
                (field(&pair[1])[i] - field(&pair[0])[i]).abs()
            };
            assert!(step(|c| c.position) <= 2.9 * 2e-3);
            assert!(step(|c| c.velocity) <= 25.0 * 2e-3 + 1e-9);
            assert!(step(|c| c.acceleration) <= 2500.0 * 2e-3 + 1e-9);
        }
    }
    commands
}

fn no_frames(tick: u64, _: &mut RobotState, frames: &mut TaskFrames) {
    frames.frames[1].valid = u32::from(!(400..3000).contains(&tick));
}

#[test]
fn without_frames_it_retreats_where_that_is_configured_and_comes_back() {
    let position = vec![-2.6, -1.6, 1.4, -1.3, -1.5, 0.2];
    let posture = PostureLeaf {
        position: position.clone(),
        inertia: 1.0,
        stiffness_1_s2: 16.0,
        damping_1_s: 8.0,
        saturation: 0.3,
    };
    let retreats = |config: &mut ControllerConfig| {
        config.supervision.fallback.frames = Fallback::Retreat(posture);
    };
    let commands = run("retreat", &POSES, 3600, retreats, &no_frames);
    let away = |command: &JointCommand| {
        let joints = position.iter().zip(&command.position);
        joints.map(|(p, q)| (p - q).abs()).fold(0.0, f64::max)
    };
    assert!(away(&commands[399]) > 0.1, "it was not there anyway");
    assert!(away(&commands[2999]) < 0.01, "{:?}", commands[2999].position);
    assert_eq!(commands[2999].reason, Reason::FrameMissing.to_wire());
    assert_eq!(commands[3599].mode, CommandMode::Track.to_wire());
    let held = run("no-retreat", &POSES, 3000, |_| {}, &no_frames);
    assert!(away(&held[2999]) > 0.1, "by itself it holds");
    assert_eq!(held[2999].velocity, [0.0; 8]);
}

#[test]
fn an_arm_that_gives_way_stays_where_it_is_pushed_and_one_that_holds_comes_back() {
    let pushed = |tick: u64, state: &mut RobotState, frames: &mut TaskFrames| {
        no_frames(tick, state, frames);
        // By 0.1 rad in a second, whatever is commanded.
        if (1000..1500).contains(&tick) {
            state.position[0] += 0.1 * 2e-3;
            state.velocity[0] = 0.1;
        }
    };
    let gives_way = |config: &mut ControllerConfig| {
        config.supervision.fallback.frames = Fallback::GravityOnly;
    };
    let commands = run("gives-way", &POSES, 1900, gives_way, &pushed);
    let [before, after] = [&commands[990], &commands[1800]];
    assert!(after.position[0] > before.position[0] + 0.02, "{}", after.position[0]);
    assert!(after.torque.iter().all(|torque| torque.abs() < 1e-9), "{:?}", after.torque);
    let commands = run("holds", &POSES, 1900, |_| {}, &pushed);
    assert_eq!(commands[1800].position[0], commands[990].position[0]);
}

#[test]
fn a_point_that_nobody_starts_is_held_where_it_is() {
    let waits = |config: &mut ControllerConfig| config.supervision.start = Start::OnRequest;
    let commands = run("not-started", &PLANE, 500, waits, &|_, _, _| {});
    for command in &commands[10..] {
        assert_eq!(command.reason, Reason::StartNotRequested.to_wire());
        assert_eq!(command.mode, CommandMode::Hold.to_wire());
        assert_eq!(command.position, PLANE.state().position);
    }
}
