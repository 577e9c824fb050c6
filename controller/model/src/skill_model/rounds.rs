//! The copies of a periodic skill's components in the rounds before and after.

/// Copies farther from a phase than its nearest one by so many widths have no weight: √90, as the exponent at
/// which the field leaves components out says, rounded up.
const REACH: f64 = 9.5;

/// A copy of a component: which one, and in which round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RoundCopy {
    /// From 0.
    pub component: usize,
    /// 0 for the round that the phases 0 to 1 are.
    pub round: i32,
}

/// The copies that have a weight at any phase of a round, in order of their phases; none where the numbers are
/// not finite, or a width not above zero.
///
/// * `phases`  of the components, rising, as fractions of a round
/// * `phase_width`  σ, as a fraction of a round
#[must_use]
pub fn copies(phases: &[f64], phase_width: f64) -> Vec<RoundCopy> {
    let after = phases.iter().skip(1).copied().chain(phases.first().map(|first| first + 1.0));
    let gap = phases.iter().zip(after).map(|(a, b)| b - a).fold(0.0, f64::max);
    let reach = REACH * phase_width + 0.5 * gap;
    // With a wider reach there are more copies than a field holds.
    if !(reach.is_finite() && phase_width > 0.0 && reach < 64.0) {
        return Vec::new();
    }
    let rounds = reach.ceil() as i32;
    let mut copies = Vec::new();
    for round in -rounds..=rounds {
        for (component, phase) in phases.iter().enumerate() {
            let place = phase + f64::from(round);
            if (-reach..=1.0 + reach).contains(&place) {
                copies.push(RoundCopy { component, round });
            }
        }
    }
    copies
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use tprmp_rmpflow::policy::canonical::field::{Component, Field};
    use tprmp_rmpflow::policy::canonical::rounds::in_round;

    /// A circle that falls by 3 a round, uneven.
    fn round(count: usize, phase_width: f64) -> Field<3> {
        let phases: Vec<f64> = (0..count).map(|k| (k as f64 + 0.5) / count as f64).collect();
        let one = |k: usize| {
            let angle = std::f64::consts::TAU * phases[k];
            Component {
                mean: Vector3::new(angle.cos(), angle.sin(), phases[k]),
                metric: Matrix3::from_diagonal(&Vector3::new(1.0 + 0.3 * angle.sin(), 1.2, 0.5)),
                potential: -3.0 * phases[k] + 0.2 * angle.cos(),
                gradient: Vector3::new(0.3 * angle.sin(), 0.1, -3.0),
                hessian: Matrix3::new(20.0, 1.0, 2.0, 1.0, 15.0, -1.0, 2.0, -1.0, 4.0),
            }
        };
        let all = copies(&phases, phase_width);
        let components: Vec<_> =
            all.iter().map(|copy| in_round(&one(copy.component), copy.round, 1.0, 3.0)).collect();
        Field::new(&components, phase_width, 8.0).unwrap()
    }

    #[test]
    fn a_round_later_everything_is_the_same_but_the_potential() {
        for (count, width) in [(12, 0.05), (8, 0.09), (3, 0.2)] {
            let field = round(count, width);
            let velocity = Vector3::new(0.4, -0.3, 0.8);
            let [mut most, mut fall] = [0.0_f64; 2];
            for i in 0..200 {
                // From just before the end of a round, and on into the next one's beginning.
                let s = 1e-3 * f64::from(i - 100) * width;
                let here = Vector3::new(0.7, 0.4, s);
                let later = here + Vector3::z();
                let [a, b] = [here, later].map(|z| field.evaluate(&z, &velocity));
                most = most.max((a.force(&velocity) - b.force(&velocity)).norm());
                most = most.max((a.metric - b.metric).norm());
                fall = fall.max((a.potential - b.potential - 3.0).abs());
            }
            assert!(most < 1e-9 && fall < 1e-9, "{count}: {most:e} {fall:e}");
        }
    }

    #[test]
    fn numbers_that_make_no_copies_give_none() {
        assert!(copies(&[0.1, 0.5], f64::NAN).is_empty());
        assert!(copies(&[0.1, 0.5], 1e6).is_empty());
        assert!(copies(&[0.1, 0.5], 0.0).is_empty());
        assert!(copies(&[], 0.1).is_empty());
    }
}
