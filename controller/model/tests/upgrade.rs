//! A model file that the last version wrote is read.

use std::path::{Path, PathBuf};

use tprmp_model::RENAMED_KEYS;
use tprmp_model::skill_model::{ModelError, SkillModel, read, to_text};

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
    assert!(old.contains("tprmp-model/5") && new.contains("tprmp-model/6"));
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
    assert_eq!(numbers(&old), numbers(&new));
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
    for part in ["tprmp-model/6", "tprmp-model/5", "found `tprmp-model/4`", "train it again"] {
        assert!(message.contains(part), "{message}");
    }
}
