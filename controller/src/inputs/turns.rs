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

    /// The whole turns by which a report of positions goes on from `last` \[rad or m\], the nearest way.
    #[must_use]
    pub fn since(&self, last: &SVector<f64, N>, reported: &SVector<f64, N>) -> SVector<f64, N> {
        let nearest = |i: usize| ((last[i] - reported[i]) / TAU).round();
        SVector::from_fn(|i, _| if self.0[i] { nearest(i) } else { 0.0 })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_within_one_turn_goes_on_the_nearest_way() {
        let joints = ContinuousJoints::from([true, false]);
        let mut last = SVector::from([3.0, 3.0]);
        for step in 1..200 {
            // Within [−π, π), a twentieth of a radian further each time.
            let angle = 3.0 + 0.05 * f64::from(step);
            let reported = SVector::from([(angle + PI).rem_euclid(TAU) - PI, -3.0]);
            let turns = joints.since(&last, &reported);
            last = SVector::from_fn(|i, _| add_turns(reported[i], turns[i]));
            assert!((last[0] - angle).abs() < 1e-12, "{last:?}");
            assert_eq!(last[1], -3.0, "a joint with an end leaps");
        }
    }
}
