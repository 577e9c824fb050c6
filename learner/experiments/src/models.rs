//! Trains what is compared.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use tprmp_learner::certify::policy::LearnedPolicy;
use tprmp_learner::demonstration::Demonstration;
use tprmp_learner::file_error::FileError;
use tprmp_learner::mixture::components::ChoiceError;
use tprmp_learner::skill::Skill;
use tprmp_learner::train::{TrainError, learn};
use tprmp_model::skill_model::SkillModel;

use crate::body::ControllerLeaves;
use crate::dataset::SkillSet;
use crate::experiment::{PolicyKind, Space};
use crate::progress::progress;

/// The skill files of one space.
#[derive(Clone, Debug)]
struct Files {
    canonical: Skill,
    thesis: Skill,
    published: Option<Skill>,
}

/// The skill files by which policies are learned.
#[derive(Clone, Debug)]
pub(crate) struct SkillFiles(BTreeMap<Space, Files>);

impl SkillFiles {
    /// Reads, for each space of these skills, `<space>.ron` and `<space>_thesis.ron` from the folder of
    /// skill files, and `<space>_published.ron` where the thesis learned one with frames of its own.
    ///
    /// # Errors
    /// [`FileError`] of a file that is missing or refused.
    pub(crate) fn read(config: &Path, skills: &[SkillSet]) -> Result<Self, FileError> {
        let mut spaces = BTreeMap::new();
        for space in Space::ALL {
            let mut own = skills.iter().filter(|set| set.space() == space).peekable();
            if own.peek().is_none() {
                continue;
            }
            let read = |suffix| Skill::read(&config.join(format!("skills/{space}{suffix}.ron")));
            let published = own.any(SkillSet::has_reference_frames).then(|| read("_published"));
            let published = published.transpose()?;
            let files = Files { canonical: read("")?, thesis: read("_thesis")?, published };
            spaces.insert(space, files);
        }
        Ok(Self(spaces))
    }

    /// The skill file of a learned policy; `None` when no skill lives there.
    pub(crate) fn of(&self, space: Space, policy: PolicyKind) -> Option<&Skill> {
        let files = self.0.get(&space)?;
        Some(if policy == PolicyKind::Canonical { &files.canonical } else { &files.thesis })
    }

    /// Gaussians of a learned policy where their number is not varied; 0 when no skill lives there.
    pub(crate) fn count(&self, space: Space, policy: PolicyKind) -> usize {
        self.of(space, policy).map_or(0, |skill| skill.mixture.components)
    }

    /// These numbers of Gaussians, and that of the skill file.
    pub(crate) fn counts(&self, varied: &[usize], space: Space, policy: PolicyKind) -> Vec<usize> {
        let (mut counts, own) = (varied.to_vec(), self.count(space, policy));
        if !counts.contains(&own) {
            counts.push(own);
        }
        counts
    }

    /// The skill file by which a policy is learned on these demonstrations, and the demonstrations: on
    /// the thesis' own skills its policy is learned as it was there.
    fn learned<'a>(
        &'a self,
        policy: PolicyKind,
        set: &'a SkillSet,
    ) -> (&'a Skill, &'a [Demonstration]) {
        let files = &self.0[&set.space()];
        match (policy, &files.published) {
            (PolicyKind::Canonical, _) => (&files.canonical, &set.demonstrations),
            (_, Some(skill)) if set.has_reference_frames() => (skill, &set.as_published),
            _ => (&files.thesis, &set.demonstrations),
        }
    }
}

/// What identifies a trained model: policy, number of Gaussians, skill.
pub(crate) type Key = (PolicyKind, usize, String);

#[derive(Debug)]
pub(crate) struct Trained {
    pub(crate) model: SkillModel,
    /// As it is evaluated.
    pub(crate) policy: LearnedPolicy,
    /// How long the training took, certificate included where there is one [s].
    pub(crate) training_s: f64,
    /// Whether it was certified or refused.
    pub(crate) examined: bool,
}

/// All trained models, and why others could not be trained.
#[derive(Debug, Default)]
pub(crate) struct Models {
    pub(crate) trained: BTreeMap<Key, Trained>,
    /// Policy, number of Gaussians, skill, and why.
    pub(crate) failures: Vec<String>,
}

impl Models {
    /// A model, when it could be trained.
    pub(crate) fn get(
        &self,
        policy: PolicyKind,
        components: usize,
        skill: &str,
    ) -> Option<&Trained> {
        self.trained.get(&(policy, components, skill.to_owned()))
    }
}

/// A model to be trained.
struct Training<'a> {
    set: &'a SkillSet,
    policy: PolicyKind,
    components: usize,
    /// With the number of Gaussians that the skill file names a certificate is made.
    examined: bool,
}

impl Training<'_> {
    fn run(
        &self,
        files: &SkillFiles,
        leaves: &ControllerLeaves,
        seed: u64,
    ) -> Result<Trained, TrainError> {
        let (skill, demonstrations) = files.learned(self.policy, self.set);
        let skill = skill.clone().with_components(self.components);
        let mut skill = skill.map_err(ChoiceError::Components)?;
        self.set.name.clone_into(&mut skill.skill);
        if !self.examined {
            skill.certification.random_starts = 0;
            skill.certification.displaced_starts = 0;
        }
        let begun = Instant::now();
        let model = learn(&skill, demonstrations, seed, &mut |_| {})?.model;
        let training_s = begun.elapsed().as_secs_f64();
        let policy = leaves.scaled(self.set.scale()).policy(&model)?;
        Ok(Trained { model, policy, training_s, examined: self.examined })
    }
}

/// Trains each policy with each number of Gaussians on each skill.
pub(crate) fn train_all(
    files: &SkillFiles,
    leaves: &ControllerLeaves,
    skills: &[SkillSet],
    components: &[usize],
    seed: u64,
) -> Models {
    let mut wanted = Vec::new();
    for set in skills {
        for policy in PolicyKind::LEARNED {
            let own = files.count(set.space(), policy);
            let counts = files.counts(components, set.space(), policy).into_iter();
            wanted.extend(counts.map(|components| Training {
                set,
                policy,
                components,
                examined: components == own,
            }));
        }
    }
    let bar = progress("training", wanted.len());
    let train = |training: &Training| {
        let result = training.run(files, leaves, seed);
        bar.inc(1);
        ((training.policy, training.components, training.set.name.clone()), result)
    };
    // The default policy's training is timed: one after the other, each on all cores.
    let (timed, others): (Vec<_>, Vec<_>) = wanted
        .into_iter()
        .partition(|training| training.policy == PolicyKind::Canonical && training.examined);
    let mut results: Vec<_> = timed.iter().map(train).collect();
    results.par_extend(others.par_iter().map(train));
    bar.finish_and_clear();
    let mut models = Models::default();
    for (key, result) in results {
        match result {
            Ok(trained) => {
                models.trained.insert(key, trained);
            }
            Err(error) => {
                let (policy, count, skill) = key;
                models.failures.push(format!("{policy}, K = {count}, skill `{skill}`: {error}"));
            }
        }
    }
    models
}
