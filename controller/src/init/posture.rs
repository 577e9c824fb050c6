//! A posture to begin from, and the range around it in which the arm is not singular.

use core::f64::consts::PI;

use glam::DVec3;
use nalgebra::{DMatrix, SVector};
use tprmp_robot::{
    Chain, ControlPoints, JointKind, Kinematics, SelfPairs, forward_kinematics, point_position,
    spread_posture,
};

/// Postures that are tried, and how often the best one is bettered.
const TRIED: usize = 4000;
const REFINED: usize = 400;
/// Spheres keep so far apart, and so far above the ground: beyond where avoidance acts, with room to move \[m\].
const CLEARANCE_M: f64 = 0.06;
const HEIGHT_M: f64 = 0.2;
/// The manipulability may fall to this fraction of that at home.
const SINGULAR_FRACTION: f64 = 0.08;
/// Steps in which a joint is swept \[rad or m\].
const STEP: f64 = 0.02;
/// A joint may be moved at least so far from home to each side \[rad\]: otherwise home is singular itself.
const ROOM: f64 = 0.3;

/// What decides about a posture.
pub(super) struct Criteria<'a, const N: usize> {
    /// The arm.
    pub chain: &'a Chain<N>,
    /// Its spheres.
    pub points: &'a ControlPoints,
    /// Which of them keep clear of each other.
    pub pairs: &'a SelfPairs,
    /// Limits of the joints with the margin taken off \[rad or m\].
    pub range: [SVector<f64, N>; 2],
    /// The tool's axis that points at what it works on, in its frame.
    pub approach_axis: DVec3,
    /// Which coordinates of the tool the skill moves, displacement before rotation.
    pub(super) moved: &'a [usize],
    /// Spheres that stand on the ground in every posture.
    pub grounded: &'a [bool],
    /// Against gravity, in the base.
    pub up: DVec3,
    /// Height of the ground along that \[m\], where it is known.
    pub ground_m: Option<f64>,
}

impl<const N: usize> Criteria<'_, N> {
    /// The best posture: far from singular configurations and from the joints' limits, clear of itself and of the
    /// ground, the tool pointing down where it can.
    pub(super) fn home(&self) -> SVector<f64, N> {
        let [lower, upper] = &self.range;
        let mut kinematics = Kinematics::new();
        let reach = self.reach(&mut kinematics);
        let mut best = (f64::NEG_INFINITY, SVector::zeros());
        let mut consider = |q: SVector<f64, N>, best: &mut (f64, SVector<f64, N>)| {
            let score = self.score(&q, reach, &mut kinematics);
            if score > best.0 {
                *best = (score, q);
            }
        };
        for k in 1..=TRIED {
            consider(spread_posture(lower, upper, k), &mut best);
        }
        for k in 1..=REFINED {
            let size = 0.4 * (1.0 - k as f64 / (REFINED + 1) as f64);
            let aside = spread_posture(&SVector::repeat(-size), &SVector::repeat(size), k);
            let ends = lower.zip_map(upper, |lower, upper| [lower, upper]);
            consider(
                (best.1 + aside).zip_map(&ends, |q, [lower, upper]| q.clamp(lower, upper)),
                &mut best,
            );
        }
        let rounded = best.1.map(|q| (q * 100.0).round() / 100.0);
        SVector::from_fn(|i, _| rounded[i].clamp(lower[i], upper[i]))
    }

    /// How far the tool comes from the first joint \[m\].
    fn reach(&self, kinematics: &mut Kinematics<N>) -> f64 {
        let [lower, upper] = &self.range;
        let distance = |k| {
            forward_kinematics(self.chain, &spread_posture(lower, upper, k), kinematics);
            let first = point_position(kinematics, 0, DVec3::ZERO);
            kinematics.tool_position().distance(first)
        };
        (1..=500).map(distance).fold(1e-3, f64::max)
    }

    fn score(&self, q: &SVector<f64, N>, reach: f64, kinematics: &mut Kinematics<N>) -> f64 {
        forward_kinematics(self.chain, q, kinematics);
        let (mut near_limit, [lower, upper]) = (0.0, &self.range);
        for i in 0..N {
            let (lower, upper) = (lower[i].max(-PI), upper[i].min(PI));
            let aside = (q[i] - 0.5 * (lower + upper)) / (0.5 * (upper - lower)).max(1e-9);
            near_limit += aside * aside / N as f64;
        }
        let [clearance, low] = self.clearance(kinematics);
        let down = -(kinematics.tool_pose().orientation * self.approach_axis).dot(self.up);
        let out = kinematics.tool_position().reject_from(self.up).length() / reach;
        let height = (kinematics.tool_position().dot(self.up) / reach - 0.3).clamp(-1.0, 1.0);
        // Half of the reach away, and a third of it high.
        2.0 / N as f64 * self.manipulability(kinematics, reach).max(1e-30).ln() - 1.5 * near_limit
            + 20.0 * (clearance - CLEARANCE_M).min(0.0) / CLEARANCE_M
            + 10.0 * (low - HEIGHT_M).min(0.0) / HEIGHT_M
            + 3.0 * down
            - 4.0 * (out - 0.55).powi(2)
            - 4.0 * height * height
    }

    /// Least clearance between spheres of the arm, and from the ground \[m\].
    fn clearance(&self, kinematics: &Kinematics<N>) -> [f64; 2] {
        let points = self.points.as_slice();
        let centre = |i: usize| point_position(kinematics, points[i].joint, points[i].centre);
        let own = self
            .pairs
            .watched
            .iter()
            .map(|&(i, j)| centre(i).distance(centre(j)) - points[i].radius - points[j].radius);
        let above = (0..points.len())
            .filter(|&i| !self.grounded[i])
            .filter_map(|i| Some(centre(i).dot(self.up) - points[i].radius - self.ground_m?));
        [own.fold(1.0, f64::min), above.fold(1.0, f64::min)]
    }

    /// Of each joint the range around home \[rad or m\] beyond which the arm, with the other joints at home, comes near
    /// a singular configuration, and no more than half a turn to either side; `None` where its limits are nearer.
    pub(super) fn working_range(&self, home: &SVector<f64, N>) -> [Option<[f64; 2]>; N] {
        let mut kinematics = Kinematics::new();
        let reach = self.reach(&mut kinematics);
        forward_kinematics(self.chain, home, &mut kinematics);
        let least = SINGULAR_FRACTION * self.manipulability(&kinematics, reach);
        std::array::from_fn(|i| {
            if self.chain.joint_kind(i) != Some(JointKind::Revolute) {
                return None;
            }
            let [lower, upper] = [self.range[0][i], self.range[1][i]];
            let mut end = |direction: f64| {
                let mut q = *home;
                let room = PI.min(if direction < 0.0 { home[i] - lower } else { upper - home[i] });
                let steps = (room / STEP) as usize;
                let mut clear = 0.0;
                for k in 1..=steps {
                    q[i] = home[i] + direction * STEP * k as f64;
                    forward_kinematics(self.chain, &q, &mut kinematics);
                    if self.manipulability(&kinematics, reach) < least && STEP * k as f64 > ROOM {
                        break;
                    }
                    clear = STEP * k as f64;
                }
                // Where nothing but the limit is in the way, it is left to that.
                if clear + 2.0 * STEP >= room && room < PI {
                    direction * f64::INFINITY
                } else {
                    home[i] + direction * clear
                }
            };
            let [from, to] = [end(-1.0), end(1.0)];
            let within = [from.max(lower), to.min(upper)];
            let bounded = from.is_finite() || to.is_finite();
            bounded.then_some(within.map(|end| (end * 100.0).round() / 100.0))
        })
    }

    /// √det(J Jᵀ) over the coordinates that the skill moves, with lengths in units of the reach \[m\]; of fewer
    /// joints √det(Jᵀ J).
    fn manipulability(&self, kinematics: &Kinematics<N>, reach: f64) -> f64 {
        let jacobian = &kinematics.tool_jacobian;
        let scaled = DMatrix::from_fn(self.moved.len(), N, |i, column| {
            let row = self.moved[i];
            jacobian[(row, column)] / if row < 3 { reach } else { 1.0 }
        });
        scaled.svd(false, false).singular_values.iter().product::<f64>().abs()
    }
}
