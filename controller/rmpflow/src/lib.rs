//! Riemannian motion policies: M ẍ = f.
//!
//! A policy on a space x is a pair of a force f and a metric M: it desires the acceleration M⁻¹f, and M is
//! its weight, direction by direction. A leaf is a policy on a task space x = ψ(q) of the robot. Pulled back
//! to the robot's coordinates q, policies of the same robot add up, and their sum is resolved:
//!
//! ```text
//! M ẍ = f                                                    natural form  [thesis section 3.3]
//! f_q = Σ Jᵀ (f − M J̇q̇),   M_q = Σ Jᵀ M J                  pullback      [thesis eq. 3.2]
//! q̈  = M_q⁻¹ f_q                                             resolve
//! ```
//!
//! | symbol | meaning | where |
//! |---|---|---|
//! | f, M | force and metric of a policy | [`Natural`] |
//! | J, J̇q̇ | Jacobian of a task map, and the drift, what ẍ has beside J q̈ | [`Natural::add_pullback`] |
//! | q, q̇, q̈ | coordinates of the robot, their velocity and acceleration | [`leaves::Tick`], [`tree::Resolved`] |
//! | Φ, ξ, B | potential, curvature force and damping: f = −∇Φ − ξ − B ẋ | [`policy::canonical::field`] |
//! | V | energy Φ + ½ ẋᵀMẋ, which never rises while the frames rest | [`SkillValue::energy`](policy::SkillValue::energy) |
//! | s, ṡ | phase: 0 at the start of a skill, 1 at its goal | [`policy::Phase`] |
//! | y, x | coordinates among the frames, and in the world | [`policy::canonical::frame_map`] |
//! | d, n | clearance and its gradient | [`leaves::Clearance`] |
//!
//! Two kinds of policies meet in the [`Tree`]: a learned one on the pose of the tool, a [`SkillPolicy`], and
//! the hand-made [`leaves`] that keep the robot clear, within its limits and in a posture. The rest of the
//! mathematics is in `MATHEMATICS.md`; `examples/own_leaf.rs` adds a leaf of one's own to a tree.
//!
//! Nothing here allocates after it was built, reads a clock or a file, or logs. The same input gives the same
//! bits on every machine.
//!
//! ```
//! use nalgebra::{Matrix1, Matrix1x2, Vector1, Vector2};
//! use tprmp_rmpflow::Natural;
//! use tprmp_rmpflow::leaves::JointDamping;
//!
//! // Two joints, one task: their sum shall accelerate by 1.
//! let mut root = JointDamping { inertia: 0.01, damping_1_s: 2.0 }.evaluate(&Vector2::zeros());
//! let task = Natural { force: Vector1::new(5.0), metric: Matrix1::new(5.0) };
//! root.add_pullback(&task, &Matrix1x2::new(1.0, 1.0), &Vector1::zeros());
//! let acceleration = root.resolve()?;
//! assert!((acceleration.sum() - 1.0).abs() < 0.01);
//! # Ok::<(), tprmp_rmpflow::ResolveError>(())
//! ```

#![cfg_attr(
    test,
    allow(
        clippy::disallowed_types,
        clippy::disallowed_methods,
        clippy::disallowed_macros,
        reason = "tests may do what the crate never does"
    )
)]
#![allow(clippy::needless_range_loop, reason = "formulas with matrices are written with indices")]

mod lanes;
pub mod leaves;
pub mod natural;
pub mod policy;
pub mod tree;

pub use natural::{Natural, ResolveError};
pub use policy::{PolicyState, SkillPolicy};
pub use tree::{Tree, TreeState};
