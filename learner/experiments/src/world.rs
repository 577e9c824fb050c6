//! The world of an experiment: a body follows a policy while its goal moves, it is pushed, and an
//! obstacle is in the way.

use std::ops::ControlFlow::{self, Break, Continue};

use glam::DVec3;
use nalgebra::SVector;
use tprmp_learner::certify::policy::{Body, DesiredMotion, MotionPolicy};
use tprmp_learner::certify::rollout::{self, Environment, RolloutSpec, resolve_first, roll_out};
use tprmp_model::skill_model::Manifold;
use tprmp_rmpflow::leaves::{AvoidanceState, Free, FreeBall, Task, Tick};
use tprmp_rmpflow::natural::Natural;
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration};

use crate::conditions::{Ball, Conditions, GoalMotion};
use crate::metric::{STOP_SPEED_M_S, STOP_STEPS};

/// A body that is farther away has diverged, at a scale of one [m].
const DIVERGED_M: f64 = 1e5;
/// A rollout ends when the body rests at its goal, nearer than this [m, rad] and slower [m/s, rad/s], at a scale
/// of one.
const AT_REST: f64 = 1e-7;
/// A sum of some ten terms is known no better than this, relative to its value.
const ENERGY_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// How a rollout under an experiment's conditions went.
#[derive(Clone, Debug, Default)]
pub struct RunOutcome {
    /// Poses, one a step, the first one included.
    pub path: Vec<Pose>,
    /// Positions of the goal, as many.
    pub goals: Vec<DVec3>,
    /// Distance to the true goal at the end \[m\].
    pub goal_error_m: f64,
    /// Angle to it \[rad\]; zero in the plane.
    pub goal_error_rad: f64,
    /// Largest acceleration [m/s²].
    pub acceleration_max_m_s2: f64,
    /// Least distance to the obstacle's surface, negative when it was touched \[m\].
    pub clearance_min_m: Option<f64>,
    /// Largest rise of V in a step beyond rounding, as a fraction of what V falls by on the path.
    pub energy_rise_max: f64,
    /// Poses up to the thesis' stop.
    pub stopped_at: usize,
    /// Whether the body came so near to the goal that it stopped.
    pub touched: bool,
    /// Distance to the policy's own goal at the thesis' stop, as the thesis measures it \[m\].
    pub own_goal_error_m: f64,
}

impl RunOutcome {
    /// Whether the obstacle was touched.
    #[must_use]
    pub fn collided(&self) -> bool {
        self.clearance_min_m.is_some_and(|clearance| clearance <= 0.0)
    }
}

/// The world while a body moves through it.
struct World<'a> {
    conditions: &'a Conditions,
    frames: Vec<MovingPose>,
    /// Whether the goal moves still.
    moving: bool,
    /// Steps that the rollout takes at most.
    steps: usize,
    /// Whether the body has got under way: a start from rest is no stop.
    started: bool,
    /// Steps since when it is slow.
    slow: usize,
    /// Distance to the policy's own goal at the thesis' stop [m].
    stopped_m: Option<f64>,
    sides: AvoidanceState,
    /// V at the start, at the last step, and the least.
    energies: Option<[f64; 3]>,
    outcome: RunOutcome,
}

impl World<'_> {
    fn new(conditions: &Conditions, steps: usize) -> World<'_> {
        World {
            frames: conditions.frames.iter().copied().map(MovingPose::at_rest).collect(),
            moving: conditions.goal_motion != GoalMotion::default(),
            conditions,
            steps,
            started: false,
            slow: 0,
            stopped_m: None,
            sides: AvoidanceState::default(),
            energies: None,
            outcome: RunOutcome {
                clearance_min_m: conditions.ball.map(|_| f64::INFINITY),
                ..RunOutcome::default()
            },
        }
    }

    fn goal(&self) -> Pose {
        self.conditions.goal(&self.frames[1])
    }

    /// The goal that the policy itself has.
    fn own_goal<P: MotionPolicy + ?Sized>(&self, policy: &mut P) -> Pose {
        policy.goal(&self.frames).unwrap_or_else(|| self.goal())
    }

    fn own_goal_error<P: MotionPolicy + ?Sized>(&self, body: &Body, policy: &mut P) -> f64 {
        (body.pose.position - self.own_goal(policy).position).length()
    }

    /// Moves the goal until the body is near.
    fn move_goal<P: MotionPolicy + ?Sized>(&mut self, body: &Body, policy: &mut P) {
        let motion = &self.conditions.goal_motion;
        let goal = if self.conditions.own_goal { self.own_goal(policy) } else { self.goal() };
        let near = (body.pose.position - goal.position).length() < motion.stops_within_m;
        if near && !self.outcome.path.is_empty() {
            self.moving = false;
            self.outcome.touched = true;
            self.frames[1] = MovingPose::at_rest(self.frames[1].pose);
        } else {
            self.frames[1] = motion.at(&self.conditions.frames[1], body.time_s);
        }
    }

    /// Watches V while the goal stands still from the start.
    fn watch_energy(&mut self, energy: f64) {
        if self.conditions.goal_motion != GoalMotion::default() {
            return;
        }
        let [first, before, least] = self.energies.unwrap_or([energy; 3]);
        let rise = energy - before - ENERGY_ROUNDING * before.abs();
        self.outcome.energy_rise_max = self.outcome.energy_rise_max.max(rise);
        self.energies = Some([first, energy, least.min(energy)]);
    }

    /// Keeps the body clear of the ball, in the N linear coordinates in which it moves; returns the
    /// obstructed fraction of the desired velocity.
    fn avoid<const N: usize>(
        &mut self,
        ball: &Ball,
        body: &Body,
        desired: &mut DesiredMotion,
    ) -> f64 {
        let obstacle = ball.at(&self.frames[1], &self.conditions.frames[1]);
        let (position, velocity) = (body.pose.position, body.velocity.linear);
        let distance = obstacle.clearance(position, velocity, 0.0).distance;
        let least = self.outcome.clearance_min_m.unwrap_or(f64::INFINITY);
        self.outcome.clearance_min_m = Some(least.min(distance));
        let point = FreeBall { position, velocity, radius: 0.0, goal: self.goal().position };
        let DesiredMotion { natural, energy } = desired;
        let free = resolve(natural, self.conditions.manifold).map_or(DVec3::ZERO, |a| a.linear);
        let mut root = Natural::<N> {
            force: natural.force.fixed_rows::<N>(0).into_owned(),
            metric: natural.metric.fixed_view::<N, N>(0, 0).into_owned(),
        };
        let Ok(factor) = root.factor() else { return 0.0 };
        let vector = |v: DVec3| SVector::<f64, N>::from_fn(|i, _| v[i]);
        let tick = Tick {
            task: Task { natural: root, energy: *energy },
            position: vector(position),
            velocity: vector(velocity),
            body: &point,
            obstacles: std::slice::from_ref(&obstacle),
            dt_s: self.conditions.step_s,
        };
        let free = Free { acceleration: vector(free), factor };
        let proximity = ball.avoidance.add(&tick, &free, &mut root, &mut self.sides);
        natural.force.fixed_rows_mut::<N>(0).copy_from(&root.force);
        natural.metric.fixed_view_mut::<N, N>(0, 0).copy_from(&root.metric);
        proximity.obstructed_fraction
    }
}

/// The acceleration in all directions in which the manifold moves, decomposed alike in all of them: so
/// rows of `results.json` stay comparable to the last digit.
pub(crate) fn resolve(natural: &Natural<6>, manifold: Manifold) -> Option<SpatialAcceleration> {
    match manifold {
        Manifold::R2 => resolve_first::<2>(natural),
        Manifold::R3 => resolve_first::<3>(natural),
        Manifold::R3S3 => resolve_first::<6>(natural),
        Manifold::R3S1 | Manifold::S3 => rollout::resolve(natural, manifold),
    }
}

impl<P: MotionPolicy + ?Sized> Environment<P> for World<'_> {
    fn frames(&self) -> &[MovingPose] {
        &self.frames
    }

    fn observe(&mut self, body: &Body, policy: &mut P) -> ControlFlow<()> {
        let scale = self.conditions.scale;
        if body.pose.position.length() >= DIVERGED_M * scale {
            self.outcome.goal_error_m = f64::INFINITY;
            return Break(());
        }
        if self.moving {
            self.move_goal(body, policy);
        }
        let goal = self.goal();
        let outcome = &mut self.outcome;
        outcome.path.push(body.pose);
        outcome.goals.push(goal.position);
        outcome.goal_error_m = (body.pose.position - goal.position).length();
        let turns = self.conditions.manifold.has_orientation();
        outcome.goal_error_rad = if turns { body.pose.rotation_from(&goal).length() } else { 0.0 };
        let error = (outcome.goal_error_m / scale).max(outcome.goal_error_rad);
        let count = outcome.path.len();
        let speed_m_s = body.velocity.linear.length();
        let is_slow = speed_m_s < STOP_SPEED_M_S * scale;
        self.started |= !is_slow;
        self.slow = if self.started && is_slow { self.slow + 1 } else { 0 };
        if self.stopped_m.is_none() && self.slow >= STOP_STEPS {
            self.stopped_m = Some(self.own_goal_error(body, policy));
            self.outcome.stopped_at = count;
        }
        let pushed = self.conditions.push.is_some_and(|push| body.time_s <= push.during_s[1]);
        let speed = (speed_m_s / scale).max(body.velocity.angular.length());
        let at_rest = error < AT_REST && speed < AT_REST;
        let done = count > self.steps || (at_rest && !self.moving && !pushed);
        if done { Break(()) } else { Continue(()) }
    }

    fn act(&mut self, body: &Body, desired: &mut DesiredMotion, policy: &mut P) -> ControlFlow<()> {
        self.watch_energy(desired.energy);
        if let Some(push) = &self.conditions.push {
            let force = push.force(body.time_s, body.velocity.linear);
            for i in 0..3 {
                desired.natural.force[i] += force[i];
            }
        }
        if let Some(ball) = &self.conditions.ball {
            policy.set_obstructed(if self.conditions.manifold == Manifold::R2 {
                self.avoid::<2>(ball, body, desired)
            } else {
                self.avoid::<3>(ball, body, desired)
            });
        }
        Continue(())
    }

    fn resolve(&self, natural: &Natural<6>, manifold: Manifold) -> Option<SpatialAcceleration> {
        resolve(natural, manifold)
    }
}

/// Lets a body follow a policy under these conditions.
pub fn run<P: MotionPolicy + ?Sized>(policy: &mut P, conditions: &Conditions) -> RunOutcome {
    let steps = (conditions.duration_s / conditions.step_s).ceil() as usize;
    let mut world = World::new(conditions, steps);
    let (manifold, start, step_s) = (conditions.manifold, conditions.start, conditions.step_s);
    let end = roll_out(policy, &mut world, &RolloutSpec { manifold, start, step_s, steps });
    let own_goal_error_m = world.stopped_m.unwrap_or_else(|| {
        world.outcome.stopped_at = world.outcome.path.len();
        world.own_goal_error(&end.body, policy)
    });
    let fall = world.energies.map_or(0.0, |[first, _, least]| first - least);
    let mut outcome = world.outcome;
    outcome.own_goal_error_m = own_goal_error_m;
    outcome.acceleration_max_m_s2 = end.acceleration_max_m_s2;
    outcome.energy_rise_max /= fall.max(f64::MIN_POSITIVE);
    if !end.completed {
        outcome.goal_error_m = f64::INFINITY;
    }
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{ControllerLeaves, INERTIA, point_motion};
    use crate::conditions::Push;
    use crate::experiment::Space;
    use glam::DQuat;

    /// A critically damped spring to the goal frame's origin.
    struct Spring;

    impl MotionPolicy for Spring {
        fn evaluate(&mut self, frames: &[MovingPose], body: &Body) -> DesiredMotion {
            let goal = frames[1];
            let away = body.pose.position - goal.pose.position;
            let rate = body.velocity.linear - goal.velocity.linear;
            let desired = point_motion(goal.acceleration.linear - away * 25.0 - rate * 10.0);
            let energy =
                INERTIA.linear_kg * (12.5 * away.length_squared() + 0.5 * rate.length_squared());
            DesiredMotion { energy, ..desired }
        }
    }

    fn conditions() -> Conditions {
        let at = |x, y| Pose { position: DVec3::new(x, y, 0.0), orientation: DQuat::IDENTITY };
        Conditions {
            manifold: Manifold::R2,
            frames: vec![at(0.0, 0.0), at(1.0, 0.0)],
            grasp: at(0.0, 0.0),
            start: Body::at_rest(at(0.0, 0.0)),
            own_goal: false,
            step_s: 0.01,
            duration_s: 10.0,
            goal_motion: GoalMotion::default(),
            push: None,
            ball: None,
            scale: 1.0,
        }
    }

    #[test]
    fn a_spring_arrives_and_its_energy_falls() {
        let outcome = run(&mut Spring, &conditions());
        assert!(outcome.goal_error_m < 1e-6 && outcome.path.len() < 1000);
        assert!(outcome.energy_rise_max <= 0.0, "{}", outcome.energy_rise_max);
        assert!((outcome.acceleration_max_m_s2 - 25.0).abs() < 1e-9);
        assert!(outcome.own_goal_error_m < 1.0);
    }

    #[test]
    fn a_goal_on_a_circle_stops_when_the_body_is_near() {
        let goal_motion = GoalMotion::circle(0.5, 3.0, 0.1);
        let outcome = run(&mut Spring, &Conditions { goal_motion, ..conditions() });
        assert!(outcome.goal_error_m < 1e-6 && outcome.touched);
        let center = DVec3::new(1.0, 0.0, 0.0);
        assert!(outcome.goals.iter().all(|goal| ((*goal - center).length() - 0.5).abs() < 1e-9));
        assert_eq!(outcome.goals.last(), outcome.goals.get(outcome.goals.len() - 2));
    }

    #[test]
    fn the_thesis_stop_and_rest_scale_with_the_skill() {
        let small = |scale: f64| {
            let mut conditions = Conditions { scale, ..conditions() };
            conditions.frames[1].position *= 0.05;
            run(&mut Spring, &conditions)
        };
        let (large, scaled, unscaled) = (run(&mut Spring, &conditions()), small(0.05), small(1.0));
        assert_eq!(scaled.stopped_at, large.stopped_at);
        assert_eq!(scaled.path.len(), large.path.len());
        assert!((scaled.own_goal_error_m / large.own_goal_error_m / 0.05 - 1.0).abs() < 1e-9);
        // On a drawing of 5 cm the thesis' own bound stops too early.
        assert!(unscaled.own_goal_error_m > 10.0 * scaled.own_goal_error_m);
    }

    #[test]
    fn what_flies_away_has_diverged() {
        let push = Push { force_n: 1e9, during_s: [0.0, 10.0], as_published: false };
        let outcome = run(&mut Spring, &Conditions { push: Some(push), ..conditions() });
        assert!(outcome.goal_error_m.is_infinite() && outcome.path.len() < 1000);
    }

    #[test]
    fn a_touched_ball_is_seen() {
        let center = DVec3::new(0.5, 0.05, 0.0);
        let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");
        let leaves = ControllerLeaves::read(config.as_ref()).unwrap();
        let ball = Ball { center, radius_m: 0.2, avoidance: leaves.avoidance(Space::Planar) };
        let with = Conditions { ball: Some(ball), ..conditions() };
        assert!(ball.leaves_room(&with, 0.05));
        let outcome = run(&mut Spring, &with);
        assert!(outcome.clearance_min_m.unwrap() > 0.0);
        assert!(outcome.path.iter().all(|p| (p.position - center).length() > 0.2));
        assert!(!Ball { radius_m: 0.5, ..ball }.leaves_room(&with, 0.05));
    }
}
