//! Energy, random starts, accelerations, and the time of a control iteration.

use std::time::Instant;

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::{MovingPose, Twist};

use super::dataset::SkillSet;
use super::follower::{Follower, Moment};
use super::metric::quantile;
use super::models::Kind;
use super::progress;
use super::protocol::{Bench, CIRCLE_RADIUS_M, CIRCLE_SPEED_RAD_S, DURATION_S, shown_course};
use super::results::{Row, finite};
use super::world::{Course, GoalMotion, resolve, run};
use tprmp_learner::canonical::savitzky_golay::smooth;

/// Random starts lie in the box around the demonstrations, larger by this fraction of its diagonal on
/// each side.
const MARGIN_FRACTION: f64 = 0.18;
/// They start turned by at most this against the demonstrated start [rad].
const TURN_RAD: f64 = 0.5;
/// Window in which demonstrations are smoothed for their accelerations [s].
const WINDOW_S: f64 = 0.3;
/// The slow and the fast controller [s].
const STEPS_S: [f64; 2] = [0.01, 0.001];

impl Bench<'_> {
    /// Energy and random starts of all skills, on all cores.
    #[must_use]
    pub fn stability(&self) -> Vec<Row> {
        let mut work = Vec::new();
        for skill in self.skills {
            for kind in Kind::ALL {
                work.push((skill, kind, None));
                work.extend(STEPS_S.map(|step_s| (skill, kind, Some(step_s))));
            }
        }
        let bar = progress("stability", work.len());
        work.par_iter()
            .inspect(|_| bar.inc(1))
            .filter_map(|(set, kind, step_s)| match step_s {
                Some(step_s) => self.energy(set, *kind, *step_s),
                None => self.random_starts(set, *kind),
            })
            .collect()
    }

    fn base_row(&self, set: &SkillSet, kind: Kind, experiment: &str, setting: String) -> Row {
        Row {
            experiment: experiment.into(),
            dataset: self.dataset.clone(),
            policy: kind.name().into(),
            setting,
            skill: set.name.clone(),
            components: self.count(set.manifold, kind),
            seed: self.seed,
            feasible: true,
            demonstrated_acceleration_max_m_s2: Some(demonstrated_acceleration(set)),
            ..Row::default()
        }
    }

    /// Rise of V from the demonstrated starts at a rate of control.
    fn energy(&self, set: &SkillSet, kind: Kind, step_s: f64) -> Option<Row> {
        let components = self.count(set.manifold, kind);
        let model = &self.models.get(kind, components, &set.name)?.evaluated;
        let setting = format!("{:.0} Hz", 1.0 / step_s);
        let mut row = self.base_row(set, kind, "energy", setting);
        let (mut rise, mut acceleration, mut error): (f64, f64, f64) = (0.0, 0.0, 0.0);
        for demonstration in 0..set.demonstrations.len() {
            let course = Course { step_s, ..shown_course(set, demonstration) };
            let trace = run(&mut model.follower(), &course);
            rise = rise.max(trace.energy_rise_max);
            acceleration = acceleration.max(trace.acceleration_max_m_s2);
            error = error.max(trace.goal_error_m);
        }
        row.x = 1.0 / step_s;
        row.energy_rise_max = finite(rise);
        row.acceleration_max_m_s2 = finite(acceleration);
        row.goal_error_m = finite(error);
        row.reached = error <= 0.001;
        Some(row)
    }

    /// Rollouts from random starts around the demonstrations.
    fn random_starts(&self, set: &SkillSet, kind: Kind) -> Option<Row> {
        let components = self.count(set.manifold, kind);
        let model = &self.models.get(kind, components, &set.name)?.evaluated;
        let points =
            || set.demonstrations.iter().flat_map(|d| d.poses.iter().map(|pose| pose.position));
        let low = points().fold(DVec3::INFINITY, DVec3::min);
        let high = points().fold(DVec3::NEG_INFINITY, DVec3::max);
        let mut margin = DVec3::splat(MARGIN_FRACTION * (high - low).length());
        if set.manifold == Manifold::R2 {
            margin.z = 0.0;
        }
        let count = self.extent.starts;
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(1 << 40);
        let mut row = self.base_row(set, kind, "random_starts", format!("{count} random starts"));
        let (mut reached, mut rise, mut worst, mut fastest) = (0, 0.0_f64, 0.0_f64, 0.0_f64);
        for i in 0..count {
            let fraction = DVec3::from_array(std::array::from_fn(|_| random.random::<f64>()));
            let position = low - margin + (high - low + 2.0 * margin) * fraction;
            let mut course = shown_course(set, i % set.demonstrations.len());
            course.start.position = position;
            if set.manifold.has_orientation() {
                let axis =
                    DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
                let turn = DQuat::from_scaled_axis(axis.normalize_or_zero() * TURN_RAD);
                course.start.orientation = turn * course.start.orientation;
            }
            let trace = run(&mut model.follower(), &course);
            let near = trace.goal_error_m <= 0.005 && trace.goal_error_rad <= 0.01;
            reached += u32::from(near);
            rise = rise.max(trace.energy_rise_max);
            worst = worst.max(trace.goal_error_m);
            fastest = fastest.max(trace.acceleration_max_m_s2);
        }
        row.x = count as f64;
        row.starts_reached = Some([reached, count as u32]);
        row.energy_rise_max = finite(rise);
        row.goal_error_m = finite(worst);
        row.acceleration_max_m_s2 = finite(fastest);
        row.reached = reached == count as u32;
        Some(row)
    }

    /// Time of one control iteration with a moving goal, on a single core: policy, resolution and all.
    #[must_use]
    pub fn iteration_times(&self) -> Vec<(Row, Vec<f64>)> {
        let mut rows = Vec::new();
        // One planar skill serves for all: the cost does not depend on the shape.
        let planar = self.skills.iter().find(|set| set.manifold == Manifold::R2);
        let spatial = self.skills.iter().find(|set| set.manifold != Manifold::R2);
        for set in planar.into_iter().chain(spatial) {
            let mut time = |row: Row, follower: &mut dyn Follower| {
                let times = time_one(follower, &shown_course(set, 0), self.extent.timed);
                let at = |fraction| quantile(&times, fraction).unwrap_or(f64::NAN);
                rows.push((Row { iteration_us: Some([at(0.5), at(0.99), at(1.0)]), ..row }, times));
            };
            let name =
                if set.manifold == Manifold::R2 { "iteration_time" } else { "pick_iteration_time" };
            for kind in Kind::ALL {
                for count in &self.extent.components {
                    let Some(model) = self.models.get(kind, *count, &set.name) else { continue };
                    let mut row = self.base_row(set, kind, name, format!("K = {count}"));
                    row.components = *count;
                    row.x = *count as f64;
                    time(row, &mut model.evaluated.follower());
                }
            }
            if set.manifold != Manifold::R2 {
                continue;
            }
            let row = |policy: &str| {
                let row = self.base_row(set, Kind::Thesis, name, "as demonstrated".into());
                Row { policy: policy.into(), ..row }
            };
            let dmp = super::baselines::Dmp::learn(&set.demonstrations);
            time(
                row("dmp"),
                &mut dmp.follower(set.demonstrations[0].poses[0].position, DVec3::ZERO),
            );
            if let Some(lqr) = self.regulator(set) {
                time(row("tpgmm_lqr"), &mut lqr.follower());
            }
        }
        rows
    }
}

/// Times of evaluations along a demonstration's straight way, the goal on its circle [µs].
fn time_one(follower: &mut dyn Follower, course: &Course, count: usize) -> Vec<f64> {
    let motion = GoalMotion::circle(CIRCLE_RADIUS_M, CIRCLE_SPEED_RAD_S, 0.0);
    let moving = Course { goal_motion: motion, ..course.clone() };
    let mut frames: Vec<MovingPose> =
        course.frames.iter().map(|pose| MovingPose::at_rest(*pose)).collect();
    let goal = course.frames[1].compose(&course.grasp);
    let mut once = |i: usize| {
        let time_s = DURATION_S * i as f64 / count as f64;
        frames[1] = moving.goal_motion.at(&course.frames[1], time_s);
        let fraction = i as f64 / count as f64;
        let pose = course.start.interpolate(&goal, fraction);
        let linear = (goal.position - course.start.position) * 0.1;
        let velocity = Twist { linear, ..Twist::ZERO };
        let moment = Moment { time_s, frames: &frames, pose, velocity };
        let begun = Instant::now();
        let wish = follower.evaluate(&moment);
        let solved = resolve(&wish.natural, course.manifold);
        let time = begun.elapsed().as_secs_f64() * 1e6;
        std::hint::black_box(solved);
        time
    };
    // What is cold at first is not counted.
    (0..20).for_each(|i| {
        once(i);
    });
    (0..count).map(once).collect()
}

/// Largest smoothed acceleration of the demonstrations [m/s²].
#[must_use]
pub fn demonstrated_acceleration(set: &SkillSet) -> f64 {
    let of = |d: &tprmp_learner::demonstration::Demonstration| {
        let points: Vec<DVec3> = d.poses.iter().map(|pose| pose.position).collect();
        let path = smooth(&points, d.sampling_time_s, WINDOW_S, 3);
        path.accelerations.iter().map(|a| a.length()).fold(0.0, f64::max)
    };
    set.demonstrations.iter().map(of).fold(0.0, f64::max)
}
