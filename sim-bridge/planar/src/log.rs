//! What a run leaves behind: `DIR/log.csv`, every fifth step, and `DIR/bridge.json`, what the
//! simulator knows about the whole run.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};
use tprmp_files::{Draft, Existing, make_folder};
use tprmp_messages::LifeCycle;

use crate::episode::Episode;
use crate::error::{SimError, parse_json, read_text};

/// File of the rows.
pub(crate) const LOG_FILE: &str = "log.csv";
/// File of the whole run.
pub(crate) const BRIDGE_FILE: &str = "bridge.json";
/// Schema of [`BRIDGE_FILE`].
const SCHEMA: &str = "tprmp-planar-bridge/1";
/// One row is kept of so many steps.
pub(crate) const STEPS_A_ROW: u64 = 5;
const HINT: &str = " (is this a folder that `planar-sim run --out` wrote?)";

/// The controller brakes in order to leave: no longer part of the task.
pub(crate) const STOPPING: f64 = LifeCycle::Stopping as u32 as f64;

macro_rules! row {
    ($($(#[$meta:meta])* $column:ident),+ $(,)?) => {
        /// One row: the state at a time and what acts from then on. SI units; `-1` where there is
        /// no mode, reason or life cycle yet.
        #[derive(Debug, Clone, Copy, Default, PartialEq)]
        pub(crate) struct Row { $($(#[$meta])* pub(crate) $column: f64),+ }

        impl Row {
            const COLUMNS: &[&str] = &[$(stringify!($column)),+];
            fn values(&self) -> [f64; Self::COLUMNS.len()] { [$(self.$column),+] }
            fn from_values(values: [f64; Self::COLUMNS.len()]) -> Self {
                let [$($column),+] = values;
                Self { $($column),+ }
            }
        }
    };
}

row! {
    /// The scenario's clock.
    time_s,
    x_m,
    y_m,
    vx_m_s,
    vy_m_s,
    /// Applied, within the limits.
    force_x_n,
    force_y_n,
    goal_x_m,
    goal_y_m,
    goal_angle_rad,
    obstacle_x_m,
    obstacle_y_m,
    clearance_m,
    /// A `CommandMode`, -1 while braked.
    mode,
    /// A `Reason`.
    reason,
    /// A `LifeCycle`.
    life_cycle,
}

/// The whole run.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Bridge {
    pub(crate) schema: String,
    /// Scene file.
    pub(crate) scene: String,
    pub(crate) instance: String,
    pub(crate) mode: Mode,
    pub(crate) outcome: Outcome,
    pub(crate) point_radius_m: f64,
    pub(crate) effort_max_n: [f64; 2],
    pub(crate) velocity_max_m_s: [f64; 2],
    pub(crate) episode: Episode,
    pub(crate) timing: Timing,
    /// How many commands had each fault, by its name; runs of old have none.
    #[serde(default)]
    pub(crate) command_faults: BTreeMap<String, u64>,
    pub(crate) extremes: Extremes,
}

/// Which clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Mode {
    RealTime,
    Lockstep,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Outcome {
    /// The controller called the task done, for a second; or what goes round went round to the time limit.
    Done,
    /// The controller left before.
    ControllerStopped,
    /// In lockstep: no answer any more.
    ControllerLost,
    /// The scene's time limit.
    Timeout,
    /// A signal.
    Interrupted,
}

/// How well real time was kept.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Timing {
    pub(crate) wall_s: f64,
    pub(crate) simulated_s: f64,
    /// Steps that began more than half a period late: the schedule moved with them.
    pub(crate) slips: u64,
    pub(crate) slip_total_s: f64,
    pub(crate) slip_max_s: f64,
    pub(crate) braked_steps: u64,
    pub(crate) clamped_steps: u64,
}

/// Extremes over every step.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Extremes {
    pub(crate) clearance_min_m: f64,
    /// Of the force, as a fraction of its limit.
    pub(crate) effort_fraction_max: f64,
    /// Of the velocity, as a fraction of its limit.
    pub(crate) velocity_fraction_max: f64,
}

impl Bridge {
    /// The schema this program writes and reads.
    pub(crate) fn schema() -> String {
        SCHEMA.into()
    }
}

/// Writes both files into a folder; both, or none when one may not be.
pub(crate) fn save(
    folder: &Path,
    rows: &[Row],
    bridge: &Bridge,
    existing: Existing,
) -> Result<(), SimError> {
    let mut text = Row::COLUMNS.join(",");
    text.push('\n');
    for row in rows {
        for (i, value) in row.values().iter().enumerate() {
            let separator = if i == 0 { "" } else { "," };
            // Tenths of a millimetre and less; no trailing zeros.
            let rounded = (value * 1e5).round() / 1e5;
            write!(text, "{separator}{rounded}").expect("a string grows");
        }
        text.push('\n');
    }
    let json = serde_json::to_string_pretty(bridge).expect("keys are strings");
    make_folder(folder)?;
    let mut drafts = Vec::new();
    for (name, content) in [(LOG_FILE, text), (BRIDGE_FILE, json + "\n")] {
        let mut draft = Draft::open(&folder.join(name), existing)?;
        draft.put(content)?;
        drafts.push(draft);
    }
    Ok(drafts.into_iter().try_for_each(Draft::keep)?)
}

/// Reads both files of a folder.
pub(crate) fn load(folder: &Path) -> Result<(Vec<Row>, Bridge), SimError> {
    let path = folder.join(BRIDGE_FILE);
    let bridge: Bridge = parse_json(&read_text(&path, HINT)?, &path)?;
    if bridge.schema != SCHEMA {
        let problem = format!("expected `{SCHEMA}`, found `{}`", bridge.schema);
        return Err(SimError::key(&path, "schema", problem));
    }
    let path = folder.join(LOG_FILE);
    Ok((parse_rows(&read_text(&path, HINT)?, &path)?, bridge))
}

/// Counts by name, in words.
pub(crate) fn counted(counts: &BTreeMap<String, u64>) -> String {
    if counts.is_empty() {
        return "none".into();
    }
    let each: Vec<_> = counts.iter().map(|(name, count)| format!("{count} {name}")).collect();
    each.join(", ")
}

/// The rows of the task, without those in which the controller leaves.
pub(crate) fn before_stopping(mut rows: Vec<Row>) -> Vec<Row> {
    rows.retain(|row| row.life_cycle != STOPPING);
    rows
}

fn parse_rows(text: &str, path: &Path) -> Result<Vec<Row>, SimError> {
    let mut lines = text.lines();
    let header = lines.next().unwrap_or("");
    if header != Row::COLUMNS.join(",") {
        let problem = format!("expected `{}`, found `{header}`", Row::COLUMNS.join(","));
        return Err(SimError::key(path, "line 1", problem));
    }
    let parse = |(i, line): (usize, &str)| {
        let values: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
        let values = values.ok().and_then(|values| values.try_into().ok());
        values.map(Row::from_values).ok_or_else(|| {
            let problem = format!("expected {} numbers, found `{line}`", Row::COLUMNS.len());
            SimError::key(path, format!("line {}", i + 2), problem)
        })
    };
    lines.enumerate().map(parse).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_survive_the_file_and_damaged_ones_are_refused() {
        let path = Path::new("log.csv");
        let header = Row::COLUMNS.join(",");
        let mut values = [0.0; Row::COLUMNS.len()];
        for (i, value) in values.iter_mut().enumerate() {
            *value = i as f64 * 0.125 - 1.0;
        }
        let line = values.map(|v| v.to_string()).join(",");
        let rows = parse_rows(&format!("{header}\n{line}\n"), path).unwrap();
        assert_eq!(rows, [Row::from_values(values)]);
        assert_eq!(rows[0].values(), values);
        for (text, place) in [
            ("time_s\n1\n".to_owned(), "line 1"),
            (format!("{header}\n{line}\n1,2\n"), "line 3"),
            (format!("{header}\n{}\n", line.replace("-1", "x")), "line 2"),
        ] {
            let error = parse_rows(&text, path).unwrap_err().to_string();
            assert!(error.contains(place) && error.contains("log.csv"), "{error}");
        }
    }
}
