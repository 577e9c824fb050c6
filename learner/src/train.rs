//! The whole path from demonstrations to a model, in five steps.

use std::path::Path;
use std::time::{Duration, Instant};

use tprmp_model::skill_model::{
    Canonical, Certificate, DemonstrationRollout, EvaluationError, Figure, Fit, FrameMixture,
    PolicyModel, ProgramFit, ProgramStatus, Provenance, SkillModel, Source, Waypoint,
};
use tprmp_rmpflow::policy::canonical::frame_map::Anchor;

use crate::alignment::rest::DemonstrationError;
use crate::alignment::{Aligned, Alignment, align};
use crate::canonical::{CanonicalSet, canonicalise};
use crate::certify::Certifier;
use crate::certify::policy::LearnedPolicy;
use crate::demonstration::{Demonstration, plausibility, read_folder};
use crate::file_error::FileError;
use crate::fit::thesis::ThesisFit;
use crate::fit::{self, FitError, Reason};
use crate::mixture::MixtureError;
use crate::mixture::components::{Choice, ChoiceError, Components, choose};
use crate::mixture::tp_gmm::{Samples, TpGmm, uninformative_frames};
use crate::skill::{FitSettings, Skill};

/// A demonstration is warned of when it is left by more than this fraction of the skill's span.
const PATH_FRACTION_MAX: f64 = 0.05;

/// With more demonstrations none is left out to see whether it causes a failure.
const DIAGNOSED_MAX: usize = 32;

/// Why there is no model.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The skill file, or a demonstration's.
    #[error(transparent)]
    File(#[from] FileError),
    /// The number of Gaussians.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
    /// A demonstration cannot be learned from.
    #[error(transparent)]
    Demonstration(#[from] DemonstrationError),
    /// The mixture.
    #[error(transparent)]
    Mixture(#[from] MixtureError),
    /// The policy is not fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The learned numbers cannot be computed with.
    #[error("the learned policy cannot be evaluated: {0}")]
    Evaluation(#[from] EvaluationError),
}

/// A trained model, and how the training went.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The model.
    pub model: SkillModel,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Wall time of each step, in order.
    pub times: Vec<(Step, Duration)>,
    /// Samples of all demonstrations.
    pub samples: usize,
    /// How the demonstrations were brought to a common time.
    pub alignments: Vec<Alignment>,
    /// Where the common motion pauses: beginning and duration \[s\].
    pub pauses: Vec<[f64; 2]>,
    /// How the number of Gaussians was chosen, when the learner chose it.
    pub choice: Option<Choice>,
}

/// A step of the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The number of Gaussians is chosen.
    Choice,
    /// Demonstrations are brought to a common time.
    Alignment,
    /// Demonstrations are brought into canonical coordinates.
    CanonicalCoordinates,
    /// The Gaussian mixture is learned.
    Mixture,
    /// The policy is fitted.
    Fit,
    /// The policy is rolled out from the demonstrated starts …
    DemonstratedStarts,
    /// … and from random ones.
    Certificate,
}

impl std::fmt::Display for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Choice => "choice of K",
            Self::Alignment => "alignment",
            Self::CanonicalCoordinates => "canonical coordinates",
            Self::Mixture => "mixture",
            Self::Fit => "fit",
            Self::DemonstratedStarts => "demonstrated starts",
            Self::Certificate => "certificate",
        })
    }
}

/// Wall times of the steps, and who hears of them.
struct Clock<'a> {
    since: Instant,
    times: Vec<(Step, Duration)>,
    progress: &'a mut dyn FnMut(&str),
}

impl Clock<'_> {
    fn done(&mut self, step: Step) {
        let now = Instant::now();
        self.times.push((step, now - self.since));
        self.since = now;
        (self.progress)(&step.to_string());
    }
}

/// Trains a skill file's model with `components` Gaussians. `progress` hears the name of what is done.
///
/// # Errors
/// [`TrainError`], naming the file and key, or the part that failed.
pub fn train(
    skill_file: &Path,
    components: Components,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Result<Trained, TrainError> {
    let skill = Skill::read(skill_file)?;
    let folder = skill_file.parent().unwrap_or(Path::new("")).join(&skill.demonstrations);
    if !folder.is_dir() {
        let problem = format!(
            "expected a folder of demonstrations, relative to this file, found `{}`, which is none",
            skill.demonstrations.display()
        );
        return Err(FileError::key(skill_file, "demonstrations", problem).into());
    }
    let demonstrations = read_folder(
        &folder,
        &skill.skill,
        skill.manifold,
        &skill.start_frame,
        &skill.goal_frame,
        &skill.other_frames,
    )?;
    let started = Instant::now();
    let Some(origin) = components.origin() else {
        return learn(&skill, &demonstrations, seed, progress);
    };
    let (count, choice) = match components {
        Components::SkillFile => (skill.mixture.components, None),
        Components::Count(count) => (count, None),
        Components::Auto { least, most } => {
            let choice = choose(&skill, &demonstrations, seed, least..=most, progress)?;
            (choice.components, Some(choice))
        }
    };
    let chosen = started.elapsed();
    let skill = skill.with_components(count).map_err(ChoiceError::Components)?;
    let mut trained = learn(&skill, &demonstrations, seed, progress)?;
    trained.model.provenance.hyper_parameters.push(("mixture.components_origin".into(), origin));
    if let Some(choice) = choice {
        trained.times.insert(0, (Step::Choice, chosen));
        trained.warnings.extend(choice.warning());
        trained.choice = Some(choice);
    }
    Ok(trained)
}

/// Learns a model from demonstrations, and certifies it: its certificate may have failures.
///
/// # Errors
/// [`TrainError`]: the demonstrations cannot be learned from, or a convex program is not solved.
///
/// # Panics
/// When there is no demonstration.
pub fn learn(
    skill: &Skill,
    recorded: &[Demonstration],
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Result<Trained, TrainError> {
    let mut clock = Clock { since: Instant::now(), times: Vec::new(), progress };
    let Aligned { demonstrations, alignments, pauses } = &align(skill, recorded)?;
    clock.done(Step::Alignment);
    let names: Vec<&str> = demonstrations.iter().map(|d| d.name.as_str()).collect();
    let fitted = FittedPolicy::new(skill, demonstrations, seed, &mut |step| clock.done(step));
    let fitted = diagnosed(fitted, &names, |left_out| {
        let mut others = demonstrations.clone();
        others.remove(left_out);
        FittedPolicy::new(skill, &others, seed, &mut |_| {}).is_ok()
    })?;
    let set = &fitted.set;
    let mut model = fitted.model(skill, demonstrations, seed);
    let uncertified = model.clone();
    let policy = LearnedPolicy::new(&uncertified)?;
    let certifier = Certifier::new(skill, demonstrations, set, &policy);
    model.fit.demonstrations = certifier.follow_demonstrations();
    clock.done(Step::DemonstratedStarts);
    let programs = &model.fit.programs;
    let faults: f64 = programs.iter().filter_map(|p| p.figure(Figure::ValleyFaults)).sum();
    let hears = &mut *clock.progress;
    let mut progress = || hears("random starts");
    model.certificate =
        certifier.certify(&model.fit.demonstrations, faults as u32, seed, &mut progress);
    clock.done(Step::Certificate);

    let mut warnings = plausibility::warnings(recorded);
    warnings.extend(uninformative_frames(skill, demonstrations));
    let span_m = skill.scale.span / set.scales[0];
    warnings.extend(fit_warnings(&model.fit.programs, &model.fit.demonstrations, span_m));
    let samples = demonstrations.iter().map(|d| d.poses.len()).sum();
    Ok(Trained {
        model,
        warnings,
        times: clock.times,
        samples,
        choice: None,
        alignments: alignments.clone(),
        pauses: pauses.clone(),
    })
}

/// What the steps in between give.
struct FittedPolicy {
    set: CanonicalSet,
    mixture: TpGmm,
    frames: Vec<FrameMixture>,
    policy: PolicyModel,
    programs: Vec<ProgramFit>,
}

impl FittedPolicy {
    /// `done` hears each step that is done.
    fn new(
        skill: &Skill,
        demonstrations: &[Demonstration],
        seed: u64,
        done: &mut dyn FnMut(Step),
    ) -> Result<Self, TrainError> {
        let set = canonicalise(skill, demonstrations)?;
        done(Step::CanonicalCoordinates);
        let samples = Samples::new(skill, demonstrations, &set);
        let mixture = samples.learn(skill, skill.mixture.components, seed)?;
        done(Step::Mixture);
        let frames = mixture.stored_frames(skill, set.scales);
        let (policy, programs) = match &skill.fit {
            FitSettings::Canonical(settings) => {
                fit::canonical::fit(skill, settings, &mixture, &set, seed)
                    .map_err(FitError::from)?
            }
            FitSettings::Thesis(settings) => {
                ThesisFit { mixture: &frames, skill, settings, demonstrations }.fit()?
            }
        };
        done(Step::Fit);
        Ok(Self { set, mixture, frames, policy, programs })
    }

    /// The model without its certificate.
    fn model(&self, skill: &Skill, demonstrations: &[Demonstration], seed: u64) -> SkillModel {
        let mixture = &self.mixture;
        let source = |d: &Demonstration| Source { file: d.name.clone(), sha256: d.sha256.clone() };
        SkillModel {
            skill: skill.skill.clone(),
            manifold: skill.manifold,
            tool_frame: skill.tool_frame.clone(),
            start_frame: skill.start_frame.clone(),
            goal_frame: skill.goal_frame.clone(),
            canonical: stored_canonical(skill, demonstrations, &self.set),
            gaussians: mixture.stored_canonical(skill, self.set.scales),
            frames: self.frames.clone(),
            policy: self.policy.clone(),
            fit: Fit {
                em_iterations: mixture.log_likelihoods.len() as u32,
                em_log_likelihood: mixture.log_likelihoods[mixture.log_likelihoods.len() - 1],
                programs: self.programs.clone(),
                demonstrations: Vec::new(),
            },
            certificate: Certificate::none(),
            provenance: Provenance {
                tool_version: env!("CARGO_PKG_VERSION").into(),
                seed,
                demonstrations: demonstrations.iter().map(source).collect(),
                hyper_parameters: skill.values(),
            },
        }
    }
}

/// Frames and goal as the model file stores them.
fn stored_canonical(
    skill: &Skill,
    demonstrations: &[Demonstration],
    set: &CanonicalSet,
) -> Canonical {
    let map = &set.map;
    let names: Vec<&str> = skill.named_frames(&demonstrations[0]).map(|(name, _)| name).collect();
    let waypoint = |anchor: &Anchor| Waypoint {
        frame: names[anchor.index].into(),
        pose: anchor.frame.into(),
        point_m: anchor.point.to_array(),
        phase: anchor.phase,
    };
    let ends = [skill.start_frame.as_str(), &skill.goal_frame];
    let between = map.anchors().iter().filter(|anchor| !ends.contains(&names[anchor.index]));
    let goal = map.anchors()[map.anchors().len() - 1];
    Canonical {
        start: set.start.into(),
        goal_frame: map.goal_frame().into(),
        goal: map.goal().into(),
        rotate_positions: map.rotate_positions(),
        start_phase: map.anchors()[0].phase.min(goal.phase),
        goal_phase: goal.phase,
        waypoints: between.map(waypoint).collect(),
        adaptation: map.adaptation().map(Into::into),
    }
}

/// Leave-one-out diagnosis: a program that is not solved names the demonstrations without any one of
/// which it is. Numbers that a program cannot begin with are the settings', and each try takes as long as a fit.
fn diagnosed<T>(
    mut fitted: Result<T, TrainError>,
    names: &[&str],
    is_solved_without: impl Fn(usize) -> bool,
) -> Result<T, TrainError> {
    if let Err(TrainError::Fit(FitError::NotSolved(failed))) = &mut fitted
        && matches!(failed.reason, Reason::Ended(_))
        && names.len() <= DIAGNOSED_MAX
    {
        let causes = (0..names.len()).filter(|i| names.len() == 1 || is_solved_without(*i));
        failed.causes = causes.map(|i| names[i].to_owned()).collect();
    }
    fitted
}

fn fit_warnings(
    programs: &[ProgramFit],
    demonstrations: &[DemonstrationRollout],
    span_m: f64,
) -> Vec<String> {
    let reduced = programs.iter().filter(|program| program.status != ProgramStatus::Solved);
    let reduced = reduced.map(|program| {
        format!("the {} was solved to a reduced accuracy only ({})", program.name, program.status)
    });
    let left = demonstrations.iter().filter(|row| row.path_rms_m > PATH_FRACTION_MAX * span_m);
    let left = left.map(|row| {
        format!(
            "`{}` is left by {:.1} mm (rms) where {span_m:.2} m are spanned: does it \
             contradict the others?",
            row.name,
            row.path_rms_m * 1e3
        )
    });
    reduced.chain(left).collect()
}

#[cfg(test)]
mod tests {
    use clarabel::solver::SolverStatus;
    use tprmp_model::skill_model::Program;

    use super::*;
    use crate::fit::NotSolved;

    #[test]
    fn the_demonstration_without_which_a_program_is_solved_is_named() {
        let failed = || -> Result<(), TrainError> {
            let reason = Reason::Ended(SolverStatus::NumericalError);
            Err(FitError::from(NotSolved::new(Program::Potential, (reason, 7))).into())
        };
        let names = ["01.json", "02.json", "03.json"];
        let message = |solved_without: &[usize]| {
            let diagnosed = diagnosed(failed(), &names, |i| solved_without.contains(&i));
            diagnosed.unwrap_err().to_string()
        };
        let one = message(&[1]);
        assert!(one.contains("`02.json` causes it") && one.contains("potential"), "{one}");
        let several = message(&[0, 2]);
        assert!(several.contains("`01.json`, `03.json`"), "{several}");
        assert!(message(&[]).contains("no single demonstration"));
        // The only one is the cause, and is not left out.
        let only = diagnosed(failed(), &names[..1], |_| unreachable!("nothing is left"));
        assert!(only.unwrap_err().to_string().contains("`01.json` causes it"));
        assert!(diagnosed(Ok(()), &names, |_| false).is_ok());
    }
}
