//! How the controller ends, observed from outside.

use std::time::Duration;

use tprmp_messages::{CommandMode, Reason};

use crate::common::{Place, file, finish, text};
use crate::robot::{signal, start, stop};

/// A signal ramps the velocity down to rest in bounded time, then a last command says stop.
fn stops_on(name: &str) {
    let place = Place::new(&format!("stop{name}"));
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.run_up();
    signal(&controller, name);
    let mut last_speed = f64::INFINITY;
    let mut braking = 0;
    let last = loop {
        let before = robot.speed();
        let command = robot.good();
        if command.reason == Reason::StopRequested.to_wire() {
            // The acceleration is turned round within 20 ms.
            assert!(braking < 20 || before <= last_speed + 1e-3, "the speed rose while stopping");
            last_speed = before;
            braking += 1;
        }
        if command.mode == CommandMode::Stop.to_wire() {
            assert!(before < 0.02, "still moving at {before} m/s at the last command");
            break command;
        }
        assert!(braking < 1100, "not at rest after the longest stopping time");
    };
    assert!(braking > 5, "a ramp, not a jump: {braking} ticks");
    assert_eq!(last.velocity, [0.0; 8]);
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
    drop(robot);
    assert_eq!(place.leftovers(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn an_interrupt_ramps_down_to_rest() {
    stops_on("-INT");
}

#[test]
fn a_termination_ramps_down_to_rest() {
    stops_on("-TERM");
}

#[test]
fn a_second_signal_leaves_at_once() {
    let place = Place::new("second-signal");
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.run_up();
    // No state follows, so the loop still waits for one when the second signal comes.
    signal(&controller, "-INT");
    std::thread::sleep(Duration::from_millis(20));
    signal(&controller, "-INT");
    let output = finish(controller);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
}

#[test]
fn a_second_controller_of_an_instance_is_refused() {
    let place = Place::new("second-controller");
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.good();
    let model = place.path("planar.model.ron");
    let second =
        finish(place.controller(&file("config/controllers/planar.ron"), &model, &["--lockstep"]));
    assert_eq!(second.status.code(), Some(1));
    assert!(text(&second).contains("already has a publisher"), "{}", text(&second));
    stop(robot, controller);
}
