//! Dynamic movement primitives  [Ijspeert et al. 2013, in the form of Park et al. 2008].
//!
//! ```text
//! τ v̇ = K (g − x) − D v − K (g − x₀) s + K f(s)        τ ẋ = v        τ ṡ = −α s
//! f(s) = Σ w_i ψ_i(s) s / Σ ψ_i(s),   ψ_i(s) = exp(−h_i (s − c_i)²)
//! ```
//!
//! In this form a shift of start or goal deforms the path smoothly, and nothing is divided by g − x₀. The
//! forcing term is the weighted least-squares fit to all demonstrations; rotations of frames do not
//! enter.

use glam::DVec3;
use tprmp_learner::certify::policy::{Body, DesiredMotion, MotionPolicy};
use tprmp_learner::demonstration::{Demonstration, mean_duration_s};
use tprmp_spatial::MovingPose;

use crate::body::point_motion;
use crate::path::{positions, sampled};

/// K and D = 2 √K, critically damped; times as fractions of the duration.
const STIFFNESS: f64 = 150.0;
/// α: s falls to exp(−α) by the end.
const DECAY: f64 = 4.0;
/// Basis functions.
const BASIS: usize = 40;

/// A primitive.
#[derive(Clone, Debug)]
pub struct Dmp {
    /// τ [s].
    duration_s: f64,
    centres: Vec<f64>,
    widths: Vec<f64>,
    weights: Vec<DVec3>,
}

impl Dmp {
    /// Learns from demonstrations.
    ///
    /// # Panics
    /// Without demonstrations.
    #[must_use]
    pub fn learn(demonstrations: &[Demonstration]) -> Self {
        let centre = |i: usize| (-DECAY * i as f64 / (BASIS - 1) as f64).exp();
        let centres: Vec<f64> = (0..BASIS).map(centre).collect();
        let width = |i: usize| {
            let next = centres[(i + 1).min(BASIS - 1)] - centres[(i + 1).min(BASIS - 1) - 1];
            1.0 / (next * next)
        };
        let widths: Vec<f64> = (0..BASIS).map(width).collect();
        let damping = 2.0 * STIFFNESS.sqrt();
        let (mut right, mut left) = (vec![DVec3::ZERO; BASIS], vec![0.0; BASIS]);
        for demonstration in demonstrations {
            let points = positions(&demonstration.poses);
            let (first, goal) = (points[0], points[points.len() - 1]);
            let tau = demonstration.duration_s();
            for k in 0..points.len() {
                let time_s = k as f64 * demonstration.sampling_time_s;
                let [x, v, a] = sampled(&points, demonstration.sampling_time_s, time_s);
                let s = (-DECAY * time_s / tau).exp();
                let wanted = a * (tau * tau) + v * (damping * tau) - (goal - x) * STIFFNESS
                    + (goal - first) * (STIFFNESS * s);
                for i in 0..BASIS {
                    let psi = (-widths[i] * (s - centres[i]).powi(2)).exp();
                    right[i] += wanted / STIFFNESS * (psi * s);
                    left[i] += psi * s * s;
                }
            }
        }
        let weights = right.iter().zip(&left).map(|(r, l)| *r / (l + 1e-12)).collect();
        let duration_s = mean_duration_s(demonstrations);
        Self { duration_s, centres, widths, weights }
    }

    fn force(&self, s: f64) -> DVec3 {
        let (mut sum, mut psis) = (DVec3::ZERO, 1e-12);
        for i in 0..BASIS {
            let psi = (-self.widths[i] * (s - self.centres[i]).powi(2)).exp();
            sum += self.weights[i] * psi;
            psis += psi;
        }
        sum * (s / psis)
    }

    /// A primitive in use; the goal lies at `goal_offset` from the goal frame, not rotated with it.
    #[must_use]
    pub fn instance(&self, start: DVec3, goal_offset: DVec3) -> DmpInstance<'_> {
        DmpInstance { dmp: self, start, goal_offset }
    }
}

/// A primitive in use.
#[derive(Clone, Debug)]
pub struct DmpInstance<'a> {
    dmp: &'a Dmp,
    start: DVec3,
    goal_offset: DVec3,
}

impl MotionPolicy for DmpInstance<'_> {
    fn evaluate(&mut self, frames: &[MovingPose], body: &Body) -> DesiredMotion {
        let tau = self.dmp.duration_s;
        let s = (-DECAY * body.time_s / tau).exp();
        let goal = frames[1].pose.position + self.goal_offset;
        let damping = 2.0 * STIFFNESS.sqrt();
        let wanted = (goal - body.pose.position) * STIFFNESS
            - body.velocity.linear * (damping * tau)
            - (goal - self.start) * (STIFFNESS * s)
            + self.dmp.force(s) * STIFFNESS;
        point_motion(wanted / (tau * tau))
    }
}
