//! What was proved of a model, and how its rollouts ended.

use serde::{Deserialize, Serialize};

/// What was proved of a model, and how its rollouts ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// Why it is not certified; empty when it is.
    pub failures: Vec<String>,
    /// Its blocks: position and orientation, or the pose as a whole.
    pub blocks: Vec<BlockCertificate>,
    /// Rollouts from random starts with the frames of the demonstrations.
    pub demonstrated_frames: Rollouts,
    /// The same with displaced and rotated frames.
    pub displaced_frames: Rollouts,
    /// Step of these rollouts \[s\].
    pub step_s: f64,
    /// The limit cycle of a periodic skill.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cycle: Option<CycleCertificate>,
}

/// The limit cycle of a periodic skill, as rollouts run in it once they have come to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CycleCertificate {
    /// How long a round lasts \[s\].
    pub period_s: f64,
    /// How long a demonstrated one lasts, median \[s\].
    pub demonstrated_period_s: f64,
    /// How many complete rounds each demonstration has, in their order.
    pub rounds: Vec<u32>,
    /// Root of the mean square distance of the cycle from the mean of the demonstrated rounds \[m\].
    pub beside_rms_m: f64,
    /// The same for the angle \[rad\].
    pub beside_rms_rad: f64,
    /// Largest distance from that mean \[m\].
    pub beside_max_m: f64,
    /// Largest angle to it \[rad\].
    pub beside_max_rad: f64,
    /// Largest distance between the places at which successive rounds end, of rollouts in the cycle \[m\].
    pub return_max_m: f64,
    /// The same for the angle \[rad\].
    pub return_max_rad: f64,
}

/// A block of the policy at its goal, and its metric.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockCertificate {
    /// `position`, `orientation` or `pose`.
    pub name: String,
    /// No eigenvalue of the metric is smaller, anywhere: it is a mean of the components' metrics.
    pub metric_eigenvalue_min: f64,
    /// No eigenvalue of the metric is larger, anywhere.
    pub metric_eigenvalue_max: f64,
    /// |M⁻¹∇Φ| at the goal [m/s² or rad/s²]: zero when the goal is at rest, and for periodic skills, which have none.
    pub goal_gradient: f64,
    /// Smallest eigenvalue of the Hessian at the goal relative to the metric [1/s²]: positive when
    /// the goal is a strict minimum. Zero for periodic skills, which have no goal.
    pub goal_hessian_min_1_s2: f64,
    /// The valley of a canonical field.
    pub valley: Option<ValleyCertificate>,
}

/// For each phase a canonical potential is a quadratic with one lowest point; these points are its
/// valley. Where the valley falls towards the goal everywhere, the goal is the only place of rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValleyCertificate {
    /// Phases at which it was examined.
    pub phases: u32,
    /// Smallest eigenvalue of the Hessian of Φ in the coordinates without the phase, relative to the
    /// metric [1/s²]: no smaller at any phase, since both are means of the components'.
    pub stiffness_min_1_s2: f64,
    /// Least fall of the potential along the valley towards the goal, over a fraction of the phase
    /// [u²/s²], outside of the neighbourhood of the goal that its Hessian covers; of a periodic skill, along all
    /// of a round.
    pub descent_min: f64,
    /// Intervals of the phase over which it was proved, by interval arithmetic, that the potential falls towards
    /// the goal, or all along a round: together they are all phases. 0 where it was not proved.
    #[serde(default)]
    pub intervals: u32,
    /// Phases between which it could not be proved.
    #[serde(default)]
    pub unproved: Option<[f64; 2]>,
}

/// Figures of rollouts from random starts around the demonstrations. Where a periodic skill has no goal, the limit
/// cycle stands in its place: what was reached, and how far the last round is from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rollouts {
    /// Number of starts.
    pub starts: u32,
    /// Starts from which the goal was reached.
    pub reached: u32,
    /// Largest final distance to the goal \[m\].
    pub goal_error_max_m: f64,
    /// Largest final angle to the goal \[rad\].
    pub goal_error_max_rad: f64,
    /// Largest rise of `V = Φ + ½żᵀMż` in a step, relative to its value at the start above that at the
    /// goal.
    pub energy_rise_max: f64,
    /// Of those that did not reach it, how many were still on their way when time was up.
    #[serde(default)]
    pub on_their_way: u32,
}

impl Certificate {
    /// Before anything was examined.
    #[must_use]
    pub fn none() -> Self {
        let rollouts = Rollouts {
            starts: 0,
            reached: 0,
            goal_error_max_m: 0.0,
            goal_error_max_rad: 0.0,
            energy_rise_max: 0.0,
            on_their_way: 0,
        };
        Self {
            failures: vec!["nothing was examined".into()],
            blocks: Vec::new(),
            demonstrated_frames: rollouts.clone(),
            displaced_frames: rollouts,
            step_s: 0.0,
            cycle: None,
        }
    }

    /// Whether nothing failed.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.failures.is_empty()
    }
}
