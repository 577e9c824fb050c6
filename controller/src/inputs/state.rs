//! Checks of the robot's state: what a message cannot know by itself.

use nalgebra::SVector;
use tprmp_messages::{Reason, RobotState};
use tprmp_robot::Chain;

/// A checked state of the robot.
#[derive(Debug, Clone, Copy)]
pub struct JointState<const N: usize> {
    /// q \[rad or m\].
    pub position: SVector<f64, N>,
    /// q̇ \[rad/s or m/s\].
    pub velocity: SVector<f64, N>,
}

/// A measured speed beyond this multiple of the joint's limit is not believed.
const SPEED_MULTIPLE_MAX: f64 = 2.0;

/// Checks a state: number of joints, finite numbers, believable speeds.
///
/// # Errors
/// The reason for which it is no measurement.
pub fn check_state<const N: usize>(
    state: &RobotState,
    chain: &Chain<N>,
) -> Result<JointState<N>, Reason> {
    let [position, velocity] = state.check(N)?.map(SVector::<f64, N>::from_column_slice);
    let unbelievable = |i: usize| velocity[i].abs() > SPEED_MULTIPLE_MAX * chain.velocity_max()[i];
    if (0..N).any(unbelievable) {
        return Err(Reason::StateUnbelievable);
    }
    Ok(JointState { position, velocity })
}

/// A change of position beyond what the believable speeds allow is a jump from here on [rad or m].
const JUMP_MIN: f64 = 0.05;

/// Whether a joint has moved farther in `elapsed_s` \[s\] than its believable speed allows.
#[must_use]
pub fn jumps<const N: usize>(
    before: &JointState<N>,
    now: &JointState<N>,
    elapsed_s: f64,
    chain: &Chain<N>,
) -> bool {
    (0..N).any(|i| {
        let most = SPEED_MULTIPLE_MAX * chain.velocity_max()[i] * elapsed_s + JUMP_MIN;
        (now.position[i] - before.position[i]).abs() > most
    })
}

/// Whether every joint is within the robot's position limits.
#[must_use]
pub fn within_position_limits<const N: usize>(state: &JointState<N>, chain: &Chain<N>) -> bool {
    (0..N).all(|i| {
        let q = state.position[i];
        q >= chain.position_lower()[i] && q <= chain.position_upper()[i]
    })
}
