//! The shipped state publishers, in Rust, Python and C: a controller connects to them and runs its skill to the
//! end. And what `controller layout` prints for other languages is what is committed, and compiles.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::common::{Place, file, finish, json, program, root, run, text};
use crate::robot::signal;

/// A page of a publisher.
const LINES_MAX: usize = 40;
const C: &str = "controller/messages/c";

fn runs_a_skill(mut publisher: Command, test: &str) {
    let place = Place::new(test);
    let model = place.train("planar");
    publisher.arg(&place.instance).stdout(Stdio::piped()).stderr(Stdio::piped());
    let publisher = publisher.spawn().expect("the publisher starts");
    // The publisher keeps real time: where the machine stands still for a while, the point goes on after it.
    let config = place.passing("config/controllers/planar.ron");
    let output = finish(place.controller(&config, &model, &["--until-done"]));
    signal(&publisher, "-INT");
    let published = finish(publisher);
    assert!(output.status.success(), "{}", text(&output));
    assert!(published.status.success(), "{}", text(&published));
    let summary = json(&place.path("controller.json"));
    assert_eq!(summary["life_cycle"], "Done", "{summary}");
    assert_eq!(place.leftovers(), Vec::<PathBuf>::new());
}

fn is_short(path: &str) {
    let lines = std::fs::read_to_string(file(path)).unwrap().lines().count();
    assert!(lines <= LINES_MAX, "{path}: {lines} lines, expected at most {LINES_MAX}");
}

#[test]
fn a_state_publisher_in_thirty_lines_of_rust_is_one() {
    is_short("controller/messages/examples/state_publisher.rs");
    runs_a_skill(program("examples/state_publisher"), "example-rust");
}

#[test]
fn a_state_publisher_in_thirty_lines_of_python_is_one() {
    is_short("sim-bridge/examples/state_publisher.py");
    let mut python = program("python");
    python.arg(root().join("sim-bridge/examples/state_publisher.py"));
    runs_a_skill(python, "example-python");
}

/// Where cargo puts the shared library for C: beside the programs.
fn library_folder() -> PathBuf {
    let test = std::env::current_exe().expect("a test has a path");
    let folder = test.ancestors().nth(2).expect("target/<profile>/deps/<test>").to_path_buf();
    let library = folder.join("libtprmp.so");
    assert!(
        library.exists(),
        "{} is missing: `cargo build --release -p tprmp-c`",
        library.display()
    );
    folder
}

fn compiles(command: &mut Command) {
    let output = run(command);
    assert!(output.status.success(), "{command:?}: {}", text(&output));
}

/// gcc with the strictest warnings.
fn gcc(standard: &str) -> Command {
    let mut gcc = Command::new("gcc");
    gcc.args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-D_POSIX_C_SOURCE=200809L"]);
    gcc.args(["-I", &file(&format!("{C}/include"))]);
    gcc
}

#[test]
fn a_state_publisher_in_c_is_one() {
    let place = Place::new("example-c-program");
    let folder = library_folder().to_str().unwrap().to_owned();
    let program = place.path("state_publisher");
    compiles(
        gcc("-std=c11")
            .args([&file(&format!("{C}/examples/state_publisher.c")), "-o", &program])
            .args(["-L", &folder, "-ltprmp", &format!("-Wl,-rpath,{folder}")]),
    );
    runs_a_skill(Command::new(program), "example-c");
}

#[test]
fn what_fails_in_c_is_told() {
    let place = Place::new("example-c-errors");
    let folder = library_folder().to_str().unwrap().to_owned();
    let (source, program) = (place.path("errors.c"), place.path("errors"));
    let code = r#"
        #include <stdio.h>
        #include "tprmp.h"
        int main(int count, char **arguments) {
            const char *joints[] = {"a", "b", "c", "d", "e", "f", "g", "h", "i"};
            if (count != 2 || tprmp_open("no/name", joints, 1, NULL)) return 1;
            puts(tprmp_error());
            if (tprmp_open(arguments[1], joints, 9, NULL)) return 1;
            puts(tprmp_error());
            tprmp_publisher *robot = tprmp_open(arguments[1], joints, 2, NULL);
            if (!robot || tprmp_open(arguments[1], joints, 2, NULL)) return 1;
            puts(tprmp_error());
            tprmp_source *camera = tprmp_open_source(arguments[1]);
            tprmp_task_frames frames = {.source = "camera"};
            if (!camera || tprmp_publish_source(camera, tprmp_now_ns(), &frames)) return 1;
            tprmp_robot_state state = {0};
            if (tprmp_publish(robot, 7, NULL, &state)) return 1;
            printf("%u joints, stamp %u\n", state.joint_count, (unsigned)state.time_ns);
            tprmp_close_source(camera);
            tprmp_close(robot);
            tprmp_close(NULL);
            return 0;
        }"#;
    std::fs::write(&source, code).unwrap();
    compiles(gcc("-std=c11").args([&source, "-o", &program]).args([
        "-L",
        &folder,
        "-ltprmp",
        &format!("-Wl,-rpath,{folder}"),
    ]));
    let output = run(Command::new(program).arg(&place.instance));
    let said = text(&output);
    assert!(output.status.success(), "{said}");
    for part in [
        "instance name `no/name`: expected 1 to 32",
        "a robot of 9 joints: expected 1 to 8",
        "robot_state/v1` already has a publisher",
        "2 joints, stamp 7",
    ] {
        assert!(said.contains(part), "expected `{part}` in: {said}");
    }
}

/// What `controller layout` prints in a language.
fn layout(format: &str) -> String {
    let output = run(program("controller").args(["layout", "--format", format]));
    assert!(output.status.success(), "{}", text(&output));
    String::from_utf8(output.stdout).unwrap()
}

/// With `TPRMP_WRITE_TABLES=1` the files are written anew.
#[test]
fn the_header_and_the_module_are_those_that_the_controller_prints() {
    for (format, path) in [
        ("c", format!("{C}/include/tprmp_messages.h")),
        ("python", "sim-bridge/sim_bridge/wire.py".into()),
    ] {
        let printed = layout(format);
        if std::env::var("TPRMP_WRITE_TABLES").is_ok_and(|value| value == "1") {
            std::fs::write(file(&path), printed).unwrap();
            continue;
        }
        let written = std::fs::read_to_string(file(&path)).unwrap();
        assert!(
            printed == written,
            "{path}: `controller layout --format {format} > {path}` writes it anew"
        );
    }
}

#[test]
fn the_header_and_the_module_stand_alone() {
    let place = Place::new("layout");
    let (header, module) = (place.path("messages.h"), place.path("messages.py"));
    std::fs::write(&header, layout("c")).unwrap();
    std::fs::write(&module, layout("python")).unwrap();
    compiles(gcc("-std=c11").args(["-fsyntax-only", "-x", "c", &header]));
    compiles(gcc("-std=c++11").args(["-fsyntax-only", "-x", "c++", &header]));
    compiles(program("python").args(["-I", &module]));
    // The assertions of the header are no decoration.
    let wrong = layout("c").replacen("uint64_t time_ns;", "uint32_t time_ns;", 1);
    std::fs::write(&header, wrong).unwrap();
    let output = run(gcc("-std=c11").args(["-fsyntax-only", "-x", "c", &header]));
    let said = text(&output);
    assert!(!output.status.success() && said.contains("static assertion failed"), "{said}");
}

#[test]
fn the_layout_for_programs_says_all_that_another_language_needs() {
    let layout: serde_json::Value = serde_json::from_str(&layout("json")).unwrap();
    assert_eq!(layout["iceoryx2"], "0.9.3");
    assert_eq!(layout["prefix"], "tprmp_<user id>_<instance>_");
    assert_eq!(layout["root"], "/tmp/tprmp-<user id>/<instance>/");
    let of = |list: &str, key: &str, name: &str| {
        let list = layout[list].as_array().unwrap();
        list.iter().find(|item| item[key] == name).unwrap_or_else(|| panic!("no {name}")).clone()
    };
    let frames = of("messages", "message", "TaskFrames");
    assert_eq!((&frames["type_name"], &frames["size"]), (&"TaskFramesV3".into(), &5488.into()));
    let obstacles = &frames["fields"][6];
    assert_eq!((&obstacles["type"], &obstacles["count"]), (&"Obstacle".into(), &32.into()));
    let service = of("services", "service", "<instance>/task_frames/v1");
    assert_eq!(service["bounds"]["max_publishers"], 8);
    let modes = of("enums", "enum", "CommandMode");
    assert_eq!(
        (&modes["values"][2]["name"], &modes["values"][2]["value"]),
        (&"Hold".into(), &2.into())
    );
}
