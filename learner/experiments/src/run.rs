//! A run of all experiments.

use std::path::{Path, PathBuf};
use std::time::Instant;

use tprmp_files::{Existing, make_folder, outln, try_out, write};
use tprmp_learner::file_error::FileError;
use tprmp_learner::skill::{AlignmentMethod, Skill};

use crate::bench::Bench;
use crate::body::ControllerLeaves;
use crate::case::Extent;
use crate::dataset::{SkillSet, read_dataset};
use crate::error::ExperimentsError;
use crate::experiment::{PolicyKind, Space};
use crate::models::{SkillFiles, train_all};
use crate::people::hand::Hand;
use crate::people::table::Row;
use crate::report::content::Run;
use crate::report::measures;
use crate::report::page::{page, summary};
use crate::verdict::{reproduction, verdicts};
use crate::{people, published, results};

/// Where the shipped planar skills are, in the configuration folder.
const SHIPPED: &str = "demonstrations/drawings";
/// … and the pick.
const SHIPPED_PICK: &str = "demonstrations/pick";

/// What a run is asked for.
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
    /// Replace another run's files in this folder
    #[arg(long)]
    pub force: bool,
    /// Seed of all that is drawn
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder with skill files, the planar controller's file and shipped demonstrations
    #[arg(long, value_name = "DIR", default_value = "config")]
    pub config: PathBuf,
}

/// Of this many skills one is taken in a quick run.
const QUICK_EVERY: usize = 4;
/// Planar skills of the thesis, over which its medians are.
const PUBLISHED_SKILLS: usize = 15;

/// Runs all experiments; returns what to print.
///
/// # Errors
/// [`ExperimentsError`]: the data set or a configuration file is refused, or the folder cannot be
/// written.
pub fn run(options: &Options) -> Result<String, ExperimentsError> {
    let begun = Instant::now();
    let seed = options.seed;
    let (dataset, mut skills) = skills(options)?;
    let extent = if options.quick { Extent::quick() } else { Extent::full() };
    let leaves = ControllerLeaves::read(&options.config)?;
    let files = SkillFiles::read(&options.config, &skills)?;
    for set in &mut skills {
        if let Some(skill) = files.of(set.space(), PolicyKind::Canonical) {
            set.cut_rest(skill)?;
        }
    }
    make_folder(&options.out)?;
    let [results_path, path] = ["results.json", "report.html"].map(|name| options.out.join(name));
    for path in [&results_path, &path] {
        try_out(path, Existing::unless(options.force))?;
    }
    outln!("data set   {dataset}: {} skills, seed {seed}", skills.len());
    let models = train_all(&files, &leaves, &skills, &extent.components, seed);
    let trained = begun.elapsed();
    let bench = Bench { dataset, skills: &skills, models: &models, files: &files, extent, seed };
    let cases = bench.cases(&leaves);
    let mut rows = bench.run(&cases);
    rows.extend(bench.stability());
    rows.extend(bench.grid_starts());
    let timed = bench.iteration_times();
    rows.extend(timed.iter().map(|(row, _)| row.clone()));
    results::write(&rows, &results_path)?;
    let own = Space::ALL.map(|space| files.count(space, PolicyKind::Canonical));
    let mut verdicts = verdicts(&rows, &models, own);
    if skills.iter().filter(|set| set.has_reference_frames()).count() == PUBLISHED_SKILLS {
        verdicts.push(reproduction(&rows, &published::published()));
    }
    let people = people(options)?;
    verdicts.extend(people::table::verdicts(&people));
    let content = Run {
        people: &people,
        bench: &bench,
        cases: &cases,
        rows: &rows,
        timed: &timed,
        verdicts: &verdicts,
        trained,
        elapsed: begun.elapsed(),
    };
    write(&path, page(&content), Existing::Replace)?;
    Ok(format!(
        "{}{}{}{} rows in {:.0} s (training {:.0} s)\nwrote      {}\nwrote      {}\n",
        summary(&verdicts, &models.failures),
        measures::text(&content),
        if people.is_empty() { String::new() } else { people::table::text(&people) },
        rows.len(),
        begun.elapsed().as_secs_f64(),
        trained.as_secs_f64(),
        results_path.display(),
        path.display()
    ))
}

/// Seeds of the hand-like recordings, and of a quick run.
const PEOPLE_SEEDS: [u64; 2] = [8, 2];

/// What is learned from hand-like recordings: with the shipped data set alone, which is no recording of people.
fn people(options: &Options) -> Result<Vec<Row>, FileError> {
    if options.dataset.is_some() {
        return Ok(Vec::new());
    }
    let skill = Skill::read(&options.config.join("skills/pick.ron"))?;
    let all = [
        AlignmentMethod::Joint,
        AlignmentMethod::ArcLength,
        AlignmentMethod::Barycentre,
        AlignmentMethod::Clock,
    ];
    let (methods, seeds) =
        if options.quick { (&all[..1], PEOPLE_SEEDS[1]) } else { (&all[..], PEOPLE_SEEDS[0]) };
    Ok(people::table::rows(&skill, &Hand::default(), methods, seeds))
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
            let counts = set.space() == Space::Planar;
            planar += usize::from(counts);
            !counts || (planar - 1).is_multiple_of(QUICK_EVERY)
        });
    }
    Ok((dataset, skills))
}
