//! What can be wrong with a robot description.

use std::path::PathBuf;

/// A URDF file that cannot be used. Its message names the file, the joint or link, what was
/// expected and what was found.
#[derive(Debug, thiserror::Error)]
#[error("{}: {kind}", file.display())]
pub struct UrdfError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub kind: UrdfErrorKind,
}

/// What is wrong with a URDF file.
#[derive(Debug, thiserror::Error)]
pub enum UrdfErrorKind {
    /// The file cannot be read.
    #[error("expected a readable URDF file, found: {0}")]
    NotReadable(std::io::Error),
    /// The text is no URDF: the XML is broken, or an element or attribute is missing.
    #[error("expected a URDF document, found: {0}")]
    NotUrdf(String),
    /// The document is larger than any robot's: made to hurt, or no robot.
    #[error(
        "line {line}: expected a robot of at most {most} {what}, found more; take out what is not the arm"
    )]
    TooMany {
        /// Where the bound is reached.
        line: usize,
        /// What there is too much of.
        what: &'static str,
        /// The bound.
        most: usize,
    },
    /// Two links or two joints have the same name.
    #[error("{element} `{name}`: expected unique names, found it twice")]
    DuplicateName {
        /// `link` or `joint`.
        element: &'static str,
        /// The name.
        name: String,
    },
    /// A joint refers to a link that does not exist.
    #[error("joint `{joint}`: expected its {role} to be a link of the file, found `{link}`")]
    UnknownLink {
        /// The joint.
        joint: String,
        /// `parent` or `child`.
        role: &'static str,
        /// The name found.
        link: String,
    },
    /// A link is the child of two joints.
    #[error("link `{link}`: expected one parent joint, found `{first}` and `{second}`")]
    TwoParents {
        /// The link.
        link: String,
        /// One of its parent joints.
        first: String,
        /// Another one.
        second: String,
    },
    /// There is no root link, or more than one.
    #[error("expected exactly one root link, found {}: {}", .found.len(), .found.join(", "))]
    RootCount {
        /// The links without a parent.
        found: Vec<String>,
    },
    /// The tool link does not exist.
    #[error("tool link `{tool_link}`: expected a link of the file, found only: {}", .found.join(", "))]
    UnknownToolLink {
        /// The name asked for.
        tool_link: String,
        /// The links of the file.
        found: Vec<String>,
    },
    /// The base link is no link of the file.
    #[error("base link `{base_link}`: expected a link of the file, found only: {}", .found.join(", "))]
    UnknownBaseLink {
        /// The name asked for.
        base_link: String,
        /// The links of the file.
        found: Vec<String>,
    },
    /// The base link is not above the tool link.
    #[error(
        "base link `{base_link}`: expected a link between the root and `{tool_link}`, found one beside"
    )]
    NotAbove {
        /// The base link.
        base_link: String,
        /// The tool link.
        tool_link: String,
    },
    /// A joint that shall be held is no joint of the file.
    #[error("held joint `{joint}`: expected a joint of the file, found only: {}", .found.join(", "))]
    UnknownHeldJoint {
        /// The name given.
        joint: String,
        /// The joints of the file.
        found: Vec<String>,
    },
    /// A link's parents run in a circle.
    #[error("link `{link}`: expected a path to the root link, found a closed loop")]
    ClosedLoop {
        /// A link of the loop.
        link: String,
    },
    /// A joint between the root link and the tool is of a type that is not supported.
    #[error(
        "joint `{joint}`: expected type revolute, continuous, prismatic or fixed, found {found}"
    )]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// Its type, or `mimic`.
        found: &'static str,
    },
    /// A joint that can move does not lie between the root link and the tool.
    #[error(
        "joint `{joint}`: expected a fixed joint beside the path from the root link to `{tool_link}`, found {found}"
    )]
    MovableBranch {
        /// The joint.
        joint: String,
        /// Its type.
        found: &'static str,
        /// The tool link.
        tool_link: String,
    },
    /// The chain has another number of movable joints than the caller's `N`.
    #[error(
        "tool link `{tool_link}`: expected {expected} movable joints on its path, found {found}"
    )]
    JointCount {
        /// The tool link.
        tool_link: String,
        /// The caller's `N`.
        expected: usize,
        /// Revolute, continuous and prismatic joints on the path.
        found: usize,
    },
    /// The chain has more or fewer movable joints than this crate is built for.
    #[error(
        "tool link `{tool_link}`: expected {min} to {max} movable joints on its path, found {found}"
    )]
    JointCountRange {
        /// The tool link.
        tool_link: String,
        /// [`crate::JOINTS_MIN`].
        min: usize,
        /// [`crate::JOINTS_MAX`].
        max: usize,
        /// Revolute, continuous and prismatic joints on the path.
        found: usize,
    },
    /// A number is infinite or not a number.
    #[error("{element} `{name}`: {quantity}: expected a finite number, found {found}")]
    NotFinite {
        /// `link` or `joint`.
        element: &'static str,
        /// Its name.
        name: String,
        /// The URDF element.
        quantity: &'static str,
        /// The number.
        found: f64,
    },
    /// A number is larger than any arm's.
    #[error(
        "{element} `{name}`: {quantity}: expected at most {most:e} in SI units, found {found:e}"
    )]
    TooLarge {
        /// `link` or `joint`.
        element: &'static str,
        /// Its name.
        name: String,
        /// The URDF element.
        quantity: &'static str,
        /// The bound.
        most: f64,
        /// The number.
        found: f64,
    },
    /// A movable joint has no axis.
    #[error("joint `{joint}`: axis: expected a vector longer than zero, found 0 0 0")]
    ZeroAxis {
        /// The joint.
        joint: String,
    },
    /// A movable joint has no limits.
    #[error(
        "joint `{joint}`: expected a <limit> with lower, upper, velocity and effort, found none (or only zeros)"
    )]
    NoLimits {
        /// The joint.
        joint: String,
    },
    /// A velocity or effort limit is zero or negative.
    #[error("joint `{joint}`: limit {limit}: expected a positive number of {unit}, found {found}")]
    LimitNotPositive {
        /// The joint.
        joint: String,
        /// `velocity` or `effort`.
        limit: &'static str,
        /// Its unit.
        unit: &'static str,
        /// The number.
        found: f64,
    },
    /// The position limits leave no range.
    #[error(
        "joint `{joint}`: limit: expected lower < upper, found lower {lower} and upper {upper}"
    )]
    LimitOrder {
        /// The joint.
        joint: String,
        /// Lower position limit [rad or m].
        lower: f64,
        /// Upper position limit [rad or m].
        upper: f64,
    },
    /// A mass is negative.
    #[error("link `{link}`: mass: expected zero or a positive number of kg, found {found}")]
    NegativeMass {
        /// The link.
        link: String,
        /// The mass [kg].
        found: f64,
    },
    /// A rotational inertia has a negative principal moment.
    #[error(
        "link `{link}`: inertia: expected principal moments of zero or more kg m², found the smallest {found}"
    )]
    NegativeInertia {
        /// The link.
        link: String,
        /// The smallest principal moment [kg m²].
        found: f64,
    },
    /// A collision shape has a dimension of zero or less.
    #[error("link `{link}`: collision {dimension}: expected a positive number of m, found {found}")]
    DimensionNotPositive {
        /// The link.
        link: String,
        /// The dimension.
        dimension: &'static str,
        /// The number.
        found: f64,
    },
}
