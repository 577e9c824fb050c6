//! Drawings: strokes given as waypoints, demonstrated by the scripted expert as skills.

use std::path::Path;

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Deserialize;
use tprmp_files::{Existing, Name, outln};

use crate::error::{SimError, parse_json, read_text};
use crate::record::{Demonstration, Labels, Variation, demonstrate, write_all};
use crate::scene::{Range, require_between, require_schema};
use crate::shape::{Stroke, minimum_jerk};

/// Schema this module reads.
const SCHEMA: &str = "tprmp-drawings/1";
/// A stroke that is drawn more slowly would have no end \[m/s\].
const SPEED_MIN_M_S: f64 = 1e-6;
/// Steps of the table from time to arc length.
const TABLE_STEPS: usize = 2000;
/// Where the path is curved less than this, the speed does not depend on it \[1/m\].
const CURVATURE_SOFTENING_1_M: f64 = 1.0;
/// Half the distance over which the curvature is taken, as a fraction of the length.
const CURVATURE_FRACTION: f64 = 0.01;

/// A drawings file: what the expert varies, and the drawings.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Drawings {
    #[serde(rename = "schema")]
    _schema: String,
    start_frame: Name,
    goal_frame: Name,
    /// Demonstrations of each drawing.
    count: u32,
    sampling_time_s: f64,
    /// Length of the stroke by its duration.
    mean_speed_m_s: Range,
    /// Of either frame, to either side, in x and y.
    position_variation_m: f64,
    /// Of either frame, to either side.
    angle_variation_rad: f64,
    /// Of the stroke between its ends, to either side.
    shape_variation_m: f64,
    drawings: Vec<Drawing>,
}

/// A drawing; its name is its skill's, and its folder's.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Drawing {
    skill: Name,
    way_points_m: Vec<[f64; 2]>,
}

impl Drawings {
    /// Reads and checks a drawings file.
    pub(crate) fn read(path: &Path) -> Result<Self, SimError> {
        Self::from_text(&read_text(path, "")?, path)
    }

    fn from_text(text: &str, path: &Path) -> Result<Self, SimError> {
        require_schema(text, path, SCHEMA)?;
        let drawings: Self = parse_json(text, path)?;
        drawings.check(path)?;
        Ok(drawings)
    }

    fn check(&self, path: &Path) -> Result<(), SimError> {
        self.mean_speed_m_s.require(path, "mean_speed_m_s", SPEED_MIN_M_S)?;
        require_between(
            path,
            &[
                ("count", f64::from(self.count), 1.0, 99.0),
                ("sampling_time_s", self.sampling_time_s, 0.001, 0.1),
                ("position_variation_m", self.position_variation_m, 0.0, 2.0),
                ("angle_variation_rad", self.angle_variation_rad, 0.0, 1.6),
                ("shape_variation_m", self.shape_variation_m, 0.0, 1.0),
            ],
        )?;
        for (i, drawing) in self.drawings.iter().enumerate() {
            let fail = |key: &str, problem: String| {
                Err(SimError::key(path, format!("drawings[{i}].{key}"), problem))
            };
            let skill = &drawing.skill;
            if self.drawings[..i].iter().any(|other| other.skill == *skill) {
                return fail("skill", format!("expected names that differ, found `{skill}` twice"));
            }
            let points = &drawing.way_points_m;
            if points.len() < 2 {
                let problem = format!("expected at least 2 waypoints, found {}", points.len());
                return fail("way_points_m", problem);
            }
            let apart =
                |pair: &[[f64; 2]]| (DVec2::from(pair[1]) - DVec2::from(pair[0])).length() > 1e-3;
            if let Some(k) = points.windows(2).position(|pair| !apart(pair)) {
                let problem =
                    format!("expected neighbours apart, found {k} and {} at one place", k + 1);
                return fail("way_points_m", problem);
            }
        }
        Ok(())
    }
}

/// Writes the demonstrations of all drawings, each into a folder of its own.
pub(crate) fn draw(file: &Path, seed: u64, out: &Path, existing: Existing) -> Result<(), SimError> {
    let drawings = Drawings::read(file)?;
    outln!("seed {seed}");
    for drawing in &drawings.drawings {
        let labels = Labels {
            skill: &drawing.skill,
            start_frame: &drawings.start_frame,
            goal_frame: &drawings.goal_frame,
            sampling_time_s: drawings.sampling_time_s,
        };
        let folder = out.join(drawing.skill.as_str());
        write_all(&of_drawing(&drawings, drawing, seed), &labels, &folder, existing)?;
    }
    Ok(())
}

/// The expert's demonstrations of a drawing with this seed.
fn of_drawing(drawings: &Drawings, drawing: &Drawing, seed: u64) -> Vec<Demonstration> {
    let points: Vec<DVec2> = drawing.way_points_m.iter().map(|p| DVec2::from(*p)).collect();
    let stroke = Stroke::through(&points);
    let length = stroke.length_m();
    let Range { low, high } = drawings.mean_speed_m_s;
    let variation = Variation {
        count: drawings.count,
        duration_s: Range { low: length / high, high: length / low },
        sampling_time_s: drawings.sampling_time_s,
        position_variation_m: drawings.position_variation_m,
        angle_variation_rad: drawings.angle_variation_rad,
        shape_variation_m: drawings.shape_variation_m,
    };
    let profile = SpeedProfile::new(&stroke);
    // A stream of its own: a drawing that is added changes no other.
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(fnv1a(&drawing.skill));
    demonstrate(&stroke, &variation, &mut generator, |time| profile.fraction(time))
}

/// FNV-1a hash: the same on every machine and with every version of the compiler.
fn fnv1a(text: &str) -> u64 {
    let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    text.bytes().fold(0xcbf2_9ce4_8422_2325, step)
}

/// How a hand moves along a stroke: slower where it is curved, v ∝ (κ² + κ₀²)^(−1/6), the two-thirds
/// power law [Viviani and Schneider 1991], and from rest to rest.
struct SpeedProfile {
    /// Fraction of the time, without the rests, at σ = i/n.
    times: Vec<f64>,
}

impl SpeedProfile {
    fn new(stroke: &Stroke) -> Self {
        let slowness = |fraction: f64| {
            let h = CURVATURE_FRACTION;
            let fraction = fraction.clamp(h, 1.0 - h);
            let [a, b, c] = [fraction - h, fraction, fraction + h].map(|at| stroke.point(at));
            let step = h * stroke.length_m();
            let curvature = (a - 2.0 * b + c).length() / (step * step);
            (curvature.powi(2) + CURVATURE_SOFTENING_1_M.powi(2)).powf(1.0 / 6.0)
        };
        let mut times = vec![0.0];
        for i in 0..TABLE_STEPS {
            times.push(times[i] + slowness((i as f64 + 0.5) / TABLE_STEPS as f64));
        }
        let whole = times[TABLE_STEPS];
        times.iter_mut().for_each(|time| *time /= whole);
        Self { times }
    }

    /// Fraction of the length at a fraction of the duration.
    fn fraction(&self, time: f64) -> f64 {
        let wanted = minimum_jerk(time);
        let above = self.times.partition_point(|time| *time < wanted).clamp(1, TABLE_STEPS);
        let (low, high) = (self.times[above - 1], self.times[above]);
        (above as f64 - 1.0 + (wanted - low) / (high - low)) / TABLE_STEPS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::PlanarPose;

    const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/drawings.json");
    const UNSEEN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/drawings_unseen.json");

    #[test]
    fn the_shipped_drawings_are_many_and_end_in_their_frames_at_rest() {
        for (file, least) in [(FILE, 15), (UNSEEN, 12)] {
            let drawings = Drawings::read(Path::new(file)).unwrap();
            assert!(drawings.drawings.len() >= least && drawings.count >= 3);
            for drawing in &drawings.drawings {
                let demonstrations = of_drawing(&drawings, drawing, 1);
                for d in &demonstrations {
                    let last = d.points.len() - 1;
                    assert!((d.points[0] - d.start.position_m).length() < 1e-9);
                    assert!((d.points[last] - d.goal.position_m).length() < 1e-9);
                    let speed = |i: usize| {
                        (d.points[i + 1] - d.points[i]).length() / drawings.sampling_time_s
                    };
                    let speeds: Vec<f64> = (0..last).map(speed).collect();
                    let fastest = speeds.iter().copied().fold(0.0, f64::max);
                    assert!(speeds[0] < 0.02 && speeds[last - 1] < 0.02);
                    assert!(fastest < 3.0, "{}: {fastest} m/s", drawing.skill);
                }
                let frames_differ = |a: &PlanarPose, b: &PlanarPose| {
                    (a.position_m - b.position_m).length() > 1e-3
                        && (a.angle_rad - b.angle_rad).abs() > 1e-4
                };
                assert!(frames_differ(&demonstrations[0].start, &demonstrations[1].start));
                assert!(frames_differ(&demonstrations[0].goal, &demonstrations[1].goal));
            }
        }
    }

    #[test]
    fn a_drawing_that_is_added_changes_no_other() {
        let mut drawings = Drawings::read(Path::new(FILE)).unwrap();
        let last = drawings.drawings.last().unwrap().clone();
        let before = of_drawing(&drawings, &last, 3);
        let way_points_m = vec![[0.0, 0.0], [1.0, 0.2], [2.0, 0.0]];
        drawings.drawings.insert(0, Drawing { skill: "new".parse().unwrap(), way_points_m });
        let after = of_drawing(&drawings, drawings.drawings.last().unwrap(), 3);
        assert!(before.iter().zip(&after).all(|(a, b)| a.points == b.points));
        assert!(of_drawing(&drawings, &last, 4)[0].points != before[0].points);
    }

    #[test]
    fn a_hand_is_slower_where_the_path_is_curved() {
        let corner = [(0.0, 0.0), (0.9, 0.0), (1.0, 0.05), (1.0, 0.2), (1.0, 1.0)];
        let stroke = Stroke::through(&corner.map(DVec2::from));
        let profile = SpeedProfile::new(&stroke);
        let slowness = |i: usize| profile.times[i + 1] - profile.times[i];
        assert!(slowness(TABLE_STEPS / 2) > 1.2 * slowness(TABLE_STEPS / 5));
        assert!(profile.fraction(0.0).abs() < 1e-12 && (profile.fraction(1.0) - 1.0).abs() < 1e-12);
        let fractions: Vec<f64> = (0..=50).map(|i| profile.fraction(f64::from(i) / 50.0)).collect();
        assert!(fractions.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn errors_name_file_key_and_expectation() {
        let text = std::fs::read_to_string(FILE).unwrap();
        for (from, to, key, expectation) in [
            ("\"count\": 4", "\"count\": 0", "count", "from 1 to 99"),
            ("tprmp-drawings/1", "tprmp-drawings/9", "schema", "tprmp-drawings/9"),
            ("\"skill\": \"C\"", "\"skill\": \"../C\"", "drawings[0].skill", "expected a name"),
            ("\"skill\": \"G\"", "\"skill\": \"C\"", "drawings[1].skill", "twice"),
            ("\"mean_speed_m_s\": [0.6", "\"mean_speed_m_s\": [-0.6", "mean_speed_m_s", "low"),
            ("\"skill\": \"C\", ", "", "drawings[0]", "missing field `skill`"),
        ] {
            assert!(text.contains(from), "{from}");
            let bad = text.replacen(from, to, 1);
            let error = Drawings::from_text(&bad, Path::new("a/d.json")).unwrap_err().to_string();
            for part in ["a/d.json", key, expectation] {
                assert!(error.contains(part), "{error}: no {part}");
            }
        }
    }
}
