//! Proves that the valley of a field falls towards its goal everywhere, by interval arithmetic.
//!
//! For a phase s the potential is one quadratic of r = y − y_c, whatever y_c,
//!
//! ```text
//! Φ = A + Bᵀr + ½ rᵀH r          A = Σ w_k a_k,  B = Σ w_k b_k,  H = Σ w_k S_k
//! r* = −H⁻¹B                     r*′ = −H⁻¹(B′ + H′r*)
//! U′ = A′ + B′ᵀr* + ½ r*ᵀH′r*    U″ = A″ + B″ᵀr* + ½ r*ᵀH″r* + (B′ + H′r*)ᵀr*′
//! ```
//!
//! of functions of s alone. With them for an interval of phases in place of s, U′ and U″ are held by intervals,
//! too. On an interval around the goal U″ > 0: there U′ is zero once. Everywhere else U′ < 0 before the goal and
//! U′ > 0 after it, by U′ of the interval or by U′(m) + U″ (s − m); an interval on which neither says so is halved.

use nalgebra::{SMatrix, SVector};
use tprmp_rmpflow::policy::PHASE_RANGE;
use tprmp_rmpflow::policy::canonical::field::{Component, Field};

use crate::skill_model::interval::Interval;

/// Intervals that are examined before it is given up: a hundred times what a learned field needs.
const INTERVALS_MAX: u32 = 50_000;
/// The first interval around the goal reaches so far to each side, as a fraction of the phase.
const GOAL_FRACTION: f64 = 0.02;
/// It is given up at intervals narrower than this fraction of the phase.
const WIDTH_MIN: f64 = 1e-7;
/// Most coordinates beside the phase.
const MOST: usize = 3;

type Vector = [Interval; MOST];
type Matrix = [[Interval; MOST]; MOST];

const NOWHERE: Vector = [Interval::ZERO; MOST];

/// What was proved: over how many intervals. Or between which phases it was given up.
pub(crate) fn prove<const N: usize>(field: &Field<N>) -> Result<u32, [f64; 2]> {
    let length = field.goal()[N - 1];
    let [low, high] = PHASE_RANGE.map(|fraction| fraction * length);
    let mut examined = 0;
    let mut around = GOAL_FRACTION;
    let goal = loop {
        let goal = Interval { low: (1.0 - around) * length, high: (1.0 + around) * length };
        examined += 1;
        if slopes(field, goal).is_some_and(|[_, second]| second.is_above_zero()) {
            break goal;
        }
        around *= 0.5;
        if around < WIDTH_MIN {
            return Err([goal.low, goal.high]);
        }
    };
    let left =
        vec![(Interval { low, high: goal.low }, true), (Interval { low: goal.high, high }, false)];
    halve(field, left, examined, length)
}

/// The same of a skill that goes round: that the valley falls at each phase of a round, 0 to 1.
pub(crate) fn prove_round<const N: usize>(field: &Field<N>) -> Result<u32, [f64; 2]> {
    halve(field, vec![(Interval { low: 0.0, high: 1.0 }, true)], 0, 1.0)
}

/// Halves intervals until the valley is sure to fall on each: to the right where it is said, else to the left.
///
/// * `length`  what the phase one stands for
fn halve<const N: usize>(
    field: &Field<N>,
    mut left: Vec<(Interval, bool)>,
    mut examined: u32,
    length: f64,
) -> Result<u32, [f64; 2]> {
    while let Some((phases, before)) = left.pop() {
        examined += 1;
        if falls(field, phases, before) {
            continue;
        }
        let middle = phases.middle();
        if examined > INTERVALS_MAX || phases.high - phases.low < WIDTH_MIN * length {
            return Err([phases.low, phases.high]);
        }
        left.push((Interval { low: middle, ..phases }, before));
        left.push((Interval { high: middle, ..phases }, before));
    }
    Ok(examined)
}

/// Whether the valley is sure to fall towards the goal at all these phases.
fn falls<const N: usize>(field: &Field<N>, phases: Interval, before: bool) -> bool {
    let sure = |slope: Interval| if before { slope.is_below_zero() } else { slope.is_above_zero() };
    let Some([slope, second]) = slopes(field, phases) else { return false };
    if sure(slope) {
        return true;
    }
    let middle = phases.middle();
    let Some([at_middle, _]) = slopes(field, Interval::point(middle)) else { return false };
    sure(at_middle + second * (phases - Interval::point(middle)))
}

/// U′ and U″ over these phases; `None` where the valley is not known to be.
fn slopes<const N: usize>(field: &Field<N>, phases: Interval) -> Option<[Interval; 2]> {
    let origin = field.valley(phases.middle())?.point;
    let weights = Weights::new(field, phases);
    let parts: Vec<Part> =
        field.components().iter().map(|one| Part::new(one, &origin, phases)).collect();
    // Σ w′ = Σ w″ = 0: only how parts differ from one of them counts. It is the heaviest one.
    let heaviest = weights.value.iter().enumerate().max_by(|a, b| a.1.high.total_cmp(&b.1.high))?.0;
    let base = &parts[heaviest];
    let sum = |weights: &[Interval], of: &dyn Fn(&Part) -> Interval| -> Interval {
        weights.iter().zip(&parts).map(|(weight, part)| *weight * of(part)).sum()
    };
    let Weights { value, first, second } = &weights;
    let matrix = |weights: &[Interval], less: &Matrix| -> Matrix {
        matrix::<N>(|i, j| sum(weights, &|p| p.h[i][j] - less[i][j]))
    };
    let two = Interval::point(2.0);
    let a1 = sum(first, &|p| p.a[0] - base.a[0]) + sum(value, &|p| p.a[1]);
    let a2 = sum(second, &|p| p.a[0] - base.a[0])
        + two * sum(first, &|p| p.a[1] - base.a[1])
        + sum(value, &|p| p.a[2]);
    let b = vector::<N>(|i| sum(value, &|p| p.b[0][i]));
    let b1 =
        vector::<N>(|i| sum(first, &|p| p.b[0][i] - base.b[0][i]) + sum(value, &|p| p.b[1][i]));
    let b2 = vector::<N>(|i| {
        sum(second, &|p| p.b[0][i] - base.b[0][i]) + two * sum(first, &|p| p.b[1][i] - base.b[1][i])
    });
    let (h1, h2) = (matrix(first, &base.h), matrix(second, &base.h));
    let solver = Solver::new::<N>(&matrix(value, &[NOWHERE; MOST]))?;
    let valley = solver.solve(&b).map(|r| -r);
    let curved = times(&h1, &valley);
    let rate_of: Vector = core::array::from_fn(|i| b1[i] + curved[i]);
    let rate = solver.solve(&rate_of).map(|r| -r);
    let half = Interval::point(0.5);
    Some([
        a1 + dot(&b1, &valley) + half * dot(&valley, &curved),
        a2 + dot(&b2, &valley) + half * dot(&valley, &times(&h2, &valley)) + dot(&rate_of, &rate),
    ])
}

/// A vector of the coordinates beside the phase, and zeros.
fn vector<const N: usize>(of: impl Fn(usize) -> Interval) -> Vector {
    core::array::from_fn(|i| if i + 1 < N { of(i) } else { Interval::ZERO })
}

/// A matrix of them, and zeros.
fn matrix<const N: usize>(of: impl Fn(usize, usize) -> Interval) -> Matrix {
    core::array::from_fn(|i| if i + 1 < N { vector::<N>(|j| of(i, j)) } else { NOWHERE })
}

fn dot(a: &Vector, b: &Vector) -> Interval {
    a.iter().zip(b).map(|(a, b)| *a * *b).sum()
}

fn times(matrix: &Matrix, vector: &Vector) -> Vector {
    matrix.map(|row| dot(&row, vector))
}

/// A component's potential as a polynomial of r and the phase: a + bᵀr + ½ rᵀh r.
struct Part {
    /// a, a′, a″.
    a: [Interval; 3],
    /// b, b′.
    b: [Vector; 2],
    h: Matrix,
}

impl Part {
    fn new<const N: usize>(
        component: &Component<N>,
        origin: &SVector<f64, N>,
        phases: Interval,
    ) -> Self {
        let last = N - 1;
        let Component { mean, potential, gradient, hessian, .. } = component;
        let along = phases - Interval::point(mean[last]);
        let offset = vector::<N>(|i| Interval::point(origin[i]) - Interval::point(mean[i]));
        let own = vector::<N>(|i| Interval::point(gradient[i]));
        let mixed = vector::<N>(|i| Interval::point(hessian[(i, last)]));
        let h = matrix::<N>(|i, j| Interval::point(hessian[(i, j)]));
        let curved = times(&h, &offset);
        let half = Interval::point(0.5);
        let constant =
            Interval::point(*potential) + dot(&own, &offset) + half * dot(&curved, &offset);
        let linear = Interval::point(gradient[last]) + dot(&mixed, &offset);
        let second = Interval::point(hessian[(last, last)]);
        Self {
            a: [
                constant + linear * along + half * second * along.square(),
                linear + second * along,
                second,
            ],
            b: [core::array::from_fn(|i| own[i] + curved[i] + mixed[i] * along), mixed],
            h,
        }
    }
}

/// The weights w_k, w_k′ and w_k″ over an interval of phases.
///
/// With the mean of the phases s̄ = Σ w_k s_k, which rises,
///
/// ```text
/// w_k′ = w_k (s_k − s̄)/σ²       w_k″ = w_k ((s_k − s̄)² − Σ w_j (s_j − s̄)²)/σ⁴
/// ```
///
/// so that w_k rises as long as s̄ < s_k, and falls afterwards.
struct Weights {
    value: Vec<Interval>,
    first: Vec<Interval>,
    second: Vec<Interval>,
}

impl Weights {
    fn new<const N: usize>(field: &Field<N>, phases: Interval) -> Self {
        let centres: Vec<Interval> =
            field.components().iter().map(|one| Interval::point(one.mean[N - 1])).collect();
        let inverse = Interval::point(field.phase_width()).square().reciprocal();
        let (at_low, mean_low) = at(&centres, inverse, phases.low);
        let (at_high, mean_high) = at(&centres, inverse, phases.high);
        let mean = mean_low.hull(mean_high);
        let width = phases - Interval::point(phases.low);
        let rises = width * (mean - Interval::point(mean.low)) * inverse;
        let growth = rises.exp().high;
        let value: Vec<Interval> = at_low
            .iter()
            .zip(&at_high)
            .zip(&centres)
            .map(|((low, high), centre)| {
                let both = low.hull(*high);
                let turns = centre.low > mean.low && centre.high < mean.high;
                let high = if turns { (both.high * growth).next_up().min(1.0) } else { both.high };
                Interval { low: both.low, high }
            })
            .collect();
        let away: Vec<Interval> = centres.iter().map(|centre| *centre - mean).collect();
        let spread: Interval = value.iter().zip(&away).map(|(w, a)| *w * a.square()).sum();
        let first = value.iter().zip(&away).map(|(w, a)| *w * *a * inverse).collect();
        let curved = |(w, a): (&Interval, &Interval)| *w * (a.square() - spread) * inverse.square();
        let second = value.iter().zip(&away).map(curved).collect();
        Self { value, first, second }
    }
}

/// The weights at one phase, and s̄.
fn at(centres: &[Interval], inverse: Interval, phase: f64) -> (Vec<Interval>, Interval) {
    let exponents: Vec<Interval> = centres
        .iter()
        .map(|centre| (Interval::point(phase) - *centre).square() * inverse * -0.5)
        .collect();
    let most = exponents.iter().fold(f64::NEG_INFINITY, |most, e| most.max(e.high));
    let powers: Vec<Interval> =
        exponents.iter().map(|e| (*e - Interval::point(most)).exp()).collect();
    let inverse_sum = powers.iter().copied().sum::<Interval>().reciprocal();
    let weights: Vec<Interval> = powers.iter().map(|power| *power * inverse_sum).collect();
    let mean = weights.iter().zip(centres).map(|(w, centre)| *w * *centre).sum();
    (weights, mean)
}

/// Solves H x = b for all matrices of an interval: with R ≈ H⁻¹ of the middle, E = I − R H and ε = ‖E‖∞ < 1,
/// |x − R b|∞ ≤ ε/(1 − ε) |R b|∞.
struct Solver {
    inverse: Matrix,
    /// ε/(1 − ε), no less.
    away: f64,
}

impl Solver {
    fn new<const N: usize>(h: &Matrix) -> Option<Self> {
        let n = N - 1;
        let middle = SMatrix::<f64, MOST, MOST>::from_fn(|i, j| match (i < n, j < n) {
            (true, true) => h[i][j].middle(),
            _ => f64::from(u8::from(i == j)),
        });
        let inverse = middle.try_inverse()?;
        let inverse: Matrix =
            core::array::from_fn(|i| core::array::from_fn(|j| Interval::point(inverse[(i, j)])));
        let row = |i: usize| -> f64 {
            let entry = |j: usize| {
                let product: Interval = (0..n).map(|k| inverse[i][k] * h[k][j]).sum();
                Interval::point(f64::from(u8::from(i == j))) - product
            };
            (0..n).map(|j| entry(j).magnitude()).fold(0.0, |sum, term| (sum + term).next_up())
        };
        let most = (0..n).map(row).fold(0.0, f64::max);
        if most.is_nan() || most >= 0.5 {
            return None;
        }
        let ratio =
            Interval::point(most) * (Interval::point(1.0) - Interval::point(most)).reciprocal();
        Some(Self { inverse, away: ratio.high })
    }

    fn solve(&self, b: &Vector) -> Vector {
        let near = times(&self.inverse, b);
        let most = near.iter().fold(0.0, |most: f64, entry| most.max(entry.magnitude()));
        let away = (most * self.away).next_up();
        near.map(|entry| entry + Interval::between(-away, away))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skill_model::valley::tests::straight;
    use nalgebra::{Matrix4, Vector4};
    use proptest::prelude::*;

    /// The heap's tail does not reach the goal.
    const HEAP_AT: f64 = 0.2;

    #[test]
    fn a_valley_that_falls_is_proved_and_one_that_rises_is_not() {
        assert!(prove(&straight(1.0, HEAP_AT, 0.0)).is_ok_and(|intervals| intervals > 2));
        let [low, high] = prove(&straight(1.0, HEAP_AT, 1.0)).unwrap_err();
        assert!(low > -0.25 && high < 0.2, "{low} {high}");
        let mut flat = straight(1.0, HEAP_AT, 0.0).components().to_vec();
        flat.iter_mut().for_each(|c| c.hessian[(1, 1)] = -1.0);
        assert!(prove(&Field::new(&flat, 0.12, 8.0).unwrap()).is_err());
    }

    /// Between what is proved and what is given up, there is hardly a heap that makes a difference.
    #[test]
    fn it_is_given_up_only_where_the_valley_hardly_falls() {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            *(if prove(&straight(1.0, HEAP_AT, middle)).is_ok() { &mut low } else { &mut high }) =
                middle;
        }
        let most = |heap: f64| {
            let slope =
                |i: i32| straight(1.0, HEAP_AT, heap).valley(f64::from(i) / 1e5).unwrap().slope;
            (-25_000..98_000).map(slope).fold(f64::NEG_INFINITY, f64::max)
        };
        assert!(low > 0.01 && most(low) < 0.0, "{low}: {}", most(low));
        assert!(most(high + 1e-4) > 0.0, "{high}: {}", most(high + 1e-4));
    }

    proptest! {
        /// U′ and U″ of an interval hold those at its phases, by the field's own evaluation.
        #[test]
        fn slopes_hold_what_the_field_says(
            entries in prop::collection::vec(-1.0..1.0f64, 60),
            at in 0.0..0.9f64,
            width in 0.0..0.1f64,
        ) {
            let mut next = entries.iter().copied().cycle();
            let mut number = || next.next().unwrap();
            let components: Vec<Component<4>> = (0..4)
                .map(|k| {
                    let root = Matrix4::from_fn(|_, _| number());
                    Component {
                        mean: Vector4::new(number(), number(), number(), f64::from(k) / 3.0),
                        metric: Matrix4::identity(),
                        potential: number(),
                        gradient: Vector4::from_fn(|_, _| number()),
                        hessian: root * root.transpose() + Matrix4::identity(),
                    }
                })
                .collect();
            let field = Field::new(&components, 0.2, 8.0).unwrap();
            let Some([first, second]) = slopes(&field, Interval { low: at, high: at + width }) else {
                return Ok(());
            };
            for i in 0..=10 {
                let phase = at + width * f64::from(i) / 10.0;
                let slope = |phase: f64| field.valley(phase).unwrap().slope;
                prop_assert!(first.low <= slope(phase) + 1e-9 && slope(phase) - 1e-9 <= first.high);
                let change = (slope(phase + 1e-5) - slope(phase - 1e-5)) / 2e-5;
                let room = 1e-4 * (1.0 + change.abs());
                prop_assert!(second.low <= change + room && change - room <= second.high);
            }
        }
    }
}
