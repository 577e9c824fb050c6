//! Who has to say that the arm may move, and what it does while it may not.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::controller_config::check::Check;
use crate::controller_config::leaves::PostureLeaf;

/// When a controller begins to follow its policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Start {
    /// As soon as all is well.
    Automatic,
    /// When somebody asks for it: `controller ctl start`.
    OnRequest,
}

/// What the arm does while a fault lasts, once it is at rest.
#[derive(Debug, Clone, Deserialize)]
pub enum Fallback {
    /// It holds its place.
    Hold,
    /// It goes to a posture, around the obstacles that were known last.
    Retreat(PostureLeaf),
    /// It gives way: only gravity is held.
    GravityOnly,
}

/// What the arm does, for each kind of fault. Where no state can be believed there is no feedback, and it
/// can only come to rest.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fallbacks {
    /// Frames or obstacles are missing, too old or faulty.
    pub frames: Fallback,
    /// The loop, the policy or the gripper failed.
    pub controller: Fallback,
    /// Somebody asked for a hold, or has not asked for a start.
    pub request: Fallback,
}

/// Who has to say that the arm may move.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Supervision {
    /// When the controller begins.
    pub start: Start,
    /// Reasons after which a person has to look: the arm is held until `controller ctl reset`. After all
    /// others it goes on once the cause has gone.
    pub latching: Vec<String>,
    /// What the arm does meanwhile.
    pub fallback: Fallbacks,
    /// What `controller ctl set` may change, and between which bounds, in the unit of the key.
    pub settable: BTreeMap<String, [f64; 2]>,
}

impl Supervision {
    pub(super) fn check(&self, joints: usize, check: &mut Check) {
        check.within("fallback", |check| {
            let Fallbacks { frames, controller, request } = &self.fallback;
            for (key, fallback) in [("frames", frames), ("request", request)] {
                if let Fallback::Retreat(posture) = fallback {
                    check.within(key, |check| posture.check(joints, check));
                }
            }
            // Whatever failed there would have to find the way.
            let stays = !matches!(controller, Fallback::Retreat(_));
            check.require(stays, "controller", "Hold or GravityOnly", controller);
        });
        for (key, bounds) in &self.settable {
            let rises = bounds[0] > 0.0 && bounds[0] <= bounds[1] && bounds[1].is_finite();
            let expected = "a lower bound above 0 that is not above the upper one";
            check.require(rises, &format!("settable.{key}"), expected, bounds);
        }
    }
}
