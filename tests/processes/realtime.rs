//! What the loop promises of a running controller, looked at from outside: system calls, page
//! faults, allocations, the rights it asks for, and the programs that watch it.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tprmp_messages::Instance;

use crate::common::{Place, file, finish, json, program, run, skip, text};
use crate::robot::{Robot, signal, start, stop_live};

/// The system calls of a controller's loop while it runs, by `strace`; `None` where it cannot look.
fn system_calls(robot: &mut Robot, process: u32) -> Option<Vec<String>> {
    let tracer = Command::new("strace")
        .args(["-c", "-p", &process.to_string()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let mut tracer = match tracer {
        Ok(tracer) => tracer,
        Err(error) => {
            skip(&format!("strace cannot be started: {error}"));
            return None;
        }
    };
    for _ in 0..1500 {
        robot.live();
    }
    if tracer.try_wait().unwrap().is_some() {
        skip(&format!("strace cannot look: {}", text(&finish(tracer))));
        return None;
    }
    signal(&tracer, "-INT");
    let said = text(&finish(tracer));
    // % time, seconds, µs a call, calls, errors or nothing, name
    let rows = said.lines().skip_while(|line| !line.starts_with("------")).skip(1);
    let rows = rows.take_while(|line| !line.starts_with("------"));
    let names: Vec<String> =
        rows.filter_map(|line| line.split_whitespace().last().map(Into::into)).collect();
    assert!(!names.is_empty(), "strace saw nothing: {said}");
    Some(names)
}

#[test]
fn a_running_loop_makes_no_system_call_but_its_sleep() {
    for options in [
        ["--trigger", "periodic", "--spin-ns", "0"],
        ["--trigger", "periodic", "--spin-ns", "100000"],
        ["--trigger", "on-state", "--spin-ns", "0"],
    ] {
        let place = Place::new(&format!("strace-{}-{}", options[1], options[3]));
        let (mut robot, controller) = start(&place, &options);
        robot.run_up_live();
        if let Some(calls) = system_calls(&mut robot, controller.id()) {
            // The sleep that strace interrupts when it comes is restarted under that name.
            let sleeps = ["clock_nanosleep", "restart_syscall"];
            assert!(calls.iter().all(|call| sleeps.contains(&call.as_str())), "{calls:?}");
            assert!(calls.iter().any(|call| call == "clock_nanosleep"), "{calls:?}");
        }
        stop_live(robot, controller);
    }
}

#[test]
fn a_hundred_thousand_ticks_meet_no_page_fault_and_allocate_nothing() {
    let place = Place::new("faults-none");
    let options = ["--trigger", "periodic", "--period-ns", "50000", "--status-every-ticks", "100"];
    let (mut robot, controller) = start(&place, &options);
    let port = Instance::new(&place.instance).unwrap().open_status().unwrap();
    let begin = Instant::now();
    let (mut ticks, mut statuses) = (0, 0);
    while ticks < 100_000 {
        robot.live();
        while let Some(status) = port.status.receive() {
            ticks = status.ticks;
            statuses += 1;
        }
        assert!(begin.elapsed() < Duration::from_secs(120), "{ticks} ticks only");
    }
    // One in a hundred ticks, and where the reason changes.
    assert!(statuses > 100 && statuses < ticks / 20, "{statuses} statuses of {ticks} ticks");
    signal(&controller, "-INT");
    let mut controller = controller;
    while controller.try_wait().unwrap().is_none() {
        robot.live();
    }
    let said = text(&finish(controller));
    let summary = json(&place.path("controller.json"));
    assert!(summary["ticks"].as_u64().unwrap() >= 100_000, "{summary}");
    assert_eq!(summary["allocations"], 0, "{summary}");
    if said.contains("memory is not locked") {
        skip(&format!("page faults are promised with locked memory only: {said}"));
        return;
    }
    assert_eq!(summary["page_faults"]["minor"], 0, "{summary}");
    assert_eq!(summary["page_faults"]["major"], 0, "{summary}");
}

#[test]
fn a_right_that_is_required_and_refused_keeps_the_controller_from_starting() {
    let place = Place::new("required");
    let robots = file("config/robots");
    let config = place.edited(
        "config/controllers/planar.ron",
        &[("cpu: None", "cpu: Some(1000)"), ("../robots", &robots)],
    );
    let model = place.train("planar");
    let check = run(program("controller").args(["check", &config]));
    assert!(text(&check).contains("lack  core"), "{}", text(&check));
    assert!(text(&check).contains("real_time.cpu"), "{}", text(&check));

    // Best effort: it says so and goes on.
    let mut robot = Robot::new(&place);
    let controller = place.controller(&config, &model, &[]);
    robot.run_up_live();
    signal(&controller, "-INT");
    let mut controller = controller;
    while controller.try_wait().unwrap().is_none() {
        robot.live();
    }
    let output = finish(controller);
    assert!(output.status.success());
    assert!(text(&output).contains("the loop is not kept on its core"), "{}", text(&output));

    let text_of = std::fs::read_to_string(&config).unwrap();
    std::fs::write(&config, text_of.replace("required: []", "required: [Cpu]")).unwrap();
    let output = finish(place.controller(&config, &model, &[]));
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output);
    assert!(said.contains("real_time.required") && said.contains("real_time.cpu"), "{said}");
}

#[test]
fn an_option_that_makes_no_sense_is_refused_by_its_key() {
    let place = Place::new("options");
    let model = place.train("planar");
    let config = file("config/controllers/planar.ron");
    for (options, key) in [
        (["--spin-ns", "900000"], "loop.spin_ns"),
        (["--period-ns", "0"], "loop.period_ns"),
        (["--fifo-priority", "100"], "real_time.fifo_priority"),
        (["--status-every-ticks", "0"], "loop.status_every_ticks"),
    ] {
        let output = finish(place.controller(&config, &model, &options));
        assert_eq!(output.status.code(), Some(1));
        assert!(text(&output).contains(key), "{}", text(&output));
    }
}

#[test]
fn top_shows_a_running_controller_and_says_when_there_is_none() {
    let place = Place::new("top");
    let top = ["top", "--instance", &place.instance, "--once"];
    let none = run(program("controller").args(top));
    assert_eq!(none.status.code(), Some(1));
    assert!(text(&none).contains("no controller runs on instance"), "{}", text(&none));

    let (mut robot, controller) = start(&place, &[]);
    robot.run_up_live();
    let mut looking = program("controller")
        .args(top)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    while looking.try_wait().unwrap().is_none() {
        robot.live();
    }
    let printed = text(&finish(looking));
    for part in [&place.instance, "Hz, period 1000 µs", "allocations in the loop 0", "evaluation"]
    {
        assert!(printed.contains(part), "expected `{part}` in: {printed}");
    }
    stop_live(robot, controller);
    let summary = json(&place.path("controller.json"));
    assert_eq!(summary["allocations"], 0, "{summary}");
    assert!(summary["connections"]["count"].as_u64().unwrap() >= 1, "{summary}");
}

#[test]
fn a_short_soak_holds_and_one_without_a_publisher_does_not() {
    let place = Place::new("soak");
    let model = place.train("planar");
    let config = file("config/controllers/planar.ron");
    let soak = |minutes: &str, force: &[&str], publisher: &[&str]| {
        run(program("controller")
            .args(["soak", &config, "--model", &model, "--minutes", minutes])
            .args(force)
            .args(["--instance", &place.instance, "--out", &place.path("soak"), "--"])
            .args(publisher))
    };
    let simulator = program("planar-sim");
    let simulator = simulator.get_program().to_str().unwrap();
    let scene = file("config/scenes/planar.json");
    let out = place.path("publisher");
    let publisher = [
        simulator,
        "run",
        "--scene",
        &scene,
        "--seed",
        "{seed}",
        "--out",
        &out,
        "--instance",
        &place.instance,
        "--force",
    ];
    let output = soak("0.2", &[], &publisher);
    assert!(output.status.success(), "{}", text(&output));
    let result = json(&place.path("soak/soak.json"));
    assert_eq!(result["allocations"], 0, "{result}");
    assert_eq!(result["schedule_drift_ns"], 0, "{result}");
    assert!(result["publisher_starts"].as_u64().unwrap() >= 2, "{result}");
    assert!(result["ticks"].as_u64().unwrap() > 1000, "{result}");

    let output = soak("0.01", &[], &["true"]);
    assert!(text(&output).contains("is there already and stays as it is"), "{}", text(&output));
    assert_eq!(json(&place.path("soak/soak.json")), result);
    let output = soak("0.01", &["--force"], &["true"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("no tick was in time"), "{}", text(&output));
}
