//! A model file that the last version wrote is read, and moves a tool as it did.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use tprmp_model::RENAMED_KEYS;
use tprmp_model::skill_model::{ModelError, SkillModel, read, to_text};
use tprmp_rmpflow::policy::{PolicyState, SkillInertia};
use tprmp_spatial::{MovingPose, Pose, Twist};

/// Position of the tool, and the bits of what the last version computed there: force x and y, metric
/// xy, energy.
const EXPECTED: [(f64, f64, [u64; 4]); 3] = [
    (
        0.05,
        0.1,
        [
            0x3fda_78f7_b778_2914,
            0x3ff6_cb3b_a165_aba8,
            0xbfd3_f28e_f48b_a30a,
            0x3ff6_dbf3_678c_b636,
        ],
    ),
    (
        0.3,
        0.2,
        [
            0x3fc6_bee8_7cd7_ecf0,
            0x4009_1cd7_f06c_a414,
            0xbfdd_5bad_b63b_2f39,
            0x3fe9_0929_63b0_1f81,
        ],
    ),
    (
        0.62,
        0.3,
        [
            0xbfea_8be6_d281_fca2,
            0xbfdd_fbf8_ee86_1592,
            0xbf52_015e_4cfb_ec08,
            0xbfe4_bcfa_de73_a535,
        ],
    ),
];

fn old_file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/tprmp-model-5.ron")
}

/// What reading a changed file gives.
fn read_changed(name: &str, from: &str, to: &str) -> Result<SkillModel, ModelError> {
    let text = std::fs::read_to_string(old_file()).unwrap();
    assert!(text.contains(from), "the change must hit");
    let path = std::env::temp_dir().join(format!("tprmp-upgrade-{name}-{}", std::process::id()));
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    let model = read(&path);
    std::fs::remove_file(&path).unwrap();
    model
}

#[test]
fn a_file_of_the_last_version_has_this_version_s_names() {
    let old = std::fs::read_to_string(old_file()).unwrap();
    let model = read(&old_file()).unwrap();
    let new = to_text(&model);
    assert!(old.contains("tprmp-model/5") && new.contains("tprmp-model/7"));
    for (old_key, new_key) in RENAMED_KEYS {
        for (before, after) in ["\n      {}:", "\n        {}:", ".{}\""]
            .map(|pattern| (pattern.replace("{}", old_key), pattern.replace("{}", new_key)))
        {
            assert!(!new.contains(&before), "{before}");
            assert_eq!(old.contains(&before), new.contains(&after), "{after}");
        }
    }
    for (before, after) in [
        ("\"repairs\"", "\"refinement rounds\""),
        ("share against the demonstrations", "fraction against the demonstrations"),
        ("stiffness across the way", "stiffness across the path"),
    ] {
        assert!(old.contains(before) && !new.contains(before), "{before}");
        assert!(new.contains(after), "{after}");
    }
    let numbers = |text: &str| -> Vec<f64> {
        let body = text.split_once("body:").unwrap().1;
        let parts = body.split(|c: char| !(c.is_ascii_alphanumeric() || "_.-".contains(c)));
        parts.filter_map(|part| part.parse().ok()).collect()
    };
    let lacking = |line: &&str| !NEW_KEYS.iter().any(|key| line.trim_start().starts_with(key));
    let without: String = new.lines().filter(lacking).collect::<Vec<_>>().join("\n");
    assert_eq!(numbers(&old), numbers(&without));
}

/// Keys that files of earlier versions lack.
const NEW_KEYS: [&str; 12] = [
    "intervals:",
    "unproved:",
    "duration_s:",
    "agreement:",
    "agreement_fraction:",
    "path_rms_rad:",
    "end_error_",
    "predicted_rms_",
    "execution_s:",
    "recorded_s:",
    "on_their_way:",
    "// ",
];

#[test]
fn a_file_of_the_version_between_is_read() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/tprmp-model-6.ron");
    let model = read(&file).unwrap();
    assert!(model.fit.demonstrations.len() == 6 && model.fit.duration_s == 0.0);
    assert!(to_text(&model).contains("tprmp-model/7"));
}

#[test]
fn a_file_of_the_last_version_moves_the_tool_as_it_did() {
    let policy = read(&old_file()).unwrap().policy().unwrap();
    let pose =
        |x: f64, y: f64| Pose { position: DVec3::new(x, y, 0.0), orientation: DQuat::IDENTITY };
    let frames = [pose(0.05, -0.02), pose(0.65, 0.33)].map(MovingPose::at_rest);
    let inertia = SkillInertia { linear_kg: 1.0, angular_kg_m2: 0.1 };
    let mut state = PolicyState::default();
    let velocity = Twist { linear: DVec3::new(0.2, 0.1, 0.0), angular: DVec3::ZERO };
    for (x, y, expected) in EXPECTED {
        state.restart();
        let value = policy.evaluate(&inertia, &frames, &pose(x, y), &velocity, &mut state);
        let natural = &value.natural;
        let found = [natural.force[0], natural.force[1], natural.metric[(0, 1)], value.energy];
        assert_eq!(found.map(f64::to_bits), expected, "at {x}, {y}: {found:?}");
    }
}

#[test]
fn a_damaged_file_of_the_last_version_is_refused() {
    let error = read_changed("number", "0.6, 0.3", "0.7, 0.3").unwrap_err();
    assert!(matches!(error, ModelError::Checksum { .. }), "{error}");
    let error = read_changed("key", "positions_turn", "positions_spin").unwrap_err();
    assert!(matches!(error, ModelError::Syntax { .. }), "{error}");
    // The layout is free.
    read_changed("layout", "body: (", "// of the last version\n body :(").unwrap();
}

#[test]
fn older_files_are_refused_with_what_is_read_and_what_helps() {
    let message = read_changed("older", "tprmp-model/5", "tprmp-model/4").unwrap_err().to_string();
    for part in [
        "tprmp-model/7",
        "tprmp-model/6",
        "tprmp-model/5",
        "found `tprmp-model/4`",
        "train it again",
    ] {
        assert!(message.contains(part), "{message}");
    }
}
