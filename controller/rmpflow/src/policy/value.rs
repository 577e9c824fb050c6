//! What a learned policy of either kind is evaluated to.

use nalgebra::{Matrix6, Vector6};
use tprmp_spatial::SpatialAcceleration;

use crate::natural::Natural;

/// Most frames of a policy.
pub const FRAME_CAPACITY: usize = 8;
/// The phase stays within these bounds …
pub const PHASE_RANGE: [f64; 2] = [-0.25, 1.25];
/// … and its rate below this \[1/s\].
pub const PHASE_RATE_MAX_1_S: f64 = 50.0;

/// The weight of a skill beside other leaves: its inertia at the goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkillInertia {
    /// \[kg\]
    pub linear_kg: f64,
    /// \[kg m²\]
    pub angular_kg_m2: f64,
}

/// How far a skill has progressed, and how fast it goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phase {
    /// s: 0 at the start, 1 at the goal; of a skill that goes round, in [0, 1).
    pub value: f64,
    /// ṡ \[1/s\].
    pub rate_1_s: f64,
}

/// How the phase responds to the acceleration of the tool: s̈ = free − couplingᵀ ẍ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseResponse {
    /// M_ss⁻¹ f_s \[1/s²\].
    pub free: f64,
    /// M_ss⁻¹ M_sx on \[linear; angular\] \[1/m; 1/rad\].
    pub coupling: Vector6<f64>,
    /// It is not slower than this \[1/s²\]; −∞ unless an obstacle holds the tool back.
    pub least: f64,
    /// Whether the phase begins a new round at 1.
    pub wraps: bool,
}

impl PhaseResponse {
    /// That of a policy without a phase.
    pub(crate) fn none() -> Self {
        Self { free: 0.0, coupling: Vector6::zeros(), least: f64::NEG_INFINITY, wraps: false }
    }
}

impl Phase {
    /// Goes on for `dt_s` \[s\] with the acceleration that the tool gets, by the semi-implicit Euler
    /// rule. At the ends of [`PHASE_RANGE`] it comes to rest; one that goes round begins anew instead. Returns how
    /// many rounds were completed, below zero for backwards.
    pub fn advance(
        &mut self,
        response: &PhaseResponse,
        tool: &SpatialAcceleration,
        dt_s: f64,
    ) -> f64 {
        let own = response.free - response.coupling.dot(&Vector6::from(*tool));
        // Not `max`, which would hide what is not a number.
        let acceleration = if own < response.least { response.least } else { own };
        let rate =
            (self.rate_1_s + acceleration * dt_s).clamp(-PHASE_RATE_MAX_1_S, PHASE_RATE_MAX_1_S);
        let value = self.value + rate * dt_s;
        if !value.is_finite() {
            return 0.0;
        }
        if response.wraps {
            // What is hardly below zero would be rounded to 1.
            let below_one = (value - value.floor()) < 1.0;
            let rounds = if below_one { value.floor() } else { value.ceil() };
            *self = Self { value: (value - rounds).max(0.0), rate_1_s: rate };
            return rounds;
        }
        let [low, high] = PHASE_RANGE;
        self.value = value.clamp(low, high);
        self.rate_1_s = if self.value == value { rate } else { 0.0 };
        0.0
    }
}

/// A skill at a moving pose.
#[derive(Debug, Clone, Copy)]
pub struct SkillValue {
    /// M ẍ = f on \[linear; angular\] of the pose, drift of the map included.
    pub natural: Natural<6>,
    /// V = Φ + ½ żᵀMż \[J\], that of the phase included: never rises while the frames stand still.
    pub energy: f64,
    /// How its phase goes on.
    pub phase: PhaseResponse,
}

impl SkillValue {
    /// No policy yet.
    pub(crate) fn zero() -> Self {
        Self { natural: Natural::zero(), energy: 0.0, phase: PhaseResponse::none() }
    }

    /// The value where frames or parameters leave nothing to evaluate: not finite, so that
    /// [`Natural::resolve`] refuses it.
    pub(crate) fn undefined() -> Self {
        let natural =
            Natural { force: Vector6::repeat(f64::NAN), metric: Matrix6::repeat(f64::NAN) };
        Self { natural, energy: f64::NAN, phase: PhaseResponse::none() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn a_phase_stays_finite_and_in_its_range() {
        let response = |free: f64| {
            let least = f64::NEG_INFINITY;
            PhaseResponse { free, coupling: Vector6::repeat(1.0), least, wraps: false }
        };
        let zero = SpatialAcceleration::ZERO;
        let mut phase = Phase { value: 0.2, rate_1_s: 0.1 };
        phase.advance(&response(f64::NAN), &zero, 1e-3);
        phase.advance(&response(0.0), &SpatialAcceleration { linear: DVec3::NAN, ..zero }, 1e-3);
        assert_eq!(phase, Phase { value: 0.2, rate_1_s: 0.1 });
        for _ in 0..100 {
            phase.advance(&response(1e9), &zero, 1e-2);
        }
        assert_eq!(phase, Phase { value: PHASE_RANGE[1], rate_1_s: 0.0 });
        phase.advance(&response(f64::NEG_INFINITY), &zero, 1e-3);
        assert_eq!(phase.rate_1_s, -PHASE_RATE_MAX_1_S);
    }

    #[test]
    fn a_phase_that_goes_round_stays_in_a_round_and_counts() {
        let least = f64::NEG_INFINITY;
        let response = PhaseResponse { free: 0.0, coupling: Vector6::zeros(), least, wraps: true };
        let zero = SpatialAcceleration::ZERO;
        let mut phase = Phase { value: 0.9, rate_1_s: 2.0 };
        assert_eq!(phase.advance(&response, &zero, 0.1), 1.0);
        assert!((phase.value - 0.1).abs() < 1e-12 && phase.rate_1_s == 2.0);
        phase.rate_1_s = -3.0;
        assert_eq!(phase.advance(&response, &zero, 0.5), -2.0);
        phase = Phase { value: 1e-20, rate_1_s: -2e-20 };
        phase.advance(&response, &zero, 1.0);
        assert!((0.0..1.0).contains(&phase.value));
    }
}
