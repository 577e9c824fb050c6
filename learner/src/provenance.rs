//! Where a model comes from, as it stores it.

use tprmp_model::skill_model::{Provenance, Source};

use crate::demonstration::Demonstration;
use crate::skill::Skill;

/// The provenance of a model that is learned from these demonstrations.
pub(crate) fn provenance(skill: &Skill, demonstrations: &[Demonstration], seed: u64) -> Provenance {
    let source = |d: &Demonstration| Source {
        file: d.name.clone(),
        sha256: d.sha256.clone(),
        remarks: d.remarks.clone(),
    };
    Provenance {
        tool_version: env!("CARGO_PKG_VERSION").into(),
        seed,
        demonstrations: demonstrations.iter().map(source).collect(),
        hyper_parameters: skill.values(),
    }
}
