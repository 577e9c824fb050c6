//! A barrier on a distance: what keeps clearances, and joints inside their limits.

use glam::DVec3;
use nalgebra::{SMatrix, Vector1, Vector3};
use tprmp_spatial::PointMotion;

use crate::leaves::range::{Report, not_negative, positive};
use crate::natural::Natural;

/// A clearance and how it changes: of a moving ball from an obstacle, or any other that a point keeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// d \[m\].
    pub distance: f64,
    /// ḋ \[m/s\].
    pub rate: f64,
    /// ∂d/∂x; a unit vector where d is a distance.
    pub normal: DVec3,
    /// What d̈ is beside nᵀ times the point's acceleration \[m/s²\].
    pub curvature: f64,
}

impl Clearance {
    /// How fast it closes where it changes at `rate` \[m/s\]: −ḋ/d \[1/s\]. No clearance counts as less than a
    /// millimetre: slowly a body may move where there is none.
    #[must_use]
    pub fn closing_1_s(&self, rate: f64) -> f64 {
        -rate / self.distance.max(1e-3)
    }
}

/// Keeps a distance d, of unit u \[m or rad\], from becoming zero: the clearance of a point from an
/// obstacle, or the distance of a joint from its limit.
///
/// ```text
/// w(d) = m (d₀/d − 1)² for d < d₀, else 0
/// u(ḋ) = ε + (ḋ/v₀)² for ḋ < 0, else ε       G = w u,  M = G + Ξ = w (ε + 2(ḋ/v₀)²)
/// Φ = ½ a w(d)      B = η G      ξ = ½ w′ u ḋ²   [Cheng et al. 2019, eq. 21 and 68]
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct Barrier {
    /// d₀: farther away the leaf is inactive \[u\].
    pub activation_distance: f64,
    /// Distance below which the leaf no longer grows \[u\].
    pub distance_min: f64,
    /// m \[kg, for angles kg m²\].
    pub inertia: f64,
    /// ε: fraction of the inertia that is active at any velocity.
    pub rest_fraction: f64,
    /// v₀: approach speed at which u has risen by one \[u/s\].
    pub approach_speed: f64,
    /// a: strength of the repulsive potential \[u²/s²\].
    pub repulsion: f64,
    /// η \[1/s\].
    pub damping_1_s: f64,
}

/// Keys of a barrier in the order of its fields.
pub type BarrierKeys = [&'static str; 7];

impl Barrier {
    /// Keys of the fields.
    pub const KEYS: BarrierKeys = [
        "activation_distance",
        "distance_min",
        "inertia",
        "rest_fraction",
        "approach_speed",
        "repulsion",
        "damping_1_s",
    ];
    /// Keys of a barrier on a length, which carry their units.
    pub const KEYS_ON_LENGTH: BarrierKeys = [
        "activation_distance_m",
        "clearance_min_m",
        "inertia_kg",
        "rest_fraction",
        "approach_speed_m_s",
        "repulsion_m2_s2",
        "damping_1_s",
    ];

    /// Reports parameters outside their ranges by these keys.
    pub fn check(&self, keys: &BarrierKeys, report: &mut Report<'_>) {
        positive(keys[0], self.activation_distance, report);
        positive(keys[1], self.distance_min, report);
        if self.distance_min >= self.activation_distance {
            report(keys[1], "less than the activation distance beside it", &self.distance_min);
        }
        positive(keys[2], self.inertia, report);
        not_negative(keys[3], self.rest_fraction, report);
        positive(keys[4], self.approach_speed, report);
        not_negative(keys[5], self.repulsion, report);
        not_negative(keys[6], self.damping_1_s, report);
    }

    /// The leaf at `distance` \[u\], changing at `rate` \[u/s\]; `None` out of range.
    #[must_use]
    pub fn evaluate(&self, distance: f64, rate: f64) -> Option<Natural<1>> {
        if distance.is_nan() || distance >= self.activation_distance {
            return None;
        }
        let d = distance.max(self.distance_min);
        let ratio = self.activation_distance / d - 1.0;
        let weight = self.inertia * ratio * ratio;
        let slope = -2.0 * self.inertia * ratio * self.activation_distance / (d * d);
        let approach = rate.min(0.0) / self.approach_speed;
        let gate = self.rest_fraction + approach * approach;
        let metric = weight * (self.rest_fraction + 2.0 * approach * approach);
        let force = -0.5 * self.repulsion * slope
            - self.damping_1_s * weight * gate * rate
            - 0.5 * slope * gate * rate * rate;
        Some(Natural { force: Vector1::new(force), metric: SMatrix::<f64, 1, 1>::new(metric) })
    }

    /// The leaf, inactive from a shorter clearance d₁ on. Its metric is as firm as before near a contact,
    /// w = m d₀² (1/d − 1/d₁)²; its potential is that of a leaf of this range, ½ a m (d₁/d − 1)², which
    /// from a shorter distance pushes back no harder.
    #[must_use]
    pub fn within(&self, distance: f64) -> Self {
        if distance >= self.activation_distance {
            return *self;
        }
        let longer = self.activation_distance / distance;
        Self {
            activation_distance: distance,
            inertia: self.inertia * longer * longer,
            repulsion: self.repulsion / (longer * longer),
            ..*self
        }
    }

    /// V = Φ + ½ G ḋ² at `distance` \[u\], changing at `rate` \[u/s\]  \[J\].
    #[must_use]
    pub fn energy(&self, distance: f64, rate: f64) -> f64 {
        if distance.is_nan() || distance >= self.activation_distance {
            return 0.0;
        }
        let ratio = self.activation_distance / distance.max(self.distance_min) - 1.0;
        let weight = self.inertia * ratio * ratio;
        let approach = rate.min(0.0) / self.approach_speed;
        let gate = self.rest_fraction + approach * approach;
        0.5 * weight * (self.repulsion + gate * rate * rate)
    }

    /// Adds the leaf on the clearance of a point, pulled back to the coordinates of its body.
    pub fn add<const N: usize>(
        &self,
        clearance: &Clearance,
        point: &PointMotion<N>,
        root: &mut Natural<N>,
    ) {
        if let Some(leaf) = self.evaluate(clearance.distance, clearance.rate) {
            let normal = Vector3::from(clearance.normal);
            let drift = normal.dot(&point.drift) + clearance.curvature;
            let row = normal.transpose() * point.jacobian;
            root.add_pullback(&leaf, &row, &Vector1::new(drift));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAF: Barrier = Barrier {
        activation_distance: 0.15,
        distance_min: 0.002,
        inertia: 0.5,
        rest_fraction: 0.1,
        approach_speed: 0.3,
        repulsion: 0.05,
        damping_1_s: 6.0,
    };

    /// V = Φ + ½ G ḋ²; V̇ = −B ḋ² for M d̈ = f.
    #[test]
    fn collision_energy_falls_by_the_damping_alone() {
        let leaf = Barrier { damping_1_s: 0.0, ..LEAF };
        let energy = |d: f64, rate: f64| leaf.energy(d, rate);
        let acceleration = |d: f64, rate: f64| {
            let natural = leaf.evaluate(d, rate).unwrap();
            natural.force[0] / natural.metric[0]
        };
        let (mut d, mut rate, dt) = (0.1, -0.4, 1e-5);
        let start = energy(d, rate);
        for _ in 0..10_000 {
            let a = acceleration(d + 0.5 * dt * rate, rate + 0.5 * dt * acceleration(d, rate));
            d += dt * (rate + 0.5 * dt * a);
            rate += dt * a;
            assert!(d > 0.0);
            if d > 0.13 {
                break;
            }
            assert!((energy(d, rate) - start).abs() < 1e-4 * start, "{}", energy(d, rate) / start);
        }
        let free = leaf.evaluate(0.1, -0.4).unwrap().force[0];
        let damped = LEAF.evaluate(0.1, -0.4).unwrap().force[0];
        assert!(damped > free, "damping opposes the approach");
    }

    #[test]
    fn a_shorter_range_is_as_firm_near_a_contact() {
        assert_eq!(LEAF.within(1.0), LEAF);
        let short = LEAF.within(0.2 * LEAF.activation_distance);
        assert!(short.evaluate(short.activation_distance, -0.1).is_none());
        let metric = |leaf: &Barrier, d: f64| leaf.evaluate(d, -0.1).unwrap().metric[0];
        let near = 1e-3 * LEAF.activation_distance;
        let [short, long] =
            [&short, &LEAF].map(|leaf| metric(&Barrier { distance_min: near, ..*leaf }, near));
        assert!(short < long && short > 0.98 * long, "{short} {long}");
    }

    #[test]
    fn collision_is_inactive_out_of_range_and_finite_in_contact() {
        assert!(LEAF.evaluate(0.15, -1.0).is_none());
        assert!(LEAF.evaluate(f64::NAN, -1.0).is_none());
        for distance in [0.0, -0.05] {
            let natural = LEAF.evaluate(distance, 0.0).unwrap();
            assert!(natural.force[0] > 0.0 && natural.force[0].is_finite());
        }
    }
}
