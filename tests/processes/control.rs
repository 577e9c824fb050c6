//! `controller ctl`, as a user types it.

use std::process::Output;

use tprmp_messages::{CommandMode, JointCommand, LifeCycle, Reason};

use crate::common::{Place, file, finish, json, program, run, text};
use crate::robot::{Robot, stop};

fn ctl(place: &Place, words: &[&str]) -> Output {
    run(program("controller").arg("ctl").args(words).args(["--instance", &place.instance]))
}

fn accepted(place: &Place, words: &[&str], said: &str) {
    let output = ctl(place, words);
    assert!(output.status.success(), "{words:?}: {}", text(&output));
    assert!(text(&output).contains(said), "{words:?}: {}", text(&output));
}

fn refused(place: &Place, words: &[&str], said: &str) {
    let output = ctl(place, words);
    assert_eq!(output.status.code(), Some(1), "{words:?}: {}", text(&output));
    assert!(text(&output).contains(said), "{words:?}: {}", text(&output));
}

/// Steps until a command is as wanted; no velocity or acceleration steps farther than it may.
fn until(robot: &mut Robot, what: &str, wanted: impl Fn(&JointCommand) -> bool) -> JointCommand {
    let mut before = robot.good();
    for _ in 0..5000 {
        let command = robot.good();
        for i in 0..2 {
            let step = (command.velocity[i] - before.velocity[i]).abs();
            assert!(step <= 60.0 * 1e-3 * 1.001, "{what}: {step} m/s");
            let step = (command.acceleration[i] - before.acceleration[i]).abs();
            assert!(step <= 6000.0 * 1e-3 * 1.001, "{what}: {step} m/s²");
        }
        before = command;
        if wanted(&command) {
            return command;
        }
    }
    panic!("{what}: {before:?}");
}

fn reason(command: &JointCommand) -> Reason {
    Reason::from_wire(command.reason).unwrap()
}

#[test]
fn a_controller_waits_holds_goes_on_and_is_reset_as_it_is_asked_to() {
    let place = Place::new("ctl");
    let model = place.train("planar");
    refused(&place, &["status"], "no controller answers");
    let robots = format!("\"{}", file("config/robots"));
    let config = place.edited(
        "config/controllers/planar.ron",
        &[("start: Automatic", "start: OnRequest"), ("\"../robots", &robots)],
    );
    let mut robot = Robot::new(&place);
    let controller = place.controller(&config, &model, &["--lockstep"]);
    until(&mut robot, "ready", |c| reason(c) == Reason::StartNotRequested);
    for _ in 0..200 {
        assert_eq!(reason(&robot.good()), Reason::StartNotRequested);
    }
    assert!(robot.speed() < 1e-6, "it moved before it was asked to");
    accepted(&place, &["status"], "ready");
    refused(&place, &["reset"], "no fault");
    accepted(&place, &["start"], "go on");
    let speed = |c: &JointCommand| c.velocity[0].hypot(c.velocity[1]);
    until(&mut robot, "moving", |c| speed(c) > 0.3);
    accepted(&place, &["hold"], "hold");
    until(&mut robot, "held", |c| reason(c) == Reason::HoldRequested && speed(c) == 0.0);
    accepted(&place, &["start"], "go on");
    until(&mut robot, "moving again", |c| c.mode == CommandMode::Track.to_wire() && speed(c) > 0.1);
    // A fault that latches: nothing but a reset helps.
    robot.exchange(|s| s.position[0] += 5.0, |_| {});
    until(&mut robot, "at rest", |c| speed(c) == 0.0);
    assert_eq!(reason(&robot.good()), Reason::StateUnbelievable);
    refused(&place, &["start"], "ctl reset");
    assert_eq!(reason(&robot.good()), Reason::StateUnbelievable);
    accepted(&place, &["status"], "ctl reset");
    accepted(&place, &["reset"], "StateUnbelievable");
    until(&mut robot, "moving after the reset", |c| speed(c) > 0.1);
    stop(robot, controller);
    let summary = json(&place.path("controller.json"));
    assert_eq!(summary["allocations"], 0, "{summary}");
}

#[test]
fn a_model_is_swapped_and_gains_are_set_in_motion_without_a_step() {
    let place = Place::new("ctl-swap");
    let model = place.train("planar");
    let other = place.path("other.ron");
    let trained = run(program("learner").args([
        "train",
        &file("config/skills/planar.ron"),
        "--components",
        "5",
        "--out",
        &other,
    ]));
    assert!(trained.status.success(), "{}", text(&trained));
    let mut robot = Robot::new(&place);
    let config = file("config/controllers/planar.ron");
    let controller = place.controller(&config, &model, &["--lockstep"]);
    robot.run_up();
    let track = CommandMode::Track.to_wire();
    for path in [&other, &model, &other] {
        accepted(&place, &["swap-model", path], "goes on with");
        for _ in 0..50 {
            until(&mut robot, "following", |c| c.mode == track);
        }
    }
    refused(&place, &["swap-model", &place.path("none.ron")], "cannot be read");
    let robot_file = file("config/controllers/planar.ron");
    refused(&place, &["swap-model", &robot_file], "planar.ron");
    refused(&place, &["set", "impedance.damping_ratio", "1000"], "expected 0.5 to 2");
    refused(&place, &["set", "skill.governor.linear_max_m_s", "NaN"], "expected 0.1 to 4.3");
    refused(&place, &["set", "robot.acceleration_max", "1"], "expected one of");
    accepted(&place, &["set", "impedance.damping_ratio", "1.5"], "goes to 1.5");
    accepted(&place, &["set", "skill.governor.linear_max_m_s", "0.15"], "goes to 0.15");
    for _ in 0..3000 {
        robot.good();
    }
    let distance = (robot.state.position[0] - 2.0).hypot(robot.state.position[1] - 1.0);
    assert!(distance < 0.01 || robot.speed() < 0.2, "{} m/s", robot.speed());
    until(&mut robot, "still following", |c| c.mode == track);
    accepted(&place, &["stop"], "leave");
    while robot.good().mode != CommandMode::Stop.to_wire() {}
    assert!(finish(controller).status.success());
    let summary = json(&place.path("controller.json"));
    assert_eq!(summary["allocations"], 0, "{summary}");
    let ended = summary["life_cycle"].as_str().unwrap();
    assert!([LifeCycle::Running, LifeCycle::Done].iter().any(|l| format!("{l:?}") == ended));
}
