//! Rows of `results.json`.

use std::path::Path;

use serde::{Deserialize, Serialize};
use tprmp_files::{Existing, WriteError};

use crate::experiment::{Experiment, PolicyKind};
use crate::measures::Measures;

/// When the distance to the demonstrated path is measured: after the end of a push [s].
pub(crate) const AFTER_PUSH_S: [f64; 5] = [0.0, 0.25, 0.5, 1.0, 2.0];

/// What one rollout, or one measurement, gave. A length that is not finite (a body that diverged) is
/// `null` in the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) experiment: Experiment,
    pub(crate) dataset: String,
    pub(crate) policy: PolicyKind,
    /// What was varied, with its unit, and what its length or force was multiplied by.
    pub(crate) setting: String,
    pub(crate) skill: String,
    /// Final distance to the true goal [m].
    pub(crate) goal_error_m: Option<f64>,
    /// What the thesis measured in this experiment.
    pub(crate) thesis_metric: Option<f64>,
    /// Mean square distance to the demonstration at the same times, where there is one [m²].
    pub time_aligned_mse_m2: Option<f64>,
    /// Whether the goal was reached within the experiment's tolerance.
    pub(crate) reached: bool,
    /// Whether the obstacle was touched.
    pub(crate) collided: bool,
    /// Least clearance to the obstacle, where there was one [m].
    pub(crate) clearance_min_m: Option<f64>,
    /// Largest acceleration [m/s²].
    pub acceleration_max_m_s2: Option<f64>,
    /// The varied number; of a length or a force, before it was multiplied by the scale.
    pub(crate) x: f64,
    /// By what the protocol's lengths were multiplied: how large the data set is beside the thesis'.
    pub(crate) scale: f64,
    pub(crate) components: usize,
    /// Which demonstration's frames, or which of several draws.
    pub(crate) instance: usize,
    pub(crate) seed: u64,
    /// Whether the task could be done at all; obstacles may bury the goal.
    pub(crate) feasible: bool,
    /// Final angle to the true goal, in space [°].
    pub(crate) goal_error_deg: Option<f64>,
    /// Largest rise of V in a step beyond rounding as a fraction of what it falls by, frames at rest.
    pub(crate) energy_rise_max: Option<f64>,
    /// Starts that reached the goal, of how many.
    pub(crate) starts_reached: Option<[u32; 2]>,
    /// Time of a control iteration: median, 99th percentile and largest [µs].
    pub(crate) iteration_us: Option<[f64; 3]>,
    /// Root mean square of position [m] and orientation [°] against the demonstration.
    pub(crate) tracking_rms: Option<[f64; 2]>,
    /// How like the demonstration the rollout is, where there is one and the body did not diverge.
    pub(crate) measures: Option<Measures>,
    /// Distance to the demonstrated path at [`AFTER_PUSH_S`] after a push, as a fraction of the skill's size.
    pub(crate) tube_distances: Option<[f64; AFTER_PUSH_S.len()]>,
    /// Largest acceleration of the demonstrations [m/s²].
    pub demonstrated_acceleration_max_m_s2: Option<f64>,
}

impl Row {
    /// Nothing was measured yet.
    pub(crate) fn new(experiment: Experiment, policy: PolicyKind) -> Self {
        Self { experiment, policy, scale: 1.0, feasible: true, ..Self::default() }
    }
}

/// A length, unless it is not finite.
pub(crate) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Writes the rows, one a line.
///
/// # Errors
/// [`WriteError`].
pub(crate) fn write(rows: &[Row], path: &Path) -> Result<(), WriteError> {
    let lines: Vec<String> =
        rows.iter().map(|row| serde_json::to_string(row).expect("plain data serialises")).collect();
    let text = format!("[\n{}\n]\n", lines.join(",\n"));
    // The folder is this run's by now.
    tprmp_files::write(path, text, Existing::Replace)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_the_agreed_keys_and_come_back() {
        let row = Row {
            goal_error_m: finite(f64::INFINITY),
            thesis_metric: finite(0.1),
            x: 9.0,
            measures: Some(Measures {
                rmse_m: 0.1,
                dtw_m: 0.2,
                frechet_m: 0.3,
                swept_area_m2: None,
                velocity_rmse_m_s: 0.4,
            }),
            tube_distances: Some([0.5, 0.4, 0.3, 0.2, 0.1]),
            ..Row::new(Experiment::Tracking, PolicyKind::TpgmmLqr)
        };
        let value = serde_json::to_value(&row).unwrap();
        for key in [
            "experiment",
            "dataset",
            "policy",
            "setting",
            "skill",
            "goal_error_m",
            "thesis_metric",
            "time_aligned_mse_m2",
            "reached",
            "collided",
            "clearance_min_m",
            "acceleration_max_m_s2",
        ] {
            assert!(value.get(key).is_some(), "{key}");
        }
        assert!(value["goal_error_m"].is_null());
        assert_eq!(
            (&value["experiment"], &value["policy"]),
            (&"tracking".into(), &"tpgmm_lqr".into())
        );
        let back: Row = serde_json::from_value(value).unwrap();
        assert_eq!(back, row);
    }
}
