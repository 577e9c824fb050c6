//! The joints in a state of the robot, and what they did since another one.

use nalgebra::SVector;
use tprmp_messages::Reason;

use crate::detail::{About, Detail};
use crate::inputs::turns::{ContinuousJoints, add_turns};

/// States farther apart are judged as if so far apart: a stamp cannot make room for a jump \[s\].
const GAP_MAX_S: f64 = 0.05;

/// Positions and velocities of the joints.
#[derive(Debug, Clone, Copy)]
pub struct JointState<const N: usize> {
    /// q \[rad or m\].
    pub position: SVector<f64, N>,
    /// q̇ \[rad/s or m/s\].
    pub velocity: SVector<f64, N>,
}

/// A state as it was measured.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured<const N: usize> {
    /// With the turns that were counted.
    pub(super) joints: JointState<N>,
    /// Positions as they were reported \[rad or m\].
    reported: SVector<f64, N>,
    /// How many whole turns `joints` has beside that.
    pub(super) turns: SVector<f64, N>,
    pub(super) sequence: u64,
    pub(super) time_ns: u64,
}

impl<const N: usize> Measured<N> {
    /// As it was reported.
    pub(super) fn new(joints: JointState<N>, sequence: u64, time_ns: u64) -> Self {
        let (reported, turns) = (joints.position, SVector::zeros());
        Self { joints, reported, turns, sequence, time_ns }
    }

    /// This state in the turns in which it goes on from the last one.
    pub(super) fn continuing(&self, last: &Self, continuous: &ContinuousJoints<N>) -> Self {
        let alike = self.in_turns(last.turns);
        self.in_turns(continuous.continued(&last.turns, &alike.beside(last)))
    }

    fn in_turns(&self, turns: SVector<f64, N>) -> Self {
        let position = self.reported.zip_map(&turns, add_turns);
        Self { joints: JointState { position, ..self.joints }, turns, ..*self }
    }

    /// Since the last one \[s\].
    pub(super) fn elapsed_s(&self, last: &Self) -> f64 {
        (self.time_ns.saturating_sub(last.time_ns) as f64 * 1e-9).min(GAP_MAX_S)
    }

    /// What the positions changed by since the last one beside their mean velocity \[rad or m\].
    pub(super) fn beside(&self, last: &Self) -> SVector<f64, N> {
        let mean = (last.joints.velocity + self.joints.velocity) * 0.5;
        self.joints.position - last.joints.position - mean * self.elapsed_s(last)
    }

    /// Its stamp is not newer than the last one \[ns\].
    pub(super) fn stuck(&self, last_ns: u64) -> Detail {
        let expected = [last_ns as f64, 0.0];
        Detail::new(Reason::StateTimeStuck, About::Stamp, self.time_ns as f64, expected)
    }
}
