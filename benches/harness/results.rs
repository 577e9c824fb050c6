//! `target/bench/results.json`: an array with one flat object a row, of every benchmark.
//!
//! A row has `group`, `name`, its settings, and `p50`, `p99`, `p999`, `max` with the unit in the
//! key; where something is promised, a [`Verdict`] under `verdict`. A row that belongs to a plot
//! has `series`, what is varied, `x`, its value, and `best_us`. Histograms stand under
//! `histograms_us`, each a list of `[upper bound, count]`.

use std::path::{Path, PathBuf};
use std::{fs, io};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Something promised, and what was found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdict {
    /// The promise.
    pub must: String,
    /// What was measured.
    pub found: String,
    /// Whether it holds; `None` where this run cannot decide.
    pub holds: Option<bool>,
}

impl Verdict {
    /// A quantity that must not exceed a limit.
    pub fn at_most(found: f64, limit: f64, unit: &str) -> Self {
        Self {
            must: format!("≤ {limit} {unit}"),
            found: format!("{found:.3} {unit}"),
            holds: (!found.is_nan()).then_some(found <= limit),
        }
    }

    /// The verdict in a word.
    pub fn word(&self) -> &'static str {
        match self.holds {
            Some(true) => "holds",
            Some(false) => "does not hold",
            None => "open",
        }
    }
}

/// The folder of what benchmarks write.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("target/bench")
}

/// Puts the rows of a group in the place of its former ones in `target/bench/results.json`.
///
/// # Errors
/// When a row is not an object, or the file cannot be read or written.
pub fn replace(group: &str, rows: &[Value]) -> io::Result<()> {
    fs::create_dir_all(folder())?;
    let path = folder().join("results.json");
    let before = if path.exists() { read()? } else { Vec::new() };
    let rows = merged(before, group, rows)?;
    // Renamed into place: a reader, or a run that is ended, never leaves half a file.
    let unfinished = path.with_extension("json.new");
    fs::write(&unfinished, format!("{:#}\n", Value::from(rows)))?;
    fs::rename(unfinished, path)
}

/// All rows of `target/bench/results.json`.
///
/// # Errors
/// When it cannot be read, or is not an array.
pub fn read() -> io::Result<Vec<Value>> {
    let path = folder().join("results.json");
    let wrong = |found: String| {
        let path = path.display();
        io::Error::other(format!("`{path}`: expected an array of rows, found {found}"))
    };
    match serde_json::from_str(&fs::read_to_string(&path)?) {
        Ok(Value::Array(rows)) => Ok(rows),
        Ok(other) => Err(wrong(other.to_string())),
        Err(error) => Err(wrong(error.to_string())),
    }
}

fn merged(before: Vec<Value>, group: &str, rows: &[Value]) -> io::Result<Vec<Value>> {
    let mut all: Vec<Value> = before.into_iter().filter(|row| row["group"] != group).collect();
    for row in rows {
        let Value::Object(fields) = row else {
            return Err(io::Error::other(format!("expected a row, found `{row}`")));
        };
        let mut named = Map::from_iter([("group".into(), group.into())]);
        named.extend(fields.clone());
        all.push(named.into());
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_group_replaces_its_own_rows_and_keeps_the_others() {
        let first = merged(Vec::new(), "a", &[json!({ "name": "old" })]).unwrap();
        let second = merged(first, "b", &[json!({ "name": "other" })]).unwrap();
        let third = merged(second, "a", &[json!({ "name": "new", "p50_us": 1.5 })]).unwrap();
        assert_eq!(
            Value::from(third),
            json!([
                { "group": "b", "name": "other" },
                { "group": "a", "name": "new", "p50_us": 1.5 },
            ])
        );
    }

    #[test]
    fn what_is_not_a_row_is_refused() {
        let error = merged(Vec::new(), "a", &[json!(3)]).unwrap_err();
        assert!(error.to_string().contains("found `3`"), "{error}");
    }

    #[test]
    fn a_limit_is_kept_or_not_or_unknown() {
        assert_eq!(Verdict::at_most(1.0, 1.0, "s").holds, Some(true));
        assert_eq!(Verdict::at_most(1.1, 1.0, "s").holds, Some(false));
        assert_eq!(Verdict::at_most(f64::NAN, 1.0, "s").holds, None);
    }
}
