//! From a file to a configuration.

use std::path::{Component, Path, PathBuf};

use crate::controller_config::check::Check;
use crate::controller_config::config::ControllerConfig;
use crate::controller_config::error::{ConfigError, Fault};
use crate::controller_config::layers::{FAULTS_MAX, Layers, layers, options};

/// Reads and validates a configuration.
///
/// # Errors
/// [`ConfigError`], with all that is wrong as far as it can be found in one run, each fault with the
/// file, the key and what was expected.
pub fn read(path: &Path) -> Result<ControllerConfig, ConfigError> {
    read_with(path, |_| {})
}

/// Reads a configuration, lets `edit` change it and validates what comes out.
///
/// # Errors
/// As [`read`].
pub fn read_with(
    path: &Path,
    edit: impl FnOnce(&mut ControllerConfig),
) -> Result<ControllerConfig, ConfigError> {
    parsed(layers(path)?, edit)
}

fn parsed(
    mut layers: Layers,
    edit: impl FnOnce(&mut ControllerConfig),
) -> Result<ControllerConfig, ConfigError> {
    let mut faults = Vec::new();
    // Ends: each round but the last takes a key out of the text.
    let mut config: ControllerConfig = loop {
        match options().from_str(&layers.text) {
            Ok(config) => break config,
            Err(error) => {
                let (fault, goes_on) = layers.fault(&error);
                faults.push(fault);
                if !goes_on || faults.len() == FAULTS_MAX {
                    return Err(ConfigError::Faults(faults));
                }
            }
        }
    };
    edit(&mut config);
    let mut check = Check::default();
    config.check(&mut check);
    faults.extend(check.found.into_iter().map(|(key, problem)| {
        let path = layers.path_of(&key).into();
        Fault { path, position: None, key: Some(key), problem }
    }));
    if !faults.is_empty() {
        return Err(ConfigError::Faults(faults));
    }
    let folder = layers.path_of("robot.urdf").parent().unwrap_or(Path::new(""));
    config.robot.urdf = relative_to(folder, &config.robot.urdf);
    Ok(config)
}

/// `path` as seen from `folder`, each `..` taken back where a folder stands before it.
fn relative_to(folder: &Path, path: &Path) -> PathBuf {
    let mut joined = folder.to_path_buf();
    for part in path.components() {
        let in_folder = matches!(joined.components().next_back(), Some(Component::Normal(_)));
        match part {
            Component::ParentDir if in_folder => {
                joined.pop();
            }
            part => joined.push(part),
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller_config::error::Problem;
    use crate::controller_config::layers::{Source, layers_of};
    use crate::renamed::RENAMED_KEYS;

    fn controllers() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/controllers")
    }

    /// A layer as an arm without a configuration of its own has it, on the shipped base.
    const LAYER: &str = include_str!("../../tests/data/layer.ron");

    fn layer_path() -> PathBuf {
        controllers().join("layer.ron")
    }

    /// The shipped configuration and its base, both edited.
    fn edited(edit: impl Fn(&str) -> String) -> Result<ControllerConfig, ConfigError> {
        let text = LAYER;
        let edited = edit(text);
        let is_hit = edited != text;
        let layers = layers_of(Source { path: layer_path(), text: edited }, |path| {
            let text = std::fs::read_to_string(path)?;
            let edited = edit(&text);
            assert!(is_hit || edited != text, "the edit must hit");
            Ok(edited)
        })?;
        parsed(layers, |_| {})
    }

    fn faults_of(edit: impl Fn(&str) -> String) -> Vec<Fault> {
        match edited(edit).unwrap_err() {
            ConfigError::Faults(faults) => faults,
            error @ ConfigError::Read { .. } => panic!("{error}"),
        }
    }

    fn error_of(edit: impl Fn(&str) -> String) -> String {
        edited(edit).unwrap_err().to_string()
    }

    /// A file with these keys above a base with these.
    fn layered(file: &str, base: &str) -> Result<Layers, ConfigError> {
        let file = Source { path: "a/file.ron".into(), text: file.into() };
        layers_of(file, |path| {
            assert_eq!(path, Path::new("a/b/base.ron"));
            Ok(base.into())
        })
    }

    #[test]
    fn every_shipped_controller_configuration_is_valid() {
        let mut count = 0;
        let files = std::fs::read_dir(controllers()).unwrap().flatten();
        for path in files.map(|entry| entry.path()).filter(|path| path.is_file()) {
            let config = read(&path).unwrap();
            assert!(config.robot.urdf.exists(), "{}", config.robot.urdf.display());
            count += 1;
        }
        assert!(count >= 2);
    }

    #[test]
    fn paths_are_relative_to_the_file() {
        let urdf = Path::new("../robots/ur5.urdf");
        let joined = |folder: &str| relative_to(Path::new(folder), urdf);
        assert_eq!(joined("config/controllers"), Path::new("config/robots/ur5.urdf"));
        assert_eq!(joined(""), urdf);
        assert_eq!(joined(".."), Path::new("../../robots/ur5.urdf"));
        assert_eq!(relative_to(Path::new("a"), Path::new("/b")), Path::new("/b"));
    }

    #[test]
    fn a_missing_key_is_named() {
        let error = error_of(|t| t.replace("fade_in_s:", "// fade_in_s:"));
        assert!(error.contains("layer.ron") && error.contains("fade_in_s"), "{error}");
    }

    #[test]
    fn an_unknown_key_is_named_with_what_was_expected() {
        let error = error_of(|t| t.replace("fade_in_s:", "fade_in_ms:"));
        assert!(error.contains("fade_in_ms") && error.contains("fade_in_s"), "{error}");
    }

    /// The text without a key and its value.
    fn without(text: &str, key: &str) -> String {
        let Some(at) = text.find(&format!(" {key}: ")) else { return text.into() };
        let at = at + 1;
        let mut depth = 0;
        let end = text[at..].find(|c: char| {
            depth +=
                i32::from(matches!(c, '(' | '[' | '{')) - i32::from(matches!(c, ')' | ']' | '}'));
            c == ',' && depth == 0
        });
        format!("{}{}", &text[..at], &text[at + end.unwrap() + 1..])
    }

    #[test]
    fn a_missing_key_is_an_error_where_none_is_a_value_too() {
        for key in [
            "base_link",
            "payload",
            "gripped",
            "control_points",
            "goal_attractor",
            "joint_limits",
            "joint_speeds",
            "posture",
            "collision",
            "steering",
            "self_collision",
            "approach",
            "lift",
            "external",
            "disturbance",
            "load",
            "fifo_priority",
            "cpu",
            "cpu_latency_max_us",
        ] {
            let error = error_of(|text| without(text, key));
            assert!(error.contains(key) && error.contains("missing"), "{key}: {error}");
        }
    }

    #[test]
    fn a_value_outside_its_range_is_named_with_the_range() {
        let error = error_of(|t| t.replace("velocity_fraction: ", "velocity_fraction: 1"));
        assert!(
            error.contains("robot.velocity_fraction") && error.contains("at most 1"),
            "{error}"
        );
        let error = error_of(|t| t.replace("period_ns: 1_000_000", "period_ns: 0"));
        assert!(error.contains("loop.period_ns"), "{error}");
        let error = error_of(|t| t.replace("spin_ns: 0", "spin_ns: 800_001"));
        assert!(error.contains("loop.spin_ns") && error.contains("four fifths"), "{error}");
        let error = error_of(|t| t.replace("required: []", "required: [Cpu]"));
        assert!(error.contains("real_time.required") && error.contains("Cpu"), "{error}");
        let error = error_of(|t| t.replace("acceleration_max: [", "acceleration_max: [1.0, "));
        assert!(error.contains("one number for each joint"), "{error}");
        let refused = [
            ("linear_max_m_s: 1.5", "linear_max_m_s: 0.0", "skill.governor.linear_max_m_s"),
            ("activation_distance: 0.2", "activation_distance: 0.001", "joint_limits.distance_min"),
            ("free_fraction: 0.7", "free_fraction: 1.0", "joint_speeds.free_fraction"),
            (
                "posture: None",
                "posture: Some((position: [0.0], inertia: 0.1, stiffness_1_s2: 1.0, \
              damping_1_s: 2.0, saturation: 0.5))",
                "posture.position",
            ),
            ("Space((0.0, 0.0, 1.0))", "Space((0.0, 0.0, 0.0))", "collision.steering.side"),
            ("ramp_time_s: 0.02", "ramp_time_s: -1.0", "collision.ramp_time_s"),
            (
                "extent: NearAxis(0.15)",
                "extent: NearAxis(-0.15)",
                "collision.exempt[3].extent, NearAxis",
            ),
            ("extent: Above(0.015)", "extent: Above(0.005)", "collision.exempt[0].extent, Above"),
            ("margin_m: 0.0,", "margin_m: -0.005,", "self_collision.margin_m"),
            (
                "additional_skills: []",
                "additional_skills: [(moves: Whole, linear_inertia_kg: 1.0, angular_inertia_kg_m2: 0.0, governor: \
                 (linear_max_m_s: 1.0, angular_max_rad_s: 1.0, response_1_s: 8.0))]",
                "additional_skills[0].angular_inertia_kg_m2",
            ),
            (
                "goal_attractor: None",
                "goal_attractor: Some((linear_inertia_kg: 1.0, angular_inertia_kg_m2: 0.1, \
                 stiffness_1_s2: 9.0, damping_1_s: 6.0, saturation_m: 0.0))",
                "goal_attractor.saturation_m",
            ),
            ("linear_max_m_s: 0.25", "linear_max_m_s: inf", "external.linear_max_m_s"),
            ("angular_max_rad_s: 1.0", "angular_max_rad_s: 0.0", "external.angular_max_rad_s"),
            ("linear_inertia_kg: 4.0", "linear_inertia_kg: -4.0", "external.linear_inertia_kg"),
            (
                "angular_inertia_kg_m2: 2.0",
                "angular_inertia_kg_m2: NaN",
                "external.angular_inertia_kg_m2",
            ),
            ("fade_s: 0.05", "fade_s: 0.0", "external.fade_s"),
            ("age_max_ns: 150_000_000", "age_max_ns: 0", "external.age_max_ns"),
            ("rotor_inertia: [0.0", "rotor_inertia: [-1.0", "robot.actuators.rotor_inertia"),
            ("coulomb_friction: [0.0, ", "coulomb_friction: [", "robot.actuators.coulomb_friction"),
            ("friction_speed: 0.001", "friction_speed: 0.0", "robot.actuators.friction_speed"),
            ("feedback_fraction: 0.5", "feedback_fraction: 0.0", "impedance.feedback_fraction"),
            (
                "stuck_time_constant_s: 0.02",
                "stuck_time_constant_s: 0.001",
                "disturbance.load.stuck_time_constant_s",
            ),
            ("\"elbow_joint\": (", "\"elbow\": (", "robot.working_range"),
            ("\"elbow_joint\": (0.1", "\"elbow_joint\": (3.0", "robot.working_range"),
        ];
        for (from, to, key) in refused {
            let error = error_of(|t| t.replace(from, to));
            assert!(error.contains(key), "{key}: {error}");
        }
    }

    #[test]
    fn what_is_carried_is_checked() {
        for (from, to, key) in [
            (
                "payload: None",
                "payload: Some((mass_kg: 0.0, centre_m: (0.0, 0.0, 0.1)))",
                "robot.payload.mass_kg",
            ),
            (
                "payload: None",
                "payload: Some((mass_kg: 1.0, centre_m: (0.0, NaN, 0.1)))",
                "robot.payload.centre_m",
            ),
            (
                "gripped: None",
                "gripped: Some((mass_kg: -1.0, centre_m: (0.0, 0.0, 0.0), spheres: [], obstacle_within_m: 0.0))",
                "gripped.mass_kg",
            ),
            (
                "gripped: None",
                "gripped: Some((mass_kg: 0.0, centre_m: (0.0, 0.0, 0.0), obstacle_within_m: 0.0, spheres: \
                 [(position_m: (0.0, 0.0, 0.0), radius_m: 0.1), (position_m: (0.0, 0.0, 0.1), radius_m: 0.0)]))",
                "gripped.spheres[1].radius_m",
            ),
        ] {
            let error = error_of(|t| t.replace(from, to));
            assert!(error.contains(key), "{key}: {error}");
        }
    }

    /// The shipped configuration of an arm that is driven otherwise.
    fn driven(actuators: &str) -> Result<ControllerConfig, ConfigError> {
        edited(|text| {
            let Some(at) = text.find("actuators: Torque") else { return text.into() };
            let end = at + text[at..].find(")),").unwrap();
            format!("{}actuators: {actuators}{}", &text[..at], &text[end + 2..])
        })
    }

    #[test]
    fn servos_have_a_lag_within_bounds_and_torques_none() {
        assert_eq!(read(&controllers().join("ur5_pick.ron")).unwrap().robot.actuators.lag_s(), 0.0);
        for kind in ["PositionServo", "VelocityServo"] {
            let servo = |lag: &str| {
                driven(&format!("{kind}((lag_s: {lag}, reference_time_constant_s: 0.5))"))
            };
            assert_eq!(servo("0.1").unwrap().robot.actuators.lag_s(), 0.1);
            let error = servo("100.0").unwrap_err().to_string();
            assert!(error.contains("robot.actuators.lag_s") && error.contains("0.5"), "{error}");
        }
        let missing = driven("PositionServo((lag_s: 0.1))").unwrap_err().to_string();
        assert!(missing.contains("reference_time_constant_s"), "{missing}");
    }

    #[test]
    fn gains_of_an_older_version_are_refused_with_those_of_now() {
        let error = error_of(|t| t.replace("natural_frequency_rad_s: 10", "stiffness_1_s2: 100"));
        for word in ["arm_pick.ron", "stiffness_1_s2", "natural_frequency_rad_s"] {
            assert!(error.contains(word), "{word}: {error}");
        }
        let error = error_of(|text| without(text, "actuators"));
        assert!(error.contains("actuators") && error.contains("missing"), "{error}");
    }

    #[test]
    fn commands_from_outside_are_optional_but_the_key_is_not() {
        assert!(read(&controllers().join("ur5_pick.ron")).unwrap().external.is_some());
        let none = edited(|text| {
            without(text, "external").replace("    done: (", "    external: None,\n    done: (")
        });
        assert!(none.unwrap().external.is_none());
        let missing = error_of(|text| without(text, "external"));
        assert!(missing.contains("external"), "{missing}");
    }

    #[test]
    fn what_an_edit_leaves_is_validated_too() {
        let path = controllers().join("ur5_pick.ron");
        let config = read_with(&path, |c| c.cycle.period_ns = 250_000).unwrap();
        assert_eq!(config.cycle.period_ns, 250_000);
        let error = read_with(&path, |c| c.real_time.fifo_priority = Some(100)).unwrap_err();
        assert!(error.to_string().contains("real_time.fifo_priority"), "{error}");
    }

    #[test]
    fn a_truncated_file_is_an_error_with_a_position() {
        let error = error_of(|t| t[..t.len() / 2].to_string());
        assert!(error.contains("layer.ron"), "{error}");
    }

    #[test]
    fn a_layer_overrides_its_base_key_by_key_and_adds_what_the_base_has_not() {
        let base = "(a: (b: 1, c: [1, 2], d: Some((e: 3)),), f: None, g: Above(1), h: ())";
        let file = "(base: \"b/base.ron\", g: Whole, a: (x: 7, c: [], d: (e: 4, y: 8)), h: (i: 1), \
                    j: 5)";
        let layers = layered(file, base).unwrap();
        let expected =
            "(a: (b: 1, c: [], d: Some((e: 4,y: 8,)),x: 7,), f: None, g: Whole, h: (i: 1,),j: 5,)";
        assert_eq!(layers.text, expected);
        for (key, path) in [("a.b", "a/b/base.ron"), ("a.c", "a/file.ron"), ("j", "a/file.ron")] {
            assert_eq!(layers.path_of(key), Path::new(path), "{key}");
        }
        assert_eq!(layers.path_of("a.c[3].z"), Path::new("a/file.ron"), "the nearest key around");
        // A group in place of none, and none in place of a group, are values as a whole.
        let layers = layered("(base: \"b/base.ron\", f: (k: 1), a: None)", base).unwrap();
        assert_eq!(layers.text, "(a: None, f: (k: 1), g: Above(1), h: ())");
        // Another variant replaces the whole value, the same one is changed.
        let base = "(a: Servo((lag: 1, time: 2)), b: Some((c: 1, d: 2)))";
        let layer = "(base: \"b/base.ron\", a: Torque((k: 3)), b: (c: 4))";
        assert_eq!(
            layered(layer, base).unwrap().text,
            "(a: Torque((k: 3)), b: Some((c: 4, d: 2)))"
        );
        let layer = "(base: \"b/base.ron\", a: Servo((time: 3)))";
        let same = "(a: Servo((lag: 1, time: 3)), b: Some((c: 1, d: 2)))";
        assert_eq!(layered(layer, base).unwrap().text, same);
        let twice = layered("(base: \"b/base.ron\", f: 1, f: 2)", "(f: 0)").unwrap_err();
        assert!(twice.to_string().contains("key `f`: the key is given twice"), "{twice}");
    }

    #[test]
    fn a_fault_is_found_in_the_file_in_which_it_stands() {
        let base = controllers().join("base/arm_pick.ron");
        let at = |edit: &dyn Fn(&str) -> String| {
            let fault = faults_of(edit).remove(0);
            (fault.path, fault.position, fault.key.unwrap_or_default())
        };
        let line = |path: &Path, part: &str| {
            let base = (path != layer_path()).then(|| std::fs::read_to_string(path).unwrap());
            let text = base.as_deref().unwrap_or(LAYER);
            let line = text.lines().position(|line| line.contains(part)).unwrap();
            let column = text.lines().nth(line).unwrap().find(part).unwrap();
            Some((line + 1, column + 1))
        };
        let below = at(&|t| t.replace("fade_in_s:", "fade_in_ms:"));
        assert_eq!(below, (base.clone(), line(&base, "fade_in_s"), "stop.fade_in_ms".into()));
        let above = at(&|t| t.replace("urdf:", "urd:"));
        assert_eq!(above, (layer_path(), line(&layer_path(), "urdf"), "robot.urd".into()));
        let list = at(&|t| t.replace("(link: \"wrist_3_link\", ", "(lnk: \"wrist_3_link\", "));
        let column = line(&layer_path(), "link: \"wrist_3_link\"");
        assert_eq!(list, (layer_path(), column, "collision.exempt[1].lnk".into()));
        let of_type = at(&|t| t.replace("gain: 4.0", "gain: \"x\""));
        assert_eq!((of_type.0, of_type.2), (base.clone(), "collision.steering.gain".into()));
        assert_eq!(of_type.1.map(|(line, _)| line), line(&base, "gain: 4.0").map(|(line, _)| line));
        let value = at(&|t| t.replace("period_ns: 1_000_000", "period_ns: 0"));
        assert_eq!(value, (base.clone(), None, "loop.period_ns".into()));
        let value = at(&|t| t.replace("position_margin: 0.05", "position_margin: -1"));
        assert_eq!(value, (layer_path(), None, "robot.position_margin".into()));
        let syntax = at(&|t| t.replace("exempt: []", "exempt: [)"));
        assert_eq!((syntax.0, syntax.2), (layer_path(), String::new()));
        // A wrong type in place of a good value of the base, and a key that stands twice.
        let layer = |keys: &str| {
            let edit = |t: &str| t.replace("base: \"base", &format!("{keys} base: \"base"));
            faults_of(edit).into_iter().map(|f| (f.path, f.key.unwrap_or_default(), f.problem))
        };
        for (keys, key) in [("done: (distance_m: \"x\"),", "done.distance_m"), ("done: 5,", "done")]
        {
            let (path, found, _) = layer(keys).next().unwrap();
            assert_eq!((path, found.as_str()), (layer_path(), key));
        }
        for keys in [
            "posture: None, done: 5, done: (distance_m: 0.5),",
            "posture: None, done: (distance_m: 0.5), done: (),",
            "posture: None, collision: None, done: (), done: 5,",
        ] {
            let twice = (layer_path(), "done".to_owned(), Problem::Twice);
            assert!(layer(keys).any(|fault| fault == twice), "{keys}");
        }
        // What both lack is missing in the file that is read.
        let missing = faults_of(|t| t.replace("fade_in_s:", "// fade_in_s:")).remove(0);
        let expected = (layer_path(), None, Some("stop.fade_in_s".into()), Problem::Missing);
        assert_eq!((missing.path, missing.position, missing.key, missing.problem), expected);
    }

    #[test]
    fn brackets_without_end_are_refused_at_once() {
        for text in ["[".repeat(200_000), format!("({}", "a:(".repeat(100_000))] {
            let source = Source { path: layer_path(), text };
            let ConfigError::Faults(faults) =
                layers_of(source, |_| unreachable!("no base is named")).unwrap_err()
            else {
                panic!("it was read")
            };
            assert!(matches!(faults[0].problem, Problem::Syntax(_)), "{:?}", faults[0]);
        }
    }

    #[test]
    fn all_faults_are_found_in_one_run() {
        let faults = faults_of(|t| {
            t.replace("urdf:", "colour: 1, urdf:")
                .replace("fade_in_s:", "haste: (a: [1, (b: 2)]), fade_in_s:")
                .replace("gain: 4.0", "gain: -4.0")
                .replace("distance_m: 0.01", "distance_m: 0.0")
                .replace("position_margin: 0.05", "position_margin: -0.05")
        });
        let keys: Vec<_> = faults.iter().map(|fault| fault.key.clone().unwrap()).collect();
        let expected = [
            "robot.colour",
            "stop.haste",
            "robot.position_margin",
            "collision.steering.gain",
            "done.distance_m",
        ];
        let sorted = |mut keys: Vec<String>| {
            keys.sort();
            keys
        };
        assert_eq!(sorted(keys), sorted(expected.map(Into::into).to_vec()), "{faults:?}");
        let message = ConfigError::Faults(faults).to_string();
        assert_eq!(message.lines().count(), 5, "{message}");
        assert!(message.contains("key `collision.steering.gain`: expected a finite number of at"));
    }

    #[test]
    fn keys_of_the_last_version_are_refused_with_the_new_name() {
        for (old, new) in RENAMED_KEYS {
            let message = error_of(|t| {
                t.replace(&format!(" {new}:"), &format!(" {old}:"))
                    .replace("done: (", &format!("{old}: 1, done: ("))
            });
            assert!(message.contains(&format!("`{old}` is now `{new}`")), "{message}");
            assert!(message.contains("arm_pick.ron`, line "), "{message}");
        }
        let faults = faults_of(|t| t.replace("_fraction:", "_share:")); // the old names
        assert!(faults.len() >= 8, "all at once: {faults:?}");
    }

    #[test]
    fn a_base_that_is_none_is_refused() {
        let missing = error_of(|t| t.replace("base/arm_pick.ron", "base/leg_pick.ron"));
        for part in ["layer.ron", "key `base`", "leg_pick.ron", "relative to this one"] {
            assert!(missing.contains(part), "{part}: {missing}");
        }
        let number = error_of(|t| t.replace("\"base/arm_pick.ron\"", "7"));
        assert!(number.contains("key `base`"), "{number}");
        // Its own base, and a base of a base.
        for base in ["../ur5_pick.ron", "other.ron"] {
            let text = format!("(base: \"{base}\", robot: ())");
            let error = layered("(base: \"b/base.ron\")", &text).unwrap_err().to_string();
            assert!(error.contains("a/b/base.ron") && error.contains(base), "{error}");
            assert!(error.contains("none in a file that is a base itself"), "{error}");
        }
        let own = edited(|t| t.replace("base/arm_pick.ron", "ur5_pick.ron"));
        assert!(own.unwrap_err().to_string().contains("none in a file that is a base itself"));
    }

    #[test]
    fn the_robot_description_is_relative_to_the_file_that_names_it() {
        let config = edited(|t| {
            without(t, "urdf").replace("base_link: None", "urdf: \"ur5.urdf\", base_link: None")
        });
        assert_eq!(config.unwrap().robot.urdf, controllers().join("base/ur5.urdf"));
    }
}
