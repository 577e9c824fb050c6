//! One word for one thing, the field's own: words that were replaced do not come back.

use crate::{files, own_path, root};

/// Words that are used nowhere any more, and what to write in their place. They are looked for as whole
/// parts of names, whatever their case: `headway` is found in `headway_m` and in `HeadwayMin`.
const REPLACED: &[(&str, &str)] = &[
    ("foretell", "predict"),
    ("foretells", "predicts"),
    ("foretold", "predicted"),
    ("headway", "progress"),
    ("loudness", "weight"),
    ("nearness", "proximity"),
    ("newcomer", "new peer"),
    ("newcomers", "new peers"),
    ("standstill", "stall"),
    ("wish", "desired motion"),
    ("wished", "desired"),
    ("wishes", "desired motions"),
];

/// Words that name nothing in code any more; in prose some of them are ordinary English.
const NO_NAMES: &[(&str, &str)] = &[
    ("board", "shared status"),
    ("bend", "second derivative"),
    ("bends", "second derivative"),
    ("blaming", "leave-one-out diagnosis"),
    ("course", "task state, rollout specification"),
    ("demands", "constraints, requirements"),
    ("ending", "outcome"),
    ("examiner", "certifier"),
    ("led", "externally commanded"),
    ("louder", "heavier"),
    ("pressing", "obstructed fraction"),
    ("refusal", "denied capability"),
    ("repairs", "refinement rounds"),
    ("share", "fraction"),
    ("shares", "fractions"),
    ("shown", "demonstrated"),
    ("situation", "policy instance"),
    ("surroundings", "proximity"),
];

/// The words of a name, in lower case: `maxSpeed_m_s` has max, speed, m and s.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut lower_before = false;
    for c in line.chars() {
        if !c.is_alphabetic() || (c.is_uppercase() && lower_before) {
            words.push(String::new());
        }
        if c.is_alphabetic() {
            words.last_mut().unwrap().extend(c.to_lowercase());
        }
        lower_before = c.is_lowercase();
    }
    words
}

#[test]
fn words_that_were_replaced_do_not_come_back() {
    let mut found = Vec::new();
    let all = ["rs", "py", "ron", "md", "toml"].into_iter().flat_map(|e| files(root(), e));
    for path in all {
        let name = own_path(&path);
        // The change log names what was renamed, this file and the readers of old files what is read.
        if name == "CHANGELOG.md"
            || name.ends_with("repository/words.rs")
            || name.contains("renamed")
            || name.contains("upgrade")
            || name.contains("tests/data/")
        {
            continue;
        }
        for (i, line) in std::fs::read_to_string(&path).unwrap().lines().enumerate() {
            if line.ends_with("// the old names") {
                continue;
            }
            let code = line.split("//").next().unwrap();
            let prose = name.ends_with(".md") || name.ends_with(".toml");
            let names = if prose || line.trim_start().starts_with('#') { &[] } else { NO_NAMES };
            let everywhere = REPLACED.iter().map(|pair| (pair, line));
            for ((old, new), text) in everywhere.chain(names.iter().map(|pair| (pair, code))) {
                if words(text).iter().any(|word| word == old) {
                    found.push(format!(
                        "{name}:{}: `{old}`, write `{new}`: {}",
                        i + 1,
                        line.trim()
                    ));
                }
            }
        }
    }
    assert!(found.is_empty(), "{} replaced words:\n{}", found.len(), found.join("\n"));
}

#[test]
fn a_word_is_found_in_a_name_of_any_style() {
    for name in ["speed_share", "SpeedShare", "SHARE_MAX", "a share of"] {
        assert!(words(name).contains(&"share".to_owned()), "{name}");
    }
    assert!(!words("shared memory").contains(&"share".to_owned()));
}
