//! From a file to a document.

use std::path::Path;

use crate::document::Document;
use crate::error::{UrdfError, UrdfErrorKind as Kind, UrdfFault};
use crate::xml::{self, Element};
use crate::{foreign, sanitise, xacro};

/// Largest file [bytes]; descriptions of whole humanoids have some hundred thousand.
const BYTES_MAX: u64 = 4 << 20;

impl Document {
    /// Reads a URDF.
    ///
    /// # Errors
    ///
    /// [`UrdfError`] when the file cannot be read, is no URDF, or still has parts of xacro: then with
    /// the command that expands them.
    pub fn read(file: impl AsRef<Path>) -> Result<Self, UrdfError> {
        let file = file.as_ref();
        let read = || {
            let root = root(&text(file)?)?;
            match xacro::left_in(&root) {
                None => of(file, &root),
                Some((line, found)) => Err(UrdfFault::at(line, xacro::unexpanded(file, found))),
            }
        };
        read().map_err(|fault| UrdfError::of(file, vec![fault]))
    }

    /// Reads a URDF; what still has parts of xacro is expanded by that program first, in at most half a
    /// minute. The second value says whether it was: lines are those of the expanded text then, and the
    /// document's file says so behind its name. For commands that do not move an arm.
    ///
    /// # Errors
    ///
    /// As [`Self::read`], and when xacro is not there or fails: with what it says.
    pub fn read_expanding(file: impl AsRef<Path>) -> Result<(Self, bool), UrdfError> {
        let file = file.as_ref();
        let read = || {
            let root_found = root(&text(file)?)?;
            let Some((line, found)) = xacro::left_in(&root_found) else {
                return Ok((of(file, &root_found)?, false));
            };
            let expanded = xacro::expand(file, found, BYTES_MAX);
            let expanded = expanded.map_err(|kind| UrdfFault::at(line, kind))?;
            let mut name = file.file_name().unwrap_or_default().to_owned();
            name.push(", expanded by xacro");
            Ok((of(&file.with_file_name(name), &root(&expanded)?)?, true))
        };
        read().map_err(|fault| UrdfError::of(file, vec![fault]))
    }
}

fn text(file: &Path) -> Result<String, UrdfFault> {
    tprmp_files::read_text(file, BYTES_MAX)
        .map_err(|error| UrdfFault::new(Kind::NotReadable(error.to_string())))
}

/// The root element of a text.
fn root(text: &str) -> Result<Element, UrdfFault> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    foreign::check_text(text)?;
    xml::parse(text)
}

fn of(file: &Path, root: &Element) -> Result<Document, UrdfFault> {
    foreign::check_root(root)?;
    let (links, joints, faults) = sanitise::read(root)?;
    Ok(Document { file: file.to_owned(), links, joints, faults })
}
