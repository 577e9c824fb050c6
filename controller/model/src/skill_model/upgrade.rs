//! Model files of earlier versions.

use std::ops::Range;

use crate::renamed::new_name;
use crate::ron_text::{entries, tokens};

/// Schema of the last version, which is read too: it only lacks figures of the fit.
pub(super) const SCHEMA_BEFORE: &str = "tprmp-model/6";
/// Schema of the version before, which is read too, with other names.
pub(super) const SCHEMA_RENAMED: &str = "tprmp-model/5";

/// Names of the fit's figures and constraints in that version, and what they are called now.
const RENAMED_FIT: [(&str, &str); 3] = [
    ("repairs", "refinement rounds"),
    ("share against the demonstrations", "fraction against the demonstrations"),
    ("stiffness across the way", "stiffness across the path"),
];

/// The text of a file of that version with this version's names; nothing else changes.
pub(super) fn upgraded(text: &str) -> String {
    let entries = entries(text);
    let within = |path: &str| {
        let entry = entries.iter().find(|entry| entry.path == path);
        entry.map_or(0..0, |entry| entry.value.clone())
    };
    let fit = within("body.fit.programs");
    let hyper_parameters = within("body.provenance.hyper_parameters");
    let keys: Vec<&Range<usize>> = entries.iter().map(|entry| &entry.key).collect();
    let (mut upgraded, mut done) = (String::with_capacity(text.len()), 0);
    for token in tokens(text) {
        let name = token.text.trim_matches('"');
        let is_key = || keys.binary_search_by_key(&token.start, |key| key.start).is_ok();
        let new = if fit.contains(&token.start) && token.text.starts_with('"') {
            RENAMED_FIT.iter().find(|(old, _)| *old == name).map(|(_, new)| format!("\"{new}\""))
        } else if hyper_parameters.contains(&token.start) {
            // `section.key`, of a skill file.
            let section = name.rfind('.').map_or(0, |dot| dot + 1);
            new_name(&name[section..]).map(|new| format!("\"{}{new}\"", &name[..section]))
        } else {
            new_name(name).filter(|_| is_key()).map(Into::into)
        };
        if let Some(new) = new {
            upgraded += &text[done..token.start];
            upgraded += &new;
            done = token.end();
        }
    }
    upgraded + &text[done..]
}
