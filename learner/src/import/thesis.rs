//! One JSON file with several demonstrations, as the reference data of the thesis are stored.
//!
//! ```text
//! {"name": "C", "dt": 0.01, "manifold": "R2", "demonstrations": [
//!   {"frames": {"start": {"A": [[…],[…]], "b": [x, y]}, "end": {…}}, "positions": [[x, y], …]}, …]}
//! {"name": …, "dt": …, "manifold": "R3xS3", "quaternion_order": "wxyz", "demonstrations": [
//!   {"tag": …, "frames": {"ee_frame": {"position": […], "quaternion": […]}, "obj_frame": {…}},
//!    "positions": [[x, y, z, w, x, y, z], …]}, …]}
//! ```
//!
//! A demonstration may have `reference_frames` beside its own `frames`: those with which the thesis
//! learned it. Its planar skills have the frames of the first demonstration in all.
//!
//! Other keys are disregarded: they repeat these, or are not used. So are recorded velocities: those
//! of the reference data are on another clock than `dt`, by a factor of six.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{DMat2, DQuat, DVec2, DVec3};
use serde::Deserialize;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::recording::Recording;
use super::rows::pose_of;
use super::selection::Selection;
use crate::demonstration::at_most::{Row, at_most};
use crate::demonstration::{BYTES_MAX, SAMPLES_MAX, columns};
use crate::file_error::{FileError, read_text};

/// Most demonstrations of a file.
const DEMONSTRATIONS_MAX: usize = 1000;
/// How far a rotation may be from one.
const ROTATION_TOLERANCE: f64 = 1e-6;

#[derive(Deserialize)]
struct Foreign {
    name: String,
    dt: f64,
    manifold: String,
    quaternion_order: Option<String>,
    #[serde(deserialize_with = "at_most::<DEMONSTRATIONS_MAX, _, _>")]
    demonstrations: Vec<ForeignDemonstration>,
}

#[derive(Deserialize)]
struct ForeignDemonstration {
    tag: Option<String>,
    frames: BTreeMap<String, ForeignFrame>,
    reference_frames: Option<BTreeMap<String, ForeignFrame>>,
    #[serde(deserialize_with = "at_most::<SAMPLES_MAX, _, _>")]
    positions: Vec<Row<f64>>,
}

/// Planar frames have A and b, spatial ones a position and a quaternion (and A, b on another space).
#[derive(Deserialize)]
struct ForeignFrame {
    #[serde(rename = "A")]
    a: Option<Vec<Row<f64>>>,
    b: Option<Vec<f64>>,
    position: Option<[f64; 3]>,
    quaternion: Option<[f64; 4]>,
}

/// The skill's name and the demonstrations of a file.
pub(super) fn read(
    path: &Path,
    selection: &Selection,
) -> Result<(String, Vec<Recording>), FileError> {
    let file: Foreign = serde_json::from_str(&read_text(path, BYTES_MAX)?)
        .map_err(|e| FileError::syntax(path, e.line(), e.column(), e.to_string()))?;
    recordings(&file, selection)
        .map(|recordings| (selection.skill.clone().unwrap_or(file.name), recordings))
        .map_err(|(key, problem)| FileError::input(path, format!("key `{key}`"), problem))
}

/// The key that is wrong, and what was expected.
type Wrong = (String, String);

fn recordings(file: &Foreign, selection: &Selection) -> Result<Vec<Recording>, Wrong> {
    let fail = |key: &str, problem: String| Err((key.to_owned(), problem));
    let manifold = match file.manifold.as_str() {
        "R2" => Manifold::R2,
        "R3xS3" => Manifold::R3S3,
        other => return fail("manifold", format!("expected R2 or R3xS3, found `{other}`")),
    };
    if manifold.has_orientation() && file.quaternion_order.as_deref() != Some("wxyz") {
        let found = file.quaternion_order.as_deref().unwrap_or("none");
        return fail("quaternion_order", format!("expected `wxyz`, found `{found}`"));
    }
    if !(file.dt.is_finite() && file.dt > 0.0) {
        return fail("dt", format!("expected a positive time [s], found {}", file.dt));
    }
    let tags: BTreeSet<&str> =
        file.demonstrations.iter().filter_map(|d| d.tag.as_deref()).collect();
    let known = tags.iter().map(|tag| format!("`{tag}`")).collect::<Vec<_>>().join(", ");
    match &selection.tag {
        None if tags.len() > 1 => {
            let problem = format!("several kinds of demonstrations ({known}): choose one by --tag");
            return fail("demonstrations[].tag", problem);
        }
        Some(tag) if !tags.contains(tag.as_str()) => {
            let problem = format!("expected one of [{known}], found --tag `{tag}`");
            return fail("demonstrations[].tag", problem);
        }
        _ => {}
    }
    let chosen = (file.demonstrations.iter().enumerate())
        .filter(|(_, foreign)| selection.tag.is_none() || selection.tag == foreign.tag);
    let recordings: Vec<_> = chosen
        .map(|(i, foreign)| {
            let key = format!("demonstrations[{i}]");
            recording(foreign, &key, manifold, file.dt, selection.reference_frames)
        })
        .collect::<Result<_, _>>()?;
    if recordings.is_empty() {
        return fail("demonstrations", "expected at least one, found none".into());
    }
    Ok(recordings)
}

/// The demonstration at a key.
fn recording(
    foreign: &ForeignDemonstration,
    key: &str,
    manifold: Manifold,
    dt: f64,
    with_reference_frames: bool,
) -> Result<Recording, Wrong> {
    let (frames_key, frames) = match &foreign.reference_frames {
        Some(reference) if with_reference_frames && !reference.is_empty() => {
            ("reference_frames", reference)
        }
        _ => ("frames", &foreign.frames),
    };
    let (start, goal, expected) = match manifold {
        Manifold::R2 => ("start", "end", "expected `A`, a rotation of the plane, and `b`, a point"),
        _ => ("ee_frame", "obj_frame", "expected `position` and a unit `quaternion`"),
    };
    let frame = |name: &str| {
        let frame = frames.get(name).and_then(|frame| match manifold {
            Manifold::R2 => planar_pose(frame),
            _ => spatial_pose(frame),
        });
        frame.ok_or_else(|| (format!("{key}.{frames_key}.{name}"), expected.to_owned()))
    };
    let columns = columns(manifold);
    let sample = |(j, Row(row)): (usize, &Row<f64>)| {
        let pose = if row.len() == columns.len() { pose_of(row, 1.0).ok() } else { None };
        pose.ok_or_else(|| {
            (format!("{key}.positions[{j}]"), format!("expected {columns:?}, found {row:?}"))
        })
    };
    Ok(Recording {
        place: format!("key `{key}`"),
        manifold,
        start: frame(start)?,
        goal_frame: frame(goal)?,
        other_frames: BTreeMap::new(),
        times_s: (0..foreign.positions.len()).map(|i| i as f64 * dt).collect(),
        poses: foreign.positions.iter().enumerate().map(sample).collect::<Result<_, _>>()?,
        velocities: None,
        gripper: None,
        notes: Vec::new(),
        ignored: None,
        has_own_unit: true,
    })
}

fn spatial_pose(frame: &ForeignFrame) -> Option<Pose> {
    pose_of(&[&frame.position?[..], &frame.quaternion?].concat(), 1.0).ok()
}

fn planar_pose(frame: &ForeignFrame) -> Option<Pose> {
    let rows: &[Row<f64>; 2] = frame.a.as_deref()?.try_into().ok()?;
    let [first, second] = rows
        .each_ref()
        .map(|Row(row)| <[f64; 2]>::try_from(row.as_slice()).ok().map(DVec2::from_array));
    let rotation = DMat2::from_cols(first?, second?).transpose();
    let angle = rotation.x_axis.y.atan2(rotation.x_axis.x);
    if !rotation.abs_diff_eq(DMat2::from_angle(angle), ROTATION_TOLERANCE) {
        return None;
    }
    let [x, y] = <[f64; 2]>::try_from(frame.b.as_deref()?).ok()?;
    Some(Pose { position: DVec3::new(x, y, 0.0), orientation: DQuat::from_rotation_z(angle) })
}
