//! The loop allocates nothing: counted by the global allocator over whole cycles with real ports, in
//! whatever profile this test is built. Each skill runs beside a publisher that moves frames and
//! obstacles and sends faulty messages, so that braking and resuming are counted too, and beside
//! external commands of the tool and another source of frames now and then.

use tprmp_controller::timing::allocation::{self, CountingAllocator};
use tprmp_controller::timing::pacing::Pacing;
use tprmp_controller::timing::realtime::monotonic_ns;
use tprmp_messages::{
    Frame, FrameSourcePort, Instance, Obstacle, ObstacleKind, RobotState, StatePublisherPorts,
    TaskFrames, ToolCommand, ToolCommandPort,
};
use tprmp_model::controller_config::{ControllerConfig, Trigger};

use crate::common::{Controller, Outcome, PLANE, POSES, Setting, answer};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// States that a run is fed with.
const STATES: u64 = 3000;

struct Publisher {
    ports: StatePublisherPorts,
    commander: ToolCommandPort,
    camera: FrameSourcePort,
    state: RobotState,
    frames: TaskFrames,
    pacing: Pacing,
}

impl Publisher {
    fn new(setting: &Setting, instance: &Instance, pacing: Pacing) -> Self {
        let (state, mut frames) = (setting.state(), setting.frames());
        frames.obstacle_count = 1;
        frames.obstacles[0] = Obstacle {
            kind: ObstacleKind::Sphere.to_wire(),
            valid: 1,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            size: [0.06, 0.0, 0.0],
            ..Default::default()
        };
        let ports = instance.open_state_publisher().unwrap();
        let commander = instance.open_tool_command().unwrap();
        let camera = instance.open_frame_source().unwrap();
        Self { ports, commander, camera, state, frames, pacing }
    }

    /// Publishes the next state and frames, now and then faulty ones, and at times a command for the
    /// tool.
    fn publish(&mut self, step: u64) {
        let t = step as f64 * 1e-3;
        let time_ns = match self.pacing {
            Pacing::Lockstep => 1_000_000_000 + step * 1_000_000,
            Pacing::RealTime(_) => monotonic_ns(),
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
        if step % 700 < 250 && step.is_multiple_of(10) {
            let x = if step.is_multiple_of(70) { f64::NAN } else { 0.2 };
            let command = ToolCommand {
                sequence: step,
                time_ns,
                linear_velocity: [x, 0.1, 0.0],
                angular_velocity: [0.0, 0.0, 0.3],
            };
            assert!(self.commander.command.publish(command));
        }
        if step.is_multiple_of(7) {
            let mut seen = TaskFrames::of_source("camera").unwrap();
            (seen.time_ns, seen.frame_count, seen.obstacle_count) = (time_ns, 1, 1);
            // Twice, now and then: the other source publishes it, too.
            let name = if step.is_multiple_of(350) { "end" } else { "mark" };
            seen.frames[0] = Frame::at(name, [0.1 * t.sin(), 0.0, 1.0]).unwrap();
            seen.obstacles[0] = frames.obstacles[0];
            seen.obstacles[0].position = [5.0, 5.0, 5.0];
            assert!(self.camera.frames.publish(seen));
        }
        assert!(self.ports.frames.publish(frames) && self.ports.state.publish(state));
    }
}

/// Runs a loop in a thread of its own beside a publisher; `at_half_time` is called in between.
fn run(
    name: &str,
    setting: &Setting,
    pacing: Pacing,
    edit: impl FnOnce(&mut ControllerConfig),
    at_half_time: impl FnOnce(&Instance),
) -> Outcome {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    let mut publisher = Publisher::new(setting, &instance, pacing);
    let controller = Controller::start(setting, &instance, pacing, edit);
    let mut step = 0;
    let mut publish = |until: u64| {
        while step < until {
            step += 1;
            publisher.publish(step);
            answer(&publisher.ports, publisher.state.sequence);
        }
    };
    publish(STATES / 2);
    at_half_time(&instance);
    publish(STATES);
    controller.stop(|| {
        step += 1;
        publisher.publish(step);
    })
}

fn allocates_nothing(name: &str, setting: &Setting, pacing: Pacing) {
    let spin = |config: &mut ControllerConfig| {
        config.cycle.period_ns = 250_000;
        config.cycle.spin_ns = 50_000;
        assert!(config.external.is_some(), "commands for the tool are listened to");
    };
    let outcome = run(name, setting, pacing, spin, |_| {});
    assert!(outcome.ticks >= STATES, "{}", outcome.ticks);
    assert_eq!(outcome.run.allocations, 0);
    assert_eq!((outcome.run.connections.count, outcome.run.connections.allocations), (0, 0));
}

#[test]
fn a_planar_skill_allocates_nothing() {
    allocates_nothing("alloc-plane", &PLANE, Pacing::Lockstep);
}

#[test]
fn an_arm_s_skill_allocates_nothing() {
    allocates_nothing("alloc-poses", &POSES, Pacing::Lockstep);
}

#[test]
fn a_loop_on_each_state_allocates_nothing() {
    allocates_nothing("alloc-on-state", &PLANE, Pacing::RealTime(Trigger::OnState));
}

#[test]
fn a_loop_on_its_schedule_allocates_nothing() {
    allocates_nothing("alloc-periodic", &PLANE, Pacing::RealTime(Trigger::Periodic));
}

/// The negative control: what allocates is counted. A reader that appears is a real allocation inside
/// the loop, and is counted as the connection that it is.
#[test]
fn an_allocation_is_counted() {
    let before = allocation::counted();
    drop(core::hint::black_box(Box::new(1)));
    assert_eq!(allocation::counted() - before, 1);

    let mut reader = None;
    let appear = |instance: &Instance| reader = Some(instance.open_status().unwrap());
    let outcome = run("alloc-control", &PLANE, Pacing::Lockstep, |_| {}, appear);
    assert!(outcome.run.connections.count >= 1, "{:?}", outcome.run.connections);
    assert!(outcome.run.connections.allocations > 0, "{:?}", outcome.run.connections);
    assert_eq!(outcome.run.allocations, 0);
}
