//! How many Gaussians: given, or chosen by the Bayesian information criterion.
//!
//! `BIC(K) = p(K) ln n − 2 ln L(K)`, p(K) = K − 1 + K Σ (m + m (m + 1)/2)  [Schwarz 1978],
//! with n samples of m coordinates in each view that the mixture is learned in (the frames, or the
//! canonical space with the time), L the likelihood of the mixture after the iterations that
//! training uses. The smallest wins, the smaller K of equals.
//!
//! Samples of a demonstration depend on each other, so the criterion counts more evidence than
//! there is and leans towards many components.

use std::ops::RangeInclusive;
use std::sync::mpsc;

use rayon::prelude::*;

use crate::alignment::Aligned;
use crate::alignment::rest::DemonstrationError;
use crate::canonical::CanonicalSet;
use crate::mixture::tp_gmm::Samples;
use crate::skill::Skill;

/// Where the number of Gaussians comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Components {
    /// The skill file says it.
    SkillFile,
    /// This many.
    Count(usize),
    /// The best of a range.
    Auto {
        /// Fewest.
        least: usize,
        /// Most.
        most: usize,
    },
}

impl Components {
    /// Where a number that is not the skill file's comes from, for the model's provenance.
    #[must_use]
    pub fn origin(self) -> Option<String> {
        match self {
            Self::SkillFile => None,
            Self::Count(_) => Some("the command line".into()),
            Self::Auto { least, most } => Some(format!("BIC among {least} to {most}")),
        }
    }
}

/// A mixture that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// K.
    pub components: usize,
    /// ln L of all samples together \[nat\].
    pub log_likelihood: f64,
    /// p(K).
    pub parameters: usize,
    /// BIC(K) \[nat\].
    pub bic: f64,
    /// A component holds no samples: this K cannot be learned.
    pub empty: bool,
}

/// All mixtures that were tried, and the best.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// K of the least BIC.
    pub components: usize,
    /// In order of K.
    pub candidates: Vec<Candidate>,
}

impl Choice {
    /// What the user should know: the range may have been too narrow.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let last = self.candidates.last().is_some_and(|c| c.components == self.components);
        (last && self.candidates.len() > 1).then(|| {
            format!(
                "K = {} is the most that was tried: more may describe the demonstrations better \
                 (--components-range), or the one of the skill file may do",
                self.components
            )
        })
    }
}

/// Why no number of Gaussians is chosen.
#[derive(Debug, thiserror::Error)]
pub enum ChoiceError {
    /// A demonstration cannot be learned from.
    #[error(transparent)]
    Demonstration(#[from] DemonstrationError),
    /// The command line asks for a number that cannot be.
    #[error("option --components: {0}")]
    Components(String),
}

/// Chooses the number of Gaussians. The candidates are computed side by side; the result depends
/// on input and seed only. `progress` hears of each that is done.
///
/// # Errors
/// The demonstrations cannot be learned from, or not with any number of the range.
///
/// # Panics
/// When there is no demonstration.
pub fn choose(
    skill: &Skill,
    (aligned, set): (&Aligned, &CanonicalSet),
    seed: u64,
    range: RangeInclusive<usize>,
    progress: &mut dyn FnMut(&str),
) -> Result<Choice, ChoiceError> {
    for end in [*range.start(), *range.end()] {
        skill.clone().with_components(end).map_err(ChoiceError::Components)?;
    }
    let samples = Samples::new(skill, &aligned.demonstrations, set);
    let most = samples.components_max();
    let tried: Vec<usize> = range.clone().filter(|components| *components <= most).collect();
    let (sender, done) = mpsc::channel();
    let candidates: Vec<Candidate> = std::thread::scope(|scope| {
        let work = scope.spawn(|| {
            // The channel closes with this thread's sender, and so ends the loop below.
            tried
                .par_iter()
                .map_with(sender, |sender, components| {
                    let candidate = candidate(skill, &samples, *components, seed);
                    // Progress that nobody hears changes nothing.
                    let _ = sender.send(*components);
                    candidate
                })
                .collect()
        });
        for components in done {
            progress(&format!("mixture of {components} Gaussians"));
        }
        work.join().expect("expectation maximisation does not panic")
    });
    let learnable = candidates.iter().filter(|candidate| !candidate.empty);
    let best = learnable.min_by(|a, b| a.bic.total_cmp(&b.bic)).ok_or_else(|| {
        ChoiceError::Components(format!(
            "expected a range with a number that {} samples can fill, found {} to {}",
            samples.len(),
            range.start(),
            range.end()
        ))
    })?;
    Ok(Choice { components: best.components, candidates })
}

fn candidate(skill: &Skill, samples: &Samples, components: usize, seed: u64) -> Candidate {
    let Ok(mixture) = samples.learn_exactly(skill, components, seed) else {
        let (log_likelihood, bic) = (f64::NEG_INFINITY, f64::INFINITY);
        return Candidate { components, log_likelihood, parameters: 0, bic, empty: true };
    };
    let count = samples.len() as f64;
    let mean = mixture.log_likelihoods[mixture.log_likelihoods.len() - 1];
    let (log_likelihood, parameters) = (mean * count, mixture.parameters);
    let bic = parameters as f64 * count.ln() - 2.0 * log_likelihood;
    Candidate { components, log_likelihood, parameters, bic, empty: false }
}
