//! Learns a frozen model from demonstrations.
//!
//! [`train::train`] is the whole path, in five steps; each is a room:
//!
//! 1. [`alignment`]: demonstrations at a common time,
//! 2. [`canonical`]: in the coordinates in which they share their frames,
//! 3. [`mixture`]: Gaussians, common to all frames,
//! 4. [`fit`]: the policy, canonical or the thesis', by convex programs,
//! 5. [`certify`]: what can be proved of it, and what rollouts show.
//!
//! ```text
//! recording ──► y_i(s)  ──► π_k, μ_k, C_k ──► Φ(z), M(z) ──► certificate
//!   poses       canonical    mixture           M z̈ = −∇Φ − ξ − d M ż
//! ```
//!
//! A [`skill`] file names the [`demonstration`]s and every number that was chosen. [`import`] reads files
//! of other formats, [`record`] writes demonstrations from a live robot, [`plot`] draws what was
//! learned, [`report`] prints it.
//!
//! ```no_run
//! use tprmp_learner::{mixture::components::Components, train::train};
//!
//! let skill = "config/skills/planar.ron".as_ref();
//! let trained = train(skill, Components::SkillFile, 1, &mut |_| {})?;
//! assert!(trained.model.certificate.holds());
//! tprmp_model::skill_model::write(&trained.model, "target/planar.model.ron".as_ref())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod alignment;
pub mod canonical;
pub mod certify;
pub mod demonstration;
pub mod file_error;
pub mod fit;
mod fit_warnings;
pub mod gripper_events;
pub mod import;
pub mod mixture;
pub mod modes;
pub mod periodic;
pub mod plot;
pub mod proposed_frames;
mod provenance;
pub mod record;
pub mod report;
pub mod skill;
pub mod train;
