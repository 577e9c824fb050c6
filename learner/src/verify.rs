//! Rollouts of a learned model in its own field and frame map: does it do what was shown?
//!
//! In canonical coordinates both blocks move on their own; the frame map, at rest, takes their
//! paths into the robot's base frame.

use glam::DVec3;
use nalgebra::SVector;
use rand::Rng;
use tprmp_model::skill_model::{DemonstrationRollout, FieldModel, Rollouts};
use tprmp_rmpflow::field::Field;
use tprmp_rmpflow::frame_map::{Canonical, FrameMap};

use crate::canonical::{CanonicalDemonstration, CanonicalSet};
use crate::demonstration::Demonstration;
use crate::error::LearnerError;
use crate::skill::Verification;

/// Step of the rollouts [s], that of a fast controller.
pub const STEP_S: f64 = 1e-3;
/// Every how many steps the way of a rollout is looked at for the nearest point.
const WAY_STEP: usize = 5;
/// A random start stops once it is this much nearer than the tolerance, and that slow.
const ARRIVED_SHARE: f64 = 0.01;
/// Largest rotation vector of a random start [rad].
const START_ANGLE_MAX_RAD: f64 = 0.95 * std::f64::consts::PI;

/// A field of whichever dimension, acting on the first coordinates of a vector.
enum Block {
    Plane(Box<Field<2>>),
    Space(Box<Field<3>>),
}

/// The path of a block, one point a step, and how its energy fared.
struct Run {
    points: Vec<DVec3>,
    energy_at_start: f64,
    rise_max: f64,
}

impl Block {
    fn new(model: &FieldModel) -> Self {
        if model.components[0].mean.len() == 2 {
            Self::Plane(Box::new(model.field()))
        } else {
            Self::Space(Box::new(model.field()))
        }
    }

    fn run(&self, start: DVec3, steps: usize, arrived: Option<f64>) -> Run {
        match self {
            Self::Plane(field) => run(field, start, steps, arrived),
            Self::Space(field) => run(field, start, steps, arrived),
        }
    }
}

fn to_world<const D: usize>(y: &SVector<f64, D>) -> DVec3 {
    DVec3::new(y[0], y[1], if D > 2 { y[2] } else { 0.0 })
}

/// Follows ÿ = M⁻¹f from rest by the semi-implicit Euler rule. Stops early when point and velocity
/// are within `arrived` of the goal and of rest.
fn run<const D: usize>(field: &Field<D>, start: DVec3, steps: usize, arrived: Option<f64>) -> Run {
    let goal = field.goal();
    let mut y = SVector::<f64, D>::from_fn(|i, _| start[i]);
    let mut velocity = SVector::<f64, D>::zeros();
    let energy_at_goal = field.evaluate(&goal, &velocity).potential;
    let mut value = field.evaluate(&y, &velocity);
    let mut energy = value.energy(&velocity);
    let mut run =
        Run { points: vec![to_world(&y)], energy_at_start: energy - energy_at_goal, rise_max: 0.0 };
    for _ in 0..steps {
        let Some(factor) = value.metric.cholesky() else { break };
        velocity += factor.solve(&value.force(&velocity)) * STEP_S;
        y += velocity * STEP_S;
        value = field.evaluate(&y, &velocity);
        let after = value.energy(&velocity);
        run.rise_max = run.rise_max.max(after - energy);
        energy = after;
        run.points.push(to_world(&y));
        if arrived.is_some_and(|near| (y - goal).norm() < near && velocity.norm() < near) {
            break;
        }
    }
    run
}

/// A fitted model's moving parts.
pub struct Verifier<'a> {
    map: &'a FrameMap,
    position: Block,
    rotation: Option<Block>,
    settings: Verification,
    energy_at_start: [f64; 2],
    rise_max: [f64; 2],
}

impl<'a> Verifier<'a> {
    /// Takes the fields of a model and the map of its frames.
    #[must_use]
    pub fn new(
        map: &'a FrameMap,
        position: &FieldModel,
        orientation: Option<&FieldModel>,
        settings: &Verification,
    ) -> Self {
        Self {
            map,
            position: Block::new(position),
            rotation: orientation.map(Block::new),
            settings: *settings,
            energy_at_start: [0.0; 2],
            rise_max: [0.0; 2],
        }
    }

    /// Runs every demonstration and the random starts. `progress` is told after each rollout.
    /// `radii` are those of the random starts around demonstrated points [m, rad].
    ///
    /// # Errors
    /// [`LearnerError::GoalMissed`] when a demonstrated start does not reach the goal.
    pub fn verify(
        mut self,
        demonstrations: &[Demonstration],
        set: &CanonicalSet,
        radii: [f64; 2],
        random: &mut impl Rng,
        progress: &mut dyn FnMut(),
    ) -> Result<Rollouts, LearnerError> {
        let mut rows = Vec::with_capacity(demonstrations.len());
        for (demonstration, canonical) in demonstrations.iter().zip(&set.demonstrations) {
            let row = self.follow(demonstration, canonical).0;
            let (metres, radians) = (row.goal_error_m, row.goal_error_rad);
            let reached = metres <= self.settings.goal_tolerance_m
                && radians <= self.settings.goal_tolerance_rad;
            if !reached {
                return Err(LearnerError::GoalMissed {
                    name: row.name,
                    error_mm: metres * 1e3,
                    error_deg: radians.to_degrees(),
                });
            }
            rows.push(row);
            progress();
        }
        let mut reached = 0;
        for _ in 0..self.settings.random_starts {
            let shown = &set.demonstrations[random.random_range(0..set.demonstrations.len())];
            let sample = random.random_range(0..shown.position.points.len());
            let near = Canonical {
                position: shown.position.points[sample] + in_ball(radii[0], random),
                rotation: shown.rotation.points[sample] + in_ball(radii[1], random),
            };
            reached += u32::from(self.reaches(near));
            progress();
        }
        let rise = |i: usize| self.rise_max[i] / self.energy_at_start[i].max(f64::MIN_POSITIVE);
        let orientation_rise = if self.rotation.is_some() { rise(1) } else { 0.0 };
        Ok(Rollouts {
            demonstrations: rows,
            random_starts: self.settings.random_starts,
            random_starts_reached: reached,
            energy_rise_max: rise(0).max(orientation_rise),
        })
    }

    /// Follows the model from a demonstration's start, from rest, with its frames; the path in
    /// canonical coordinates goes with the figures.
    pub fn follow(
        &mut self,
        demonstration: &Demonstration,
        canonical: &CanonicalDemonstration,
    ) -> (DemonstrationRollout, Vec<Canonical>) {
        let displacement = &canonical.displacement;
        let poses = &demonstration.poses[canonical.rest..];
        let start = self.map.inverse(displacement, &poses[0], &mut 0.0);
        let duration_s = (poses.len() - 1) as f64 * demonstration.sampling_time_s;
        let steps = (self.settings.horizon_s.max(duration_s) / STEP_S).ceil() as usize + 1;
        let path = self.path(start, steps, None);
        let at = |time_s: f64| {
            let step = time_s / STEP_S;
            let (i, share) = (step.floor() as usize, step.fract());
            let (a, b) = (path[i.min(path.len() - 1)], path[(i + 1).min(path.len() - 1)]);
            Canonical {
                position: a.position.lerp(b.position, share),
                rotation: a.rotation.lerp(b.rotation, share),
            }
        };
        let (mut square_m2, mut square_rad2, mut square_path_m2) = (0.0, 0.0, 0.0);
        let way: Vec<DVec3> = path
            .iter()
            .step_by(WAY_STEP)
            .map(|y| self.map.forward(displacement, y).position)
            .collect();
        for (i, pose) in poses.iter().enumerate() {
            let y = at(i as f64 * demonstration.sampling_time_s);
            let here = self.map.forward(displacement, &y);
            square_m2 += (here.position - pose.position).length_squared();
            square_rad2 += here.rotation_from(pose).length_squared();
            let nearest = way.iter().map(|p| (*p - pose.position).length_squared());
            square_path_m2 += nearest.fold(f64::INFINITY, f64::min);
        }
        let goal =
            Canonical { position: self.map.canonical().goal.position, rotation: DVec3::ZERO };
        let last = path[path.len() - 1];
        let goal = self.map.forward(displacement, &goal);
        let end = self.map.forward(displacement, &last);
        let count = poses.len() as f64;
        let turns = if self.rotation.is_some() { 1.0 } else { 0.0 };
        let figures = DemonstrationRollout {
            name: demonstration.name.clone(),
            goal_error_m: (end.position - goal.position).length(),
            goal_error_rad: end.rotation_from(&goal).length() * turns,
            tracking_rms_m: (square_m2 / count).sqrt(),
            path_rms_m: (square_path_m2 / count).sqrt(),
            tracking_rms_rad: (square_rad2 / count).sqrt() * turns,
        };
        (figures, path)
    }

    fn reaches(&mut self, start: Canonical) -> bool {
        let tolerance = [self.settings.goal_tolerance_m, self.settings.goal_tolerance_rad];
        let steps = (self.settings.horizon_s / STEP_S).ceil() as usize;
        let path = self.path(start, steps, Some(tolerance));
        let end = path[path.len() - 1];
        (end.position - self.map.canonical().goal.position).length() <= tolerance[0]
            && end.rotation.length() <= tolerance[1]
    }

    fn path(
        &mut self,
        start: Canonical,
        steps: usize,
        tolerance: Option<[f64; 2]>,
    ) -> Vec<Canonical> {
        let arrived = tolerance.map(|t| t.map(|t| t * ARRIVED_SHARE));
        let position = self.position.run(start.position, steps, arrived.map(|a| a[0]));
        self.note(0, &position);
        let rotation = match &self.rotation {
            None => vec![DVec3::ZERO],
            Some(block) => {
                let vector = start.rotation.clamp_length_max(START_ANGLE_MAX_RAD);
                let run = block.run(vector, steps, arrived.map(|a| a[1]));
                self.note(1, &run);
                run.points
            }
        };
        // A block that arrived early stays where it is.
        let held = |points: &[DVec3], i: usize| points[i.min(points.len() - 1)];
        (0..position.points.len().max(rotation.len()))
            .map(|i| Canonical {
                position: held(&position.points, i),
                rotation: held(&rotation, i),
            })
            .collect()
    }

    fn note(&mut self, block: usize, run: &Run) {
        self.energy_at_start[block] = self.energy_at_start[block].max(run.energy_at_start);
        self.rise_max[block] = self.rise_max[block].max(run.rise_max);
    }
}

/// A point in a ball, evenly distributed.
fn in_ball(radius: f64, random: &mut impl Rng) -> DVec3 {
    // One try in two hits; 64 misses in a row do not happen.
    for _ in 0..64 {
        let point = DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
        if point.length() <= 1.0 {
            return point * radius;
        }
    }
    DVec3::ZERO
}
