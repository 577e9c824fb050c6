//! Frames and obstacles that stand still, in a RON file: what `controller frames` publishes.

use std::path::{Path, PathBuf};

use serde::Deserialize;

/// A larger file is none of frames \[bytes\].
const BYTES_MAX: u64 = 1 << 20;

/// What a source publishes again and again.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedFrames {
    /// Name of the source.
    pub source: String,
    /// Time between two messages \[s\].
    pub period_s: f64,
    /// Frames.
    pub frames: Vec<FixedFrame>,
    /// Obstacles.
    pub obstacles: Vec<FixedObstacle>,
}

/// A frame in the robot's base.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedFrame {
    /// Its name.
    pub name: String,
    /// Origin \[m\].
    pub position_m: [f64; 3],
    /// Orientation, unit quaternion.
    pub quaternion_wxyz: [f64; 4],
}

/// An obstacle in the robot's base.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum FixedObstacle {
    /// A ball.
    Sphere {
        /// Centre \[m\].
        position_m: [f64; 3],
        /// Radius \[m\].
        radius_m: f64,
    },
    /// Everything below a plane whose normal is the z axis.
    HalfSpace {
        /// A point of the plane \[m\].
        position_m: [f64; 3],
        /// Orientation, unit quaternion.
        quaternion_wxyz: [f64; 4],
    },
    /// All points within a radius of a stretch of the z axis.
    Capsule {
        /// Middle of the stretch \[m\].
        position_m: [f64; 3],
        /// Orientation, unit quaternion.
        quaternion_wxyz: [f64; 4],
        /// Radius \[m\].
        radius_m: f64,
        /// Length of the stretch, without the round ends \[m\].
        length_m: f64,
    },
    /// A box.
    Box {
        /// Centre \[m\].
        position_m: [f64; 3],
        /// Orientation, unit quaternion.
        quaternion_wxyz: [f64; 4],
        /// Edges along x, y and z \[m\].
        size_m: [f64; 3],
    },
}

/// Why a file of frames is refused.
#[derive(Debug, thiserror::Error)]
pub enum FixedFramesError {
    /// It cannot be read.
    #[error("frames `{path}` cannot be read: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// It is not RON, or a key is missing, unknown or of another type.
    #[error("frames `{path}`, line {line}, column {column}: {problem}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// What is wrong.
        problem: String,
    },
    /// A value is outside its range.
    #[error("frames `{path}`, key `{key}`: {problem}")]
    Value {
        /// The file.
        path: PathBuf,
        /// The key.
        key: String,
        /// What is wrong.
        problem: String,
    },
}

/// Reads a file of at most 1 MiB. Whether messages carry what it names is judged by whoever publishes it.
///
/// # Errors
/// [`FixedFramesError`], with the file and what was expected.
pub fn read(path: &Path) -> Result<FixedFrames, FixedFramesError> {
    let text = tprmp_files::read_text(path, BYTES_MAX)
        .map_err(|source| FixedFramesError::Read { path: path.into(), source })?;
    parsed(&text, path)
}

fn parsed(text: &str, path: &Path) -> Result<FixedFrames, FixedFramesError> {
    let fixed: FixedFrames = ron::from_str(text).map_err(|error| FixedFramesError::Syntax {
        path: path.into(),
        line: error.span.start.line,
        column: error.span.start.col,
        problem: tprmp_files::shortened(&error.code.to_string()),
    })?;
    if !(0.001..=1.0).contains(&fixed.period_s) {
        return Err(FixedFramesError::Value {
            path: path.into(),
            key: "period_s".into(),
            problem: format!("expected 0.001 to 1 s, found {}", fixed.period_s),
        });
    }
    Ok(fixed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/frames/table.ron")
    }

    /// What is said of the shipped file with one text replaced.
    fn said(from: &str, to: &str) -> String {
        let text = std::fs::read_to_string(shipped()).unwrap();
        assert!(text.contains(from), "the edit must hit");
        parsed(&text.replacen(from, to, 1), Path::new("my.ron")).unwrap_err().to_string()
    }

    #[test]
    fn a_file_is_refused_by_its_line_key_and_expectation() {
        let shipped = read(&shipped()).unwrap();
        assert_eq!((shipped.frames.len(), shipped.obstacles.len()), (1, 1));
        for (text, part) in [
            (
                said("period_s: 0.02", "period_s: 0.0"),
                "key `period_s`: expected 0.001 to 1 s, found 0",
            ),
            (said("period_s: 0.02", "period_s: NaN"), "found NaN"),
            (said("period_s: 0.02,", ""), "period_s"),
            (said("source:", "sauce:"), "sauce"),
            (said("HalfSpace", "HalfSpade"), "HalfSpade"),
            (said("(0.5, 0.0, 0.0)", "(0.5, 0.0)"), "line 7"),
        ] {
            assert!(text.contains("my.ron") && text.contains(part), "{text}");
        }
        let missing = read(Path::new("no-such-file.ron")).unwrap_err().to_string();
        assert!(missing.contains("no-such-file.ron") && missing.contains("cannot be read"));
    }
}
