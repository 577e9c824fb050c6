//! Adaptation of the path to its goal: what demonstrations show beyond the transforms of the frames.
//!
//! Frames transport the space rigidly at each phase (see [`crate::policy::canonical::frame_map`]). How a
//! path changes with its goal is more than that: a longer one swings out wider, or rises before it goes
//! across. From several demonstrations it is learned, as a linear regression on the *shift* of the goal
//! frame against the start frame,
//!
//! ```text
//! y = y° − E(s) u          E(s) = Σ_j b_j(s) E_j          j = 1 … 9
//! u = (u_p, u_r)           u_i = v_i/(1 + (|v_i|/ρ)⁸)^⅛,  v_i = δ_i/ℓ_i,  ρ = 5/4
//! ```
//!
//! with y° the coordinates for the frames alone, b_j cubic B-splines over the phase that vanish at 0 and 1
//! with their first two derivatives, δ_p and δ_r translation and rotation of the goal against the start, 0
//! in canonical coordinates, and ℓ_i the largest that was demonstrated. So start and goal stay where the
//! frames put them, and the path is deformed by a quarter more than was demonstrated at most, wherever the
//! goal is: beyond that it is transported rigidly.
//!
//! For a given phase it is a shift of y that does not depend on the place: nothing folds.

use glam::DVec3;

use tprmp_spatial::jet::{Real, Vec3};

/// Number of B-splines over the phase.
pub const SPLINES: usize = 9;
/// Coordinates of y and of u: three of position, three of rotation.
pub const COORDINATES: usize = 6;

/// Distance of their knots.
const KNOTS: f64 = 1.0 / (SPLINES + 3) as f64;
/// ρ, the largest |u|; up to |v| = 1 u is linear up to two hundredths.
const REACH: f64 = 1.25;

/// E_j: row by row, position before rotation, \[m or rad per unit of u\].
pub type Coefficients = [[f64; COORDINATES]; COORDINATES];

/// How the path of a skill adapts to the shift of its goal. Immutable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptation {
    /// ℓ_p \[m\] and ℓ_r \[rad\]; 0 where no shift was demonstrated: there it has no effect.
    pub reach: [f64; 2],
    /// E_j.
    pub coefficients: [Coefficients; SPLINES],
}

/// The B-splines that do not vanish at a phase: the index of the first one, which may be negative, and
/// the values with two derivatives of it and the next three. Those whose index is not in
/// 0 .. [`SPLINES`] do not exist.
#[must_use]
pub fn splines(phase: f64) -> (i32, [[f64; 3]; 4]) {
    let place = phase / KNOTS;
    if !(0.0..(SPLINES + 3) as f64).contains(&place) {
        return (0, [[0.0; 3]; 4]);
    }
    let (t, r) = (place.fract(), 1.0 - place.fract());
    let derived = |b: [f64; 3]| [b[0] / 6.0, b[1] / (2.0 * KNOTS), b[2] / (KNOTS * KNOTS)];
    let values = [
        [r * r * r, -r * r, r],
        [3.0 * t * t * t - 6.0 * t * t + 4.0, 3.0 * t * t - 4.0 * t, 3.0 * t - 2.0],
        [3.0 * r * r * r - 6.0 * r * r + 4.0, 4.0 * r - 3.0 * r * r, 3.0 * r - 2.0],
        [t * t * t, t * t, t],
    ];
    (place as i32 - 3, values.map(derived))
}

impl Adaptation {
    /// u of a shift of the goal.
    ///
    /// * `shift`  δ_p \[m\] and δ_r \[rad\]
    #[must_use]
    pub fn bounded<S: Real>(reach: [f64; 2], shift: [Vec3<S>; 2]) -> [Vec3<S>; 2] {
        [0, 1].map(|i| {
            if reach[i] <= 0.0 {
                return Vec3::constant(DVec3::ZERO);
            }
            let v = shift[i].times(S::constant(1.0 / reach[i]));
            let squared = v.dot(v);
            // h = w^(−⅛) as a function of q = |v|², w = 1 + (q/ρ²)⁴.
            let (q, scale) = (squared.value(), 1.0 / (REACH * REACH));
            let fraction = q * scale;
            let (cubed, inside) = (fraction.powi(3), 1.0 / (1.0 + fraction.powi(4)));
            let h = inside.sqrt().sqrt().sqrt();
            let first = -0.5 * scale * cubed * h * inside;
            let second = -0.5
                * scale
                * scale
                * fraction
                * fraction
                * h
                * inside
                * (3.0 - 4.5 * cubed * fraction * inside);
            v.times(squared.chain([h, first, second]))
        })
    }

    /// Three rows of E(s) u, of position (`first` = 0) or rotation (3), at a moving phase; and of E′ u.
    #[inline]
    pub(crate) fn shift<S: Real>(
        &self,
        first: usize,
        u: &[Vec3<S>; 2],
        phase: S,
    ) -> (Vec3<S>, DVec3) {
        let (low, weights) = splines(phase.value());
        let mut rows = [[[0.0; 3]; COORDINATES]; 3];
        for (j, weight) in (low..).zip(weights) {
            let Some(matrix) = usize::try_from(j).ok().and_then(|j| self.coefficients.get(j))
            else {
                continue;
            };
            for (row, of) in rows.iter_mut().zip(&matrix[first..first + 3]) {
                for (entry, e) in row.iter_mut().zip(of) {
                    for (sum, w) in entry.iter_mut().zip(weight) {
                        *sum += e * w;
                    }
                }
            }
        }
        let mut shift = [S::constant(0.0); 3];
        let mut rate = DVec3::ZERO;
        for (i, row) in rows.iter().enumerate() {
            for (entry, u) in row.iter().zip(u.iter().flat_map(|v| v.0)) {
                shift[i] = shift[i] + phase.chain(*entry) * u;
                rate[i] += entry[1] * u.value();
            }
        }
        (Vec3(shift), rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_spatial::jet::Jet;

    #[test]
    fn the_splines_vanish_at_both_ends_and_their_derivatives_are_right() {
        let at = |phase: f64| {
            let (first, values) = splines(phase);
            let mut all = [[0.0; 3]; SPLINES];
            for (j, value) in (first..).zip(values) {
                if let Some(entry) = usize::try_from(j).ok().and_then(|j| all.get_mut(j)) {
                    *entry = value;
                }
            }
            all
        };
        for phase in [-0.3, 0.0, 1.0, 1.2] {
            assert!(at(phase).iter().flatten().all(|x| x.abs() < 1e-12), "{phase}");
        }
        let h = 1e-6;
        for i in 0..97 {
            let phase = 0.0105 * f64::from(i);
            let (before, now, after) = (at(phase - h), at(phase), at(phase + h));
            for j in 0..SPLINES {
                let [_, first, second] = now[j];
                assert!((first - (after[j][0] - before[j][0]) / (2.0 * h)).abs() < 1e-6);
                assert!((second - (after[j][1] - before[j][1]) / (2.0 * h)).abs() < 1e-3);
            }
            // In between they add up to one.
            let sum: f64 = now.iter().map(|value| value[0]).sum();
            assert!(!(0.25..0.75).contains(&phase) || (sum - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_shift_counts_for_a_quarter_more_than_was_demonstrated_at_most() {
        let u = |metres: f64| {
            let shift = [Vec3([metres, 0.0, 0.0]), Vec3([0.0, 1.0, 0.0])];
            Adaptation::bounded([0.2, 0.0], shift)
        };
        assert!((u(1e-4)[0].0[0] - 5e-4).abs() < 1e-9);
        assert!(u(1e9)[0].0[0] <= REACH + 1e-12 && u(1e3)[0].0[0] > 1.249);
        assert!((u(0.2)[0].0[0] - 1.0).abs() < 0.02);
        // No rotation was demonstrated.
        assert_eq!(u(0.1)[1], Vec3([0.0; 3]));
        // Its derivatives in time.
        let at = |t: f64| Vec3([0.3 * t.sin(), 0.2 * t * t, 0.1]);
        let (t, h) = (0.7_f64, 1e-4);
        let moving = Vec3([
            Jet(0.3 * t.sin(), 0.3 * t.cos(), -0.3 * t.sin()),
            Jet(0.2 * t * t, 0.4 * t, 0.4),
            Jet(0.1, 0.0, 0.0),
        ]);
        let zero = Vec3([0.0; 3]);
        let value = |t: f64| Adaptation::bounded([0.2, 0.0], [at(t), zero])[0].value();
        let [u, _] = Adaptation::bounded([0.2, 0.0], [moving, Vec3::constant(DVec3::ZERO)]);
        let (before, now, after) = (value(t - h), value(t), value(t + h));
        assert!((u.first() - (after - before) / (2.0 * h)).length() < 1e-7);
        assert!((u.second() - (after - 2.0 * now + before) / (h * h)).length() < 1e-5);
    }
}
