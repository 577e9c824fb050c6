//! Serial robot arms from URDF: kinematics and dynamics of fixed size.
//!
//! # Frames and notation
//!
//! | letter | frame |
//! |---|---|
//! | `B`   | base: the root link of the URDF, at rest |
//! | `J_i` | joint frame of joint `i`: fixed to the link that joint `i` moves, origin on the joint's axis, z along the axis |
//! | `E`   | tool ("end-effector"): the URDF link named at start-up, fixed to the last joint frame |
//!
//! `X_BE` is the pose of `E` in `B`: it maps coordinates in `E` to coordinates in `B`
//! (`p_B = R_BE p_E + p_BE`), so that letters cancel: `X_BE = X_BJ X_JE`.
//! Where the URDF's axis is +z, the joint frame is the URDF frame of the joint's child link;
//! otherwise it is that frame rotated so that z lies along the axis.
//!
//! 6-vectors and the 6×N Jacobian stack `[linear; angular]` and are expressed in `B`:
//! the linear part belongs to the origin of `E`, the angular part is the true angular velocity.
//! With `V` the twist of the tool,
//!
//! ```text
//! V = J(q) q̇          V̇ = J(q) q̈ + J̇q̇        (V̇: classical acceleration of the tool point)
//! τ = M(q) q̈ + h(q, q̇)                        (h: Coriolis, centrifugal and gravity torques)
//! ```
//!
//! SI units: m, rad, s, kg, N, N m. `N` is the number of movable joints; entries of joint vectors
//! are rad or m, whichever the joint is.
//!
//! # Use
//!
//! [`Chain`] is the immutable model, built and checked once at start-up; [`Kinematics`] is the
//! workspace, owned by the caller; the algorithms are free functions of both:
//!
//! * [`forward_kinematics`], [`forward_kinematics_with_velocity`], [`point_motion`]
//! * [`inverse_dynamics`], [`gravity_torques`], [`mass_matrix`], [`forward_dynamics`]
//! * [`ControlPoints`]: spheres that cover the collision shapes
//!
//! # Invariants
//!
//! Evaluation allocates nothing, takes no lock, does no I/O and does not panic. Each loop runs over
//! the `N` joints. Input that is not finite gives output that is not finite.
//! Fixed links are folded into the link they are fixed to, those beside the path to the tool
//! included; joints can be held. There are no closed loops, no joint on the path follows another, and
//! meshes are not covered by spheres.

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets: [m]")]

mod chain;
mod control_points;
mod description;
pub mod document;
mod dynamics;
mod error;
mod foreign;
mod inertia;
mod kinematics;
mod limits;
mod payload;
mod placement;
mod plausibility;
mod postures;
mod ranges;
mod reader;
mod sanitise;
mod selection;
mod self_pairs;
mod tree;
mod trigonometry;
mod urdf;
mod xacro;
mod xml;

pub use chain::Chain;
pub use control_points::{
    CONTROL_POINT_CAPACITY, ControlPoint, ControlPointError, ControlPoints, INFLATION_MAX,
};
pub use description::{CollisionGeometry, CollisionShape, JointKind};
pub use document::Document;
pub use dynamics::{
    DynamicsError, forward_dynamics, gravity_torques, gravity_torques_with, inverse_dynamics,
    inverse_dynamics_with, mass_matrix,
};
pub use error::{BranchJoint, LackingLimits, UrdfError, UrdfErrorKind, UrdfFault};
pub use kinematics::{
    Kinematics, forward_kinematics, forward_kinematics_with_velocity, link_pose, point_motion,
    point_position,
};
pub use payload::Payload;
pub use plausibility::{Remark, remarks};
pub use postures::spread_posture;
pub use selection::{Interface, LimitOverride, PointMass, Selection};
pub use self_pairs::{Ignored, SelfPairs};
pub use urdf::{JOINTS_MAX, JOINTS_MIN, count_joints};
