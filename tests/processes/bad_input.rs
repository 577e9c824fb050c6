//! Bad input to the controller: a clear error, an exit code that is not zero, and nothing moved:
//! no service of the instance was ever opened.

use crate::common::{Place, file, program, run, text};

struct Case {
    place: Place,
    model: String,
}

impl Case {
    fn new(test: &str, skill: &str) -> Self {
        let place = Place::new(test);
        let model = place.train(skill);
        Self { place, model }
    }

    /// Starts the controller and expects it to refuse, saying all of `expected`.
    fn refused(&self, config: &str, model: &str, expected: &[&str]) {
        let output = run(program("controller").args([
            "run",
            config,
            "--model",
            model,
            "--instance",
            &self.place.instance,
        ]));
        let said = text(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        for part in expected {
            assert!(said.contains(part), "expected `{part}` in: {said}");
        }
        assert!(self.place.leftovers().is_empty());
    }

    /// A copy of the pick's configuration and robot with one text replaced.
    fn edited(&self, path: &str, from: &str, to: &str) -> String {
        self.place.edited(path, &[(from, to)])
    }

    fn damaged(&self, edit: impl Fn(String) -> String) -> String {
        let copy = self.place.path("damaged.model.ron");
        let text = std::fs::read_to_string(&self.model).unwrap();
        let damaged = edit(text.clone());
        assert!(damaged != text, "nothing was damaged");
        std::fs::write(&copy, damaged).unwrap();
        copy
    }
}

const PICK: &str = "config/controllers/ur5_pick.ron";

#[test]
fn a_wrong_model_is_refused() {
    let case = Case::new("wrong-model", "planar");
    let config = file("config/controllers/planar.ron");
    case.refused(&config, "no-such-file.ron", &["no-such-file.ron", "cannot be read"]);
    let truncated = case.damaged(|t| t[..t.len() / 2].into());
    case.refused(&config, &truncated, &["damaged.model.ron", "truncated"]);
    let corrupted = case.damaged(|t| t.replacen("damping_1_s: 8", "damping_1_s: 9", 1));
    case.refused(&config, &corrupted, &["checksum"]);
    let other = case.damaged(|t| t.replacen("tprmp-model/7", "tprmp-model/999", 1));
    case.refused(&config, &other, &["schema", "tprmp-model/7", "tprmp-model/999"]);
}

#[test]
fn a_model_without_its_certificate_is_refused_by_file_key_and_failure() {
    let place = Place::new("uncertified");
    let skill = file("config/skills/planar_thesis.ron");
    let model = place.train_file(&skill, &["--allow-uncertified"]);
    let said = text(&run(program("learner").args(["inspect", &model])));
    let failure = said.lines().find_map(|line| line.trim().strip_prefix("failed    ")).unwrap();
    let config = file("config/controllers/planar.ron");
    let check = run(program("controller").args(["check", &config, "--model", &model]));
    assert!(check.status.success(), "{}", text(&check));
    let line = format!("lack  certificate      {failure}");
    assert!(text(&check).contains(&line), "{}", text(&check));
    let case = Case { place, model };
    case.refused(
        &config,
        &case.model,
        &["planar_thesis.model.ron", "certificate.failures", failure, "--allow-uncertified"],
    );
}

#[test]
fn a_model_of_another_robot_is_refused() {
    let case = Case::new("other-robot", "planar");
    case.refused(&file(PICK), &case.model, &["tool_frame", "`point`", "`suction_tip`"]);
}

#[test]
fn a_wrong_configuration_is_refused() {
    let case = Case::new("wrong-config", "planar");
    let config = "config/controllers/planar.ron";
    case.refused("no-such-config.ron", &case.model, &["no-such-config.ron", "cannot be read"]);
    let missing = case.edited(config, "fade_in_s: ", "// fade_in_s: ");
    case.refused(&missing, &case.model, &["planar.ron", "fade_in_s"]);
    let unknown = case.edited(config, "period_ns: ", "period_ms: ");
    case.refused(&unknown, &case.model, &["period_ms", "period_ns"]);
    let latching = case.edited(config, "\"StateUnbelievable\"", "\"StateUnbelievabel\"");
    let expected = ["supervision.latching", "StateUnbelievable", "StateUnbelievabel"];
    case.refused(&latching, &case.model, &expected);
    let checked = run(program("controller").args(["check", &latching]));
    assert_eq!(checked.status.code(), Some(1), "{}", text(&checked));
    assert!(expected.iter().all(|part| text(&checked).contains(part)), "{}", text(&checked));
    let urdf = case.edited(config, "../robots/point2d.urdf", "no-such-robot.urdf");
    case.refused(&urdf, &case.model, &["no-such-robot.urdf"]);
}

#[test]
fn a_robot_description_without_a_named_joint_or_link_is_refused() {
    let case = Case::new("wrong-robot", "planar");
    let robots = file("config/robots");
    let config = |from: &str, to: &str| {
        let path = case.edited("config/controllers/planar.ron", from, to);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replace("../robots", &robots)).unwrap();
        path
    };
    let joint = config("\"y_joint\"", "\"z_joint\"");
    case.refused(&joint, &case.model, &["robot.joints", "z_joint", "y_joint", "point2d.urdf"]);
    let link = config("tool_link: \"point\"", "tool_link: \"no_such_link\"");
    case.refused(&link, &case.model, &["no_such_link"]);
}

#[test]
fn an_instance_name_that_is_none_is_refused() {
    let case = Case::new("wrong-instance", "planar");
    let output = run(program("controller").args([
        "run",
        &file("config/controllers/planar.ron"),
        "--model",
        &case.model,
        "--instance",
        "../elsewhere",
    ]));
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).contains("instance name"), "{}", text(&output));
}
