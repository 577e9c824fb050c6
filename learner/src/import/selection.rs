//! What is imported, and how: the options of `learner import`.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use tprmp_model::skill_model::Manifold;

use crate::file_error::FileError;

/// How values between samples are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Interpolation {
    /// Cubic Hermite: smooth, with the slopes of parabolas through three samples.
    #[default]
    Cubic,
    /// Straight lines, and rotations at constant speed.
    Linear,
}

/// Unit of recorded positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LengthUnit {
    /// Metres, however far the tool moves.
    M,
    /// Millimetres.
    Mm,
}

/// Unit of recorded times.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TimeUnit {
    /// Seconds.
    S,
    /// Milliseconds.
    Ms,
    /// Microseconds.
    Us,
    /// Nanoseconds.
    Ns,
}

impl TimeUnit {
    /// In seconds \[s\].
    pub(super) fn seconds(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e-3,
            Self::Us => 1e-6,
            Self::Ns => 1e-9,
        }
    }

    /// As it stands at the end of a column's name.
    pub(super) fn suffix(self) -> &'static str {
        match self {
            Self::S => "s",
            Self::Ms => "ms",
            Self::Us => "us",
            Self::Ns => "ns",
        }
    }
}

/// Unit of recorded positions of rotating joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AngleUnit {
    /// Radians.
    Rad,
    /// Degrees.
    Deg,
}

/// Space of the poses to import.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Space {
    /// The plane.
    #[value(name = "R2")]
    R2,
    /// Positions without orientation.
    #[value(name = "R3")]
    R3,
    /// Positions and orientations.
    #[value(name = "R3xS3")]
    R3S3,
}

impl Space {
    pub(super) fn manifold(self) -> Manifold {
        match self {
            Self::R2 => Manifold::R2,
            Self::R3 => Manifold::R3,
            Self::R3S3 => Manifold::R3S3,
        }
    }
}

/// At which end of its values a gripper is closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Closed {
    /// At the least value.
    Low,
    /// At the greatest value.
    High,
}

/// What to import, and how.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Selection {
    /// Name of the skill; by default the one in the file (.json) or of the file (.mat)
    #[arg(long)]
    pub skill: Option<String>,
    /// Only the demonstrations with this tag
    #[arg(long)]
    pub tag: Option<String>,
    /// Name of the start frame; by default `start` in the plane, `ee_start` in space
    #[arg(long)]
    pub start_frame: Option<String>,
    /// Name of the goal frame; by default `end` in the plane, `object` in space
    #[arg(long)]
    pub goal_frame: Option<String>,
    /// Resample to this time between samples, in seconds; first and last sample stay, so the time is
    /// rounded to a whole part of the duration
    #[arg(long, value_name = "S")]
    pub sampling_time_s: Option<f64>,
    /// Most samples a second: faster recordings are thinned to so many, unless --sampling-time-s is given
    #[arg(long, value_name = "HZ", default_value = "100")]
    pub rate_max_hz: Option<f64>,
    /// Most samples of a demonstration: longer ones are thinned to so many, unless --sampling-time-s is
    /// given. The time of learning grows with their number
    #[arg(long, value_name = "N", default_value = "1501")]
    pub samples_max: Option<usize>,
    /// How to resample
    #[arg(long, value_enum, default_value_t)]
    pub interpolation: Interpolation,
    /// Time between the recorded samples, in seconds, in place of what the file says
    #[arg(long, value_name = "S")]
    pub recorded_at_s: Option<f64>,
    /// Unit of the recorded times, where the file or the column's name says another
    #[arg(long, value_enum)]
    pub time_unit: Option<TimeUnit>,
    /// Keep the first of several samples with one and the same time
    #[arg(long)]
    pub drop_duplicate_stamps: bool,
    /// Unit of the recorded positions. `m` also permits motions that look like millimetres
    #[arg(long, value_enum)]
    pub unit: Option<LengthUnit>,
    /// Configuration of a controller, e.g. config/controllers/ur5_pick.ron: its robot's joints are
    /// recorded, and its kinematics make poses of them
    #[arg(long, value_name = "CONFIG")]
    pub robot: Option<PathBuf>,
    /// Unit of the recorded positions of rotating joints
    #[arg(long, value_enum, default_value = "rad")]
    pub joint_unit: Option<AngleUnit>,
    /// Space of the poses; by default all that was recorded
    #[arg(long, value_enum, value_name = "SPACE")]
    pub space: Option<Space>,
    /// Names of the columns of an array or of a LeRobot state, in place of those the file says
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub columns: Vec<String>,
    /// Columns to leave out although they look like known ones
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub ignore: Vec<String>,
    /// File of frames: {"frames": {...}} for all demonstrations, and "demonstrations":
    /// [{"frames": {...}}, ...] for those of each
    #[arg(long, value_name = "FILE")]
    pub frames: Option<PathBuf>,
    /// This frame is the tool's pose where the gripper closes first
    #[arg(long, value_name = "FRAME", requires = "closed")]
    pub frame_at_closing: Option<String>,
    /// Column of the gripper
    #[arg(long, value_name = "NAME", default_value = "gripper")]
    pub gripper: Option<String>,
    /// At which end of its values the gripper is closed; with it the column of --gripper, past the middle
    /// of its values, tells whether the gripper is open
    #[arg(long, value_enum)]
    pub closed: Option<Closed>,
    /// Feature of a LeRobot folder that holds the robot's state
    #[arg(long, value_name = "FEATURE", default_value = "observation.state")]
    pub state: Option<String>,
    /// Take the frames with which the thesis learned a demonstration, where its file has them
    #[arg(long)]
    pub reference_frames: bool,
}

impl Selection {
    /// The column of the gripper's position.
    pub(super) fn gripper_column(&self) -> &str {
        self.gripper.as_deref().unwrap_or("gripper")
    }

    /// Names of start and goal frame.
    pub(super) fn frames(&self, manifold: Manifold) -> [String; 2] {
        let [start, goal] = match manifold {
            Manifold::R2 => ["start", "end"],
            Manifold::R3 | Manifold::R3S1 | Manifold::S3 | Manifold::R3S3 => ["ee_start", "object"],
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

    /// Metres in a unit of recorded positions \[m\].
    pub(super) fn length_m(&self) -> f64 {
        if self.unit == Some(LengthUnit::Mm) { 1e-3 } else { 1.0 }
    }

    /// Refuses numbers that are no times or rates.
    pub(super) fn check(&self, path: &Path) -> Result<(), FileError> {
        for (option, number) in [
            ("option --sampling-time-s", self.sampling_time_s),
            ("option --recorded-at-s", self.recorded_at_s),
            ("option --rate-max-hz", self.rate_max_hz),
        ] {
            if let Some(number) = number.filter(|number| !(number.is_finite() && *number > 0.0)) {
                let kind = if option.ends_with("hz") { "rate" } else { "time" };
                let problem = format!("expected a positive {kind}, found {number}");
                return Err(FileError::input(path, option, problem));
            }
        }
        if self.frame_at_closing.is_some() && self.closed.is_none() {
            let problem = "expected `low` or `high`: --frame-at-closing needs it";
            return Err(FileError::input(path, "option --closed", problem));
        }
        Ok(())
    }

    /// Refuses options that a format has no use for.
    pub(super) fn refuse(&self, path: &Path, given: &[(&str, bool)]) -> Result<(), FileError> {
        match given.iter().find(|(_, is_given)| *is_given) {
            None => Ok(()),
            Some((option, _)) => {
                let problem = "this format has no use for it: its layout says it";
                Err(FileError::input(path, format!("option {option}"), problem))
            }
        }
    }
}
