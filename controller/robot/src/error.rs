//! What can be wrong with a robot description.

use std::fmt;
use std::path::{Path, PathBuf};

/// Most faults that are listed; a file of many more has one cause.
const LISTED_MAX: usize = 50;

/// A URDF file that cannot be used: all that is wrong with it, at least one fault. Its message has a line
/// for each, with the file, the line, the joint or link, what was expected and what was found.
#[derive(Debug)]
pub struct UrdfError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub faults: Vec<UrdfFault>,
}

impl UrdfError {
    pub(crate) fn of(file: &Path, faults: Vec<UrdfFault>) -> Self {
        Self { file: file.to_owned(), faults }
    }
}

impl std::error::Error for UrdfError {}

impl fmt::Display for UrdfError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = self.file.display();
        for (i, fault) in self.faults.iter().take(LISTED_MAX).enumerate() {
            let before = if i == 0 { "" } else { "\n" };
            write!(f, "{before}{file}: {fault}")?;
        }
        match self.faults.len().checked_sub(LISTED_MAX) {
            Some(more @ 1..) => write!(f, "\n{file}: and {more} more"),
            _ => Ok(()),
        }
    }
}

/// One thing that is wrong with a URDF file.
#[derive(Debug, Clone)]
pub struct UrdfFault {
    /// The line of the file, from 1, where it can be known.
    pub line: Option<usize>,
    /// What is wrong.
    pub kind: UrdfErrorKind,
}

impl UrdfFault {
    pub(crate) fn new(kind: UrdfErrorKind) -> Self {
        Self { line: None, kind }
    }

    pub(crate) fn at(line: usize, kind: UrdfErrorKind) -> Self {
        Self { line: Some(line), kind }
    }
}

impl fmt::Display for UrdfFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(line) = self.line {
            write!(f, "line {line}: ")?;
        }
        write!(f, "{}", self.kind)
    }
}

/// What is wrong with a URDF file.
#[derive(Debug, Clone, thiserror::Error)]
pub enum UrdfErrorKind {
    /// The file cannot be read.
    #[error("expected a readable URDF file, found: {0}")]
    NotReadable(String),
    /// The file is no URDF.
    #[error("expected a URDF document, found {found}; {remedy}")]
    NotUrdf {
        /// What it is.
        found: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The document is larger than any robot's: made to hurt, or no robot.
    #[error("expected a robot of at most {most} {what}, found more; take out what is not the arm")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// The bound.
        most: usize,
    },
    /// Parts of xacro are left in the file.
    #[error(
        "expected a URDF, found {found} of xacro; expand it with `xacro '{}' -o '{}'` (`pip install \
         xacro`) and use that file", file.display(), urdf.display()
    )]
    Xacro {
        /// What stands there.
        found: String,
        /// The file.
        file: PathBuf,
        /// A name for what comes out.
        urdf: PathBuf,
    },
    /// The program xacro cannot expand the file.
    #[error(
        "expected a file that xacro expands, found that it says: {said}; what it includes by `$(find …)` has to be \
         installed here, or expand it where that is, and use the file that comes out"
    )]
    XacroFailed {
        /// Its message.
        said: String,
    },
    /// An element or attribute of a link or joint is missing, doubled or unreadable.
    #[error("{place}: expected {expected}, found {found}")]
    Part {
        /// The link or joint, and the element in it.
        place: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// Two links or two joints have the same name.
    #[error("{element} `{name}`: expected unique names, found it on line {first} too")]
    DuplicateName {
        /// `link` or `joint`.
        element: &'static str,
        /// The name.
        name: String,
        /// Line of the first one.
        first: usize,
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
    /// A value for a held joint that its range does not have.
    #[error(
        "held joint `{joint}`: expected a position from {lower} to {upper}, found {found}; set `robot.held_joints`"
    )]
    HeldOutside {
        /// The joint.
        joint: String,
        /// Lower end of its range [rad or m].
        lower: f64,
        /// Upper end of its range [rad or m].
        upper: f64,
        /// The position asked for [rad or m].
        found: f64,
    },
    /// A joint on the path follows another one.
    #[error(
        "joint `{joint}`: expected joints that move by themselves on the path to the tool, found that it follows `{master}`; hold `{master}` by `robot.held_joints`, or choose another tool link"
    )]
    Follows {
        /// The joint.
        joint: String,
        /// The joint it follows.
        master: String,
    },
    /// A joint between the root link and the tool is of a type that is not supported.
    #[error(
        "joint `{joint}`: expected type revolute, continuous, prismatic or fixed, found {found}"
    )]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// Its type.
        found: &'static str,
    },
    /// Joints that can move do not lie between the base and the tool.
    #[error(
        "expected joints beside the path from `{root_link}` to `{tool_link}` to be held, found {} that {} not: {}; \
         set `robot.held_joints: {{{}}}`",
        .joints.len(), if .joints.len() == 1 { "is" } else { "are" }, types(.joints), positions(.joints)
    )]
    MovableBranch {
        /// The joints.
        joints: Vec<BranchJoint>,
        /// The base.
        root_link: String,
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
        "tool link `{tool_link}`: expected {min} to {max} movable joints on its path, found {found}{}",
        if found > max { ": name a base link (`--base`, `robot.base_link`) farther up the chain" } else { "" }
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
    /// Movable joints lack limits.
    #[error(
        "expected limits of every joint, found none (or zero, or more than any arm's) for {}; set `robot.limits: {{{}}}`, or \
         mend the file{}",
        .joints.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "), overrides(.joints),
        if .joints.iter().any(|joint| joint.effort) {
            "; an arm that is not commanded by torques (`robot.actuators`) needs no effort"
        } else { "" }
    )]
    NoLimits {
        /// The joints.
        joints: Vec<LackingLimits>,
    },
    /// A joint that limits are given for is not among those that move.
    #[error("key `robot.limits`: expected joints on the path to the tool, {}, found `{joint}`", .expected.join(", "))]
    UnknownLimitedJoint {
        /// The name given.
        joint: String,
        /// The joints there are.
        expected: Vec<String>,
    },
    /// Soft position limits leave no range.
    #[error(
        "joint `{joint}`: safety_controller: expected soft limits that overlap {hard:?}, found {soft:?}; set `robot.limits`"
    )]
    SoftLimits {
        /// The joint.
        joint: String,
        /// Lower and upper position limit [rad or m].
        hard: [f64; 2],
        /// Lower and upper soft limit [rad or m].
        soft: [f64; 2],
    },
    /// Bodies that joints move by torques have no mass.
    #[error(
        "expected a mass of everything that a commanded torque moves, found none of {}; add an <inertial> to the \
         link that has the mass, or command positions or velocities (`robot.actuators`)",
        .bodies.iter().map(|(joint, links)| format!("what joint `{joint}` moves ({})", links.join(", ")))
            .collect::<Vec<_>>().join(", ")
    )]
    NoMass {
        /// Joints, and the links that are fixed to what each moves.
        bodies: Vec<(String, Vec<String>)>,
    },
    /// A velocity or effort limit is zero or negative.
    #[error(
        "joint `{joint}`: limit {limit}: expected a positive number of {unit}, found {found}; set `robot.limits`"
    )]
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
        "joint `{joint}`: limit: expected lower < upper, found lower {lower} and upper {upper}{}",
        if lower > upper { ": they are swapped; mend them, or set `robot.limits`" } else { "; set `robot.limits`" }
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

/// A joint beside the path.
#[derive(Debug, Clone)]
pub struct BranchJoint {
    /// Its name.
    pub joint: String,
    /// Its type.
    pub found: &'static str,
    /// A position that it can be held at: of its range the nearest to zero [rad or m].
    pub position: f64,
}

fn types(joints: &[BranchJoint]) -> String {
    let one = |branch: &BranchJoint| format!("`{}` ({})", branch.joint, branch.found);
    joints.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn positions(joints: &[BranchJoint]) -> String {
    let one = |branch: &BranchJoint| format!("\"{}\": {:?}", branch.joint, branch.position);
    joints.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// A joint, and which of its limits are missing.
#[derive(Debug, Clone)]
pub struct LackingLimits {
    /// The joint.
    pub joint: String,
    /// Line of the joint or its limits.
    pub line: usize,
    /// No lower and upper limit.
    pub position: bool,
    /// No speed limit, or zero.
    pub velocity: bool,
    /// No torque or force limit, or zero.
    pub effort: bool,
}

impl fmt::Display for LackingLimits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lacking =
            [(self.position, "position"), (self.velocity, "velocity"), (self.effort, "effort")];
        let words = lacking.iter().filter(|(lacks, _)| *lacks).map(|(_, word)| *word);
        let words = words.collect::<Vec<_>>().join(", ");
        write!(f, "`{}` (line {}: {words})", self.joint, self.line)
    }
}

fn overrides(joints: &[LackingLimits]) -> String {
    let value = |lacks, text| if lacks { text } else { "None" };
    let one = |lacking: &LackingLimits| {
        format!(
            "\"{}\": (position: {}, velocity: {}, effort: {})",
            lacking.joint,
            value(lacking.position, "Some((…, …))"),
            value(lacking.velocity, "Some(…)"),
            value(lacking.effort, "Some(…)"),
        )
    };
    joints.iter().map(one).collect::<Vec<_>>().join(", ")
}
