//! Rotations of four components at once. Nothing here takes a sine or an arc tangent of an angle:
//! with the unit quaternion (v, w) = (n sin θ/2, cos θ/2) all is a function of u = v/(1 + w) = n tan θ/4.

use crate::lanes::{Lanes, dot};

pub(super) type Vector<S> = [S; 3];
/// Rows.
pub(super) type Matrix<S> = [[S; 3]; 3];
/// x, y, z, w.
pub(super) type Quaternion<S> = [S; 4];

/// A b
#[inline(always)]
pub(super) fn matrix_times<L: Lanes>(a: &Matrix<L>, b: &Vector<L>) -> Vector<L> {
    [dot(&a[0], b), dot(&a[1], b), dot(&a[2], b)]
}

/// p ⊗ q
#[inline(always)]
pub(super) fn hamilton<L: Lanes>(p: &Quaternion<L>, q: &Quaternion<L>) -> Quaternion<L> {
    let (&[a, b, c, w], &[x, y, z, r]) = (p, q);
    [
        w * x + r * a + (b * z - c * y),
        w * y + r * b + (c * x - a * z),
        w * z + r * c + (a * y - b * x),
        w * r - (a * x + b * y + c * z),
    ]
}

/// q ⊗ (1, r/2), normalised: the rotation vector r away, to third order.
#[inline(always)]
pub(super) fn rotated<L: Lanes>(orientation: &Quaternion<L>, r: &Vector<L>) -> Quaternion<L> {
    let half = L::splat(0.5);
    let step = [r[0] * half, r[1] * half, r[2] * half, L::splat(1.0)];
    let q = hamilton(orientation, &step);
    let scale = L::splat(1.0) / dot(&q, &q).sqrt();
    [q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale]
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
pub(super) struct Rotation<L> {
    /// The rotation vector r = n θ \[rad\].
    pub(super) vector: Vector<L>,
    /// u = n tan θ/4.
    quarter: Vector<L>,
    /// |u|².
    squared: L,
    /// sin(θ/2)/θ.
    half_sine_fraction: L,
}

impl<L: Lanes> Rotation<L> {
    /// p⁻¹ ⊗ q of unit quaternions, the shorter way round.
    #[inline(always)]
    pub(super) fn between(&[x, y, z, w]: &Quaternion<L>, q: &Quaternion<L>) -> Self {
        let [x, y, z, w] = hamilton(&[-x, -y, -z, w], q);
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
            vector: [quarter[0] * length, quarter[1] * length, quarter[2] * length],
            quarter,
            squared,
            half_sine_fraction: denominator / (L::splat(4.0) * (one + squared) * fraction),
        }
    }

    /// The rotation by half the angle: parallel transport from q back to p, in body axes.
    #[inline(always)]
    pub(super) fn transport(&self) -> Matrix<L> {
        // R = I + 2 (\[u\]ₓ + \[u\]ₓ²)/(1 + |u|²), the Cayley transform.
        let scale = L::splat(2.0) / (L::splat(1.0) + self.squared);
        series(L::splat(1.0) - scale * self.squared, scale, scale, &self.quarter)
    }

    /// J_l(r) = J_r(r)ᵀ, and its determinant.
    #[inline(always)]
    pub(super) fn left_jacobian(&self) -> (Matrix<L>, L) {
        // With a = (1 − cos θ)/θ² and b = (θ − sin θ)/θ³: J_l = I + a \[r\]ₓ + b \[r\]ₓ², det J_l = 2a.
        let one = L::splat(1.0);
        let k = self.half_sine_fraction;
        let a = L::splat(2.0) * k * k;
        // sin θ/θ = 1 − b θ². Where θ² is lost in rounding b does not matter, but has to be finite.
        let cosine = (one - self.squared) / (one + self.squared);
        let sine_fraction = L::splat(2.0) * cosine * k;
        let angle_squared = dot(&self.vector, &self.vector).at_least(1e-200);
        let b = (one - sine_fraction) / angle_squared;
        (series(sine_fraction, a, b, &self.vector), a + a)
    }
}

/// α I + β \[v\]ₓ + γ v vᵀ
#[inline(always)]
fn series<L: Lanes>(alpha: L, beta: L, gamma: L, &[x, y, z]: &Vector<L>) -> Matrix<L> {
    let (cx, cy, cz) = (gamma * x, gamma * y, gamma * z);
    let (bx, by, bz) = (beta * x, beta * y, beta * z);
    [
        [alpha + cx * x, cx * y - bz, cx * z + by],
        [cx * y + bz, alpha + cy * y, cy * z - bx],
        [cx * z - by, cy * z + bx, alpha + cz * z],
    ]
}
