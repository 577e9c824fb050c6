//! `learner record` beside an arm with noisy encoders, and a camera that is noisy, too.

use std::path::Path;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use glam::{DQuat, DVec3};
use nalgebra::SVector;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_learner::demonstration;
use tprmp_messages::{Frame, Instance, RobotState, StatePublisherPorts, TaskFrames, name_bytes};
use tprmp_model::controller_config;
use tprmp_robot::{Chain, Kinematics, forward_kinematics};
use tprmp_spatial::Pose;

use crate::common::{Place, file, program, skip};
use crate::record::{Recorder, names};

/// States follow each other so fast, whatever their stamps say.
const PACE: Duration = Duration::from_millis(2);
/// Longest anything may take.
const PATIENCE: Duration = Duration::from_secs(120);
const START: [f64; 6] = [0.3, -1.4, 1.6, -1.7, -1.57, 0.2];
const GOAL: [f64; 6] = [-0.5, -1.1, 1.5, -1.9, -1.4, -0.3];
const OBJECT: DVec3 = DVec3::new(0.5, -0.2, 0.03);
/// Of a camera, on each axis: [m] and [rad].
const CAMERA: [f64; 2] = [3e-3, 5e-3];
/// A servo of 12 bits counts in such steps [rad].
const SERVO_STEP: f64 = std::f64::consts::TAU / 4096.0;

/// How the arm is measured.
#[derive(Debug, Clone, Copy)]
struct Case {
    rate_hz: u64,
    /// Standard deviation of the encoders [rad].
    noise_rad: f64,
    quantised: bool,
    seed: u64,
}

/// An arm that is guided by hand.
struct Arm {
    case: Case,
    random: ChaCha8Rng,
    ports: StatePublisherPorts,
    state: RobotState,
    frames: TaskFrames,
    joints: [f64; 6],
}

impl Arm {
    fn new(place: &Place, case: Case) -> Self {
        let mut frames = TaskFrames { frame_count: 1, ..Default::default() };
        frames.frames[0].name = name_bytes("object").unwrap();
        Self {
            case,
            random: ChaCha8Rng::seed_from_u64(case.seed),
            ports: Instance::new(&place.instance).unwrap().open_state_publisher().unwrap(),
            state: RobotState { joint_count: 6, time_ns: 1_000_000_000, ..Default::default() },
            frames,
            joints: START,
        }
    }

    /// A number of mean 0 and standard deviation 1, after Box and Muller.
    fn normal(&mut self) -> f64 {
        let (u, v): (f64, f64) = (1.0 - self.random.random::<f64>(), self.random.random());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    fn normals(&mut self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| self.normal()))
    }

    fn publish(&mut self) {
        self.state.sequence += 1;
        self.state.time_ns += 1_000_000_000 / self.case.rate_hz;
        for i in 0..6 {
            let noisy = self.joints[i] + self.case.noise_rad * self.normal();
            let step = (noisy / SERVO_STEP).round() * SERVO_STEP;
            self.state.position[i] = if self.case.quantised { step } else { noisy };
            // As if it were differentiated without a filter, whatever the arm does.
            self.state.velocity[i] = 0.3 * self.normal();
        }
        let rotation = DQuat::from_scaled_axis(CAMERA[1] * self.normals());
        self.frames.frames[0] = Frame {
            valid: 1,
            position: (OBJECT + CAMERA[0] * self.normals()).to_array(),
            quaternion: [rotation.w, rotation.x, rotation.y, rotation.z],
            ..self.frames.frames[0]
        };
        self.frames.sequence += 1;
        self.frames.time_ns = self.state.time_ns;
        assert!(self.ports.frames.publish(self.frames) && self.ports.state.publish(self.state));
        sleep(PACE);
    }

    fn rest_until(&mut self, recorder: &Recorder, said: &str) -> String {
        let case = format!("{:?}:", self.case);
        recorder.hear_while(&case, said, PATIENCE, || self.publish())
    }

    /// With minimum jerk.
    fn go(&mut self, to: [f64; 6], duration_s: f64) {
        let from = self.joints;
        let steps = (duration_s * self.case.rate_hz as f64).round() as u32;
        for step in 1..=steps {
            let t = f64::from(step) / f64::from(steps);
            let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
            self.joints = std::array::from_fn(|j| from[j] + s * (to[j] - from[j]));
            self.publish();
        }
    }
}

/// `learner record` of the pick, with its output piped.
fn record(place: &Place, options: &[&str]) -> Recorder {
    let mut command = program("learner");
    command.args(Recorder::arguments(place, "ur5_pick", &file("config/skills/pick.ron")));
    command.args(options).stdout(Stdio::piped()).stderr(Stdio::piped());
    Recorder::spawn(command)
}

/// X_BE at joint positions [rad].
fn tool(joints: [f64; 6]) -> Pose {
    let config = file("config/controllers/ur5_pick.ron");
    let robot = controller_config::read(Path::new(&config)).unwrap().robot;
    let chain = Chain::<6>::from_urdf(&robot.urdf, robot.selection()).unwrap();
    let mut kinematics = Kinematics::new();
    forward_kinematics(&chain, &SVector::from(joints), &mut kinematics);
    kinematics.tool_pose()
}

/// How far the mean position of some poses is from a point [m].
fn mean_error_m(poses: &[Pose], truth: DVec3) -> f64 {
    let sum: DVec3 = poses.iter().map(|pose| pose.position).sum();
    (sum / poses.len() as f64 - truth).length()
}

#[test]
fn noisy_arms_are_recorded_from_rest_to_rest() {
    let kinds = [(500, 5e-4, false), (125, 1e-3, false), (125, 0.0, true), (50, 1e-3, true)];
    for (seed, (rate_hz, noise_rad, quantised)) in kinds.into_iter().cycle().take(8).enumerate() {
        let case = Case { rate_hz, noise_rad, quantised, seed: seed as u64 };
        let place = Place::new(&format!("record-noise-{seed}"));
        let recorder = record(&place, &["--count", "2"]);
        let mut arm = Arm::new(&place, case);
        arm.rest_until(&recorder, "ready");
        arm.go(GOAL, 2.0);
        arm.rest_until(&recorder, "01.json: ");
        // Rest that goes on for long is none of a demonstration.
        (0..8 * rate_hz).for_each(|_| arm.publish());
        arm.go(START, 3.0);
        arm.rest_until(&recorder, "02.json: ");
        let said = recorder.end();
        assert!(!said.contains("not recorded") && !said.contains("note "), "{case:?}: {said}");
        assert_eq!(names(&place), ["01.json", "02.json"], "{case:?}: {said}");

        for (name, from, to, duration_s) in
            [("01.json", START, GOAL, 2.0), ("02.json", GOAL, START, 3.0)]
        {
            let path = place.path(&format!("recorded/{name}"));
            let read = demonstration::read(Path::new(&path), "ee_start", "object").unwrap();
            let (poses, [from, to]) = (&read.poses, [from, to].map(|joints| tool(joints).position));
            // Steps shift the whole rest, noise its mean over ten samples.
            let bound_m = 1e-3 + 3.0 * noise_rad + if quantised { SERVO_STEP } else { 0.0 };
            let ends = [(&poses[..10], from), (&poses[poses.len() - 10..], to)];
            for error_m in ends.map(|(rest, at)| mean_error_m(rest, at)) {
                assert!(error_m < bound_m, "{case:?}: {name}: {error_m} m");
            }
            assert!((read.start.position - from).length() < bound_m, "{case:?}: {name}");
            // The mean of 50 measurements or more.
            let goal_m = (read.goal_frame.position - OBJECT).length();
            assert!(goal_m < 4.0 * CAMERA[0] * (3.0_f64 / 50.0).sqrt(), "{case:?}: {goal_m} m");
            let recorded_s = (poses.len() - 1) as f64 * read.sampling_time_s;
            assert!((duration_s..duration_s + 1.0).contains(&recorded_s), "{recorded_s} s");
        }
    }
}

#[test]
fn what_is_waited_for_is_said_with_its_numbers_and_bounds_are_options() {
    let place = Place::new("record-says");
    let case = Case { rate_hz: 125, noise_rad: 1e-3, quantised: false, seed: 1 };
    let recorder = record(&place, &["--count", "1", "--frame-noise-m", "0.02", "--rest-s", "0.8"]);
    let mut arm = Arm::new(&place, case);
    for to in [GOAL, START] {
        arm.go(to, 2.0);
    }
    let said = arm.rest_until(&recorder, "ready");
    assert!(said.contains("waiting for the arm to rest: 0."), "{said}");
    assert!(said.contains(" rad/s above 0.0"), "{said}");
    let (_, noise) = said.split_once("noise: joints ").expect(&said);
    let noise_mrad: f64 = noise.split_once(" mrad").unwrap().0.parse().expect(&said);
    assert!((0.5..2.0).contains(&noise_mrad), "{said}");
    arm.go(GOAL, 2.0);
    arm.rest_until(&recorder, "01.json: ");
    recorder.end();

    let refused = record(&place, &["--rest-speed-m-s", "0"]);
    refused.wait_until("expected a number from 1e-6 to 10");
}

#[test]
fn on_a_terminal_one_line_is_kept_up_to_date() {
    if !Path::new("/usr/bin/script").exists() {
        skip("`script`, which makes a terminal, is not installed");
        return;
    }
    let place = Place::new("record-terminal");
    let learner = program("learner").get_program().to_str().unwrap().to_owned();
    let arguments = Recorder::arguments(&place, "ur5_pick", &file("config/skills/pick.ron"));
    let mut command = std::process::Command::new("/usr/bin/script");
    command
        .args(["-qec", &format!("{learner} {} --count 1", arguments.join(" ")), "/dev/null"])
        .env("TERM", "xterm")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let recorder = Recorder::spawn(command);
    let case = Case { rate_hz: 125, noise_rad: 1e-3, quantised: false, seed: 2 };
    let mut arm = Arm::new(&place, case);
    arm.rest_until(&recorder, "ready: waiting for the arm to move");
    arm.go(GOAL, 8.0);
    let said = arm.rest_until(&recorder, "01.json: ");
    recorder.end();
    let lines = said.split(['\r', '\n']).filter(|line| line.contains("recording, "));
    let times: Vec<&str> = lines.filter_map(|l| l.split("recording, ").nth(1)?.get(..3)).collect();
    assert!(times.len() > 3 && times.is_sorted(), "{times:?} in {said}");
    assert!(said.contains("\u{1b}[2K") || said.contains("\u{1b}[1A"), "{said:?}");
}
