//! What the gripper did while a skill was demonstrated: events at phases.

use std::fmt;

use serde::{Deserialize, Serialize};

/// What a gripper did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum GripperAction {
    /// It opened.
    Opens,
    /// It closed.
    Closes,
    /// It changed its width, to this one \[m\].
    WidthM(f64),
}

impl fmt::Display for GripperAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Opens => f.write_str("opens"),
            Self::Closes => f.write_str("closes"),
            Self::WidthM(width_m) => write!(f, "goes to {:.1} mm", 1e3 * width_m),
        }
    }
}

/// A change of the gripper in the demonstrations of a skill.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GripperEvent {
    /// Phase of the policy at which it happens, the median of the demonstrations.
    pub phase: f64,
    /// Fraction of the demonstrations' common time at which it happens, the median of the demonstrations.
    pub time_fraction: f64,
    /// What the gripper does.
    pub action: GripperAction,
    /// How far the phase of a demonstration is from `phase` at most.
    pub spread: f64,
    /// From how many demonstrations.
    pub demonstrations: u32,
}

impl GripperEvent {
    /// What happened in a line, of a skill with so many demonstrations.
    #[must_use]
    pub fn described(&self, of: usize) -> String {
        let Self { phase, action, spread, demonstrations, .. } = self;
        format!(
            "gripper {action} at phase {phase:.2} ({demonstrations} of {of} demonstration{}, within {spread:.2})",
            if of == 1 { "" } else { "s" }
        )
    }
}
