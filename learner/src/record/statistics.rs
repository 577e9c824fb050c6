//! Robust statistics of poses: how noisy they are, and where their middle lies.
//!
//! Everything is computed of *offsets* from one of the poses, in the body axes of its orientation:
//! q = q̄ exp(r). Noise is taken to be white; what is not, the bounds have to cover.

use glam::{DQuat, DVec3};
use tprmp_spatial::Pose;
use tprmp_spatial::rotation::rotation_vector;

/// Standard deviation of a normal distribution over the median of its absolute values, 1/Φ⁻¹(¾).
const DEVIATION_PER_MEDIAN: f64 = 1.482_602_218_505_602;
/// Samples that an estimate of noise looks at: enough for a tenth of it, and a bound on the work.
pub(super) const NOISE_SAMPLES: usize = 300;
/// What lies farther than so many standard deviations from the median is no part of a mean.
const OUTLIER_DEVIATIONS: f64 = 5.0;
/// Rounds of the mean on the sphere. Each cubes the angle that is left, so that two do for noise.
const MEAN_ROUNDS: u32 = 4;

/// A length and an angle: of a displacement, a bound or a standard deviation; or both over a time.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Extent {
    /// Of the position [m] or [m/s].
    pub(super) m: f64,
    /// Of the orientation [rad] or [rad/s].
    pub(super) rad: f64,
}

impl Extent {
    pub(super) fn scaled(self, by: f64) -> Self {
        Self { m: by * self.m, rad: by * self.rad }
    }

    pub(super) fn plus(self, other: Self) -> Self {
        Self { m: self.m + other.m, rad: self.rad + other.rad }
    }

    pub(super) fn max(self, other: Self) -> Self {
        Self { m: self.m.max(other.m), rad: self.rad.max(other.rad) }
    }

    /// Whether neither length nor angle is beyond those of `bound`.
    pub(super) fn is_within(self, bound: Self) -> bool {
        self.m <= bound.m && self.rad <= bound.rad
    }
}

/// From one pose to another.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Offset {
    /// Displacement in the base frame [m].
    pub(super) position: DVec3,
    /// Rotation vector r in q = q̄ exp(r) [rad].
    pub(super) rotation: DVec3,
}

impl Offset {
    pub(super) fn between(from: &Pose, to: &Pose) -> Self {
        let position = to.position - from.position;
        if from.orientation == to.orientation {
            // Without what is rounded off.
            return Self { position, rotation: DVec3::ZERO };
        }
        let rotation = rotation_vector(from.orientation.conjugate() * to.orientation);
        Self { position, rotation }
    }

    pub(super) fn plus(self, other: Self) -> Self {
        Self { position: self.position + other.position, rotation: self.rotation + other.rotation }
    }

    pub(super) fn minus(self, other: Self) -> Self {
        self.plus(other.scaled(-1.0))
    }

    pub(super) fn scaled(self, by: f64) -> Self {
        Self { position: by * self.position, rotation: by * self.rotation }
    }

    pub(super) fn extent(self) -> Extent {
        Extent { m: self.position.length(), rad: self.rotation.length() }
    }

    fn axes(&self) -> [f64; 6] {
        let ([x, y, z], [a, b, c]) = (self.position.to_array(), self.rotation.to_array());
        [x, y, z, a, b, c]
    }

    fn from_axes([x, y, z, a, b, c]: [f64; 6]) -> Self {
        Self { position: DVec3::new(x, y, z), rotation: DVec3::new(a, b, c) }
    }

    fn applied_to(self, from: &Pose) -> Pose {
        let position = from.position + self.position;
        if self.rotation == DVec3::ZERO {
            return Pose { position, ..*from };
        }
        let rotation = DQuat::from_scaled_axis(self.rotation);
        Pose { position, orientation: (from.orientation * rotation).normalize() }
    }
}

/// Standard deviation of the white noise on numbers that follow each other, in their unit.
///
/// From the median of their third differences x₃ − 3x₂ + 3x₁ − x₀, whose variance is 20 σ²: a smooth
/// motion does not enter, and neither does a jump. 0 for fewer than four numbers.
pub(super) fn noise(numbers: &[f64]) -> f64 {
    let newest = &numbers[numbers.len().saturating_sub(NOISE_SAMPLES)..];
    let third = |x: &[f64]| (x[3] - 3.0 * x[2] + 3.0 * x[1] - x[0]).abs();
    let mut differences: Vec<f64> = newest.windows(4).map(third).collect();
    if differences.is_empty() {
        return 0.0;
    }
    DEVIATION_PER_MEDIAN * median(&mut differences) / 20.0_f64.sqrt()
}

/// Standard deviation of the noise on poses that follow each other, of the noisiest axis.
pub(super) fn pose_noise(offsets: &[Offset]) -> Extent {
    let newest = &offsets[offsets.len().saturating_sub(NOISE_SAMPLES)..];
    let [x, y, z, a, b, c] = std::array::from_fn(|axis| {
        let numbers: Vec<f64> = newest.iter().map(|offset| offset.axes()[axis]).collect();
        noise(&numbers)
    });
    Extent { m: x.max(y).max(z), rad: a.max(b).max(c) }
}

/// The mean of what lies within `radius`, and what `noise` adds to it, of the median of each axis,
/// positions and rotations apart; without offsets, none.
pub(super) fn centre(offsets: &[Offset], noise: Extent, radius: Extent) -> Option<Offset> {
    if offsets.is_empty() {
        return None;
    }
    let median = Offset::from_axes(std::array::from_fn(|axis| {
        let mut numbers: Vec<f64> = offsets.iter().map(|offset| offset.axes()[axis]).collect();
        median(&mut numbers)
    }));
    let radius = radius.plus(noise.scaled(OUTLIER_DEVIATIONS));
    let positions = offsets.iter().map(|offset| offset.position);
    let rotations = offsets.iter().map(|offset| offset.rotation);
    Some(Offset {
        position: mean_within(positions, median.position, radius.m),
        rotation: mean_within(rotations, median.rotation, radius.rad),
    })
}

/// The mean of the vectors within a radius of their median; that itself where there are none, as it
/// need not be near any of them.
fn mean_within(vectors: impl Iterator<Item = DVec3>, median: DVec3, radius: f64) -> DVec3 {
    let inliers = vectors.filter(|v| v.distance(median) <= radius);
    let (sum, count) = inliers.fold((DVec3::ZERO, 0), |(sum, count), v| (sum + v, count + 1));
    if count == 0 { median } else { sum / f64::from(count) }
}

/// The mean of poses as [`centre`] has it, that of the orientations on the sphere of quaternions:
/// where their rotation vectors add up to zero. Without poses, none.
pub(super) fn mean_pose(poses: &[Pose], noise: Extent, radius: Extent) -> Option<Pose> {
    let mut mean = *poses.get(poses.len() / 2)?;
    for _ in 0..MEAN_ROUNDS {
        let offsets: Vec<Offset> = poses.iter().map(|p| Offset::between(&mean, p)).collect();
        mean = centre(&offsets, noise, radius)?.applied_to(&mean);
    }
    Some(mean)
}

/// The upper one of both medians for an even count; the numbers are put in another order.
///
/// # Panics
/// Without numbers.
fn median(numbers: &mut [f64]) -> f64 {
    let middle = numbers.len() / 2;
    *numbers.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::noisy::Gaussian;

    #[test]
    fn noise_is_found_beside_motion_and_a_jump_and_none_without() {
        for seed in 0..20 {
            let mut gaussian = Gaussian::new(seed);
            let motion = |i: usize| {
                let jump = if i > 200 { 5.0 } else { 0.0 };
                (0.02 * i as f64).sin() + jump
            };
            let numbers: Vec<f64> = (0..400).map(|i| motion(i) + 0.003 * gaussian.next()).collect();
            let found = noise(&numbers);
            assert!((0.0024..0.0036).contains(&found), "seed {seed}: {found}");
            let clean: Vec<f64> = (0..400).map(motion).collect();
            assert!(noise(&clean) < 1e-5, "{}", noise(&clean));
        }
        assert_eq!(noise(&[1.0, 2.0, 5.0]), 0.0);
    }

    #[test]
    fn the_mean_pose_lies_in_the_middle_whatever_the_signs_and_a_flip_is_left_out() {
        let truth = Pose {
            position: DVec3::new(0.5, -0.2, 0.1),
            orientation: DQuat::from_scaled_axis(DVec3::new(0.4, 2.9, -0.3)),
        };
        let noise = Extent { m: 0.003, rad: 0.005 };
        let radius = Extent { m: 0.005, rad: 0.05 };
        for seed in 0..20 {
            let mut gaussian = Gaussian::new(seed);
            let mut poses: Vec<Pose> = (0..100)
                .map(|i| {
                    let pose = gaussian.pose(&truth, noise);
                    let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
                    Pose { orientation: pose.orientation * sign, ..pose }
                })
                .collect();
            let flip = DQuat::from_rotation_x(std::f64::consts::PI);
            poses[7] = Pose { orientation: truth.orientation * flip, ..truth };
            poses[9].position.x += 0.4;
            let mean = mean_pose(&poses, noise, radius).unwrap();
            let error = Offset::between(&truth, &mean).extent();
            // Four standard errors of each axis, along the diagonal.
            assert!(error.m < 0.7 * noise.m && error.rad < 0.7 * noise.rad, "{seed}: {error:?}");
            assert!(mean.orientation.is_normalized());
        }
        assert_eq!(mean_pose(&[], noise, radius), None);
    }

    #[test]
    fn equal_poses_are_their_mean_to_the_last_bit() {
        let orientation = DQuat::from_xyzw(0.1, 0.7, -0.3, 0.4).normalize();
        let pose = Pose { position: DVec3::new(0.1, 0.7, -0.3), orientation };
        assert_eq!(mean_pose(&[pose; 7], Extent::default(), Extent::default()), Some(pose));
    }
}
