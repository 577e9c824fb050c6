//! What an XRDF says: NVIDIA's Extended Robot Description Format, version 1.0.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use serde::Deserialize;
use tprmp_spatial::Pose;

use crate::init::semantic::Semantic;

#[derive(Debug, Deserialize)]
struct Xrdf {
    format: String,
    #[serde(default)]
    format_version: Option<f64>,
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
    #[serde(flatten)]
    further: BTreeMap<String, serde_json::Value>,
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
    fn add(
        &mut self,
        added: &AddedFrame,
        needed: &mut Vec<(String, String)>,
    ) -> Result<(), String> {
        let AddedFrame { frame_name, parent_frame_name, joint_type, fixed_transform } = added;
        let fault = |expected: &str, found: &str| {
            let (name, found) = (tprmp_files::printable(frame_name), tprmp_files::printable(found));
            Err(format!("key `modifiers`, frame `{name}`: expected {expected}, found {found}"))
        };
        if let Some(found) =
            joint_type.as_ref().filter(|found| !found.eq_ignore_ascii_case("fixed"))
        {
            return fault("a joint_type of FIXED", &format!("`{found}`"));
        }
        let Orientation { w, xyz: [x, y, z] } = &fixed_transform.orientation;
        let rotation = DQuat::from_xyzw(*x, *y, *z, *w);
        let (position, length) = (DVec3::from(fixed_transform.position), rotation.length());
        if !position.is_finite() || !(0.99..1.01).contains(&length) {
            let found = format!("{position} and a quaternion of length {length}");
            return fault("finite numbers and a quaternion of length 1", &found);
        }
        let own = Pose { position, orientation: rotation.normalize() };
        let (link, parent) = self.resolve(parent_frame_name);
        let key = format!("key `modifiers`, frame `{frame_name}`");
        let pose = parent.compose(&own);
        needed.push((key, link.clone()));
        self.0.insert(frame_name.clone(), (link, pose));
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

/// Takes what an XRDF says.
///
/// # Errors
/// What was expected and found.
pub(super) fn parse_xrdf(text: &str, semantic: &mut Semantic) -> Result<(), String> {
    let xrdf: Xrdf =
        serde_saphyr::from_str(text).map_err(|error| format!("expected an XRDF: {error}"))?;
    if xrdf.format != "xrdf" {
        return Err(format!(
            "key `format`: expected `xrdf`, found `{}`",
            tprmp_files::printable(&xrdf.format)
        ));
    }
    if let Some(version) = xrdf.format_version.filter(|version| !(1.0..2.0).contains(version)) {
        return Err(format!("key `format_version`: expected 1.0, found {version}"));
    }
    for key in xrdf.further.keys() {
        let key = tprmp_files::printable(key);
        semantic.unused.push(format!("the XRDF's key `{key}` is not known, and not used"));
    }
    if xrdf.self_collision.as_ref().is_some_and(|own| !own.buffer_distance.is_empty()) {
        let text = "the XRDF's `self_collision.buffer_distance` is not used: spheres have one radius, that of `collision`";
        semantic.unused.push(text.into());
    }
    let mut frames = AddedFrames::default();
    for modifier in &xrdf.modifiers {
        match modifier {
            Modifier::AddFrame(frame) => frames.add(frame, &mut semantic.needed_links)?,
            Modifier::SetBaseFrame(base) => {
                semantic
                    .needed_links
                    .push(("key `modifiers`, `set_base_frame`".into(), base.clone()));
                semantic.base = Some(base.clone());
            }
        }
    }
    take_cspace(&xrdf.cspace, semantic)?;
    if let Some(tool) = xrdf.tool_frames.first() {
        let (link, pose) = frames.resolve(tool);
        semantic.needed_links.push(("key `tool_frames`".into(), link.clone()));
        semantic.tool_frame = (link != *tool).then(|| (tool.clone(), pose));
        semantic.tool = Some(link);
    }
    if let Some((joint, at)) = xrdf.default_joint_positions.iter().find(|(_, at)| !at.is_finite()) {
        return Err(format!(
            "key `default_joint_positions`, joint `{joint}`: expected a finite number, found {at}"
        ));
    }
    if !xrdf.default_joint_positions.is_empty() {
        semantic.home.clone_from(&xrdf.default_joint_positions);
        semantic.home_name = "default_joint_positions".into();
    }
    take_collision(&xrdf, &frames, semantic)
}

/// The joints that move, and their limits.
fn take_cspace(cspace: &Cspace, semantic: &mut Semantic) -> Result<(), String> {
    let names = &cspace.joint_names;
    for (key, limits, kept) in [
        ("acceleration_limits", &cspace.acceleration_limits, &mut semantic.acceleration),
        ("jerk_limits", &cspace.jerk_limits, &mut semantic.jerk),
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
    Ok(())
}

/// Spheres, and pairs to ignore.
fn take_collision(
    xrdf: &Xrdf,
    frames: &AddedFrames,
    semantic: &mut Semantic,
) -> Result<(), String> {
    if let Some(collision) = &xrdf.collision {
        let geometry = xrdf.geometry.get(&collision.geometry).ok_or_else(|| {
            let known = xrdf.geometry.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            format!(
                "key `collision.geometry`: expected one of {known}, found `{}`",
                collision.geometry
            )
        })?;
        let found = spheres(geometry, &collision.buffer_distance, frames)?;
        let key = format!("key `geometry.{}.spheres`", collision.geometry);
        semantic.needed_links.extend(found.iter().map(|(link, ..)| (key.clone(), link.clone())));
        semantic.needed_links.dedup();
        semantic.spheres = Some(found);
    }
    for (link, others) in xrdf.self_collision.iter().flat_map(|own| &own.ignore) {
        let of_link = |name: &String| frames.resolve(name).0;
        semantic.ignored.extend(others.iter().map(|other| (of_link(link), of_link(other))));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::arm::Arm;

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
        assert_eq!([semantic.home["a"], semantic.home["b"]], [0.1, -0.2]);
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
            ("format: xrdf", "format: xrdf\nformat_version: 2.0", "format_version"),
            ("cspace", "default_joint_positions: {a: .nan}\ncspace", "finite"),
        ] {
            let wrong = text.replacen(from, to, 1);
            let error = parse_xrdf(&wrong, &mut Semantic::default()).unwrap_err();
            assert!(error.contains(named), "{error}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let wrong = |text: &str| parse_xrdf(text, &mut Semantic::default()).unwrap_err();
        assert!(wrong("format: urdf\ncspace: {joint_names: []}").contains("`format`"));
        assert!(wrong("format: [").contains("XRDF"));
        let few = "format: xrdf\ncspace: {joint_names: [a, b], jerk_limits: [1.0]}";
        assert!(wrong(few).contains("expected 2 numbers, found 1"));
        let mut semantic = Semantic::default();
        parse_xrdf(
            "format: xrdf\ncspace: {joint_names: [a]}\ncolision: {geometry: g}",
            &mut semantic,
        )
        .unwrap();
        assert!(semantic.unused[0].contains("`colision`"), "{:?}", semantic.unused);
    }
}
