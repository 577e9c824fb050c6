//! Which policy does what under which conditions.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bench::Bench;
use crate::body::ControllerLeaves;
use crate::case::Case;
use crate::conditions::{Ball, CIRCLE_RADIUS_M, CIRCLE_SPEED_RAD_S, Conditions, GoalMotion, Push};
use crate::dataset::SkillSet;
use crate::experiment::{
    Compared, Experiment, OBJECT_TURNING_RAD, PolicyKind, START_NOISE_M, Setting, Space,
    TURNING_DEG,
};
use crate::path::{middle, positions};

/// The goal stops when the body is so near [m]: planar, and in space. All lengths and forces here are those at a scale
/// of one.
const STOPS_WITHIN_M: [f64; 2] = [0.1, 0.05];
/// The push, as in the thesis: steps 50 to 150.
const PUSH_S: [f64; 2] = [0.5, 1.5];
/// Angular frequency of what turns [rad/s].
const TURNING_SPEED_RAD_S: f64 = 1.0;
/// Distances of static displaced goals [m].
const DISPLACED_M: [f64; 3] = [0.3, 0.6, 0.9];
/// Rotations of frames at rest [°].
const TURNED_DEG: [f64; 6] = [-90.0, -60.0, -30.0, 30.0, 60.0, 90.0];
/// The pick's obstacles and the object's circle beside them [m], and its speed as a fraction of π rad/s.
const PICK_BALLS_M: [f64; 4] = [0.02, 0.04, 0.06, 0.08];
const PICK_BALL_CIRCLE_M: f64 = 0.15;
const PICK_BALL_SPEED: f64 = 0.3;

/// Collects the cases of one skill.
struct Collector<'a> {
    bench: &'a Bench<'a>,
    leaves: &'a ControllerLeaves,
    skill: usize,
    set: &'a SkillSet,
    /// The frames of the first demonstration, at rest.
    still: Conditions,
    cases: Vec<Case>,
}

impl Bench<'_> {
    /// All cases of all experiments that are rollouts, in the order of the skills.
    pub(crate) fn cases(&self, leaves: &ControllerLeaves) -> Vec<Case> {
        let of = |(skill, set)| {
            let (still, cases) = (Conditions::demonstrated(set, 0), Vec::new());
            let mut collector = Collector { bench: self, leaves, skill, set, still, cases };
            match set.space() {
                Space::Planar => collector.planar(),
                Space::Pick => collector.pick(),
            }
            collector.cases
        };
        self.skills.iter().enumerate().flat_map(of).collect()
    }
}

/// A stream of random numbers for a draw of a skill.
fn random(seed: u64, skill: usize, draw: usize) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(((skill as u64) << 32) | draw as u64);
    random
}

impl Collector<'_> {
    fn add(
        &mut self,
        experiment: Experiment,
        setting: Setting,
        compared: Compared,
        instance: usize,
        conditions: Conditions,
    ) {
        let skill = self.skill;
        self.cases.push(Case { experiment, setting, compared, skill, instance, conditions });
    }

    /// The learned policies with the Gaussians of their skill files.
    fn learned(&self) -> [Compared; 2] {
        PolicyKind::LEARNED
            .map(|policy| Compared { policy, components: self.bench.count(self.set, policy) })
    }

    /// The goal on a circle at rest in the plane of the frames.
    fn circle(&self, radius_m: f64, speed_rad_s: f64) -> Conditions {
        let scale = self.set.scale();
        let stops_within_m = STOPS_WITHIN_M[self.set.space() as usize] * scale;
        let goal_motion = GoalMotion::circle(radius_m * scale, speed_rad_s, stops_within_m);
        Conditions { goal_motion, ..self.still.clone() }
    }

    fn planar_circle(&self, radius_m: f64) -> Conditions {
        self.circle(radius_m, CIRCLE_SPEED_RAD_S)
    }

    /// The object's speed is drawn for each run, as in the thesis.
    fn pick_circle(&self, radius_m: f64, draw: usize) -> Conditions {
        let fraction = random(self.bench.seed, self.skill, draw).random_range(0.2..1.0);
        self.circle(radius_m, fraction * CIRCLE_SPEED_RAD_S)
    }

    fn with_push(conditions: Conditions, force_n: f64, as_published: bool) -> Conditions {
        let force_n = force_n * conditions.scale;
        let push = Some(Push { force_n, during_s: PUSH_S, as_published });
        Conditions { push, ..conditions }
    }

    /// A ball half-way along the first demonstration.
    fn with_ball(&self, conditions: Conditions, radius_m: f64) -> Conditions {
        let center = middle(&positions(&self.set.demonstrations[0].poses));
        let scale = self.set.scale();
        let avoidance = self.leaves.scaled(scale).avoidance(self.set.space());
        let ball = Some(Ball { center, radius_m: radius_m * scale, avoidance });
        Conditions { ball, ..conditions }
    }

    fn turning(conditions: Conditions, rotation_rad: f64) -> Conditions {
        let rotation_speed_rad_s = TURNING_SPEED_RAD_S;
        let goal_motion =
            GoalMotion { rotation_rad, rotation_speed_rad_s, ..conditions.goal_motion };
        Conditions { goal_motion, ..conditions }
    }

    fn planar(&mut self) {
        let extent = &self.bench.extent;
        self.adaptation(Experiment::Adaptation, 0, &self.planar_circle(CIRCLE_RADIUS_M));
        let (own, circle) = (self.learned(), self.planar_circle(CIRCLE_RADIUS_M));
        for compared in [own[0], own[1], PolicyKind::Dmp.into(), PolicyKind::TpgmmLqr.into()] {
            self.static_goals(compared);
        }
        for compared in own {
            self.noisy_starts(compared);
            self.turned_frames(compared);
            let turning = Self::turning(circle.clone(), TURNING_DEG.to_radians());
            self.add(Experiment::TurningFrames, Setting::TurningEnd, compared, 0, turning);
            for force_n in &extent.forces_n {
                for (as_published, experiment) in
                    [(false, Experiment::Disturbance), (true, Experiment::DisturbancePublished)]
                {
                    let conditions = Self::with_push(circle.clone(), *force_n, as_published);
                    self.add(experiment, Setting::Force(*force_n), compared, 0, conditions);
                }
            }
            for radius_m in &extent.radii_m {
                let wide = self.planar_circle(*radius_m);
                self.add(Experiment::Radius, Setting::Circle(*radius_m), compared, 0, wide);
                let obstacle = self.with_ball(circle.clone(), *radius_m);
                let ball = Setting::Ball(*radius_m);
                self.add(Experiment::Obstacle, ball, compared, 0, obstacle);
                let still = self.with_ball(self.still.clone(), *radius_m);
                self.add(Experiment::ObstacleStill, ball, compared, 0, still);
            }
        }
        self.pushes_at_rest();
        self.tracking(Experiment::Tracking);
    }

    /// Pushes across the motion with the frames at rest.
    fn pushes_at_rest(&mut self) {
        let baselines = [PolicyKind::Pd, PolicyKind::Dmp, PolicyKind::TpgmmLqr].map(Into::into);
        for compared in self.learned().into_iter().chain(baselines) {
            for force_n in &self.bench.extent.forces_n {
                let conditions = Self::with_push(self.still.clone(), *force_n, false);
                let setting = Setting::Force(*force_n);
                self.add(Experiment::DisturbanceStill, setting, compared, 0, conditions);
            }
        }
    }

    /// Over the number of Gaussians.
    fn adaptation(&mut self, experiment: Experiment, instance: usize, circle: &Conditions) {
        for components in &self.bench.extent.components {
            for policy in PolicyKind::LEARNED {
                let compared = Compared { policy, components: *components };
                let setting = Setting::Components(*components);
                self.add(experiment, setting, compared, instance, circle.clone());
            }
        }
    }

    fn static_goals(&mut self, compared: Compared) {
        for i in 0..self.bench.extent.directions {
            let angle = TAU * i as f64 / self.bench.extent.directions as f64;
            for radius_m in DISPLACED_M {
                let mut conditions = self.still.clone();
                conditions.frames[1].position +=
                    DVec3::new(angle.cos(), angle.sin(), 0.0) * (radius_m * conditions.scale);
                let setting = Setting::Displaced(radius_m, angle);
                self.add(Experiment::StaticGoal, setting, compared, i, conditions);
            }
        }
    }

    fn noisy_starts(&mut self, compared: Compared) {
        for i in 0..self.bench.extent.draws {
            let mut random = random(self.bench.seed, self.skill, i);
            let mut conditions = self.still.clone();
            let (angle, radius): (f64, f64) =
                (random.random_range(0.0..TAU), random.random::<f64>().sqrt());
            conditions.start.pose.position += DVec3::new(angle.cos(), angle.sin(), 0.0)
                * (radius * START_NOISE_M * conditions.scale);
            self.add(Experiment::StartNoise, Setting::NoisyStart, compared, i, conditions);
        }
    }

    fn turned_frames(&mut self, compared: Compared) {
        for degrees in TURNED_DEG {
            for (frame, setting) in
                [Setting::TurnedStart(degrees), Setting::TurnedEnd(degrees)].into_iter().enumerate()
            {
                let mut conditions = self.still.clone();
                let orientation = &mut conditions.frames[frame].orientation;
                *orientation = DQuat::from_rotation_z(degrees.to_radians()) * *orientation;
                self.add(Experiment::TurnedFrames, setting, compared, frame, conditions);
            }
        }
    }

    fn pick(&mut self) {
        self.tracking(Experiment::PickTracking);
        let (extent, own) = (&self.bench.extent, self.learned());
        for draw in 0..extent.draws {
            let circle = self.pick_circle(CIRCLE_RADIUS_M, draw);
            self.adaptation(Experiment::PickAdaptation, draw, &circle);
            for compared in own {
                for force_n in &extent.pick_forces_n {
                    let conditions = Self::with_push(circle.clone(), *force_n, false);
                    let setting = Setting::Force(*force_n);
                    self.add(Experiment::PickDisturbance, setting, compared, draw, conditions);
                }
                for radius_m in &extent.radii_m {
                    let conditions = self.pick_circle(*radius_m, draw);
                    let setting = Setting::Circle(*radius_m);
                    self.add(Experiment::PickRadius, setting, compared, draw, conditions);
                }
                let turning = Self::turning(circle.clone(), OBJECT_TURNING_RAD);
                self.add(Experiment::PickTurning, Setting::TurningObject, compared, draw, turning);
            }
        }
        for compared in own {
            for radius_m in PICK_BALLS_M {
                let circle = self.circle(PICK_BALL_CIRCLE_M, PICK_BALL_SPEED * PI);
                let conditions = self.with_ball(circle, radius_m);
                let setting = Setting::Ball(radius_m);
                self.add(Experiment::PickObstacle, setting, compared, 0, conditions);
            }
        }
    }

    fn tracking(&mut self, experiment: Experiment) {
        let mut compared = Vec::new();
        for policy in PolicyKind::LEARNED {
            let counts =
                self.bench.files.counts(&self.bench.extent.components, self.set.space(), policy);
            compared.extend(counts.into_iter().map(|components| {
                (Compared { policy, components }, Setting::Components(components))
            }));
        }
        let mut baselines = vec![PolicyKind::Pd, PolicyKind::PdPublished];
        if self.set.space() == Space::Planar {
            baselines.extend([PolicyKind::Dmp, PolicyKind::TpgmmLqr]);
        }
        let baselines = baselines.into_iter();
        compared.extend(baselines.map(|policy| (policy.into(), Setting::AsDemonstrated)));
        for demonstration in 0..self.set.demonstrations.len() {
            for (compared, setting) in &compared {
                let conditions = Conditions::demonstrated(self.set, demonstration);
                self.add(experiment, *setting, *compared, demonstration, conditions);
            }
        }
    }
}
