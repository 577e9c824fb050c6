//! `learner record` beside a publisher of this test's own: what it writes is what was published.

use std::cell::Cell;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

use tprmp_learner::demonstration::{self, Demonstration};
use tprmp_learner::skill::Skill;
use tprmp_messages::{Frame, Instance, RobotState, StatePublisherPorts, TaskFrames, name_bytes};
use tprmp_spatial::Pose;

use crate::common::{Place, file, program, run, text};

/// Time between two states on their own clock [ns]; in truth they follow each other faster.
const STEP_NS: u64 = 5_000_000;
const PACE: Duration = Duration::from_millis(2);
/// Longest anything may take.
const PATIENCE: Duration = Duration::from_secs(60);
const START: [f64; 2] = [-0.4, 0.1];
const GOAL: [f64; 2] = [0.5, 0.3];

/// A point in the plane that is guided by hand.
struct Robot {
    ports: StatePublisherPorts,
    state: RobotState,
    frames: TaskFrames,
}

impl Robot {
    fn new(place: &Place) -> Self {
        let frame = |name: &str, [x, y]: [f64; 2]| Frame {
            name: name_bytes(name).unwrap(),
            valid: 1,
            position: [x, y, 0.0],
            quaternion: [0.995_004_165, 0.0, 0.0, 0.099_833_417],
            ..Default::default()
        };
        let mut frames = TaskFrames { frame_count: 2, ..Default::default() };
        frames.frames[0] = frame("start", START);
        frames.frames[1] = frame("end", GOAL);
        let ports = Instance::new(&place.instance).unwrap().open_state_publisher().unwrap();
        let mut state = RobotState { joint_count: 2, time_ns: 1_000_000_000, ..Default::default() };
        state.position[..2].copy_from_slice(&START);
        Self { ports, state, frames }
    }

    fn publish(&mut self) {
        self.state.sequence += 1;
        self.state.time_ns += STEP_NS;
        self.frames.sequence += 1;
        self.frames.time_ns = self.state.time_ns;
        assert!(self.ports.frames.publish(self.frames) && self.ports.state.publish(self.state));
        sleep(PACE);
    }

    /// Stays where it is until the recorder has said this; gives what it said since the last time.
    fn rest_until(&mut self, recorder: &Recorder, said: &str) -> String {
        recorder.hear_while("", said, PATIENCE, || self.publish())
    }

    /// Stays where it is for as long as everything has to rest, and somewhat longer.
    fn rest(&mut self) {
        (0..RESTS).for_each(|_| self.publish());
    }

    /// Moves on a bow to another place; `each` is called before each state with the fraction of time.
    fn go(&mut self, to: [f64; 2], mut each: impl FnMut(&mut Self, f64)) {
        let from = [self.state.position[0], self.state.position[1]];
        for step in 1..=STEPS {
            let fraction = f64::from(step) / f64::from(STEPS);
            self.state.position[..2].copy_from_slice(&bow(from, to, fraction));
            each(self, fraction);
            self.publish();
        }
    }
}

/// States of a rest: two seconds on their clock.
const RESTS: u32 = 400;
/// States of a motion: two seconds on their clock.
const STEPS: u32 = 400;

/// Where the point is after this fraction of the time.
fn bow(from: [f64; 2], to: [f64; 2], fraction: f64) -> [f64; 2] {
    let t = fraction.clamp(0.0, 1.0);
    let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
    let side = 0.15 * (std::f64::consts::PI * s).sin();
    [from[0] + (to[0] - from[0]) * s, from[1] + (to[1] - from[1]) * s + side]
}

/// `learner record`, and what it says.
pub(crate) struct Recorder {
    child: Child,
    said: Arc<Mutex<String>>,
    /// So much of it has been looked at.
    heard: Cell<usize>,
}

impl Recorder {
    /// Goes on until it has said this; gives what it said since the last time.
    pub(crate) fn hear_while(
        &self,
        case: &str,
        said: &str,
        patience: Duration,
        mut go_on: impl FnMut(),
    ) -> String {
        let begin = Instant::now();
        while !self.has_said(said) {
            assert!(begin.elapsed() < patience, "{case} expected `{said}` in: {}", self.all_said());
            go_on();
        }
        self.hear()
    }

    fn command(place: &Place, skill: &str, options: &[&str]) -> Command {
        let mut command = program("learner");
        command.args(Self::arguments(place, "planar", skill)).args(options);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// For the arm of a shipped configuration.
    pub(crate) fn arguments(place: &Place, config: &str, skill: &str) -> Vec<String> {
        let config = file(&format!("config/controllers/{config}.ron"));
        let out = place.path("recorded");
        ["record", &config, "--skill", skill, "--out", &out, "--instance", &place.instance]
            .map(Into::into)
            .into()
    }

    fn start(place: &Place, options: &[&str]) -> Self {
        Self::start_with(place, &file("config/skills/planar.ron"), options)
    }

    fn start_with(place: &Place, skill: &str, options: &[&str]) -> Self {
        Self::spawn(Self::command(place, skill, options))
    }

    /// Starts a command whose output is piped.
    pub(crate) fn spawn(mut command: Command) -> Self {
        let mut child = command.spawn().unwrap();
        let said = Arc::new(Mutex::new(String::new()));
        let mut err = child.stderr.take().unwrap();
        let mut out = child.stdout.take().unwrap();
        let listen = |source: &mut dyn Read, said: &Mutex<String>| {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = source.read(&mut bytes) {
                said.lock().unwrap().push_str(&String::from_utf8_lossy(&bytes[..count]));
            }
        };
        let heard = Arc::clone(&said);
        spawn(move || listen(&mut err, &heard));
        let heard = Arc::clone(&said);
        spawn(move || listen(&mut out, &heard));
        Self { child, said, heard: Cell::new(0) }
    }

    pub(crate) fn all_said(&self) -> String {
        self.said.lock().unwrap().clone()
    }

    pub(crate) fn has_said(&self, text: &str) -> bool {
        self.said.lock().unwrap()[self.heard.get()..].contains(text)
    }

    /// Gives what it said since the last time.
    pub(crate) fn hear(&self) -> String {
        let said = self.said.lock().unwrap();
        said[self.heard.replace(said.len())..].into()
    }

    /// Waits for this without a publisher.
    pub(crate) fn wait_until(&self, said: &str) {
        let begin = Instant::now();
        while !self.has_said(said) {
            assert!(begin.elapsed() < PATIENCE, "expected `{said}` in: {}", self.all_said());
            sleep(PACE);
        }
    }

    fn interrupt(self) -> String {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        self.end()
    }

    /// Waits for its end; it succeeds. Gives all that it said.
    pub(crate) fn end(mut self) -> String {
        let begin = Instant::now();
        while self.child.try_wait().unwrap().is_none() {
            if begin.elapsed() > PATIENCE {
                self.child.kill().unwrap();
                panic!("it did not end: {}", self.all_said());
            }
            sleep(PACE);
        }
        assert!(self.child.wait().unwrap().success(), "{}", self.all_said());
        self.heard.set(0);
        self.wait_until("learner: ended");
        self.all_said()
    }
}

/// A test that fails leaves no process behind.
impl Drop for Recorder {
    fn drop(&mut self) {
        // It has ended already when the test did not fail.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Names in the folder of demonstrations.
pub(crate) fn names(place: &Place) -> Vec<String> {
    let entries = fs::read_dir(place.path("recorded")).unwrap().flatten();
    let mut names: Vec<_> = entries.map(|e| e.file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn read(place: &Place, name: &str) -> Demonstration {
    demonstration::read(Path::new(&place.path(&format!("recorded/{name}"))), "start", "end")
        .unwrap()
}

/// The largest distance [m] of the samples from what was published, where the first one is the
/// published state that fits best.
fn error_m(demonstration: &Demonstration, from: [f64; 2], to: [f64; 2]) -> f64 {
    let error_at = |first: i32| {
        let errors = demonstration.poses.iter().enumerate().map(|(k, pose)| {
            let step =
                f64::from(first) + k as f64 * demonstration.sampling_time_s * 1e9 / STEP_NS as f64;
            let [x, y] = bow(from, to, step / f64::from(STEPS));
            (pose.position.x - x).hypot(pose.position.y - y)
        });
        errors.fold(0.0, f64::max)
    };
    (-100..=100).map(error_at).fold(f64::INFINITY, f64::min)
}

#[test]
fn what_is_written_is_what_was_published_one_file_a_motion() {
    let place = Place::new("record");
    fs::create_dir_all(place.path("recorded")).unwrap();
    fs::write(place.path("recorded/07.json"), "not mine").unwrap();
    let recorder = Recorder::start(&place, &["--count", "2", "--sampling-time-s", "0.008"]);
    recorder.wait_until("waiting for a state of the robot");
    let mut robot = Robot::new(&place);
    robot.rest_until(&recorder, "ready");
    robot.go(GOAL, |_, _| {});
    robot.rest_until(&recorder, "08.json: ");
    // Begun elsewhere, and the frame with it.
    let other = [-0.2, -0.3];
    robot.frames.frames[0].position[..2].copy_from_slice(&GOAL);
    robot.frames.frames[1].position[..2].copy_from_slice(&other);
    robot.rest();
    robot.go(other, |_, _| {});
    robot.rest_until(&recorder, "09.json: ");
    assert!(recorder.end().contains("2 demonstrations"));
    drop(robot);
    assert_eq!(place.leftovers(), Vec::<PathBuf>::new());

    assert_eq!(names(&place), ["07.json", "08.json", "09.json"]);
    assert_eq!(fs::read_to_string(place.path("recorded/07.json")).unwrap(), "not mine");
    for (name, from, to) in [("08.json", START, GOAL), ("09.json", GOAL, other)] {
        let demonstration = read(&place, name);
        assert_eq!(
            (demonstration.skill.as_str(), demonstration.sampling_time_s),
            ("planar", 0.008)
        );
        // Six decimals, and straight lines between states.
        let error = error_m(&demonstration, from, to);
        assert!(error < 5e-5, "{name}: {error} m");
        let ends = [&demonstration.poses[0], &demonstration.poses[demonstration.poses.len() - 1]];
        for ((end, at), frame) in
            ends.into_iter().zip([from, to]).zip([&demonstration.start, &demonstration.goal_frame])
        {
            assert!((end.position.x - at[0]).hypot(end.position.y - at[1]) < 3e-4, "{name}");
            assert_eq!((frame.position.x, frame.position.y), (at[0], at[1]), "{name}");
            assert!((frame.orientation.z - 0.099_833).abs() < 1e-6);
        }
    }
}

#[test]
fn an_interrupt_keeps_what_was_recorded_so_far_and_nothing_else() {
    let place = Place::new("record-interrupt");
    let recorder = Recorder::start(&place, &[]);
    let mut robot = Robot::new(&place);
    robot.rest_until(&recorder, "ready");
    assert!(recorder.interrupt().contains("0 demonstrations"));
    assert_eq!(names(&place), Vec::<String>::new());

    let recorder = Recorder::start(&place, &[]);
    robot.rest_until(&recorder, "ready");
    robot.state.position[0] += 0.004;
    robot.publish();
    robot.rest_until(&recorder, "not recorded: the tool moved by");
    robot.rest_until(&recorder, "ready");
    let from = [robot.state.position[0], robot.state.position[1]];
    for step in 1..=STEPS / 2 {
        let at = bow(from, GOAL, f64::from(step) / f64::from(STEPS));
        robot.state.position[..2].copy_from_slice(&at);
        robot.publish();
    }
    let said = recorder.interrupt();
    assert!(said.contains("01.json") && said.contains("1 demonstration"), "{said}");
    assert_eq!(names(&place), ["01.json"]);
    let error = error_m(&read(&place, "01.json"), from, GOAL);
    assert!(error < 5e-5, "{error} m");
}

#[test]
fn frames_that_move_or_are_missing_are_named_and_nothing_is_written() {
    let place = Place::new("record-frames");
    let recorder = Recorder::start(&place, &["--count", "1"]);
    let mut robot = Robot::new(&place);
    let good = robot.frames;
    robot.frames.frames[1].name = name_bytes("other").unwrap();
    robot.rest_until(&recorder, "waiting for frame `end`, which is not among the published frames");
    robot.go(GOAL, |_, _| {});
    robot.rest_until(&recorder, "not recorded: the arm moves, but frame `end`");
    robot.frames = good;
    robot.frames.frames[1].valid = 0;
    robot.rest_until(&recorder, "waiting for frame `end`, which is published as invalid");
    robot.frames = good;
    robot.rest_until(&recorder, "ready");
    robot
        .go(START, |robot, fraction| robot.frames.frames[1].position[1] = GOAL[1] + 0.1 * fraction);
    robot.rest_until(&recorder, "not recorded: frame `end` moved by");
    robot.rest_until(&recorder, "ready");
    assert_eq!(names(&place), Vec::<String>::new());

    // A robot guided by hand: nobody publishes a start frame.
    robot.frames = good;
    robot.frames.frames[0] = good.frames[1];
    robot.frames.frame_count = 1;
    robot.rest();
    let from = [robot.state.position[0], robot.state.position[1]];
    robot.go(GOAL, |_, _| {});
    let said = robot.rest_until(&recorder, "01.json");
    assert!(said.contains("frame `start` is not published: the tool's pose"), "{said}");
    recorder.end();
    assert_eq!(names(&place), ["01.json"]);
    let demonstration = read(&place, "01.json");
    assert_eq!(demonstration.start, demonstration.poses[0]);
    assert!(
        (demonstration.start.position.x - from[0]).hypot(demonstration.start.position.y - from[1])
            < 1e-5
    );
}

#[test]
fn further_frames_are_written_and_a_skill_of_one_frame_needs_no_other() {
    let place = Place::new("record-further");
    let mut robot = Robot::new(&place);
    let good = robot.frames;
    for (start, others, name) in
        [("end", &["box"][..], "01.json"), ("start", &["box"], "02.json"), ("end", &[], "03.json")]
    {
        let skill = place.edited(
            "config/skills/planar.ron",
            &[
                ("start_frame: \"start\"", &format!("start_frame: \"{start}\"")),
                ("other_frames: []", &format!("other_frames: {others:?}")),
            ],
        );
        let recorder = Recorder::start_with(&place, &skill, &["--count", "1"]);
        robot.state.position[..2].copy_from_slice(&START);
        robot.frames = good;
        if start == "end" {
            // A frame that no skill names is not looked at.
            robot.frames.frames[0].valid = 0;
        }
        if !others.is_empty() {
            robot.rest_until(&recorder, "waiting for frame `box`, which is not among");
            robot.frames.frame_count = 3;
            robot.frames.frames[2] = good.frames[0];
            robot.frames.frames[2].name = name_bytes("box").unwrap();
            robot.rest_until(&recorder, "ready");
            robot.go(GOAL, |robot, fraction| {
                robot.frames.frames[2].position[0] = START[0] + fraction.powi(3);
            });
            robot.rest_until(&recorder, "not recorded: frame `box` moved by");
            robot.state.position[..2].copy_from_slice(&START);
            robot.frames.frames[2].position[..2].copy_from_slice(&[0.1, -0.2]);
        }
        robot.rest_until(&recorder, "ready");
        robot.go(GOAL, |_, _| {});
        robot.rest_until(&recorder, name);
        let said = recorder.end();
        assert!(!said.contains("note ") && !said.contains("the tool's pose"), "{said}");

        // Training finds just the frames that it asks for.
        let alone = place.folder.join("alone");
        fs::create_dir_all(&alone).unwrap();
        fs::copy(place.path(&format!("recorded/{name}")), alone.join("demonstration.json"))
            .unwrap();
        let skill = Skill::read(Path::new(&skill)).unwrap();
        let Skill { start_frame, goal_frame, other_frames, .. } = &skill;
        let demonstration = demonstration::read_folder(
            &alone,
            &skill.skill,
            skill.manifold,
            start_frame,
            goal_frame,
            other_frames,
        );
        let [demonstration] = &demonstration.unwrap()[..] else { panic!("one demonstration") };
        let at = |frame: &Pose| [frame.position.x, frame.position.y];
        assert_eq!(at(&demonstration.goal_frame), GOAL);
        assert_eq!(at(&demonstration.start), if start == "end" { GOAL } else { START });
        assert!(demonstration.other_frames.values().all(|frame| at(frame) == [0.1, -0.2]));
        let error = error_m(demonstration, START, GOAL);
        assert!(error < 5e-5, "{error} m");
    }
}

#[test]
fn faulty_states_and_a_publisher_that_goes_end_a_demonstration_and_the_next_one_is_recorded() {
    let place = Place::new("record-faults");
    let recorder = Recorder::start(&place, &["--count", "1"]);
    let mut robot = Robot::new(&place);
    type Fault = fn(&mut RobotState);
    let faults: [(Fault, &str); 4] = [
        (|s| s.position[1] = f64::NAN, "a joint position is not finite"),
        (|s| s.joint_count = 6, "a state has 6 joints"),
        (|s| s.time_ns += 1_000_000_000, "more than 0.1 s lie between two states"),
        (|s| s.sequence = 0, "the sequence number went back"),
    ];
    for (i, (fault, said)) in faults.into_iter().enumerate() {
        robot.rest_until(&recorder, "ready");
        robot.go(if i % 2 == 0 { GOAL } else { START }, |robot, fraction| {
            if fraction == 0.5 {
                let state = robot.state;
                fault(&mut robot.state);
                robot.publish();
                let (sequence, time_ns) = (robot.state.sequence, robot.state.time_ns);
                robot.state = RobotState { sequence, time_ns, ..state };
            }
        });
        robot.rest_until(&recorder, &format!("not recorded: {said}"));
    }
    // Gone in the middle, and back with numbers of its own.
    robot.rest_until(&recorder, "ready");
    for step in 1..=STEPS / 2 {
        let at = bow(START, GOAL, f64::from(step) / f64::from(STEPS));
        robot.state.position[..2].copy_from_slice(&at);
        robot.publish();
    }
    drop(robot);
    recorder.wait_until("not recorded: no state arrived");
    recorder.wait_until("the publisher is gone");
    recorder.hear();
    let mut robot = Robot::new(&place);
    robot.rest_until(&recorder, "ready");
    assert_eq!(names(&place), Vec::<String>::new());
    robot.go(GOAL, |_, _| {});
    robot.rest_until(&recorder, "01.json");
    recorder.end();
    let error = error_m(&read(&place, "01.json"), START, GOAL);
    assert!(error < 5e-5, "{error} m");
    drop(robot);
    assert_eq!(place.leftovers(), Vec::<PathBuf>::new());
}

#[test]
fn a_listener_that_has_gone_ends_no_recording() {
    let place = Place::new("record-unheard");
    let mut robot = Robot::new(&place);
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut command =
        Recorder::command(&place, &file("config/skills/planar.ron"), &["--count", "1"]);
    let mut child = command.stdout(writer.try_clone().unwrap()).stderr(writer).spawn().unwrap();
    let begin = Instant::now();
    for to in [GOAL, START].into_iter().cycle() {
        if child.try_wait().unwrap().is_some() || begin.elapsed() > PATIENCE {
            break;
        }
        robot.rest();
        robot.go(to, |_, _| {});
    }
    // One that has not ended by now fails the test.
    let _ = child.kill();
    assert!(child.wait().unwrap().success());
    assert_eq!(names(&place), ["01.json"]);
}

#[test]
fn recording_beside_a_controller_changes_none_of_its_commands() {
    let place = Place::new("record-beside");
    let model = place.train("planar");
    let mut streams = Vec::new();
    for beside in [false, true] {
        let recorder = beside.then(|| Recorder::start(&place, &[]));
        if let Some(recorder) = &recorder {
            recorder.wait_until("waiting for a state of the robot");
        }
        let config = file("config/controllers/planar.ron");
        let controller = place.controller(&config, &model, &["--lockstep", "--until-done"]);
        let commands = place.path("commands.bin");
        let output = run(program("planar-sim")
            .args(["run", "--seed", "1", "--out", &place.path(""), "--lockstep", "--force"])
            .args(["--instance", &place.instance, "--record-commands", &commands]));
        assert!(output.status.success(), "{}", text(&output));
        let output = crate::common::finish(controller);
        assert!(output.status.success(), "{}", text(&output));
        if let Some(recorder) = recorder {
            recorder.interrupt();
        }
        streams.push(fs::read(commands).unwrap());
        assert_eq!(place.leftovers(), Vec::<PathBuf>::new());
    }
    assert!(!streams[0].is_empty() && streams[0] == streams[1]);
}

#[test]
fn what_cannot_be_recorded_is_refused_before_anything_is_opened() {
    let place = Place::new("record-refused");
    let refused = |config: &str, skill: &str, options: &[&str], expected: &[&str]| {
        let output = run(program("learner")
            .args(["record", config, "--skill", skill, "--instance", &place.instance])
            .args(options));
        let said = text(&output);
        assert!(!output.status.success(), "{said}");
        for part in expected {
            assert!(said.contains(part), "expected `{part}` in: {said}");
        }
        assert!(place.leftovers().is_empty());
    };
    let (config, skill) = (file("config/controllers/planar.ron"), file("config/skills/planar.ron"));
    let out = place.path("recorded");
    refused("none.ron", &skill, &["--out", &out], &["none.ron", "cannot be read"]);
    refused(&config, "none.ron", &["--out", &out], &["none.ron", "cannot be read"]);
    let pick = file("config/skills/pick.ron");
    refused(&config, &pick, &["--out", &out], &["tool_frame", "`point`", "`suction_tip`"]);
    refused(&config, &skill, &["--out", &out, "--sampling-time-s", "0"], &["0.001 to 0.1 s"]);
    fs::write(place.path("file"), "").unwrap();
    let below = place.path("file/recorded");
    refused(&config, &skill, &["--out", &below], &["file/recorded", "cannot be written"]);
}
