//! What programs write, seen from outside: when, over what, and what becomes of a fault.

use std::fs;
use std::process::{Child, Stdio};

use crate::common::{Place, file, finish, json, program, text};
use crate::robot::{Robot, start, stop};

/// A planar controller, its standard error wherever asked for.
fn controller(place: &Place, model: &str, summary: &str, err: Stdio) -> Child {
    program("controller")
        .args(["run", &file("config/controllers/planar.ron"), "--model", model, "--lockstep"])
        .args(["--instance", &place.instance, "--summary", summary])
        .stdout(Stdio::piped())
        .stderr(err)
        .spawn()
        .unwrap()
}

#[test]
fn a_summary_is_touched_when_there_is_something_to_write() {
    let place = Place::new("summary");
    let summary = place.path("controller.json");
    fs::write(&summary, "before").unwrap();
    let (mut robot, mut killed) = start(&place, &["--lockstep"]);
    robot.run_up();
    assert_eq!(fs::read_to_string(&summary).unwrap(), "before");
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert_eq!(fs::read_to_string(&summary).unwrap(), "before");
    drop(robot);
    let (mut robot, controller) = start(&place, &["--lockstep"]);
    robot.run_up();
    stop(robot, controller);
    assert_eq!(json(&summary)["allocations"], 0);
    let partial = |entry: fs::DirEntry| entry.file_name().to_string_lossy().contains("partial");
    assert!(!fs::read_dir(&place.folder).unwrap().flatten().any(partial));
}

#[test]
fn a_summary_is_no_device_and_no_folder() {
    let place = Place::new("summary-device");
    let model = place.train("planar");
    for (path, kind) in [("/dev/null", "a device"), (&*place.path(""), "a folder")] {
        let output = finish(controller(&place, &model, path, Stdio::piped()));
        assert_eq!(output.status.code(), Some(1));
        let expected = format!("--summary: `{path}` cannot be written: it is {kind}");
        assert!(text(&output).contains(&expected), "{}", text(&output));
    }
}

/// The arm comes to rest as always; the exit code and the message tell of the file.
#[test]
fn a_summary_that_cannot_be_written_at_the_end_is_told() {
    let place = Place::new("summary-lost");
    let model = place.train("planar");
    fs::create_dir(place.path("gone")).unwrap();
    let mut robot = Robot::new(&place);
    let controller =
        controller(&place, &model, &place.path("gone/controller.json"), Stdio::piped());
    robot.run_up();
    fs::remove_dir(place.path("gone")).unwrap();
    crate::robot::signal(&controller, "-INT");
    while robot.good().mode != tprmp_messages::CommandMode::Stop.to_wire() {}
    assert!(robot.speed() < 0.02);
    let output = finish(controller);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).contains("gone/controller.json` cannot be written"), "{}", text(&output));
}

#[test]
fn nobody_has_to_read_what_a_controller_says() {
    let place = Place::new("deserted");
    let model = place.train("planar");
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut robot = Robot::new(&place);
    let summary = place.path("controller.json");
    let controller = controller(&place, &model, &summary, writer.into());
    robot.run_up();
    stop(robot, controller);
    assert_eq!(json(&summary)["allocations"], 0);
}
