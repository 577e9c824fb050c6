//! The loop allocates nothing: counted by the global allocator over whole cycles with real ports, in
//! whatever profile this test is built. Each skill runs beside a publisher that moves frames and
//! obstacles and sends faulty messages, so that braking and resuming are counted too.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tprmp_controller::allocation::{self, CountingAllocator};
use tprmp_controller::cycle::Ending;
use tprmp_controller::pacing::Pace;
use tprmp_controller::realtime::monotonic_ns;
use tprmp_controller::startup::{self, StartError, WithRobot};
use tprmp_controller::telemetry::Connections;
use tprmp_messages::{
    CommandMode, Frame, Instance, Obstacle, ObstacleKind, RobotState, StatePublisherPorts,
    TaskFrames, name_bytes,
};
use tprmp_model::controller_config::{ControllerConfig, Trigger};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// States that a run is fed with.
const STATES: u64 = 3000;

fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// A configuration, a model for it, and a state in which the robot stands still.
struct Setting {
    config: &'static str,
    model: &'static str,
    rest: &'static [f64],
    /// The skill's frames, around which they move \[m\].
    frames: [(&'static str, [f64; 3]); 2],
}

const PLANE: Setting = Setting {
    config: "config/controllers/planar.ron",
    model: "learner/tests/golden/canonical_plane.ron",
    rest: &[0.1, 0.05],
    frames: [("start", [0.0, 0.0, 0.0]), ("end", [0.6, 0.3, 0.0])],
};
const POSES: Setting = Setting {
    config: "config/controllers/ur5_pick.ron",
    model: "learner/tests/golden/canonical_poses.ron",
    rest: &[-3.1, -1.5, 1.5, -1.5, -1.5, 0.0],
    frames: [("start", [0.4, 0.3, 0.3]), ("end", [0.5, -0.2, 0.1])],
};

/// What a run came to.
struct Outcome {
    ending: Ending,
    connections: Connections,
    ticks: u64,
}

struct Run {
    config_path: PathBuf,
    loaded: startup::Loaded,
    instance: Instance,
    pace: Pace,
    stop: Arc<AtomicBool>,
}

impl WithRobot for Run {
    type Output = Outcome;

    fn call<const N: usize>(self) -> Result<Outcome, StartError> {
        let mut cycle =
            startup::cycle::<N>(&self.config_path, self.loaded, self.pace, false, &self.instance)?;
        let ending = cycle.run(&self.stop);
        let telemetry = cycle.telemetry();
        Ok(Outcome { ending, connections: telemetry.connections, ticks: telemetry.ticks })
    }
}

struct Publisher {
    ports: StatePublisherPorts,
    state: RobotState,
    frames: TaskFrames,
    pace: Pace,
}

impl Publisher {
    fn new(setting: &Setting, instance: &Instance, pace: Pace) -> Self {
        let joint_count = setting.rest.len() as u32;
        let mut state = RobotState { joint_count, gripper_state: 1, ..Default::default() };
        state.position[..setting.rest.len()].copy_from_slice(setting.rest);
        let mut frames = TaskFrames { frame_count: 2, obstacle_count: 1, ..Default::default() };
        for (frame, (name, position)) in frames.frames.iter_mut().zip(setting.frames) {
            *frame = Frame {
                name: name_bytes(name).unwrap(),
                valid: 1,
                position,
                quaternion: [1.0, 0.0, 0.0, 0.0],
                ..Default::default()
            };
        }
        frames.obstacles[0] = Obstacle {
            kind: ObstacleKind::Sphere.to_wire(),
            valid: 1,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            size: [0.06, 0.0, 0.0],
            ..Default::default()
        };
        Self { ports: instance.open_state_publisher().unwrap(), state, frames, pace }
    }

    /// Publishes the next state and frames, now and then faulty ones.
    fn publish(&mut self, step: u64) {
        let t = step as f64 * 1e-3;
        let time_ns = match self.pace {
            Pace::Lockstep => 1_000_000_000 + step * 1_000_000,
            Pace::RealTime(_) => monotonic_ns(),
        };
        self.state.sequence += 1;
        self.frames.sequence += 1;
        (self.state.time_ns, self.frames.time_ns) = (time_ns, time_ns);
        let goal = &mut self.frames.frames[1];
        goal.position[0] += 1e-4 * (3.0 * t).cos();
        goal.linear_velocity[0] = 0.1 * (3.0 * t).cos();
        let mut frames = self.frames;
        frames.obstacles[0].position = [0.3 + 0.1 * t.sin(), 0.1, 0.2];
        let mut state = self.state;
        match step % 500 {
            300..320 => state.position[0] = f64::NAN,
            400..420 => frames.frames[0].valid = 0,
            450..460 => state.joint_count = 0,
            _ => {}
        }
        assert!(self.ports.frames.publish(frames) && self.ports.state.publish(state));
    }

    /// Publishes and waits for the answer; gives the command's mode.
    fn exchange(&mut self, step: u64) -> CommandMode {
        self.publish(step);
        let start = Instant::now();
        loop {
            assert!(start.elapsed() < Duration::from_secs(60), "no answer from the controller");
            assert!(
                self.ports.state.update_connections() && self.ports.frames.update_connections()
            );
            match self.ports.command.receive() {
                Some(command) if command.state_sequence == self.state.sequence => {
                    return CommandMode::from_wire(command.mode).unwrap();
                }
                _ => std::thread::sleep(Duration::from_micros(20)),
            }
        }
    }
}

/// Runs a loop in a thread of its own beside a publisher; `at_half_time` is called in between.
fn run(
    name: &str,
    setting: &Setting,
    pace: Pace,
    edit: impl FnOnce(&mut ControllerConfig),
    at_half_time: impl FnOnce(&Instance),
) -> Outcome {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    let config_path = file(setting.config);
    let loaded = startup::load_with(&config_path, edit, &[file(setting.model)], false).unwrap();
    let mut publisher = Publisher::new(setting, &instance, pace);
    let stop = Arc::new(AtomicBool::new(false));
    let work =
        Run { config_path, loaded, instance: instance.clone(), pace, stop: Arc::clone(&stop) };
    let joints = setting.rest.len();
    let controller = std::thread::spawn(move || match joints {
        2 => work.call::<2>().unwrap(),
        _ => work.call::<6>().unwrap(),
    });
    let mut step = 0;
    let mut publish = |until: u64| {
        while step < until {
            step += 1;
            publisher.exchange(step);
        }
    };
    publish(STATES / 2);
    at_half_time(&instance);
    publish(STATES);
    stop.store(true, Ordering::Relaxed);
    while !controller.is_finished() {
        step += 1;
        publisher.publish(step);
        std::thread::sleep(Duration::from_micros(100));
    }
    controller.join().unwrap()
}

fn allocates_nothing(name: &str, setting: &Setting, pace: Pace) {
    let spin = |config: &mut ControllerConfig| {
        config.cycle.period_ns = 250_000;
        config.cycle.spin_ns = 50_000;
    };
    let outcome = run(name, setting, pace, spin, |_| {});
    assert!(outcome.ticks >= STATES, "{}", outcome.ticks);
    assert_eq!(outcome.ending.allocations, 0);
    assert_eq!((outcome.connections.count, outcome.connections.allocations), (0, 0));
}

#[test]
fn a_planar_skill_allocates_nothing() {
    allocates_nothing("alloc-plane", &PLANE, Pace::Lockstep);
}

#[test]
fn an_arm_s_skill_allocates_nothing() {
    allocates_nothing("alloc-poses", &POSES, Pace::Lockstep);
}

#[test]
fn a_loop_on_each_state_allocates_nothing() {
    allocates_nothing("alloc-on-state", &PLANE, Pace::RealTime(Trigger::OnState));
}

#[test]
fn a_loop_on_its_schedule_allocates_nothing() {
    allocates_nothing("alloc-periodic", &PLANE, Pace::RealTime(Trigger::Periodic));
}

/// The negative control: what allocates is seen. A reader that appears is a real allocation inside
/// the loop, and is counted as the connection that it is.
#[test]
fn an_allocation_is_seen() {
    let before = allocation::counted();
    drop(core::hint::black_box(Box::new(1)));
    assert_eq!(allocation::counted() - before, 1);

    let mut reader = None;
    let appear = |instance: &Instance| reader = Some(instance.open_status().unwrap());
    let outcome = run("alloc-control", &PLANE, Pace::Lockstep, |_| {}, appear);
    assert!(outcome.connections.count >= 1, "{:?}", outcome.connections);
    assert!(outcome.connections.allocations > 0, "{:?}", outcome.connections);
    assert_eq!(outcome.ending.allocations, 0);
}
