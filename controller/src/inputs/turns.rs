//! The whole turns of joints without position limits. A robot may report such a joint within one turn,
//! in [−π, π) for one: where the report leaps from one end to the other, the joint goes on.

use core::f64::consts::{PI, TAU};

use nalgebra::SVector;
use tprmp_robot::{Chain, JointKind};

/// Which joints rotate without an end.
#[derive(Debug, Clone, Copy)]
pub struct ContinuousJoints<const N: usize>([bool; N]);

impl<const N: usize> ContinuousJoints<N> {
    /// None of them.
    pub const NONE: Self = Self([false; N]);

    /// Those of a chain: revolute, and without a position limit on either side.
    #[must_use]
    pub fn of(chain: &Chain<N>) -> Self {
        Self(core::array::from_fn(|i| {
            let ends = [chain.position_lower()[i], chain.position_upper()[i]];
            chain.joint_kind(i) == Some(JointKind::Revolute) && ends.iter().all(|e| e.is_infinite())
        }))
    }

    /// The turns of a state that seems to have left the last one by `beside` \[rad or m\] with the turns of that
    /// one. Within one turn a report leaps by one turn: a larger jump is no reason to count more.
    #[must_use]
    pub fn continued(&self, turns: &SVector<f64, N>, beside: &SVector<f64, N>) -> SVector<f64, N> {
        SVector::from_fn(|i, _| {
            let leaps = self.0[i] && beside[i].abs() > PI;
            if leaps { turns[i] - beside[i].signum() } else { turns[i] }
        })
    }
}

impl<const N: usize> From<[bool; N]> for ContinuousJoints<N> {
    /// Whether each one does.
    fn from(each: [bool; N]) -> Self {
        Self(each)
    }
}

/// A position \[rad or m\] and so many turns. Without one it stays as it is, to the last bit.
#[must_use]
pub fn add_turns(position: f64, turns: f64) -> f64 {
    if turns == 0.0 { position } else { position + TAU * turns }
}
