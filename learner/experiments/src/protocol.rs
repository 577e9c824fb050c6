//! The experiments: which policy does what under which conditions.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::baselines::{Dmp, Lqr, Pd};
use super::dataset::SkillSet;
use super::follower::Follower;
use super::metric::{resampled, thesis_tracking, time_aligned_mse_m2};
use super::models::{Kind, Models, space};
use super::progress;
use super::results::{Row, finite};
use super::world::{Ball, Course, GoalMotion, Push, Trace, run};
use tprmp_learner::canonical::kaiser_smoothing::kaiser_smoothing;
use tprmp_learner::canonical::mean_goal;
use tprmp_learner::skill::KaiserSmoothing;

/// Step of all rollouts, as in the thesis [s].
pub const STEP_S: f64 = 0.01;
/// How long a rollout may take [s].
pub const DURATION_S: f64 = 20.0;
/// Angular speed of the goal on its circle, as in the thesis [rad/s].
pub const CIRCLE_SPEED_RAD_S: f64 = std::f64::consts::PI;
/// Radius of that circle where nothing else is said [m].
pub const CIRCLE_RADIUS_M: f64 = 0.2;
/// The goal stops when the body is so near [m]: planar, and in space.
const STOPS_WITHIN_M: [f64; 2] = [0.1, 0.05];
/// The push, as in the thesis: steps 50 to 150.
const PUSH_S: [f64; 2] = [0.5, 1.5];
/// How the thesis smooths demonstrations.
const PUBLISHED_SMOOTHING: KaiserSmoothing = KaiserSmoothing { window_s: 0.3, shape: 14.0 };
/// The thesis' own conditions: the goal stops within this distance of the policy's own [m] …
const PUBLISHED_STOPS_M: f64 = 0.2;
/// … a rollout takes at most so long [s]; twice that with an obstacle, unbounded when it tracks.
const PUBLISHED_DURATION_S: f64 = 10.0;

/// Room between goal or start and an obstacle that makes a case feasible [m].
const FEASIBLE_ROOM_M: f64 = 0.05;
/// Spread of the noisy starts: they lie in a disc of this radius [m].
const START_NOISE_M: f64 = 0.2;

/// How much is done.
#[derive(Clone, Debug)]
pub struct Extent {
    /// Numbers of Gaussians.
    pub components: Vec<usize>,
    /// Forces on planar skills [N].
    pub forces_n: Vec<f64>,
    /// Forces on the pick [N].
    pub pick_forces_n: Vec<f64>,
    /// Radii, of goals and of obstacles [m].
    pub radii_m: Vec<f64>,
    /// Directions of static displaced goals.
    pub directions: usize,
    /// Runs with random speed of the object, noisy starts.
    pub draws: usize,
    /// Random starts a skill.
    pub starts: usize,
    /// Evaluations that are timed.
    pub timed: usize,
}

impl Extent {
    /// All of it.
    #[must_use]
    pub fn full() -> Self {
        let tenths = |n: i32| f64::from(n) / 10.0;
        Self {
            components: vec![5, 7, 9, 11, 13, 15],
            forces_n: (1..=9).map(|n| f64::from(n) * 10.0).collect(),
            pick_forces_n: (0..10).map(|n| 10.0 + 50.0 * f64::from(n)).collect(),
            radii_m: (1..=9).map(tenths).collect(),
            directions: 8,
            draws: 10,
            starts: 1000,
            timed: 2000,
        }
    }

    /// A look at each.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            components: vec![5, 9, 15],
            forces_n: vec![10.0, 50.0, 90.0],
            pick_forces_n: vec![10.0, 210.0, 460.0],
            radii_m: vec![0.1, 0.5, 0.9],
            directions: 4,
            draws: 3,
            starts: 100,
            timed: 500,
        }
    }
}

/// Which policy, in which form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compared {
    /// A learned one with so many Gaussians.
    Learned(Kind, usize),
    /// PD, critically damped at full speed.
    Pd,
    /// PD as the thesis has it.
    PdPublished,
    /// Dynamic movement primitives.
    Dmp,
    /// TP-GMM with a linear quadratic regulator.
    Lqr,
}

impl Compared {
    /// As it is called in the results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Learned(kind, _) => kind.name(),
            Self::Pd => "pd",
            Self::PdPublished => "pd_published",
            Self::Dmp => "dmp",
            Self::Lqr => "tpgmm_lqr",
        }
    }
}

/// One rollout to be made.
#[derive(Clone, Debug)]
pub struct Case {
    /// Which experiment.
    pub experiment: &'static str,
    /// What is varied.
    pub setting: String,
    /// … as a number.
    pub x: f64,
    /// Which policy.
    pub compared: Compared,
    /// Index of the skill.
    pub skill: usize,
    /// Demonstration whose frames are taken.
    pub demonstration: usize,
    /// Counts draws of the same setting.
    pub instance: usize,
    /// What happens.
    pub course: Course,
    /// Whether the demonstration is what should come out.
    pub tracks: bool,
    /// Reached within [m] and, in space, [°].
    pub tolerance: [f64; 2],
}

/// The skills and models of a run.
pub struct Bench<'a> {
    /// Name of the data set.
    pub dataset: String,
    /// Skills.
    pub skills: &'a [SkillSet],
    /// Trained models.
    pub models: &'a Models,
    /// Number of Gaussians of the learned policies where it is not varied, by space: canonical and
    /// thesis.
    pub components: &'a BTreeMap<(&'static str, Kind), usize>,
    /// Factor on the thesis' covariances, which the regulator takes back.
    pub covariance_scale: f64,
    /// How much is done.
    pub extent: Extent,
    /// Seed of what is drawn.
    pub seed: u64,
}

/// A still course with the frames of a demonstration.
#[must_use]
pub fn shown_course(set: &SkillSet, demonstration: usize) -> Course {
    let shown = &set.demonstrations[demonstration];
    let frames: Vec<Pose> = [shown.start, shown.goal_frame]
        .into_iter()
        .chain(shown.other_frames.values().copied())
        .collect();
    Course {
        manifold: set.manifold,
        frames,
        grasp: mean_goal(&set.demonstrations),
        start: set.motion(demonstration)[0],
        start_velocity: DVec3::ZERO,
        own_goal: false,
        step_s: STEP_S,
        duration_s: DURATION_S,
        goal_motion: GoalMotion::default(),
        push: None,
        ball: None,
    }
}

impl Bench<'_> {
    /// Gaussians of a learned policy where their number is not varied.
    #[must_use]
    pub fn count(&self, manifold: Manifold, kind: Kind) -> usize {
        self.components[&(space(manifold), kind)]
    }

    fn learned(&self, skill: usize) -> [Compared; 2] {
        let manifold = self.skills[skill].manifold;
        Kind::ALL.map(|kind| Compared::Learned(kind, self.count(manifold, kind)))
    }

    fn goal_stops_m(manifold: Manifold) -> f64 {
        STOPS_WITHIN_M[usize::from(manifold != Manifold::R2)]
    }

    /// All cases of all experiments that are rollouts.
    #[must_use]
    pub fn cases(&self) -> Vec<Case> {
        let mut cases = Vec::new();
        for (skill, set) in self.skills.iter().enumerate() {
            if set.manifold == Manifold::R2 {
                self.planar(skill, set, &mut cases);
            } else {
                self.spatial(skill, set, &mut cases);
            }
        }
        cases
    }

    fn planar(&self, skill: usize, set: &SkillSet, cases: &mut Vec<Case>) {
        let shown = shown_course(set, 0);
        let mut add = |experiment, setting: String, x, compared, instance, course: &Course| {
            cases.push(Case {
                experiment,
                setting,
                x,
                compared,
                skill,
                demonstration: 0,
                instance,
                course: course.clone(),
                tracks: false,
                tolerance: [if experiment == "obstacle" { 0.01 } else { 0.005 }, f64::INFINITY],
            });
        };
        let circle = |radius_m: f64| Course {
            goal_motion: GoalMotion::circle(radius_m, CIRCLE_SPEED_RAD_S, STOPS_WITHIN_M[0]),
            ..shown.clone()
        };
        for count in &self.extent.components {
            for kind in Kind::ALL {
                let (compared, setting) = (Compared::Learned(kind, *count), format!("K = {count}"));
                let course = circle(CIRCLE_RADIUS_M);
                add("adaptation", setting, *count as f64, compared, 0, &course);
            }
        }
        let own = self.learned(skill);
        let with_baselines = [own[0], own[1], Compared::Dmp, Compared::Lqr];
        for compared in with_baselines {
            for i in 0..self.extent.directions {
                let angle = std::f64::consts::TAU * i as f64 / self.extent.directions as f64;
                for radius_m in [0.3, 0.6, 0.9] {
                    let mut course = shown.clone();
                    course.frames[1].position +=
                        DVec3::new(angle.cos(), angle.sin(), 0.0) * radius_m;
                    let setting = format!("{radius_m} m at {:.0}°", angle.to_degrees());
                    add("static_goal", setting, radius_m, compared, i, &course);
                }
            }
        }
        for compared in own {
            for i in 0..self.extent.draws {
                let mut random = self.random(skill, i);
                let mut course = shown.clone();
                let (angle, radius): (f64, f64) = (
                    random.random_range(0.0..std::f64::consts::TAU),
                    random.random::<f64>().sqrt(),
                );
                course.start.position +=
                    DVec3::new(angle.cos(), angle.sin(), 0.0) * (radius * START_NOISE_M);
                let setting = format!("start within {START_NOISE_M} m");
                add("start_noise", setting, START_NOISE_M, compared, i, &course);
            }
            for degrees in [-90.0, -60.0, -30.0, 30.0, 60.0, 90.0_f64] {
                for (frame, name) in ["start", "end"].into_iter().enumerate() {
                    let mut course = shown.clone();
                    let turn = DQuat::from_rotation_z(degrees.to_radians());
                    course.frames[frame].orientation = turn * course.frames[frame].orientation;
                    let setting = format!("{name} frame turned by {degrees}°");
                    add("turned_frames", setting, degrees, compared, frame, &course);
                }
            }
            let mut turning = circle(CIRCLE_RADIUS_M);
            turning.goal_motion.turn_rad = std::f64::consts::FRAC_PI_2;
            turning.goal_motion.turn_speed_rad_s = 1.0;
            let setting = "end frame circles, and turns by ±90° at 1 rad/s".to_owned();
            add("turning_frames", setting, 90.0, compared, 0, &turning);
            for force_n in &self.extent.forces_n {
                for as_published in [false, true] {
                    let mut course = circle(CIRCLE_RADIUS_M);
                    course.push = Some(Push { force_n: *force_n, during_s: PUSH_S, as_published });
                    let name = if as_published { "disturbance_published" } else { "disturbance" };
                    add(name, format!("{force_n} N"), *force_n, compared, 0, &course);
                }
            }
            for radius_m in &self.extent.radii_m {
                let course = circle(*radius_m);
                add("radius", format!("r = {radius_m} m"), *radius_m, compared, 0, &course);
                let points: Vec<DVec3> =
                    set.demonstrations[0].poses.iter().map(|pose| pose.position).collect();
                let mut course = circle(CIRCLE_RADIUS_M);
                course.ball = Some(Ball { center: middle(&points), radius_m: *radius_m });
                add("obstacle", format!("R = {radius_m} m"), *radius_m, compared, 0, &course);
            }
        }
        self.tracking(skill, set, cases);
    }

    fn spatial(&self, skill: usize, set: &SkillSet, cases: &mut Vec<Case>) {
        self.tracking(skill, set, cases);
        let shown = shown_course(set, 0);
        let mut add = |experiment, setting: String, x, compared, instance, course: &Course| {
            let tolerance = [0.001, 0.1];
            cases.push(Case {
                experiment,
                setting,
                x,
                compared,
                skill,
                demonstration: 0,
                instance,
                course: course.clone(),
                tracks: false,
                tolerance,
            });
        };
        let stops = Self::goal_stops_m(set.manifold);
        // The object's speed is drawn for each run, as in the thesis.
        let circle = |radius_m: f64, draw: usize| {
            let speed = self.random(skill, draw).random_range(0.2..1.0) * CIRCLE_SPEED_RAD_S;
            Course { goal_motion: GoalMotion::circle(radius_m, speed, stops), ..shown.clone() }
        };
        let own = self.learned(skill);
        for draw in 0..self.extent.draws {
            for count in &self.extent.components {
                for kind in Kind::ALL {
                    let compared = Compared::Learned(kind, *count);
                    let setting = format!("K = {count}");
                    let course = circle(CIRCLE_RADIUS_M, draw);
                    add("pick_adaptation", setting, *count as f64, compared, draw, &course);
                }
            }
            for compared in own {
                for force_n in &self.extent.pick_forces_n {
                    let mut course = circle(CIRCLE_RADIUS_M, draw);
                    let push = Push { force_n: *force_n, during_s: PUSH_S, as_published: false };
                    course.push = Some(push);
                    let setting = format!("{force_n} N");
                    add("pick_disturbance", setting, *force_n, compared, draw, &course);
                }
                for radius_m in &self.extent.radii_m {
                    let setting = format!("r = {radius_m} m");
                    let course = circle(*radius_m, draw);
                    add("pick_radius", setting, *radius_m, compared, draw, &course);
                }
                let mut turning = circle(CIRCLE_RADIUS_M, draw);
                turning.goal_motion.turn_rad = 0.6;
                turning.goal_motion.turn_speed_rad_s = 1.0;
                let setting = "object circles, and turns by ±34° at 1 rad/s".to_owned();
                add("pick_turning", setting, 0.6, compared, draw, &turning);
            }
        }
        for compared in own {
            for radius_m in [0.02, 0.04, 0.06, 0.08] {
                let points: Vec<DVec3> =
                    set.demonstrations[0].poses.iter().map(|pose| pose.position).collect();
                let mut course = circle(0.15, 0);
                course.goal_motion.speed_rad_s = 0.3 * std::f64::consts::PI;
                course.ball = Some(Ball { center: middle(&points), radius_m });
                add("pick_obstacle", format!("R = {radius_m} m"), radius_m, compared, 0, &course);
            }
        }
    }

    fn tracking(&self, skill: usize, set: &SkillSet, cases: &mut Vec<Case>) {
        let planar = set.manifold == Manifold::R2;
        let experiment = if planar { "tracking" } else { "pick_tracking" };
        let mut compared: Vec<(Compared, String, f64)> = Vec::new();
        for kind in Kind::ALL {
            let mut counts = self.extent.components.clone();
            let own = self.count(set.manifold, kind);
            if !counts.contains(&own) {
                counts.push(own);
            }
            let each = counts.into_iter();
            compared.extend(each.map(|count| {
                (Compared::Learned(kind, count), format!("K = {count}"), count as f64)
            }));
        }
        let mut baselines = vec![Compared::Pd, Compared::PdPublished];
        if planar {
            baselines.extend([Compared::Dmp, Compared::Lqr]);
        }
        compared.extend(baselines.into_iter().map(|one| (one, "as demonstrated".into(), 0.0)));
        for demonstration in 0..set.demonstrations.len() {
            for (compared, setting, x) in &compared {
                cases.push(Case {
                    experiment,
                    setting: setting.clone(),
                    x: *x,
                    compared: *compared,
                    skill,
                    demonstration,
                    instance: demonstration,
                    course: shown_course(set, demonstration),
                    tracks: true,
                    tolerance: [0.001, 0.1],
                });
            }
        }
    }

    fn random(&self, skill: usize, draw: usize) -> ChaCha8Rng {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(((skill as u64) << 32) | draw as u64);
        random
    }

    /// Makes the rollouts, on all cores. A policy that could not be trained gives a row that says that
    /// the goal was not reached.
    #[must_use]
    pub fn run(&self, cases: &[Case]) -> Vec<Row> {
        let bar = progress("rollouts", cases.len());
        cases
            .par_iter()
            .inspect(|_| bar.inc(1))
            .map(|case| match self.follow(case) {
                Some(trace) => self.row(case, &trace),
                None => self.empty_row(case),
            })
            .collect()
    }

    /// What the thesis' code measures, under its own conditions: tracking starts where and as fast as the
    /// demonstration does once it is smoothed, and a rollout ends when the body is slow. With an obstacle, 1 or 0: whether the body
    /// passes near the policy's own goal, however fast and whatever it touches.
    fn thesis_metric(&self, case: &Case) -> Option<f64> {
        let set = &self.skills[case.skill];
        let dt = set.demonstrations[case.demonstration].sampling_time_s;
        let smoothed = if case.tracks {
            kaiser_smoothing(set.motion(case.demonstration), dt, PUBLISHED_SMOOTHING)
        } else {
            Vec::new()
        };
        let mut case = case.clone();
        let course = &mut case.course;
        course.own_goal = true;
        if course.goal_motion != GoalMotion::default() {
            course.goal_motion.stops_within_m = PUBLISHED_STOPS_M;
        }
        if case.tracks {
            course.start = smoothed[0];
            course.start_velocity = (smoothed[1].position - smoothed[0].position) / dt;
        } else {
            let factor = if course.ball.is_some() { 2.0 } else { 1.0 };
            course.duration_s = factor * PUBLISHED_DURATION_S;
        }
        let trace = self.follow(&case)?;
        if case.course.ball.is_some() {
            return Some(if trace.touched { 1.0 } else { 0.0 });
        }
        if !case.tracks {
            return finite(trace.own_goal_error_m);
        }
        let points: Vec<DVec3> = smoothed.iter().map(|pose| pose.position).collect();
        let points = resampled(&points, dt, STEP_S);
        let path: Vec<DVec3> = trace.path.iter().map(|pose| pose.position).collect();
        finite(thesis_tracking(&path[..trace.stopped_at], &points))
    }

    /// One rollout; `None` when its policy could not be trained.
    #[must_use]
    pub fn follow(&self, case: &Case) -> Option<Trace> {
        let set = &self.skills[case.skill];
        let shown = &set.demonstrations[case.demonstration];
        let moving = set.motion(case.demonstration);
        let positions = || moving.iter().map(|pose| pose.position).collect::<Vec<_>>();
        let dt = shown.sampling_time_s;
        let go = |follower: &mut dyn Follower| run(follower, &case.course);
        Some(match case.compared {
            Compared::Learned(kind, count) => {
                go(&mut self.models.get(kind, count, &set.name)?.evaluated.follower())
            }
            Compared::Pd => go(&mut Pd::new(positions(), dt, false)),
            Compared::PdPublished => go(&mut Pd::new(positions(), dt, true)),
            Compared::Dmp => {
                let dmp = Dmp::learn(&set.demonstrations);
                let goal_frame = case.course.frames[1];
                let offset = goal_frame.compose(&case.course.grasp).position - goal_frame.position;
                go(&mut dmp.follower(case.course.start.position, offset))
            }
            Compared::Lqr => go(&mut self.regulator(set)?.follower()),
        })
    }

    /// The regulator of a planar skill.
    #[must_use]
    pub fn regulator(&self, set: &SkillSet) -> Option<Lqr> {
        let count = self.count(set.manifold, Kind::Thesis);
        let model = &self.models.get(Kind::Thesis, count, &set.name)?.model;
        let duration = |d: &tprmp_learner::demonstration::Demonstration| {
            (d.poses.len() - 1) as f64 * d.sampling_time_s
        };
        let duration_s =
            set.demonstrations.iter().map(duration).sum::<f64>() / set.demonstrations.len() as f64;
        Some(Lqr::new(model, self.covariance_scale, duration_s))
    }

    fn empty_row(&self, case: &Case) -> Row {
        let components = match case.compared {
            Compared::Learned(_, count) => count,
            _ => 0,
        };
        Row {
            experiment: case.experiment.into(),
            dataset: self.dataset.clone(),
            policy: case.compared.name().into(),
            setting: case.setting.clone(),
            skill: self.skills[case.skill].name.clone(),
            x: case.x,
            components,
            instance: case.instance,
            seed: self.seed,
            feasible: case
                .course
                .ball
                .is_none_or(|ball| ball.leaves_room(&case.course, FEASIBLE_ROOM_M)),
            ..Row::default()
        }
    }

    fn row(&self, case: &Case, trace: &Trace) -> Row {
        let set = &self.skills[case.skill];
        let turns = set.manifold.has_orientation();
        let degrees = trace.goal_error_rad.to_degrees();
        let mut row = Row {
            goal_error_m: finite(trace.goal_error_m),
            thesis_metric: self.thesis_metric(case),
            reached: trace.goal_error_m <= case.tolerance[0] && degrees <= case.tolerance[1],
            collided: trace.clearance_min_m.is_some_and(|clearance| clearance <= 0.0),
            clearance_min_m: trace.clearance_min_m.and_then(finite),
            acceleration_max_m_s2: finite(trace.acceleration_max_m_s2),
            goal_error_deg: if turns { finite(degrees) } else { None },
            energy_rise_max: finite(trace.energy_rise_max),
            ..self.empty_row(case)
        };
        if case.tracks {
            let shown = &set.demonstrations[case.demonstration];
            let moving = set.motion(case.demonstration);
            let points: Vec<DVec3> = moving.iter().map(|pose| pose.position).collect();
            let points = resampled(&points, shown.sampling_time_s, STEP_S);
            let path: Vec<DVec3> = trace.path.iter().map(|pose| pose.position).collect();
            let mse = time_aligned_mse_m2(&path, &points);
            row.time_aligned_mse_m2 = finite(mse);
            let square = |(i, pose): (usize, &Pose)| {
                let at = (i as f64 * shown.sampling_time_s / STEP_S).round() as usize;
                trace.path[at.min(trace.path.len() - 1)].rotation_from(pose).length_squared()
            };
            let sum: f64 = moving.iter().enumerate().map(square).sum();
            let rms_deg = if turns { (sum / moving.len() as f64).sqrt().to_degrees() } else { 0.0 };
            row.tracking_rms = mse.is_finite().then_some([mse.sqrt(), rms_deg]);
        }
        row
    }
}

/// The point of a path at half its length.
fn middle(points: &[DVec3]) -> DVec3 {
    let length = |points: &[DVec3]| points.windows(2).map(|p| (p[1] - p[0]).length()).sum::<f64>();
    let half = 0.5 * length(points);
    let mut way = 0.0;
    for pair in points.windows(2) {
        way += (pair[1] - pair[0]).length();
        if way >= half {
            return pair[1];
        }
    }
    points[points.len() - 1]
}
