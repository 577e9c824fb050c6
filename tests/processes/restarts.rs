//! Processes that die: the arm rests, and whoever is started again goes on without any clean-up.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use tprmp_messages::{Instance, ObserverPorts, Reason, RobotState, StatusPort};

use crate::common::{Place, file, finish, program, random, run, text};
use crate::robot::signal;

/// How long a test waits for what has to come.
const PATIENCE: Duration = Duration::from_secs(90);

fn bridge(place: &Place, name: &str) -> Child {
    let scene = match name {
        "planar-sim" => "config/scenes/planar.json",
        _ => "config/scenes/pick.json",
    };
    program(name)
        .args(["run", "--scene", &file(scene), "--seed", "1"])
        .args(["--instance", &place.instance, "--out", &place.path(name), "--force"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the bridge starts")
}

fn quiet_controller(place: &Place, config: &str, model: &str) -> Child {
    program("controller")
        .args(["run", config, "--model", model, "--instance", &place.instance, "--reset"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the controller starts")
}

fn kill(mut child: Child) {
    child.kill().expect("a child can be killed");
    child.wait().expect("a child can be waited for");
}

/// The next state, whose speed is the largest of any joint.
fn next(observer: &ObserverPorts) -> (RobotState, f64) {
    let start = Instant::now();
    loop {
        if let Some(state) = observer.state.receive() {
            let speed = state.velocity.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            return (*state, speed);
        }
        std::thread::sleep(Duration::from_millis(1));
        assert!(start.elapsed() < PATIENCE, "the bridge does not publish");
    }
}

/// Reads states until `wanted`, given how many in a row were at rest.
fn until(observer: &ObserverPorts, what: &str, wanted: impl Fn(f64, u32) -> bool) -> RobotState {
    let start = Instant::now();
    let mut at_rest = 0;
    loop {
        let (state, speed) = next(observer);
        at_rest = if speed < 1e-3 { at_rest + 1 } else { 0 };
        if wanted(speed, at_rest) {
            return state;
        }
        assert!(start.elapsed() < PATIENCE, "{what}: it did not come to this");
    }
}

/// Commands expire: a bridge that hears nothing new brakes, and obeys the next controller.
fn rests_without_its_controller(name: &str, config: &str, skill: &str, way_max: f64) {
    let place = Place::new(&format!("killed-{name}"));
    let model = place.train(skill);
    let observer = Instance::new(&place.instance).unwrap().open_observer().unwrap();
    let bridge = bridge(&place, name);
    let controller = quiet_controller(&place, config, &model);
    let moving = until(&observer, "moving", |speed, _| speed > 0.15);
    kill(controller);
    let resting = until(&observer, "at rest", |_, at_rest| at_rest > 300);
    for (before, after) in moving.position.iter().zip(&resting.position) {
        assert!((before - after).abs() < way_max, "it ran on from {before} to {after}");
    }
    let controller = quiet_controller(&place, config, &model);
    until(&observer, "moving again", |speed, _| speed > 0.15);
    for child in [controller, bridge] {
        signal(&child, "-INT");
        finish(child);
    }
    drop(observer);
    assert_eq!(place.leftovers(), Vec::<PathBuf>::new());
}

#[test]
fn the_point_rests_when_its_controller_is_killed() {
    let config = file("config/controllers/planar.ron");
    rests_without_its_controller("planar-sim", &config, "planar", 0.3);
}

#[test]
fn the_arm_rests_when_its_controller_is_killed() {
    let config = file("config/controllers/ur5_pick.ron");
    rests_without_its_controller("sim-bridge", &config, "pick", 0.4);
}

/// Waits until the policy is followed by a controller that was started anew, or that has connected
/// to a publisher since it had `connections`, for longer than an old state is believed. Gives how
/// many connections it has then.
fn followed(port: &StatusPort, connections: Option<u64>) -> u64 {
    let start = Instant::now();
    while port.status.receive().is_some() {}
    let mut since = None;
    loop {
        while let Some(status) = port.status.receive() {
            if connections.is_none_or(|before| status.connections > before) {
                let since = *since.get_or_insert(status.ticks);
                if status.reason == Reason::None.to_wire() && status.ticks >= since + 100 {
                    return status.connections;
                }
            }
        }
        assert!(start.elapsed() < PATIENCE, "the policy is not followed again");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_hundred_random_kills_need_no_clean_up() {
    let place = Place::new("kills");
    let model = place.train("planar");
    // A publisher that is started again begins elsewhere: here that passes.
    let config = &place.passing("config/controllers/planar.ron");
    let port = Instance::new(&place.instance).unwrap().open_status().unwrap();
    let mut publisher = bridge(&place, "planar-sim");
    let mut controller = quiet_controller(&place, config, &model);
    let mut connections = followed(&port, None);
    let mut random = random(1);
    let mut killed = [0, 0];
    for _ in 0..100 {
        std::thread::sleep(Duration::from_millis(random(30)));
        // One that reached its goal has left.
        let left = publisher.try_wait().unwrap().is_some();
        if left || random(2) == 0 {
            kill(publisher);
            publisher = bridge(&place, "planar-sim");
            connections = followed(&port, Some(connections));
            killed[0] += 1;
        } else {
            kill(controller);
            controller = quiet_controller(&place, config, &model);
            connections = followed(&port, None);
            killed[1] += 1;
        }
    }
    assert!(killed[0] > 20 && killed[1] > 20, "{killed:?}");
    for child in [controller, publisher] {
        signal(&child, "-INT");
        finish(child);
    }
    drop(port);
    assert_eq!(place.leftovers(), Vec::<PathBuf>::new());
}

#[test]
fn a_second_publisher_of_an_instance_is_refused() {
    let place = Place::new("second-publisher");
    let _robot = crate::robot::Robot::new(&place);
    for name in ["planar-sim", "sim-bridge"] {
        let scene = if name == "planar-sim" { "planar" } else { "pick" };
        let mut second: Command = program(name);
        second.args(["run", "--scene", &file(&format!("config/scenes/{scene}.json"))]);
        second.args(["--seed", "1", "--instance", &place.instance, "--out", &place.path(name)]);
        let output = run(&mut second);
        assert!(!output.status.success());
        assert!(text(&output).contains("already has a publisher"), "{}", text(&output));
    }
}
