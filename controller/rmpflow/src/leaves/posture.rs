//! The joints where the task leaves them free: a damping and a posture.

use nalgebra::{SMatrix, SVector};

use crate::leaves::range::{Report, not_negative};
use crate::natural::Natural;

/// Damping in joint space: M = m I, f = −d m q̇. It keeps the root's metric positive definite near
/// singular configurations.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct JointDamping {
    /// m \[kg m²\] for revolute joints, \[kg\] for prismatic ones.
    pub inertia: f64,
    /// d \[1/s\].
    pub damping_1_s: f64,
}

impl JointDamping {
    /// Reports parameters outside their ranges.
    pub fn check(&self, report: &mut Report<'_>) {
        not_negative("inertia", self.inertia, report);
        not_negative("damping_1_s", self.damping_1_s, report);
    }

    /// The leaf at joint velocity q̇ \[rad/s or m/s\].
    #[must_use]
    pub fn evaluate<const N: usize>(&self, velocity: &SVector<f64, N>) -> Natural<N> {
        Natural {
            force: velocity * (-self.damping_1_s * self.inertia),
            metric: SMatrix::identity() * self.inertia,
        }
    }
}

/// Pulls the joints to a posture, where the task leaves them free.
///
/// M = m I, Φ = m k s Σ(√(e² + s²) − s), e = q − q₀, B = d M. The pull saturates at m k s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posture<const N: usize> {
    /// q₀ \[rad or m\].
    pub position: SVector<f64, N>,
    /// m \[kg m² or kg\].
    pub inertia: f64,
    /// k \[1/s²\].
    pub stiffness_1_s2: f64,
    /// d \[1/s\].
    pub damping_1_s: f64,
    /// s \[rad or m\].
    pub saturation: f64,
}

impl<const N: usize> Posture<N> {
    /// The leaf at joint position q and velocity q̇.
    #[must_use]
    pub fn evaluate(&self, q: &SVector<f64, N>, qd: &SVector<f64, N>) -> Natural<N> {
        let s = self.saturation;
        let pull = (q - self.position).map(|e| self.stiffness_1_s2 * s * e / e.hypot(s));
        Natural {
            force: (pull + qd * self.damping_1_s) * -self.inertia,
            metric: SMatrix::identity() * self.inertia,
        }
    }

    /// Φ + ½ q̇ᵀMq̇.
    #[must_use]
    pub fn energy(&self, q: &SVector<f64, N>, qd: &SVector<f64, N>) -> f64 {
        let s = self.saturation;
        let potential: f64 = (q - self.position).iter().map(|e| e.hypot(s) - s).sum();
        self.inertia * (self.stiffness_1_s2 * s * potential + 0.5 * qd.norm_squared())
    }
}
