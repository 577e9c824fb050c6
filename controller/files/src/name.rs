//! Names that come out of files.

use core::fmt;
use core::ops::Deref;
use core::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::printable::is_control;

/// The name of a skill, a frame, a drawing or a file, as somebody else's file gives it. It is fit
/// for a file name, a line on a terminal and a page:
///
/// * 1 to [`Name::BYTES_MAX`] bytes;
/// * no `/`, no `\`, no control character, nothing that turns the direction of writing;
/// * neither `.` nor `-` first, no white space at the ends.
///
/// ```
/// use tprmp_files::Name;
///
/// let name: Name = "two-loops".parse().unwrap();
/// assert_eq!(format!("{name}_01.json"), "two-loops_01.json");
/// let refused = "../../evil".parse::<Name>().unwrap_err();
/// assert!(refused.to_string().contains("found \"../../evil\""), "{refused}");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Name(String);

/// A text that is no name; it says what was expected and what was found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected a name of 1 to {max} bytes without `/`, `\\`, control characters, a dot or minus sign first or \
     white space at its ends, found {found}", max = Name::BYTES_MAX
)]
pub struct NameError {
    /// The beginning of the text, quoted and escaped.
    found: String,
}

/// So many characters of a text that is no name are shown.
const SHOWN: usize = 40;

impl Name {
    /// With a number and an extension it is still a file name on every file system.
    pub const BYTES_MAX: usize = 100;

    /// Checks a name.
    ///
    /// # Errors
    /// [`NameError`], when the text is not fit for a file name, a terminal and a page.
    pub fn new(text: impl Into<String>) -> Result<Self, NameError> {
        let text = text.into();
        check(&text)?;
        Ok(Self(text))
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Checks a name that stays where it is.
///
/// # Errors
/// [`NameError`], as for [`Name::new`].
pub fn check(text: &str) -> Result<(), NameError> {
    let fits = (1..=Name::BYTES_MAX).contains(&text.len())
        && !text.starts_with(['.', '-'])
        && text.trim() == text
        && !text.contains(|c| matches!(c, '/' | '\\') || is_control(c));
    if fits {
        return Ok(());
    }
    let beginning: String = text.chars().take(SHOWN).collect();
    let more = if beginning.len() < text.len() { "…" } else { "" };
    let escaped: String = beginning
        .chars()
        .map(|c| if is_control(c) { c.escape_unicode().to_string() } else { c.to_string() })
        .collect();
    Err(NameError { found: format!("\"{escaped}{more}\" ({} bytes)", text.len()) })
}

impl FromStr for Name {
    type Err = NameError;

    fn from_str(text: &str) -> Result<Self, NameError> {
        Self::new(text)
    }
}

impl TryFrom<String> for Name {
    type Error = NameError;

    fn try_from(text: String) -> Result<Self, NameError> {
        Self::new(text)
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

impl Deref for Name {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_that_would_be_paths_or_move_a_cursor_are_refused() {
        let long = "a".repeat(Name::BYTES_MAX + 1);
        for bad in [
            "",
            ".",
            "..",
            "../../evil",
            "/etc/passwd",
            "a/b",
            "a\\b",
            ".hidden",
            "-rf",
            " a",
            "a ",
            "a\n",
            "a\0b",
            "\u{1b}[2J",
            "\u{202e}gnp",
            "a\u{2028}b",
            &long,
        ] {
            let refused = Name::new(bad).unwrap_err().to_string();
            assert!(!refused.contains(|c: char| is_control(c)), "{refused:?}");
            assert!(refused.contains("expected a name") && refused.len() < 300, "{refused}");
            assert!(serde_json::from_value::<Name>(bad.into()).is_err());
        }
        for good in ["pick", "two-loops", "Zug um Zug", "größer", "日本", "a..b", &long[1..]] {
            assert_eq!(Name::new(good).unwrap().as_str(), good);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        /// Whatever is accepted is one component of a path, and the same after being joined.
        #[test]
        fn a_name_is_one_component_of_a_path(text in any::<String>()) {
            if let Ok(name) = Name::new(text) {
                let path = std::path::Path::new("folder").join(name.as_str());
                prop_assert_eq!(path.components().count(), 2);
                prop_assert_eq!(path.file_name().unwrap().to_str().unwrap(), name.as_str());
            }
        }
    }
}
