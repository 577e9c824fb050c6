//! The frozen model of a learned skill: its schema, reader, writer and validation.
//!
//! The file is RON text, `(schema: "tprmp-model/7", checksum: "sha256:…", body: (…))`. The checksum
//! is the SHA-256 of the body without spaces, comments and commas before closing brackets, so that
//! comments and layout may change, numbers may not. Files of the two schemas before are read too.
//!
//! *Canonical coordinates* are those of the space in which all demonstrations share their start
//! frame and goal frame \[m\], and, for the orientation, the rotation vector at the goal,
//! `q_y = q_g · exp(y_r)` [rad, full angle]. So the goal of the orientation block is `y_r = 0`.
//!
//! The canonical policy has a field for each block, on z = (y, s) with the phase s as last coordinate, 0 at
//! the start and 1 at the goal (`v_k = z − μ_k`, `s_k` the last coordinate of `μ_k`, `G` the last
//! component):
//!
//! ```text
//! e_k = exp(−½ (s − s_k)²/phase_width²),  w_k = e_k / Σe
//! φ_k = φ⁰_k + g_kᵀv_k + ½ v_kᵀS_kv_k
//! Φ = Σ w_k φ_k,  M = Σ w_k M_k,  z̈ = −M⁻¹(∇Φ + ξ) − d ż
//! ```
//!
//! Φ and M are divided by the goal's metric, so that `M_G = I` in y: no acceleration changes.
//!
//! A periodic skill has no goal: its components are those of one round, and stand in every round r anew, at s_k + r
//! with the potential φ⁰_k − r `fall_per_round`. Its potentials and metrics are divided by the mean metric in y.
//!
//! The thesis' policy multiplies the Gaussians of all frames in the world [thesis eq. 3.6] and has
//! Huber potentials [4.10–4.11], the metric 4.5 and the damping 4.17 on them; see
//! `tprmp_rmpflow`.

mod blocks;
mod certificate;
mod descent;
mod evaluated;
mod field;
mod file;
mod fit;
mod frame_roles;
mod gripper;
mod interval;
mod model;
mod recomputed;
mod rounds;
mod upgrade;
mod validate;
pub mod valley;

pub use blocks::blocks;
pub use certificate::{
    BlockCertificate, Certificate, CycleCertificate, Rollouts, ValleyCertificate,
};
pub use evaluated::{EvaluationError, thesis_policy};
pub use file::{ModelError, SCHEMA, read, sha256_hex, to_text, write};
pub use fit::{
    ActiveConstraints, Constraints, DemonstrationRollout, Figure, Fit, Program, ProgramFit,
    ProgramStatus,
};
pub use frame_roles::lost_agreement;
pub use gripper::{GripperAction, GripperEvent};
pub use model::{
    Adaptation, Canonical, Component, FieldModel, FrameGaussian, FrameMixture, Gaussian,
    MODE_CAPACITY, Manifold, Motion, PolicyModel, Pose, Provenance, Remarks, SkillModel, Source,
    ThesisModel, Waypoint,
};
pub use recomputed::verify;
pub use rounds::{RoundCopy, copies};
pub use tprmp_rmpflow::policy::FRAME_CAPACITY;
pub use tprmp_rmpflow::policy::canonical::adaptation::{COORDINATES, SPLINES};
pub use validate::GRIPPER_EVENTS_MAX;
