//! How the phase runs from 0 to 1 during a demonstration.
//!
//! The policy moves its phase by a potential and the damping d (see `tprmp_rmpflow::policy::canonical::field`), from
//! rest: so the phase of the demonstrations is the solution of (8a) in MATHEMATICS.md,
//!
//! ```text
//! s̈ = f(s) − d ṡ     f(s) = d v tanh((1 − s)/κ)     κ = 4v/d     s(0) = ṡ(0) = 0
//! ```
//!
//! a constant pull before, and a spring without overshoot at the goal (f′(1) = −d²/4). A potential
//! with this slope reproduces it without a lag. A profile that suits the eye, such as one that rises like
//! t³, has no such potential: where s̈ + d ṡ is no smooth function of s, each error at the start grows.
//!
//! v is such that the phase ends, after the duration, where a fraction of κ is left; that is then called
//! 1. The fraction belongs to the profile and is no setting: pictures of a model draw by the same profile.

use crate::skill::FitSettings;

/// What is left of κ when the demonstrations end: where tanh is linear to 1.3 %, so that the end is
/// approached as the policy approaches it.
const LEFT: f64 = 0.2;
/// Steps of the table, and of the integration: a hundred in each of the policy's time constants 1/d at
/// 8/s over 5 s.
const STEPS: usize = 4000;
/// Halvings in the search of v: more than a double has digits.
const HALVINGS: usize = 60;

/// The phase as a function of the fraction of a duration.
#[derive(Clone, Debug)]
pub struct PhaseProfile {
    /// At equal steps of the fraction: the phase and its first two derivatives by the fraction.
    table: Vec<[f64; 3]>,
}

impl PhaseProfile {
    /// The profile in demonstrations of this duration \[s\] that are learned from with these settings.
    #[must_use]
    pub fn of(fit: &FitSettings, duration_s: f64) -> Self {
        match fit {
            FitSettings::Canonical(settings) => Self::damped(duration_s, settings.damping_1_s),
            // The thesis' policy has no phase.
            FitSettings::Thesis(_) => Self::linear(),
        }
    }

    /// The phase is the fraction.
    #[must_use]
    pub fn linear() -> Self {
        Self { table: vec![[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]] }
    }

    /// The profile of a policy with this damping in demonstrations of this duration.
    ///
    /// * `duration_s`     above 0
    /// * `damping_1_s`    d, above 0
    #[must_use]
    pub fn damped(duration_s: f64, damping_1_s: f64) -> Self {
        let d = damping_1_s * duration_s;
        // The speed that arrives in time, per duration: a larger one leaves less.
        let (mut low, mut high) = (0.0, 1e3 * (1.0 + 1.0 / d));
        for _ in 0..HALVINGS {
            let v = 0.5 * (low + high);
            let end = integrate(v, d).last().map_or(0.0, |end| end[0]);
            if 1.0 - end > LEFT * 4.0 * v / d { low = v } else { high = v }
        }
        let mut table = integrate(high, d);
        let end = table[STEPS][0];
        table.iter_mut().flatten().for_each(|entry| *entry /= end);
        Self { table }
    }

    /// The phase at a fraction of the duration, and its first two derivatives by the fraction.
    ///
    /// * `fraction`  0 to 1
    #[must_use]
    pub fn at(&self, fraction: f64) -> [f64; 3] {
        let last = self.table.len() - 1;
        let place = fraction.clamp(0.0, 1.0) * last as f64;
        let i = (place as usize).min(last - 1);
        let (a, b, t) = (self.table[i], self.table[i + 1], place - i as f64);
        [0, 1, 2].map(|k| a[k] + t * (b[k] - a[k]))
    }
}

/// Phase and derivatives at equal steps of the fraction, by the midpoint rule.
fn integrate(v: f64, d: f64) -> Vec<[f64; 3]> {
    let second = |s: f64, rate: f64| d * (v * ((1.0 - s) * d / (4.0 * v)).tanh() - rate);
    let h = 1.0 / STEPS as f64;
    let (mut s, mut rate) = (0.0, 0.0);
    let mut table = Vec::with_capacity(STEPS + 1);
    for _ in 0..STEPS {
        let acceleration = second(s, rate);
        table.push([s, rate, acceleration]);
        let (s_mid, rate_mid) = (s + 0.5 * h * rate, rate + 0.5 * h * acceleration);
        s += h * rate_mid;
        rate += h * second(s_mid, rate_mid);
    }
    table.push([s, rate, second(s, rate)]);
    table
}
