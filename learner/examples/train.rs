//! Trains a model from Rust: `cargo run --release -p tprmp-learner --example train`.

use std::error::Error;
use std::path::Path;

use tprmp_learner::mixture::components::Components;
use tprmp_learner::report;
use tprmp_learner::train::train;
use tprmp_model::skill_model;

/// Learns the shipped planar skill and prints what was learned.
///
/// # Errors
/// Whatever keeps it from being learned or written.
pub fn main() -> Result<(), Box<dyn Error>> {
    // The skill file names its demonstrations, and every number that was chosen.
    let skill = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/skills/planar.ron");
    let seed = 1;
    let trained = train(&skill, Components::SkillFile, seed, &mut |step| eprintln!("{step}"))?;
    print!("{}", report::trained(&trained));

    // What fails its certificate is written only when asked for.
    assert!(trained.model.certificate.holds(), "{:?}", trained.model.certificate.failures);
    let model = std::env::temp_dir().join("tprmp_example_planar.model.ron");
    skill_model::write(&trained.model, &model)?;
    assert_eq!(skill_model::read(&model)?, trained.model);
    Ok(())
}
