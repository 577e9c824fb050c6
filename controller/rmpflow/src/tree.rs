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
//! is a [`FreeBall`](crate::leaves::FreeBall).

use nalgebra::SVector;

use crate::leaves::{
    Avoidance, AvoidanceState, Body, Free, JointDamping, JointLimits, JointSpeedLimits, Posture,
    Proximity, SelfCollision, Tick,
};
use crate::natural::ResolveError;

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
    /// How fast what obstacles add to the acceleration may change \[rad/s³ or m/s³\]; `None` without a
    /// limit.
    pub obstacle_jerk_max: Option<SVector<f64, N>>,
}

/// What the tree needs between ticks.
#[derive(Debug, Clone, Copy)]
pub struct TreeState<const N: usize> {
    avoidance: AvoidanceState,
    /// What obstacles added to the acceleration in the last tick.
    added: SVector<f64, N>,
}

/// The acceleration of a tick, and how near everything is.
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
    /// Hot path: no allocation; O(points × (obstacles + pairs)).
    ///
    /// # Errors
    /// When the root cannot be resolved: the caller stops the robot.
    pub fn evaluate<B: Body<N>>(
        &self,
        tick: &Tick<'_, B, N>,
        state: &mut TreeState<N>,
    ) -> Result<Resolved<N>, ResolveError> {
        let (q, qd) = (&tick.position, &tick.velocity);
        let mut root = self.joint_damping.evaluate(qd);
        root.add(&tick.task.natural);
        if let Some(limits) = &self.joint_limits {
            limits.add(q, qd, &mut root);
        }
        if let Some(limits) = &self.joint_speed_limits {
            limits.add(qd, &mut root);
        }
        if let Some(posture) = &self.posture {
            root.add(&posture.evaluate(q, qd));
        }
        let own = self
            .self_collision
            .as_ref()
            .map_or(Proximity::NONE, |leaf| leaf.add(tick.body, &mut root));
        let factor = root.factor()?;
        let free = Free { acceleration: root.resolve_with(&factor)?, factor };
        let conditioning = factor.pivot_ratio();
        let mut proximity = Proximity::NONE;
        let mut acceleration = free.acceleration;
        if let Some(avoidance) = &self.avoidance {
            let before = root;
            proximity = avoidance.add(tick, &free, &mut root, &mut state.avoidance);
            if root != before {
                acceleration = root.resolve()?;
            }
            let mut change = acceleration - free.acceleration - state.added;
            if let Some(jerk_max) = &self.obstacle_jerk_max {
                let change_max = jerk_max * tick.dt_s;
                change = change.zip_map(&change_max, |change, most| change.clamp(-most, most));
            }
            state.added += change;
            acceleration = free.acceleration + state.added;
        }
        proximity.closing_1_s = proximity.closing_1_s.max(own.closing_1_s);
        let self_clearance_min_m = own.clearance_min_m;
        Ok(Resolved { acceleration, proximity, self_clearance_min_m, conditioning })
    }
}
