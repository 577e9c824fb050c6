//! A PD controller that tracks a recorded path.

use glam::DVec3;
use tprmp_learner::certify::policy::{Body, DesiredMotion, MotionPolicy};
use tprmp_spatial::MovingPose;

use crate::body::point_motion;
use crate::path::sampled;

/// Stiffness of the one that is done right [1/s²]; critically damped.
const STIFFNESS_1_S2: f64 = 100.0;
/// Gains of the published one [1/s², 1/s]: a damping ratio of 0.05.
const PUBLISHED_GAINS: [f64; 2] = [1.0, 0.1];
/// Its path point goes on by one sample at 50 Hz, a sample being 1/100 s: half the speed; and it is
/// held between. Its velocity is not fed forward.
const PUBLISHED_SPEED: f64 = 0.5;
const PUBLISHED_HOLD_S: f64 = 0.02;

/// A PD controller.
#[derive(Clone, Debug)]
pub struct Pd {
    points: Vec<DVec3>,
    sampling_time_s: f64,
    as_published: bool,
}

impl Pd {
    /// Tracks these points, critically damped, with the path's velocity and acceleration fed
    /// forward; or as the thesis' baseline does.
    #[must_use]
    pub fn new(points: Vec<DVec3>, sampling_time_s: f64, as_published: bool) -> Self {
        Self { points, sampling_time_s, as_published }
    }
}

impl MotionPolicy for Pd {
    fn evaluate(&mut self, _frames: &[MovingPose], body: &Body) -> DesiredMotion {
        let away = |p: DVec3| p - body.pose.position;
        if self.as_published {
            let held_s = (body.time_s / PUBLISHED_HOLD_S).floor() * PUBLISHED_HOLD_S;
            let time_s = held_s * PUBLISHED_SPEED;
            let [p, ..] = sampled(&self.points, self.sampling_time_s, time_s);
            let [stiffness, damping] = PUBLISHED_GAINS;
            return point_motion(away(p) * stiffness - body.velocity.linear * damping);
        }
        let [p, v, a] = sampled(&self.points, self.sampling_time_s, body.time_s);
        let damping = 2.0 * STIFFNESS_1_S2.sqrt();
        point_motion(a + away(p) * STIFFNESS_1_S2 + (v - body.velocity.linear) * damping)
    }
}
