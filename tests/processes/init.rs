//! `controller init`: from a URDF to a configuration that `controller check` accepts, and an arm that follows a skill.

use std::process::Output;

use crate::common::{Place, file, program, run, text};

fn init(arguments: &[&str]) -> Output {
    run(program("controller").arg("init").args(arguments))
}

fn read(path: &str) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The URDF of the UR5 with some texts replaced, in the folder of a test.
fn edited(place: &Place, edits: &[(&str, &str)]) -> String {
    let mut urdf = read(&file("config/robots/ur5.urdf"));
    for (from, to) in edits {
        assert!(urdf.contains(from), "{from}");
        urdf = urdf.replace(from, to);
    }
    let path = place.path("arm.urdf");
    std::fs::write(&path, urdf).unwrap();
    path
}

#[test]
fn own_arms_that_init_configures_follow_a_skill_to_four_places() {
    let place = Place::new("init-arms");
    let mut arms = program("arms");
    arms.args([&file("tests/arms/arms.ron"), "--out", &place.path("")]);
    arms.args(["--root", &format!("own={}", file("config"))]);
    arms.args(["--controller", program("controller").get_program().to_str().unwrap()]);
    for skill in ["pick", "place", "planar"] {
        let model = place.path(&format!("{skill}.ron"));
        let path = file(&format!("config/skills/{skill}.ron"));
        let trained = run(program("learner").args(["train", &path, "--out", &model]));
        assert!(trained.status.success(), "{}", text(&trained));
        arms.args(["--model", &format!("{skill}={model}")]);
    }
    for name in ["fr3", "scara", "planar"] {
        arms.args(["--only", name]);
    }
    let output = run(&mut arms);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(text(&output).contains("3 of 3 arms"), "{}", text(&output));
}

#[test]
fn the_shipped_arms_are_configured_by_init() {
    let place = Place::new("init-shipped");
    let root = file("");
    let fitted =
        ["panda_suction", "iiwa_suction"].map(|arm| format!("{root}/target/robots/{arm}.urdf"));
    for urdf in [file("config/robots/ur5.urdf")].into_iter().chain(fitted) {
        let out = place.path("out");
        let asked = "--tool suction_tip --task pick --interface torque --hulls --out";
        let mut arguments: Vec<_> = asked.split(' ').collect();
        arguments.extend([out.as_str()]);
        let made = init(&[&[urdf.as_str()], &arguments[..]].concat());
        assert!(made.status.success(), "`make fitted` writes the arms: {}", text(&made));
        let name = std::path::Path::new(&urdf).with_extension("ron");
        let name = name.file_name().unwrap().to_str().unwrap();
        // All but the way to the description, which depends on the folder.
        let keys = |path: String| {
            let text = read(&path);
            text.lines().filter(|line| !line.contains(" urdf: ")).collect::<Vec<_>>().join("\n")
        };
        let shipped = keys(file(&format!("config/controllers/base/{name}")));
        assert!(
            keys(format!("{out}/{name}")) == shipped,
            "{name}: `make configurations` writes it anew"
        );
    }
}

#[test]
fn a_configuration_is_whole_and_the_same_each_time_and_replaces_nothing() {
    let place = Place::new("init-ur5");
    let (urdf, out) = (file("config/robots/ur5.urdf"), place.path("out"));
    let made = init(&[&urdf, "--out", &out, "--interface", "torque", "--task", "pick"]);
    assert!(made.status.success(), "{}", text(&made));
    let config = format!("{out}/ur5.ron");
    let written = read(&config);
    assert!(!written.contains("base:"), "it needs no other file");
    for key in ["Torque((", "approach: (", "lift: (", "start_frame: Tool", "real_time: ("] {
        assert!(written.contains(key), "{key}");
    }
    let checked = run(program("controller").args(["check", &config]));
    assert!(checked.status.success(), "{}", text(&checked));
    let again = init(&[&urdf, "--out", &out]);
    assert_eq!(again.status.code(), Some(1), "{}", text(&again));
    assert!(text(&again).contains("--force"), "{}", text(&again));
    assert_eq!(read(&config), written);
    let forced =
        init(&[&urdf, "--out", &out, "--interface", "torque", "--task", "pick", "--force"]);
    assert!(forced.status.success(), "{}", text(&forced));
    assert_eq!(read(&config), written);
}

#[test]
fn what_a_description_lacks_is_a_default_that_is_told() {
    let place = Place::new("init-lacks");
    let urdf = edited(
        &place,
        &[
            (
                r#"lower="-6.28318530718" upper="6.28318530718" velocity="3.14159265359" effort="28""#,
                r#"velocity="3.1" effort="28""#,
            ),
            (r#"velocity="3.14159265359" effort="150""#, r#"velocity="0" effort="1""#),
        ],
    );
    let out = place.path("out");
    let made = init(&[&urdf, "--out", &out]);
    let said = text(&made);
    assert!(made.status.success(), "{said}");
    assert!(said.contains("look  joint `wrist_1_joint`: a default in place of"), "{said}");
    let written = read(&format!("{out}/arm.ron"));
    assert!(
        written.contains(r#""shoulder_pan_joint": (position: None, velocity: Some(1.0)"#),
        "{written}"
    );
    assert!(written.contains("Some((-3.141592653589793, 3.141592653589793))"), "{written}");
    let checked = run(program("controller").args(["check", &format!("{out}/arm.ron")]));
    assert!(checked.status.success(), "{}", text(&checked));
}

#[test]
fn joints_beside_the_arm_are_held_and_links_without_their_mesh_are_not_kept_clear() {
    let place = Place::new("init-gripper");
    let urdf = edited(
        &place,
        &[(
            "</robot>",
            r#"<link name="hand"><collision><geometry><mesh filename="package://none/hand.stl"/></geometry></collision></link>
            <joint name="hand_mount" type="fixed"><parent link="wrist_3_link"/><child link="hand"/></joint>
            <link name="left"/><joint name="left_finger" type="prismatic"><parent link="hand"/><child link="left"/>
            <axis xyz="1 0 0"/><limit lower="0.01" upper="0.05" effort="1" velocity="1"/></joint>
            <link name="right"/><joint name="right_finger" type="prismatic"><parent link="hand"/><child link="right"/>
            <axis xyz="1 0 0"/><limit lower="0.01" upper="0.05" effort="1" velocity="1"/><mimic joint="left_finger"/></joint>
            </robot>"#,
        )],
    );
    let out = place.path("out");
    let made = init(&[&urdf, "--out", &out]);
    let said = text(&made);
    assert!(made.status.success(), "{said}");
    assert!(said.contains("held beside the arm: `left_finger` at 0.03"), "{said}");
    assert!(said.contains("look  link `hand` is not kept clear"), "{said}");
    let config = format!("{out}/arm.ron");
    let checked = run(program("controller").args(["check", &config]));
    assert_eq!(checked.status.code(), Some(1), "{}", text(&checked));
    assert!(text(&checked).contains("not_kept_clear"), "{}", text(&checked));
    let exempt = read(&config).replace("not_kept_clear: []", r#"not_kept_clear: ["hand"]"#);
    std::fs::write(&config, exempt).unwrap();
    let checked = run(program("controller").args(["check", &config]));
    assert!(checked.status.success(), "{}", text(&checked));
}

#[test]
fn a_taught_tool_that_the_arm_does_not_have_is_put_at_its_flange() {
    let place = Place::new("init-tool");
    let model = place.path("pick.ron");
    let skill = file("config/skills/pick.ron");
    let trained = run(program("learner").args(["train", &skill, "--out", &model]));
    assert!(trained.status.success(), "{}", text(&trained));
    let out = place.path("out");
    let urdf = edited(&place, &[("suction_tip", "nozzle")]);
    let made = init(&[&urdf, "--tool", "nozzle", "--model", &model, "--out", &out]);
    let said = text(&made);
    assert!(made.status.success(), "{said}");
    assert!(said.contains("look  the model's tool `suction_tip` is put at `nozzle`"), "{said}");
    let config = format!("{out}/arm.ron");
    assert!(read(&config).contains(r#"tool_offset: Some((frame: "suction_tip""#));
    let checked = run(program("controller").args(["check", &config, "--model", &model]));
    assert!(checked.status.success(), "{}", text(&checked));
}

#[test]
fn spheres_limits_and_postures_of_xrdf_and_srdf_are_used() {
    let place = Place::new("init-xrdf");
    let joints = "shoulder_pan_joint, shoulder_lift_joint, elbow_joint, wrist_1_joint, wrist_2_joint, wrist_3_joint";
    let xrdf = format!(
        "format: xrdf\nformat_version: 1.0\ncspace: {{joint_names: [{joints}], acceleration_limits: [1, 2, 3, 4, 5, 6]}}\n\
         tool_frames: [suction_tip]\ncollision: {{geometry: g}}\n\
         geometry: {{g: {{spheres: {{forearm_link: [{{center: [-0.2, 0.0, 0.0], radius: 0.07}}]}}}}}}\n"
    );
    let srdf = r#"<robot name="ur5"><group_state name="home" group="arm">
        <joint name="shoulder_pan_joint" value="0.1"/><joint name="shoulder_lift_joint" value="-1.2"/>
        <joint name="elbow_joint" value="1.3"/><joint name="wrist_1_joint" value="-1.6"/>
        <joint name="wrist_2_joint" value="-1.5"/><joint name="wrist_3_joint" value="0.2"/></group_state></robot>"#;
    let (xrdf_path, srdf_path) = (place.path("a.xrdf"), place.path("a.srdf"));
    std::fs::write(&xrdf_path, xrdf).unwrap();
    std::fs::write(&srdf_path, srdf).unwrap();
    let (urdf, out) = (file("config/robots/ur5.urdf"), place.path("out"));
    let made = init(&[&urdf, "--xrdf", &xrdf_path, "--srdf", &srdf_path, "--out", &out]);
    assert!(made.status.success(), "{}", text(&made));
    let written = read(&format!("{out}/ur5.ron"));
    assert!(written.contains("acceleration_max: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]"), "{written}");
    assert!(written.contains("[0.1, -1.2, 1.3, -1.6, -1.5, 0.2]"), "{written}");
    assert!(written.contains("position_m: (-0.2, 0.0, 0.0), radius_m: 0.0700"), "{written}");
}

#[test]
fn what_is_no_arm_is_refused_by_name() {
    let place = Place::new("init-wrong");
    let (urdf, out) = (file("config/robots/ur5.urdf"), place.path("out"));
    let second = (1..=5).fold(
        r#"<link name="l0"/><joint name="j0" type="fixed"><parent link="base_link"/><child link="l0"/></joint>"#.to_owned(),
        |text, i| {
            let from = i - 1;
            format!(
                r#"{text}<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="l{from}"/><child link="l{i}"/>
                <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"#
            )
        },
    );
    let two = edited(&place, &[("</robot>", &format!("{second}</robot>"))]);
    let cases = [
        (vec![urdf.as_str(), "--tool", "nose", "--out", &out], "--tool: expected one of its links"),
        (vec![two.as_str(), "--out", &out], "expected one arm, found 2"),
        (vec!["nothing.urdf", "--out", &out], "nothing.urdf"),
        (
            vec![urdf.as_str(), "--srdf", urdf.as_str(), "--base", "wrist_3_link", "--out", &out],
            "nothing moves",
        ),
    ];
    for (arguments, expected) in cases {
        let output = init(&arguments);
        let said = text(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(expected), "{expected}: {said}");
        assert!(!std::path::Path::new(&out).exists(), "nothing is written: {said}");
    }
}

#[test]
fn what_is_wrong_with_a_file_is_told_and_nothing_is_written() {
    let place = Place::new("init-faults");
    let elbow =
        r#"lower="-3.14159265359" upper="3.14159265359" velocity="3.14159265359" effort="150""#;
    let twice = r#"<joint name="again" type="fixed"><parent link="base"/><child link="forearm_link"/></joint></robot>"#;
    let joints = "shoulder_pan_joint, shoulder_lift_joint, elbow_joint, wrist_1_joint, wrist_2_joint, wrist_3_joint";
    let xrdf = |joints: &str, more: &str| {
        format!("format: xrdf\nformat_version: 1.0\ncspace: {{joint_names: [{joints}]}}\n{more}\n")
    };
    let srdf = |at: &str| {
        format!(
            r#"<robot name="ur5"><group_state name="home" group="arm"><joint name="elbow_joint" value="{at}"/></group_state></robot>"#
        )
    };
    let of_urdf = |from: &str, to: &str| ("--force", "", (from.to_owned(), to.to_owned()));
    let none = || ("<robot".to_owned(), "<robot".to_owned());
    let cases = [
        (of_urdf(elbow, &elbow.replace("lower=\"-", "lower=\"")), "lower < upper"),
        (of_urdf(elbow, &elbow.replace("lower=\"-3.14159265359", "lower=\"nan")), "finite number"),
        (of_urdf(elbow, &elbow.replace("velocity=\"", "velocity=\"-")), "positive number of rad/s"),
        (of_urdf(elbow, &elbow.replace("-3.14159265359", "3.1415")), "`elbow_joint` can move by"),
        (of_urdf("</robot>", twice), "`forearm_link` is the child of two joints"),
        (("--xrdf", &*xrdf(&joints.replace("wrist_3", "wrist_4"), ""), none()), "`wrist_4_joint`"),
        (("--xrdf", &*xrdf(joints, "modifiers: [set_base_frame: foot]"), none()), "found `foot`"),
        (
            ("--xrdf", &*xrdf(joints, "default_joint_positions: {elbow_joint: .inf}"), none()),
            "finite number",
        ),
        (("--srdf", &*srdf("nan"), none()), "`home`, joint `elbow_joint`"),
        (
            (
                "--srdf",
                "<robot><group name=\"a\"><chain base_link=\"b\" tip_link=\"hand\"/></group></robot>",
                none(),
            ),
            "found `hand`",
        ),
    ];
    let (other, out) = (place.path("other"), place.path("out"));
    for ((option, content, (from, to)), expected) in cases {
        std::fs::write(&other, content).unwrap();
        let urdf = edited(&place, &[(from.as_str(), to.as_str())]);
        let mut arguments = vec![urdf.as_str(), "--out", &out, option];
        arguments.extend((!content.is_empty()).then_some(other.as_str()));
        let output = init(&arguments);
        let said = text(&output);
        assert_eq!(output.status.code(), Some(1), "{expected}: {said}");
        assert!(said.contains(expected), "{expected}: {said}");
        let left = std::fs::read_dir(&out).map_or(0, Iterator::count);
        assert_eq!(left, 0, "nothing is written: {said}");
    }
}

#[test]
fn where_the_arm_is_mounted_and_what_stands_beside_it_is_seen() {
    let place = Place::new("init-mounted");
    let body = r#"<link name="torso"><collision><geometry><box size="0.3 0.3 1"/></geometry></collision></link>
        <joint name="hangs" type="fixed"><origin xyz="0.2 0 1" rpy="3.141592653589793 0 0"/>
        <parent link="torso"/><child link="base"/></joint></robot>"#;
    let payload = "payload: Some((mass_kg: 60.0, centre_m: (0.0, 0.0, 0.05)))";
    let urdf = edited(&place, &[("</robot>", body)]);
    let out = place.path("out");
    let made = init(&[&urdf, "--base", "base", "--out", &out]);
    let said = text(&made);
    assert!(made.status.success(), "{said}");
    assert!(said.contains("look  1 links have shapes and do not move with the arm"), "{said}");
    assert!(said.contains("`torso`") && said.contains("mounted turned"), "{said}");
    let config = format!("{out}/arm.ron");
    let written = read(&config);
    assert!(written.contains("gravity_m_s2: (0.0, 0.0, 9.81)"), "{written}");
    assert!(!written.contains("obstacle: HalfSpace"), "there is no ground");
    std::fs::write(&config, written.replace("payload: None", payload)).unwrap();
    let checked = text(&run(program("controller").args(["check", &config])));
    assert!(
        checked.contains("warn  robot            joint `elbow_joint`: to hold the arm"),
        "{checked}"
    );
}

#[test]
fn a_tool_that_points_elsewhere_is_told_with_the_transform_that_is_missing() {
    let place = Place::new("init-axis");
    let model = place.path("pick.ron");
    let skill = file("config/skills/pick.ron");
    let trained = run(program("learner").args(["train", &skill, "--out", &model]));
    assert!(trained.status.success(), "{}", text(&trained));
    let layer = |name: &str, offset: &str| {
        let path = place.path(name);
        let base = file("config/controllers/ur5_pick.ron");
        let text = read(&base)
            .replace("\"base/", &format!("\"{}/", file("config/controllers/base")))
            .replace("robot: (", &format!("robot: (tool_offset: {offset},"));
        std::fs::write(&path, text).unwrap();
        text_of_check(&path, &model)
    };
    let turned = r#"Some((frame: "suction_tip", position_m: (0.0, 0.0, 0.01), quaternion_wxyz: (0.7071068, 0.7071068, 0.0, 0.0)))"#;
    let said = layer("turned.ron", turned);
    assert!(said.contains("a fixed transform is missing"), "{said}");
    let (_, rest) = said.split_once("`robot.tool_offset: ").unwrap();
    let (proposed, _) = rest.split_once('`').unwrap();
    let mended = layer("mended.ron", proposed);
    assert!(!mended.contains("a fixed transform is missing"), "{mended}");
}

fn text_of_check(config: &str, model: &str) -> String {
    let checked = run(program("controller").args(["check", config, "--model", model]));
    assert!(checked.status.success(), "{}", text(&checked));
    text(&checked)
}
