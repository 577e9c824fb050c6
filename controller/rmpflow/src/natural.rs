//! Policies in natural form, and the algebra that composes them  [thesis section 3.3].

use nalgebra::{SMatrix, SVector};

/// A policy M ẍ = f on a space of dimension N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Natural<const N: usize> {
    /// f \[task unit of force\].
    pub force: SVector<f64, N>,
    /// M, symmetric, positive semi-definite.
    pub metric: SMatrix<f64, N, N>,
}

/// Why a tree could not be resolved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResolveError {
    /// The metric at the root is not positive definite.
    MetricNotPositiveDefinite,
    /// The force at the root is not finite.
    ForceNotFinite,
}

impl core::fmt::Display for ResolveError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::MetricNotPositiveDefinite => "the metric at the root is not positive definite",
            Self::ForceNotFinite => "the force at the root is not finite",
        })
    }
}

impl core::error::Error for ResolveError {}

impl<const N: usize> Natural<N> {
    /// No policy: zero force, zero metric.
    #[must_use]
    pub fn zero() -> Self {
        Self { force: SVector::zeros(), metric: SMatrix::zeros() }
    }

    /// Pulls a leaf back through its task map and adds it.
    ///
    /// `f += Jᵀ (f_leaf − M_leaf J̇q̇)`, `M += Jᵀ M_leaf J`  [thesis eq. 3.2]
    ///
    /// * `jacobian`  J, K×N
    /// * `drift`     J̇q̇, and what else of the task acceleration is not J q̈, K
    ///
    /// Hot path: no allocation, O(K²N + K N²).
    #[inline]
    pub fn add_pullback<const K: usize>(
        &mut self,
        leaf: &Natural<K>,
        jacobian: &SMatrix<f64, K, N>,
        drift: &SVector<f64, K>,
    ) {
        let metric = &leaf.metric.data.0;
        let columns = &jacobian.data.0;
        let mut rows = [[0.0; N]; K];
        for k in 0..K {
            for i in 0..N {
                rows[k][i] = columns[i][k];
            }
        }
        let mut residual = leaf.force.data.0[0];
        for k in 0..K {
            for l in 0..K {
                residual[l] -= metric[k][l] * drift[k];
            }
        }
        for k in 0..K {
            for i in 0..N {
                self.force[i] += rows[k][i] * residual[k];
            }
        }
        for (sum, column) in self.metric.data.0.iter_mut().zip(columns) {
            let mut weighted = [0.0; K];
            for k in 0..K {
                for l in 0..K {
                    weighted[l] += metric[k][l] * column[k];
                }
            }
            for k in 0..K {
                for i in 0..N {
                    sum[i] += rows[k][i] * weighted[k];
                }
            }
        }
    }

    /// Adds a policy on the same space.
    pub fn add(&mut self, other: &Self) {
        self.force += other.force;
        self.metric += other.metric;
    }

    /// The decomposition of M.
    ///
    /// # Errors
    /// When M is not positive definite.
    pub fn factor(&self) -> Result<Factor<N>, ResolveError> {
        Factor::new(&self.metric).ok_or(ResolveError::MetricNotPositiveDefinite)
    }

    /// The acceleration a = M⁻¹ f.
    ///
    /// Hot path: no allocation, O(N³).
    ///
    /// # Errors
    /// When M is not positive definite or f is not finite: the caller decides what is safe.
    pub fn resolve(&self) -> Result<SVector<f64, N>, ResolveError> {
        self.resolve_with(&self.factor()?)
    }

    /// The acceleration for this force and a metric that is decomposed already.
    ///
    /// # Errors
    /// When f is not finite.
    pub fn resolve_with(&self, factor: &Factor<N>) -> Result<SVector<f64, N>, ResolveError> {
        let acceleration = factor.solve(&self.force);
        if acceleration.iter().all(|a| a.is_finite()) {
            Ok(acceleration)
        } else {
            Err(ResolveError::ForceNotFinite)
        }
    }
}

/// A symmetric positive definite matrix M = L D Lᵀ, without roots.
#[derive(Debug, Clone, Copy)]
pub struct Factor<const N: usize> {
    /// Below the diagonal the columns of L D, on it D.
    columns: [[f64; N]; N],
    /// D⁻¹.
    inverse: [f64; N],
}

impl<const N: usize> Factor<N> {
    /// Decomposes a matrix, of which the lower triangle counts; `None` when it is not positive definite.
    ///
    /// Hot path: no allocation, O(N³).
    #[inline]
    #[must_use]
    pub fn new(matrix: &SMatrix<f64, N, N>) -> Option<Self> {
        let mut columns = matrix.data.0;
        let mut inverse = [0.0; N];
        for j in 0..N {
            let pivot = columns[j][j];
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            inverse[j] = 1.0 / pivot;
            for k in j + 1..N {
                let fraction = columns[j][k] * inverse[j];
                for i in k..N {
                    columns[k][i] -= fraction * columns[j][i];
                }
            }
        }
        Some(Self { columns, inverse })
    }

    /// L⁻¹ b
    #[inline]
    fn forward(&self, b: &mut [f64; N]) {
        for j in 0..N {
            let fraction = b[j] * self.inverse[j];
            for k in j + 1..N {
                b[k] -= self.columns[j][k] * fraction;
            }
        }
    }

    /// M⁻¹ b; O(N²).
    #[inline]
    #[must_use]
    pub fn solve(&self, b: &SVector<f64, N>) -> SVector<f64, N> {
        let mut x = b.data.0[0];
        self.forward(&mut x);
        for j in (0..N).rev() {
            for k in j + 1..N {
                x[j] -= self.columns[j][k] * x[k];
            }
            x[j] *= self.inverse[j];
        }
        SVector::from(x)
    }

    /// J M⁻¹ Jᵀ, which is (L⁻¹Jᵀ)ᵀ D⁻¹ (L⁻¹Jᵀ); O(K N²).
    #[inline]
    #[must_use]
    pub fn mobility<const K: usize>(&self, jacobian: &SMatrix<f64, K, N>) -> SMatrix<f64, K, K> {
        let mut rows = jacobian.transpose().data.0;
        rows.iter_mut().for_each(|row| self.forward(row));
        SMatrix::from_fn(|i, j| (0..N).map(|n| rows[i][n] * rows[j][n] * self.inverse[n]).sum())
    }

    /// The ratio of the least to the largest pivot, the entries of D.
    #[must_use]
    pub fn pivot_ratio(&self) -> f64 {
        let pivots = (0..N).map(|j| self.columns[j][j]);
        let (least, largest) =
            pivots.fold((f64::INFINITY, 0.0), |(least, most), d| (d.min(least), d.max(most)));
        least / largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};

    #[test]
    fn a_full_rank_leaf_alone_gets_the_acceleration_it_desires() {
        let metric = Matrix2::new(3.0, 0.5, 0.5, 2.0);
        let desired = Vector2::new(1.0, -2.0);
        let leaf = Natural { force: metric * desired, metric };
        let jacobian = Matrix2::new(0.4, 1.0, -2.0, 0.3);
        let drift = Vector2::new(0.2, 0.7);
        let mut root = Natural::zero();
        root.add_pullback(&leaf, &jacobian, &drift);
        let q = root.resolve().unwrap();
        assert!((jacobian * q + drift - desired).norm() < 1e-12);
    }

    #[test]
    fn two_leaves_meet_at_the_weighted_least_squares_solution() {
        let jacobian = Matrix3x2::new(1.0, 0.2, -0.3, 0.9, 0.5, 0.5);
        let leaf = Natural {
            force: Vector3::new(1.0, 2.0, -1.0),
            metric: Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, 0.5)),
        };
        let posture = Natural { force: Vector2::new(0.1, 0.2), metric: Matrix2::identity() };
        let mut root = posture;
        root.add_pullback(&leaf, &jacobian, &Vector3::zeros());
        let q = root.resolve().unwrap();
        // The gradient of ½|q−a_p|²_M + ½|Jq−a_l|²_M vanishes.
        let residual = posture.metric * q - posture.force
            + jacobian.transpose() * (leaf.metric * (jacobian * q) - leaf.force);
        assert!(residual.norm() < 1e-12);
    }

    #[test]
    fn a_factor_solves_and_gives_the_mobility_and_the_pivots() {
        let matrix = Matrix3::new(4.0, 1.0, -0.5, 1.0, 3.0, 0.2, -0.5, 0.2, 2.0);
        let factor = Factor::new(&matrix).unwrap();
        let force = Vector3::new(0.3, -1.0, 2.0);
        assert!((matrix * factor.solve(&force) - force).norm() < 1e-14);
        let rows = nalgebra::Matrix2x3::new(1.0, 0.3, -0.2, 0.4, -1.0, 0.5);
        let expected = rows * matrix.try_inverse().unwrap() * rows.transpose();
        assert!((factor.mobility(&rows) - expected).norm() < 1e-14);
        let diagonal = matrix.cholesky().unwrap().l().diagonal();
        let ratio = (diagonal.min() / diagonal.max()).powi(2);
        assert!((factor.pivot_ratio() - ratio).abs() < 1e-15);
        assert!(Factor::new(&(matrix - Matrix3::identity() * 2.0)).is_none());
    }

    #[test]
    fn a_singular_metric_or_a_force_that_is_not_finite_is_refused() {
        let mut root = Natural::<2>::zero();
        assert_eq!(root.resolve(), Err(ResolveError::MetricNotPositiveDefinite));
        root.metric = Matrix2::identity();
        root.force = Vector2::new(f64::NAN, 0.0);
        assert_eq!(root.resolve(), Err(ResolveError::ForceNotFinite));
        root.metric[(0, 0)] = f64::NAN;
        assert_eq!(root.resolve(), Err(ResolveError::MetricNotPositiveDefinite));
    }
}
