//! Gaussians on poses, seen from frames and multiplied  [thesis eq. 3.3 and 3.6].
//!
//! The tangent space of dimension D at a mean μ = (μ_x, μ_q) is the position in the axes of the
//! coordinate system in which the Gaussian is given and, for D = 6, the rotation vector in body
//! axes of the mean:
//!
//! | D | manifold | tangent                                                      |
//! |---|----------|--------------------------------------------------------------|
//! | 2 | R²       | x − μ_x, the first two                                       |
//! | 3 | R³       | x − μ_x                                                      |
//! | 6 | R³ × S³  | \[x − μ_x; v\] with q = μ_q exp(v), v the full angle ([`tprmp_spatial::rotation`]) |
//!
//! A Gaussian is held by its precision Λ = Σ⁻¹: the product is a sum of precisions, so that nothing
//! is inverted on the way from the frames to the field.
//!
//! ```text
//! μ̂_p = A_p μ_p + b_p     Λ̂_p = A_p Λ_p A_pᵀ                      (seen from the world)
//! Λ̂ = Σ_p Λ̂_p∥            0 = Σ_p Λ̂_p∥ [x_p − x̂; log(q̂⁻¹ q_p)]    (product)
//! ```
//!
//! Λ̂_p∥ is the precision of factor p, parallel-transported from its mean to the product's: on R² and
//! R³ it is Λ̂_p and the product is eq. 3.6 as it stands. For D = 6 the mean is found by Gauss–Newton
//! on the manifold, starting at the strongest factor, that of the largest det Λ_p. It is unique
//! where the orientations of the means lie within π/2 of one another; a factor exactly opposite has
//! no direction of its own.
//!
//! The order of the factors matters by rounding alone, but for what the tangent does not span (for
//! D = 2 height, for D < 6 orientation): that is the strongest factor's, and the first's of equals.

use core::array::from_fn;

use glam::{DMat3, DQuat};
use nalgebra::{Cholesky, SMatrix};

use crate::lanes::{
    LANES, Lanes, Quad, dot, load_all, load_rows, splat_all, store_all, store_rows,
};
use crate::policy::thesis::rotation::{
    Matrix, Quaternion, Rotation, Vector, hamilton, matrix_times, rotated,
};
use tprmp_spatial::Pose;

/// A factor is stronger than another when its precision's determinant is larger by more than this:
/// rounding does not decide.
const STRONGER: f64 = 1e-6;
/// Bound on the Gauss–Newton iterations; factors within 1 rad of one another take some six.
const ITERATIONS_MAX: usize = 50;
/// The iterations stop at this change of the mean's orientation \[rad\]; what is left is less.
const ROTATION_TOLERANCE: f64 = 1e-11;

/// A Gaussian on R² (D = 2), R³ (D = 3) or R³ × S³ (D = 6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGaussian<const D: usize> {
    /// μ; what the tangent does not span (for D = 2 height, for D < 6 orientation) is kept.
    pub mean: Pose,
    /// Λ = Σ⁻¹, symmetric positive definite \[1/m², 1/(m rad), 1/rad²\].
    pub precision: SMatrix<f64, D, D>,
}

impl<const D: usize> PoseGaussian<D> {
    /// The Gaussian of a covariance \[m², m rad, rad²\]; `None` when it is not positive definite.
    #[must_use]
    pub fn from_covariance(mean: Pose, covariance: &SMatrix<f64, D, D>) -> Option<Self> {
        Some(Self { mean, precision: Cholesky::new(*covariance)?.inverse() })
    }
}

/// The factor of the largest det Λ_p, the first of equals; `None` when a factor is no Gaussian.
pub(super) fn strongest<const D: usize>(factors: &[PoseGaussian<D>]) -> Option<usize> {
    let mut best: Option<(f64, usize)> = None;
    for (p, factor) in factors.iter().enumerate() {
        let determinant = Cholesky::new(factor.precision)?.determinant();
        let Pose { position, orientation } = factor.mean;
        if !(determinant.is_finite() && position.is_finite() && orientation.is_finite()) {
            return None;
        }
        if best.is_none_or(|(largest, _)| determinant > largest * (1.0 + STRONGER)) {
            best = Some((determinant, p));
        }
    }
    best.map(|(_, p)| p)
}

/// Gaussians on poses, one in each lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoseGroup<const D: usize> {
    position: Vector<Quad>,
    orientation: Quaternion<Quad>,
    /// Of this and of all matrices below the lower triangle counts.
    precision: [[Quad; D]; D],
}

/// A product of all lanes: its mean, its precision, and the precision's determinant.
pub(super) struct Product<L, const D: usize> {
    pub(super) position: Vector<L>,
    pub(super) orientation: Quaternion<L>,
    pub(super) precision: [[L; D]; D],
    pub(super) determinant: L,
}

impl<const D: usize> PoseGroup<D> {
    pub(super) const NONE: Self = Self {
        position: [[0.0; LANES]; 3],
        orientation: [[0.0; LANES]; 4],
        precision: [[[0.0; LANES]; D]; D],
    };

    pub(super) fn new(gaussians: [&PoseGaussian<D>; LANES]) -> Self {
        let orientations = gaussians.map(|g| g.mean.orientation.normalize().to_array());
        Self {
            position: from_fn(|i| gaussians.map(|g| g.mean.position[i])),
            orientation: from_fn(|i| orientations.map(|q| q[i])),
            precision: from_fn(|i| from_fn(|j| gaussians.map(|g| g.precision[(i, j)]))),
        }
    }

    /// Gaussians given in a frame, in the coordinates in which the frame is given: μ̂ = A μ + b and
    /// Λ̂ = A Λ Aᵀ  [thesis eq. 3.3, 3.6].
    ///
    /// The rotation block is in body axes and stays. In the plane the frame's z axis has to be
    /// upright, up or down.
    #[inline(always)]
    pub(super) fn transformed<L: Lanes>(&self, frame: &Pose) -> Self {
        let orientation = frame.orientation.normalize();
        let [a, b, c] = DMat3::from_quat(orientation).transpose().to_cols_array_2d();
        let rotation: Matrix<L> = [splat_all(&a), splat_all(&b), splat_all(&c)];
        let mut position = matrix_times(&rotation, &load_all(&self.position));
        for i in 0..3 {
            position[i] = position[i] + L::splat(frame.position[i]);
        }
        let orientation = splat_all(&orientation.to_array());
        Self {
            position: store_all(&position),
            orientation: store_all(&hamilton::<L>(&orientation, &load_all(&self.orientation))),
            precision: store_rows(&congruence::<L, D>(&load_rows(&self.precision), &rotation, 0)),
        }
    }
}

impl<L: Lanes, const D: usize> Product<L, D> {
    /// The products of these factors, normalised  [thesis eq. 3.6].
    ///
    /// * `strongest`  for each lane, the factor at which the iterations start
    ///
    /// No allocation, O(P D³) an iteration. `None` for what is not finite.
    #[inline(always)]
    pub(super) fn new(factors: &[PoseGroup<D>], strongest: &[usize; LANES]) -> Option<Self> {
        let first = |lane: usize| &factors[strongest[lane]];
        let start: Vector<Quad> = from_fn(|i| from_fn(|lane| first(lane).position[i][lane]));
        let mut position: Vector<L> = load_all(&start);
        let start: Quaternion<Quad> = from_fn(|i| from_fn(|lane| first(lane).orientation[i][lane]));
        let mut orientation: Quaternion<L> = load_all(&start);
        let mut factor = Factor::new(&precision(factors, &orientation));
        for iteration in 0..ITERATIONS_MAX {
            if D == 6 && iteration == 1 {
                // From here on the matrix hardly changes.
                factor = Factor::new(&precision(factors, &orientation));
            }
            let step = factor.solve(&pull(factors, &position, &orientation));
            for i in 0..D.min(3) {
                position[i] = position[i] + step[i];
            }
            if D < 6 {
                break;
            }
            let rotation = [step[3], step[4], step[5]];
            orientation = rotated(&orientation, &rotation);
            let squared = largest(dot(&rotation, &rotation));
            if squared <= ROTATION_TOLERANCE * ROTATION_TOLERANCE || squared.is_nan() {
                break;
            }
        }
        let precision = precision(factors, &orientation);
        let determinant = Factor::new(&precision).determinant;
        let sum = dot(&position, &position) + orientation[3] + determinant;
        let product = Self { position, orientation, precision, determinant };
        largest(sum).is_finite().then_some(product)
    }

    /// The mean of a lane.
    #[inline(always)]
    pub(super) fn mean(&self, lane: usize) -> Pose {
        Pose {
            position: store_all(&self.position).map(|quad| quad[lane]).into(),
            orientation: DQuat::from_array(store_all(&self.orientation).map(|quad| quad[lane])),
        }
    }
}

/// The largest lane; not a number when one is none.
#[inline(always)]
fn largest<L: Lanes>(values: L) -> f64 {
    let [a, b, c, d] = values.store();
    if (a + b + c + d).is_nan() { f64::NAN } else { a.max(b).max(c.max(d)) }
}

/// Σ_p Λ̂_p∥ at an orientation q̂.
#[inline(always)]
fn precision<L: Lanes, const D: usize>(
    factors: &[PoseGroup<D>],
    orientation: &Quaternion<L>,
) -> [[L; D]; D] {
    let mut sum = [[L::zero(); D]; D];
    for factor in factors {
        let mut precision = load_rows(&factor.precision);
        if D == 6 {
            let away = Rotation::between(orientation, &load_all(&factor.orientation));
            precision = congruence(&precision, &away.transport(), 3);
        }
        for i in 0..D {
            for j in 0..=i {
                sum[i][j] = sum[i][j] + precision[i][j];
            }
        }
    }
    sum
}

/// Σ_p Λ̂_p∥ \[x_p − x̂; r_p\] at a pose, r_p = log(q̂⁻¹ q_p).
///
/// Transport T_p rotates about r_p, so that T_pᵀ r_p = r_p: matrices are not rotated for it.
#[inline(always)]
fn pull<L: Lanes, const D: usize>(
    factors: &[PoseGroup<D>],
    position: &Vector<L>,
    orientation: &Quaternion<L>,
) -> [L; D] {
    let mut sum = [L::zero(); D];
    for factor in factors {
        let mut offset: Vector<L> = load_all(&factor.position);
        for i in 0..3 {
            offset[i] = offset[i] - position[i];
        }
        let mut force = block_times(&factor.precision, [0, 0], &offset);
        if D == 6 {
            let away = Rotation::between(orientation, &load_all(&factor.orientation));
            let crossed = block_times(&factor.precision, [0, 3], &away.vector);
            let mut torque = block_times(&factor.precision, [3, 0], &offset);
            let about = block_times(&factor.precision, [3, 3], &away.vector);
            for i in 0..3 {
                force[i] = force[i] + crossed[i];
                torque[i] = torque[i] + about[i];
            }
            let torque = matrix_times(&away.transport(), &torque);
            for i in 0..3 {
                sum[i + 3] = sum[i + 3] + torque[i];
            }
        }
        for i in 0..D.min(3) {
            sum[i] = sum[i] + force[i];
        }
    }
    sum
}

/// A block of a symmetric matrix, the first row and column of which are given, times v.
#[inline(always)]
fn block_times<L: Lanes, const D: usize>(
    matrix: &[[Quad; D]; D],
    [row, column]: [usize; 2],
    v: &Vector<L>,
) -> Vector<L> {
    let mut product = [L::zero(); 3];
    for i in row..D.min(row + 3) {
        let entry = |j: usize| L::load(&matrix[i.max(j)][i.min(j)]);
        product[i - row] = entry(column) * v[0];
        for j in column + 1..D.min(column + 3) {
            product[i - row] = product[i - row] + entry(j) * v[j - column];
        }
    }
    product
}

/// T Λ Tᵀ for a T that is A on the three axes from `first` on, and one on the others.
#[inline(always)]
pub(super) fn congruence<L: Lanes, const D: usize>(
    matrix: &[[L; D]; D],
    rotation: &Matrix<L>,
    first: usize,
) -> [[L; D]; D] {
    let end = D.min(first + 3);
    let mut result = *matrix;
    for i in first..D {
        // Row i of T Λ, up to where it is needed.
        let mut row = matrix[i];
        for j in 0..end {
            let entry = |k: usize| rotation[i - first][k - first] * matrix[k.max(j)][k.min(j)];
            if i < end {
                row[j] = entry(first);
                for k in first + 1..end {
                    row[j] = row[j] + entry(k);
                }
            }
        }
        for j in 0..end.min(i + 1) {
            result[i][j] = row[j];
            if j >= first {
                result[i][j] = row[first] * rotation[j - first][0];
                for k in first + 1..end {
                    result[i][j] = result[i][j] + row[k] * rotation[j - first][k - first];
                }
            }
        }
    }
    result
}
/// A = L D Lᵀ for a symmetric positive definite A.
struct Factor<L, const D: usize> {
    /// L below its diagonal of ones.
    lower: [[L; D]; D],
    /// D⁻¹.
    inverse: [L; D],
    /// det A.
    determinant: L,
}

impl<L: Lanes, const D: usize> Factor<L, D> {
    /// Of a matrix of which the lower triangle counts.
    #[inline(always)]
    fn new(a: &[[L; D]; D]) -> Self {
        let mut lower = *a;
        let mut inverse = [L::zero(); D];
        let mut determinant = L::splat(1.0);
        for i in 0..D {
            // Row i of L D, then of L.
            for j in 0..i {
                for k in 0..j {
                    lower[i][j] = lower[i][j] - lower[i][k] * lower[j][k];
                }
            }
            let mut diagonal = a[i][i];
            for j in 0..i {
                let scaled = lower[i][j] * inverse[j];
                diagonal = diagonal - scaled * lower[i][j];
                lower[i][j] = scaled;
            }
            determinant = determinant * diagonal;
            inverse[i] = L::splat(1.0) / diagonal;
        }
        Self { lower, inverse, determinant }
    }

    /// A⁻¹ b
    #[inline(always)]
    fn solve(&self, b: &[L; D]) -> [L; D] {
        let mut x = *b;
        for i in 0..D {
            for j in 0..i {
                x[i] = x[i] - self.lower[i][j] * x[j];
            }
        }
        for i in (0..D).rev() {
            x[i] = x[i] * self.inverse[i];
            for k in i + 1..D {
                x[i] = x[i] - self.lower[k][i] * x[k];
            }
        }
        x
    }
}
