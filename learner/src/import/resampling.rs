//! Poses between recorded samples.

use glam::{DQuat, DVec4};
use tprmp_spatial::Pose;

use super::selection::Interpolation;

/// Shorter sums of quaternions have no direction.
const QUATERNION_MIN: f64 = 0.1;

/// Poses at `steps` + 1 even times from the first to the last of the times [s], which grow.
pub(super) fn resample(
    times_s: &[f64],
    poses: &[Pose],
    steps: usize,
    interpolation: Interpolation,
) -> Vec<Pose> {
    let last = poses.len() - 1;
    let (first_s, duration_s) = (times_s[0], times_s[last] - times_s[0]);
    let curve = Curve::new(times_s, poses);
    let mut i = 0;
    let inner = (1..steps).map(|k| {
        let t = first_s + duration_s * (k as f64 / steps as f64);
        while i + 2 <= last && times_s[i + 1] <= t {
            i += 1;
        }
        let u = ((t - times_s[i]) / (times_s[i + 1] - times_s[i])).clamp(0.0, 1.0);
        match interpolation {
            Interpolation::Linear => curve.linear(i, u),
            Interpolation::Cubic => curve.cubic(i, u),
        }
    });
    std::iter::once(poses[0]).chain(inner).chain([poses[last]]).collect()
}

/// Samples with their fractions at `steps` + 1 even times from the first to the last of the times [s], which
/// grow.
pub(super) fn even_places(times_s: &[f64], steps: usize) -> Vec<f64> {
    let last = times_s.len() - 1;
    let (first_s, duration_s) = (times_s[0], times_s[last] - times_s[0]);
    let mut i = 0;
    let inner = (1..steps).map(|k| {
        let t = first_s + duration_s * (k as f64 / steps as f64);
        while i + 2 <= last && times_s[i + 1] <= t {
            i += 1;
        }
        i as f64 + ((t - times_s[i]) / (times_s[i + 1] - times_s[i])).clamp(0.0, 1.0)
    });
    std::iter::once(0.0).chain(inner).chain([last as f64]).collect()
}

/// Samples as vectors of four: the position and a zero, the quaternion.
struct Curve<'a> {
    times_s: &'a [f64],
    samples: Vec<[DVec4; 2]>,
}

impl<'a> Curve<'a> {
    fn new(times_s: &'a [f64], poses: &[Pose]) -> Self {
        let mut samples: Vec<[DVec4; 2]> = Vec::with_capacity(poses.len());
        for pose in poses {
            // A quaternion and its negative are the same: neighbours on the same side of the sphere.
            let q = DVec4::from(pose.orientation);
            let other_side = samples.last().is_some_and(|[_, before]| before.dot(q) < 0.0);
            samples.push([pose.position.extend(0.0), if other_side { -q } else { q }]);
        }
        Self { times_s, samples }
    }

    /// The straight line between samples i and i + 1 at u in [0, 1], at a constant angular velocity.
    fn linear(&self, i: usize, u: f64) -> Pose {
        let ([p, q], [p_next, q_next]) = (self.samples[i], self.samples[i + 1]);
        let orientation = DQuat::from_vec4(q).slerp(DQuat::from_vec4(q_next), u).normalize();
        Pose { position: p.truncate().lerp(p_next.truncate(), u), orientation }
    }

    /// The cubic between samples i and i + 1 at u in [0, 1].
    fn cubic(&self, i: usize, u: f64) -> Pose {
        let [p, q] = [0, 1].map(|part| self.hermite(part, i, u));
        // Neighbours on one side of the sphere keep the sum away from zero, but for orientations
        // that jump by almost half a revolution.
        let q = if q.length() > QUATERNION_MIN { q } else { self.samples[i][1] };
        Pose { position: p.truncate(), orientation: DQuat::from_vec4(q).normalize() }
    }

    fn hermite(&self, part: usize, i: usize, u: f64) -> DVec4 {
        let span = self.times_s[i + 1] - self.times_s[i];
        let (a, b) = (self.samples[i][part], self.samples[i + 1][part]);
        let [slope_a, slope_b] = [i, i + 1].map(|j| self.slope(part, j) * span);
        let (u2, u3) = (u * u, u * u * u);
        a * (2.0 * u3 - 3.0 * u2 + 1.0)
            + slope_a * (u3 - 2.0 * u2 + u)
            + b * (3.0 * u2 - 2.0 * u3)
            + slope_b * (u3 - u2)
    }

    /// Slope at a sample of the parabola through it and its neighbours.
    fn slope(&self, part: usize, j: usize) -> DVec4 {
        let middle = j.clamp(1, self.samples.len() - 2);
        let [t0, t1, t2] = [middle - 1, middle, middle + 1].map(|k| self.times_s[k]);
        let [x0, x1, x2] = [middle - 1, middle, middle + 1].map(|k| self.samples[k][part]);
        let (before, after) = ((x1 - x0) / (t1 - t0), (x2 - x1) / (t2 - t1));
        // Newton's form, differentiated at t_j.
        let second_difference = (after - before) / (t2 - t0);
        before + second_difference * (2.0 * self.times_s[j] - t0 - t1)
    }
}
