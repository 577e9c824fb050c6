//! A TP-GMM with minimal-intervention tracking by a linear quadratic regulator  [Calinon 2016].
//!
//! The product of the frames' Gaussians gives means μ̂_k and covariances Σ̂_k; at each step of the
//! demonstrated duration the one of that phase is active. The point, a double integrator, minimises
//!
//! ```text
//! Σ_t (x_t − μ̂_k(t))ᵀ Σ̂⁻¹_k(t) (x_t − μ̂_k(t)) + r uᵀu
//! ```
//!
//! by the backward Riccati recursion, anew whenever a frame has moved; afterwards the last gain holds
//! it at the goal.

use glam::DVec3;
use nalgebra::{Matrix2, Matrix4, Matrix4x2, SMatrix, Vector2, Vector4};
use tprmp_learner::certify::policy::{Body, DesiredMotion, MotionPolicy};
use tprmp_model::skill_model::SkillModel;
use tprmp_spatial::{MovingPose, Pose};

use crate::body::point_motion;

/// r, cost of an acceleration, at a scale of one [s⁴/m⁴ × m²/m²].
const EFFORT: f64 = 0.1;
/// Step of the recursion [s].
const STEP_S: f64 = 0.02;
/// Steps that the last Gaussian is held for beyond the duration.
const HOLD_STEPS: usize = 150;
/// Added to the covariances, at a scale of one [m²]: how exactly the path has to be met.
const PRECISION_M2: f64 = 1e-4;
/// A frame that moved by less has not moved [m].
const MOVED_M: f64 = 1e-9;

/// What the regulator tracks: planar Gaussians in each frame, and when each is active.
#[derive(Clone, Debug)]
pub struct Lqr {
    /// Mean [m] and covariance [m²] in each frame, a component.
    components: Vec<Vec<(Vector2<f64>, Matrix2<f64>)>>,
    /// Mean phase of each component.
    phases: Vec<f64>,
    duration_s: f64,
    /// [`EFFORT`] and [`PRECISION_M2`] at the skill's scale.
    effort: f64,
    precision_m2: f64,
}

impl Lqr {
    /// Takes the mixture of a planar model whose demonstrations take `duration_s` on average.
    ///
    /// * `scale`  of the data set
    ///
    /// # Panics
    /// When the model is not planar.
    #[must_use]
    pub fn new(model: &SkillModel, covariance_scale: f64, duration_s: f64, scale: f64) -> Self {
        let count = model.gaussians.len();
        let component = |k: usize| {
            let each = model.frames.iter().map(|frame| {
                let g = &frame.gaussians[k];
                let mean = Vector2::new(g.position_m[0], g.position_m[1]);
                let covariance = Matrix2::from_fn(|i, j| g.covariance[i][j] / covariance_scale);
                (mean, covariance)
            });
            each.collect()
        };
        let components = (0..count).map(component).collect();
        let phases = model.gaussians.iter().map(|g| g.phase).collect();
        let (effort, precision_m2) = (EFFORT / scale.powi(2), PRECISION_M2 * scale.powi(2));
        Self { components, phases, duration_s, effort, precision_m2 }
    }

    /// Product of the frames' Gaussians  [thesis eq. 3.6]: mean and precision.
    fn product(&self, k: usize, frames: &[MovingPose]) -> (Vector2<f64>, Matrix2<f64>) {
        let (mut precision, mut weighted) = (Matrix2::zeros(), Vector2::zeros());
        for ((mean, covariance), frame) in self.components[k].iter().zip(frames) {
            let Pose { position, orientation } = frame.pose;
            let [x, y] = [DVec3::X, DVec3::Y].map(|axis| orientation * axis);
            let rotation = Matrix2::new(x.x, y.x, x.y, y.y);
            let in_world = rotation * covariance * rotation.transpose()
                + Matrix2::identity() * self.precision_m2;
            let own = in_world.try_inverse().unwrap_or_else(Matrix2::identity);
            precision += own;
            weighted += own * (rotation * mean + Vector2::new(position.x, position.y));
        }
        let covariance = precision.try_inverse().unwrap_or_else(Matrix2::identity);
        (covariance * weighted, precision)
    }

    /// A regulator in use.
    #[must_use]
    pub fn instance(&self) -> LqrInstance<'_> {
        LqrInstance { lqr: self, frames: Vec::new(), gains: Vec::new() }
    }

    /// Gains and feed-forward of every step: u = h − G (x, ẋ).
    fn gains(&self, frames: &[MovingPose]) -> Vec<(SMatrix<f64, 2, 4>, Vector2<f64>)> {
        let products: Vec<_> = (0..self.phases.len()).map(|k| self.product(k, frames)).collect();
        let steps = (self.duration_s / STEP_S).ceil() as usize;
        let active = |t: usize| {
            let phase = t as f64 / steps as f64;
            let between = |k: usize| 0.5 * (self.phases[k] + self.phases[k + 1]);
            (0..self.phases.len() - 1).filter(|k| between(*k) < phase).count()
        };
        let h = STEP_S;
        let mut a = Matrix4::identity();
        let mut b = Matrix4x2::zeros();
        for i in 0..2 {
            a[(i, i + 2)] = h;
            b[(i, i)] = 0.5 * h * h;
            b[(i + 2, i)] = h;
        }
        let effort = Matrix2::identity() * self.effort;
        let cost = |t: usize| {
            let (mean, precision) = products[active(t.min(steps))];
            let mut q = Matrix4::zeros();
            q.fixed_view_mut::<2, 2>(0, 0).copy_from(&precision);
            (q, q * Vector4::new(mean.x, mean.y, 0.0, 0.0))
        };
        // Cost to go zᵀP z − 2 pᵀz.
        let (mut big, mut small) = cost(steps + HOLD_STEPS);
        let mut gains = Vec::with_capacity(steps + HOLD_STEPS);
        for t in (0..steps + HOLD_STEPS).rev() {
            let inner = effort + b.transpose() * big * b;
            let inverse = inner.try_inverse().unwrap_or_else(Matrix2::identity);
            let gain: SMatrix<f64, 2, 4> = inverse * b.transpose() * big * a;
            let forward: Vector2<f64> = inverse * b.transpose() * small;
            gains.push((gain, forward));
            let closed = a - b * gain;
            let (q, towards) = cost(t);
            small = closed.transpose() * small + towards;
            big = a.transpose() * big * closed + q;
        }
        gains.reverse();
        gains
    }
}

/// A regulator in use.
#[derive(Clone, Debug)]
pub struct LqrInstance<'a> {
    lqr: &'a Lqr,
    frames: Vec<Pose>,
    gains: Vec<(SMatrix<f64, 2, 4>, Vector2<f64>)>,
}

impl MotionPolicy for LqrInstance<'_> {
    fn evaluate(&mut self, frames: &[MovingPose], body: &Body) -> DesiredMotion {
        let moved = self.frames.len() != frames.len()
            || self.frames.iter().zip(frames).any(|(before, frame)| {
                (before.position - frame.pose.position).length() > MOVED_M
                    || before.rotation_from(&frame.pose).length() > MOVED_M
            });
        if moved {
            self.frames = frames.iter().map(|frame| frame.pose).collect();
            self.gains = self.lqr.gains(frames);
        }
        // In the hold the gain of its middle serves for ever.
        let last = self.gains.len() - HOLD_STEPS / 2;
        let (gain, forward) = self.gains[((body.time_s / STEP_S) as usize).min(last)];
        let (x, v) = (body.pose.position, body.velocity.linear);
        let u = forward - gain * Vector4::new(x.x, x.y, v.x, v.y);
        point_motion(DVec3::new(u.x, u.y, 0.0))
    }

    fn goal(&mut self, frames: &[MovingPose]) -> Option<Pose> {
        let (mean, _) = self.lqr.product(self.lqr.phases.len() - 1, frames);
        let position = DVec3::new(mean.x, mean.y, 0.0);
        Some(Pose { position, orientation: frames[1].pose.orientation })
    }
}
