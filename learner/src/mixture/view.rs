//! A coordinate system of the samples, and Gaussians in it.
//!
//! Coordinates are Euclidean ones, orientations, or both: means on S³ are those of the least sum of
//! squared angles, covariances stand in the tangent space at the mean, as rotation vectors in its own
//! axes.

use glam::{DQuat, DVec3};
use nalgebra::{DMatrix, DVector};
use tprmp_spatial::rotation::rotation_vector;

use crate::canonical::means::mean_orientation;

/// Most coordinates of a view: time, position, rotation.
const DIMENSION_MAX: usize = 7;
/// A component without samples must not divide by zero.
pub(crate) const WEIGHT_FLOOR: f64 = 1e-9;

/// A covariance is not positive definite: the samples span numbers that differ too much in size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Singular;

/// The samples in one coordinate system.
#[derive(Clone, Debug)]
pub struct View {
    /// Euclidean coordinates, one column a sample.
    pub euclidean: DMatrix<f64>,
    /// Orientations, one a sample, for views that have them.
    pub orientations: Option<Vec<DQuat>>,
    /// Factor on rotation vectors, which makes them comparable with the other coordinates [1/rad].
    pub rotation_scale: f64,
}

/// A Gaussian of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian {
    /// Mean of the Euclidean coordinates.
    pub mean: DVector<f64>,
    /// Mean orientation.
    pub orientation: Option<DQuat>,
    /// Covariance of (Euclidean coordinates, scaled rotation vector in axes of the mean), without
    /// the regularisation.
    pub covariance: DMatrix<f64>,
}

impl View {
    /// Euclidean coordinates alone, one column a sample.
    #[must_use]
    pub fn euclidean(euclidean: DMatrix<f64>) -> Self {
        Self { euclidean, orientations: None, rotation_scale: 1.0 }
    }

    /// Positions, and orientations with their scale, e.g. of poses seen from a frame.
    #[must_use]
    pub fn poses(
        positions: &[DVec3],
        dimension: usize,
        position_scale: f64,
        orientations: Option<(Vec<DQuat>, f64)>,
    ) -> Self {
        let euclidean =
            DMatrix::from_fn(dimension, positions.len(), |a, i| positions[i][a] * position_scale);
        let (orientations, rotation_scale) = orientations.unzip();
        Self { euclidean, orientations, rotation_scale: rotation_scale.unwrap_or(1.0) }
    }

    /// Samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.euclidean.ncols()
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Dimension of the tangent space.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.euclidean.nrows() + if self.orientations.is_some() { 3 } else { 0 }
    }

    /// Sample i as seen from a mean: Euclidean difference ⊕ s log(μ⁻¹ q).
    fn offset(&self, i: usize, gaussian: &Gaussian, offset: &mut [f64; DIMENSION_MAX]) {
        let n = self.euclidean.nrows();
        let column = self.euclidean.column(i);
        for ((entry, x), mean) in offset.iter_mut().zip(column.iter()).zip(gaussian.mean.iter()) {
            *entry = x - mean;
        }
        if let (Some(all), Some(mean)) = (&self.orientations, gaussian.orientation) {
            let rotation = rotation_vector(mean.conjugate() * all[i]) * self.rotation_scale;
            offset[n..n + 3].copy_from_slice(&rotation.to_array());
        }
    }

    /// Mean and covariance of weighted samples  [thesis eq. 3.5].
    fn gaussian(&self, weights: &[f64]) -> Gaussian {
        let sum = weights.iter().sum::<f64>() + WEIGHT_FLOOR;
        let mut mean = DVector::zeros(self.euclidean.nrows());
        for (sample, weight) in self.euclidean.column_iter().zip(weights) {
            mean.axpy(weight / sum, &sample, 1.0);
        }
        let orientation = self.orientations.as_ref().map(|all| mean_orientation(all, weights));
        let n = self.dimension();
        let mut gaussian = Gaussian { mean, orientation, covariance: DMatrix::zeros(n, n) };
        let mut offset = [0.0; DIMENSION_MAX];
        let mut covariance = DMatrix::zeros(n, n);
        for (i, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
            self.offset(i, &gaussian, &mut offset);
            for a in 0..n {
                let scaled = weight / sum * offset[a];
                for b in 0..=a {
                    covariance[(a, b)] += scaled * offset[b];
                }
            }
        }
        covariance.fill_upper_triangle_with_lower_triangle();
        gaussian.covariance = covariance;
        gaussian
    }

    /// The Gaussians for given responsibilities, its own or those learned in other views.
    #[must_use]
    pub fn gaussians(&self, responsibilities: &DMatrix<f64>) -> Vec<Gaussian> {
        responsibilities.column_iter().map(|weights| self.gaussian(weights.as_slice())).collect()
    }

    /// Adds ln N of every sample (row) under every Gaussian (column).
    ///
    /// # Errors
    /// A regularised covariance is not positive definite.
    pub fn add_log_densities(
        &self,
        gaussians: &[Gaussian],
        regularisation: f64,
        sum: &mut DMatrix<f64>,
    ) -> Result<(), Singular> {
        let n = self.dimension();
        let mut offset = [0.0; DIMENSION_MAX];
        for (k, gaussian) in gaussians.iter().enumerate() {
            let regular = &gaussian.covariance + DMatrix::identity(n, n) * regularisation;
            let factor = regular.cholesky().ok_or(Singular)?.unpack();
            let root: f64 = factor.diagonal().iter().map(|x| x.ln()).sum();
            let constant = -root - 0.5 * n as f64 * std::f64::consts::TAU.ln();
            for i in 0..self.len() {
                self.offset(i, gaussian, &mut offset);
                let mut square = 0.0;
                for a in 0..n {
                    let mut rest = offset[a];
                    for b in 0..a {
                        rest -= factor[(a, b)] * offset[b];
                    }
                    offset[a] = rest / factor[(a, a)];
                    square += offset[a] * offset[a];
                }
                sum[(i, k)] += constant - 0.5 * square;
            }
        }
        Ok(())
    }
}
