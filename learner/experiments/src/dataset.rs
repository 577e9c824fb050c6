//! Data sets: folders of demonstrations of many skills, in any of the layouts that can be imported.
//!
//! * a folder a skill, each with `tprmp-demonstration/1` files (the shipped sets, recordings),
//! * one such folder alone,
//! * files in the thesis' layout (`.json` with several demonstrations each),
//! * shapes of the LASA handwriting data set (`.mat`).

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Deserialize;
use tprmp_learner::alignment::rest::{DemonstrationError, moving_ranges};
use tprmp_learner::demonstration::{BYTES_MAX, Demonstration, SCHEMA, read};
use tprmp_learner::file_error::{FileError, read_text};
use tprmp_learner::import::{Selection, load};
use tprmp_learner::skill::Skill;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use crate::experiment::Space;
use crate::scale::{bounds, scale, size_m};

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
    /// By what the lengths of the protocols are multiplied: how large the data set is beside the thesis'.
    scale: f64,
}

/// What tells the layouts of a JSON file apart.
#[derive(Deserialize)]
struct Header {
    schema: Option<String>,
    manifold: Option<String>,
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

    /// Where it lives.
    pub(crate) fn space(&self) -> Space {
        Space::of(self.manifold)
    }

    /// By what all lengths, speeds, accelerations and forces of the protocols are multiplied.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Its size: the mean diagonal of the boxes around its demonstrations \[m\].
    #[must_use]
    pub fn size_m(&self) -> f64 {
        size_m(&self.demonstrations)
    }

    /// The corners of the box around all its demonstrations \[m\].
    pub(crate) fn bounds(&self) -> [DVec3; 2] {
        let poses = self.demonstrations.iter().flat_map(|d| &d.poses);
        bounds(poses.map(|pose| pose.position))
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

/// Reads all skills of a data set, in order of their names; they have the scale of the whole.
///
/// # Errors
/// [`FileError`], naming the path: it is missing or no folder, holds no skill in a known layout,
/// or a file of it is refused.
pub fn read_dataset(folder: &Path) -> Result<Vec<SkillSet>, FileError> {
    let fail =
        |problem| Err(FileError::Input { path: folder.into(), place: "data set".into(), problem });
    if !folder.is_dir() {
        let found = if folder.exists() { "a file" } else { "nothing" };
        return fail(format!("expected a folder, found {found}"));
    }
    let mut skills = Vec::new();
    skills.extend(skill_set(folder)?);
    for path in sorted(folder)? {
        if path.is_dir() {
            skills.extend(skill_set(&path)?);
        } else if has_extension(&path, "mat") {
            skills.push(of(load(&path, &Selection::default())?));
        } else if has_extension(&path, "json")
            && let Some(demonstrations) = header(&path)?.demonstrations
        {
            let tagged = demonstrations.iter().any(|d| d.tag.as_deref() == Some(TAG));
            let tag = tagged.then(|| TAG.to_owned());
            let selection = Selection { tag, ..Selection::default() };
            let mut set = of(load(&path, &selection)?);
            set.as_published = load(&path, &Selection { reference_frames: true, ..selection })?;
            skills.push(set);
        }
    }
    if skills.is_empty() {
        return fail(
            "expected a folder of demonstrations a skill, or files of the thesis' layout (.json) \
             or of LASA (.mat), found none of them"
                .into(),
        );
    }
    skills.sort_by(|a, b| a.name.cmp(&b.name));
    set_scales(&mut skills);
    if let Some(pair) = skills.windows(2).find(|pair| pair[0].name == pair[1].name) {
        return fail(format!("expected skills that differ, found `{}` twice", pair[0].name));
    }
    Ok(skills)
}

/// Gives the skills of each space their common scale.
fn set_scales(skills: &mut [SkillSet]) {
    for space in Space::ALL {
        let own = skills.iter().filter(|set| set.space() == space);
        let sizes_m: Vec<f64> = own.map(SkillSet::size_m).collect();
        let scale = scale(space, &sizes_m);
        skills.iter_mut().filter(|set| set.space() == space).for_each(|set| set.scale = scale);
    }
}

fn sorted(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let paths = std::fs::read_dir(folder)
        .and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>, _>>());
    let mut paths = paths.map_err(|source| FileError::Read { path: folder.into(), source })?;
    paths.sort();
    Ok(paths)
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

fn header(path: &Path) -> Result<Header, FileError> {
    serde_json::from_str(&read_text(path, BYTES_MAX)?)
        .map_err(|e| FileError::syntax(path, e.line(), e.column(), e.to_string()))
}

/// The skill of the `tprmp-demonstration/1` files in a folder, if there are any.
fn skill_set(folder: &Path) -> Result<Option<SkillSet>, FileError> {
    let mut demonstrations: Vec<Demonstration> = Vec::new();
    for file in sorted(folder)?.iter().filter(|f| f.is_file() && has_extension(f, "json")) {
        let header = header(file)?;
        if header.schema.as_deref() != Some(SCHEMA) {
            continue;
        }
        let planar = header.manifold.as_deref() == Some("R2");
        let [start, goal] = if planar { ["start", "end"] } else { ["ee_start", "object"] };
        let demonstration = read(file, start, goal)?;
        if let Some(first) = demonstrations.first()
            && (&first.skill, first.manifold) != (&demonstration.skill, demonstration.manifold)
        {
            let problem = format!("expected `{}`, found `{}`", first.skill, demonstration.skill);
            return Err(FileError::key(file, "skill", problem));
        }
        demonstrations.push(demonstration);
    }
    Ok((!demonstrations.is_empty()).then(|| of(demonstrations)))
}

/// A skill of demonstrations, of which there is at least one.
fn of(demonstrations: Vec<Demonstration>) -> SkillSet {
    let (name, manifold) = (demonstrations[0].skill.clone(), demonstrations[0].manifold);
    let moving = demonstrations.iter().map(|d| 0..d.poses.len()).collect();
    let as_published = demonstrations.clone();
    SkillSet { name, manifold, as_published, demonstrations, moving, scale: 1.0 }
}
