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
    pub fn add_pullback<const K: usize>(
        &mut self,
        leaf: &Natural<K>,
        jacobian: &SMatrix<f64, K, N>,
        drift: &SVector<f64, K>,
    ) {
        let weighted = leaf.metric * jacobian;
        self.force += jacobian.tr_mul(&(leaf.force - leaf.metric * drift));
        self.metric += jacobian.tr_mul(&weighted);
    }

    /// Adds a policy on the same space.
    pub fn add(&mut self, other: &Self) {
        self.force += other.force;
        self.metric += other.metric;
    }

    /// The acceleration a = M⁻¹ f, by the decomposition M = L D Lᵀ.
    ///
    /// Hot path: no allocation, O(N³).
    ///
    /// # Errors
    /// When M is not positive definite or f is not finite: the caller decides what is safe.
    pub fn resolve(&self) -> Result<SVector<f64, N>, ResolveError> {
        // Below the diagonal the columns become those of L D.
        let mut columns = self.metric.data.0;
        let mut inverse = [0.0; N];
        let mut x = self.force.data.0[0];
        for j in 0..N {
            let pivot = columns[j][j];
            if !(pivot > 0.0 && pivot.is_finite()) {
                return Err(ResolveError::MetricNotPositiveDefinite);
            }
            inverse[j] = 1.0 / pivot;
            for k in j + 1..N {
                let share = columns[j][k] * inverse[j];
                x[k] -= share * x[j];
                for i in k..N {
                    columns[k][i] -= share * columns[j][i];
                }
            }
        }
        for j in (0..N).rev() {
            for k in j + 1..N {
                x[j] -= columns[j][k] * x[k];
            }
            x[j] *= inverse[j];
        }
        if x.iter().all(|a| a.is_finite()) {
            Ok(SVector::from(x))
        } else {
            Err(ResolveError::ForceNotFinite)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};

    #[test]
    fn a_full_rank_leaf_alone_gets_the_acceleration_it_wants() {
        let metric = Matrix2::new(3.0, 0.5, 0.5, 2.0);
        let wanted = Vector2::new(1.0, -2.0);
        let leaf = Natural { force: metric * wanted, metric };
        let jacobian = Matrix2::new(0.4, 1.0, -2.0, 0.3);
        let drift = Vector2::new(0.2, 0.7);
        let mut root = Natural::zero();
        root.add_pullback(&leaf, &jacobian, &drift);
        let q = root.resolve().unwrap();
        assert!((jacobian * q + drift - wanted).norm() < 1e-12);
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
