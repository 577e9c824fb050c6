//! How noisy the joint positions are, for people.

use std::collections::VecDeque;

use tprmp_messages::JOINT_CAPACITY;

use super::arm::Arm;
use super::statistics::{Extent, NOISE_SAMPLES, noise};

/// The newest joint positions.
#[derive(Debug, Default)]
pub(super) struct JointNoise {
    newest: VecDeque<[f64; JOINT_CAPACITY]>,
}

impl JointNoise {
    /// Handles joint positions [rad or m].
    pub(super) fn update(&mut self, position: &[f64; JOINT_CAPACITY]) {
        if self.newest.len() == NOISE_SAMPLES {
            self.newest.pop_front();
        }
        self.newest.push_back(*position);
    }

    /// The next positions may be any.
    pub(super) fn forget(&mut self) {
        self.newest.clear();
    }

    /// Standard deviation of the noisiest joint that slides [m], and of that which rotates [rad].
    pub(super) fn extent(&self, arm: &dyn Arm) -> Extent {
        let mut noisiest = Extent::default();
        for joint in 0..arm.joints() {
            let numbers: Vec<f64> = self.newest.iter().map(|position| position[joint]).collect();
            let of_joint = noise(&numbers);
            noisiest = noisiest.max(match !arm.rotates(joint) {
                true => Extent { m: of_joint, rad: 0.0 },
                false => Extent { m: 0.0, rad: of_joint },
            });
        }
        noisiest
    }
}
