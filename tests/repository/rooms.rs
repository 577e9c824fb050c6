//! Which crate may use which: the table of rooms in ARCHITECTURE.md, compared with the manifests.

use std::collections::{BTreeMap, BTreeSet};

use crate::{files, own_path, root};

/// The rows of the table of rooms: folder → rooms that it depends on, by their folders.
fn table() -> BTreeMap<String, BTreeSet<String>> {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let rows = text.lines().filter(|line| line.starts_with("| `"));
    let rows = rows.map(|line| line.split('|').map(str::trim).collect::<Vec<_>>());
    rows.filter(|cells| cells.len() == 6)
        .map(|cells| {
            let names = |cell: &str| -> BTreeSet<String> {
                cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
            };
            let room = names(cells[1]).into_iter().next().unwrap();
            (room, names(cells[3]))
        })
        .collect()
}

/// Folders of the workspace's crates by package name.
fn members() -> BTreeMap<String, String> {
    let manifests = files(root(), "toml").into_iter().filter(|path| path.ends_with("Cargo.toml"));
    let named = manifests.filter(|path| path.parent() != Some(root())).map(|path| {
        let text = std::fs::read_to_string(&path).unwrap();
        let name = text.split("name = \"").nth(1).unwrap().split('"').next().unwrap();
        (name.to_owned(), own_path(path.parent().unwrap()))
    });
    named.collect()
}

#[test]
fn crates_depend_on_what_the_table_of_rooms_says() {
    let (table, members) = (table(), members());
    assert!(members.len() >= 10, "{members:?}");
    for (name, folder) in &members {
        let manifest = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap();
        let section = manifest.split("\n[dependencies]\n").nth(1).unwrap_or("");
        let section = section.split("\n[").next().unwrap();
        let used: BTreeSet<String> = section
            .lines()
            .filter_map(|line| members.get(line.split(['.', ' ']).next()?).cloned())
            .collect();
        let told = table.get(folder).unwrap_or_else(|| {
            panic!("ARCHITECTURE.md, table of rooms: no row for `{folder}` ({name})")
        });
        let told: BTreeSet<String> =
            told.iter().filter(|room| members.values().any(|f| f == *room)).cloned().collect();
        assert_eq!(used, told, "`{folder}`: manifest and table of rooms disagree");
    }
}

const PRINTED: &str =
    "it panics where nobody reads it, and shows what moves a cursor: `outln!`, `errln!`";
const WRITTEN: &str = "a file is there whole or not at all: `tprmp_files::write`";

/// What the column "never" says beyond dependencies: a folder, files of it that may, a text that must
/// not stand there, and why.
const NEVER: &[(&str, &[&str], &str, &str)] = &[
    ("learner/src", &["record", "main.rs"], "tprmp_messages", "training knows no shared memory"),
    ("learner/src", &["record", "main.rs"], "tprmp_robot", "training knows no robot"),
    ("learner/src", &[], "open_state_publisher", "the learner publishes nothing"),
    ("controller/rmpflow/src", &[], "std::time", "the mathematics read no clock"),
    ("controller/rmpflow/src", &[], "std::fs", "the mathematics do no I/O"),
    ("controller/messages/src", &[], "use tprmp_", "messages know no robot, model or policy"),
    ("controller/model/src", &[], "iceoryx2", "files know no shared memory"),
    ("learner/drawing/src", &[], "tprmp_rmpflow", "drawing knows no policy"),
    ("controller/src", &[], "println!", PRINTED),
    ("learner/src", &[], "println!", PRINTED),
    ("learner/experiments/src", &[], "println!", PRINTED),
    ("sim-bridge/planar/src", &[], "println!", PRINTED),
    ("controller/src", &[], "fs::write", WRITTEN),
    ("controller/model/src", &[], "fs::write", WRITTEN),
    ("learner/src", &["record/folder.rs"], "fs::write", WRITTEN),
    ("learner/experiments/src", &[], "fs::write", WRITTEN),
    ("sim-bridge/planar/src", &[], "fs::write", WRITTEN),
    ("controller/src", &[], "File::create", WRITTEN),
    ("learner/src", &[], "File::create", WRITTEN),
    ("learner/drawing/src", &[], "tprmp_model", "drawing knows no model"),
];

#[test]
fn rooms_leave_alone_what_they_never_touch() {
    let mut found = Vec::new();
    for (folder, may, text, reason) in NEVER {
        let folder = root().join(folder);
        for path in files(&folder, "rs") {
            let inside = path.strip_prefix(&folder).unwrap();
            if may.iter().any(|part| inside.starts_with(part)) {
                continue;
            }
            for (i, line) in std::fs::read_to_string(&path).unwrap().lines().enumerate() {
                if !line.trim_start().starts_with("//") && line.contains(text) {
                    found.push(format!("{}:{}: `{text}`: {reason}", own_path(&path), i + 1));
                }
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}
