//! The scene file: what moves how, and between which limits a seed draws it.
//!
//! Every key is needed and no other is taken; the unit stands last in a key. A pair of numbers is
//! a range from which each seed draws uniformly.

use std::path::{Path, PathBuf};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::RngCore;
use serde::Deserialize;
use tprmp_files::Name;

use crate::error::{SimError, parse_json, read_text};

/// Schema this module reads.
const SCHEMA: &str = "tprmp-planar-scene/1";

/// A scene, checked.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Scene {
    /// Where it was read from.
    #[serde(skip)]
    pub(crate) file: PathBuf,
    #[serde(rename = "schema")]
    _schema: String,
    pub(crate) robot: RobotSettings,
    pub(crate) physics: PhysicsSettings,
    pub(crate) task: TaskSettings,
    pub(crate) start: StartSettings,
    pub(crate) goal: GoalSettings,
    pub(crate) obstacle: ObstacleSettings,
    pub(crate) push: PushSettings,
    pub(crate) record: RecordSettings,
}

/// Which robot.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RobotSettings {
    /// Relative to the scene file; after reading, as it can be opened.
    pub(crate) urdf: PathBuf,
    pub(crate) tool_link: String,
}

/// The physics' clock.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PhysicsSettings {
    pub(crate) rate_hz: u32,
    pub(crate) time_limit_s: f64,
}

/// Which skill, and what counts as success.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TaskSettings {
    pub(crate) skill: Name,
    /// Relative to the scene file; after reading, as it can be opened.
    pub(crate) demonstrations: PathBuf,
    pub(crate) start_frame: Name,
    pub(crate) goal_frame: Name,
    pub(crate) position_error_max_m: f64,
    /// The skill is never done: the time limit is the end of the run.
    #[serde(default)]
    pub(crate) goes_round: bool,
}

/// The start frame, against the start of the expert's stroke.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StartSettings {
    pub(crate) offset_x_m: Range,
    pub(crate) offset_y_m: Range,
    pub(crate) angle_rad: Range,
}

/// The goal frame: on a circle about the end of the expert's stroke, rotating to and fro.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GoalSettings {
    pub(crate) offset_x_m: Range,
    pub(crate) offset_y_m: Range,
    pub(crate) circle_radius_m: f64,
    pub(crate) circle_speed_rad_s: Range,
    pub(crate) circle_phase_rad: Range,
    pub(crate) rotation_amplitude_rad: Range,
    pub(crate) rotation_speed_rad_s: Range,
    pub(crate) rotation_phase_rad: Range,
}

/// The obstacle: a ball that swings across the stroke.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ObstacleSettings {
    pub(crate) radius_m: Range,
    /// Where it crosses the stroke, as a fraction of its length.
    pub(crate) crossing_fraction: Range,
    pub(crate) crossing_time_s: Range,
    /// Direction in which it crosses, against the stroke's normal.
    pub(crate) crossing_angle_rad: Range,
    pub(crate) crossing_speed_m_s: Range,
    /// How far it swings to either side.
    pub(crate) swing_m: Range,
    /// Kept between its surface and the point at the start, at any time.
    pub(crate) start_clearance_min_m: f64,
    /// Kept between its surface and a point anywhere on the goal's circle, at any time.
    pub(crate) goal_clearance_min_m: f64,
}

/// The push that `--push` asks for.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PushSettings {
    pub(crate) force_n: Range,
    pub(crate) direction_rad: Range,
    pub(crate) time_s: Range,
    pub(crate) duration_s: f64,
}

/// The scripted expert.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RecordSettings {
    pub(crate) count: u32,
    /// From start to end.
    pub(crate) length_m: f64,
    /// Of either curve of the S.
    pub(crate) height_m: f64,
    /// How far the curves lean over their middle.
    pub(crate) overhang_m: f64,
    pub(crate) duration_s: Range,
    pub(crate) sampling_time_s: f64,
    /// Of either frame, to either side, in x and y.
    pub(crate) position_variation_m: f64,
    /// Of either frame, to either side.
    pub(crate) angle_variation_rad: f64,
    /// Of the stroke between its ends, to either side.
    pub(crate) shape_variation_m: f64,
}

/// From where a seed draws uniformly: `[low, high]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(from = "[f64; 2]")]
pub(crate) struct Range {
    pub(crate) low: f64,
    pub(crate) high: f64,
}

impl From<[f64; 2]> for Range {
    fn from([low, high]: [f64; 2]) -> Self {
        Self { low, high }
    }
}

impl Range {
    /// Refuses ends that are not numbers in order from `least` on.
    pub(crate) fn require(&self, path: &Path, key: &str, least: f64) -> Result<(), SimError> {
        let Self { low, high } = *self;
        if low.is_finite() && high.is_finite() && low <= high && low >= least {
            return Ok(());
        }
        let bound = if least.is_finite() { format!(" from {least}") } else { String::new() };
        let problem = format!("expected [low, high] with low ≤ high{bound}, found [{low}, {high}]");
        Err(SimError::key(path, key, problem))
    }

    /// To either side of zero.
    pub(crate) fn around_zero(most: f64) -> Self {
        Self { low: -most, high: most }
    }

    /// One value.
    pub(crate) fn draw(&self, generator: &mut ChaCha8Rng) -> f64 {
        // 53 random bits: the same on every machine and with every version of a crate.
        let fraction = (generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        self.low + (self.high - self.low) * fraction
    }
}

/// Refuses numbers that are not between their bounds: key, number, least, most.
pub(crate) fn require_between(
    path: &Path,
    numbers: &[(&str, f64, f64, f64)],
) -> Result<(), SimError> {
    match numbers.iter().find(|(_, number, least, most)| !(least..=most).contains(&number)) {
        None => Ok(()),
        Some((key, number, least, most)) => {
            let problem = format!("expected a number from {least} to {most}, found {number}");
            Err(SimError::key(path, *key, problem))
        }
    }
}

#[derive(Deserialize)]
struct Header {
    schema: Option<String>,
}

/// The schema first, so that a file of another version is refused as such.
pub(crate) fn require_schema(text: &str, path: &Path, expected: &str) -> Result<(), SimError> {
    let found = parse_json::<Header>(text, path)?.schema;
    if found.as_deref() == Some(expected) {
        return Ok(());
    }
    let found = found.map_or("none".into(), |s| format!("`{s}`"));
    Err(SimError::key(path, "schema", format!("expected `{expected}`, found {found}")))
}

impl Scene {
    /// Reads and checks a scene file.
    pub(crate) fn read(path: &Path) -> Result<Self, SimError> {
        Self::from_text(&read_text(path, "")?, path)
    }

    /// A scene from the text of the file at `path`.
    pub(crate) fn from_text(text: &str, path: &Path) -> Result<Self, SimError> {
        require_schema(text, path, SCHEMA)?;
        let mut scene: Self = parse_json(text, path)?;
        scene.check_ranges(path)?;
        scene.check_numbers(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        scene.robot.urdf = folder.join(&scene.robot.urdf);
        scene.task.demonstrations = folder.join(&scene.task.demonstrations);
        scene.file = path.into();
        Ok(scene)
    }

    fn check_ranges(&self, path: &Path) -> Result<(), SimError> {
        let (start, goal, obstacle) = (&self.start, &self.goal, &self.obstacle);
        let (push, record) = (&self.push, &self.record);
        let any = f64::NEG_INFINITY;
        let ranges = [
            ("start.offset_x_m", start.offset_x_m, any),
            ("start.offset_y_m", start.offset_y_m, any),
            ("start.angle_rad", start.angle_rad, any),
            ("goal.offset_x_m", goal.offset_x_m, any),
            ("goal.offset_y_m", goal.offset_y_m, any),
            ("goal.circle_speed_rad_s", goal.circle_speed_rad_s, any),
            ("goal.circle_phase_rad", goal.circle_phase_rad, any),
            ("goal.rotation_amplitude_rad", goal.rotation_amplitude_rad, 0.0),
            ("goal.rotation_speed_rad_s", goal.rotation_speed_rad_s, any),
            ("goal.rotation_phase_rad", goal.rotation_phase_rad, any),
            ("obstacle.radius_m", obstacle.radius_m, 0.0),
            ("obstacle.crossing_fraction", obstacle.crossing_fraction, 0.0),
            ("obstacle.crossing_time_s", obstacle.crossing_time_s, 0.0),
            ("obstacle.crossing_angle_rad", obstacle.crossing_angle_rad, any),
            ("obstacle.crossing_speed_m_s", obstacle.crossing_speed_m_s, 0.0),
            ("obstacle.swing_m", obstacle.swing_m, 1e-3),
            ("push.force_n", push.force_n, 0.0),
            ("push.direction_rad", push.direction_rad, any),
            ("push.time_s", push.time_s, 0.0),
            ("record.duration_s", record.duration_s, 0.5),
        ];
        ranges.into_iter().try_for_each(|(key, range, least)| range.require(path, key, least))
    }

    fn check_numbers(&self, path: &Path) -> Result<(), SimError> {
        let (goal, obstacle) = (&self.goal, &self.obstacle);
        let (push, record) = (&self.push, &self.record);
        let numbers = [
            ("physics.rate_hz", f64::from(self.physics.rate_hz), 100.0, 10_000.0),
            ("physics.time_limit_s", self.physics.time_limit_s, 1.0, 600.0),
            ("task.position_error_max_m", self.task.position_error_max_m, 1e-4, 1.0),
            ("goal.circle_radius_m", goal.circle_radius_m, 0.0, 5.0),
            ("obstacle.start_clearance_min_m", obstacle.start_clearance_min_m, 0.0, 5.0),
            ("obstacle.goal_clearance_min_m", obstacle.goal_clearance_min_m, 0.0, 5.0),
            ("push.duration_s", push.duration_s, 0.0, 10.0),
            ("record.count", f64::from(record.count), 1.0, 99.0),
            ("record.length_m", record.length_m, 0.5, 10.0),
            ("record.height_m", record.height_m, 0.0, 5.0),
            ("record.overhang_m", record.overhang_m, 0.0, 2.0),
            ("record.sampling_time_s", record.sampling_time_s, 0.001, 0.1),
            ("record.position_variation_m", record.position_variation_m, 0.0, 2.0),
            ("record.angle_variation_rad", record.angle_variation_rad, 0.0, 1.6),
            ("record.shape_variation_m", record.shape_variation_m, 0.0, 1.0),
        ];
        require_between(path, &numbers)?;
        if 1_000_000_000 % self.physics.rate_hz != 0 {
            let problem = format!(
                "expected a period of whole nanoseconds, e.g. 1000, found {}",
                self.physics.rate_hz
            );
            return Err(SimError::key(path, "physics.rate_hz", problem));
        }
        if obstacle.crossing_fraction.high > 1.0 {
            let problem = "expected fractions from 0 to 1";
            return Err(SimError::key(path, "obstacle.crossing_fraction", problem));
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) const FILE: &str =
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenes/planar.json");

    pub(crate) fn scene() -> Scene {
        Scene::read(Path::new(FILE)).unwrap()
    }

    #[test]
    fn errors_name_file_key_and_expectation() {
        let text = std::fs::read_to_string(FILE).unwrap();
        let cases = [
            ("\"rate_hz\": 1000,", "", "physics", "missing field `rate_hz`"),
            ("\"rate_hz\": 1000", "\"rate_hz\": \"fast\"", "physics.rate_hz", "expected u32"),
            ("\"rate_hz\": 1000", "\"rate_hz\": 1500", "physics.rate_hz", "whole nanoseconds"),
            ("\"swing_m\"", "\"swing_mm\"", "obstacle.swing_mm", "unknown field `swing_mm`"),
            ("\"circle_radius_m\": 0.2", "\"circle_radius_m\": -1", "goal.circle_radius_m", "-1"),
            ("[0.08, 0.14]", "[0.14, 0.08]", "obstacle.radius_m", "low ≤ high"),
            ("[0.08, 0.14]", "[0.08]", "obstacle.radius_m", "array of length 2"),
            ("tprmp-planar-scene/1", "tprmp-scene/1", "schema", "found `tprmp-scene/1`"),
        ];
        for (from, to, key, expectation) in cases {
            assert!(text.contains(from), "{from}");
            let bad = text.replacen(from, to, 1);
            let error = Scene::from_text(&bad, Path::new("a/scene.json")).unwrap_err().to_string();
            for part in ["a/scene.json", &format!("`{key}`"), expectation] {
                assert!(error.contains(part), "{error}: no {part}");
            }
        }
    }
}
