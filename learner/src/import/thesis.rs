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

use super::{Recording, Selection};
use crate::file_error::{FileError, read_text};

/// How far a rotation may be from one.
const ROTATION_TOLERANCE: f64 = 1e-6;

#[derive(Deserialize)]
struct Foreign {
    name: String,
    dt: f64,
    manifold: String,
    quaternion_order: Option<String>,
    demonstrations: Vec<ForeignDemonstration>,
}

#[derive(Deserialize)]
struct ForeignDemonstration {
    tag: Option<String>,
    frames: BTreeMap<String, ForeignFrame>,
    reference_frames: Option<BTreeMap<String, ForeignFrame>>,
    positions: Vec<Vec<f64>>,
}

/// Planar frames have A and b, spatial ones a position and a quaternion (and A, b on another space).
#[derive(Deserialize)]
struct ForeignFrame {
    #[serde(rename = "A")]
    a: Option<Vec<Vec<f64>>>,
    b: Option<Vec<f64>>,
    position: Option<[f64; 3]>,
    quaternion: Option<[f64; 4]>,
}

/// The skill's name and the demonstrations of a file.
pub(super) fn read(
    path: &Path,
    selection: &Selection,
) -> Result<(String, Vec<Recording>), FileError> {
    let text = read_text(path)?;
    let file: Foreign = serde_json::from_str(&text)
        .map_err(|e| FileError::syntax(path, e.line(), e.column(), e.to_string()))?;
    let fail = |key: &str, problem: String| Err(FileError::key(path, key, problem));
    let (manifold, frames) = match file.manifold.as_str() {
        "R2" => (Manifold::R2, ["start", "end"]),
        "R3xS3" => (Manifold::R3S3, ["ee_frame", "obj_frame"]),
        other => return fail("manifold", format!("expected R2 or R3xS3, found `{other}`")),
    };
    if manifold.has_orientation() && file.quaternion_order.as_deref() != Some("wxyz") {
        let found = file.quaternion_order.unwrap_or_else(|| "none".into());
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
    let skill = selection.skill.clone().unwrap_or(file.name);
    let mut demonstrations = Vec::new();
    for (i, foreign) in file.demonstrations.iter().enumerate() {
        if selection.tag.is_some() && selection.tag != foreign.tag {
            continue;
        }
        let key = format!("demonstrations[{i}]");
        let (frames_key, foreign_frames) = match &foreign.reference_frames {
            Some(reference) if selection.reference_frames && !reference.is_empty() => {
                ("reference_frames", reference)
            }
            _ => ("frames", &foreign.frames),
        };
        let frame = |name: &str| {
            let frame = foreign_frames.get(name).and_then(|frame| pose(frame, manifold));
            frame.ok_or_else(|| {
                let problem = match manifold {
                    Manifold::R2 => "expected `A`, a rotation of the plane, and `b`, a point",
                    _ => "expected `position` and a unit `quaternion`",
                };
                FileError::key(path, format!("{key}.{frames_key}.{name}"), problem)
            })
        };
        let (start, goal_frame) = (frame(frames[0])?, frame(frames[1])?);
        let mut poses = Vec::with_capacity(foreign.positions.len());
        for (j, row) in foreign.positions.iter().enumerate() {
            let Some(pose) = sample(row, manifold) else {
                let columns = crate::demonstration::columns(manifold);
                let problem = format!("expected {columns:?}, found {row:?}");
                return fail(&format!("{key}.positions[{j}]"), problem);
            };
            poses.push(pose);
        }
        demonstrations.push(Recording {
            place: format!("key `{key}`"),
            manifold,
            start,
            goal_frame,
            other_frames: BTreeMap::new(),
            times_s: (0..poses.len()).map(|i| i as f64 * file.dt).collect(),
            poses,
            velocities: None,
        });
    }
    if demonstrations.is_empty() {
        return fail("demonstrations", "expected at least one, found none".into());
    }
    Ok((skill, demonstrations))
}

fn pose(frame: &ForeignFrame, manifold: Manifold) -> Option<Pose> {
    if manifold != Manifold::R2 {
        let position = DVec3::from_array(frame.position?);
        return Some(Pose { position, orientation: quaternion(&frame.quaternion?)? });
    }
    let rows: Vec<DVec2> = frame
        .a
        .as_ref()?
        .iter()
        .map(|row| <[f64; 2]>::try_from(row.as_slice()).ok().map(DVec2::from_array))
        .collect::<Option<_>>()?;
    let [first, second] = <[DVec2; 2]>::try_from(rows).ok()?;
    let rotation = DMat2::from_cols(first, second).transpose();
    let angle = rotation.x_axis.y.atan2(rotation.x_axis.x);
    if !rotation.abs_diff_eq(DMat2::from_angle(angle), ROTATION_TOLERANCE) {
        return None;
    }
    let [x, y] = <[f64; 2]>::try_from(frame.b.as_deref()?).ok()?;
    Some(Pose { position: DVec3::new(x, y, 0.0), orientation: DQuat::from_rotation_z(angle) })
}

fn sample(row: &[f64], manifold: Manifold) -> Option<Pose> {
    if manifold == Manifold::R2 {
        let [x, y] = <[f64; 2]>::try_from(row).ok()?;
        return Some(Pose { position: DVec3::new(x, y, 0.0), orientation: DQuat::IDENTITY });
    }
    let [x, y, z, rotation @ ..] = <[f64; 7]>::try_from(row).ok()?;
    Some(Pose { position: DVec3::new(x, y, z), orientation: quaternion(&rotation)? })
}

fn quaternion(wxyz: &[f64; 4]) -> Option<DQuat> {
    let [w, x, y, z] = *wxyz;
    let q = DQuat::from_xyzw(x, y, z, w);
    ((q.length() - 1.0).abs() < 1e-3).then(|| q.normalize())
}
