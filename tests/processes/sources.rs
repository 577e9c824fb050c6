//! Frames from several sources, each a process of its own beside the state publisher: what is theirs is told by
//! their names, and none of them concerns another.

use std::fmt::Write as _;
use std::process::{Child, Stdio};

use tprmp_messages::{CommandMode, JointCommand, Reason};

use crate::common::{Place, file, program, run, text};
use crate::robot::{Robot, signal, start, stop_live};

/// A source of frames that stand still, and so many balls far away.
struct Source<'a> {
    name: &'a str,
    frames: &'a [(&'a str, [f64; 3])],
    balls: u32,
    period_s: f64,
}

impl Source<'_> {
    fn start(&self, place: &Place) -> Child {
        let Self { name, frames, balls, period_s } = self;
        let mut text = format!("(source: \"{name}\", period_s: {period_s:?}, frames: [");
        for (frame, [x, y, z]) in *frames {
            let upright = "quaternion_wxyz: (1.0, 0.0, 0.0, 0.0)";
            let _ =
                write!(text, "(name: {frame:?}, position_m: ({x:?}, {y:?}, {z:?}), {upright}),");
        }
        text += "], obstacles: [";
        for ball in 0..*balls {
            let x = 20.0 + f64::from(ball);
            let _ = write!(text, "Sphere(position_m: ({x:?}, -90.0, 0.0), radius_m: 0.1),");
        }
        text += "])";
        let path = place.path(&format!("{name}.ron"));
        std::fs::write(&path, text).unwrap();
        program("controller")
            .args(["frames", &path, "--instance", &place.instance])
            .stdout(Stdio::null())
            .spawn()
            .expect("the source starts")
    }
}

const CAMERA: Source<'_> =
    Source { name: "camera", frames: &[("end", [2.0, 1.0, 0.0])], balls: 0, period_s: 0.02 };
const TABLE: Source<'_> =
    Source { name: "table", frames: &[("corner", [3.0; 3])], balls: 2, period_s: 0.05 };

fn kill(mut child: Child) {
    child.kill().expect("a child can be killed");
    child.wait().expect("a child can be waited for");
}

fn said(place: &Place, words: &[&str]) -> String {
    text(&run(program("controller").args(words).args(["--instance", &place.instance])))
}

/// A controller, and a robot that publishes its states and the frame `start`.
fn without_end(place: &Place) -> (Robot, Child) {
    let (mut robot, controller) = start(place, &[]);
    robot.frames.frame_count = 1;
    (robot, controller)
}

fn goes_on(robot: &mut Robot) {
    robot.until("goes on", Robot::live, |_, command| is_following(command));
}

fn is_following(command: &JointCommand) -> bool {
    command.mode == CommandMode::Track.to_wire() && command.reason == Reason::None.to_wire()
}

/// The arm comes to rest for this reason, and it is said with all of `parts`.
fn rests(robot: &mut Robot, place: &Place, reason: Reason, parts: &[&str]) {
    robot.until("rests", Robot::live, |robot, command| {
        command.reason == reason.to_wire() && robot.speed() < 0.01
    });
    // The robot goes on publishing while somebody asks.
    let status = std::thread::scope(|scope| {
        let asking = scope.spawn(|| said(place, &["ctl", "status"]));
        while !asking.is_finished() {
            robot.live();
        }
        asking.join().unwrap()
    });
    for part in parts {
        assert!(status.contains(part), "expected `{part}` in: {status}");
    }
}

#[test]
fn a_source_that_is_killed_is_named_and_the_arm_goes_on_once_it_is_back() {
    let place = Place::new("sources-killed");
    let (mut robot, controller) = without_end(&place);
    robot.until("waits for `end`", Robot::live, |_, command| {
        command.reason == Reason::FrameMissing.to_wire()
    });
    let (camera, table) = (CAMERA.start(&place), TABLE.start(&place));
    robot.run_up_live();
    kill(camera);
    let parts = ["frame `end` of source `camera`", "ms old, at most 100.0 ms"];
    rests(&mut robot, &place, Reason::FramesStale, &parts);
    let camera = CAMERA.start(&place);
    goes_on(&mut robot);
    kill(table);
    let parts = ["the newest obstacles of source `table`", "ms old, at most 100.0 ms"];
    rests(&mut robot, &place, Reason::FramesStale, &parts);
    let table = TABLE.start(&place);
    goes_on(&mut robot);
    let picture = std::thread::scope(|scope| {
        let asking = scope.spawn(|| said(&place, &["top", "--once"]));
        while !asking.is_finished() {
            robot.live();
        }
        asking.join().unwrap()
    });
    assert!(picture.contains("frames end; 0 obstacles"), "{picture}");
    assert!(picture.contains("source `table`"), "{picture}");
    stop_live(robot, controller);
    for source in [camera, table] {
        signal(&source, "-INT");
        assert!(crate::common::finish(source).status.success());
    }
    let summary = crate::common::json(&place.path("controller.json"));
    assert_eq!(summary["allocations"], 0, "{summary}");
}

#[test]
fn a_frame_or_a_name_that_two_sources_have_is_told() {
    let place = Place::new("sources-twice");
    let (mut robot, controller) = without_end(&place);
    let camera = CAMERA.start(&place);
    robot.run_up_live();
    let tracker = Source { name: "tracker", ..CAMERA }.start(&place);
    let parts = ["frame `end` is published by", "source `camera`", "source `tracker`"];
    rests(&mut robot, &place, Reason::FrameTwice, &parts);
    kill(tracker);
    goes_on(&mut robot);
    let other = CAMERA.start(&place);
    let parts = ["two publishers of frames have one `source`, source `camera`"];
    rests(&mut robot, &place, Reason::FrameTwice, &parts);
    kill(other);
    goes_on(&mut robot);
    stop_live(robot, controller);
    kill(camera);
}

#[test]
fn obstacles_of_two_sources_that_are_one_too_many_are_told() {
    let place = Place::new("sources-33");
    let (mut robot, controller) = start(&place, &[]);
    robot.run_up_live();
    let most = Source { name: "tracker", frames: &[], balls: 31, period_s: 0.01 };
    let tracker = most.start(&place);
    goes_on(&mut robot);
    kill(tracker);
    let many = Source { balls: 32, ..most }.start(&place);
    let parts = ["33 obstacles are published, at most 32", "source `tracker` goes beyond"];
    rests(&mut robot, &place, Reason::ObstacleCount, &parts);
    kill(many);
    let tracker = most.start(&place);
    goes_on(&mut robot);
    stop_live(robot, controller);
    kill(tracker);
}

/// The kit looks at all sources, too.
#[test]
fn the_kit_names_sources_that_publish_one_frame() {
    let place = Place::new("sources-kit");
    let mut publisher = program("examples/state_publisher");
    publisher.arg(&place.instance).stdout(Stdio::null()).stderr(Stdio::null());
    let publisher = publisher.spawn().unwrap();
    let table = TABLE.start(&place);
    let kit = || {
        let config = file("config/controllers/planar.ron");
        said(&place, &["conformance", &config, "--seconds", "1"])
    };
    let passed = kit();
    assert!(passed.contains("of source `table`") && !passed.contains("FAILED"), "{passed}");
    let camera = CAMERA.start(&place);
    let failed = kit();
    assert!(failed.contains("frame `end` is published twice"), "{failed}");
    assert_eq!(failed.matches("FAILED").count(), 1, "{failed}");
    for child in [publisher, table, camera] {
        kill(child);
    }
}
