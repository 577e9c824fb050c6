//! The graph of modules: no file imports, by whatever detour, a file that imports it.
//!
//! Read from the text: `use` declarations and paths that begin with `crate::` or `super::`, and
//! Python's imports. Tests inside a file may look at whatever they like.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::{files, own_path, root};

/// Which files a file imports.
type Graph = BTreeMap<PathBuf, BTreeSet<PathBuf>>;

/// The source folders of all Rust crates.
fn sources() -> Vec<PathBuf> {
    let manifests = files(root(), "toml").into_iter().filter(|path| path.ends_with("Cargo.toml"));
    manifests.map(|path| path.with_file_name("src")).filter(|path| path.is_dir()).collect()
}

/// Module path of a file: `src/a/b.rs` and `src/a/b/mod.rs` are a::b.
fn module(source: &Path, file: &Path) -> Vec<String> {
    let inside = file.strip_prefix(source).unwrap().with_extension("");
    let mut parts: Vec<String> =
        inside.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
    if parts.last().is_some_and(|last| last == "mod")
        || (parts.len() == 1 && ["lib", "main"].contains(&parts[0].as_str()))
    {
        parts.pop();
    }
    parts
}

/// A file without its comments and without its tests.
fn code(text: &str) -> String {
    let end = text.find("#[cfg(test)]\nmod tests").unwrap_or(text.len());
    let lines = text[..end].lines().filter(|line| !line.trim_start().starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
}

/// The paths that a text names after `start`, groups in braces taken apart.
fn paths_after(text: &str, start: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for (at, _) in text.match_indices(start) {
        let before = text[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        expand(&text[at + start.len()..], &[], &mut found);
    }
    found
}

/// Reads one path, or a group of them, from the start of `text`; returns what follows it.
fn expand<'a>(text: &'a str, prefix: &[String], found: &mut Vec<Vec<String>>) -> &'a str {
    let mut rest = text.trim_start();
    let mut path = prefix.to_vec();
    loop {
        if let Some(mut inner) = rest.strip_prefix('{') {
            loop {
                inner = expand(inner, &path, found).trim_start();
                match inner.strip_prefix(',') {
                    Some(after) if after.trim_start().starts_with('}') => {
                        return &after.trim_start()[1..];
                    }
                    Some(after) => inner = after,
                    None => return inner.strip_prefix('}').unwrap_or(inner),
                }
            }
        }
        let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
        if end == 0 {
            found.push(path);
            return rest;
        }
        path.push(rest[..end].to_owned());
        rest = &rest[end..];
        let Some(after) = rest.strip_prefix("::") else {
            found.push(path);
            // The name under which it is imported.
            return rest.trim_start().strip_prefix("as ").map_or(rest, |name| {
                name.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_')
            });
        };
        rest = after;
    }
}

fn rust_graph() -> Graph {
    let mut graph = Graph::new();
    for source in sources() {
        let all: BTreeMap<Vec<String>, PathBuf> =
            files(&source, "rs").into_iter().map(|file| (module(&source, &file), file)).collect();
        for (module, file) in &all {
            let text = code(&std::fs::read_to_string(file).unwrap());
            let parent = &module[..module.len().saturating_sub(1)];
            let own = paths_after(&text, "crate::");
            let above = paths_after(&text, "\nuse super::")
                .into_iter()
                .map(|path| [parent, &path].concat());
            let below = paths_after(&text, "pub use ")
                .into_iter()
                .filter(|path| path.first().is_some_and(|first| first != "crate"))
                .map(|path| [&module[..], &path].concat());
            let targets = own.into_iter().chain(above).chain(below).filter_map(|path| {
                // The longest beginning of the path that is a file.
                (0..=path.len()).rev().find_map(|n| all.get(&path[..n])).cloned()
            });
            graph.entry(file.clone()).or_default().extend(targets.filter(|to| to != file));
        }
    }
    graph
}

fn python_graph() -> Graph {
    let package = root().join("sim-bridge/sim_bridge");
    let all = files(&package, "py");
    let mut graph = Graph::new();
    for file in &all {
        let text = std::fs::read_to_string(file).unwrap();
        let mut targets = BTreeSet::new();
        for line in text.lines() {
            let words: Vec<&str> =
                line.split([' ', ',', '(', ')']).filter(|w| !w.is_empty()).collect();
            let ["from", from, "import", names @ ..] = &words[..] else { continue };
            let own = from.strip_prefix("sim_bridge").map(|rest| (package.clone(), rest));
            let relative = from.strip_prefix('.').map(|rest| {
                let above = rest.len() - rest.trim_start_matches('.').len();
                (file.ancestors().nth(1 + above).unwrap().to_path_buf(), &rest[above..])
            });
            let Some((base, rest)) = own.or(relative) else { continue };
            let base = rest.split('.').filter(|s| !s.is_empty()).fold(base, |p, part| p.join(part));
            targets.insert(base.with_extension("py"));
            targets.extend(names.iter().map(|name| base.join(name).with_extension("py")));
        }
        targets.retain(|to| all.contains(to) && to != file);
        graph.insert(file.clone(), targets);
    }
    graph
}

/// A circle, as the files along it; `None` where there is none.
fn circle(graph: &Graph) -> Option<Vec<PathBuf>> {
    fn visit(
        at: &PathBuf,
        graph: &Graph,
        path: &mut Vec<PathBuf>,
        done: &mut BTreeSet<PathBuf>,
    ) -> bool {
        if let Some(start) = path.iter().position(|file| file == at) {
            path.drain(..start);
            return true;
        }
        if done.contains(at) {
            return false;
        }
        path.push(at.clone());
        if graph[at].iter().any(|to| visit(to, graph, path, done)) {
            return true;
        }
        path.pop();
        done.insert(at.clone());
        false
    }
    let mut done = BTreeSet::new();
    graph.keys().find_map(|file| {
        let mut path = Vec::new();
        visit(file, graph, &mut path, &mut done).then_some(path)
    })
}

#[track_caller]
fn check(mut graph: Graph, arrows_min: usize) {
    let arrows: usize = graph.values().map(BTreeSet::len).sum();
    assert!(arrows >= arrows_min, "{arrows} imports were found: the reader of imports is broken");
    let mut circles = Vec::new();
    while let Some(found) = circle(&graph) {
        circles.push(found.iter().map(|file| own_path(file)).collect::<Vec<_>>().join(" -> "));
        // Cut here, so that the next one is found as well.
        let next = &found[1 % found.len()];
        graph.get_mut(&found[0]).unwrap().remove(next);
    }
    assert!(circles.is_empty(), "{} circles of imports:\n{}", circles.len(), circles.join("\n"));
}

#[test]
fn no_rust_file_imports_one_that_imports_it() {
    check(rust_graph(), 200);
}

#[test]
fn no_python_file_imports_one_that_imports_it() {
    check(python_graph(), 40);
}

#[test]
fn paths_are_found_in_groups_and_alone() {
    let text = "use crate::a::{B, c::{D as E, f}};\nlet x = crate::g::h(mycrate::no);";
    let found: Vec<String> = paths_after(text, "crate::").iter().map(|p| p.join("::")).collect();
    assert_eq!(found, ["a::B", "a::c::D", "a::c::f", "g::h"]);
}

#[test]
fn a_circle_is_found() {
    let file = |name: &str| PathBuf::from(name);
    let graph = Graph::from([
        (file("a"), BTreeSet::from([file("b")])),
        (file("b"), BTreeSet::from([file("c")])),
        (file("c"), BTreeSet::from([file("b")])),
    ]);
    assert_eq!(circle(&graph).unwrap(), [file("b"), file("c")]);
}
