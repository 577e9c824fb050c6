//! What the leaves beside the task are evaluated for.

use nalgebra::SVector;

use crate::leaves::obstacle::Obstacle;
use crate::natural::Natural;

/// The task of a tick.
#[derive(Debug, Clone, Copy)]
pub struct Task<const N: usize> {
    /// Its leaves, pulled back to the root.
    pub natural: Natural<N>,
    /// Its energy V \[J\], or whatever else falls as it nears its goal.
    pub energy: f64,
}

/// A tick of a robot with N coordinates.
#[derive(Debug)]
pub struct Tick<'a, B, const N: usize> {
    /// Its task.
    pub task: Task<N>,
    /// q \[rad or m\].
    pub position: SVector<f64, N>,
    /// q̇ \[rad/s or m/s\].
    pub velocity: SVector<f64, N>,
    /// The points that keep clear, at q and q̇.
    pub body: &'a B,
    /// What they keep clear of.
    pub obstacles: &'a [Obstacle],
    /// Time since the last tick \[s\].
    pub dt_s: f64,
}
