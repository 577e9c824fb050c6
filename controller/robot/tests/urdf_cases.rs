//! Descriptions as they come from others: what the arm does not need is not judged, and what is wrong with the
//! rest is said at once, with its place and what to do. Each case is the repository's UR5 with a few edits.

mod common;

use std::path::PathBuf;

use common::robot_file;
use glam::DVec3;
use tprmp_robot::document::{Owner, Shape};
use tprmp_robot::{
    Chain, Document, Interface, LimitOverride, Selection, UrdfError, count_joints, remarks,
};

/// Limits of the elbow in the file.
const ELBOW: &str = r#"<limit lower="-3.14159265359" upper="3.14159265359" velocity="3.14159265359" effort="150"/>"#;
/// Inertia of the forearm in the file.
const FOREARM: &str = r#"<inertia ixx="0.004194" ixy="0" ixz="0" iyy="0.0319714954687" iyz="0" izz="0.0319714954687"/>"#;
const FINGERS: &str = r#"<link name="f1"/><link name="f2"/>
<joint name="finger_joint" type="prismatic"><parent link="suction_tip"/><child link="f1"/><axis xyz="0 1 0"/>
  <limit lower="0.01" upper="0.05" effort="20" velocity="0.1"/></joint>
<joint name="finger_mimic" type="prismatic"><parent link="suction_tip"/><child link="f2"/><axis xyz="0 -1 0"/>
  <limit lower="0" upper="0.05" effort="20" velocity="0.1"/>
  <mimic joint="finger_joint" multiplier="2" offset="0.001"/></joint></robot>"#;

fn written(test: &str, text: impl AsRef<[u8]>) -> PathBuf {
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("case_{test}.urdf"));
    std::fs::write(&file, text).unwrap();
    file
}

/// The UR5 with each first text replaced by the second.
fn edited(test: &str, edits: &[(&str, &str)]) -> PathBuf {
    let mut text = std::fs::read_to_string(robot_file("ur5.urdf")).unwrap();
    for (from, to) in edits {
        assert!(text.contains(from), "nothing to edit: {from}");
        text = text.replace(from, to);
    }
    written(test, text)
}

fn ur5() -> Selection {
    "suction_tip".into()
}

fn by_motion() -> Selection {
    Selection { interface: Interface::Motion, ..ur5() }
}

fn without_shapes() -> Selection {
    Selection { ignores_shapes: true, ..ur5() }
}

fn limited(joint: &str, limits: LimitOverride) -> Selection {
    Selection { limits: [(joint.to_owned(), limits)].into(), ..ur5() }
}

fn holding(joints: &[(&str, f64)]) -> Selection {
    let held_joints = joints.iter().map(|(joint, at)| ((*joint).to_owned(), *at)).collect();
    Selection { held_joints, ..ur5() }
}

fn chain(test: &str, edits: &[(&str, &str)], selection: Selection) -> Result<Chain<6>, UrdfError> {
    Chain::from_urdf(edited(test, edits), selection)
}

/// Reads an edited UR5 that is refused with these parts of a message.
fn refused(test: &str, edits: &[(&str, &str)], selection: Selection, expected: &[&str]) {
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
fn remarked(test: &str, edits: &[(&str, &str)], selection: &Selection) -> String {
    let document = Document::read(edited(test, edits)).unwrap();
    Chain::<6>::from_document(&document, selection).unwrap();
    let texts: Vec<_> =
        remarks(&document, selection).unwrap().iter().map(ToString::to_string).collect();
    texts.join("\n")
}

#[test]
fn nothing_is_remarked_on_the_arms_of_the_repository() {
    assert_eq!(remarked("own", &[], &ur5()), "");
    for (file, tool) in [("point2d.urdf", "point"), ("fr3.urdf", "suction_tip")] {
        let document = Document::read(robot_file(file)).unwrap();
        assert_eq!(remarks(&document, &tool.into()).unwrap(), [], "{file}");
    }
}

#[test]
fn the_tree_is_there_as_it_stands_in_the_file() {
    let mesh = r#"<mesh filename="package://ur/f.stl" scale="0.001 0.001 -0.001"/>"#;
    let file = edited("tree", &[(r#"<cylinder radius="0.045" length="0.37"/>"#, mesh)]);
    let document = Document::read(file).unwrap();
    let elbow = document.joints.iter().find(|joint| joint.name == "elbow_joint").unwrap();
    assert_eq!((elbow.line, elbow.limit.line), (140, Some(145)));
    assert_eq!((elbow.parent.as_str(), elbow.child.as_str()), ("upper_arm_link", "forearm_link"));
    assert_eq!(elbow.origin.xyz, [-0.425, 0.0, 0.0]);
    assert_eq!(elbow.limit.effort, Some(150.0));
    assert_eq!(elbow.dynamics.unwrap().damping, 0.0);
    let forearm = document.links.iter().find(|link| link.name == "forearm_link").unwrap();
    assert_eq!(forearm.inertial.unwrap().mass, 2.33);
    let [collision] = &forearm.collisions[..] else { panic!("{:?}", forearm.collisions) };
    let filename = "package://ur/f.stl".to_owned();
    assert_eq!(collision.shape, Shape::Mesh { filename, scale: [0.001, 0.001, -0.001] });
    assert!(document.faults.is_empty());
    let file =
        edited("tree_fault", &[("<cylinder radius=\"0.045\"", "<cylinder radius=\"thick\"")]);
    let document = Document::read(file).unwrap();
    let [fault, ..] = &document.faults[..] else { panic!("{:?}", document.faults) };
    let Owner::Link(link) = fault.owner else { panic!("{fault:?}") };
    assert_eq!((document.links[link].name.as_str(), fault.part), ("forearm_link", "collision"));
}

#[test]
fn what_is_no_urdf_is_named_for_what_it_is() {
    let whole = std::fs::read_to_string(robot_file("ur5.urdf")).unwrap();
    let half = |at: &str| whole[..whole.find(at).unwrap()].to_owned();
    let cases: &[(&str, String, &[&str])] = &[
        ("empty", String::new(), &["an empty file"]),
        ("blank", " \n\t\n".into(), &["an empty file"]),
        ("comment", "<?xml version=\"1.0\"?>\n<!-- later -->\n".into(), &["no element at all"]),
        (
            "half",
            half("<visual>\n      <origin xyz=\"-0.196"),
            &["line 149", "half a file", "forearm_link"],
        ),
        ("half_tag", half("0.0319714954687\" iyz"), &["line 149", "half a file", "forearm_link"]),
        ("half_joint", half(ELBOW), &["line 140", "half a file", "elbow_joint"]),
        (
            "html",
            "<!DOCTYPE html><html><body>404: Not Found</body></html>".into(),
            &["a web page", "raw"],
        ),
        ("html_upper", "\n<HTML lang=en><p>sign in".into(), &["a web page"]),
        ("404", "404: Not Found".into(), &["download that failed", "again"]),
        ("not_found", "Not Found".into(), &["download that failed"]),
        (
            "lfs",
            "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n".into(),
            &["Git LFS", "git lfs pull"],
        ),
        ("json", "{\"links\": []}".into(), &["JSON"]),
        ("yaml", "robot:\n  links: []\n".into(), &["line 1", "no XML", "`robot:`"]),
        ("stl", "solid arm\nfacet normal 0 0 1\n".into(), &["no XML", "`solid arm`"]),
        ("binary", "\u{0}\u{1}\u{0}".into(), &["a binary file"]),
        ("sdf", "<sdf version=\"1.6\"><model name=\"a\"/></sdf>".into(), &["an SDF of Gazebo"]),
        (
            "mjcf",
            "<?xml version=\"1.0\"?>\n<mujoco model=\"a\"/>".into(),
            &["line 2", "an MJCF of MuJoCo"],
        ),
        (
            "srdf",
            "<robot name=\"a\"><group name=\"arm\"/></robot>".into(),
            &["an SRDF", "the .urdf file"],
        ),
        ("launch", "<launch/>".into(), &["a launch file of ROS"]),
        ("mesh", "<COLLADA/>".into(), &["a COLLADA mesh"]),
        ("other", "<svg/>".into(), &["the root element <svg>", "<robot>"]),
        ("no_link", "<robot name=\"a\"><joint/></robot>".into(), &["without any <link>"]),
        ("two", format!("{whole}<robot/>"), &["a second root element"]),
        (
            "xacro_only",
            "<robot name=\"a\" xmlns:xacro=\"x\">\n<xacro:arm prefix=\"\"/></robot>".into(),
            &["line 2", "<xacro:arm>", "pip install xacro"],
        ),
    ];
    for (test, text, expected) in cases {
        let file = written(test, text);
        let message = count_joints(&file, "tool").unwrap_err().to_string();
        let start = format!("{}: ", file.display());
        assert!(message.starts_with(&start) && message.contains("expected a URDF"), "{message}");
        for part in *expected {
            assert!(message.contains(part), "{test}: `{part}` is missing in: {message}");
        }
    }
}

#[test]
fn a_byte_order_mark_and_ends_of_lines_of_windows_are_no_reason() {
    let text = std::fs::read_to_string(robot_file("ur5.urdf")).unwrap().replace('\n', "\r\n");
    let file = written("bom", format!("\u{feff}{text}"));
    assert_eq!(count_joints(file, "suction_tip").unwrap(), 6);
}

#[test]
fn what_is_left_of_xacro_is_named_with_the_command_that_expands_it() {
    let in_arm = r#"<origin xyz="-0.425 0 0" rpy="0 0 0"/>"#;
    for (test, from, to, expected) in [
        (
            "expression",
            in_arm,
            r#"<origin xyz="${pi/2} 0 0"/>"#,
            "line 143: expected a URDF, found xyz=\"${pi/2} 0 0\"",
        ),
        (
            "argument",
            in_arm,
            r#"<origin xyz="$(arg x) 0 0"/>"#,
            "line 143: expected a URDF, found xyz=\"$(arg x)",
        ),
        (
            "element",
            in_arm,
            "<xacro:origin_of_arm/>",
            "line 143: expected a URDF, found <xacro:origin_of_arm>",
        ),
        (
            "name",
            "\"forearm_link\"",
            "\"${p}forearm_link\"",
            "line 142: expected a URDF, found link=\"${p}forearm_link\"",
        ),
        (
            "condition",
            "<robot name=\"ur5\">",
            "<robot name=\"ur5\"><xacro:if value=\"0\"/>",
            "found <xacro:if>",
        ),
    ] {
        refused(test, &[(from, to)], ur5(), &[expected, "xacro '", "-o '", "pip install xacro"]);
    }
    for (test, from, to) in [
        ("drawn", "<material name=\"ur_grey\"/>", "<material name=\"${grey}\"/>"),
        ("simulated", "</robot>", "<gazebo><p f=\"$(find x)/y\"/></gazebo></robot>"),
        ("commented", "</robot>", "<!-- <xacro:arm/> ${pi} --></robot>"),
    ] {
        chain(test, &[(from, to)], ur5()).unwrap();
    }
}

#[test]
fn what_the_chain_does_not_need_is_not_judged() {
    let base = "<link name=\"base\">";
    let zero_box = "<collision><geometry><box size=\"0 0 0\"/></geometry></collision>";
    let base_inertia = "<link name=\"base\">\n    <inertial>\n      <origin xyz=\"0 0 0\" rpy=\"0 0 0\"/>\n      <mass \
                        value=\"0\"/>\n      <inertia ixx=\"0\"";
    for (test, from, to) in [
        ("base_box", base, format!("{base}{zero_box}")),
        ("base_inertia", base_inertia, base_inertia.replace("ixx=\"0\"", "ixx=\"-3.5e-8\"")),
        ("base_word", base_inertia, base_inertia.replace("ixx=\"0\"", "ixx=\"none\"")),
        ("material_twice", "<material name=\"ur_grey\"/>", "<material name=\"a\"/><material name=\"b\"/>".into()),
        ("texture", "<material name=\"ur_grey\"/>", "<material name=\"a\"><texture/></material>".into()),
        ("colour", "rgba=\"0.72 0.74 0.76 1\"", "rgba=\"0.72 0.74 0.76\"".into()),
        ("no_name", "<material name=\"ur_grey\"/>", "<material/>".into()),
        ("visual", "<visual>", "<visual><geometry><torus/></geometry></visual><visual>".into()),
        ("transmission", "</robot>", "<transmission><joint/></transmission></robot>".into()),
        (
            "antenna",
            "</robot>",
            "<link name=\"antenna\"/><joint name=\"mast\" type=\"fixed\"><parent link=\"base\"/><child \
             link=\"antenna\"/><origin xyz=\"0,0,1\"/></joint></robot>"
                .into(),
        ),
        ("calibration", ELBOW, format!("{ELBOW}<calibration rising=\"?\"/>")),
        ("other_attribute", ELBOW, ELBOW.replace("effort=", "acceleration=\"fast\" effort=")),
    ] {
        chain(test, &[(from, &to)], ur5()).unwrap_or_else(|error| panic!("{test}: {error}"));
    }
}

#[test]
fn shapes_are_judged_only_where_they_matter() {
    let shape = r#"<cylinder radius="0.045" length="0.37"/>"#;
    for (test, to, expected) in [
        (
            "flat",
            r#"<cylinder radius="0.045" length="0"/>"#,
            "link `forearm_link`: collision length",
        ),
        (
            "word",
            r#"<cylinder radius="thick" length="0.37"/>"#,
            "<cylinder>: expected radius: a number, found `thick`",
        ),
        (
            "torus",
            "<torus/>",
            "<geometry>: expected one shape of cylinder, capsule, sphere, box, mesh, found torus",
        ),
        (
            "none",
            "",
            "<geometry>: expected one shape of cylinder, capsule, sphere, box, mesh, found none",
        ),
        ("mesh", "<mesh/>", "<mesh>: expected the attribute `filename`, found none"),
    ] {
        let test = format!("shape_{test}");
        refused(&test, &[(shape, to)], ur5(), &[expected, "forearm_link"]);
        let chain = chain(&test, &[(shape, to)], without_shapes()).unwrap();
        assert!(chain.collision_shapes().is_empty(), "{test}");
    }
}

#[test]
fn all_joints_without_limits_are_listed_with_the_key() {
    for (test, to, selection, expected) in [
        ("no_limit", "", ur5(), "`elbow_joint` (line 140: position, velocity, effort)"),
        ("no_limit_motion", "", by_motion(), "`elbow_joint` (line 140: position, velocity)"),
        (
            "no_effort",
            r#"<limit lower="-3" upper="3" velocity="3.1"/>"#,
            ur5(),
            "(line 145: effort)",
        ),
        (
            "no_velocity",
            r#"<limit lower="-3" upper="3" effort="150"/>"#,
            ur5(),
            "(line 145: velocity)",
        ),
        (
            "effort_0",
            r#"<limit lower="-3" upper="3" velocity="3" effort="0"/>"#,
            ur5(),
            "(line 145: effort)",
        ),
        (
            "velocity_0",
            r#"<limit lower="-3" upper="3" velocity="0" effort="1"/>"#,
            by_motion(),
            "(line 145: velocity)",
        ),
        (
            "no_range",
            r#"<limit lower="0" upper="0" velocity="3" effort="1"/>"#,
            ur5(),
            "(line 145: position)",
        ),
        (
            "huge",
            r#"<limit lower="-1e30" upper="1e30" velocity="1e30" effort="1e30"/>"#,
            ur5(),
            "(line 145: velocity, effort)",
        ),
    ] {
        refused(
            test,
            &[(ELBOW, to)],
            selection,
            &[
                "expected limits of every joint",
                expected,
                "`robot.limits: {\"elbow_joint\": (position: ",
            ],
        );
    }
    let every = [("velocity=\"3.14159265359\"", ""), ("effort=\"28\"", "")];
    let expected = [
        "`shoulder_pan_joint` (line",
        "`elbow_joint` (line 145: velocity)",
        "`wrist_3_joint` (line",
        "(line 160: velocity, effort)",
    ];
    let file = edited("every", &every);
    let error = Chain::<6>::from_urdf(file, ur5()).unwrap_err();
    assert_eq!(error.faults.len(), 1, "{error}");
    refused("every", &every, ur5(), &expected[..3]);
    let continuous = [
        (
            "<joint name=\"elbow_joint\" type=\"revolute\">",
            "<joint name=\"elbow_joint\" type=\"continuous\">",
        ),
        (ELBOW, ""),
    ];
    refused("continuous", &continuous, ur5(), &["`elbow_joint` (line 140: velocity, effort)"]);
}

#[test]
fn limits_are_those_given_beside_the_file() {
    let all =
        LimitOverride { position: Some([-1.0, 2.0]), velocity: Some(1.5), effort: Some(99.0) };
    for (test, to) in [
        ("given", ""),
        ("given_kept", ELBOW),
        ("given_for_swapped", r#"<limit lower="3" upper="-3" velocity="3" effort="1"/>"#),
        ("given_for_word", r#"<limit lower="-3,0" upper="3,0" velocity="3" effort="1"/>"#),
        ("given_for_negative", r#"<limit lower="-3" upper="3" velocity="-1" effort="-1"/>"#),
    ] {
        let chain = chain(test, &[(ELBOW, to)], limited("elbow_joint", all)).unwrap();
        assert_eq!((chain.position_lower()[2], chain.position_upper()[2]), (-1.0, 2.0), "{test}");
        assert_eq!((chain.velocity_max()[2], chain.effort_max()[2]), (1.5, 99.0), "{test}");
        assert_eq!(chain.effort_max()[1], 150.0, "{test}");
    }
    let only_effort = LimitOverride { effort: Some(99.0), ..LimitOverride::default() };
    let to = r#"<limit lower="-3" upper="3" velocity="3.1"/>"#;
    let one = chain("one", &[(ELBOW, to)], limited("elbow_joint", only_effort)).unwrap();
    assert_eq!((one.velocity_max()[2], one.effort_max()[2]), (3.1, 99.0));
    let motion = chain("motion", &[(ELBOW, to)], by_motion()).unwrap();
    assert_eq!((motion.effort_max()[2], motion.effort_max()[1]), (f64::INFINITY, 150.0));
    let unknown = limited("elbow", only_effort);
    refused(
        "unknown",
        &[],
        unknown,
        &["key `robot.limits`: expected joints on the path", "elbow_joint", "found `elbow`"],
    );
}

#[test]
fn continuous_joints_have_no_position_limits() {
    let continuous = (
        "<joint name=\"elbow_joint\" type=\"revolute\">",
        "<joint name=\"elbow_joint\" type=\"continuous\">",
    );
    let free = chain("free", &[continuous], ur5()).unwrap();
    assert_eq!(
        (free.position_lower()[2], free.position_upper()[2]),
        (f64::NEG_INFINITY, f64::INFINITY)
    );
    let bare = [
        continuous,
        (
            ELBOW,
            r#"<limit velocity="3" effort="150"/><safety_controller soft_lower_limit="-1" soft_upper_limit="1" k_velocity="1"/>"#,
        ),
    ];
    let free = chain("bare", &bare, ur5()).unwrap();
    assert_eq!((free.position_lower()[2], free.velocity_max()[2]), (f64::NEG_INFINITY, 3.0));
}

#[test]
fn soft_limits_count_where_they_are_narrower() {
    for (test, soft, expected) in [
        ("narrower", r#"soft_lower_limit="-2" soft_upper_limit="1.5""#, [-2.0, 1.5]),
        ("wider", r#"soft_lower_limit="-9" soft_upper_limit="9""#, [-3.14159265359, 3.14159265359]),
        ("one_side", r#"soft_lower_limit="-2" soft_upper_limit="9""#, [-2.0, 3.14159265359]),
        ("zeros", r#"soft_lower_limit="0" soft_upper_limit="0""#, [-3.14159265359, 3.14159265359]),
        ("none", r#"k_position="30""#, [-3.14159265359, 3.14159265359]),
    ] {
        let to = format!("{ELBOW}<safety_controller k_velocity=\"1\" {soft}/>");
        let chain = chain(test, &[(ELBOW, &to)], ur5()).unwrap();
        assert_eq!([chain.position_lower()[2], chain.position_upper()[2]], expected, "{test}");
    }
    let apart =
        format!("{ELBOW}<safety_controller soft_lower_limit=\"4\" soft_upper_limit=\"5\"/>");
    refused(
        "apart",
        &[(ELBOW, &apart)],
        ur5(),
        &["line 145: joint `elbow_joint`: safety_controller", "[4.0, 5.0]"],
    );
}

#[test]
fn limits_that_are_wrong_are_named() {
    for (test, to, expected) in [
        (
            "swapped",
            r#"<limit lower="3" upper="-3" effort="150" velocity="3"/>"#,
            "line 145: joint `elbow_joint`: limit: expected lower < upper, found lower 3 and upper -3: they are swapped",
        ),
        (
            "equal",
            r#"<limit lower="1" upper="1" effort="150" velocity="3"/>"#,
            "found lower 1 and upper 1; set `robot.limits`",
        ),
        (
            "negative",
            r#"<limit lower="-3" upper="3" effort="150" velocity="-3"/>"#,
            "limit velocity: expected a positive number of rad/s, found -3",
        ),
        (
            "nan",
            r#"<limit lower="nan" upper="3" effort="150" velocity="3"/>"#,
            "limit: expected a finite number, found NaN",
        ),
        (
            "comma",
            r#"<limit lower="-3,0" upper="3" effort="150" velocity="3"/>"#,
            "line 145: joint `elbow_joint`: <limit>: expected lower: a number and a point before decimals, found `-3,0`",
        ),
        (
            "two",
            &format!("{ELBOW}{ELBOW}"),
            "line 145: joint `elbow_joint`: <limit>: expected one <limit>",
        ),
    ] {
        refused(test, &[(ELBOW, to)], ur5(), &[expected]);
    }
}

#[test]
fn one_run_tells_all_that_is_wrong() {
    let edits = [
        (ELBOW, r#"<limit lower="3" upper="-3" effort="no" velocity="3"/><axis xyz="0 0"/>"#),
        (FOREARM, r#"<inertia ixx="-0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>"#),
        (r#"<mass value="1.219"/>"#, r#"<mass value="heavy"/>"#),
        (r#"effort="28""#, ""),
        (r#"<cylinder radius="0.06" length="0.12"/>"#, r#"<cylinder radius="-1" length="0.12"/>"#),
        ("</robot>", FINGERS),
    ];
    let expected = [
        "line 145: joint `elbow_joint`: <limit>: expected effort: a number, found `no`",
        "joint `elbow_joint`: <axis>: expected one <axis>",
        "link `forearm_link`: inertia: expected principal moments",
        "link `wrist_1_link`: <mass>: expected value: a number, found `heavy`",
        "`wrist_1_joint` (line",
        "`wrist_3_joint` (line",
        "`finger_joint` (prismatic)",
    ];
    let text = std::fs::read_to_string(robot_file("ur5.urdf")).unwrap();
    let edits: Vec<_> = edits.into_iter().filter(|(from, _)| text.contains(from)).collect();
    assert!(edits.len() >= 5);
    refused("everything", &edits, ur5(), &expected);
}

#[test]
fn missing_and_doubled_parts_are_named_with_their_line() {
    let parent = "<parent link=\"upper_arm_link\"/>\n    <child link=\"forearm_link\"/>";
    let inertial = "<link name=\"forearm_link\">";
    let second = "<link name=\"forearm_link\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" \
                  iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>";
    for (test, from, to, expected) in [
        (
            "two_inertial",
            inertial,
            second,
            "line 150: link `forearm_link`: <inertial>: expected one <inertial>: which of two counts cannot be known, found a second one; the first is on line 149",
        ),
        (
            "no_parent",
            parent,
            "<child link=\"forearm_link\"/>",
            "line 140: joint `elbow_joint`: expected an element <parent>, found none",
        ),
        (
            "no_child_link",
            "<child link=\"forearm_link\"/>",
            "<child/>",
            "line 142: joint `elbow_joint`: <child>: expected the attribute `link`, found none",
        ),
        (
            "no_type",
            "<joint name=\"elbow_joint\" type=\"revolute\">",
            "<joint name=\"elbow_joint\">",
            "line 140: joint `elbow_joint`: expected a type of revolute, ",
        ),
        (
            "no_name",
            "<joint name=\"elbow_joint\" type=\"revolute\">",
            "<joint type=\"revolute\">",
            "line 140: joint ``: expected the attribute `name`, found none",
        ),
        (
            "no_mass",
            "<mass value=\"2.33\"/>",
            "",
            "link `forearm_link`: <inertial>: expected an element <mass>, found none",
        ),
        (
            "no_ixy",
            FOREARM,
            r#"<inertia ixx="0.004" iyy="0.03" izz="0.03"/>"#,
            "line 153: link `forearm_link`: <inertia>: expected the attribute `ixy`, found none",
        ),
        (
            "origin",
            r#"<origin xyz="-0.425 0 0" rpy="0 0 0"/>"#,
            r#"<origin xyz="-0.425 0 0 0"/>"#,
            "line 143: joint `elbow_joint`: <origin>: expected xyz: 3 numbers with spaces between them, found `-0.425 0 0 0`",
        ),
    ] {
        refused(&format!("part_{test}"), &[(from, to)], ur5(), &[expected]);
    }
}

/// The text without what stands between two marks, wherever they are; only behind `after`.
fn without(after: &str, from: &str, to: &str) -> String {
    let text = std::fs::read_to_string(robot_file("ur5.urdf")).unwrap();
    let start = text.find(after).unwrap();
    let (mut kept, mut rest) = (text[..start].to_owned(), &text[start..]);
    while let Some(at) = rest.find(from) {
        kept += &rest[..at];
        rest = &rest[at + rest[at..].find(to).unwrap() + to.len()..];
    }
    kept + rest
}

#[test]
fn masses_are_needed_for_torques_and_missed_otherwise() {
    let text = without("<robot", "<inertial>", "</inertial>");
    let file = written("massless", text);
    let error = Chain::<6>::from_urdf(&file, ur5()).unwrap_err().to_string();
    for part in [
        "`shoulder_pan_joint` moves (shoulder_link)",
        "wrist_3_joint",
        "add an <inertial>",
        "`robot.actuators`",
    ] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let document = Document::read(&file).unwrap();
    Chain::<6>::from_document(&document, &by_motion()).unwrap();
    let remarks = remarks(&document, &by_motion()).unwrap();
    let texts: Vec<_> = remarks.iter().map(ToString::to_string).collect();
    assert!(
        texts
            .iter()
            .any(|text| text.contains("link `forearm_link`: it has a body and no <inertial>")),
        "{texts:?}"
    );
    assert!(texts.iter().any(|text| text.contains("`wrist_3_joint` moves")), "{texts:?}");

    let text = without("<link name=\"wrist_3_link\">", "<inertial>", "</inertial>");
    let error =
        Chain::<6>::from_urdf(written("massless_wrist", text), ur5()).unwrap_err().to_string();
    assert!(
        error.contains("what joint `wrist_3_joint` moves (wrist_3_link")
            && !error.contains("wrist_2"),
        "{error}"
    );

    // A frame between two joints has no mass, and needs none: something beyond it has.
    let frame = [(
        "<joint name=\"elbow_joint\" type=\"revolute\">\n    <parent link=\"upper_arm_link\"/>",
        "<link name=\"frame\"/>\
          <joint name=\"extra\" type=\"revolute\"><parent link=\"upper_arm_link\"/><child link=\"frame\"/><limit lower=\"-1\" \
          upper=\"1\" velocity=\"1\" effort=\"1\"/></joint><joint name=\"elbow_joint\" type=\"revolute\">\n    <parent link=\"frame\"/>",
    )];
    assert_eq!(count_joints(edited("frame", &frame), ur5()).unwrap(), 7);
}

#[test]
fn what_looks_wrong_is_remarked_on() {
    let g_mm2 = r#"<inertia ixx="4194000" ixy="0" ixz="0" iyy="4200000" iyz="0" izz="4200000"/>"#;
    let triangle = r#"<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="5"/>"#;
    let swapped = r#"<inertia ixx="0.032" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/>"#;
    for (test, from, to, expected) in [
        (
            "g_mm2",
            FOREARM,
            g_mm2,
            "line 149: link `forearm_link`: an inertia of 4200000 kg m² for 2.33 kg",
        ),
        (
            "triangle",
            FOREARM,
            triangle,
            "no body has the principal moments 0.001, 0.001 and 5 kg m²",
        ),
        (
            "axes",
            FOREARM,
            swapped,
            "link `forearm_link`: about the long axis of its collision shape it has its largest",
        ),
        (
            "degrees",
            ELBOW,
            r#"<limit lower="-180" upper="180" effort="150" velocity="3"/>"#,
            "line 145: joint `elbow_joint`: position limits [-180.0, 180.0] look like degrees",
        ),
        (
            "degrees_s",
            ELBOW,
            r#"<limit lower="-3" upper="3" effort="150" velocity="180"/>"#,
            "a velocity limit of 180 looks like degrees/s",
        ),
        (
            "far",
            ELBOW,
            r#"<limit lower="-1e30" upper="1e30" effort="150" velocity="3"/>"#,
            "position limits [-1e30, 1e30] are taken as none",
        ),
    ] {
        let remarks = remarked(&format!("odd_{test}"), &[(from, to)], &ur5());
        assert!(remarks.contains(expected), "{test}: {remarks}");
    }
    let far = chain(
        "odd_far",
        &[(ELBOW, r#"<limit lower="-1e30" upper="inf" effort="150" velocity="3"/>"#)],
        ur5(),
    )
    .unwrap();
    assert_eq!(
        (far.position_lower()[2], far.position_upper()[2]),
        (f64::NEG_INFINITY, f64::INFINITY)
    );
    let given = LimitOverride { position: Some([-3.0, 3.0]), velocity: Some(3.0), effort: None };
    let degrees = [(ELBOW, r#"<limit lower="-180" upper="180" effort="150" velocity="180"/>"#)];
    assert_eq!(remarked("odd_given", &degrees, &limited("elbow_joint", given)), "");
}

#[test]
fn branches_are_listed_at_once_and_held_where_it_is_said() {
    let fingers = [("</robot>", FINGERS)];
    let expected = "expected joints beside the path from `base` to `suction_tip` to be held, found 1 that is not: \
                    `finger_joint` (prismatic); set `robot.held_joints: {\"finger_joint\": 0.01}`";
    refused("fingers", &fingers, ur5(), &[expected]);
    for (at, follower) in [(0.01, -0.021), (0.02, -0.041)] {
        let chain = chain("held", &fingers, holding(&[("finger_joint", at)])).unwrap();
        let links = chain.moving_links();
        let place = |name: &str| {
            let link = links.iter().position(|(link, _)| link == name).unwrap();
            chain.in_joint_frame(link, DVec3::ZERO).unwrap()
        };
        // The tip's y axis, by what the finger moves along it.
        let (tip, first, second) = (place("suction_tip"), place("f1"), place("f2"));
        assert!(((first - tip).length() - at).abs() < 1e-12);
        assert!(((second - tip) - (first - tip) * (follower / at)).length() < 1e-12);
    }
    let outside = "held joint `finger_joint`: expected a position from 0.01 to 0.05, found 0";
    refused(
        "outside",
        &fingers,
        holding(&[("finger_joint", 0.0)]),
        &[outside, "`robot.held_joints`"],
    );
    refused("beyond", &fingers, holding(&[("finger_joint", 0.06)]), &["found 0.06"]);
    refused("nan", &fingers, holding(&[("finger_joint", f64::NAN)]), &["found NaN"]);
    // The follower alone: the joint that it follows is still free.
    refused(
        "follower",
        &fingers,
        holding(&[("finger_mimic", 0.02)]),
        &["`finger_joint` (prismatic)"],
    );
    refused("fixed", &[], holding(&[("suction_joint", 0.5)]), &["held joint `suction_joint`"]);
    let both = holding(&[("finger_joint", 0.02), ("finger_mimic", 0.03)]);
    chain("both", &fingers, both).unwrap();
    let head = "<link name=\"head\"/><joint name=\"neck\" type=\"continuous\"><parent link=\"base\"/><child \
                link=\"head\"/></joint><link name=\"cloud\"/><joint name=\"drift\" type=\"floating\"><parent \
                link=\"head\"/><child link=\"cloud\"/></joint></robot>";
    let fingers = FINGERS.replace("</robot>", head);
    let expected = [
        "found 3 that are not",
        "`neck` (continuous)",
        "`drift` (floating)",
        "{\"finger_joint\": 0.01, \"neck\": 0.0, \"drift\": 0.0}",
    ];
    refused("three", &[("</robot>", &fingers)], ur5(), &expected);
    let held = holding(&[("finger_joint", 0.02), ("neck", 7.0), ("drift", 0.0)]);
    chain("three_held", &[("</robot>", &fingers)], held).unwrap();
    let held = holding(&[("finger_joint", 0.02), ("neck", 7.0), ("drift", 0.1)]);
    refused("drifting", &[("</robot>", &fingers)], held, &["held joint `drift`"]);
}

#[test]
fn a_held_joint_turns_what_is_behind_it() {
    // The wrist held at a right angle is the same as the arm with the wrist there.
    let held =
        Chain::<5>::from_urdf(edited("wrist", &[]), holding(&[("wrist_3_joint", 0.7)])).unwrap();
    let whole = Chain::<6>::from_urdf(edited("wrist", &[]), ur5()).unwrap();
    let mut five = tprmp_robot::Kinematics::new();
    let mut six = tprmp_robot::Kinematics::new();
    let q = [0.3, -1.0, 1.2, -0.4, 0.9, 0.7];
    tprmp_robot::forward_kinematics(
        &held,
        &nalgebra::SVector::from_column_slice(&q[..5]),
        &mut five,
    );
    tprmp_robot::forward_kinematics(&whole, &nalgebra::SVector::from_column_slice(&q), &mut six);
    let (five, six) = (five.tool_pose(), six.tool_pose());
    assert!((five.position - six.position).length() < 1e-12);
    assert!(five.orientation.dot(six.orientation).abs() > 1.0 - 1e-12);
}

#[test]
fn followers_that_follow_each_other_come_to_an_end() {
    let ring = "<link name=\"a\"/><link name=\"b\"/><joint name=\"ja\" type=\"revolute\"><parent link=\"base\"/><child \
                link=\"a\"/><mimic joint=\"jb\"/></joint><joint name=\"jb\" type=\"revolute\"><parent link=\"base\"/><child \
                link=\"b\"/><mimic joint=\"ja\"/></joint></robot>";
    refused("ring", &[("</robot>", ring)], ur5(), &["`ja` (mimic), `jb` (mimic)"]);
    chain("ring_held", &[("</robot>", ring)], holding(&[("ja", 0.1)])).unwrap();
    let lost = ring.replace("\"ja\"/></joint></robot>", "\"nobody\"/></joint></robot>");
    refused("lost", &[("</robot>", &lost)], ur5(), &["(mimic)"]);
}
