//! What is told of a configuration that was written.

use core::fmt;

/// Whether somebody has to look at what is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoteKind {
    /// What was found or chosen.
    Found,
    /// What the description lacks: a default stands in its place.
    Lack,
}

/// Something to be told.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// Whether somebody has to look at it.
    pub kind: NoteKind,
    /// What it is.
    pub text: String,
}

impl Note {
    pub(super) fn found(text: String) -> Self {
        Self { kind: NoteKind::Found, text }
    }

    pub(super) fn lack(text: String) -> Self {
        Self { kind: NoteKind::Lack, text }
    }
}

impl fmt::Display for NoteKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Found => "ok",
            Self::Lack => "look",
        })
    }
}
