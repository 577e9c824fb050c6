//! The UR5 of the repository with a few edits, as descriptions come from others.

#![allow(dead_code, reason = "each test binary uses a part of this module")]

use std::path::PathBuf;

use tprmp_robot::{
    Chain, Document, Interface, LimitOverride, Selection, UrdfError, count_joints, remarks,
};

use crate::common::robot_file;

/// Limits of the elbow in the file.
pub(crate) const ELBOW: &str = r#"<limit lower="-3.14159265359" upper="3.14159265359" velocity="3.14159265359" effort="150"/>"#;
/// Inertia of the forearm in the file.
pub(crate) const FOREARM: &str = r#"<inertia ixx="0.004194" ixy="0" ixz="0" iyy="0.0319714954687" iyz="0" izz="0.0319714954687"/>"#;
pub(crate) const FINGERS: &str = r#"<link name="f1"/><link name="f2"/>
<joint name="finger_joint" type="prismatic"><parent link="suction_tip"/><child link="f1"/><axis xyz="0 1 0"/>
  <limit lower="0.01" upper="0.05" effort="20" velocity="0.1"/></joint>
<joint name="finger_mimic" type="prismatic"><parent link="suction_tip"/><child link="f2"/><axis xyz="0 -1 0"/>
  <limit lower="0" upper="0.05" effort="20" velocity="0.1"/>
  <mimic joint="finger_joint" multiplier="2" offset="0.001"/></joint></robot>"#;

pub(crate) fn written(test: &str, text: impl AsRef<[u8]>) -> PathBuf {
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("case_{test}.urdf"));
    std::fs::write(&file, text).unwrap();
    file
}

/// The UR5 with each first text replaced by the second.
pub(crate) fn edited(test: &str, edits: &[(&str, &str)]) -> PathBuf {
    let mut text = std::fs::read_to_string(robot_file("ur5.urdf")).unwrap();
    for (from, to) in edits {
        assert!(text.contains(from), "nothing to edit: {from}");
        text = text.replace(from, to);
    }
    written(test, text)
}

pub(crate) fn ur5() -> Selection {
    "suction_tip".into()
}

pub(crate) fn by_motion() -> Selection {
    Selection { interface: Interface::Motion, ..ur5() }
}

pub(crate) fn without_shapes() -> Selection {
    Selection { ignores_shapes: true, ..ur5() }
}

pub(crate) fn limited(joint: &str, limits: LimitOverride) -> Selection {
    Selection { limits: [(joint.to_owned(), limits)].into(), ..ur5() }
}

pub(crate) fn holding(joints: &[(&str, f64)]) -> Selection {
    let held_joints = joints.iter().map(|(joint, at)| ((*joint).to_owned(), *at)).collect();
    Selection { held_joints, ..ur5() }
}

pub(crate) fn chain(
    test: &str,
    edits: &[(&str, &str)],
    selection: Selection,
) -> Result<Chain<6>, UrdfError> {
    Chain::from_urdf(edited(test, edits), selection)
}

/// Reads an edited UR5 that is refused with these parts of a message.
pub(crate) fn refused(test: &str, edits: &[(&str, &str)], selection: Selection, expected: &[&str]) {
    let file = edited(test, edits);
    let message = Chain::<6>::from_urdf(&file, selection.clone()).unwrap_err().to_string();
    assert_eq!(count_joints(&file, selection).unwrap_err().to_string(), message);
    for line in message.lines() {
        assert!(line.starts_with(&format!("{}: ", file.display())), "file not named: {message}");
    }
    for part in expected {
        assert!(message.contains(part), "{test}: `{part}` is missing in: {message}");
    }
}

/// What is remarked on an edited UR5 that can be used.
pub(crate) fn remarked(test: &str, edits: &[(&str, &str)], selection: &Selection) -> String {
    let document = Document::read(edited(test, edits)).unwrap();
    Chain::<6>::from_document(&document, selection).unwrap();
    let texts: Vec<_> =
        remarks(&document, selection).unwrap().iter().map(ToString::to_string).collect();
    texts.join("\n")
}
