//! The geometry of orientations: logarithm, Jacobians and a chart.
//!
//! Tangent vectors at an orientation q̄ are rotation vectors in body axes: q = q̄ exp(v), with v the
//! full angle about its axis \[rad\]. The exponential is [`DQuat::from_scaled_axis`], its inverse
//! [`rotation_vector`]; q and −q are the same orientation everywhere.
//!
//! ```text
//! exp(r + dr) = exp(J_l(r) dr) exp(r) = exp(r) exp(J_r(r) dr)        J_r(r) = J_l(r)ᵀ = J_l(−r)
//! ```

use glam::{DMat3, DQuat, DVec3};

use crate::jet::Quat;

/// log q: the rotation vector of the smaller of both angles, |r| ≤ π \[rad\].
#[must_use]
#[inline]
pub fn rotation_vector(q: DQuat) -> DVec3 {
    DVec3::from_array(Quat::<f64>::constant(q).log().0)
}

/// J_r(r), the right Jacobian of SO(3): ω = J_r(r) ṙ in body axes for q = exp(r).
#[must_use]
#[inline]
pub fn right_jacobian(r: DVec3) -> DMat3 {
    let squared = r.length_squared();
    // (1 − cos θ)/θ² and (θ − sin θ)/θ³.
    let (first, second) = if squared < 1e-3 {
        (
            0.5 - squared / 24.0 + squared * squared / 720.0,
            1.0 / 6.0 - squared / 120.0 + squared * squared / 5040.0,
        )
    } else {
        let angle = squared.sqrt();
        let half_sine = (0.5 * angle).sin();
        (2.0 * half_sine * half_sine / squared, (angle - angle.sin()) / (squared * angle))
    };
    let cross = skew(r);
    DMat3::IDENTITY - cross * first + cross * cross * second
}

/// J_l⁻¹(r), the inverse left Jacobian of SO(3): ṙ = J_l⁻¹(r) ω for q = exp(r); |r| < 2π.
#[must_use]
#[inline]
pub fn inverse_left_jacobian(r: DVec3) -> DMat3 {
    let squared = r.length_squared();
    let factor = if squared < 1e-4 {
        1.0 / 12.0 + squared / 720.0
    } else {
        let angle = squared.sqrt();
        let half = 0.5 * angle;
        (1.0 - half / half.tan()) / squared
    };
    let cross = skew(r);
    DMat3::IDENTITY - cross * 0.5 + cross * cross * factor
}

/// \[r\]ₓ, so that \[r\]ₓ v = r × v.
#[inline]
fn skew(r: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, r.z, -r.y),
        DVec3::new(-r.z, 0.0, r.x),
        DVec3::new(r.y, -r.x, 0.0),
    )
}

/// An orientation in the chart q = q_g exp(r) of a goal at rest.
#[derive(Debug, Clone, Copy)]
pub struct Chart {
    /// r \[rad\].
    pub rotation: DVec3,
    /// ṙ \[rad/s\].
    pub velocity: DVec3,
    /// ∂r/∂(angular displacement): ṙ = J ω.
    pub jacobian: DMat3,
    /// The angular acceleration for r̈ = 0 \[rad/s²\]: r̈ = J (ω̇ − b).
    pub bias: DVec3,
}

/// b, c and the derivatives of a and b by s = θ² of [`orientation_chart`].
struct ChartCoefficients {
    b: f64,
    c: f64,
    a_slope: f64,
    b_slope: f64,
}

/// * `relative`  exp(r), its scalar part not negative; `squared`  |r|²
#[inline]
fn chart_coefficients(relative: DQuat, squared: f64) -> ChartCoefficients {
    if squared < 0.05 {
        // Power series: what is left out is below 1e-16.
        let s = squared;
        let series = |[c0, c1, c2, c3, c4, c5]: [f64; 6]| {
            c0 - s * (c1 - s * (c2 - s * (c3 - s * (c4 - s * c5))))
        };
        ChartCoefficients {
            b: series(
                [6.0, 120.0, 5040.0, 362_880.0, 39_916_800.0, 6_227_020_800.0].map(f64::recip),
            ),
            c: 1.0 / 12.0
                + s * (1.0 / 720.0
                    + s * (1.0 / 30_240.0
                        + s * (1.0 / 1_209_600.0
                            + s * (1.0 / 47_900_160.0 + s * (691.0 / 1_307_674_368_000.0))))),
            a_slope: -series([
                1.0 / 24.0,
                2.0 / 720.0,
                3.0 / 40_320.0,
                4.0 / 3_628_800.0,
                5.0 / 479_001_600.0,
                6.0 / 87_178_291_200.0,
            ]),
            b_slope: -series([
                1.0 / 120.0,
                2.0 / 5040.0,
                3.0 / 362_880.0,
                4.0 / 39_916_800.0,
                5.0 / 6_227_020_800.0,
                6.0 / 1_307_674_368_000.0,
            ]),
        }
    } else {
        // cos ½θ and sin(½θ)/θ.
        let cosine = relative.w;
        let half_sine_fraction = relative.xyz().length() / squared.sqrt();
        let sine_fraction = 2.0 * cosine * half_sine_fraction;
        let inverse = 1.0 / squared;
        let a = 2.0 * half_sine_fraction * half_sine_fraction;
        let b = (1.0 - sine_fraction) * inverse;
        ChartCoefficients {
            b,
            c: (1.0 - 0.5 * cosine / half_sine_fraction) * inverse,
            a_slope: (0.5 * sine_fraction - a) * inverse,
            b_slope: (0.5 * a - 1.5 * b) * inverse,
        }
    }
}

/// Charts an orientation that rotates with `angular` \[rad/s\] by the rotation vector from the
/// goal, |r| < π.
///
/// ```text
/// J_l  = I + a \[r\]ₓ + b \[r\]ₓ²          a = (1 − cos θ)/θ²     b = (θ − sin θ)/θ³
/// J_l⁻¹ = I − ½ \[r\]ₓ + c \[r\]ₓ²         c = (1 − ½ θ cot ½θ)/θ²
/// ```
///
/// and the bias is J̇_l ṙ; derivatives of a and b are those by s = θ².
#[must_use]
#[inline]
pub fn orientation_chart(goal: DQuat, orientation: DQuat, angular: DVec3) -> Chart {
    let relative = goal.conjugate() * orientation;
    let relative = if relative.w < 0.0 { -relative } else { relative };
    let rotation = rotation_vector(relative);
    let squared = rotation.length_squared();
    let ChartCoefficients { b, c, a_slope, b_slope } = chart_coefficients(relative, squared);
    let cross = skew(rotation);
    let inverse = DMat3::IDENTITY - cross * 0.5 + cross * cross * c;
    let to_world = DMat3::from_quat(goal);
    let jacobian = inverse * to_world.transpose();
    let velocity = jacobian * angular;
    let sideways = rotation.cross(velocity);
    let growth = 2.0 * rotation.dot(velocity);
    let acceleration = sideways * (a_slope * growth)
        + rotation.cross(sideways) * (b_slope * growth)
        + velocity.cross(sideways) * b;
    Chart { rotation, velocity, jacobian, bias: to_world * acceleration }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jet::{Jet, Vec3};
    use proptest::prelude::*;

    fn vector(length_max: f64) -> impl Strategy<Value = DVec3> {
        let component = -1.0..1.0;
        (component.clone(), component.clone(), component, 0.0..length_max)
            .prop_filter_map("a direction", |(x, y, z, length)| {
                Some(DVec3::new(x, y, z).try_normalize()? * length)
            })
    }

    fn dot(a: DQuat, b: DQuat) -> f64 {
        a.dot(b)
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn exponential_and_logarithm_undo_one_another(v in vector(std::f64::consts::PI - 1e-6)) {
            let q = DQuat::from_scaled_axis(v);
            prop_assert!((rotation_vector(q) - v).length() < 1e-9);
            prop_assert!((rotation_vector(-q) - v).length() < 1e-9);
            let back = DQuat::from_scaled_axis(rotation_vector(-q));
            prop_assert!((dot(back, q).abs() - 1.0).abs() < 1e-14);
        }

        #[test]
        fn right_jacobian_is_the_derivative_of_the_exponential(
            r in vector(3.1), v in vector(1.0),
        ) {
            let h = 1e-5;
            let at = |s: f64| DQuat::from_scaled_axis(r + v * s);
            let expected = rotation_vector(at(-h).conjugate() * at(h)) / (2.0 * h);
            prop_assert!((right_jacobian(r) * v - expected).length() < 1e-9);
            let back = inverse_left_jacobian(-r) * (right_jacobian(r) * v);
            prop_assert!((back - v).length() < 1e-12);
        }
    }

    /// The chart along a rotation vector that moves steadily, by second-order jets.
    #[test]
    fn a_chart_agrees_with_its_jets() {
        let goal = DQuat::from_scaled_axis(DVec3::new(0.4, -0.7, 1.1));
        let axis = DVec3::new(0.6, 0.48, -0.64);
        let angular = DVec3::new(0.9, -0.3, 0.5);
        let limit = 0.05_f64.sqrt();
        for angle in [0.0, 1e-12, 1e-6, 1e-3, 0.1, limit - 1e-9, limit + 1e-9, 0.3, 1.0, 2.5, 3.1] {
            for sign in [1.0, -1.0] {
                let orientation = goal * DQuat::from_scaled_axis(axis * angle) * sign;
                let chart = orientation_chart(goal, orientation, angular);
                assert!((chart.rotation - axis * angle).length() < 1e-13);
                let path = Quat::exp(Vec3::moving(chart.rotation, chart.velocity, DVec3::ZERO));
                let (rate, bias) = Quat::<Jet>::constant(goal).times(path).angular_motion();
                assert!((rate - angular).length() < 1e-11, "{angle}");
                assert!((chart.bias - bias).length() < 1e-11, "{angle}");
                assert!((chart.jacobian * angular - chart.velocity).length() < 1e-15);
                let expected = inverse_left_jacobian(chart.rotation);
                let expected = expected * DMat3::from_quat(goal.conjugate());
                assert!(chart.jacobian.abs_diff_eq(expected, 1e-11), "{angle}");
            }
        }
    }

    #[test]
    fn right_jacobian_is_smooth_where_its_series_begins() {
        let along = |length: f64| right_jacobian(DVec3::new(0.6, 0.0, -0.8) * length);
        let limit = 1e-3_f64.sqrt();
        let (below, above) = (along(limit * (1.0 - 1e-9)), along(limit * (1.0 + 1e-9)));
        assert!((below - above).abs_diff_eq(DMat3::ZERO, 1e-10));
    }
}
