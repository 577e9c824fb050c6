//! Rows of `results.json`.

use std::path::Path;

use serde::{Deserialize, Serialize};

use tprmp_learner::file_error::FileError;

/// What one rollout, or one measurement, gave. A length that is not finite (a body that diverged) is
/// `null` in the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Which experiment.
    pub experiment: String,
    /// Name of the data set.
    pub dataset: String,
    /// Which policy.
    pub policy: String,
    /// What was varied, with its unit.
    pub setting: String,
    /// Name of the skill.
    pub skill: String,
    /// Final distance to the true goal [m].
    pub goal_error_m: Option<f64>,
    /// What the thesis measured in this experiment.
    pub thesis_metric: Option<f64>,
    /// Mean square distance to the demonstration at the same times, where there is one [m²].
    pub time_aligned_mse_m2: Option<f64>,
    /// Whether the goal was reached within the experiment's tolerance.
    pub reached: bool,
    /// Whether the obstacle was touched.
    pub collided: bool,
    /// Least clearance to the obstacle, where there was one [m].
    pub clearance_min_m: Option<f64>,
    /// Largest acceleration [m/s²].
    pub acceleration_max_m_s2: Option<f64>,
    /// The varied number.
    pub x: f64,
    /// Gaussians.
    pub components: usize,
    /// Which demonstration's frames, or which of several draws.
    pub instance: usize,
    /// Seed of what is drawn.
    pub seed: u64,
    /// Whether the task could be done at all; obstacles may bury the goal.
    pub feasible: bool,
    /// Final angle to the true goal, in space [°].
    pub goal_error_deg: Option<f64>,
    /// Largest rise of V in a step beyond rounding as a fraction of what it falls by, frames at rest.
    pub energy_rise_max: Option<f64>,
    /// Starts that reached the goal, of how many.
    pub starts_reached: Option<[u32; 2]>,
    /// Time of a control iteration: median, 99th percentile and largest [µs].
    pub iteration_us: Option<[f64; 3]>,
    /// Root mean square of position [m] and orientation [°] against the demonstration.
    pub tracking_rms: Option<[f64; 2]>,
    /// Largest acceleration of the demonstrations [m/s²].
    pub demonstrated_acceleration_max_m_s2: Option<f64>,
}

/// A length, unless it is not finite.
#[must_use]
pub fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Writes the rows, one a line.
///
/// # Errors
/// [`FileError::Write`].
pub fn write(rows: &[Row], path: &Path) -> Result<(), FileError> {
    let lines: Vec<String> =
        rows.iter().map(|row| serde_json::to_string(row).expect("plain data serialises")).collect();
    let text = format!("[\n{}\n]\n", lines.join(",\n"));
    std::fs::write(path, text).map_err(|source| FileError::Write { path: path.into(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_the_agreed_keys_and_come_back() {
        let row = Row {
            experiment: "tracking".into(),
            goal_error_m: finite(f64::INFINITY),
            thesis_metric: finite(0.1),
            x: 9.0,
            ..Row::default()
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
        let back: Row = serde_json::from_value(value).unwrap();
        assert_eq!(back, row);
    }
}
