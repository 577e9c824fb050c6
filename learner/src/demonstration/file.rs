//! Demonstrations: reads and writes `tprmp-demonstration/1` files.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use serde::Deserialize;
use tprmp_model::skill_model::{Manifold, Remarks, sha256_hex};
use tprmp_spatial::Pose;

use crate::demonstration::at_most::{Row, at_most, some_at_most};
use crate::demonstration::bounds::diagonal;
use crate::demonstration::gripper::Gripper;
use crate::demonstration::part;
use crate::demonstration::recorded::Demonstration;
use crate::file_error::{FileError, read_text};

/// Schema version this module reads and writes.
pub const SCHEMA: &str = "tprmp-demonstration/1";
/// Fewest points of a demonstration.
pub const POINTS_MIN: usize = 10;
/// Most points of a demonstration: 600 s at 160 Hz, and a motion has no more to tell.
pub const SAMPLES_MAX: usize = 100_000;
/// Shortest time between samples \[s\]: no robot is recorded at more than 100 kHz.
pub const SAMPLING_TIME_MIN_S: f64 = 1e-5;
/// Largest file \[bytes\]: that of the most points with all digits.
pub const BYTES_MAX: u64 = 16 << 20;
/// Most files of a folder.
const FILES_MAX: usize = 1000;
/// Positions farther away are refused \[m\]: no unit of length is so far off, and nothing overflows.
pub const POSITION_MAX_M: f64 = 1e6;
/// Longest demonstration \[s\]: a longer one has a wrong sampling time.
pub const DURATION_MAX_S: f64 = 600.0;
/// A tool that moves by less has not moved [m, or rad]: rounding.
const STILL: f64 = 1e-9;
/// How far the length of a quaternion may be from one before it is refused; within, it is
/// normalised. Files are written with six decimals.
const QUATERNION_TOLERANCE: f64 = 1e-3;
/// Characters of a remark.
const REMARK_MAX: usize = 2000;

/// Largest diagonal of the box around a demonstration's samples \[m\].
pub(crate) fn largest_span_m(demonstrations: &[Demonstration]) -> f64 {
    let spans = demonstrations.iter().map(|d| diagonal(d.poses.iter().map(|p| p.position)));
    spans.fold(0.0, f64::max)
}

#[derive(Deserialize)]
struct Header {
    schema: Option<String>,
}

/// Numbers are optional so that a missing or not finite one is named by its key.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(rename = "schema")]
    _schema: String,
    skill: String,
    manifold: String,
    sampling_time_s: Option<f64>,
    operator: Option<String>,
    notes: Option<String>,
    frames: BTreeMap<String, FileFrame>,
    columns: Vec<String>,
    #[serde(default, deserialize_with = "some_at_most::<SAMPLES_MAX, _, _>")]
    gripper: Option<Vec<Option<String>>>,
    #[serde(default, deserialize_with = "some_at_most::<SAMPLES_MAX, _, _>")]
    gripper_width_m: Option<Vec<Option<f64>>>,
    #[serde(deserialize_with = "at_most::<SAMPLES_MAX, _, _>")]
    samples: Vec<Row<Option<f64>>>,
}

/// A frame of a file; [`frame`] makes a pose of it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileFrame {
    position_m: Vec<Option<f64>>,
    quaternion_wxyz: Vec<Option<f64>>,
}

/// The columns of a manifold's samples.
#[must_use]
pub fn columns(manifold: Manifold) -> &'static [&'static str] {
    match manifold {
        Manifold::R2 => &["x_m", "y_m"],
        Manifold::R3 => &["x_m", "y_m", "z_m"],
        Manifold::R3S1 | Manifold::S3 | Manifold::R3S3 => {
            &["x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"]
        }
    }
}

/// Reads all demonstrations of a folder (`*.json`), in order of their names; hidden files are skipped. Of those of poses
/// a skill on R3, R3xS1 or S3 has its part.
///
/// # Errors
/// [`FileError`], naming file and key: the folder is missing or empty, a file is refused by
/// [`read`], shows another skill or manifold than asked for, or has not just these frames.
pub fn read_folder(
    folder: &Path,
    skill: &str,
    manifold: Manifold,
    start_frame: &str,
    goal_frame: &str,
    other_frames: &[String],
) -> Result<Vec<Demonstration>, FileError> {
    let demonstrations =
        read_folder_with_all_frames(folder, skill, manifold, start_frame, goal_frame)?;
    for demonstration in &demonstrations {
        let file = folder.join(&demonstration.name);
        let found = &demonstration.other_frames;
        if let Some(name) = other_frames.iter().find(|name| !found.contains_key(*name)) {
            let problem = "expected this frame, which the skill file names in `other_frames`";
            return Err(FileError::key(&file, format!("frames.{name}"), problem));
        }
        if let Some(name) = found.keys().find(|name| !other_frames.contains(name)) {
            let mut expected = vec![start_frame, goal_frame];
            expected.dedup();
            expected.extend(other_frames.iter().map(String::as_str));
            let problem = format!(
                "unknown frame; expected `{}`; a skill file may name further ones in `other_frames`, or say \
                 `Auto` there, but for a periodic skill, which has one",
                expected.join("`, `")
            );
            return Err(FileError::key(&file, format!("frames.{name}"), problem));
        }
    }
    Ok(demonstrations)
}

/// As [`read_folder`], with whatever further frames each file holds.
///
/// # Errors
/// As [`read_folder`], but for the frames.
pub fn read_folder_with_all_frames(
    folder: &Path,
    skill: &str,
    manifold: Manifold,
    start_frame: &str,
    goal_frame: &str,
) -> Result<Vec<Demonstration>, FileError> {
    let Listed { files, .. } = listed(folder)?;
    if files.len() > FILES_MAX {
        let problem = format!("expected at most {FILES_MAX} `*.json` files, found {}", files.len());
        return Err(FileError::input(folder, "folder of demonstrations", problem));
    }
    if files.is_empty() {
        return Err(FileError::Input {
            path: folder.into(),
            place: "folder of demonstrations".into(),
            problem: "expected at least one `*.json` file, found none; record or import some first"
                .into(),
        });
    }
    let mut demonstrations = Vec::with_capacity(files.len());
    for file in files {
        let demonstration = read(&file, start_frame, goal_frame)?;
        if demonstration.skill != skill {
            let problem = format!("expected `{skill}`, found `{}`", demonstration.skill);
            return Err(FileError::key(&file, "skill", problem));
        }
        if !part::is_learned_from(manifold, demonstration.manifold) {
            let expected = if manifold.is_part_of_pose() {
                format!("`{}`, of which a skill on {manifold} has its part", Manifold::R3S3)
            } else {
                format!("`{manifold}`")
            };
            let problem = format!("expected {expected}, found `{}`", demonstration.manifold);
            return Err(FileError::key(&file, "manifold", problem));
        }
        demonstrations.push(demonstration);
    }
    part::leave_part(&mut demonstrations, manifold, folder, [start_frame, goal_frame])?;
    Ok(demonstrations)
}

/// What lies in a folder of demonstrations.
struct Listed {
    /// In order of their names.
    files: Vec<PathBuf>,
    /// Made by file managers, and by programs that write at this moment.
    hidden: usize,
    /// Anything but `*.json`.
    foreign: usize,
}

fn listed(folder: &Path) -> Result<Listed, FileError> {
    let unreadable = |source| FileError::Read { path: folder.into(), source };
    let mut listed = Listed { files: Vec::new(), hidden: 0, foreign: 0 };
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(b".")) {
            listed.hidden += 1;
        } else if path.extension().is_some_and(|extension| extension == "json") {
            listed.files.push(path);
        } else {
            listed.foreign += 1;
        }
    }
    listed.files.sort();
    Ok(listed)
}

/// What in a folder of demonstrations is not read: a sentence, where there is something.
///
/// # Errors
/// [`FileError`]: the folder cannot be read.
pub fn skipped(folder: &Path) -> Result<Option<String>, FileError> {
    let Listed { hidden, foreign, .. } = listed(folder)?;
    Ok((hidden + foreign > 0).then(|| {
        format!(
            "{}: skipped {hidden} hidden and {foreign} foreign files or folders, which are no `*.json`",
            folder.display()
        )
    }))
}

/// Reads and validates a demonstration with the two frames that are asked for.
///
/// # Errors
/// [`FileError`], naming file and key: missing, truncated, of another schema, numbers that are
/// not finite or too large, rows of unequal length, too few points, quaternions that are not unit,
/// frames that are missing, a sampling time that is not positive or too long, a gripper that is not
/// known at each sample.
pub fn read(path: &Path, start_frame: &str, goal_frame: &str) -> Result<Demonstration, FileError> {
    let text = read_text(path, BYTES_MAX)?;
    let file = parse(&text, path)?;
    let fail = |key: &str, problem: String| Err(FileError::key(path, key, problem));
    FileError::name(path, "skill", &file.skill)?;
    for name in file.frames.keys() {
        FileError::name(path, "frames", name)?;
    }
    let manifold = match file.manifold.as_str() {
        "R2" => Manifold::R2,
        "R3" => Manifold::R3,
        "R3xS3" => Manifold::R3S3,
        other => return fail("manifold", format!("expected R2, R3 or R3xS3, found `{other}`")),
    };
    let is_time = |t: &f64| t.is_finite() && *t >= SAMPLING_TIME_MIN_S;
    let Some(sampling_time_s) = file.sampling_time_s.filter(is_time) else {
        let found = file.sampling_time_s.map_or("no finite number".into(), |t| format!("{t:e}"));
        let expected = format!("a positive time of at least {SAMPLING_TIME_MIN_S:e} s");
        return fail("sampling_time_s", format!("expected {expected}, found {found}"));
    };
    if file.columns != columns(manifold) {
        let expected = columns(manifold);
        return fail("columns", format!("expected {expected:?}, found {:?}", file.columns));
    }
    let start = frame(&file.frames, start_frame, manifold, path)?;
    let other_frames = other_frames(&file.frames, [start_frame, goal_frame], manifold, path)?;
    let goal_frame = frame(&file.frames, goal_frame, manifold, path)?;
    if file.samples.len() < POINTS_MIN {
        let found = file.samples.len();
        return fail("samples", format!("expected at least {POINTS_MIN} points, found {found}"));
    }
    let duration_s = (file.samples.len() - 1) as f64 * sampling_time_s;
    if duration_s > DURATION_MAX_S {
        let problem = format!(
            "expected a time with which {} points last at most {DURATION_MAX_S} s, found \
             {sampling_time_s}",
            file.samples.len()
        );
        return fail("sampling_time_s", problem);
    }
    let poses = file.samples.iter().enumerate();
    let poses = poses.map(|(i, row)| sample(i, &row.0, file.columns.len(), path));
    let poses = poses.collect::<Result<Vec<_>, _>>()?;
    let moves = |p: &Pose| {
        (p.position - poses[0].position).length() > STILL
            || p.rotation_from(&poses[0]).length() > STILL
    };
    if !poses.iter().any(moves) {
        return fail("samples", "expected a motion, found a point that never moves".into());
    }
    let gripper = Gripper::of_file(file.gripper, file.gripper_width_m, poses.len(), path)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let sha256 = sha256_hex(text.as_bytes());
    let remarks = remarks(file.operator, file.notes, path)?;
    let skill = file.skill;
    Ok(Demonstration {
        name,
        sha256,
        skill,
        manifold,
        sampling_time_s,
        start,
        goal_frame,
        other_frames,
        remarks,
        poses,
        gripper,
    })
}

/// What somebody wrote into a file.
fn remarks(
    operator: Option<String>,
    notes: Option<String>,
    path: &Path,
) -> Result<Remarks, FileError> {
    for (key, remark) in [("operator", &operator), ("notes", &notes)] {
        let length = remark.as_ref().map_or(0, |text| text.chars().count());
        if length > REMARK_MAX {
            let problem = format!("expected at most {REMARK_MAX} characters, found {length}");
            return Err(FileError::key(path, key, problem));
        }
    }
    Ok(Remarks { operator, notes })
}

/// The pose of sample `i`.
fn sample(i: usize, row: &[Option<f64>], columns: usize, path: &Path) -> Result<Pose, FileError> {
    let key = format!("samples[{i}]");
    let row = numbers(row, columns, &key, path)?;
    let z = row.get(2).copied().unwrap_or(0.0);
    let position = position(&[row[0], row[1], z], &key, path)?;
    let orientation = match row.get(3..7) {
        Some(q) => quaternion(q, &key, path)?,
        None => DQuat::IDENTITY,
    };
    Ok(Pose { position, orientation })
}

/// Parses the JSON; its schema first, so that a file of another version is refused as such.
fn parse(text: &str, path: &Path) -> Result<File, FileError> {
    let finite_text;
    let mut text = text;
    let mut header = serde_json::from_str::<Header>(text);
    if header.is_err() && (text.contains("NaN") || text.contains("Infinity")) {
        // JSON has no such numbers, but some writers write them: as `null` they get a key below.
        finite_text =
            text.replace("-Infinity", "null").replace("Infinity", "null").replace("NaN", "null");
        text = &finite_text;
        header = serde_json::from_str(text);
    }
    let syntax = |e: serde_json::Error| {
        let hint = if e.is_eof() { " (the file is truncated)" } else { "" };
        FileError::syntax(path, e.line(), e.column(), format!("{e}{hint}"))
    };
    match header.map_err(syntax)?.schema {
        Some(schema) if schema == SCHEMA => serde_json::from_str(text).map_err(syntax),
        found => {
            let found = found.unwrap_or_else(|| "none".into());
            let problem = format!("expected `{SCHEMA}`, found `{found}`");
            Err(FileError::key(path, "schema", problem))
        }
    }
}

/// A row of finite numbers.
fn numbers(
    row: &[Option<f64>],
    length: usize,
    key: &str,
    path: &Path,
) -> Result<Vec<f64>, FileError> {
    if row.len() != length {
        let problem = format!("expected {length} numbers, found {}", row.len());
        return Err(FileError::key(path, key, problem));
    }
    let finite = |(i, x): (usize, &Option<f64>)| {
        x.filter(|x| x.is_finite()).ok_or_else(|| {
            let problem = "expected a finite number, found none (null, NaN or infinity)";
            FileError::key(path, format!("{key}[{i}]"), problem)
        })
    };
    row.iter().enumerate().map(finite).collect()
}

/// A position of three finite numbers.
fn position(xyz: &[f64], key: &str, path: &Path) -> Result<DVec3, FileError> {
    let position = DVec3::from_slice(xyz);
    if position.abs().max_element() > POSITION_MAX_M {
        let problem = format!("expected positions within {POSITION_MAX_M} m, found {position}");
        return Err(FileError::key(path, key, problem));
    }
    Ok(position)
}

fn quaternion(wxyz: &[f64], key: &str, path: &Path) -> Result<DQuat, FileError> {
    let q = DQuat::from_xyzw(wxyz[1], wxyz[2], wxyz[3], wxyz[0]);
    if (q.length() - 1.0).abs() > QUATERNION_TOLERANCE {
        let problem =
            format!("expected a unit quaternion w, x, y, z, found one of length {:.6}", q.length());
        return Err(FileError::key(path, key, problem));
    }
    Ok(q.normalize())
}

/// The named frame as a valid pose.
pub fn frame(
    frames: &BTreeMap<String, FileFrame>,
    name: &str,
    manifold: Manifold,
    path: &Path,
) -> Result<Pose, FileError> {
    let key = format!("frames.{name}");
    let Some(frame) = frames.get(name) else {
        let found: Vec<_> = frames.keys().map(String::as_str).collect();
        let problem = format!("expected this frame, found only [{}]", found.join(", "));
        return Err(FileError::key(path, key, problem));
    };
    let position_key = format!("{key}.position_m");
    let position =
        position(&numbers(&frame.position_m, 3, &position_key, path)?, &position_key, path)?;
    let quaternion_key = format!("{key}.quaternion_wxyz");
    let wxyz = numbers(&frame.quaternion_wxyz, 4, &quaternion_key, path)?;
    let orientation = quaternion(&wxyz, &quaternion_key, path)?;
    if manifold == Manifold::R2 {
        if position.z != 0.0 {
            let problem = format!("expected z = 0 for a planar skill, found {}", position.z);
            return Err(FileError::key(path, format!("{position_key}[2]"), problem));
        }
        if orientation.x.hypot(orientation.y) > QUATERNION_TOLERANCE {
            let problem = "expected a rotation about z for a planar skill";
            return Err(FileError::key(path, quaternion_key, problem));
        }
    }
    Ok(Pose { position, orientation })
}

/// All frames but the start's and the goal's, as valid poses.
pub fn other_frames(
    frames: &BTreeMap<String, FileFrame>,
    known: [&str; 2],
    manifold: Manifold,
    path: &Path,
) -> Result<BTreeMap<String, Pose>, FileError> {
    let others = frames.keys().filter(|name| !known.contains(&name.as_str()));
    others.map(|name| Ok((name.clone(), frame(frames, name, manifold, path)?))).collect()
}

/// The text of a demonstration file: six decimals, one sample a line.
#[must_use]
pub fn to_text(demonstration: &Demonstration, start_frame: &str, goal_frame: &str) -> String {
    let frame = |pose: &Pose| {
        let (p, q) = (pose.position, pose.orientation);
        format!(
            "{{\"position_m\": [{:.6}, {:.6}, {:.6}], \"quaternion_wxyz\": [{:.6}, {:.6}, {:.6}, {:.6}]}}",
            p.x, p.y, p.z, q.w, q.x, q.y, q.z
        )
    };
    let columns = columns(demonstration.manifold);
    let quoted = |text: &str| serde_json::Value::from(text).to_string();
    let mut frames = vec![(start_frame, &demonstration.start)];
    if goal_frame != start_frame {
        frames.push((goal_frame, &demonstration.goal_frame));
    }
    frames.extend(demonstration.other_frames.iter().map(|(name, pose)| (name.as_str(), pose)));
    let frames: Vec<_> = frames
        .into_iter()
        .map(|(name, pose)| format!("{}: {}", quoted(name), frame(pose)))
        .collect();
    let Remarks { operator, notes } = &demonstration.remarks;
    let remarks: String = [("operator", operator), ("notes", notes)]
        .into_iter()
        .filter_map(|(key, text)| Some(format!("\"{key}\": {},\n", quoted(text.as_ref()?))))
        .collect();
    let gripper = demonstration.gripper.as_ref().map_or_else(String::new, Gripper::line);
    let mut text = format!(
        "{{\n\"schema\": \"{SCHEMA}\",\n\"skill\": {},\n\"manifold\": \"{}\",\n\
         \"sampling_time_s\": {},\n{remarks}\"frames\": {{\n{}\n}},\n\"columns\": [{}],\n{gripper}\"samples\": [\n",
        quoted(&demonstration.skill),
        demonstration.manifold,
        demonstration.sampling_time_s,
        frames.join(",\n"),
        columns.iter().map(|c| quoted(c)).collect::<Vec<_>>().join(", "),
    );
    for (i, pose) in demonstration.poses.iter().enumerate() {
        let (p, q) = (pose.position, pose.orientation);
        let row = [p.x, p.y, p.z, q.w, q.x, q.y, q.z];
        let row: Vec<_> = row[..columns.len()].iter().map(|x| format!("{x:.6}")).collect();
        let comma = if i + 1 == demonstration.poses.len() { "" } else { "," };
        writeln!(text, "[{}]{comma}", row.join(", ")).expect("a string grows");
    }
    text.push_str("]\n}\n");
    text
}
