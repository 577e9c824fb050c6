//! Riemannian motion policies: learned fields, task maps, leaves and the natural form that composes
//! them, evaluated without allocation.
//!
//! A learned [`policy`] says how the tool accelerates, the hand-made [`leaves`] how the robot keeps clear,
//! within its limits and in a posture; [`natural`] pulls all of them back to the joints, and the [`tree`]
//! composes and resolves them.
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
