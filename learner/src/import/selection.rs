//! What is imported, and how.

use std::path::Path;

use crate::file_error::FileError;
use tprmp_model::skill_model::Manifold;

/// How values between samples are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Interpolation {
    /// Cubic Hermite: smooth, with the slopes of parabolas through three samples.
    #[default]
    Cubic,
    /// Straight lines, and rotations at constant speed.
    Linear,
}

/// What to import, and how.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Name of the skill; the file's own name when there is none and the file has one.
    pub skill: Option<String>,
    /// Only demonstrations with this tag.
    pub tag: Option<String>,
    /// Name of the start frame; by default `start` in the plane, `ee_start` in space.
    pub start_frame: Option<String>,
    /// Name of the goal frame; by default `end` in the plane, `object` in space.
    pub goal_frame: Option<String>,
    /// Time between samples to bring the demonstrations to \[s\].
    pub sampling_time_s: Option<f64>,
    /// How.
    pub interpolation: Interpolation,
    /// Time between recorded samples in place of the file's own times \[s\].
    pub recorded_at_s: Option<f64>,
    /// The frames with which the thesis learned a demonstration in place of its own, where a file of
    /// the thesis' layout has them.
    pub reference_frames: bool,
}

impl Selection {
    /// Names of start and goal frame.
    pub(super) fn frames(&self, manifold: Manifold) -> [String; 2] {
        let [start, goal] = match manifold {
            Manifold::R2 => ["start", "end"],
            Manifold::R3 | Manifold::R3S3 => ["ee_start", "object"],
        };
        let name = |chosen: &Option<String>, usual: &str| chosen.clone().unwrap_or(usual.into());
        [name(&self.start_frame, start), name(&self.goal_frame, goal)]
    }

    /// The skill's name of a file that has none.
    pub(super) fn skill_of(&self, path: &Path) -> Result<String, FileError> {
        self.skill.clone().ok_or_else(|| {
            let problem = "expected the skill's name: such a file does not say it";
            FileError::input(path, "option --skill", problem)
        })
    }
}
