//! Riemannian motion policies: learned fields, task maps, leaves and the natural form that composes
//! them, evaluated without allocation.
//!
//! Start with [`policy`]: a learned skill is either a [`field`] on canonical coordinates behind a
//! [`frame_map`] with an [`adaptation`] ([`skill`]), or the thesis' policy, a [`gaussian_field`] on products of Gaussians
//! seen from the frames ([`product_skill`], [`gaussian_product`]). [`leaves`] and [`joint_leaves`]
//! hold the hand-made policies, [`avoidance`] leads around [`obstacle`]s, the [`governor`] keeps a skill
//! within a speed; [`natural`] pulls policies back, and the [`tree`] composes and resolves them.
//!
//! ```
//! use nalgebra::{Matrix1x2, Matrix2, Vector1, Vector2};
//! use tprmp_rmpflow::leaves::JointDamping;
//! use tprmp_rmpflow::natural::Natural;
//!
//! // Two joints, one task: their sum shall accelerate by 1.
//! let mut root = JointDamping { inertia: 0.01, damping_1_s: 2.0 }.evaluate(&Vector2::zeros());
//! let task = Natural { force: Vector1::new(5.0), metric: nalgebra::Matrix1::new(5.0) };
//! root.add_pullback(&task, &Matrix1x2::new(1.0, 1.0), &Vector1::zeros());
//! let acceleration = root.resolve()?;
//! assert!((acceleration.sum() - 1.0).abs() < 0.01);
//! # let _: Matrix2<f64> = root.metric;
//! # Ok::<(), tprmp_rmpflow::natural::ResolveError>(())
//! ```

#![allow(clippy::needless_range_loop, reason = "formulas with matrices are written with indices")]

mod lanes;
pub mod leaves;
pub mod natural;
pub mod policy;
pub mod tree;
