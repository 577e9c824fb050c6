//! Learned policies, of either kind.

pub mod canonical;
mod governor;
mod skill_policy;
pub mod thesis;
mod value;

pub use governor::SpeedGovernor;
pub use skill_policy::{PolicyState, SkillPolicy};
pub use value::{
    FRAME_CAPACITY, PHASE_RANGE, PHASE_RATE_MAX_1_S, Phase, PhaseResponse, SkillInertia, SkillValue,
};
