//! Four numbers at once, on AVX2 where the machine has it.
//!
//! What is written once as a [`Kernel`] runs on AVX2 registers or, where there are none, on plain
//! arrays; [`run`] chooses while the program runs, so that one build serves every machine. Both do
//! the same IEEE operations in the same order, and none is fused, so that the results are the same
//! bit for bit. (Fused multiply–adds save a twentieth of an evaluation, and would cost that.)

use core::ops::{Add, Div, Mul, Neg, Sub};

use nalgebra::SVector;

/// How many numbers.
pub(crate) const LANES: usize = 4;

/// Four numbers as they lie in memory.
pub(crate) type Quad = [f64; LANES];

/// The arithmetic of four numbers, lane by lane.
pub(crate) trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The same number four times.
    fn splat(value: f64) -> Self;
    /// Four numbers from memory.
    fn load(values: &Quad) -> Self;
    /// Four numbers to memory.
    fn store(self) -> Quad;
    /// √self
    fn sqrt(self) -> Self;
    /// self where it is less than `other`, else `other`.
    fn smaller(self, other: Self) -> Self;
    /// self where it is greater than `other`, else `other`.
    fn larger(self, other: Self) -> Self;
    /// `small` where self ≤ bound, else `large`.
    fn choose(self, bound: f64, small: Self, large: Self) -> Self;
    /// 2ⁿ for n = self − [`ROUNDER`], a whole number from −1022 to 1023.
    fn power_of_two(self) -> Self;
    /// The sum of the lanes of each: (l₀ + l₁) + (l₂ + l₃).
    fn sums(rows: [Self; 4]) -> Quad;

    /// 0
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }

    /// Not below a floor; what is not a number stays that.
    #[inline(always)]
    fn at_least(self, floor: f64) -> Self {
        Self::splat(floor).larger(self)
    }

    /// Not above a ceiling; what is not a number stays that.
    #[inline(always)]
    fn at_most(self, ceiling: f64) -> Self {
        Self::splat(ceiling).smaller(self)
    }

    /// The sum of its lanes.
    #[inline(always)]
    fn sum(self) -> f64 {
        let [a, b, c, d] = self.store();
        (a + b) + (c + d)
    }

    /// eˣ to one unit in the last place, for |x| ≤ 708; beyond, as if it were ±708.
    ///
    /// x = n ln 2 + r with |r| ≤ ½ ln 2; the Taylor polynomial of degree 13 leaves out less than
    /// 5e-18 of eʳ.
    #[inline(always)]
    fn exp(self) -> Self {
        const LN_2_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
        const LN_2_LOW: f64 = f64::from_bits(0x3dea_39ef_3579_3c76);
        let x = self.at_least(-EXPONENT_MAX).at_most(EXPONENT_MAX);
        let rounded = x * Self::splat(core::f64::consts::LOG2_E) + Self::splat(ROUNDER);
        let n = rounded - Self::splat(ROUNDER);
        // n has 11 bits and the higher part of ln 2 has 33, so that their product is exact.
        let r = (x - n * Self::splat(LN_2_HIGH)) - n * Self::splat(LN_2_LOW);
        let r2 = r * r;
        let r4 = r2 * r2;
        let pair = |i: usize| {
            Self::splat(INVERSE_FACTORIALS[i]) + r * Self::splat(INVERSE_FACTORIALS[i + 1])
        };
        let low = pair(2) + r2 * pair(4);
        let middle = pair(6) + r2 * pair(8);
        let high = pair(10) + r2 * pair(12);
        let tail = low + r4 * (middle + r4 * high);
        (Self::splat(1.0) + (r + r2 * tail)) * rounded.power_of_two()
    }
}

/// Largest exponent of [`Lanes::exp`].
const EXPONENT_MAX: f64 = 708.0;
/// 1.5 · 2⁵²: adding it rounds a number to a whole one, which its last bits then hold.
const ROUNDER: f64 = 6_755_399_441_055_744.0;
/// Exponent bias of a double.
const BIAS: i64 = 1023;

/// 1/n!
const INVERSE_FACTORIALS: [f64; 14] = {
    let mut table = [1.0; 14];
    // n! is exact up to 18!, so that each entry is rounded once.
    let (mut n, mut factorial) = (1, 1.0);
    while n < 14 {
        factorial *= n as f64;
        table[n] = 1.0 / factorial;
        n += 1;
    }
    table
};

/// The same numbers in all lanes.
#[inline(always)]
pub(crate) fn splat_all<L: Lanes, const D: usize>(values: &[f64; D]) -> [L; D] {
    let mut lanes = [L::zero(); D];
    for i in 0..D {
        lanes[i] = L::splat(values[i]);
    }
    lanes
}

/// Four numbers from memory for each entry.
#[inline(always)]
pub(crate) fn load_all<L: Lanes, const D: usize>(values: &[Quad; D]) -> [L; D] {
    let mut lanes = [L::zero(); D];
    for i in 0..D {
        lanes[i] = L::load(&values[i]);
    }
    lanes
}

/// Four numbers to memory for each entry.
#[inline(always)]
pub(crate) fn store_all<L: Lanes, const D: usize>(lanes: &[L; D]) -> [Quad; D] {
    let mut values = [[0.0; LANES]; D];
    for i in 0..D {
        values[i] = lanes[i].store();
    }
    values
}

/// [`load_all`] of each row.
#[inline(always)]
pub(crate) fn load_rows<L: Lanes, const C: usize, const R: usize>(
    values: &[[Quad; C]; R],
) -> [[L; C]; R] {
    let mut rows = [[L::zero(); C]; R];
    for i in 0..R {
        rows[i] = load_all(&values[i]);
    }
    rows
}

/// [`store_all`] of each row.
#[inline(always)]
pub(crate) fn store_rows<L: Lanes, const C: usize, const R: usize>(
    rows: &[[L; C]; R],
) -> [[Quad; C]; R] {
    let mut values = [[[0.0; LANES]; C]; R];
    for i in 0..R {
        values[i] = store_all(&rows[i]);
    }
    values
}

/// aᵀb
#[inline(always)]
pub(crate) fn dot<L: Lanes, const D: usize>(a: &[L; D], b: &[L; D]) -> L {
    let mut sum = a[0] * b[0];
    for i in 1..D {
        sum = sum + a[i] * b[i];
    }
    sum
}

/// S v, with the lower triangle of a symmetric S in memory.
#[inline(always)]
pub(crate) fn symmetric_times<L: Lanes, const D: usize>(
    matrix: &[[Quad; D]; D],
    v: &[L; D],
) -> [L; D] {
    let mut product = [L::zero(); D];
    for i in 0..D {
        let entry = |j: usize| &matrix[i.max(j)][i.min(j)];
        let mut sum = L::load(entry(0)) * v[0];
        for j in 1..D {
            sum = sum + L::load(entry(j)) * v[j];
        }
        product[i] = sum;
    }
    product
}

/// sum += s v
#[inline(always)]
pub(crate) fn add_scaled<L: Lanes, const D: usize>(sum: &mut [L; D], v: &[L; D], s: L) {
    for i in 0..D {
        sum[i] = sum[i] + v[i] * s;
    }
}

/// The sum of the lanes of each row.
#[inline(always)]
pub(crate) fn sums<L: Lanes, const D: usize>(rows: &[L; D]) -> SVector<f64, D> {
    let mut result = SVector::zeros();
    for first in (0..D).step_by(LANES) {
        let mut group = [L::zero(); LANES];
        for (lanes, row) in group.iter_mut().zip(&rows[first..]) {
            *lanes = *row;
        }
        for (i, sum) in L::sums(group).into_iter().enumerate().take(D - first) {
            result[first + i] = sum;
        }
    }
    result
}

/// A computation that is written once for all lanes.
pub(crate) trait Kernel {
    /// What comes out.
    type Output;
    /// Does it. Has to be `#[inline(always)]`, and all it calls with lanes too: only then AVX2 is
    /// used.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// Runs a kernel on the widest lanes of this machine.
///
/// Hot path: the machine is asked once; later calls look the answer up.
#[inline]
pub(crate) fn run<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(machine) = avx2::Machine::detect() {
        return machine.run(kernel);
    }
    run_portable(kernel)
}

/// Runs a kernel without the machine's vector registers; gives what [`run`] gives.
pub(crate) fn run_portable<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Portable>()
}

/// Lanes of any machine.
#[derive(Clone, Copy)]
struct Portable(Quad);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let ([a, b, c, d], [e, g, h, i]) = (self.0, other.0);
        Self([f(a, e), f(b, g), f(c, h), f(d, i)])
    }
}

impl Add for Portable {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Portable {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Portable {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Div for Portable {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }
}

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|a| -a))
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn load(values: &Quad) -> Self {
        Self(*values)
    }
    #[inline(always)]
    fn store(self) -> Quad {
        self.0
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
    }
    #[inline(always)]
    fn smaller(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn choose(self, bound: f64, small: Self, large: Self) -> Self {
        let lane = |i: usize| if self.0[i] <= bound { small.0[i] } else { large.0[i] };
        Self([lane(0), lane(1), lane(2), lane(3)])
    }
    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self(self.0.map(|a| f64::from_bits(a.to_bits().wrapping_add(BIAS as u64) << 52)))
    }
    #[inline(always)]
    fn sums(rows: [Self; 4]) -> Quad {
        rows.map(Self::sum)
    }
}

#[cfg(target_arch = "x86_64")]
#[expect(
    unsafe_code,
    reason = "processor instructions are unsafe to call where the machine may not have them"
)]
mod avx2 {
    use core::arch::x86_64::{
        __m256d, _CMP_LE_OQ, _mm256_add_epi64, _mm256_add_pd, _mm256_blend_pd, _mm256_blendv_pd,
        _mm256_castpd_si256, _mm256_castsi256_pd, _mm256_cmp_pd, _mm256_div_pd, _mm256_hadd_pd,
        _mm256_max_pd, _mm256_min_pd, _mm256_mul_pd, _mm256_permute2f128_pd, _mm256_set1_epi64x,
        _mm256_set1_pd, _mm256_setr_pd, _mm256_slli_epi64, _mm256_sqrt_pd, _mm256_storeu_pd,
        _mm256_sub_pd, _mm256_xor_pd,
    };
    use core::ops::{Add, Div, Mul, Neg, Sub};

    use super::{BIAS, Kernel, LANES, Lanes, Quad};

    /// The proof that the machine has AVX2.
    pub(super) struct Machine(());

    impl Machine {
        #[inline]
        pub(super) fn detect() -> Option<Self> {
            std::arch::is_x86_feature_detected!("avx2").then_some(Self(()))
        }

        #[inline]
        pub(super) fn run<K: Kernel>(&self, kernel: K) -> K::Output {
            #[target_feature(enable = "avx2")]
            fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
                kernel.run::<Avx2>()
            }
            // SAFETY: the machine has AVX2.
            unsafe { with_avx2(kernel) }
        }
    }

    /// Lanes of an AVX2 register. They exist inside [`Machine::run`] alone, hence on machines with
    /// AVX2 alone: that is what makes every block below sound.
    #[derive(Clone, Copy)]
    struct Avx2(__m256d);

    impl Add for Avx2 {
        type Output = Self;
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe { _mm256_add_pd(self.0, other.0) })
        }
    }

    impl Sub for Avx2 {
        type Output = Self;
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe { _mm256_sub_pd(self.0, other.0) })
        }
    }

    impl Mul for Avx2 {
        type Output = Self;
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe { _mm256_mul_pd(self.0, other.0) })
        }
    }

    impl Div for Avx2 {
        type Output = Self;
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe { _mm256_div_pd(self.0, other.0) })
        }
    }

    impl Neg for Avx2 {
        type Output = Self;
        #[inline(always)]
        fn neg(self) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe { _mm256_xor_pd(self.0, _mm256_set1_pd(-0.0)) })
        }
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        fn splat(value: f64) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe { _mm256_set1_pd(value) })
        }
        #[inline(always)]
        fn load(&[a, b, c, d]: &Quad) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe { _mm256_setr_pd(a, b, c, d) })
        }
        #[inline(always)]
        fn store(self) -> Quad {
            let mut values = [0.0; LANES];
            // SAFETY: see `Avx2`; the array has room for four numbers.
            unsafe { _mm256_storeu_pd(values.as_mut_ptr(), self.0) };
            values
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe { _mm256_sqrt_pd(self.0) })
        }
        #[inline(always)]
        fn smaller(self, other: Self) -> Self {
            // SAFETY: see `Avx2`. Of two that do not compare the second one is taken.
            Self(unsafe { _mm256_min_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn larger(self, other: Self) -> Self {
            // SAFETY: see `Avx2`. Of two that do not compare the second one is taken.
            Self(unsafe { _mm256_max_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn choose(self, bound: f64, small: Self, large: Self) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe {
                let is_small = _mm256_cmp_pd::<_CMP_LE_OQ>(self.0, _mm256_set1_pd(bound));
                _mm256_blendv_pd(large.0, small.0, is_small)
            })
        }
        #[inline(always)]
        fn power_of_two(self) -> Self {
            // SAFETY: see `Avx2`.
            Self(unsafe {
                let n = _mm256_add_epi64(_mm256_castpd_si256(self.0), _mm256_set1_epi64x(BIAS));
                _mm256_castsi256_pd(_mm256_slli_epi64::<52>(n))
            })
        }
        #[inline(always)]
        fn sums([a, b, c, d]: [Self; 4]) -> Quad {
            // SAFETY: see `Avx2`.
            Self(unsafe {
                // [a₀+a₁, b₀+b₁, a₂+a₃, b₂+b₃], and so for c and d.
                let (ab, cd) = (_mm256_hadd_pd(a.0, b.0), _mm256_hadd_pd(c.0, d.0));
                let crossed = _mm256_permute2f128_pd::<0x21>(ab, cd);
                let straight = _mm256_blend_pd::<0b1100>(ab, cd);
                _mm256_add_pd(straight, crossed)
            })
            .store()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// eˣ.
    struct Exp(Quad);

    impl Kernel for Exp {
        type Output = Quad;
        #[inline(always)]
        fn run<L: Lanes>(self) -> Quad {
            L::load(&self.0).exp().store()
        }
    }

    /// Everything else.
    struct Mixed([Quad; 4]);

    impl Kernel for Mixed {
        type Output = Quad;
        #[inline(always)]
        fn run<L: Lanes>(self) -> Quad {
            let [a, b, c, d] = self.0.map(|quad| L::load(&quad));
            let e = (a * b + c / d - -a).at_least(-3.0).at_most(5.0);
            let f = (b * b).sqrt() + L::zero();
            L::sums([e, f, c.choose(0.5, e, f), L::splat(e.sum())])
        }
    }

    /// Distance in units in the last place.
    fn distance(found: f64, expected: f64) -> u64 {
        found.to_bits().abs_diff(expected.to_bits())
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..Default::default() })]

        #[test]
        fn exp_is_right_to_a_unit_in_the_last_place(x in prop::array::uniform4(-708.0..708.0), scale in -12..=0) {
            let x = x.map(|x| x * 2f64.powi(scale));
            for (found, x) in run(Exp(x)).into_iter().zip(x) {
                prop_assert!(distance(found, x.exp()) <= 1, "{found:e} {:e}", x.exp());
            }
            prop_assert_eq!(run(Exp(x)), run_portable(Exp(x)));
        }

        #[test]
        fn both_kinds_of_lanes_agree_to_the_bit(quads in prop::array::uniform4(prop::array::uniform4(-4.0..4.0))) {
            prop_assert_eq!(run(Mixed(quads)), run_portable(Mixed(quads)));
        }
    }

    #[test]
    fn exp_at_its_ends() {
        let special = [0.0, -0.0, f64::NAN, -1e-320];
        let far = [-1e300, f64::NEG_INFINITY, 1e300, f64::INFINITY];
        for kernel in [run::<Exp> as fn(Exp) -> Quad, run_portable] {
            let [one, other, nan, tiny] = kernel(Exp(special));
            assert!(one == 1.0 && other == 1.0 && nan.is_nan() && tiny == 1.0);
            let [a, b, c, d] = kernel(Exp(far));
            assert!(a == b && a > 0.0 && a < 1e-300 && c == d && c > 1e300 && c.is_finite());
        }
    }

    #[test]
    fn what_is_not_a_number_stays_that() {
        let quads = [[f64::NAN; LANES], [1.0; LANES], [1.0; LANES], [1.0; LANES]];
        assert!(run(Mixed(quads))[0].is_nan() && run_portable(Mixed(quads))[0].is_nan());
    }
}
