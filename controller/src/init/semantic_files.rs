//! Reads what XRDF and SRDF files know of an arm.

use std::path::Path;

use tprmp_robot::Document;

use crate::init::notes::Note;
use crate::init::semantic::{Semantic, SemanticError};
use crate::init::srdf::parse_srdf;
use crate::init::xrdf::parse_xrdf;

/// Largest file \[bytes\].
const BYTES_MAX: u64 = 4 << 20;

/// Reads the files that there are. What an XRDF says counts before an SRDF.
///
/// # Errors
/// [`SemanticError`].
pub(super) fn read(
    document: &Document,
    xrdf: Option<&Path>,
    srdf: Option<&Path>,
    notes: &mut Vec<Note>,
) -> Result<Semantic, SemanticError> {
    let mut semantic = Semantic::default();
    for (path, parse) in
        [(srdf, parse_srdf as fn(&str, &mut Semantic) -> Result<(), String>), (xrdf, parse_xrdf)]
    {
        let Some(path) = path else { continue };
        let failed = |text: String| SemanticError { file: path.to_owned(), text };
        let text =
            tprmp_files::read_text(path, BYTES_MAX).map_err(|error| failed(error.to_string()))?;
        let before = semantic.home_name.clone();
        parse(&text, &mut semantic).map_err(failed)?;
        if semantic.home_name != before {
            semantic.home_file = path.to_owned();
        }
        semantic.check(document, path, notes)?;
    }
    Ok(semantic)
}
