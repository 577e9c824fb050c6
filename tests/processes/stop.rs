//! How the controller ends, observed from outside.

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use tprmp_messages::{CommandMode, Reason};

use crate::common::{Place, file, finish, program, text};
use crate::robot::{signal, start, stop, stop_live};

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
fn a_closed_terminal_ramps_down_to_rest() {
    stops_on("-HUP");
}

/// `timeout`, launchers and supervisors send a signal to a process and to its group.
#[test]
fn two_signals_at_once_are_one() {
    let place = Place::new("signals-at-once");
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.run_up();
    for name in ["-TERM", "-HUP", "-INT"] {
        signal(&controller, name);
    }
    let mut braking = 0;
    while robot.good().mode != CommandMode::Stop.to_wire() {
        braking += 1;
        assert!(braking < 1100, "not at rest after the longest stopping time");
    }
    assert!(braking > 5, "a ramp, not a jump: {braking} ticks");
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
}

/// `top` ends in order by any signal, and leaves nothing in shared memory.
#[test]
fn top_leaves_nothing_behind() {
    for name in ["-INT", "-TERM", "-HUP"] {
        let place = Place::new(&format!("top{name}"));
        let (mut robot, controller) = start(&place, &[]);
        robot.run_up_live();
        let mut command = program("controller");
        command.args(["top", "--instance", &place.instance]).stdout(Stdio::piped());
        let mut top = command.spawn().unwrap();
        let mut lines = BufReader::new(top.stdout.take().unwrap()).lines();
        // What it shows comes from the controller, whose point goes on meanwhile.
        let seen = std::thread::spawn(move || lines.next().unwrap().unwrap());
        while !seen.is_finished() {
            robot.live();
        }
        assert!(seen.join().unwrap().contains(&place.instance));
        signal(&top, name);
        assert!(finish(top).status.success(), "{name}");
        stop_live(robot, controller);
        assert_eq!(place.leftovers(), Vec::<std::path::PathBuf>::new(), "{name}");
    }
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
