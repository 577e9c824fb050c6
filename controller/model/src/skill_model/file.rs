//! Reads and writes model files.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use tprmp_files::{Draft, Existing, WriteError};

use crate::ron_text::{compact, entries};
use crate::skill_model::model::SkillModel;
use crate::skill_model::upgrade::{SCHEMA_BEFORE, SCHEMA_RENAMED, upgraded};

/// Schema version this crate writes, and reads beside the two before.
pub const SCHEMA: &str = "tprmp-model/7";

/// Largest file [bytes]: most Gaussians, frames and coordinates together make less than one MiB.
const BYTES_MAX: u64 = 2 << 20;

/// Why a model file was refused.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file cannot be read.
    #[error("model file `{path}` cannot be read: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file is truncated, or not RON of the schema's shape.
    #[error(
        "model file `{path}`, {position}: {problem} (truncated, or not a {SCHEMA} file: train it again)"
    )]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line and column.
        position: String,
        /// What the parser says.
        problem: String,
    },
    /// The file has a schema that is not read.
    #[error(
        "model file `{path}`, key `schema`: expected `{SCHEMA}`, or `{SCHEMA_BEFORE}` or \
         `{SCHEMA_RENAMED}` of earlier versions, found `{found}`: train it again with this version"
    )]
    Schema {
        /// The file.
        path: PathBuf,
        /// The schema in the file.
        found: String,
    },
    /// The body is not the one that was written.
    #[error(
        "model file `{path}`, key `checksum`: the body was changed or damaged \
         (expected `{expected}`, found `{found}`): train it again"
    )]
    Checksum {
        /// The file.
        path: PathBuf,
        /// Checksum that the file states.
        expected: String,
        /// Checksum of the body in the file.
        found: String,
    },
    /// A value breaks a rule of the model.
    #[error("model file `{path}`, key `{key}`: {problem}")]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Where in the body.
        key: String,
        /// What was expected, and found.
        problem: String,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

#[derive(Deserialize)]
struct Header {
    schema: String,
}

#[derive(Serialize)]
struct ModelFileOut<'a> {
    schema: &'a str,
    checksum: String,
    body: &'a SkillModel,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelFileIn {
    #[serde(rename = "schema")]
    _schema: String,
    checksum: String,
    body: SkillModel,
}

/// Reads and validates a model file, of this version's schema or of the two before.
///
/// # Errors
/// [`ModelError`], each naming the file: it is missing, truncated, of a schema that is not read,
/// does not match its checksum, or holds a value that is not finite, of the wrong dimension or
/// not positive definite.
pub fn read(path: &Path) -> Result<SkillModel, ModelError> {
    let text = tprmp_files::read_text(path, BYTES_MAX)
        .map_err(|source| ModelError::Read { path: path.into(), source })?;
    parse(&text, path)
}

/// Parses and validates the text of a model file; `path` is for messages.
fn parse(text: &str, path: &Path) -> Result<SkillModel, ModelError> {
    let syntax = |error: ron::error::SpannedError| ModelError::Syntax {
        path: path.into(),
        position: format!("line {}, column {}", error.span.start.line, error.span.start.col),
        problem: tprmp_files::shortened(&error.code.to_string()),
    };
    // The header first: a body of another version need not parse.
    let header: Header = ron::from_str(text).map_err(syntax)?;
    let file: ModelFileIn = match header.schema.as_str() {
        SCHEMA | SCHEMA_BEFORE => ron::from_str(text).map_err(syntax)?,
        SCHEMA_RENAMED => ron::from_str(&upgraded(text)).map_err(syntax)?,
        _ => return Err(ModelError::Schema { path: path.into(), found: header.schema }),
    };
    let body = entries(text).into_iter().find(|entry| entry.path == "body");
    let body = body.map_or("", |entry| &text[entry.value]);
    let found = checksum(&compact(body));
    if found != file.checksum {
        return Err(ModelError::Checksum { path: path.into(), expected: file.checksum, found });
    }
    validated(&file.body, path)?;
    Ok(file.body)
}

/// The text of a model file.
#[must_use]
pub fn to_text(model: &SkillModel) -> String {
    let body = ron::to_string(model).expect("plain numbers and strings serialise");
    let file = ModelFileOut { schema: SCHEMA, checksum: checksum(&body), body: model };
    let layout = ron::ser::PrettyConfig::new().compact_arrays(true).new_line("\n").indentor("  ");
    let mut text =
        ron::ser::to_string_pretty(&file, layout).expect("plain numbers and strings serialise");
    text.push('\n');
    text
}

/// Validates and writes a model file, in place of one that is there. What was written is read back
/// before it gets its name.
///
/// # Errors
/// [`ModelError`], naming the file: a value breaks a rule, or the file cannot be written.
pub fn write(model: &SkillModel, path: &Path) -> Result<(), ModelError> {
    validated(model, path)?;
    let mut draft = Draft::open(path, Existing::Replace)?;
    draft.put(to_text(model))?;
    let back = read(draft.temporary())?;
    assert!(back == *model, "the model read back is the one that was written");
    Ok(draft.keep()?)
}

/// SHA-256 of some bytes, hexadecimal.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    let mut hex = String::with_capacity(64);
    for byte in Sha256::digest(bytes) {
        write!(hex, "{byte:02x}").expect("a string grows");
    }
    hex
}

/// Of a body without a layout.
fn checksum(body: &str) -> String {
    format!("sha256:{}", sha256_hex(body.as_bytes()))
}

fn validated(model: &SkillModel, path: &Path) -> Result<(), ModelError> {
    model.validate().map_err(|(key, problem)| ModelError::Invalid {
        path: path.into(),
        key,
        problem,
    })
}
