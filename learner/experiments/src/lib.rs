//! The experiments of the thesis, and harder ones, on any set of demonstrations.
//!
//! [`run`] trains what is compared ([`models`]), makes every rollout of [`protocol`] and
//! [`stability`], and writes `results.json`, one row a rollout ([`results`]), and `report.html`
//! ([`report`]): each figure beside what the thesis published ([`published`]), and a table of what
//! the default policy must do ([`verdict`]).

pub mod baselines;
pub mod dataset;
pub mod follower;
pub mod metric;
pub mod models;
pub mod protocol;
pub mod published;
pub mod report;
pub mod results;
pub mod stability;
pub mod verdict;
pub mod world;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use tprmp_model::skill_model::Manifold;

use dataset::{SkillSet, read_dataset};
use models::{Kind, SkillFiles, train_all};
use protocol::{Bench, Extent};
use tprmp_learner::canonical::DemonstrationError;
use tprmp_learner::file_error::FileError;

/// Where the shipped planar skills are, in the configuration folder.
const SHIPPED: &str = "demonstrations/drawings";
/// … and the pick.
const SHIPPED_PICK: &str = "demonstrations/pick";

/// What `learner experiments` is asked for.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Data set: a folder with a folder of demonstrations a skill, with files of the thesis' layout,
    /// or with LASA shapes; by default the shipped drawings and the pick
    #[arg(long, value_name = "PATH")]
    pub dataset: Option<PathBuf>,
    /// A look at each experiment: fewer skills, settings and starts
    #[arg(long)]
    pub quick: bool,
    /// Folder for results.json and report.html; made when it is missing
    #[arg(long, value_name = "DIR", default_value = "target/experiments")]
    pub out: PathBuf,
    /// Seed of all that is drawn
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder with skill files and shipped demonstrations
    #[arg(long, value_name = "DIR", default_value = "config")]
    pub config: PathBuf,
}

/// Of this many skills one is taken in a quick run.
const QUICK_EVERY: usize = 4;
/// Planar skills of the thesis, over which its medians are.
const PUBLISHED_SKILLS: usize = 15;

/// Why there are no results.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The data set, a skill file, or the folder of results.
    #[error(transparent)]
    File(#[from] FileError),
    /// A demonstration does not move.
    #[error(transparent)]
    Demonstration(#[from] DemonstrationError),
}

/// Runs all experiments; returns what to print.
///
/// # Errors
/// [`ExperimentError`]: the data set or a skill file is refused, or the folder cannot be written.
pub fn run(options: &Options) -> Result<String, ExperimentError> {
    let begun = Instant::now();
    let (dataset, mut skills) = skills(options)?;
    let extent = if options.quick { Extent::quick() } else { Extent::full() };
    let mut files = BTreeMap::new();
    for (manifold, name) in [(Manifold::R2, "planar"), (Manifold::R3S3, "pick")] {
        let space = models::space(manifold);
        let mut own = skills.iter().filter(|set| models::space(set.manifold) == space).peekable();
        if own.peek().is_some() {
            let published = own.any(SkillSet::has_reference_frames);
            files.insert(name, SkillFiles::read(&options.config, name, published)?);
        }
    }
    for set in &mut skills {
        set.cut_rest(files[models::space(set.manifold)].of(Kind::Canonical))?;
    }
    let components: BTreeMap<(&'static str, Kind), usize> = files
        .iter()
        .flat_map(|(name, files)| {
            Kind::ALL.map(|kind| ((*name, kind), files.of(kind).mixture.components))
        })
        .collect();
    std::fs::create_dir_all(&options.out)
        .map_err(|source| FileError::Write { path: options.out.clone(), source })?;
    println!("data set   {dataset}: {} skills, seed {}", skills.len(), options.seed);
    let models = train_all(&files, &skills, &extent.components, options.seed);
    let trained = begun.elapsed();
    let covariance_scale =
        files.get("planar").map_or(1.0, |f| f.of(Kind::Thesis).mixture.covariance_scale);
    let bench = Bench {
        dataset: dataset.clone(),
        skills: &skills,
        models: &models,
        components: &components,
        covariance_scale,
        extent,
        seed: options.seed,
    };
    let cases = bench.cases();
    let mut rows = bench.run(&cases);
    rows.extend(bench.stability());
    let timed = bench.iteration_times();
    rows.extend(timed.iter().map(|(row, _)| row.clone()));
    results::write(&rows, &options.out.join("results.json"))?;
    let own = |name| components.get(&(name, Kind::Canonical)).copied().unwrap_or(0);
    let mut verdicts = verdict::verdicts(&rows, &models, [own("planar"), own("pick")]);
    if skills.iter().filter(|set| set.has_reference_frames()).count() == PUBLISHED_SKILLS {
        verdicts.push(verdict::reproduction(&rows, &published::published()));
    }
    let page = report::page(&report::Run {
        bench: &bench,
        cases: &cases,
        rows: &rows,
        timed: &timed,
        verdicts: &verdicts,
        trained,
        elapsed: begun.elapsed(),
    });
    let path = options.out.join("report.html");
    std::fs::write(&path, page)
        .map_err(|source| FileError::Write { path: path.clone(), source })?;
    let mut text = report::summary(&verdicts, &models.failures);
    text += &format!(
        "{} rows in {:.0} s (training {:.0} s)\nwrote      {}\nwrote      {}\n",
        rows.len(),
        begun.elapsed().as_secs_f64(),
        trained.as_secs_f64(),
        options.out.join("results.json").display(),
        path.display()
    );
    Ok(text)
}

/// Name of the data set, and its skills: those that are asked for, of a quick run only some.
fn skills(options: &Options) -> Result<(String, Vec<SkillSet>), FileError> {
    let name =
        |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let (dataset, mut skills) = match &options.dataset {
        Some(path) => (name(path), read_dataset(path)?),
        None => {
            let mut skills = read_dataset(&options.config.join(SHIPPED))?;
            skills.extend(read_dataset(&options.config.join(SHIPPED_PICK))?);
            ("shipped".into(), skills)
        }
    };
    if options.quick {
        let mut planar = 0;
        skills.retain(|set| {
            let counts = set.manifold == Manifold::R2;
            planar += usize::from(counts);
            !counts || (planar - 1).is_multiple_of(QUICK_EVERY)
        });
    }
    Ok((dataset, skills))
}

/// A progress bar, drawn on a terminal only.
fn progress(name: &'static str, length: usize) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{msg:<10} {bar:40} {pos}/{len} {elapsed} (eta {eta})")
            .expect("the template is well formed");
    let bar = ProgressBar::new(length as u64).with_style(style).with_message(name);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
