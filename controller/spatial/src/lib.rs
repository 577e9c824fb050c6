//! The one vocabulary of space, shared by robot, policy, learner and simulators.
//!
//! Names follow Drake's monogram notation and Pinocchio's `spatial/`: `X_AB` is the pose of frame B in
//! frame A, `V_AB` its twist, `A_AB` its acceleration, and the letters between two factors cancel,
//! X_AC = X_AB X_BC. `W` is the world (the robot's base frame, in which everything is expressed unless
//! a name says otherwise), `E` the tool.
//!
//! | type | symbol | |
//! |---|---|---|
//! | [`Pose`] | X_AB | position \[m\] and orientation, a unit quaternion |
//! | [`Twist`] | V_AB | velocity of B's origin \[m/s\] and angular velocity \[rad/s\] |
//! | [`SpatialAcceleration`] | A_AB | acceleration of B's origin \[m/s²\] and angular acceleration \[rad/s²\] |
//! | [`Wrench`] | F_B | force \[N\] and torque about B's origin \[N m\] |
//! | [`MovingPose`] | X, V, A | a frame with its motion |
//! | [`PointMotion`] | x, ẋ, J, J̇q̇ | a point of a mechanism with N coordinates |
//! | [`jet::Jet`] | u, u̇, ü | a number with its first two time derivatives |
//! | [`rotation`] | exp, log, J_r | the geometry of orientations |
//!
//! Six numbers in a column are always \[linear; angular\]. Vectors of three are [`glam::DVec3`], which
//! the processor's registers like; [`nalgebra`]'s columns come from `.into()`.
//!
//! ```
//! use glam::{DQuat, DVec3};
//! use tprmp_spatial::{Pose, Twist};
//!
//! let x_wb = Pose { position: DVec3::X, orientation: DQuat::from_rotation_z(1.0) };
//! let x_be = Pose { position: DVec3::Z, orientation: DQuat::IDENTITY };
//! let x_we = x_wb.compose(&x_be);
//! let back = x_wb.inverse().compose(&x_we);
//! assert!((back.position - x_be.position).length() < 1e-15);
//! let rotating = Twist { linear: DVec3::ZERO, angular: DVec3::Z };
//! assert_eq!(rotating.shifted(DVec3::X).linear, DVec3::Y);
//! ```

#![allow(clippy::needless_range_loop, reason = "formulas with matrices are written with indices")]

pub mod jet;
mod moving_pose;
mod point_motion;
mod pose;
pub mod rotation;
#[cfg(feature = "proptest")]
pub mod strategies;
mod vectors;

pub use moving_pose::MovingPose;
pub use point_motion::PointMotion;
pub use pose::Pose;
pub use vectors::{SpatialAcceleration, Twist, Wrench};
