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

use glam::{DMat3, DVec3};
use nalgebra::{Cholesky, SMatrix, SVector};

use crate::lanes::{self, Kernel, LANES, Lanes};
use crate::policy::thesis::product_quad::PoseQuad;
use crate::policy::value::FRAME_CAPACITY;
use tprmp_spatial::Pose;

/// A factor is stronger than another when its precision's determinant is larger by more than this:
/// rounding does not decide.
const STRONGER: f64 = 1e-6;

/// A Gaussian on R² (D = 2), R³ (D = 3) or R³ × S³ (D = 6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGaussian<const D: usize> {
    /// μ; what the tangent does not span (for D = 2 height, for D < 6 orientation) is carried along.
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

    /// Σ \[m², m rad, rad²\]; `None` when the precision is not positive definite.
    #[must_use]
    pub fn covariance(&self) -> Option<SMatrix<f64, D, D>> {
        Some(Cholesky::new(self.precision)?.inverse())
    }

    /// The Gaussian given in a frame, in the coordinates in which the frame is given.
    ///
    /// μ̂ = A μ + b and Λ̂ = A Λ Aᵀ with A the rotation of the frame and b its origin: position and
    /// cross blocks turn with A, the rotation block is in body axes and stays  [thesis eq. 3.3, 3.6].
    /// In the plane the frame's z axis has to be upright, up or down.
    #[must_use]
    pub fn transformed(&self, frame: &Pose) -> Self {
        let rotation = DMat3::from_quat(frame.orientation);
        Self {
            mean: frame.compose(&self.mean),
            precision: turned(&self.precision, rotation, DMat3::IDENTITY),
        }
    }
}

/// The product of Gaussians in the same coordinates, normalised  [thesis eq. 3.6].
///
/// ```text
/// Λ̂ = Σ_p Λ_p∥        0 = Σ_p Λ_p∥ [x_p − x̂; log(q̂⁻¹ q_p)]
/// ```
///
/// Λ_p∥ is the precision of factor p, parallel-transported from its mean to the product's: on R² and
/// R³ it is Λ_p and the product is eq. 3.6 as it stands. For D = 6 the mean is found by Gauss–Newton
/// on the manifold, starting at the strongest factor, that of the largest det Λ_p. It is unique
/// where the orientations of the means lie within π/2 of one another; a factor exactly opposite has
/// no direction of its own.
///
/// The order of the factors matters by rounding alone, but for what the tangent does not span (for
/// D = 2 height, for D < 6 orientation): that is the strongest factor's, and the first's of equals.
///
/// [`crate::policy::thesis::product_skill`] does the same for four components at once.
///
/// No allocation, O(P D³) an iteration. `None` when there is no factor, or more than
/// [`FRAME_CAPACITY`], or one whose precision is not positive definite or that is not finite.
#[must_use]
pub fn product<const D: usize>(factors: &[PoseGaussian<D>]) -> Option<PoseGaussian<D>> {
    let strongest = strongest(factors)?;
    let mut quads = [PoseQuad::NONE; FRAME_CAPACITY];
    let quads = quads.get_mut(..factors.len())?;
    for (quad, factor) in quads.iter_mut().zip(factors) {
        for lane in 0..LANES {
            quad.set(lane, factor);
        }
    }
    lanes::run(Product { factors: quads, strongest: [strongest; LANES] })
}

/// A product in all lanes.
struct Product<'a, const D: usize> {
    factors: &'a [PoseQuad<D>],
    strongest: [usize; LANES],
}

impl<const D: usize> Kernel for Product<'_, D> {
    type Output = Option<PoseGaussian<D>>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<PoseGaussian<D>> {
        let (product, _) = PoseQuad::product::<L>(self.factors, &self.strongest)?;
        Some(product.get(0))
    }
}

/// The factor of the largest det Λ_p, the first of equals; `None` when a factor is no Gaussian.
pub(crate) fn strongest<const D: usize>(factors: &[PoseGaussian<D>]) -> Option<usize> {
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

/// T Λ Tᵀ with T = diag(A, B) on position and rotation vector, cut to the first D rows and columns;
/// block by block, since most of T is zero.
fn turned<const D: usize>(
    matrix: &SMatrix<f64, D, D>,
    position: DMat3,
    rotation: DMat3,
) -> SMatrix<f64, D, D> {
    let block = |row: usize, column: usize| {
        let entry = |n: usize| matrix.get((row + n % 3, column + n / 3)).copied().unwrap_or(0.0);
        DMat3::from_cols_array(&core::array::from_fn(entry))
    };
    let linear = position * block(0, 0) * position.transpose();
    if D <= 3 {
        return block_diagonal(linear, DMat3::ZERO);
    }
    let cross = position * block(0, 3) * rotation.transpose();
    let angular = rotation * block(3, 3) * rotation.transpose();
    SMatrix::from_fn(|i, j| match (i / 3, j / 3) {
        (0, 0) => linear.col(j)[i],
        (0, _) => cross.col(j - 3)[i],
        (_, 0) => cross.col(i - 3)[j],
        (_, _) => angular.col(j - 3)[i - 3],
    })
}

/// diag(A, B) on position and rotation vector, cut to the first R rows and C columns.
pub(crate) fn block_diagonal<const R: usize, const C: usize>(
    position: DMat3,
    rotation: DMat3,
) -> SMatrix<f64, R, C> {
    const { assert!(R <= 6 && C <= 6, "two blocks of three") };
    SMatrix::from_fn(|i, j| match (i / 3, j / 3) {
        (0, 0) => position.col(j)[i],
        (1, 1) => rotation.col(j - 3)[i - 3],
        _ => 0.0,
    })
}

/// \[position; rotation vector\], cut to the first D rows.
pub(crate) fn tangent<const D: usize>(position: DVec3, rotation: DVec3) -> SVector<f64, D> {
    const { assert!(D == 2 || D == 3 || D == 6, "R², R³ or R³ × S³") };
    SVector::from_fn(|i, _| if i < 3 { position[i] } else { rotation[i - 3] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;
    use std::f64::consts::PI;
    use tprmp_spatial::rotation::rotation_vector;

    fn vector(size: f64) -> impl Strategy<Value = DVec3> {
        let component = -size..size;
        (component.clone(), component.clone(), component).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    /// Orientations within about 0.9 rad of a common one.
    fn pose() -> impl Strategy<Value = Pose> {
        (vector(1.0), vector(0.5)).prop_map(|(position, rotation)| Pose {
            position,
            orientation: DQuat::from_rotation_x(2.0) * DQuat::from_scaled_axis(rotation),
        })
    }

    fn precision<const D: usize>() -> impl Strategy<Value = SMatrix<f64, D, D>> {
        prop::collection::vec(-1.0..1.0, D * D).prop_map(|entries| {
            let root = SMatrix::<f64, D, D>::from_row_slice(&entries);
            (root * root.transpose() + SMatrix::identity() * 0.3) * 40.0
        })
    }

    fn gaussian<const D: usize>() -> impl Strategy<Value = PoseGaussian<D>> {
        (pose(), precision()).prop_map(|(mean, precision)| PoseGaussian { mean, precision })
    }

    fn gaussians<const D: usize>() -> impl Strategy<Value = Vec<PoseGaussian<D>>> {
        prop::collection::vec(gaussian(), 1..5)
    }

    fn any_frame() -> impl Strategy<Value = Pose> {
        (vector(2.0), vector(1.8)).prop_map(|(position, rotation)| Pose {
            position,
            orientation: DQuat::from_scaled_axis(rotation),
        })
    }

    fn upright_frame() -> impl Strategy<Value = Pose> {
        (vector(2.0), -PI..PI, any::<bool>()).prop_map(|(position, yaw, down)| {
            let tip = if down { DQuat::from_rotation_x(PI) } else { DQuat::IDENTITY };
            Pose { position, orientation: DQuat::from_rotation_z(yaw) * tip }
        })
    }

    /// Distance of the means in the tangent space plus relative distance of the precisions.
    fn distance<const D: usize>(a: &PoseGaussian<D>, b: &PoseGaussian<D>) -> f64 {
        let turn = rotation_vector(a.mean.orientation.conjugate() * b.mean.orientation);
        tangent::<D>(b.mean.position - a.mean.position, turn).norm()
            + (a.precision - b.precision).norm() / a.precision.norm()
    }

    /// Eq. 3.6 by covariances: Σ̂ = (Σ Σ_p⁻¹)⁻¹, μ̂ = Σ̂ Σ Σ_p⁻¹ μ_p.
    fn dense<const D: usize>(
        means: &[SVector<f64, D>],
        covariances: &[SMatrix<f64, D, D>],
    ) -> (SVector<f64, D>, SMatrix<f64, D, D>) {
        let mut sum = SMatrix::zeros();
        let mut weighted = SVector::zeros();
        for (mean, covariance) in means.iter().zip(covariances) {
            let inverse = covariance.try_inverse().unwrap();
            sum += inverse;
            weighted += inverse * mean;
        }
        let covariance = sum.try_inverse().unwrap();
        (covariance * weighted, covariance)
    }

    fn is_dense<const D: usize>(factors: &[PoseGaussian<D>]) -> bool {
        let common = factors[0].mean.orientation;
        let means: Vec<_> = factors.iter().map(|f| tangent(f.mean.position, DVec3::ZERO)).collect();
        let covariances: Vec<_> = factors.iter().map(|f| f.covariance().unwrap()).collect();
        let (mean, covariance) = dense(&means, &covariances);
        let found = product(factors).unwrap();
        let rotation = rotation_vector(common.conjugate() * found.mean.orientation);
        let rotation = if D == 6 { rotation } else { DVec3::ZERO };
        (tangent::<D>(found.mean.position, rotation) - mean).norm() < 1e-11
            && (found.covariance().unwrap() - covariance).norm() < 1e-11
    }

    fn is_equivariant<const D: usize>(factors: &[PoseGaussian<D>], frame: &Pose) -> bool {
        let moved: Vec<_> = factors.iter().map(|f| f.transformed(frame)).collect();
        distance(&product(&moved).unwrap(), &product(factors).unwrap().transformed(frame)) < 1e-10
    }

    fn is_halved<const D: usize>(gaussian: &PoseGaussian<D>) -> bool {
        let square = product(&[*gaussian, *gaussian]).unwrap();
        let halved =
            PoseGaussian::from_covariance(gaussian.mean, &(gaussian.covariance().unwrap() * 0.5));
        distance(&square, &halved.unwrap()) < 1e-12
    }

    fn is_symmetric<const D: usize>(factors: &[PoseGaussian<D>], turn: usize) -> bool {
        let mut other = factors.to_vec();
        other.rotate_left(turn % factors.len());
        distance(&product(factors).unwrap(), &product(&other).unwrap()) < 1e-10
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn on_vector_spaces_it_is_the_dense_formula(
            plane in gaussians::<2>(), space in gaussians::<3>(),
        ) {
            prop_assert!(is_dense(&plane) && is_dense(&space));
        }

        #[test]
        fn where_orientations_coincide_it_is_the_dense_formula_at_the_common_one(
            factors in gaussians::<6>(),
        ) {
            // Cross blocks turn the mean away from the common orientation unless positions
            // coincide as well or the blocks vanish.
            let common = factors[0].mean;
            let factors: Vec<_> = factors
                .iter()
                .map(|f| {
                    let mut uncoupled = f.precision;
                    uncoupled.fixed_view_mut::<3, 3>(0, 3).fill(0.0);
                    uncoupled.fixed_view_mut::<3, 3>(3, 0).fill(0.0);
                    let mean = Pose { orientation: common.orientation, ..f.mean };
                    PoseGaussian { mean, precision: uncoupled }
                })
                .collect();
            prop_assert!(is_dense(&factors));
        }

        #[test]
        fn where_poses_coincide_the_precisions_add(factors in gaussians::<6>()) {
            let mean = factors[0].mean;
            let factors: Vec<_> = factors.iter().map(|f| PoseGaussian { mean, ..*f }).collect();
            let precision = factors.iter().map(|f| f.precision).sum();
            let expected = PoseGaussian { mean, precision };
            prop_assert!(distance(&product(&factors).unwrap(), &expected) < 1e-12);
        }

        #[test]
        fn it_moves_with_its_factors(
            plane in gaussians::<2>(),
            space in gaussians::<3>(),
            poses in gaussians::<6>(),
            frame in any_frame(),
            upright in upright_frame(),
        ) {
            prop_assert!(is_equivariant(&plane, &upright));
            prop_assert!(is_equivariant(&space, &frame));
            prop_assert!(is_equivariant(&poses, &frame));
        }

        #[test]
        fn frames_compose(gaussian in gaussian::<6>(), a in any_frame(), b in any_frame()) {
            let twice = gaussian.transformed(&b).transformed(&a);
            prop_assert!(distance(&twice, &gaussian.transformed(&a.compose(&b))) < 1e-12);
        }

        #[test]
        fn order_does_not_matter(
            space in gaussians::<3>(), poses in gaussians::<6>(), turn in 0_usize..4,
        ) {
            prop_assert!(is_symmetric(&space, turn) && is_symmetric(&poses, turn));
        }

        #[test]
        fn both_quaternions_of_an_orientation_are_the_same(
            factors in gaussians::<6>(), flips in any::<[bool; 4]>(),
        ) {
            let flipped: Vec<_> = factors
                .iter()
                .zip(flips)
                .map(|(f, flip)| {
                    let q = f.mean.orientation;
                    let orientation = if flip { -q } else { q };
                    PoseGaussian { mean: Pose { orientation, ..f.mean }, ..*f }
                })
                .collect();
            let (a, b) = (product(&factors).unwrap(), product(&flipped).unwrap());
            prop_assert!(distance(&a, &b) < 1e-13);
        }

        #[test]
        fn the_square_has_half_the_covariance(
            plane in gaussian::<2>(), space in gaussian::<3>(), pose in gaussian::<6>(),
        ) {
            prop_assert!(is_halved(&plane) && is_halved(&space) && is_halved(&pose));
        }

        /// The transported pulls cancel at the product's mean, whatever the way there.
        #[test]
        fn the_mean_is_where_the_transported_pulls_cancel(factors in gaussians::<6>()) {
            let found = product(&factors).unwrap();
            let mut pull = SVector::<f64, 6>::zeros();
            for f in &factors {
                let away = rotation_vector(f.mean.orientation.conjugate() * found.mean.orientation);
                let turn: SMatrix<f64, 6, 6> = block_diagonal(
                    DMat3::IDENTITY,
                    DMat3::from_quat(DQuat::from_scaled_axis(away * -0.5)),
                );
                let at_factor = tangent::<6>(f.mean.position - found.mean.position, -away);
                pull += turn * f.precision * turn.transpose() * at_factor;
            }
            prop_assert!(pull.norm() < 1e-10 * found.precision.norm());
        }
    }

    #[test]
    fn what_is_no_gaussian_has_no_product() {
        let good = PoseGaussian::<3> { mean: Pose::IDENTITY, precision: SMatrix::identity() };
        let flat = PoseGaussian { precision: SMatrix::zeros(), ..good };
        let mut lost = good;
        lost.mean.position.y = f64::NAN;
        let endless = PoseGaussian { precision: SMatrix::identity() * f64::INFINITY, ..good };
        for bad in [flat, lost, endless] {
            assert!(product(&[good, bad]).is_none());
        }
        assert!(product::<3>(&[]).is_none());
        assert!(flat.covariance().is_none());
        assert!(PoseGaussian::from_covariance(Pose::IDENTITY, &flat.precision).is_none());
    }
}
