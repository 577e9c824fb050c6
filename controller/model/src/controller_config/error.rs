//! Why a configuration is refused.

use std::path::PathBuf;

/// Why a configuration was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("configuration `{path}` cannot be read: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// What is wrong in the file and its base; at least one fault.
    #[error("{}", lines(.0))]
    Faults(Vec<Fault>),
}

fn lines(faults: &[Fault]) -> String {
    faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

/// Something that is wrong in a configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// The file in which it stands.
    pub path: PathBuf,
    /// Line and column, from 1, of a fault in the text.
    pub position: Option<(usize, usize)>,
    /// The key, from the outermost.
    pub key: Option<String>,
    /// What is wrong.
    pub problem: Problem,
}

/// What is wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// The text is not RON, or a value is of another type.
    #[error("{0}")]
    Syntax(String),
    /// A key stands neither in the file nor in its base.
    #[error("the key is missing: there are no defaults")]
    Missing,
    /// A key that there is not.
    #[error("unknown key, expected one of {}", .expected.join(", "))]
    Unknown {
        /// The keys that there are.
        expected: &'static [&'static str],
    },
    /// A key that stands twice in one file.
    #[error("the key is given twice")]
    Twice,
    /// A key of the last version.
    #[error("`{old}` is now `{new}`")]
    Renamed {
        /// The key.
        old: &'static str,
        /// What it is called now.
        new: &'static str,
    },
    /// A value is outside its range.
    #[error("expected {expected}, found {found}")]
    Value {
        /// What was expected.
        expected: &'static str,
        /// What was found.
        found: String,
    },
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "configuration `{}`", self.path.display())?;
        if let Some((line, column)) = self.position {
            write!(f, ", line {line}, column {column}")?;
        }
        if let Some(key) = &self.key {
            write!(f, ", key `{key}`")?;
        }
        write!(f, ": {}", self.problem)
    }
}
