//! Limits of the joints: of position and of speed.

use nalgebra::SVector;

use crate::leaves::barrier::Barrier;
use crate::leaves::range::{Report, not_negative, positive};
use crate::natural::Natural;

/// Keeps joints inside their position limits: the distance from a limit is a clearance, kept by the
/// leaf of [`Barrier`] with joint units in place of metres.
///
/// The inertia grows only while a joint approaches its limit, so that it is free to leave it
/// [Cheng et al. 2019, RMPflow, appendix on joint limits, in the form of eq. 68].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits<const N: usize> {
    /// Lower limits \[rad or m\]; −∞ without.
    pub lower: SVector<f64, N>,
    /// Upper limits \[rad or m\]; +∞ without.
    pub upper: SVector<f64, N>,
    /// How the distance is kept.
    pub leaf: Barrier,
}

impl<const N: usize> JointLimits<N> {
    /// Adds the leaf at joint position q and velocity q̇.
    pub fn add(&self, q: &SVector<f64, N>, qd: &SVector<f64, N>, root: &mut Natural<N>) {
        for i in 0..N {
            for (distance, side) in [(q[i] - self.lower[i], 1.0), (self.upper[i] - q[i], -1.0)] {
                if let Some(leaf) = self.leaf.evaluate(distance, side * qd[i]) {
                    root.force[i] += side * leaf.force[0];
                    root.metric[(i, i)] += leaf.metric[(0, 0)];
                }
            }
        }
    }

    /// ½ G ḋ² + Φ of all limits.
    #[must_use]
    pub fn energy(&self, q: &SVector<f64, N>, qd: &SVector<f64, N>) -> f64 {
        (0..N)
            .map(|i| {
                self.leaf.energy(q[i] - self.lower[i], qd[i])
                    + self.leaf.energy(self.upper[i] - q[i], -qd[i])
            })
            .sum()
    }
}

/// Keeps a joint slower than its limit v: an inertia that grows without bound towards the limit, and
/// damping.
///
/// ```text
/// z = (|q̇|/v − r)/(1 − r) above 0,   G(q̇) = m z²/(1 − z),   M = G + ½ q̇ ∂G/∂q̇,   f = −η G q̇
/// ```
///
/// a geometric dynamical system whose metric depends on the velocity alone: ξ = 0, and ½ G q̇² falls
/// by the damping [Cheng et al. 2019, RMPflow, eq. 20 and 21]. The limit itself has z = 1; z is held
/// below that, so that a joint that is too fast is braked.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct SpeedBarrier {
    /// r: fraction of the largest speed from which on the leaf acts.
    pub free_fraction: f64,
    /// m \[kg m² or kg\].
    pub inertia: f64,
    /// η \[1/s\].
    pub damping_1_s: f64,
}

/// Keeps joints slower than their limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSpeedLimits<const N: usize> {
    /// v: largest speeds \[rad/s or m/s\].
    pub speed_max: SVector<f64, N>,
    /// How they are kept.
    pub leaf: SpeedBarrier,
}

/// Largest z.
const EXCESS_MAX: f64 = 0.98;

impl SpeedBarrier {
    /// Reports parameters outside their ranges.
    pub fn check(&self, report: &mut Report<'_>) {
        if !(self.free_fraction > 0.0 && self.free_fraction < 1.0) {
            report("free_fraction", "a fraction above 0 and below 1", &self.free_fraction);
        }
        positive("inertia", self.inertia, report);
        not_negative("damping_1_s", self.damping_1_s, report);
    }

    /// G and ½ q̇ ∂G/∂q̇ at a speed of which `speed_max` is the largest.
    fn metric(&self, speed: f64, speed_max: f64) -> (f64, f64) {
        let span = 1.0 - self.free_fraction;
        let relative = (speed / speed_max).abs();
        let z = ((relative - self.free_fraction) / span).clamp(0.0, EXCESS_MAX);
        let slope = if z < EXCESS_MAX { z * (2.0 - z) / ((1.0 - z) * (1.0 - z)) } else { 0.0 };
        (self.inertia * z * z / (1.0 - z), 0.5 * self.inertia * slope * relative / span)
    }
}

impl<const N: usize> JointSpeedLimits<N> {
    /// Adds the leaf at joint velocity q̇.
    pub fn add(&self, qd: &SVector<f64, N>, root: &mut Natural<N>) {
        for i in 0..N {
            let (metric, growth) = self.leaf.metric(qd[i], self.speed_max[i]);
            root.metric[(i, i)] += metric + growth;
            root.force[i] -= self.leaf.damping_1_s * metric * qd[i];
        }
    }

    /// ½ Σ G q̇².
    #[must_use]
    pub fn energy(&self, qd: &SVector<f64, N>) -> f64 {
        (0..N).map(|i| 0.5 * self.leaf.metric(qd[i], self.speed_max[i]).0 * qd[i] * qd[i]).sum()
    }
}
