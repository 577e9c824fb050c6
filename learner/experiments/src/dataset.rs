//! Data sets: folders of demonstrations of many skills, in any of the layouts that can be imported.
//!
//! * a folder a skill, each with `tprmp-demonstration/1` files (the shipped sets, recordings),
//! * one such folder alone,
//! * files in the thesis' layout (`.json` with several demonstrations each),
//! * shapes of the LASA handwriting data set (`.mat`).

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use tprmp_learner::canonical::{DemonstrationError, moving_ranges};
use tprmp_learner::demonstration::{Demonstration, SCHEMA, read};
use tprmp_learner::file_error::{FileError, read_text};
use tprmp_learner::import::{Selection, load};
use tprmp_learner::skill::Skill;

/// Of two kinds of grasp in one file the first is taken: they are two skills.
const TAG: &str = "pick_top";

/// The demonstrations of one skill.
#[derive(Clone, Debug)]
pub struct SkillSet {
    /// Name of the skill.
    pub name: String,
    /// Space in which it moves.
    pub manifold: Manifold,
    /// Its demonstrations, at least one.
    pub demonstrations: Vec<Demonstration>,
    /// The same with the frames with which the thesis learned them, for its policy.
    pub as_published: Vec<Demonstration>,
    /// Samples of each while it moves: all, unless rest is cut.
    moving: Vec<Range<usize>>,
}

#[derive(Deserialize)]
struct Kind {
    schema: Option<String>,
    demonstrations: Option<Vec<Tagged>>,
}

#[derive(Deserialize)]
struct Tagged {
    tag: Option<String>,
}

impl SkillSet {
    /// Cuts off rest before and after the demonstrations, as it is cut for learning: no policy of the
    /// state can know how long to wait.
    ///
    /// # Errors
    /// [`DemonstrationError`]: one does not move.
    pub fn cut_rest(&mut self, skill: &Skill) -> Result<(), DemonstrationError> {
        self.moving = moving_ranges(&self.demonstrations, &skill.smoothing, &skill.scale)?;
        Ok(())
    }

    /// Whether the thesis learned it with other frames than its demonstrations have: then it is one of
    /// the thesis' own planar skills.
    #[must_use]
    pub fn has_reference_frames(&self) -> bool {
        let frames = |d: &Demonstration| (d.start, d.goal_frame);
        self.manifold == Manifold::R2
            && std::iter::zip(&self.as_published, &self.demonstrations)
                .any(|(a, b)| frames(a) != frames(b))
    }

    /// The poses of a demonstration from its first to its last motion.
    #[must_use]
    pub fn motion(&self, demonstration: usize) -> &[Pose] {
        &self.demonstrations[demonstration].poses[self.moving[demonstration].clone()]
    }
}

/// Reads all skills of a data set, in order of their names.
///
/// # Errors
/// [`FileError`], naming the path: it is missing or no folder, holds no skill in a known layout,
/// or a file of it is refused.
pub fn read_dataset(folder: &Path) -> Result<Vec<SkillSet>, FileError> {
    let fail = |problem: String| FileError::Input {
        path: folder.into(),
        place: "data set".into(),
        problem,
    };
    if !folder.is_dir() {
        let found = if folder.exists() { "a file" } else { "nothing" };
        return Err(fail(format!("expected a folder, found {found}")));
    }
    let entries = sorted(folder)?;
    let mut skills = Vec::new();
    let own = demonstration_files(&entries)?;
    if !own.is_empty() {
        skills.push(skill_set(&own)?);
    }
    for path in &entries {
        if path.is_dir() {
            let files = demonstration_files(&sorted(path)?)?;
            if !files.is_empty() {
                skills.push(skill_set(&files)?);
            }
        } else if has_extension(path, "mat") {
            skills.push(of(load(path, &Selection::default())?));
        } else if has_extension(path, "json") && !own.contains(path) {
            let kind = kind(path)?;
            let Some(demonstrations) = kind.demonstrations else { continue };
            let tagged = demonstrations.iter().any(|d| d.tag.as_deref() == Some(TAG));
            let tag = tagged.then(|| TAG.to_owned());
            let selection = Selection { tag, ..Selection::default() };
            let mut set = of(load(path, &selection)?);
            set.as_published = load(path, &Selection { reference_frames: true, ..selection })?;
            skills.push(set);
        }
    }
    if skills.is_empty() {
        return Err(fail(
            "expected a folder of demonstrations a skill, or files of the thesis' layout (.json) \
             or of LASA (.mat), found none of them"
                .into(),
        ));
    }
    skills.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(pair) = skills.windows(2).find(|pair| pair[0].name == pair[1].name) {
        return Err(fail(format!("expected skills that differ, found `{}` twice", pair[0].name)));
    }
    Ok(skills)
}

fn sorted(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let unreadable = |source| FileError::Read { path: folder.into(), source };
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let mut paths = Vec::new();
    for entry in entries {
        paths.push(entry.map_err(unreadable)?.path());
    }
    paths.sort();
    Ok(paths)
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

fn kind(path: &Path) -> Result<Kind, FileError> {
    serde_json::from_str(&read_text(path)?)
        .map_err(|e| FileError::syntax(path, e.line(), e.column(), e.to_string()))
}

/// The `tprmp-demonstration/1` files among these.
fn demonstration_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, FileError> {
    let mut files = Vec::new();
    for path in paths.iter().filter(|path| path.is_file() && has_extension(path, "json")) {
        if kind(path)?.schema.as_deref() == Some(SCHEMA) {
            files.push(path.clone());
        }
    }
    Ok(files)
}

fn skill_set(files: &[PathBuf]) -> Result<SkillSet, FileError> {
    #[derive(Deserialize)]
    struct Space {
        manifold: String,
    }
    let mut demonstrations: Vec<Demonstration> = Vec::with_capacity(files.len());
    for file in files {
        let space: Space = serde_json::from_str(&read_text(file)?)
            .map_err(|e| FileError::syntax(file, e.line(), e.column(), e.to_string()))?;
        let [start, goal] =
            if space.manifold == "R2" { ["start", "end"] } else { ["ee_start", "object"] };
        let shown = read(file, start, goal)?;
        if let Some(first) = demonstrations.first()
            && (&first.skill, first.manifold) != (&shown.skill, shown.manifold)
        {
            let problem = format!("expected `{}`, found `{}`", first.skill, shown.skill);
            return Err(FileError::key(file, "skill", problem));
        }
        demonstrations.push(shown);
    }
    Ok(of(demonstrations))
}

/// A skill of demonstrations, of which there is at least one.
fn of(demonstrations: Vec<Demonstration>) -> SkillSet {
    let (name, manifold) = (demonstrations[0].skill.clone(), demonstrations[0].manifold);
    let moving = demonstrations.iter().map(|shown| 0..shown.poses.len()).collect();
    SkillSet { name, manifold, as_published: demonstrations.clone(), demonstrations, moving }
}
