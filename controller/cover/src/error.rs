//! What keeps a whole robot from being covered. What is wrong with a mesh is told of its link instead.

use std::path::PathBuf;

use tprmp_robot::CONTROL_POINT_CAPACITY;

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
        "`{}`: expected at least {least} spheres for {links} links with shapes, found {found}; {}",
        file.display(),
        remedy(*least)
    )]
    TooFewSpheres {
        /// The file.
        file: PathBuf,
        /// One a link, and those that are spheres already.
        least: usize,
        /// Links with shapes.
        links: usize,
        /// Spheres permitted.
        found: usize,
    },
}

/// What to do where so many spheres are the least.
fn remedy(least: usize) -> String {
    let fewer = "where more moves than the arm, as a torso, say where it begins: `--base LINK`";
    if least > CONTROL_POINT_CAPACITY {
        return format!(
            "an arm has at most {CONTROL_POINT_CAPACITY}; {fewer}, and where it ends: `--tool LINK`"
        );
    }
    format!("permit more, up to {CONTROL_POINT_CAPACITY}: `--spheres {least}`; {fewer}")
}
