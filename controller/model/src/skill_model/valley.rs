//! Looks along the valley of a field for places at which it does not fall towards the goal.
//!
//! For each phase the potential is a quadratic with one lowest point. A place of rest is such a point,
//! and one at which the potential of the valley is level: so the goal is the only one where the valley
//! falls towards it everywhere else.

use nalgebra::SVector;
use tprmp_rmpflow::policy::PHASE_RANGE;
use tprmp_rmpflow::policy::canonical::field::Field;

/// Phases at which the valley is looked at: with the most components that a field holds, a dozen where
/// one of them passes into the next.
pub const PHASES: u32 = 2001;
/// Nearer to the goal than this fraction of the phase its Hessian speaks: there the fall is too small to
/// be told from rounding.
const GOAL_FRACTION: f64 = 0.02;
/// Faults nearer to each other than this fraction of the phase are one: less than a component's width.
const SAME: f64 = 0.02;

/// The least fall of the potential along the valley towards the goal, by the phase \[J\], outside of the
/// goal's surroundings, and the points at which it does not fall, one in each stretch of them.
///
/// `phase_length` is the last coordinate of the goal: what the phase one stands for. Where there is no
/// valley the fall is minus infinity.
#[must_use]
pub fn descent<const N: usize>(field: &Field<N>, phase_length: f64) -> (f64, Vec<SVector<f64, N>>) {
    let [low, high] = PHASE_RANGE;
    let fractions = (0..PHASES).map(|i| low + (high - low) * f64::from(i) / f64::from(PHASES - 1));
    let fractions = fractions.filter(|fraction| (fraction - 1.0).abs() >= GOAL_FRACTION);
    falls(
        field,
        phase_length,
        fractions,
        |fraction, slope| if fraction < 1.0 { -slope } else { slope },
    )
}

/// The least fall of the potential along the valley of a skill that goes round, by a round \[J\], and the points at
/// which it does not fall, one in each stretch of them.
///
/// `phase_length` is the length of a round in the last coordinate. Where there is no valley the fall is minus
/// infinity.
#[must_use]
pub fn round_descent<const N: usize>(
    field: &Field<N>,
    phase_length: f64,
) -> (f64, Vec<SVector<f64, N>>) {
    let fractions = (0..PHASES).map(|i| f64::from(i) / f64::from(PHASES - 1));
    falls(field, phase_length, fractions, |_, slope| -slope)
}

/// The least fall at these fractions of the phase, and the points without one, one in each stretch of them.
///
/// * `fall`  by the last coordinate, of a fraction and U′ there
fn falls<const N: usize>(
    field: &Field<N>,
    phase_length: f64,
    fractions: impl Iterator<Item = f64>,
    fall: impl Fn(f64, f64) -> f64,
) -> (f64, Vec<SVector<f64, N>>) {
    let mut least = f64::INFINITY;
    let mut faults: Vec<SVector<f64, N>> = Vec::new();
    for fraction in fractions {
        let Some(valley) = field.valley(fraction * phase_length) else {
            return (f64::NEG_INFINITY, faults);
        };
        let fall = fall(fraction, valley.slope) * phase_length;
        least = least.min(fall);
        let far = |fault: &SVector<f64, N>| {
            (fault[N - 1] - valley.point[N - 1]).abs() > SAME * phase_length
        };
        if fall.is_nan() || fall <= 0.0 && faults.iter().all(far) {
            faults.push(valley.point);
        }
    }
    (least, faults)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use tprmp_rmpflow::policy::canonical::field::Component;

    /// A straight valley that falls by 0.5 (g − s) to its goal at s = g, but for a heap on its path.
    pub(crate) fn straight(goal: f64, heap_at: f64, heap: f64) -> Field<3> {
        let component = |i: i32| {
            let s = goal * f64::from(i) / 5.0;
            let heap = if (s - heap_at).abs() < 1e-9 { heap } else { 0.0 };
            Component {
                mean: Vector3::new(s, 0.0, s),
                metric: Matrix3::identity(),
                potential: 0.25 * (s - goal).powi(2) + heap,
                gradient: Vector3::new(0.0, 0.0, 0.5 * (s - goal)),
                hessian: Matrix3::new(2.0, 0.0, -2.0, 0.0, 2.0, 0.0, -2.0, 0.0, 2.5),
            }
        };
        let components = [0, 1, 2, 3, 4, 5].map(component);
        Field::new(&components, 0.12 * goal, 8.0).unwrap()
    }

    fn valley(heap: f64) -> Field<3> {
        straight(2.0, 1.2, heap)
    }

    #[test]
    fn a_valley_that_rises_is_found_and_one_that_falls_is_none() {
        let (least, faults) = descent(&valley(0.0), 2.0);
        assert!(least > 0.0 && faults.is_empty(), "{least} {faults:?}");
        let (least, faults) = descent(&valley(2.5), 2.0);
        assert!(least < 0.0 && !faults.is_empty());
        assert!(faults.iter().any(|z| (0.4..1.3).contains(&z[2])), "{faults:?}");
        let mut flat = valley(0.0).components().to_vec();
        flat.iter_mut().for_each(|c| c.hessian[(1, 1)] = -1.0);
        let none = Field::new(&flat, 0.24, 8.0).unwrap();
        assert_eq!(descent(&none, 2.0).0, f64::NEG_INFINITY);
    }
}
