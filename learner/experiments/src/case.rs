//! One rollout to be made, and how many are.

use crate::conditions::Conditions;
use crate::experiment::{Compared, Experiment, Setting};

/// How much is done.
#[derive(Clone, Debug)]
pub(crate) struct Extent {
    pub(crate) components: Vec<usize>,
    pub(crate) forces_n: Vec<f64>,
    pub(crate) pick_forces_n: Vec<f64>,
    /// Radii, of goals and of obstacles, at a scale of one [m]; so are the forces.
    pub(crate) radii_m: Vec<f64>,
    /// Directions of static displaced goals.
    pub(crate) directions: usize,
    /// Runs with random speed of the object, noisy starts.
    pub(crate) draws: usize,
    pub(crate) starts: usize,
    /// Starts along each side of the grid.
    pub(crate) grid: usize,
    pub(crate) timed: usize,
}

impl Extent {
    pub(crate) fn full() -> Self {
        let tenths = |n: i32| f64::from(n) / 10.0;
        Self {
            components: vec![5, 7, 9, 11, 13, 15],
            forces_n: (1..=9).map(|n| f64::from(n) * 10.0).collect(),
            pick_forces_n: (0..10).map(|n| 10.0 + 50.0 * f64::from(n)).collect(),
            radii_m: (1..=9).map(tenths).collect(),
            directions: 8,
            draws: 10,
            starts: 1000,
            grid: 35,
            timed: 2000,
        }
    }

    pub(crate) fn quick() -> Self {
        Self {
            components: vec![5, 9, 15],
            forces_n: vec![10.0, 50.0, 90.0],
            pick_forces_n: vec![10.0, 210.0, 460.0],
            radii_m: vec![0.1, 0.5, 0.9],
            directions: 4,
            draws: 3,
            starts: 100,
            grid: 15,
            timed: 500,
        }
    }
}

/// One rollout to be made.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    pub(crate) experiment: Experiment,
    pub(crate) setting: Setting,
    pub(crate) compared: Compared,
    /// Index of the skill.
    pub(crate) skill: usize,
    /// Counts draws of the same setting; where a policy tracks, the demonstrations.
    pub(crate) instance: usize,
    pub(crate) conditions: Conditions,
}

impl Case {
    /// Demonstration whose frames are taken.
    pub(crate) fn demonstration(&self) -> usize {
        if self.experiment.tracks() { self.instance } else { 0 }
    }
}
