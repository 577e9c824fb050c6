//! Limits, masses and branches of descriptions as they come from others.

use crate::common::robot_file;
use crate::common::variants::*;
use glam::DVec3;
use tprmp_robot::{Chain, Document, LimitOverride, count_joints, remarks};

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
    let reversed = LimitOverride { position: Some([2.0, -1.0]), ..all };
    let expected = "joint `elbow_joint`: limit: expected lower < upper, found lower 2 and upper -1";
    refused("reversed", &[], limited("elbow_joint", reversed), &[expected]);
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
    let hard = r#"<limit lower="-3" upper="3" velocity="3" effort="150"/>"#;
    for (test, soft, expected) in [
        ("narrower", r#"soft_lower_limit="-2" soft_upper_limit="1.5""#, [-2.0, 1.5]),
        ("wider", r#"soft_lower_limit="-9" soft_upper_limit="9""#, [-3.0, 3.0]),
        ("one_side", r#"soft_lower_limit="-2" soft_upper_limit="9""#, [-2.0, 3.0]),
        ("zeros", r#"soft_lower_limit="0" soft_upper_limit="0""#, [-3.0, 3.0]),
        ("none", r#"k_position="30""#, [-3.0, 3.0]),
    ] {
        let to = format!("{hard}<safety_controller k_velocity=\"1\" {soft}/>");
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
fn limits_in_other_units_and_placeholders_are_remarked_on() {
    for (velocity, expected) in [
        ("100", "a velocity limit of 100 looks like degrees/s, not rad/s"),
        ("1e4", "a velocity limit of 10000 looks like a placeholder, no limit"),
    ] {
        let limit = format!(r#"<limit lower="-3" upper="3" effort="150" velocity="{velocity}"/>"#);
        let remarks = remarked("odd_turning", &[(ELBOW, &limit)], &ur5());
        assert!(remarks.contains(expected), "{remarks}");
    }
    let sliding = |test: &str, limit: &str| {
        let revolute = "<joint name=\"elbow_joint\" type=\"revolute\">";
        let prismatic = revolute.replace("revolute", "prismatic");
        remarked(&format!("odd_{test}"), &[(revolute, &prismatic), (ELBOW, limit)], &ur5())
    };
    for (limit, expected) in [
        (
            r#"<limit lower="0" upper="500" effort="150" velocity="3"/>"#,
            "line 145: joint `elbow_joint`: position limits [0.0, 500.0] look like millimetres, not m",
        ),
        (
            r#"<limit lower="0" upper="2" effort="150" velocity="250"/>"#,
            "line 145: joint `elbow_joint`: a velocity limit of 250 looks like mm/s, not m/s",
        ),
        (
            r#"<limit lower="0" upper="2" effort="150" velocity="20000"/>"#,
            "a velocity limit of 20000 looks like a placeholder",
        ),
    ] {
        let remarks = sliding("sliding", limit);
        assert!(remarks.contains(expected), "{remarks}");
    }
    let plausible = r#"<limit lower="-20" upper="20" effort="150" velocity="50"/>"#;
    assert_eq!(sliding("sliding_far", plausible), "");
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
