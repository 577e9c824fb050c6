//! `controller cover`: from a vendor's meshes to a configuration that `controller check` accepts.

use std::path::PathBuf;
use std::process::Output;

use crate::common::{Place, file, program, root, run, text};

/// The iiwa of pybullet's data package, whose collision shapes are meshes.
fn iiwa() -> PathBuf {
    let pythons =
        std::fs::read_dir(root().join("target/venv/lib")).expect("`make venv` was run").flatten();
    let inside = "site-packages/pybullet_data/kuka_iiwa/model.urdf";
    pythons
        .map(|entry| entry.path().join(inside))
        .find(|path| path.exists())
        .expect("`make venv` was run")
}

fn cover(arguments: &[&str]) -> Output {
    run(program("controller").arg("cover").args(arguments))
}

fn check(config: &str) -> Output {
    run(program("controller").args(["check", config]))
}

#[test]
fn spheres_around_meshes_are_control_points_of_a_configuration() {
    let place = Place::new("cover-iiwa");
    let (urdf, out, page) = (iiwa(), place.path("points.ron"), place.path("links.html"));
    let arguments =
        [urdf.to_str().unwrap(), "--tool", "lbr_iiwa_link_7", "--out", &out, "--picture", &page];
    let output = cover(&arguments);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("lbr_iiwa_link_1") && said.contains("protrusion at most"), "{said}");
    assert!(std::fs::read_to_string(&page).unwrap().contains("<canvas"));
    let again = cover(&arguments);
    assert_eq!(again.status.code(), Some(1), "{}", text(&again));
    assert!(text(&again).contains("--force"), "{}", text(&again));
    let forced = cover(&[&arguments[..], &["--force"]].concat());
    assert_eq!(forced.status.code(), Some(0), "{}", text(&forced));
    // Without --out they go to standard output, and nothing else does.
    let printed = cover(&arguments[..3]);
    assert_eq!(String::from_utf8(printed.stdout).unwrap(), std::fs::read_to_string(&out).unwrap());

    let points = std::fs::read_to_string(&out).unwrap();
    let shipped =
        std::fs::read_to_string(file("config/controllers/base/iiwa_suction.ron")).unwrap();
    let (before, rest) = shipped.split_once("control_points: Some([").unwrap();
    let (_, after) = rest.split_once("]),").unwrap();
    let absolute = |text: &str| {
        text.replace("\"../../../target", &format!("\"{}", file("target")))
            .replace("not_kept_clear: [],", "")
    };
    let configured = |name: &str, exempt: &str| {
        let path = place.path(name);
        let keys = format!("not_kept_clear: [{exempt}],\ncontrol_points:\n{points},");
        std::fs::write(&path, absolute(before) + &keys + &absolute(after)).unwrap();
        path
    };
    // The suction tool of the configuration's URDF has shapes, and no spheres here.
    let refused = check(&configured("bare.ron", ""));
    let said = text(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    for part in [
        "bare.ron",
        "robot.control_points",
        "suction_tool",
        "not kept clear",
        "robot.not_kept_clear",
    ] {
        assert!(said.contains(part), "expected `{part}` in: {said}");
    }
    let accepted = check(&configured("exempt.ron", "\"suction_tool\""));
    let said = text(&accepted);
    assert_eq!(accepted.status.code(), Some(0), "{said}");
    assert!(said.contains("lbr_iiwa_link_4: "), "{said}");
    let line = "suction_tool: has collision shapes and no control points, not kept clear";
    assert!(said.contains(line), "{said}");
    let unknown = check(&configured("unknown.ron", "\"suction_toool\""));
    assert_eq!(unknown.status.code(), Some(1));
    assert!(text(&unknown).contains("suction_toool"), "{}", text(&unknown));
}

#[test]
fn a_link_without_its_mesh_is_told_as_not_kept_clear() {
    let place = Place::new("cover-missing");
    let urdf = place.path("arm.urdf");
    let link = |name: &str, shape: &str| {
        format!("<link name=\"{name}\"><collision><geometry>{shape}</geometry></collision></link>")
    };
    let joint = |name: &str, parent: &str, child: &str| {
        format!(
            "<joint name=\"{name}\" type=\"continuous\"><parent link=\"{parent}\"/><child link=\"{child}\"/></joint>"
        )
    };
    let robot = [
        "<robot name=\"arm\"><link name=\"base\"/>".to_owned(),
        link("upper", "<mesh filename=\"package://my_arm/upper.stl\"/>"),
        link("fore", "<mesh filename=\"fore.dae\"/>"),
        link("hand", "<sphere radius=\"0.05\"/>"),
        joint("j1", "base", "upper")
            + &joint("j2", "upper", "fore")
            + &joint("j3", "fore", "hand")
            + "</robot>",
    ];
    std::fs::write(&urdf, robot.concat()).unwrap();
    let output = cover(&[&urdf]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    for part in [
        "not kept clear: upper, fore",
        "--package my_arm=FOLDER",
        "fore.dae",
        "--exempt",
        "link: \"hand\"",
    ] {
        assert!(said.contains(part), "expected `{part}` in: {said}");
    }
    let one = cover(&[&urdf, "--exempt", "upper"]);
    assert_eq!(one.status.code(), Some(1), "{}", text(&one));
    assert!(text(&one).contains("not kept clear: fore;"), "{}", text(&one));
    let both = cover(&[&urdf, "--exempt", "upper", "--exempt", "fore"]);
    assert_eq!(both.status.code(), Some(0), "{}", text(&both));
    let unknown = cover(&[&urdf, "--exempt", "uper"]);
    assert_eq!(unknown.status.code(), Some(1));
    assert!(text(&unknown).contains("found `uper`"), "{}", text(&unknown));
    let package = cover(&[&urdf, "--package", "my_arm"]);
    assert_eq!(package.status.code(), Some(2));
    assert!(text(&package).contains("expected NAME=FOLDER"), "{}", text(&package));
}
