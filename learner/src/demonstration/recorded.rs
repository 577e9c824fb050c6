//! What a demonstration is.

use std::collections::BTreeMap;

use tprmp_model::skill_model::{Manifold, Remarks};
use tprmp_spatial::Pose;

use crate::demonstration::gripper::Gripper;

/// One demonstration: where the tool was, and the frames it belongs to.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstration {
    /// File name, without folders.
    pub name: String,
    /// SHA-256 of the file's bytes.
    pub sha256: String,
    /// Name of the skill.
    pub skill: String,
    /// Space of the poses.
    pub manifold: Manifold,
    /// Time between samples \[s\].
    pub sampling_time_s: f64,
    /// Start frame, in the robot's base frame.
    pub start: Pose,
    /// Goal frame, in the robot's base frame.
    pub goal_frame: Pose,
    /// Further frames by name, in the robot's base frame.
    pub other_frames: BTreeMap<String, Pose>,
    /// What somebody wrote into the file.
    pub remarks: Remarks,
    /// Poses of the tool in the robot's base frame; planar ones have z = 0 and no rotation.
    pub poses: Vec<Pose>,
    /// What the gripper does, where it is known; as many samples.
    pub gripper: Option<Gripper>,
}

impl Demonstration {
    /// How long it takes \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        (self.poses.len() - 1) as f64 * self.sampling_time_s
    }
}

/// How long demonstrations, of which there is at least one, take on average \[s\].
#[must_use]
pub fn mean_duration_s(demonstrations: &[Demonstration]) -> f64 {
    demonstrations.iter().map(Demonstration::duration_s).sum::<f64>() / demonstrations.len() as f64
}
