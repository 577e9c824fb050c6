//! Energy, random starts, accelerations, and the time of a control iteration.

use std::time::Instant;
use tprmp_drawing::quantile;

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tprmp_learner::canonical::savitzky_golay::smooth;
use tprmp_learner::certify::policy::{Body, LearnedPolicy, MotionPolicy};
use tprmp_learner::demonstration::Demonstration;
use tprmp_spatial::{MovingPose, Twist};

use crate::baselines::dmp::Dmp;
use crate::bench::Bench;
use crate::conditions::{CIRCLE_RADIUS_M, CIRCLE_SPEED_RAD_S, Conditions, DURATION_S, GoalMotion};
use crate::dataset::SkillSet;
use crate::experiment::{Experiment, PolicyKind, Setting, Space};
use crate::path::positions;
use crate::progress::progress;
use crate::results::{Row, finite};
use crate::world::{resolve, run};

/// Random starts lie in the box around the demonstrations, larger by this fraction of its diagonal on
/// each side.
const MARGIN_FRACTION: f64 = 0.18;
/// They are rotated by at most this against the demonstrated start [rad].
const ROTATION_RAD: f64 = 0.5;
/// Window in which demonstrations are smoothed for their accelerations [s].
const WINDOW_S: f64 = 0.3;
/// The slow and the fast controller [Hz].
const RATES_HZ: [f64; 2] = [100.0, 1000.0];
/// From a demonstrated start the goal is reached within this distance, at a scale of one [m] …
const REACHED_M: f64 = 0.001;
/// … from a random one within this distance and angle [rad].
const REACHED_FROM_ANYWHERE: [f64; 2] = [0.005, 0.01];
/// Evaluations that are not timed: what is cold at first does not count.
const WARM_UP: usize = 20;

/// The worst of several rollouts.
#[derive(Default)]
struct Worst {
    energy_rise_max: f64,
    acceleration_max_m_s2: f64,
    goal_error_m: f64,
    /// How many came near their goal.
    reached: u32,
}

impl Worst {
    fn of(policy: &LearnedPolicy, conditions: impl Iterator<Item = Conditions>) -> Self {
        let mut worst = Self::default();
        for conditions in conditions {
            let outcome = run(&mut policy.instance(), &conditions);
            worst.energy_rise_max = worst.energy_rise_max.max(outcome.energy_rise_max);
            worst.acceleration_max_m_s2 =
                worst.acceleration_max_m_s2.max(outcome.acceleration_max_m_s2);
            worst.goal_error_m = worst.goal_error_m.max(outcome.goal_error_m);
            let [metres, radians] = REACHED_FROM_ANYWHERE;
            let near = outcome.goal_error_m <= metres * conditions.scale
                && outcome.goal_error_rad <= radians;
            worst.reached += u32::from(near);
        }
        worst
    }
}

impl Bench<'_> {
    /// Energy at two rates of control, and random starts, of all skills, on all cores.
    pub(crate) fn stability(&self) -> Vec<Row> {
        let mut work = Vec::new();
        for set in self.skills {
            for policy in PolicyKind::LEARNED {
                work.push((set, policy, Setting::Starts(self.extent.starts)));
                work.extend(RATES_HZ.map(|rate| (set, policy, Setting::Rate(rate))));
            }
        }
        let bar = progress("stability", work.len());
        work.par_iter()
            .inspect(|_| bar.inc(1))
            .filter_map(|(set, policy, setting)| self.stability_of(set, *policy, *setting))
            .collect()
    }

    /// `None` when the policy could not be trained.
    fn stability_of(&self, set: &SkillSet, policy: PolicyKind, setting: Setting) -> Option<Row> {
        let learned = &self.models.get(policy, self.count(set, policy), &set.name)?.policy;
        let (row, worst) = if let Setting::Rate(rate_hz) = setting {
            let step_s = 1.0 / rate_hz;
            let conditions = (0..set.demonstrations.len())
                .map(|i| Conditions { step_s, ..Conditions::demonstrated(set, i) });
            let worst = Worst::of(learned, conditions);
            let row = self.own_row(set, policy, Experiment::Energy, setting);
            (Row { reached: worst.goal_error_m <= REACHED_M * set.scale(), ..row }, worst)
        } else {
            let starts = self.extent.starts as u32;
            let worst = Worst::of(learned, self.random_starts(set).into_iter());
            let row = self.own_row(set, policy, Experiment::RandomStarts, setting);
            let starts_reached = Some([worst.reached, starts]);
            (Row { reached: worst.reached == starts, starts_reached, ..row }, worst)
        };
        Some(Row {
            energy_rise_max: finite(worst.energy_rise_max),
            acceleration_max_m_s2: finite(worst.acceleration_max_m_s2),
            goal_error_m: finite(worst.goal_error_m),
            ..row
        })
    }

    /// A row of a learned policy with the Gaussians of its skill file.
    fn own_row(
        &self,
        set: &SkillSet,
        policy: PolicyKind,
        experiment: Experiment,
        setting: Setting,
    ) -> Row {
        Row {
            components: self.count(set, policy),
            demonstrated_acceleration_max_m_s2: Some(demonstrated_acceleration(set)),
            ..self.new_row(set, policy, experiment, setting)
        }
    }

    /// Random starts around the demonstrations.
    fn random_starts(&self, set: &SkillSet) -> Vec<Conditions> {
        let [low, high] = set.bounds();
        let mut margin = DVec3::splat(MARGIN_FRACTION * (high - low).length());
        if set.space() == Space::Planar {
            margin.z = 0.0;
        }
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(1 << 40);
        let conditions = (0..self.extent.starts).map(|i| {
            let fraction = DVec3::from_array(std::array::from_fn(|_| random.random::<f64>()));
            let mut conditions = Conditions::demonstrated(set, i % set.demonstrations.len());
            let start = &mut conditions.start.pose;
            start.position = low - margin + (high - low + 2.0 * margin) * fraction;
            if set.manifold.has_orientation() {
                let axis =
                    DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
                let rotation = DQuat::from_scaled_axis(axis.normalize_or_zero() * ROTATION_RAD);
                start.orientation = rotation * start.orientation;
            }
            conditions
        });
        conditions.collect()
    }

    /// Time of one control iteration with a moving goal, on a single core: policy, resolution and all.
    /// One skill of each space serves for all: the cost does not depend on the shape.
    pub(crate) fn iteration_times(&self) -> Vec<(Row, Vec<f64>)> {
        let first = |space| self.skills.iter().find(move |set| set.space() == space);
        Space::ALL.into_iter().filter_map(first).flat_map(|set| self.times_of(set)).collect()
    }

    fn times_of(&self, set: &SkillSet) -> Vec<(Row, Vec<f64>)> {
        let mut rows = Vec::new();
        let mut time = |row: Row, policy: &mut dyn MotionPolicy| {
            let times = time_one(policy, &Conditions::demonstrated(set, 0), self.extent.timed);
            let at = |fraction| quantile(&times, fraction).unwrap_or(f64::NAN);
            rows.push((Row { iteration_us: Some([at(0.5), at(0.99), at(1.0)]), ..row }, times));
        };
        let experiment = match set.space() {
            Space::Planar => Experiment::IterationTime,
            Space::Pick => Experiment::PickIterationTime,
        };
        for policy in PolicyKind::LEARNED {
            for count in &self.extent.components {
                let Some(trained) = self.models.get(policy, *count, &set.name) else { continue };
                let row = self.own_row(set, policy, experiment, Setting::Components(*count));
                time(Row { components: *count, ..row }, &mut trained.policy.instance());
            }
        }
        if set.space() == Space::Planar {
            let row = |policy| Row {
                policy,
                ..self.own_row(set, PolicyKind::Thesis, experiment, Setting::AsDemonstrated)
            };
            let dmp = Dmp::learn(&set.demonstrations);
            let start = set.demonstrations[0].poses[0].position;
            time(row(PolicyKind::Dmp), &mut dmp.instance(start, DVec3::ZERO));
            if let Some(lqr) = self.regulator(set) {
                time(row(PolicyKind::TpgmmLqr), &mut lqr.instance());
            }
        }
        rows
    }
}

/// Times of evaluations on the straight line from the start to the goal, which moves on its circle [µs].
fn time_one(policy: &mut dyn MotionPolicy, conditions: &Conditions, count: usize) -> Vec<f64> {
    let motion = GoalMotion::circle(CIRCLE_RADIUS_M * conditions.scale, CIRCLE_SPEED_RAD_S, 0.0);
    let mut frames: Vec<MovingPose> =
        conditions.frames.iter().copied().map(MovingPose::at_rest).collect();
    let start = conditions.start.pose;
    let goal = conditions.frames[1].compose(&conditions.grasp);
    let mut once = |i: usize| {
        let fraction = i as f64 / count as f64;
        let time_s = DURATION_S * i as f64 / count as f64;
        frames[1] = motion.at(&conditions.frames[1], time_s);
        let pose = start.interpolate(&goal, fraction);
        let linear = (goal.position - start.position) * 0.1;
        let body = Body { time_s, pose, velocity: Twist { linear, ..Twist::ZERO } };
        let begun = Instant::now();
        let desired = policy.evaluate(&frames, &body);
        let solved = resolve(&desired.natural, conditions.manifold);
        let time = begun.elapsed().as_secs_f64() * 1e6;
        std::hint::black_box(solved);
        time
    };
    (0..WARM_UP).for_each(|i| {
        once(i);
    });
    (0..count).map(once).collect()
}

/// Largest smoothed acceleration of the demonstrations [m/s²].
pub(crate) fn demonstrated_acceleration(set: &SkillSet) -> f64 {
    let of = |d: &Demonstration| {
        let path = smooth(&positions(&d.poses), d.sampling_time_s, WINDOW_S, 3);
        path.accelerations.iter().map(|a| a.length()).fold(0.0, f64::max)
    };
    set.demonstrations.iter().map(of).fold(0.0, f64::max)
}
