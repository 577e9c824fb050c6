//! Shapes of the LASA handwriting data set: a variable `demos`, cells of structures with `pos`
//! (2×N [mm]), `t` (1×N [s]), `vel` (2×N [mm/s]) and `dt` [s].
//!
//! The frames stand at the first and the last point of each demonstration, and are not rotated.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DQuat, DVec3};
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::mat::{Value, parse};
use super::recording::Recording;
use super::rows::read_bytes;
use super::selection::Selection;
use crate::file_error::FileError;

const M_PER_MM: f64 = 1e-3;
/// How far times and `dt` may differ, as a fraction of the duration.
const TIME_TOLERANCE: f64 = 0.01;

/// The skill's name (the file's, when none is chosen) and the demonstrations of a shape.
pub(super) fn read(
    path: &Path,
    selection: &Selection,
) -> Result<(String, Vec<Recording>), FileError> {
    let values =
        parse(&read_bytes(path)?).map_err(|problem| FileError::input(path, "format", problem))?;
    let fail = |place: &str, problem: String| {
        FileError::input(path, format!("variable `{place}`"), problem)
    };
    let Some((_, demos)) = values.iter().find(|(name, _)| name == "demos") else {
        let names: Vec<_> = values.iter().map(|(name, _)| name.as_str()).collect();
        let problem = format!("expected this variable, found only [{}]", names.join(", "));
        return Err(fail("demos", problem));
    };
    let list = match demos {
        Value::List(list) if !list.is_empty() => list.as_slice(),
        Value::Structure(_) => std::slice::from_ref(demos),
        other => {
            let problem = format!("expected cells of demonstrations, found {}", other.describe());
            return Err(fail("demos", problem));
        }
    };
    let recording = |(i, demonstration): (usize, &Value)| {
        // As MATLAB counts.
        let place = format!("demos{{{}}}", i + 1);
        recording(demonstration, &place).map_err(|(field, problem)| fail(&field, problem))
    };
    let recordings = list.iter().enumerate().map(recording).collect::<Result<_, _>>()?;
    let stem = || path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok((selection.skill.clone().unwrap_or_else(stem), recordings))
}

/// One demonstration, or the field that is wrong and what was expected.
fn recording(demonstration: &Value, place: &str) -> Result<Recording, (String, String)> {
    let numbers = |name: &str, expected_rows: usize| {
        let field = format!("{place}.{name}");
        match demonstration.field(name) {
            Some(Value::Numbers { rows, values, .. }) if *rows == expected_rows => Ok(values),
            other => {
                let found = other.map_or_else(|| demonstration.describe(), Value::describe);
                Err((field, format!("expected {expected_rows}×N numbers, found {found}")))
            }
        }
    };
    let points = |values: &[f64]| -> Vec<DVec3> {
        let point = |p: &[f64; 2]| DVec3::new(p[0], p[1], 0.0) * M_PER_MM;
        values.as_chunks().0.iter().map(point).collect()
    };
    let positions = points(numbers("pos", 2)?);
    let same_length = |name: &str, found: usize| {
        let expected = positions.len();
        let problem = format!("expected {expected} samples as in `pos`, found {found}");
        if found == expected { Ok(()) } else { Err((format!("{place}.{name}"), problem)) }
    };
    let dt = match demonstration.field("dt") {
        None => None,
        Some(_) => numbers("dt", 1)?.first().copied(),
    };
    let evenly = |dt: f64| (0..positions.len()).map(|i| i as f64 * dt).collect::<Vec<f64>>();
    let times_s = match (demonstration.field("t"), dt) {
        (None, Some(dt)) => evenly(dt),
        _ => numbers("t", 1)?.clone(),
    };
    same_length("t", times_s.len())?;
    if let (Some(dt), Some(first), Some(last)) = (dt, times_s.first(), times_s.last()) {
        let by_dt = dt * (times_s.len() - 1) as f64;
        if (by_dt - (last - first)).abs() > TIME_TOLERANCE * (last - first).abs() {
            let problem =
                format!("expected {by_dt:.6} s in all by `dt`, found {:.6} s", last - first);
            return Err((format!("{place}.t"), problem));
        }
    }
    let velocities = match demonstration.field("vel") {
        None => None,
        Some(_) => Some(points(numbers("vel", 2)?)),
    };
    if let Some(velocities) = &velocities {
        same_length("vel", velocities.len())?;
    }
    let unrotated = |position: DVec3| Pose { position, orientation: DQuat::IDENTITY };
    Ok(Recording {
        place: format!("variable `{place}`"),
        manifold: Manifold::R2,
        start: unrotated(positions.first().copied().unwrap_or_default()),
        other_frames: BTreeMap::new(),
        goal_frame: unrotated(positions.last().copied().unwrap_or_default()),
        times_s,
        poses: positions.into_iter().map(unrotated).collect(),
        velocities,
        gripper: None,
        notes: Vec::new(),
        ignored: None,
        has_own_unit: true,
    })
}
