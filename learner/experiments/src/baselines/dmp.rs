//! Dynamic movement primitives  [Ijspeert et al. 2013, in the form of Park et al. 2008].
//!
//! ```text
//! τ v̇ = K (g − x) − D v − K (g − x₀) s + K f(s)        τ ẋ = v        τ ṡ = −α s
//! f(s) = Σ w_i ψ_i(s) s / Σ ψ_i(s),   ψ_i(s) = exp(−h_i (s − c_i)²)
//! ```
//!
//! In this form a shift of start or goal bends the way smoothly, and nothing is divided by g − x₀. The
//! forcing term is the weighted least-squares fit to all demonstrations; frames that turn do not
//! enter.

use glam::DVec3;

use super::sampled;
use crate::follower::{Follower, Moment, Wish, point_wish};
use tprmp_learner::demonstration::Demonstration;

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
        let duration = |d: &Demonstration| (d.poses.len() - 1) as f64 * d.sampling_time_s;
        let duration_s =
            demonstrations.iter().map(duration).sum::<f64>() / demonstrations.len() as f64;
        let centre = |i: usize| (-DECAY * i as f64 / (BASIS - 1) as f64).exp();
        let centres: Vec<f64> = (0..BASIS).map(centre).collect();
        let width = |i: usize| {
            let next = centres[(i + 1).min(BASIS - 1)] - centres[(i + 1).min(BASIS - 1) - 1];
            1.0 / (next * next)
        };
        let widths: Vec<f64> = (0..BASIS).map(width).collect();
        let damping = 2.0 * STIFFNESS.sqrt();
        let (mut right, mut left) = (vec![DVec3::ZERO; BASIS], vec![0.0; BASIS]);
        for shown in demonstrations {
            let points: Vec<DVec3> = shown.poses.iter().map(|p| p.position).collect();
            let (first, goal) = (points[0], points[points.len() - 1]);
            let tau = duration(shown);
            for k in 0..points.len() {
                let time_s = k as f64 * shown.sampling_time_s;
                let [x, v, a] = sampled(&points, shown.sampling_time_s, time_s);
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

    /// A primitive on its way; the goal lies at `goal_offset` from the goal frame, not turned with it.
    #[must_use]
    pub fn follower(&self, start: DVec3, goal_offset: DVec3) -> DmpFollower<'_> {
        DmpFollower { dmp: self, start, goal_offset }
    }
}

/// A primitive on its way.
#[derive(Clone, Debug)]
pub struct DmpFollower<'a> {
    dmp: &'a Dmp,
    start: DVec3,
    goal_offset: DVec3,
}

impl Follower for DmpFollower<'_> {
    fn evaluate(&mut self, now: &Moment) -> Wish {
        let tau = self.dmp.duration_s;
        let s = (-DECAY * now.time_s / tau).exp();
        let goal = now.frames[1].pose.position + self.goal_offset;
        let damping = 2.0 * STIFFNESS.sqrt();
        let wanted = (goal - now.pose.position) * STIFFNESS
            - now.velocity.linear * (damping * tau)
            - (goal - self.start) * (STIFFNESS * s)
            + self.dmp.force(s) * STIFFNESS;
        point_wish(wanted / (tau * tau))
    }
}
