//! What XRDF and SRDF files know of an arm beside its URDF.

use core::str::FromStr;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use nalgebra::SVector;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use serde::Deserialize;
use thiserror::Error;
use tprmp_spatial::Pose;

use crate::init::arm::Arm;
use crate::init::limits::Rates;

/// Largest file \[bytes\].
const BYTES_MAX: u64 = 4 << 20;
/// Names of postures to begin from, the likeliest first.
const HOMES: [&str; 6] = ["ready", "home", "default", "start", "up", "rest"];

/// Why such a file cannot be used.
#[derive(Debug, Error)]
#[error("`{file}`: {text}")]
pub struct SemanticError {
    /// The file.
    pub file: PathBuf,
    /// What was expected and found.
    pub text: String,
}

/// What the files say; empty without any.
#[derive(Debug, Clone, Default)]
pub(super) struct Semantic {
    /// The base's link.
    pub base: Option<String>,
    /// The tool's link.
    pub tool: Option<String>,
    /// The tool's frame in that link, where a file adds it: its name and its pose there.
    pub tool_frame: Option<(String, Pose)>,
    /// Spheres: link, centre in its frame \[m\], radius \[m\].
    pub spheres: Option<Vec<(String, DVec3, f64)>>,
    /// Pairs of links that need not keep clear of each other.
    pub ignored: Vec<(String, String)>,
    home: BTreeMap<String, f64>,
    home_name: String,
    moved: Vec<String>,
    acceleration: BTreeMap<String, f64>,
    jerk: BTreeMap<String, f64>,
}

impl Semantic {
    /// The posture that a file names, where it has all joints \[rad or m\].
    pub(super) fn home<const N: usize>(&self, joints: &[String; N]) -> Option<SVector<f64, N>> {
        let mut home = SVector::<f64, N>::zeros();
        for (at, joint) in home.iter_mut().zip(joints) {
            *at = *self.home.get(joint)?;
        }
        Some(home)
    }

    /// Where the posture comes from.
    pub(super) fn home_reason(&self) -> String {
        if self.home.is_empty() {
            "far from singular configurations and from the joints' limits, clear, the tool down where it can".into()
        } else {
            format!("the posture `{}` of the file", self.home_name)
        }
    }

    /// Holds the joints that a file places and does not move.
    pub(super) fn hold(&self, arm: &mut Arm) {
        for (joint, at) in &mut arm.held_joints {
            if let Some(given) = self.home.get(joint) {
                *at = *given;
            }
        }
        if self.moved.is_empty() {
            return;
        }
        let held: Vec<String> =
            arm.joints.iter().filter(|joint| !self.moved.contains(joint)).cloned().collect();
        arm.joints.retain(|joint| !held.contains(joint));
        for joint in held {
            let at = self.home.get(&joint).copied().unwrap_or(0.0);
            arm.held_joints.insert(joint, at);
        }
    }

    /// Puts the file's accelerations and jerks in the place of those that were found.
    pub(super) fn replace_rates<const N: usize>(&self, joints: &[String; N], rates: &mut Rates) {
        for (limits, found, reason) in [
            (&self.acceleration, &mut rates.acceleration, &mut rates.acceleration_reason),
            (&self.jerk, &mut rates.jerk, &mut rates.jerk_reason),
        ] {
            let all = joints.iter().map(|joint| limits.get(joint).copied());
            if let Some(all) = all.collect::<Option<Vec<_>>>() {
                *found = all;
                *reason = "of the XRDF".into();
            }
        }
    }
}

/// Reads the files that there are. What an XRDF says counts before an SRDF.
///
/// # Errors
/// [`SemanticError`].
pub(super) fn read(xrdf: Option<&Path>, srdf: Option<&Path>) -> Result<Semantic, SemanticError> {
    let mut semantic = Semantic::default();
    for (path, parse) in
        [(srdf, parse_srdf as fn(&str, &mut Semantic) -> Result<(), String>), (xrdf, parse_xrdf)]
    {
        let Some(path) = path else { continue };
        let failed = |text: String| SemanticError { file: path.to_owned(), text };
        let text =
            tprmp_files::read_text(path, BYTES_MAX).map_err(|error| failed(error.to_string()))?;
        parse(&text, &mut semantic).map_err(failed)?;
    }
    Ok(semantic)
}

#[derive(Debug, Deserialize)]
struct Xrdf {
    format: String,
    #[serde(default)]
    modifiers: Vec<Modifier>,
    #[serde(default)]
    default_joint_positions: BTreeMap<String, f64>,
    cspace: Cspace,
    #[serde(default)]
    tool_frames: Vec<String>,
    collision: Option<Collision>,
    self_collision: Option<Collision>,
    #[serde(default)]
    geometry: BTreeMap<String, Geometry>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Modifier {
    SetBaseFrame(String),
    AddFrame(AddedFrame),
}

#[derive(Debug, Deserialize)]
struct AddedFrame {
    frame_name: String,
    parent_frame_name: String,
    joint_type: Option<String>,
    fixed_transform: FixedTransform,
}

#[derive(Debug, Deserialize)]
struct FixedTransform {
    position: [f64; 3],
    orientation: Orientation,
}

#[derive(Debug, Deserialize)]
struct Orientation {
    w: f64,
    xyz: [f64; 3],
}

/// The frames that a file adds to the links of a URDF: parent, and pose in it.
#[derive(Debug, Default)]
struct AddedFrames(BTreeMap<String, (String, Pose)>);

impl AddedFrames {
    /// Adds one, below a link or one that was added before.
    fn add(&mut self, added: AddedFrame) -> Result<(), String> {
        let AddedFrame { frame_name, parent_frame_name, joint_type, fixed_transform } = added;
        let fault = |expected: &str, found: &str| {
            let (name, found) =
                (tprmp_files::printable(&frame_name), tprmp_files::printable(found));
            Err(format!("key `modifiers`, frame `{name}`: expected {expected}, found {found}"))
        };
        if let Some(found) = joint_type.filter(|found| !found.eq_ignore_ascii_case("fixed")) {
            return fault("a joint_type of FIXED", &format!("`{found}`"));
        }
        let FixedTransform { position, orientation: Orientation { w, xyz: [x, y, z] } } =
            fixed_transform;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let (position, length) = (DVec3::from(position), rotation.length());
        if !position.is_finite() || !(0.99..1.01).contains(&length) {
            let found = format!("{position} and a quaternion of length {length}");
            return fault("finite numbers and a quaternion of length 1", &found);
        }
        let own = Pose { position, orientation: rotation.normalize() };
        let (link, parent) = self.resolve(&parent_frame_name);
        let pose = parent.compose(&own);
        self.0.insert(frame_name, (link, pose));
        Ok(())
    }

    /// The link of the URDF that a frame is fixed to, and its pose there.
    fn resolve(&self, name: &str) -> (String, Pose) {
        self.0.get(name).cloned().unwrap_or_else(|| (name.to_owned(), Pose::IDENTITY))
    }
}

#[derive(Debug, Deserialize)]
struct Cspace {
    joint_names: Vec<String>,
    #[serde(default)]
    acceleration_limits: Vec<f64>,
    #[serde(default)]
    jerk_limits: Vec<f64>,
}

#[derive(Debug, Deserialize)]
struct Collision {
    geometry: String,
    #[serde(default)]
    buffer_distance: BTreeMap<String, f64>,
    #[serde(default)]
    ignore: BTreeMap<String, Vec<String>>,
}

#[derive(Debug, Deserialize)]
struct Geometry {
    #[serde(default)]
    spheres: BTreeMap<String, Vec<XrdfSphere>>,
}

#[derive(Debug, Deserialize)]
struct XrdfSphere {
    center: [f64; 3],
    radius: f64,
}

fn parse_xrdf(text: &str, semantic: &mut Semantic) -> Result<(), String> {
    let xrdf: Xrdf =
        serde_saphyr::from_str(text).map_err(|error| format!("expected an XRDF: {error}"))?;
    if xrdf.format != "xrdf" {
        return Err(format!(
            "key `format`: expected `xrdf`, found `{}`",
            tprmp_files::printable(&xrdf.format)
        ));
    }
    let mut frames = AddedFrames::default();
    for modifier in xrdf.modifiers {
        match modifier {
            Modifier::AddFrame(frame) => frames.add(frame)?,
            Modifier::SetBaseFrame(base) => semantic.base = Some(base),
        }
    }
    let names = &xrdf.cspace.joint_names;
    for (key, limits, kept) in [
        ("acceleration_limits", &xrdf.cspace.acceleration_limits, &mut semantic.acceleration),
        ("jerk_limits", &xrdf.cspace.jerk_limits, &mut semantic.jerk),
    ] {
        if !limits.is_empty() && limits.len() != names.len() {
            let (expected, found) = (names.len(), limits.len());
            return Err(format!("key `cspace.{key}`: expected {expected} numbers, found {found}"));
        }
        if let Some(limit) = limits.iter().find(|limit| !(limit.is_finite() && **limit > 0.0)) {
            return Err(format!("key `cspace.{key}`: expected numbers above 0, found {limit}"));
        }
        *kept = names.iter().cloned().zip(limits.iter().copied()).collect();
    }
    semantic.moved.clone_from(names);
    if let Some(tool) = xrdf.tool_frames.first() {
        let (link, pose) = frames.resolve(tool);
        semantic.tool_frame = (link != *tool).then(|| (tool.clone(), pose));
        semantic.tool = Some(link);
    }
    if !xrdf.default_joint_positions.is_empty() {
        semantic.home = xrdf.default_joint_positions;
        semantic.home_name = "default_joint_positions".into();
    }
    if let Some(collision) = &xrdf.collision {
        let geometry = xrdf.geometry.get(&collision.geometry).ok_or_else(|| {
            let known = xrdf.geometry.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            format!(
                "key `collision.geometry`: expected one of {known}, found `{}`",
                collision.geometry
            )
        })?;
        semantic.spheres = Some(spheres(geometry, &collision.buffer_distance, &frames)?);
    }
    for (link, others) in xrdf.self_collision.iter().flat_map(|own| &own.ignore) {
        semantic.ignored.extend(others.iter().map(|other| (link.clone(), other.clone())));
    }
    Ok(())
}

fn spheres(
    geometry: &Geometry,
    buffers: &BTreeMap<String, f64>,
    frames: &AddedFrames,
) -> Result<Vec<(String, DVec3, f64)>, String> {
    let mut found = Vec::new();
    for (link, spheres) in &geometry.spheres {
        let buffer = buffers.get(link).copied().unwrap_or(0.0);
        let (of_link, pose) = frames.resolve(link);
        for sphere in spheres {
            // A sphere that a buffer makes vanish is switched off.
            let radius = sphere.radius + buffer;
            if !(radius.is_finite() && sphere.center.iter().all(|number| number.is_finite())) {
                return Err(format!("spheres of `{link}`: expected finite numbers"));
            }
            if radius > 0.0 {
                let centre = pose.transform_point(sphere.center.into());
                found.push((of_link.clone(), centre, radius));
            }
        }
    }
    Ok(found)
}

fn parse_srdf(text: &str, semantic: &mut Semantic) -> Result<(), String> {
    let mut reader = Reader::from_str(text);
    let (mut states, mut tips) = (BTreeMap::<String, BTreeMap<String, f64>>::new(), Vec::new());
    let (mut state, mut is_srdf) = (None, false);
    loop {
        let event = reader.read_event().map_err(|error| {
            format!("expected an SRDF, at byte {}: {error}", reader.error_position())
        })?;
        let element = match &event {
            Event::Start(element) | Event::Empty(element) => element,
            Event::End(end) if end.name().as_ref() == b"group_state" => {
                state = None;
                continue;
            }
            Event::Eof => break,
            _ => continue,
        };
        match element.name().as_ref() {
            b"robot" => is_srdf = true,
            b"group_state" => state = Some(attribute::<String>(element, "name")?),
            b"joint" => {
                if let Some(name) = &state {
                    let joint = attribute::<String>(element, "name")?;
                    let at = attribute::<f64>(element, "value")?;
                    states.entry(name.clone()).or_default().insert(joint, at);
                }
            }
            b"chain" => tips.push(attribute::<String>(element, "tip_link")?),
            b"disable_collisions" => {
                semantic.ignored.push((attribute(element, "link1")?, attribute(element, "link2")?));
            }
            _ => {}
        }
    }
    if !is_srdf {
        return Err("expected an SRDF, with an element <robot>".into());
    }
    if let [tip] = &tips[..] {
        semantic.tool = Some(tip.clone());
    }
    let named =
        HOMES.iter().find_map(|home| states.keys().find(|name| name.to_lowercase() == *home));
    if let Some(name) = named.cloned() {
        semantic.home = states.remove(&name).unwrap_or_default();
        semantic.home_name = name;
    }
    Ok(())
}

fn attribute<T: FromStr>(element: &BytesStart<'_>, key: &str) -> Result<T, String> {
    let name = String::from_utf8_lossy(element.name().as_ref()).into_owned();
    let found = element.try_get_attribute(key).ok().flatten();
    let value = found
        .and_then(|attribute| attribute.unescape_value().ok().map(std::borrow::Cow::into_owned));
    let value = value.ok_or_else(|| format!("<{name}>: expected an attribute `{key}`"))?;
    // Some list one number of several, of a joint with one.
    value.trim().parse().map_err(|_| {
        format!(
            "<{name}>, attribute `{key}`: expected a number, found `{}`",
            tprmp_files::printable(&value)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_xrdf_gives_spheres_limits_and_what_is_held() {
        let text = "
format: xrdf
format_version: 1.0
default_joint_positions: {a: 0.1, b: -0.2, finger: 0.03}
cspace:
  joint_names: [a, b]
  acceleration_limits: [10.0, 20.0]
  jerk_limits: [100.0, 200.0]
tool_frames: [tip]
collision: {geometry: g, buffer_distance: {l1: 0.01}}
self_collision: {geometry: g, ignore: {l1: [l2, l3]}}
geometry:
  g:
    spheres:
      l1: [{center: [0.0, 0.1, 0.2], radius: 0.05}]
      l2: [{center: [0, 0, 0], radius: -1.0}]
";
        let mut semantic = Semantic::default();
        parse_xrdf(text, &mut semantic).unwrap();
        assert_eq!(semantic.tool.as_deref(), Some("tip"));
        let (link, centre, radius) = &semantic.spheres.as_ref().unwrap()[0];
        assert_eq!((link.as_str(), *centre), ("l1", DVec3::new(0.0, 0.1, 0.2)));
        assert!((radius - 0.06).abs() < 1e-12);
        assert_eq!(semantic.spheres.as_ref().unwrap().len(), 1);
        assert_eq!(semantic.ignored.len(), 2);
        let joints = ["a".to_owned(), "b".to_owned()];
        assert_eq!(semantic.home(&joints), Some(SVector::from([0.1, -0.2])));
        let mut arm = Arm {
            base_link: None,
            tool_link: "tip".into(),
            joints: vec!["a".into(), "b".into(), "finger".into()],
            held_joints: BTreeMap::new(),
        };
        semantic.hold(&mut arm);
        assert_eq!((arm.joints.len(), arm.held_joints["finger"]), (2, 0.03));
    }

    #[test]
    fn frames_that_an_xrdf_adds_are_those_of_the_links_they_are_fixed_to() {
        let text = "
format: xrdf
modifiers:
  - set_base_frame: base_link
  - add_frame:
      frame_name: flange
      parent_frame_name: wrist
      joint_name: wrist_flange
      joint_type: FIXED
      fixed_transform: {position: [0.0, 0.0, 0.1], orientation: {w: 0.7071068, xyz: [0.0, 0.7071068, 0.0]}}
  - add_frame:
      frame_name: tip
      parent_frame_name: flange
      joint_name: flange_tip
      joint_type: FIXED
      fixed_transform: {position: [0.0, 0.0, 0.2], orientation: {w: 1.0, xyz: [0.0, 0.0, 0.0]}}
cspace: {joint_names: [a]}
tool_frames: [tip]
collision: {geometry: g}
geometry: {g: {spheres: {tip: [{center: [0.0, 0.0, 0.1], radius: 0.02}]}}}
";
        let mut semantic = Semantic::default();
        parse_xrdf(text, &mut semantic).unwrap();
        assert_eq!(semantic.base.as_deref(), Some("base_link"));
        assert_eq!(semantic.tool.as_deref(), Some("wrist"));
        let (name, pose) = semantic.tool_frame.as_ref().unwrap();
        assert_eq!(name, "tip");
        assert!((pose.position - DVec3::new(0.2, 0.0, 0.1)).length() < 1e-6, "{pose:?}");
        let (link, centre, _) = &semantic.spheres.as_ref().unwrap()[0];
        assert_eq!(link, "wrist");
        assert!((*centre - DVec3::new(0.3, 0.0, 0.1)).length() < 1e-6, "{centre}");
        for (from, to, named) in [
            ("FIXED", "REVOLUTE", "FIXED"),
            ("w: 1.0", "w: 3.0", "length 1"),
            ("set_base_frame", "scale", "scale"),
        ] {
            let wrong = text.replacen(from, to, 1);
            let error = parse_xrdf(&wrong, &mut Semantic::default()).unwrap_err();
            assert!(error.contains(named), "{error}");
        }
    }

    #[test]
    fn an_srdf_gives_pairs_and_a_named_posture() {
        let text = r#"<robot name="r"><group name="arm"><chain base_link="b" tip_link="t"/></group>
            <group_state name="home" group="arm"><joint name="a" value="0.5"/></group_state>
            <disable_collisions link1="x" link2="y" reason="Never"/></robot>"#;
        let mut semantic = Semantic::default();
        parse_srdf(text, &mut semantic).unwrap();
        assert_eq!(semantic.tool.as_deref(), Some("t"));
        assert_eq!(semantic.ignored, [("x".to_owned(), "y".to_owned())]);
        assert_eq!(semantic.home(&["a".to_owned()]), Some(SVector::from([0.5])));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let wrong = |parse: fn(&str, &mut Semantic) -> Result<(), String>, text: &str| {
            parse(text, &mut Semantic::default()).unwrap_err()
        };
        assert!(wrong(parse_xrdf, "format: urdf\ncspace: {joint_names: []}").contains("`format`"));
        assert!(wrong(parse_xrdf, "format: [").contains("XRDF"));
        let few = "format: xrdf\ncspace: {joint_names: [a, b], jerk_limits: [1.0]}";
        assert!(wrong(parse_xrdf, few).contains("expected 2 numbers, found 1"));
        assert!(wrong(parse_srdf, "<html/>").contains("<robot>"));
        let no_link = r#"<robot><disable_collisions link1="x"/></robot>"#;
        assert!(wrong(parse_srdf, no_link).contains("`link2`"));
        let no_number =
            r#"<robot><group_state name="home"><joint name="a" value="x"/></group_state></robot>"#;
        assert!(wrong(parse_srdf, no_number).contains("expected a number, found `x`"));
    }
}
