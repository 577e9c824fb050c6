//! Trains what is compared.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use tprmp_model::skill_model::{Manifold, SkillModel};

use super::dataset::SkillSet;
use super::follower::Model;
use super::progress;
use tprmp_learner::demonstration::Demonstration;
use tprmp_learner::file_error::FileError;
use tprmp_learner::mixture::components::ChoiceError;
use tprmp_learner::skill::Skill;
use tprmp_learner::train::{TrainError, learn};

/// A policy that is learned by a skill file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// The default one, with a certificate.
    Canonical,
    /// The thesis'.
    Thesis,
}

impl Kind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Canonical, Self::Thesis];

    /// As it is called in the results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Canonical => "canonical",
            Self::Thesis => "thesis",
        }
    }
}

/// The skill files of one space.
#[derive(Clone, Debug)]
pub struct SkillFiles {
    canonical: Skill,
    thesis: Skill,
    published: Option<Skill>,
}

impl SkillFiles {
    /// Reads `<name>.ron` and `<name>_thesis.ron` from the folder of skill files, and
    /// `<name>_published.ron` for sets that the thesis learned with frames of its own.
    ///
    /// # Errors
    /// [`FileError`] of a file that is missing or refused.
    pub fn read(config: &Path, name: &str, published: bool) -> Result<Self, FileError> {
        let read = |suffix: &str| Skill::read(&config.join(format!("skills/{name}{suffix}.ron")));
        let published = published.then(|| read("_published")).transpose()?;
        Ok(Self { canonical: read("")?, thesis: read("_thesis")?, published })
    }

    /// The skill file of a policy.
    #[must_use]
    pub fn of(&self, kind: Kind) -> &Skill {
        match kind {
            Kind::Canonical => &self.canonical,
            Kind::Thesis => &self.thesis,
        }
    }

    /// The skill file by which a policy is learned on these demonstrations, and the demonstrations: on
    /// the thesis' own skills its policy is learned as it was there.
    fn learned<'a>(&'a self, kind: Kind, set: &'a SkillSet) -> (&'a Skill, &'a [Demonstration]) {
        match (kind, &self.published) {
            (Kind::Thesis, Some(skill)) if set.has_reference_frames() => (skill, &set.as_published),
            _ => (self.of(kind), &set.demonstrations),
        }
    }
}

/// What identifies a trained model: policy, number of Gaussians, skill.
pub type Key = (Kind, usize, String);

/// A trained model.
#[derive(Debug)]
pub struct Trained {
    /// The model.
    pub model: SkillModel,
    /// As it is evaluated.
    pub evaluated: Model,
    /// How long the training took, certificate included where there is one [s].
    pub training_s: f64,
    /// Whether it was examined.
    pub examined: bool,
}

/// All trained models, and why others could not be trained.
#[derive(Debug, Default)]
pub struct Models {
    /// The models.
    pub trained: BTreeMap<Key, Trained>,
    /// Policy, number of Gaussians, skill, and why.
    pub failures: Vec<String>,
}

impl Models {
    /// A model, when it could be trained.
    #[must_use]
    pub fn get(&self, kind: Kind, components: usize, skill: &str) -> Option<&Trained> {
        self.trained.get(&(kind, components, skill.to_owned()))
    }
}

/// Trains each policy with each number of Gaussians on each skill. The certificate is made for the
/// number of Gaussians that the skill file names.
pub fn train_all(
    files: &BTreeMap<&'static str, SkillFiles>,
    skills: &[SkillSet],
    components: &[usize],
    seed: u64,
) -> Models {
    let mut wanted = Vec::new();
    for set in skills {
        let files = &files[space(set.manifold)];
        for kind in Kind::ALL {
            let own = files.of(kind).mixture.components;
            let mut counts = components.to_vec();
            if !counts.contains(&own) {
                counts.push(own);
            }
            wanted.extend(counts.into_iter().map(|count| (set, kind, count, own)));
        }
    }
    let bar = progress("training", wanted.len());
    let train = |(set, kind, count, own): &(&SkillSet, Kind, usize, usize)| {
        let (skill, demonstrations) = files[space(set.manifold)].learned(*kind, set);
        let key = (*kind, *count, set.name.clone());
        let result = train_one(skill, &set.name, demonstrations, *count, count == own, seed);
        bar.inc(1);
        (key, result)
    };
    // The default policy's training is timed: one after the other, each on all cores.
    let (timed, others): (Vec<_>, Vec<_>) = wanted
        .into_iter()
        .partition(|(_, kind, count, own)| *kind == Kind::Canonical && count == own);
    let mut results: Vec<(Key, Result<Trained, TrainError>)> = timed.iter().map(train).collect();
    results.par_extend(others.par_iter().map(train));
    bar.finish_and_clear();
    let mut models = Models::default();
    for (key, result) in results {
        match result {
            Ok(trained) => {
                models.trained.insert(key, trained);
            }
            Err(error) => {
                let (kind, count, skill) = key;
                let name = kind.name();
                models.failures.push(format!("{name}, K = {count}, skill `{skill}`: {error}"));
            }
        }
    }
    models
}

fn train_one(
    skill: &Skill,
    name: &str,
    demonstrations: &[Demonstration],
    components: usize,
    examined: bool,
    seed: u64,
) -> Result<Trained, TrainError> {
    let mut skill = skill.clone().with_components(components).map_err(ChoiceError::Components)?;
    name.clone_into(&mut skill.skill);
    if !examined {
        skill.certification.random_starts = 0;
        skill.certification.displaced_starts = 0;
    }
    let begun = Instant::now();
    let model = learn(&skill, demonstrations, seed, &mut |_| {})?.model;
    let training_s = begun.elapsed().as_secs_f64();
    let evaluated = Model::new(&model)?;
    Ok(Trained { model, evaluated, training_s, examined })
}

/// Name of the skill files of a space.
#[must_use]
pub fn space(manifold: Manifold) -> &'static str {
    match manifold {
        Manifold::R2 => "planar",
        Manifold::R3 | Manifold::R3S3 => "pick",
    }
}
