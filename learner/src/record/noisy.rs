//! Noise for tests, from printed seeds.

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_spatial::Pose;

use super::statistics::Extent;

/// Normally distributed numbers.
pub(super) struct Gaussian(ChaCha8Rng);

impl Gaussian {
    pub(super) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Of mean 0 and standard deviation 1, after Box and Muller.
    pub(super) fn next(&mut self) -> f64 {
        let (u, v): (f64, f64) = (1.0 - self.0.random::<f64>(), self.0.random());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| self.next()))
    }

    /// A pose with noise of this standard deviation on each axis.
    pub(super) fn pose(&mut self, truth: &Pose, noise: Extent) -> Pose {
        let rotation = DQuat::from_scaled_axis(noise.rad * self.vector());
        Pose {
            position: truth.position + noise.m * self.vector(),
            orientation: (truth.orientation * rotation).normalize(),
        }
    }
}
