//! Configures arms of many makers by `controller init` alone, and lets each follow a skill to four places.

mod episode;
mod places;
mod report;
mod world;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

use clap::Parser;
use glam::DVec3;
use nalgebra::SVector;
use serde::Deserialize;
use tprmp_controller::init::{self, Commands, Initialised, Options, Task};
use tprmp_controller::motion::limits::working_range;
use tprmp_controller::startup::{self, WithRobot};
use tprmp_cover::Packages;
use tprmp_files::{errln, outln};
use tprmp_model::controller_config::{self, ControllerConfig};
use tprmp_model::skill_model::{self, SkillModel};
use tprmp_robot::{Kinematics, SelfPairs, forward_kinematics};

use episode::{Episode, Files, Outcome};
use places::Search;
use report::Row;
use world::Meshes;

/// Largest list \[bytes\].
const BYTES_MAX: u64 = 1 << 20;
/// The table is this far below the base \[m\].
const TABLE_M: f64 = -0.02;
/// The ball beside the path: its radius, how far its middle is from the middle of the straight line, and from
/// the goal \[m\].
const BALL_M: f64 = 0.04;
const BESIDE_M: f64 = 0.15;
const FROM_GOAL_M: f64 = 0.35;

/// Lets arms follow a skill, each configured from its URDF alone.
///
/// The exit code is 1 when one does not reach a place, or touches something.
#[derive(Debug, Parser)]
#[command(name = "arms")]
struct Arguments {
    /// The arms.
    list: PathBuf,
    /// Folder that URDFs are below. May be given several times.
    #[arg(long, value_name = "NAME=DIR", value_parser = named)]
    root: Vec<(String, PathBuf)>,
    /// Model of a skill. May be given several times.
    #[arg(long, value_name = "NAME=FILE", value_parser = named)]
    model: Vec<(String, PathBuf)>,
    /// Program.
    #[arg(long, default_value = "target/release/controller")]
    controller: PathBuf,
    /// Folder for configurations and results.
    #[arg(long)]
    out: PathBuf,
    /// Only the arms of these names.
    #[arg(long)]
    only: Vec<String>,
}

fn named(text: &str) -> Result<(String, PathBuf), String> {
    let (name, path) = text.split_once('=').ok_or("expected NAME=PATH")?;
    Ok((name.to_owned(), path.into()))
}

/// An arm of the list.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Arm {
    name: String,
    root: String,
    urdf: PathBuf,
    tool: Option<String>,
    model: String,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(holds) => ExitCode::from(u8::from(!holds)),
        Err(error) => {
            errln!("arms: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<bool, String> {
    let text =
        tprmp_files::read_text(&arguments.list, BYTES_MAX).map_err(|error| error.to_string())?;
    let arms: Vec<Arm> =
        ron::from_str(&text).map_err(|error| format!("{}: {error}", arguments.list.display()))?;
    let roots: BTreeMap<_, _> = arguments.root.iter().cloned().collect();
    let models: BTreeMap<_, _> = arguments.model.iter().cloned().collect();
    let mut rows = Vec::new();
    for arm in &arms {
        if !arguments.only.is_empty() && !arguments.only.contains(&arm.name) {
            continue;
        }
        let (Some(root), Some(model)) = (roots.get(&arm.root), models.get(&arm.model)) else {
            return Err(format!(
                "{}: expected --root {} and --model {}",
                arm.name, arm.root, arm.model
            ));
        };
        let row = of_arm(arm, &root.join(&arm.urdf), model, arguments);
        let row = row.unwrap_or_else(|error| Row::failed(&arm.name, error));
        outln!("{}", row.line());
        rows.push(row);
    }
    report::write(&rows, &arguments.out).map_err(|error| error.to_string())?;
    let held = rows.iter().filter(|row| row.holds()).count();
    outln!("{held} of {} arms reach all places without a contact", rows.len());
    outln!("report: {}", arguments.out.join("arms.html").display());
    Ok(held == rows.len())
}

fn of_arm(arm: &Arm, urdf: &Path, model_path: &Path, arguments: &Arguments) -> Result<Row, String> {
    let begun = Instant::now();
    let options = Options {
        urdf: urdf.to_owned(),
        base: None,
        tool: arm.tool.clone(),
        model: Some(model_path.to_owned()),
        xrdf: None,
        srdf: None,
        packages: Packages::with_environment(Vec::new()),
        cover: tprmp_cover::Options { spheres_max: 48, ..tprmp_cover::Options::default() },
        commands: Commands::Position,
        task: Task::Reach,
        out: arguments.out.join(&arm.name),
        force: true,
    };
    let made = init::init(&options).map_err(|error| error.to_string())?;
    let init_s = begun.elapsed().as_secs_f64();
    let check = Command::new(&arguments.controller)
        .arg("check")
        .arg(&made.config)
        .arg("--model")
        .arg(model_path)
        .output()
        .map_err(|error| format!("{}: {error}", arguments.controller.display()))?;
    let mut row = Row::new(&arm.name, &made, init_s);
    if !check.status.success() {
        let said = String::from_utf8_lossy(&check.stderr).lines().last().unwrap_or("").to_owned();
        row.failure = Some(format!("check: {said}"));
        return Ok(row);
    }
    let config = controller_config::read(&made.config).map_err(|error| error.to_string())?;
    let model = skill_model::read(model_path).map_err(|error| error.to_string())?;
    let work = Work {
        name: &arm.name,
        arguments,
        made: &made,
        config: &config,
        model: &model,
        model_path,
    };
    let (outcomes, tick_us) =
        startup::with_robot(&made.config, &config, work).map_err(|error| error.to_string())??;
    (row.outcomes, row.tick_us) = (outcomes, tick_us);
    Ok(row)
}

struct Work<'a> {
    name: &'a str,
    arguments: &'a Arguments,
    made: &'a Initialised,
    config: &'a ControllerConfig,
    model: &'a SkillModel,
    model_path: &'a Path,
}

impl WithRobot for Work<'_> {
    type Output = Result<(Vec<Option<Outcome>>, f64), String>;

    fn call<const N: usize>(self) -> Self::Output {
        let config_path = &self.made.config;
        let (chain, points) =
            startup::robot::<N>(config_path, self.config).map_err(|error| error.to_string())?;
        let home = SVector::<f64, N>::from_fn(|i, _| self.made.home[i]);
        let range = working_range(&chain, &self.config.robot);
        let limits_act =
            self.config.joint_limits.as_ref().map_or(0.0, |leaf| leaf.activation_distance);
        let cover = self.made.cover.as_ref().ok_or("no cover")?;
        let meshes = Meshes::new(&chain, cover, &home);
        let exempt = self.config.self_collision.as_ref().map_or(&[][..], |own| &own.exempt);
        let low = self.config.collision.iter().flat_map(|collision| &collision.exempt);
        let search = Search {
            chain: &chain,
            model: self.model,
            home,
            range,
            limits_act,
            table_m: TABLE_M,
            points: &points,
            pairs: &SelfPairs::new(&chain, &points, exempt),
            may_be_low: low.map(|exempt| exempt.link.clone()).collect(),
        };
        let mut kinematics = Kinematics::new();
        forward_kinematics(&chain, &home, &mut kinematics);
        let start = kinematics.tool_position();
        let summary = self.arguments.out.join(self.name).join("summary.json");
        let files = Files {
            controller: &self.arguments.controller,
            config: config_path,
            model: self.model_path,
            summary: &summary,
        };
        let (mut outcomes, mut ticks) = (Vec::new(), Vec::new());
        for (k, goal) in search.goals().into_iter().enumerate() {
            let Some(goal) = goal else {
                outcomes.push(None);
                continue;
            };
            let tool_goal = goal.compose(&search.tool_in_goal());
            let ball = (beside(start, tool_goal.position), BALL_M);
            let episode = Episode {
                chain: &chain,
                meshes: &meshes,
                model: self.model,
                home,
                goal,
                tool_goal,
                ball,
                table_m: TABLE_M,
            };
            let name = format!("arms-{}-{}-{k}", std::process::id(), self.name);
            outcomes.push(Some(episode.run(&name, &files)?));
            ticks.extend(report::tick_us(&summary));
        }
        let tick_us = ticks.iter().copied().fold(f64::INFINITY, f64::min);
        Ok((outcomes, tick_us))
    }
}

/// The middle of a ball beside the straight line from the start to the goal, farther out than that from the base \[m\].
fn beside(start: DVec3, goal: DVec3) -> DVec3 {
    let (along, middle) = (goal - start, 0.5 * (start + goal));
    let far_m = (FROM_GOAL_M.powi(2) - 0.25 * along.length_squared()).max(0.0).sqrt();
    let aside = along.cross(DVec3::Z).normalize_or(DVec3::X) * far_m.max(BESIDE_M);
    middle + aside * middle.dot(aside).signum()
}
