//! The RMP-tree of a robot: the leaves beside its task, how they are composed, and the resolved
//! acceleration.
//!
//! ```text
//! root (joints) ── task leaves, pulled back by the caller
//!   ├─ joint damping, position limits, speed limits, posture
//!   ├─ pairs of points of the robot itself ── clearance ── collision leaf
//!   └─ points of the robot ── clearance from each obstacle ── collision leaf, steering
//! ```
//!
//! Every leaf but the steering is a geometric dynamical system, so that with frames and obstacles at
//! rest the sum of their energies never rises [Cheng et al. 2019, RMPflow, theorem 2]. A robot of
//! any kind is a [`Body`]: N coordinates, and points that move with them. A point that moves freely
//! is a [`FreeBall`](crate::leaves::avoidance::FreeBall).

use glam::DVec3;
use nalgebra::{SMatrix, SVector, Vector1};

use crate::leaves::avoidance::{Avoidance, AvoidanceState, Body, Proximity, vector};
use crate::leaves::joint_limits::{JointLimits, JointSpeedLimits, Posture};
use crate::leaves::obstacle::Obstacle;
use crate::leaves::{CollisionAvoidance, JointDamping};
use crate::natural::{Natural, ResolveError};

/// The leaves beside the task. Immutable.
#[derive(Debug, Clone)]
pub struct Tree<const N: usize> {
    /// Damping of all joints.
    pub joint_damping: JointDamping,
    /// Position limits.
    pub joint_limits: Option<JointLimits<N>>,
    /// Speed limits.
    pub joint_speed_limits: Option<JointSpeedLimits<N>>,
    /// Posture.
    pub posture: Option<Posture<N>>,
    /// Clearance of the robot from itself.
    pub self_collision: Option<SelfCollision>,
    /// Clearance from obstacles.
    pub avoidance: Option<Avoidance>,
    /// How fast what obstacles add to the acceleration may change; `None` without a limit.
    pub obstacle_jerk_max: Option<SVector<f64, N>>,
}

/// Clearance between points of the robot itself.
#[derive(Debug, Clone)]
pub struct SelfCollision {
    /// How it is kept.
    pub leaf: CollisionAvoidance,
    /// Added to the distance that is kept \[m\].
    pub margin_m: f64,
    /// Which parts of the body keep clear of each other: all points of one of all of the other.
    pub pairs: Box<[(usize, usize)]>,
}

/// The task of a tick.
#[derive(Debug, Clone, Copy)]
pub struct Task<const N: usize> {
    /// Its leaves, pulled back to the root.
    pub natural: Natural<N>,
    /// Its energy, or whatever else falls as it nears its goal.
    pub energy: f64,
}

/// What the tree needs between ticks.
#[derive(Debug, Clone, Copy)]
pub struct TreeState<const N: usize> {
    avoidance: AvoidanceState,
    /// What obstacles added to the acceleration in the last tick.
    added: SVector<f64, N>,
}

/// What the tree decided, and what it saw.
#[derive(Debug, Clone, Copy)]
pub struct Resolved<const N: usize> {
    /// q̈ \[rad/s² or m/s²\].
    pub acceleration: SVector<f64, N>,
    /// Of obstacles.
    pub proximity: Proximity,
    /// Least clearance of the robot from itself, margin taken off; infinite where no pair is close \[m\].
    pub self_clearance_min_m: f64,
    /// Ratio of the least to the largest pivot of the root's metric: near zero where some
    /// acceleration costs hardly anything, so that only the joint damping decides about it.
    pub conditioning: f64,
}

impl<const N: usize> Default for TreeState<N> {
    fn default() -> Self {
        Self { avoidance: AvoidanceState::default(), added: SVector::zeros() }
    }
}

impl<const N: usize> Tree<N> {
    /// Composes the task with the other leaves and resolves the root  [thesis algorithm 4.1].
    ///
    /// * `task`  the task
    /// * `q`, `qd`  coordinates and their velocities, N
    /// * `dt`  time since the last tick \[s\]
    ///
    /// Hot path: no allocation; O(points × (obstacles + pairs)).
    ///
    /// # Errors
    /// When the root cannot be resolved: the caller stops the robot.
    #[expect(clippy::too_many_arguments, reason = "what a tick consists of")]
    pub fn evaluate(
        &self,
        task: &Task<N>,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        body: &impl Body<N>,
        obstacles: &[Obstacle],
        dt: f64,
        state: &mut TreeState<N>,
    ) -> Result<Resolved<N>, ResolveError> {
        let mut root = self.joint_damping.evaluate(qd);
        root.add(&task.natural);
        if let Some(limits) = &self.joint_limits {
            limits.add(q, qd, &mut root);
        }
        if let Some(limits) = &self.joint_speed_limits {
            limits.add(qd, &mut root);
        }
        if let Some(posture) = &self.posture {
            root.add(&posture.evaluate(q, qd));
        }
        let self_clearance_min_m =
            self.self_collision.as_ref().map_or(f64::INFINITY, |leaf| leaf.add(body, &mut root));
        let factor = root.factor()?;
        let free = root.resolve_with(&factor)?;
        let conditioning = factor.pivot_ratio();
        let mut proximity = Proximity { clearance_min_m: f64::INFINITY, obstructed_fraction: 0.0 };
        let mut acceleration = free;
        if let Some(avoidance) = &self.avoidance {
            let before = root.force;
            let metric = root.metric;
            let seen = &mut state.avoidance;
            proximity =
                avoidance.add(body, obstacles, &free, &factor, task.energy, dt, &mut root, seen);
            if root.force != before || root.metric != metric {
                acceleration = root.resolve()?;
            }
            let mut change = acceleration - free - state.added;
            if let Some(most) = &self.obstacle_jerk_max {
                change = change.zip_map(most, |change, most| change.clamp(-most * dt, most * dt));
            }
            state.added += change;
            acceleration = free + state.added;
        }
        Ok(Resolved { acceleration, proximity, self_clearance_min_m, conditioning })
    }
}

impl SelfCollision {
    /// Adds the leaves of all close pairs; returns the least clearance among them, margin taken off.
    fn add<const N: usize>(&self, body: &impl Body<N>, root: &mut Natural<N>) -> f64 {
        let mut least = f64::INFINITY;
        for &(a, b) in &self.pairs {
            let (one, other) = (body.part(a), body.part(b));
            if self.is_far(one.position - other.position, one.radius + other.radius) {
                continue;
            }
            for i in one.points {
                let (position, radius) = body.ball(i);
                if self.is_far(position - other.position, radius + other.radius) {
                    continue;
                }
                for j in other.points.clone() {
                    least = least.min(self.add_pair(body, i, j, root));
                }
            }
        }
        least
    }

    /// Whether balls whose centres are `apart` lie out of the leaf's reach.
    fn is_far(&self, apart: DVec3, radii: f64) -> bool {
        let reach = radii + self.margin_m + self.leaf.activation_distance_m;
        apart.length_squared() >= reach * reach
    }

    /// Adds the leaf of a pair of points; returns its clearance, infinite when it is not close.
    fn add_pair<const N: usize>(
        &self,
        body: &impl Body<N>,
        i: usize,
        j: usize,
        root: &mut Natural<N>,
    ) -> f64 {
        let ((a, radius_a), (b, radius_b)) = (body.ball(i), body.ball(j));
        if self.is_far(a - b, radius_a + radius_b) {
            return f64::INFINITY;
        }
        let (one, other) = (body.motion(i), body.motion(j));
        let length = (a - b).length().max(1e-9);
        let clearance = length - (radius_a + radius_b + self.margin_m);
        let normal = (a - b) / length;
        let relative = one.velocity - other.velocity;
        let rate = normal.dot(relative);
        if let Some(leaf) = self.leaf.evaluate(clearance, rate) {
            let bend = (relative.length_squared() - rate * rate) / length;
            let normal = vector(normal);
            let row: SMatrix<f64, 1, N> = normal.transpose() * (one.jacobian - other.jacobian);
            let drift = normal.dot(&(one.drift - other.drift)) + bend;
            root.add_pullback(&leaf, &row, &Vector1::new(drift));
        }
        clearance
    }
}
