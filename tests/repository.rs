//! Rules of the repository itself.

use std::path::Path;

/// The top level is the map a newcomer reads first: nothing joins it unnoticed.
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
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for entry in std::fs::read_dir(root).unwrap().flatten() {
        let name = entry.file_name().into_string().unwrap();
        if entry.file_type().unwrap().is_dir() && !name.ends_with("_cache") {
            assert!(named.contains(&name.as_str()), "unexpected top-level folder `{name}`");
        }
    }
}
