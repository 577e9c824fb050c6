//! Descriptions as they come from others: what the arm does not need is not judged, and what is wrong with the
//! rest is said at once, with its place and what to do.

use crate::common::robot_file;
use crate::common::variants::*;
use tprmp_robot::document::{Owner, Shape};
use tprmp_robot::{Document, count_joints, remarks};

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
