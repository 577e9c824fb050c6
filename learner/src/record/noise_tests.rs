//! A UR5 with noisy encoders and a noisy camera, at the rates of real arms, in simulated stamps.

use std::f64::consts::TAU;
use std::path::Path;

use glam::{DQuat, DVec3};
use tprmp_messages::JOINT_CAPACITY;
use tprmp_model::controller_config;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::arm::{self, Arm};
use super::bounds::Bounds;
use super::intake::{Frames, NO_FRAMES};
use super::noisy::Gaussian;
use super::recorder::{Event, Recorder, Stage};
use super::recording::{Recorded, Task};
use super::rest::Sample;
use super::statistics::{Extent, Offset};

const START: [f64; 6] = [0.3, -1.4, 1.6, -1.7, -1.57, 0.2];
const GOAL: [f64; 6] = [-0.5, -1.1, 1.5, -1.9, -1.4, -0.3];
/// Noise of a camera: 3 mm and 0.3°, thirty times a second.
const CAMERA: Extent = Extent { m: 3e-3, rad: 5e-3 };
const CAMERA_NS: u64 = 33_333_333;
/// A servo of 12 bits counts a rotation in so many steps.
const SERVO_STEPS: f64 = 4096.0;

/// What is wrong with the encoders.
#[derive(Debug, Clone, Copy)]
struct Encoders {
    /// Standard deviation [rad].
    noise_rad: f64,
    quantised: bool,
}

const ENCODERS: [Encoders; 6] = [
    Encoders { noise_rad: 0.0, quantised: false },
    Encoders { noise_rad: 5e-4, quantised: false },
    Encoders { noise_rad: 1e-3, quantised: false },
    Encoders { noise_rad: 0.0, quantised: true },
    Encoders { noise_rad: 5e-4, quantised: true },
    Encoders { noise_rad: 1e-3, quantised: true },
];

impl Encoders {
    /// How far the mean of a few readings of all joints is from the truth at most [rad].
    fn error_rad(&self) -> f64 {
        3.0 * self.noise_rad + if self.quantised { TAU / SERVO_STEPS } else { 0.0 }
    }
}

/// A case: what is printed when it fails.
#[derive(Debug, Clone, Copy)]
struct Case {
    encoders: Encoders,
    camera: Extent,
    rate_hz: u64,
    seed: u64,
}

impl Case {
    /// Every kind of noise at every rate.
    fn all(seeds: std::ops::Range<u64>) -> impl Iterator<Item = Self> {
        let cameras = [Extent::default(), CAMERA];
        seeds.flat_map(move |seed| {
            ENCODERS.into_iter().flat_map(move |encoders| {
                cameras.into_iter().flat_map(move |camera| {
                    [50, 125, 500].map(|rate_hz| Self { encoders, camera, rate_hz, seed })
                })
            })
        })
    }
}

/// An arm that is guided by hand, and what a recorder makes of it.
struct Bench {
    case: Case,
    gaussian: Gaussian,
    arm: Box<dyn Arm>,
    joints: [f64; 6],
    goal: Pose,
    seen: Frames,
    seen_ns: u64,
    time_ns: u64,
    recorder: Recorder,
    begun: usize,
    recorded: Vec<Recorded>,
    refused: Vec<String>,
}

impl Bench {
    fn new(case: Case, bounds: Bounds) -> Self {
        let config =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/controllers/ur5_pick.ron");
        let arm = arm::read(&config, &controller_config::read(&config).unwrap().robot).unwrap();
        let task = Task {
            skill: "made_up".into(),
            manifold: Manifold::R3S3,
            required_frames: vec!["object".into()],
            start_frame: None,
            sampling_time_s: 0.01,
            bounds,
        };
        let goal = Pose {
            position: DVec3::new(0.5, -0.2, 0.03),
            orientation: DQuat::from_scaled_axis(DVec3::new(2.0, 1.8, -1.2)),
        };
        Self {
            case,
            gaussian: Gaussian::new(case.seed),
            arm,
            joints: START,
            goal,
            seen: NO_FRAMES,
            seen_ns: 0,
            time_ns: 1_000_000_000,
            recorder: Recorder::new(task),
            begun: 0,
            recorded: Vec::new(),
            refused: Vec::new(),
        }
    }

    fn pose(&mut self, joints: [f64; 6]) -> Pose {
        let mut position = [0.0; JOINT_CAPACITY];
        position[..6].copy_from_slice(&joints);
        self.arm.tool_pose(&position)
    }

    fn measured(&mut self) -> Pose {
        let Encoders { noise_rad, quantised } = self.case.encoders;
        let joints = self.joints.map(|joint| {
            let noisy = joint + noise_rad * self.gaussian.next();
            let step = TAU / SERVO_STEPS;
            if quantised { (noisy / step).round() * step } else { noisy }
        });
        self.pose(joints)
    }

    fn step(&mut self) {
        self.time_ns += 1_000_000_000 / self.case.rate_hz;
        if self.time_ns - self.seen_ns >= CAMERA_NS {
            self.seen_ns = self.time_ns;
            self.seen[0] = Ok(self.gaussian.pose(&self.goal, self.case.camera));
        }
        let pose = self.measured();
        match self.recorder.observe(
            Sample { time_ns: self.time_ns, pose, grip: None },
            self.seen,
            0,
        ) {
            None => {}
            Some(Event::Begun { .. }) => self.begun += 1,
            Some(Event::Recorded(recorded)) => self.recorded.push(*recorded),
            Some(Event::Refused(why)) => self.refused.push(why),
        }
    }

    fn rest(&mut self, duration_s: f64) {
        (0..self.steps(duration_s)).for_each(|_| self.step());
    }

    /// With minimum jerk.
    fn go(&mut self, to: [f64; 6], duration_s: f64) {
        let from = self.joints;
        let steps = self.steps(duration_s);
        for i in 1..=steps {
            let t = f64::from(i) / f64::from(steps);
            let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
            self.joints = std::array::from_fn(|j| from[j] + s * (to[j] - from[j]));
            self.step();
        }
    }

    fn steps(&self, duration_s: f64) -> u32 {
        (duration_s * self.case.rate_hz as f64).round() as u32
    }
}

/// How far the mean of some poses is from another one.
fn mean_error(poses: &[Pose], truth: &Pose) -> Extent {
    let offsets = poses.iter().map(|pose| Offset::between(truth, pose));
    let sum = offsets.fold(Offset::default(), Offset::plus);
    sum.scaled(1.0 / poses.len() as f64).extent()
}

#[test]
fn every_demonstration_is_recorded_from_rest_to_rest_whatever_the_noise() {
    for case in Case::all(0..3) {
        let mut bench = Bench::new(case, Bounds::default());
        bench.rest(2.0);
        let motions = [(GOAL, 2.0, 1.6), (START, 4.0, 3.0), (GOAL, 1.0, 2.0)];
        let mut from = START;
        for (i, (to, duration_s, rest_s)) in motions.into_iter().enumerate() {
            bench.go(to, duration_s);
            assert_eq!(bench.recorder.stage(), Stage::Recording, "{case:?}");
            bench.rest(rest_s);
            assert_eq!(bench.recorder.stage(), Stage::Ready, "{case:?}");
            assert_eq!((bench.recorded.len(), bench.begun), (i + 1, i + 1), "{case:?}");
            let [from_pose, to_pose] = [from, to].map(|joints| bench.pose(joints));
            check(case, &bench.recorded[i], [&from_pose, &to_pose], duration_s);
            let frame = Offset::between(&bench.goal, &bench.recorded[i].demonstration.goal_frame);
            // Thirty measurements: four standard errors on each axis, along the diagonal.
            let least = Extent { m: 1e-9, rad: 1e-9 };
            let bound = case.camera.scaled(4.0 * 3.0_f64.sqrt() / 30.0_f64.sqrt()).plus(least);
            assert!(frame.extent().is_within(bound), "{case:?}: {frame:?}");
            from = to;
        }
        assert!(bench.refused.is_empty(), "{case:?}: {:?}", bench.refused);
    }
}

/// It begins and ends with some rest at the right poses, and holds no more rest than it has to.
fn check(case: Case, recorded: &Recorded, [from, to]: [&Pose; 2], duration_s: f64) {
    let poses = &recorded.demonstration.poses;
    // A tenth of a second at 100 Hz: it is rest, or as good as rest.
    for (rest, at) in [(&poses[..10], from), (&poses[poses.len() - 10..], to)] {
        let error = mean_error(rest, at);
        // Steps shift the whole rest, noise its mean; and what counts as settled.
        let joint = case.encoders.error_rad();
        let bound = Extent { m: 5e-4 + joint, rad: 1e-3 + joint };
        assert!(error.is_within(bound), "{case:?}: {error:?} beyond {bound:?}");
    }
    let recorded_s = (poses.len() - 1) as f64 * recorded.demonstration.sampling_time_s;
    assert!((duration_s..duration_s + 1.2).contains(&recorded_s), "{case:?}: {recorded_s}");
    assert!(recorded.notes.is_empty(), "{case:?}: {:?}", recorded.notes);
}

#[test]
fn a_minute_of_noisy_rest_records_nothing_and_begins_nothing() {
    for case in Case::all(10..12) {
        let mut bench = Bench::new(case, Bounds::default());
        bench.rest(2.0);
        assert_eq!(bench.recorder.stage(), Stage::Ready, "{case:?}");
        for _ in 0..120 {
            bench.rest(0.5);
            assert_eq!(bench.recorder.stage(), Stage::Ready, "{case:?}");
        }
        assert_eq!((bench.begun, bench.refused.len()), (0, 0), "{case:?}: {:?}", bench.refused);
    }
}

#[test]
fn noise_beyond_the_bare_bounds_widens_them() {
    let encoders = Encoders { noise_rad: 3e-3, quantised: false };
    let camera = Extent { m: 0.01, rad: 0.02 };
    for seed in 50..54 {
        let mut bench = Bench::new(Case { encoders, camera, rate_hz: 50, seed }, Bounds::default());
        bench.rest(2.0);
        let mut fastest = Extent::default();
        for _ in 0..600 {
            bench.rest(0.1);
            assert_eq!(bench.recorder.stage(), Stage::Ready, "{seed}");
            fastest = fastest.max(bench.recorder.observation().motion.unwrap().speed);
        }
        // So the bound without the noise would have been passed.
        assert!(fastest.m > Bounds::default().rest_speed_m_s, "{seed}: {fastest:?}");
        bench.go(GOAL, 2.0);
        bench.rest(2.0);
        assert_eq!((bench.recorded.len(), bench.begun), (1, 1), "{seed}: {:?}", bench.refused);
    }
}

#[test]
fn a_nudge_is_no_demonstration_and_the_next_motion_is() {
    for case in Case::all(20..22) {
        let mut bench = Bench::new(case, Bounds::default());
        bench.rest(2.0);
        let mut nudged = START;
        nudged[1] += 0.008;
        bench.go(nudged, 0.2);
        bench.rest(2.0);
        assert!(bench.recorded.is_empty(), "{case:?}");
        bench.go(GOAL, 2.0);
        bench.rest(2.0);
        assert_eq!(bench.recorded.len(), 1, "{case:?}: {:?}", bench.refused);
    }
}

#[test]
fn a_frame_that_moves_is_noticed_under_noise_before_and_during_a_motion() {
    for case in Case::all(30..32) {
        let mut bench = Bench::new(case, Bounds::default());
        bench.rest(2.0);
        for _ in 0..bench.steps(1.0) {
            bench.goal.position.x += 0.06 / f64::from(bench.steps(1.0));
            bench.step();
        }
        assert_eq!(bench.recorder.stage(), Stage::FrameMoves(0), "{case:?}");
        bench.rest(1.2);
        assert_eq!(bench.recorder.stage(), Stage::Ready, "{case:?}");
        bench.go(GOAL, 1.0);
        bench.goal.position.y += 0.03;
        bench.go(START, 2.0);
        bench.rest(2.0);
        assert!(bench.recorded.is_empty(), "{case:?}");
        let [why] = &bench.refused[..] else { panic!("{case:?}: {:?}", bench.refused) };
        assert!(why.contains("frame `object` moved by"), "{why}");
    }
}

#[test]
fn wider_bounds_make_of_a_slow_motion_rest_and_narrower_ones_a_demonstration() {
    let case = Case { encoders: ENCODERS[1], camera: CAMERA, rate_hz: 500, seed: 40 };
    let slow = |rest_speed_m_s, rest_speed_rad_s| {
        let mut bench =
            Bench::new(case, Bounds { rest_speed_m_s, rest_speed_rad_s, ..Bounds::default() });
        bench.rest(2.0);
        let mut to = START;
        to[0] += 0.2;
        bench.go(to, 6.0);
        bench.rest(2.0);
        bench.recorded.len()
    };
    assert_eq!([slow(0.2, 0.3), slow(0.005, 0.02)], [0, 1]);
}
