//! The shipped state publishers, in Rust and in Python: a controller connects to them and runs its
//! skill to the end.

use std::process::{Command, Stdio};

use crate::common::{Place, finish, json, program, root, text};
use crate::robot::signal;

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
}

#[test]
fn a_state_publisher_in_ten_lines_of_rust_is_one() {
    runs_a_skill(program("examples/state_publisher"), "example-rust");
}

#[test]
fn a_state_publisher_in_ten_lines_of_python_is_one() {
    let mut python = program("python");
    python.arg(root().join("sim-bridge/examples/state_publisher.py"));
    runs_a_skill(python, "example-python");
}
