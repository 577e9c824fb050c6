//! The policy of the thesis (TP-RMP): Gaussians seen from all frames, multiplied in the world, and the
//! field of their mixture as a leaf on the pose of the tool  [thesis section 4.2, algorithm 4.1].
//!
//! ```text
//! product.rs  N(μ̂_k, Σ̂_k) ∝ Π_p N(A_p μ_kp + b_p, A_p Σ_kp A_pᵀ)       [thesis eq. 3.6]
//! field.rs    M, w̃_k, ξ, Φ, ∇Φ and B of the mixture of the N(μ̂_k, Σ̂_k)  [thesis eq. 4.5–4.14, 4.17]
//! policy.rs   M ÿ = −∇Φ − ξ − B ẏ, pulled back to the pose               [thesis eq. 4.4]
//! ```
//!
//! Each equation is written once, for four components side by side in `lanes.rs`.

pub mod field;
pub mod policy;
pub mod product;
mod rotation;
#[cfg(test)]
mod tests;

pub use field::{GaussianField, Term};
pub use policy::{ThesisComponent, ThesisPolicy, ThesisPolicyError, ThesisState};
pub use product::PoseGaussian;
