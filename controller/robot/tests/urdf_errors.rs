//! Each unusable URDF gives an error that names the file, the place, what was expected and found.

use std::path::PathBuf;

use crate::common::{data_file, robot_file, skew, ur5};
use tprmp_robot::{Chain, JointKind, Selection, UrdfErrorKind, count_joints};

/// A chain of two joints with a fixed side branch, to be spoilt by the tests.
const GOOD: &str = r#"<robot name="good">
  <link name="root"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.1"/>
      <mass value="1"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>
    </inertial>
    <collision>
      <geometry><cylinder radius="0.05" length="0.2"/></geometry>
    </collision>
  </link>
  <link name="lower">
    <inertial>
      <mass value="0.5"/>
      <inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/>
    </inertial>
  </link>
  <link name="tool"/>
  <link name="camera"/>
  <joint name="first" type="revolute">
    <parent link="root"/><child link="upper"/>
    <origin xyz="0 0 1" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" velocity="3" effort="4"/>
  </joint>
  <joint name="second" type="prismatic">
    <parent link="upper"/><child link="lower"/>
    <axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" velocity="0.1" effort="40"/>
  </joint>
  <joint name="tool_joint" type="fixed">
    <parent link="lower"/><child link="tool"/>
  </joint>
  <joint name="camera_joint" type="fixed">
    <parent link="upper"/><child link="camera"/>
  </joint>
</robot>
"#;

/// `GOOD` with `from` replaced by `to`, in a file of its own.
fn spoilt(test: &str, from: &str, to: &str) -> PathBuf {
    assert!(GOOD.contains(from), "nothing to spoil");
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{test}.urdf"));
    std::fs::write(&file, GOOD.replacen(from, to, 1)).unwrap();
    file
}

/// Checks that the message of reading the spoilt file starts with its name and contains `expected`.
fn refuses(test: &str, from: &str, to: &str, expected: &[&str]) {
    let file = spoilt(test, from, to);
    let message = Chain::<2>::from_urdf(&file, "tool").unwrap_err().to_string();
    names(&message, &file, expected);
}

fn names(message: &str, file: &std::path::Path, expected: &[&str]) {
    assert!(message.starts_with(&format!("{}: ", file.display())), "file not named: {message}");
    for part in expected {
        assert!(message.contains(part), "`{part}` is missing in: {message}");
    }
}

#[test]
fn a_good_file_is_read() {
    let chain = Chain::<2>::from_urdf(spoilt("good", "good", "good"), "tool").unwrap();
    assert_eq!(chain.joint_names(), &["first", "second"]);
    assert_eq!(chain.joint_kind(0), Some(JointKind::Revolute));
    assert_eq!(chain.joint_kind(1), Some(JointKind::Prismatic));
    assert_eq!(chain.joint_kind(2), None);
    assert_eq!(chain.position_lower().as_slice(), [-1.0, -0.5]);
    assert_eq!(chain.position_upper().as_slice(), [2.0, 0.5]);
    assert_eq!(chain.velocity_max().as_slice(), [3.0, 0.1]);
    assert_eq!(chain.effort_max().as_slice(), [4.0, 40.0]);
    let links: Vec<_> =
        chain.moving_links().iter().map(|(name, joint)| (&name[..], *joint)).collect();
    assert_eq!(links, [("upper", 0), ("lower", 1), ("tool", 1), ("camera", 0)]);
}

#[test]
fn robots_of_the_repository_are_counted() {
    assert_eq!(count_joints(robot_file("ur5.urdf"), "suction_tip").unwrap(), 6);
    assert_eq!(count_joints(robot_file("point2d.urdf"), "point").unwrap(), 2);
    assert_eq!(count_joints(data_file("skew.urdf"), "hand").unwrap(), 4);
    let links: Vec<_> = ur5().moving_links().iter().map(|(name, _)| name.clone()).collect();
    assert!(links.contains(&"suction_tool".to_owned()));
    assert!(!links.contains(&"base_link".to_owned()), "base_link does not move");
}

#[test]
fn a_continuous_joint_has_no_position_limits() {
    assert_eq!(skew().position_lower().as_slice(), [-3.0, -0.5, f64::NEG_INFINITY, -2.0]);
    assert_eq!(skew().position_upper().as_slice(), [3.0, 0.5, f64::INFINITY, 1.0]);
}

#[test]
fn missing_file() {
    let file = PathBuf::from("/does/not/exist.urdf");
    for error in [
        Chain::<2>::from_urdf(&file, "tool").unwrap_err(),
        count_joints(&file, "tool").unwrap_err(),
    ] {
        assert_eq!(error.file, file);
        assert!(matches!(error.faults[0].kind, UrdfErrorKind::NotReadable(_)));
        names(&error.to_string(), &file, &["expected a readable URDF file", "No such file"]);
    }
}

#[test]
fn broken_xml() {
    let expected = ["line 1: expected a URDF document, found half a file", "<robot name=\"good\">"];
    refuses("broken_xml", "</robot>", "", &expected);
    refuses("empty", GOOD, "", &["expected a URDF document, found an empty file"]);
    refuses(
        "no_mass",
        r#"<mass value="1"/>"#,
        "",
        &["line 4: link `upper`: <inertial>: expected an element <mass>, found none"],
    );
    refuses(
        "word",
        r#"value="1""#,
        r#"value="heavy""#,
        &["line 6: link `upper`: <mass>: expected value: a number, found `heavy`"],
    );
    refuses(
        "no_speed",
        r#"velocity="3""#,
        "",
        &[
            "found none (or zero, or more than any arm's) for `first` (line 25: velocity)",
            "robot.limits",
            "velocity: Some(…)",
        ],
    );
    refuses(
        "other_type",
        "prismatic",
        "hinge",
        &["line 27: joint `second`: expected a type of revolute, ", "found `hinge`"],
    );
}

#[test]
fn names_used_twice() {
    let expected = ["line 20: link `root`: expected unique names, found it on line 2 too"];
    refuses("two_links", r#"<link name="camera"/>"#, r#"<link name="root"/>"#, &expected);
    let expected = ["line 27: joint `first`: expected unique names, found it on line 21 too"];
    refuses("two_joints", r#"name="second""#, r#"name="first""#, &expected);
}

#[test]
fn unknown_links() {
    let expected = ["joint `second`: expected its parent to be a link of the file, found `uper`"];
    refuses(
        "parent",
        r#"<parent link="upper"/><child link="l"#,
        r#"<parent link="uper"/><child link="l"#,
        &expected,
    );
    let expected = ["joint `second`: expected its child to be a link of the file, found `low`"];
    refuses("child", r#"<child link="lower"/>"#, r#"<child link="low"/>"#, &expected);
}

#[test]
fn not_a_tree() {
    let expected = ["link `upper`: expected one parent joint, found `first` and `camera_joint`"];
    refuses("two_parents", r#"<child link="camera"/>"#, r#"<child link="upper"/>"#, &expected);
    let expected = ["expected exactly one root link, found 2: root, lone"];
    let lone = r#"<link name="root"/><link name="lone"/>"#;
    refuses("two_roots", r#"<link name="root"/>"#, lone, &expected);
    let expected = ["expected exactly one root link, found 0: "];
    let back = r#"<joint name="back" type="fixed"><parent link="tool"/><child link="root"/></joint></robot>"#;
    refuses("ring", "</robot>", back, &expected);
    let ring = r#"<link name="a"/><link name="b"/>
        <joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
        <joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"#;
    let expected = ["link `", "`: expected a path to the root link, found a closed loop"];
    refuses("closed_loop", "</robot>", ring, &expected);
}

#[test]
fn unknown_tool_link() {
    let file = spoilt("tool_name", "good", "good");
    let expected = [
        "tool link `gripper`: expected a link of the file, found only: root, upper, lower, tool, camera",
    ];
    names(&Chain::<2>::from_urdf(&file, "gripper").unwrap_err().to_string(), &file, &expected);
    names(&count_joints(&file, "gripper").unwrap_err().to_string(), &file, &expected);
}

#[test]
fn a_base_below_the_root_and_held_joints_choose_the_chain() {
    let file = robot_file("ur5.urdf");
    let selection = |base: &str, tool: &str, held: &[&str]| Selection {
        base_link: Some(base.into()),
        tool_link: tool.into(),
        held_joints: held.iter().map(|joint| ((*joint).to_owned(), 0.0)).collect(),
        ..Selection::default()
    };
    let arm = selection("upper_arm_link", "suction_tip", &["wrist_3_joint"]);
    assert_eq!(count_joints(&file, arm.clone()).unwrap(), 3);
    let chain = Chain::<3>::from_urdf(&file, arm).unwrap();
    assert_eq!(chain.root_link(), "upper_arm_link");
    assert_eq!(chain.joint_names(), &["elbow_joint", "wrist_1_joint", "wrist_2_joint"]);
    assert!(chain.moving_links().iter().all(|(link, _)| link != "shoulder_link"));
    for (selection, expected) in [
        (selection("leg", "suction_tip", &[]), "base link `leg`: expected a link of the file"),
        (
            selection("suction_tool", "forearm_link", &[]),
            "base link `suction_tool`: expected a link between the root and `forearm_link`",
        ),
        (
            selection("base_link", "suction_tip", &["thumb"]),
            "held joint `thumb`: expected a joint of the file",
        ),
    ] {
        names(&count_joints(&file, selection).unwrap_err().to_string(), &file, &[expected]);
    }
}

#[test]
fn wrong_number_of_joints() {
    let file = robot_file("ur5.urdf");
    let error = Chain::<7>::from_urdf(&file, "suction_tip").unwrap_err();
    let expected = "tool link `suction_tip`: expected 7 movable joints on its path, found 6";
    names(&error.to_string(), &file, &[expected]);
    let file = spoilt("no_joint", "good", "good");
    let expected = "tool link `root`: expected 2 to 8 movable joints on its path, found 0";
    names(&count_joints(&file, "root").unwrap_err().to_string(), &file, &[expected]);
    // The joint beyond the tool would move freely.
    let expected = "expected joints beside the path from `root` to `upper` to be held, found 1 that is not: \
                    `second` (prismatic); set `robot.held_joints: {\"second\": 0.0}`";
    names(&Chain::<1>::from_urdf(&file, "upper").unwrap_err().to_string(), &file, &[expected]);
}

#[test]
fn unsupported_joints() {
    let types = "expected type revolute, continuous, prismatic or fixed, found";
    for found in ["floating", "planar", "spherical"] {
        let expected = format!("joint `second`: {types} {found}");
        refuses(found, r#"type="prismatic""#, &format!(r#"type="{found}""#), &[&expected]);
        let file = spoilt(found, r#"type="prismatic""#, &format!(r#"type="{found}""#));
        names(&count_joints(&file, "tool").unwrap_err().to_string(), &file, &[&expected]);
    }
    let expected = "joint `second`: expected joints that move by themselves on the path to the tool, found that \
                    it follows `first`";
    let mimic = r#"<axis xyz="1 0 0"/><mimic joint="first"/>"#;
    refuses("mimic", r#"<axis xyz="1 0 0"/>"#, mimic, &[expected]);
    let expected = [
        "expected joints beside the path from `root` to `tool` to be held, found 1 that is not: `camera_joint` (floating)",
    ];
    let camera = r#"name="camera_joint" type="fixed""#;
    refuses("camera", camera, r#"name="camera_joint" type="floating""#, &expected);
}

#[test]
fn unusable_limits() {
    let limit = r#"<limit lower="-1" upper="2" velocity="3" effort="4"/>"#;
    let expected = [
        "expected limits of every joint, found none (or zero, or more than any arm's) for `first` (line 21: position, velocity, effort)",
    ];
    refuses("no_limit", limit, "", &expected);
    for (test, from, to, expected) in [
        ("v0", "velocity=\"3\"", "velocity=\"0\"", "for `first` (line 25: velocity)"),
        (
            "e0",
            "effort=\"4\"",
            "effort=\"-7\"",
            "joint `first`: limit effort: expected a positive number of N m, found -7",
        ),
        (
            "v1",
            "velocity=\"0.1\"",
            "velocity=\"-1\"",
            "joint `second`: limit velocity: expected a positive number of m/s, found -1",
        ),
        ("e1", "effort=\"40\"", "effort=\"0\"", "for `second` (line 30: effort)"),
        (
            "order",
            "upper=\"2\"",
            "upper=\"-1\"",
            "joint `first`: limit: expected lower < upper, found lower -1 and upper -1",
        ),
    ] {
        refuses(test, from, to, &[expected]);
    }
}

#[test]
fn zero_axis() {
    let expected = ["joint `first`: axis: expected a vector longer than zero, found 0 0 0"];
    refuses("axis", r#"xyz="0 1 0""#, r#"xyz="0 0 0""#, &expected);
}

#[test]
fn negative_mass_and_inertia() {
    let expected = ["link `lower`: mass: expected zero or a positive number of kg, found -0.5"];
    refuses("mass", r#"value="0.5""#, r#"value="-0.5""#, &expected);
    let expected = [
        "link `upper`: inertia: expected principal moments of zero or more kg m², found the smallest -0.1",
    ];
    refuses("inertia", r#"izz="0.1""#, r#"izz="-0.1""#, &expected);
    // Positive on the diagonal, and yet with a negative principal moment.
    refuses(
        "inertia_off",
        r#"ixy="0""#,
        r#"ixy="0.3""#,
        &["link `upper`: inertia", "found the smallest -0.1999"],
    );
}

#[test]
fn numbers_that_are_not_finite() {
    for (test, from, to, expected) in [
        (
            "f1",
            "xyz=\"0 0 1\"",
            "xyz=\"0 0 inf\"",
            "joint `first`: origin xyz: expected a finite number, found inf",
        ),
        (
            "f2",
            "rpy=\"0 0 0\"",
            "rpy=\"0 NaN 0\"",
            "joint `first`: origin rpy: expected a finite number, found NaN",
        ),
        (
            "f3",
            "xyz=\"0 1 0\"",
            "xyz=\"0 nan 0\"",
            "joint `first`: axis xyz: expected a finite number, found NaN",
        ),
        (
            "f4",
            "upper=\"2\"",
            "upper=\"nan\"",
            "joint `first`: limit: expected a finite number, found NaN",
        ),
        (
            "f5",
            "effort=\"40\"",
            "effort=\"nan\"",
            "joint `second`: limit effort: expected a positive number of N, found NaN",
        ),
        (
            "f6",
            "value=\"0.5\"",
            "value=\"inf\"",
            "link `lower`: mass: expected a finite number, found inf",
        ),
        (
            "f7",
            "iyz=\"0\"",
            "iyz=\"NaN\"",
            "link `upper`: inertia: expected a finite number, found NaN",
        ),
        (
            "f8",
            "xyz=\"0 0 0.1\"",
            "xyz=\"0 0 -inf\"",
            "link `upper`: origin xyz: expected a finite number, found -inf",
        ),
        (
            "f9",
            "radius=\"0.05\"",
            "radius=\"inf\"",
            "link `upper`: collision geometry: expected a finite number, found inf",
        ),
    ] {
        refuses(test, from, to, &[expected]);
    }
}

#[test]
fn flat_collision_shapes() {
    let expected = ["link `upper`: collision length: expected a positive number of m, found 0"];
    refuses("flat", r#"length="0.2""#, r#"length="0""#, &expected);
    let expected = ["link `upper`: collision size: expected a positive number of m, found -1"];
    refuses(
        "box",
        r#"<cylinder radius="0.05" length="0.2"/>"#,
        r#"<box size="1 -1 1"/>"#,
        &expected,
    );
}
