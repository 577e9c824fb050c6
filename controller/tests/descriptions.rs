//! What `controller check` and `controller run` make of the robot descriptions of others.

use std::path::{Path, PathBuf};
use std::process::Command;

use tprmp_controller::startup;
use tprmp_model::controller_config;

const ELBOW: &str = r#"<limit lower="-3.14159265359" upper="3.14159265359" velocity="3.14159265359" effort="150"/>"#;
const ELBOW_ORIGIN: &str = r#"<origin xyz="-0.425 0 0" rpy="0 0 0"/>"#;
const SERVO: &str = "PositionServo((lag_s: 0.1, reference_time_constant_s: 0.5)),";

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A folder with nothing in it, for a PATH without programs.
fn empty() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("no_programs");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// The programs of the environment that `make venv` sets up.
fn venv() -> PathBuf {
    let folder = repository().join("target/venv/bin");
    assert!(folder.join("xacro").exists(), "no xacro in {}: run `make venv`", folder.display());
    folder
}

/// A configuration of the UR5 and its description, both edited.
struct Files {
    config: PathBuf,
    urdf: PathBuf,
}

/// A layer of the UR5 on what all arms have in common, as in `config/controllers`.
fn layer() -> String {
    std::fs::read_to_string(repository().join("controller/model/tests/data/layer.ron")).unwrap()
}

fn files(test: &str, of_urdf: &[(&str, &str)], of_config: &[(&str, &str)]) -> Files {
    let edited = |mut text: String, edits: &[(&str, &str)]| {
        for (from, to) in edits {
            assert!(text.contains(from), "nothing to edit: {from}");
            text = text.replacen(from, to, 1);
        }
        text
    };
    let place = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let urdf = place.join(format!("description_{test}.urdf"));
    let config = place.join(format!("description_{test}.ron"));
    std::fs::write(
        &urdf,
        edited(
            std::fs::read_to_string(repository().join("config/robots/ur5.urdf")).unwrap(),
            of_urdf,
        ),
    )
    .unwrap();
    let base = repository().join("config/controllers/base/arm_pick.ron");
    let text = edited(layer(), of_config)
        .replace("base/arm_pick.ron", &base.display().to_string())
        .replace("../robots/ur5.urdf", &urdf.display().to_string());
    std::fs::write(&config, text).unwrap();
    Files { config, urdf }
}

/// With actuators that follow positions.
fn servo(text: &str) -> (String, String) {
    let at = text.find("Torque((").unwrap();
    let end = at + text[at..].find(")),").unwrap() + 3;
    (text[at..end].to_owned(), SERVO.to_owned())
}

/// Whether `controller check` succeeds, and what it writes.
fn check(files: &Files, programs: &Path) -> (bool, String) {
    let mut check = Command::new(env!("CARGO_BIN_EXE_controller"));
    let output = check.arg("check").arg(&files.config).env("PATH", programs).output().unwrap();
    let text = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    (output.status.success(), text)
}

fn says(found: (bool, String), success: bool, parts: &[&str]) {
    assert_eq!(found.0, success, "{}", found.1);
    for part in parts {
        assert!(found.1.contains(part), "`{part}` is missing in: {}", found.1);
    }
}

#[test]
fn limits_and_held_joints_come_from_the_configuration() {
    let finger = "<link name=\"f\"/><joint name=\"finger\" type=\"prismatic\"><parent link=\"suction_tip\"/><child \
                  link=\"f\"/><limit lower=\"0.01\" upper=\"0.05\" effort=\"1\" velocity=\"1\"/></joint></robot>";
    let urdf = [(ELBOW, ""), ("</robot>", finger)];
    says(
        check(&files("bare", &urdf, &[]), &empty()),
        false,
        &[
            "`robot.limits: {\"elbow_joint\": (position: Some((…, …)), velocity: Some(…), effort: Some(…))}`",
            "`robot.held_joints: {\"finger\": 0.01}`",
        ],
    );
    let keys = "control_points: None, held_joints: {\"finger\": 0.02}, limits: {\"elbow_joint\": (position: Some((-3.0, \
                3.0)), velocity: Some(3.0), effort: Some(150.0))},";
    let with = |keys: &str| files("given", &urdf, &[("control_points: None,", keys)]);
    says(check(&with(keys), &empty()), true, &["6 joints from `base` to `suction_tip`"]);
    for (from, to, expected) in [
        ("0.02", "0.5", "held joint `finger`: expected a position from 0.01 to 0.05, found 0.5"),
        ("0.02", "NaN", "robot.held_joints[\"finger\"]"),
        ("velocity: Some(3.0)", "velocity: Some(-3.0)", "robot.limits[\"elbow_joint\"].velocity"),
        ("-3.0, ", "9.0, ", "robot.limits[\"elbow_joint\"].position"),
        ("effort: Some(150.0)", "effort: None", "`elbow_joint` (line 140: effort)"),
        (", effort: Some(150.0)", "", "effort"),
        ("\"elbow_joint\"", "\"elbow\"", "key `robot.limits`: expected joints on the path"),
    ] {
        says(check(&with(&keys.replace(from, to)), &empty()), false, &[expected]);
    }
}

#[test]
fn an_arm_that_follows_positions_needs_no_efforts_and_no_masses() {
    let (torque, servo) = servo(&layer());
    let urdf = [
        (ELBOW, r#"<limit lower="-3" upper="3" velocity="3"/>"#),
        ("<mass value=\"0.2\"/>", "<mass value=\"0\"/>"),
    ];
    says(
        check(&files("torque", &urdf, &[]), &empty()),
        false,
        &["`elbow_joint` (line 145: effort)"],
    );
    says(check(&files("servo", &urdf, &[(&torque, &servo)]), &empty()), true, &[]);
}

#[test]
fn shapes_do_not_matter_where_nothing_is_kept_clear() {
    let urdf = [(r#"<cylinder radius="0.045" length="0.37"/>"#, "<torus/>")];
    let shape = [(r#"<cylinder radius="0.06" length="0.12"/>"#, "<torus/>")];
    let text = std::fs::read_to_string(repository().join("config/robots/ur5.urdf")).unwrap();
    assert!(urdf.iter().chain(&shape).any(|(from, _)| text.contains(from)));
    // The first is the drawn one, which is never judged.
    let both = |text: &str| text.replace(urdf[0].0, urdf[0].1);
    let files = files("shapes", &[], &[]);
    std::fs::write(&files.urdf, both(&text)).unwrap();
    says(check(&files, &empty()), false, &["<geometry>: expected one shape of", "forearm_link"]);
    let config = std::fs::read_to_string(&files.config).unwrap();
    let at = config.find("    collision: (").unwrap();
    let config = format!("{}    collision: None,\n    self_collision: None,\n)\n", &config[..at]);
    std::fs::write(&files.config, config).unwrap();
    says(check(&files, &empty()), true, &["nothing is kept clear"]);
}

#[test]
fn what_looks_wrong_is_no_reason_to_fail() {
    let degrees = r#"<limit lower="-180" upper="180" effort="150" velocity="180"/>"#;
    let expected = [
        "warn  robot",
        "description_degrees.urdf: line 145: joint `elbow_joint`",
        "look like degrees",
    ];
    says(check(&files("degrees", &[(ELBOW, degrees)], &[]), &empty()), true, &expected);
}

#[test]
fn xacro_is_expanded_by_check_and_by_nothing_that_moves_an_arm() {
    let long = (ELBOW_ORIGIN, r#"<origin xyz="${-0.4 - 0.025} 0 0" rpy="0 0 0"/>"#);
    let files_of = |test: &str, edits: &[(&str, &str)]| files(test, edits, &[]);
    let good = files_of("xacro", &[long]);
    let command = format!("xacro '{}' -o '", good.urdf.display());
    let expected = ["line 143", "${-0.4 - 0.025}", command.as_str(), "pip install xacro"];
    says(check(&good, &empty()), false, &expected);
    // It is judged to the end, and refused all the same: it has to be expanded for `run`.
    let judged =
        [&expected[..], &["6 joints from `base` to `suction_tip`", "shared memory"]].concat();
    says(check(&good, &venv()), false, &judged);
    let wrong = files_of(
        "xacro_wrong",
        &[long, (ELBOW, "<limit lower=\"${1 + 1}\" upper=\"1\" velocity=\"1\" effort=\"1\"/>")],
    );
    says(
        check(&wrong, &venv()),
        false,
        &["description_xacro_wrong.urdf, expanded by xacro: ", "found lower 2 and upper 1"],
    );
    let broken =
        files_of("xacro_broken", &[(ELBOW_ORIGIN, "<origin xyz=\"${no_such_name} 0 0\"/>")]);
    says(check(&broken, &venv()), false, &["expected a file that xacro expands", "no_such_name"]);
    let config = controller_config::read(&good.config).unwrap();
    let error = startup::robot::<6>(&good.config, &config).unwrap_err().to_string();
    assert!(expected.iter().all(|part| error.contains(part)), "{error}");
}
