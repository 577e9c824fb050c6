//! What becomes of names that want to be paths, and of what is there already: the program as a user
//! runs it.

use std::os::unix::fs::{FileTypeExt, symlink};
use std::path::Path;
use std::process::Command;

use crate::common::{Folder, arcs, skill_text};
use rustix::fs::{CWD, FileType, Mode, makedev, mknodat};
use tprmp_model::skill_model::Manifold;

/// Exit code, and what was said.
fn learner(folder: &Folder, arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_learner"));
    let output = command.args(arguments).current_dir(folder.path()).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

/// A file of the thesis' layout whose demonstrations have this name.
fn foreign(name: &str) -> String {
    let frame = |b: &str| serde_json::json!({"A": [[1, 0], [0, 1]], "b": [b.len(), 0]});
    let positions: Vec<_> = (0..20).map(|i| [0.01 * f64::from(i), 0.02 * f64::from(i)]).collect();
    let demonstration = serde_json::json!({
        "frames": {"start": frame(""), "end": frame("a")}, "positions": positions,
    });
    serde_json::json!({
        "name": name, "dt": 0.01, "manifold": "R2", "demonstrations": [demonstration],
    })
    .to_string()
}

fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let name = entry.file_name().into_string().unwrap();
        if entry.file_type().unwrap().is_dir() {
            found.extend(files(&entry.path()).into_iter().map(|file| format!("{name}/{file}")));
        } else {
            found.push(name);
        }
    }
    found.sort();
    found
}

#[test]
fn a_name_in_a_file_leads_nowhere() {
    let folder = Folder::new("name-of-import");
    for name in
        ["../../evil", "../vict/C", "/tmp/evil", "a/b", "..", "", "\u{1b}[2J", "a\nb", "a\0"]
    {
        folder.write("in/foreign.json", &foreign(name));
        let (code, said) = learner(&folder, &["import", "in/foreign.json", "--out", "a/b/out"]);
        assert_eq!(code, Some(1), "{name:?}: {said}");
        for part in ["`in/foreign.json`, key `name`", "expected a name", "found \""] {
            assert!(said.contains(part), "{name:?}: {said}");
        }
        assert!(!said.trim_end().contains(|c: char| c.is_control()), "{said:?}");
        assert_eq!(files(folder.path()), ["in/foreign.json"], "{name:?}");
    }
    // Who gives another name has decided.
    let arguments = ["import", "in/foreign.json", "--out", "out", "--skill"];
    let (code, said) = learner(&folder, &[&arguments[..], &["C"]].concat());
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = learner(&folder, &[&arguments[..], &["../C"]].concat());
    assert!(code == Some(1) && said.contains("option --skill"), "{said}");
}

#[test]
fn names_of_demonstrations_skills_and_models_are_names() {
    let folder = Folder::new("names-of-all");
    let train = |what: &str| {
        let (code, said) = learner(&folder, &["train", "skill.ron", "--out", "model.ron"]);
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("expected a name of 1 to 100 bytes"), "{said}");
        assert!(said.contains(what) && !said.contains('\u{1b}'), "{said}");
    };
    folder.demonstrations("demonstrated", &arcs(Manifold::R2));
    let text = skill_text("planar.ron");
    folder.write("skill.ron", &text.replace("\"made_up\"", "\"\\u{1b}[2J\""));
    train("key `skill`");
    folder.write("skill.ron", &text.replace("other_frames: []", "other_frames: [\"../box\"]"));
    train("key `other_frames`");
    folder.write("skill.ron", &text);
    let file = "demonstrated/made_up_02.json";
    let good = std::fs::read_to_string(folder.path().join(file)).unwrap();
    folder.write(file, &good.replace("\"made_up\"", "\"../made_up\""));
    train("key `skill`");
    folder.write(file, &good.replace("\"end\"", "\"\\u001b[2J\""));
    train("key `frames`");
}

#[test]
fn devices_pipes_and_folders_stay_and_links_are_followed() {
    let folder = Folder::new("out");
    folder.demonstrations("demonstrated", &arcs(Manifold::R2));
    folder.write("skill.ron", &skill_text("planar.ron"));
    let path = |name: &str| folder.path().join(name);
    mknodat(CWD, path("pipe"), FileType::Fifo, Mode::RWXU, 0).unwrap();
    std::fs::create_dir(path("folder")).unwrap();
    let null = makedev(1, 3);
    // Without the right to make one, the system's own does: it cannot be replaced then.
    let device = match mknodat(CWD, path("device"), FileType::CharacterDevice, Mode::RWXU, null) {
        Ok(()) => "device",
        Err(_) => "/dev/null",
    };
    for (name, kind) in [(device, "a device"), ("pipe", "a pipe"), ("folder", "a folder")] {
        let (code, said) = learner(&folder, &["train", "skill.ron", "--out", name]);
        assert_eq!(code, Some(1), "{said}");
        let expected = format!("`{name}` cannot be written: it is {kind}; name a file");
        assert!(said.contains(&expected), "{said}");
    }
    assert!(path(device).metadata().unwrap().file_type().is_char_device());
    assert!(path("pipe").metadata().unwrap().file_type().is_fifo());
    symlink("folder/model.ron", path("model.ron")).unwrap();
    for _ in 0..2 {
        let (code, said) = learner(&folder, &["train", "skill.ron", "--out", "model.ron"]);
        assert_eq!(code, Some(0), "{said}");
        assert!(path("model.ron").symlink_metadata().unwrap().is_symlink());
        assert_eq!(files(&path("folder")), ["model.ron"]);
    }
}

#[test]
fn what_is_there_is_replaced_by_force_only_and_all_or_nothing() {
    let folder = Folder::new("force");
    let mut two: serde_json::Value = serde_json::from_str(&foreign("C")).unwrap();
    let again = two["demonstrations"][0].clone();
    two["demonstrations"].as_array_mut().unwrap().push(again);
    folder.write("C.json", &two.to_string());
    folder.write("out/C_02.json", "theirs");
    let arguments = ["import", "C.json", "--out", "out"];
    let (code, said) = learner(&folder, &arguments);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("`out/C_02.json` is there already") && said.contains("--force"),
        "{said}"
    );
    assert_eq!(files(&folder.path().join("out")), ["C_02.json"]);
    assert_eq!(std::fs::read_to_string(folder.path().join("out/C_02.json")).unwrap(), "theirs");
    let (code, said) = learner(&folder, &[&arguments[..], &["--force"]].concat());
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(files(&folder.path().join("out")), ["C_01.json", "C_02.json"]);
    assert_ne!(std::fs::read_to_string(folder.path().join("out/C_02.json")).unwrap(), "theirs");
}
