//! The command line of `learner record`.

use std::path::PathBuf;

use super::bounds::Bounds;

/// Shortest and longest time between samples [s].
const SAMPLING_TIME_S: std::ops::RangeInclusive<f64> = 0.001..=0.1;

/// What `learner record` is asked for.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Configuration of the controller, e.g. config/controllers/ur5_pick.ron: it names the robot
    pub(super) config: PathBuf,
    /// Skill file: it names the skill, its manifold, its frames and the tool
    #[arg(long, value_name = "FILE")]
    pub(super) skill: PathBuf,
    /// Folder for the files 01.json, 02.json, …; made when it is missing, nothing in it is replaced
    #[arg(long, value_name = "FOLDER")]
    pub(super) out: PathBuf,
    /// Name that the publisher of states uses
    #[arg(long, default_value = "default")]
    pub(super) instance: String,
    /// Time between samples [s]
    #[arg(long, value_name = "S", default_value_t = 0.01, value_parser = sampling_time)]
    pub(super) sampling_time_s: f64,
    /// End after so many demonstrations
    #[arg(long, value_name = "N")]
    pub(super) count: Option<u32>,
    #[command(flatten)]
    pub(super) bounds: Bounds,
}

fn sampling_time(text: &str) -> Result<f64, String> {
    let (least, most) = SAMPLING_TIME_S.into_inner();
    text.parse()
        .ok()
        .filter(|time| SAMPLING_TIME_S.contains(time))
        .ok_or_else(|| format!("expected a time from {least} to {most} s"))
}
