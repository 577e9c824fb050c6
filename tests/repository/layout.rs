//! What lies where, and how long it may be.

use crate::{files, own_path, root};

/// A longer file has more than one subject.
const LINES_MAX: usize = 600;

/// The top level is the map a stranger reads first: nothing joins it unnoticed.
#[test]
fn top_level_holds_only_the_named_folders() {
    let named = [
        "benches",
        "config",
        "controller",
        "learner",
        "sim-bridge",
        "tests",
        "target",
        ".ci",
        ".git",
        ".cargo",
    ];
    for entry in std::fs::read_dir(root()).unwrap().flatten() {
        let name = entry.file_name().into_string().unwrap();
        if entry.file_type().unwrap().is_dir() && !name.ends_with("_cache") {
            assert!(named.contains(&name.as_str()), "unexpected top-level folder `{name}`");
        }
    }
}

#[test]
fn no_file_of_code_is_longer_than_one_subject() {
    let code = ["rs", "py"].into_iter().flat_map(|extension| files(root(), extension));
    let long: Vec<_> = code
        .filter_map(|path| {
            let lines = std::fs::read_to_string(&path).unwrap().lines().count();
            (lines > LINES_MAX).then(|| format!("{}: {lines} lines", own_path(&path)))
        })
        .collect();
    assert!(long.is_empty(), "files over {LINES_MAX} lines:\n{}", long.join("\n"));
}

/// Whoever opens a room finds on one screen what it is for.
#[test]
fn every_room_has_a_readme_of_one_screen() {
    let rooms = [
        "benches",
        "config",
        "controller",
        "controller/files",
        "controller/messages",
        "controller/messages/c",
        "controller/model",
        "controller/rmpflow",
        "controller/robot",
        "controller/spatial",
        "learner",
        "learner/drawing",
        "learner/experiments",
        "sim-bridge",
        "sim-bridge/planar",
        "tests",
    ];
    for room in rooms {
        let path = root().join(room).join("README.md");
        let text = std::fs::read_to_string(&path)
            .unwrap_or_else(|error| panic!("{}: {error}", own_path(&path)));
        let lines = text.lines().count();
        assert!((5..=60).contains(&lines), "{}: {lines} lines", own_path(&path));
    }
}
