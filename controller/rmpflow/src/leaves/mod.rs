//! Hand-made leaves.
//!
//! All but [`VelocityFollower`] and [`Steering`] are geometric dynamical systems, M = G + Ξ,
//! Ξ = ½ Σ ẋ_i ∂G/∂ẋ_i, f = −∇Φ − Bẋ − ξ_G, so that the stability of the whole tree holds
//! [Cheng et al. 2019, RMPflow, section V].
//!
//! | leaf | acts on |
//! |---|---|
//! | [`Barrier`] | a [`Clearance`]: of an [`Obstacle`], of the body itself, of a funnel's wall |
//! | [`Avoidance`] | the points of a [`Body`] among obstacles: clearance, and [`Steering`] around them |
//! | [`SelfCollision`] | pairs of points of a body |
//! | [`PoseAttractor`] | the pose of the tool |
//! | [`KeepUpright`] | the direction of an axis of the tool |
//! | [`ApproachFunnel`] | the tool near its goal |
//! | [`VelocityFollower`] | the velocity of the tool |
//! | [`JointDamping`], [`Posture`], [`JointLimits`], [`JointSpeedLimits`] | the joints |

mod attractor;
mod avoidance;
mod barrier;
mod body;
mod follower;
mod funnel;
mod joint_limits;
#[cfg(feature = "serde")]
mod keys;
mod obstacle;
mod posture;
pub mod range;
mod self_collision;
mod steering;
mod tick;
mod upright;

pub use attractor::PoseAttractor;
pub use avoidance::{Avoidance, Proximity};
pub use barrier::{Barrier, BarrierKeys, Clearance};
pub use body::{Body, FreeBall, Part};
pub use follower::VelocityFollower;
pub use funnel::ApproachFunnel;
pub use joint_limits::{JointLimits, JointSpeedLimits, SpeedBarrier};
pub use obstacle::{Obstacle, Shape};
pub use posture::{JointDamping, Posture};
pub use self_collision::SelfCollision;
pub use steering::{AvoidanceState, Free, STEERED_CAPACITY, Side, Steering};
pub use tick::{Task, Tick};
pub use upright::KeepUpright;
