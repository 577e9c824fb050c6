//! Products of Gaussians on poses, of four components at once; [`crate::policy::thesis::gaussian_product`] has the
//! equations.
//!
//! Nothing here takes a sine or an arc tangent of an angle: with the relative orientation
//! d = (w, v) = (cos θ/2, n sin θ/2), all is a function of u = v/(1 + w) = n tan θ/4.

use glam::{DMat3, DQuat};

use crate::lanes::{LANES, Lanes, Quad};
use crate::policy::thesis::gaussian_field::GaussianQuad;
use crate::policy::thesis::gaussian_product::PoseGaussian;
use tprmp_spatial::Pose;

/// Bound on the Gauss–Newton iterations of a product; factors within 1 rad of one another take
/// some six.
const ITERATIONS_MAX: usize = 50;
/// The iterations stop at this change of the mean's orientation \[rad\]; what is left is less.
const ROTATION_TOLERANCE: f64 = 1e-11;
/// In so many iterations the matrix is that of the place; later ones use the last of them, which
/// is close.
const REFRESHED: usize = 2;

/// Gaussians on poses of four components, one in each lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoseQuad<const D: usize> {
    position: [Quad; 3],
    /// x, y, z, w.
    orientation: [Quad; 4],
    /// Its lower triangle counts.
    precision: [[Quad; D]; D],
}

/// A frame, ready to transform with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    position: [f64; 3],
    /// x, y, z, w.
    orientation: [f64; 4],
    /// Rows.
    rotation: [[f64; 3]; 3],
}

impl Frame {
    pub(crate) fn new(pose: &Pose) -> Self {
        let orientation = pose.orientation.normalize();
        Self {
            position: pose.position.to_array(),
            orientation: orientation.to_array(),
            rotation: DMat3::from_quat(orientation).transpose().to_cols_array_2d(),
        }
    }
}

type Vector<L> = [L; 3];
type Matrix<L> = [[L; 3]; 3];
/// x, y, z, w.
type Quaternion<L> = [L; 4];

#[inline(always)]
fn dot<L: Lanes>(a: &Vector<L>, b: &Vector<L>) -> L {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A b
#[inline(always)]
fn matrix_times<L: Lanes>(a: &Matrix<L>, b: &Vector<L>) -> Vector<L> {
    [dot(&a[0], b), dot(&a[1], b), dot(&a[2], b)]
}

/// A Bᵀ
#[inline(always)]
fn times_transposed<L: Lanes>(a: &Matrix<L>, b: &Matrix<L>) -> Matrix<L> {
    [matrix_times(b, &a[0]), matrix_times(b, &a[1]), matrix_times(b, &a[2])]
}

#[inline(always)]
fn transposed<L: Lanes>(a: &Matrix<L>) -> Matrix<L> {
    [[a[0][0], a[1][0], a[2][0]], [a[0][1], a[1][1], a[2][1]], [a[0][2], a[1][2], a[2][2]]]
}

/// p ⊗ q
#[inline(always)]
fn hamilton<L: Lanes>(p: &Quaternion<L>, q: &Quaternion<L>) -> Quaternion<L> {
    let (&[a, b, c, w], &[x, y, z, r]) = (p, q);
    [
        w * x + r * a + (b * z - c * y),
        w * y + r * b + (c * x - a * z),
        w * z + r * c + (a * y - b * x),
        w * r - (a * x + b * y + c * z),
    ]
}

#[inline(always)]
fn conjugate<L: Lanes>(&[x, y, z, w]: &Quaternion<L>) -> Quaternion<L> {
    [-x, -y, -z, w]
}

#[inline(always)]
fn load<L: Lanes, const N: usize>(values: &[Quad; N]) -> [L; N] {
    let mut lanes = [L::zero(); N];
    for i in 0..N {
        lanes[i] = L::load(&values[i]);
    }
    lanes
}

#[inline(always)]
fn splat<L: Lanes, const N: usize>(values: &[f64; N]) -> [L; N] {
    crate::lanes::splat_all(values)
}

#[inline(always)]
fn store<L: Lanes, const N: usize>(lanes: &[L; N], values: &mut [Quad; N]) {
    for i in 0..N {
        values[i] = lanes[i].store();
    }
}

/// arctan(x)/x as a function of x² for |x| ≤ 7/16, to a unit in the last place: coefficients of
/// fdlibm's `s_atan.c`.
#[inline(always)]
fn arc_tangent_fraction<L: Lanes>(squared: L) -> L {
    const COEFFICIENTS: [f64; 11] = [
        3.333_333_333_333_293e-1,
        -1.999_999_999_987_648_3e-1,
        1.428_571_427_250_346_6e-1,
        -1.111_111_040_546_235_6e-1,
        9.090_887_133_436_507e-2,
        -7.691_876_205_044_83e-2,
        6.661_073_137_387_531e-2,
        -5.833_570_133_790_573_5e-2,
        4.976_877_994_615_932_4e-2,
        -3.653_157_274_421_691_6e-2,
        1.628_582_011_536_578_2e-2,
    ];
    let mut sum = L::splat(COEFFICIENTS[10]);
    for i in (0..10).rev() {
        sum = sum * squared + L::splat(COEFFICIENTS[i]);
    }
    L::splat(1.0) - squared * sum
}

/// A rotation by θ ≤ π about n.
struct Turn<L> {
    /// u = n tan θ/4.
    quarter: Vector<L>,
    /// |u|².
    squared: L,
    /// The rotation vector r = n θ \[rad\].
    vector: Vector<L>,
    /// k = sin(θ/2)/θ.
    half_sine_fraction: L,
}

impl<L: Lanes> Turn<L> {
    /// Of a unit quaternion; of q and −q the one with w ≥ 0.
    #[inline(always)]
    fn new(&[x, y, z, w]: &Quaternion<L>) -> Self {
        let one = L::splat(1.0);
        let sign = w.choose(0.0, -one, one);
        let scale = sign / (one + sign * w);
        let quarter = [x * scale, y * scale, z * scale];
        let squared = dot(&quarter, &quarter);
        // n tan θ/8 = u/(1 + √(1 + |u|²)), whose length is at most √2 − 1.
        let denominator = one + (one + squared).sqrt();
        let eighth = one / denominator;
        let fraction = arc_tangent_fraction(squared * eighth * eighth);
        let length = L::splat(8.0) * eighth * fraction;
        Self {
            quarter,
            squared,
            vector: [quarter[0] * length, quarter[1] * length, quarter[2] * length],
            half_sine_fraction: denominator / (L::splat(4.0) * (one + squared) * fraction),
        }
    }

    /// The rotation by half the angle: parallel transport back along it, in body axes.
    #[inline(always)]
    fn half(&self) -> Matrix<L> {
        // R = I + 2 (\[u\]ₓ + \[u\]ₓ²)/(1 + |u|²), the Cayley transform.
        let scale = L::splat(2.0) / (L::splat(1.0) + self.squared);
        self.series(L::splat(1.0) - scale * self.squared, scale, scale, &self.quarter)
    }

    /// J_r(r), and its determinant.
    #[inline(always)]
    fn right_jacobian(&self) -> (Matrix<L>, L) {
        // With a = (1 − cos θ)/θ² and b = (θ − sin θ)/θ³: J_r = I − a \[r\]ₓ + b \[r\]ₓ², det J_r = 2a.
        let one = L::splat(1.0);
        let k = self.half_sine_fraction;
        let a = L::splat(2.0) * k * k;
        // sin θ/θ = 1 − b θ². Where θ² is lost in rounding b does not matter, but has to be finite.
        let cosine = (one - self.squared) / (one + self.squared);
        let sine_fraction = L::splat(2.0) * cosine * k;
        let angle_squared = dot(&self.vector, &self.vector).at_least(1e-200);
        let b = (one - sine_fraction) / angle_squared;
        (self.series(sine_fraction, -a, b, &self.vector), a + a)
    }

    /// α I + β \[v\]ₓ + γ v vᵀ
    #[inline(always)]
    fn series(&self, alpha: L, beta: L, gamma: L, v: &Vector<L>) -> Matrix<L> {
        let [x, y, z] = *v;
        let (cx, cy, cz) = (gamma * x, gamma * y, gamma * z);
        let (bx, by, bz) = (beta * x, beta * y, beta * z);
        [
            [alpha + cx * x, cx * y - bz, cx * z + by],
            [cx * y + bz, alpha + cy * y, cy * z - bx],
            [cx * z - by, cy * z + bx, alpha + cz * z],
        ]
    }
}

/// Blocks of a precision on \[position; rotation vector\].
struct Blocks<L> {
    /// Symmetric.
    linear: Matrix<L>,
    /// Rows: rotation; columns: position.
    cross: Matrix<L>,
    /// Symmetric.
    angular: Matrix<L>,
}

/// A S Aᵀ for a symmetric S.
#[inline(always)]
fn congruence<L: Lanes>(a: &Matrix<L>, s: &Matrix<L>) -> Matrix<L> {
    let product = times_transposed(a, s);
    let mut result = [[L::zero(); 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            result[i][j] = dot(&product[i], &a[j]);
            result[j][i] = result[i][j];
        }
    }
    result
}

impl<L: Lanes> Blocks<L> {
    #[inline(always)]
    fn load<const D: usize>(precision: &[[Quad; D]; D]) -> Self {
        let zero = [[L::zero(); 3]; 3];
        let mut blocks = Self { linear: zero, cross: zero, angular: zero };
        for i in 0..D.min(3) {
            for j in 0..D.min(3) {
                blocks.linear[i][j] = L::load(&precision[i.max(j)][i.min(j)]);
                if D == 6 {
                    blocks.cross[i][j] = L::load(&precision[i + 3][j]);
                    blocks.angular[i][j] = L::load(&precision[i.max(j) + 3][i.min(j) + 3]);
                }
            }
        }
        blocks
    }

    #[inline(always)]
    fn store<const D: usize>(&self, precision: &mut [[Quad; D]; D]) {
        for i in 0..D.min(3) {
            for j in 0..=i {
                precision[i][j] = self.linear[i][j].store();
            }
        }
        if D == 6 {
            for i in 0..3 {
                for j in 0..3 {
                    precision[i + 3][j] = self.cross[i][j].store();
                }
                for j in 0..=i {
                    precision[i + 3][j + 3] = self.angular[i][j].store();
                }
            }
        }
    }

    /// T Λ Tᵀ with T = diag(I, B).
    #[inline(always)]
    fn turned(&self, rotation: &Matrix<L>) -> Self {
        Self {
            linear: self.linear,
            cross: transposed(&times_transposed(&transposed(&self.cross), rotation)),
            angular: congruence(rotation, &self.angular),
        }
    }
}

impl<const D: usize> PoseQuad<D> {
    pub(crate) const NONE: Self = Self {
        position: [[0.0; LANES]; 3],
        orientation: [[0.0; LANES]; 4],
        precision: [[[0.0; LANES]; D]; D],
    };

    pub(crate) fn set(&mut self, lane: usize, gaussian: &PoseGaussian<D>) {
        let orientation = gaussian.mean.orientation.normalize().to_array();
        for i in 0..3 {
            self.position[i][lane] = gaussian.mean.position[i];
        }
        for (own, value) in self.orientation.iter_mut().zip(orientation) {
            own[lane] = value;
        }
        for i in 0..D {
            for j in 0..=i {
                self.precision[i][j][lane] = gaussian.precision[(i, j)];
            }
        }
    }

    /// The Gaussian of a lane.
    pub(crate) fn get(&self, lane: usize) -> PoseGaussian<D> {
        let at = |quads: &[Quad], i: usize| quads[i][lane];
        let orientation = core::array::from_fn(|i| at(&self.orientation, i));
        PoseGaussian {
            mean: Pose {
                position: core::array::from_fn(|i| at(&self.position, i)).into(),
                orientation: DQuat::from_array(orientation),
            },
            precision: nalgebra::SMatrix::from_fn(|i, j| self.precision[i.max(j)][i.min(j)][lane]),
        }
    }

    /// Gaussians given in a frame, in the coordinates in which the frame is given: as
    /// [`PoseGaussian::transformed`].
    #[inline(always)]
    pub(crate) fn transform<L: Lanes>(&self, frame: &Frame, result: &mut Self) {
        let rotation: Matrix<L> =
            [splat(&frame.rotation[0]), splat(&frame.rotation[1]), splat(&frame.rotation[2])];
        let mut position = matrix_times(&rotation, &load(&self.position));
        for i in 0..3 {
            position[i] = position[i] + L::splat(frame.position[i]);
        }
        store(&position, &mut result.position);
        let orientation = hamilton(&splat(&frame.orientation), &load::<L, 4>(&self.orientation));
        store(&orientation, &mut result.orientation);
        let Blocks { linear, cross, angular } = Blocks::<L>::load(&self.precision);
        Blocks {
            linear: congruence(&rotation, &linear),
            cross: times_transposed(&cross, &rotation),
            angular,
        }
        .store(&mut result.precision);
    }

    /// The products of these factors, normalised, and the determinants of their precisions:
    /// as [`crate::policy::thesis::gaussian_product::product`].
    ///
    /// * `strongest`  for each lane, the factor at which the iterations start
    ///
    /// `None` for what is not finite.
    #[inline(always)]
    pub(crate) fn product<L: Lanes>(
        factors: &[Self],
        strongest: &[usize; LANES],
    ) -> Option<(Self, L)> {
        let mut start = Self::NONE;
        for (lane, factor) in strongest.iter().enumerate() {
            let factor = factors.get(*factor)?;
            for i in 0..3 {
                start.position[i][lane] = factor.position[i][lane];
            }
            for i in 0..4 {
                start.orientation[i][lane] = factor.orientation[i][lane];
            }
        }
        let mut position: Vector<L> = load(&start.position);
        let mut orientation: Quaternion<L> = load(&start.orientation);
        let mut factor = Factor::new(&precision(factors, &orientation));
        for iteration in 0..ITERATIONS_MAX {
            if D == 6 && (1..REFRESHED).contains(&iteration) {
                factor = Factor::new(&precision(factors, &orientation));
            }
            let step = factor.solve(&pull(factors, &position, &orientation));
            for i in 0..D.min(3) {
                position[i] = position[i] + step[i];
            }
            if D < 6 {
                break;
            }
            let turn = [step[3], step[4], step[5]];
            orientation = turned(&orientation, &turn);
            let size = largest(dot(&turn, &turn));
            if size <= ROTATION_TOLERANCE * ROTATION_TOLERANCE || size.is_nan() {
                break;
            }
        }
        let precision = precision(factors, &orientation);
        let determinant = Factor::new(&precision).determinant;
        let mut product = start;
        store(&position, &mut product.position);
        store(&orientation, &mut product.orientation);
        for i in 0..D {
            for j in 0..=i {
                product.precision[i][j] = precision[i][j].store();
            }
        }
        let sum = dot(&position, &position) + orientation[3] + determinant;
        largest(sum).is_finite().then_some((product, determinant))
    }

    /// The Gaussians in the chart y = \[x; r\] with q = c exp(r): mean, precision Tᵀ Λ T with
    /// T = diag(I, J_r(r)), and normaliser.
    ///
    /// * `determinant`  of the precisions
    /// * `center`  c, unit
    #[inline(always)]
    pub(crate) fn chart<L: Lanes>(
        &self,
        determinant: L,
        center: DQuat,
        result: &mut GaussianQuad<D>,
    ) {
        let mut normaliser = determinant.sqrt();
        for i in 0..D.min(3) {
            result.mean[i] = self.position[i];
        }
        if D == 6 {
            let center = conjugate(&splat::<L, 4>(&center.to_array()));
            let turn = Turn::new(&hamilton(&center, &load(&self.orientation)));
            for i in 0..3 {
                result.mean[i + 3] = turn.vector[i].store();
            }
            let (jacobian, scale) = turn.right_jacobian();
            normaliser = normaliser * scale;
            let blocks = Blocks::<L>::load(&self.precision);
            blocks.turned(&transposed(&jacobian)).store(&mut result.precision);
        } else {
            result.precision = self.precision;
        }
        result.normaliser = normaliser.store();
    }
}

/// q ⊗ (1, r/2), normalised: the rotation vector r away, to third order.
#[inline(always)]
fn turned<L: Lanes>(orientation: &Quaternion<L>, turn: &Vector<L>) -> Quaternion<L> {
    let half = L::splat(0.5);
    let step = [turn[0] * half, turn[1] * half, turn[2] * half, L::splat(1.0)];
    let [x, y, z, w] = hamilton(orientation, &step);
    let scale = L::splat(1.0) / (x * x + y * y + z * z + w * w).sqrt();
    [x * scale, y * scale, z * scale, w * scale]
}

/// The largest lane; not a number when one is none.
#[inline(always)]
fn largest<L: Lanes>(values: L) -> f64 {
    let [a, b, c, d] = values.store();
    if (a + b + c + d).is_nan() { f64::NAN } else { a.max(b).max(c.max(d)) }
}

/// Σ_p Λ_p∥ at an orientation; its lower triangle.
#[inline(always)]
fn precision<L: Lanes, const D: usize>(
    factors: &[PoseQuad<D>],
    orientation: &Quaternion<L>,
) -> [[L; D]; D] {
    let mut sum = [[L::zero(); D]; D];
    for factor in factors {
        let mut blocks = Blocks::load(&factor.precision);
        if D == 6 {
            let turn = Turn::new(&hamilton(&conjugate(orientation), &load(&factor.orientation)));
            blocks = blocks.turned(&turn.half());
        }
        for i in 0..D.min(3) {
            for j in 0..=i {
                sum[i][j] = sum[i][j] + blocks.linear[i][j];
            }
        }
        if D == 6 {
            for i in 0..3 {
                for j in 0..3 {
                    sum[i + 3][j] = sum[i + 3][j] + blocks.cross[i][j];
                }
                for j in 0..=i {
                    sum[i + 3][j + 3] = sum[i + 3][j + 3] + blocks.angular[i][j];
                }
            }
        }
    }
    sum
}

/// Σ_p Λ_p∥ \[x_p − x̂; r_p\] at a pose, r_p = log(q̂⁻¹ q_p).
///
/// Transport T_p turns about r_p, so that T_pᵀ r_p = r_p: matrices are not turned for it.
#[inline(always)]
fn pull<L: Lanes, const D: usize>(
    factors: &[PoseQuad<D>],
    position: &Vector<L>,
    orientation: &Quaternion<L>,
) -> [L; D] {
    let mut sum = [L::zero(); D];
    for factor in factors {
        let place: Vector<L> = load(&factor.position);
        let mut offset = [L::zero(); 3];
        for i in 0..D.min(3) {
            offset[i] = place[i] - position[i];
        }
        let blocks = Blocks::load(&factor.precision);
        let mut linear = matrix_times(&blocks.linear, &offset);
        if D == 6 {
            let turn = Turn::new(&hamilton(&conjugate(orientation), &load(&factor.orientation)));
            let crossed = matrix_times(&transposed(&blocks.cross), &turn.vector);
            let (along, about) =
                (matrix_times(&blocks.cross, &offset), matrix_times(&blocks.angular, &turn.vector));
            let mut angular = [L::zero(); 3];
            for i in 0..3 {
                linear[i] = linear[i] + crossed[i];
                angular[i] = along[i] + about[i];
            }
            let angular = matrix_times(&turn.half(), &angular);
            for i in 0..3 {
                sum[i + 3] = sum[i + 3] + angular[i];
            }
        }
        for i in 0..D.min(3) {
            sum[i] = sum[i] + linear[i];
        }
    }
    sum
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
        let mut lower = [[L::zero(); D]; D];
        let mut inverse = [L::zero(); D];
        let mut determinant = L::splat(1.0);
        for i in 0..D {
            // Row i of L D, then of L.
            for j in 0..i {
                lower[i][j] = a[i][j];
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
