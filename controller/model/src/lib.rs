//! Frozen model files and RON configuration, parsed into valid types.
//!
//! | file | type | reader |
//! |---|---|---|
//! | a learned skill, `*.model.ron` | [`SkillModel`] | [`skill_model::read`] |
//! | a controller's configuration | [`ControllerConfig`] | [`controller_config::read`] |
//! | frames that stand still | [`fixed_frames::FixedFrames`] | [`fixed_frames::read`] |
//!
//! A value that came from a file is valid: every reader checks schema, checksum, dimensions, ranges,
//! finiteness and definiteness, and names the file and the key it refuses. Models of the last version
//! are read too; keys of the last version are refused with their new names ([`RENAMED_KEYS`]).
//!
//! A model becomes a policy M ẍ = f on the pose of the tool by [`SkillModel::policy`]:
//! `examples/rollout.rs` loads one and rolls it out.
//!
//! ```
//! use std::path::Path;
//! use tprmp_model::skill_model;
//!
//! # let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/tprmp-model-5.ron");
//! let model = skill_model::read(&file)?;
//! assert_eq!(model.skill, "made_up");
//! assert!(model.certificate.holds());
//! let policy = model.policy()?;
//! assert_eq!(policy.frame_count(), model.frames.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod controller_config;
pub mod fixed_frames;
mod renamed;
mod ron_text;
pub mod skill_model;

pub use controller_config::{ConfigError, ControllerConfig};
pub use renamed::{RENAMED_KEYS, RenamedKey, renamed_keys};
pub use ron_text::ron_value;
pub use skill_model::{ModelError, SkillModel};
