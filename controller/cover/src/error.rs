//! What keeps a whole robot from being covered. What is wrong with a mesh is told of its link instead.

use std::path::PathBuf;

/// Why there is no cover at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CoverError {
    /// The URDF cannot be read.
    #[error("`{}`: expected a URDF, found: {text}", file.display())]
    Urdf {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        text: String,
    },
    /// A link that was named is not there.
    #[error("`{}`: expected one of the links {}, found `{link}`", file.display(), found.join(", "))]
    UnknownLink {
        /// The file.
        file: PathBuf,
        /// The link that was named.
        link: String,
        /// The links there are.
        found: Vec<String>,
    },
    /// Nothing moves.
    #[error("`{}`: expected links that a joint moves, found none; look at --base, --tool and --held", file.display())]
    NothingMoves {
        /// The file.
        file: PathBuf,
    },
    /// An option is out of its range.
    #[error("expected {expected}, found {found}")]
    Option {
        /// Name and range.
        expected: String,
        /// The value.
        found: String,
    },
    /// So few spheres cover no arm.
    #[error(
        "expected at least {least} spheres for {links} links with shapes, found {found}; give more, or fewer links"
    )]
    TooFewSpheres {
        /// One a link, and those that are spheres already.
        least: usize,
        /// Links with shapes.
        links: usize,
        /// Spheres permitted.
        found: usize,
    },
}
