//! The whole path from demonstrations to a model, in five steps.

use std::path::Path;
use std::time::{Duration, Instant};

use tprmp_model::skill_model::{
    Canonical, Certificate, EvaluationError, Figure, Fit, FrameMixture, Motion, PolicyModel,
    ProgramFit, SkillModel, Waypoint,
};
use tprmp_rmpflow::policy::canonical::frame_map::Anchor;

use crate::alignment::rest::DemonstrationError;
use crate::alignment::{Aligned, Alignment, consistency};
use crate::canonical::agreement::{Agreement, paths};
use crate::canonical::{CanonicalSet, PhaseProfile, canonicalise};
use crate::certify::Certifier;
use crate::certify::policy::LearnedPolicy;
use crate::demonstration::plausibility::with_others;
use crate::demonstration::{
    Demonstration, mean_duration_s, plausibility, read_folder, read_folder_with_all_frames, skipped,
};
use crate::file_error::FileError;
use crate::fit::thesis::ThesisFit;
use crate::fit::{self, FitError, Reason};
use crate::fit_warnings::fit_warnings;
use crate::gripper_events;
use crate::mixture::MixtureError;
use crate::mixture::components::{Choice, ChoiceError, Components, choose};
use crate::mixture::tp_gmm::{Samples, TpGmm, uninformative_frames};
use crate::modes::{self, Mode, Modes};
use crate::periodic::{self, PeriodicError};
use crate::proposed_frames;
use crate::provenance::provenance;
use crate::skill::{FitSettings, MotionSettings, Skill};

/// Smoothing over more than this fraction of a motion leaves little of it.
const WINDOW_FRACTION_MAX: f64 = 0.5;

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
    /// A periodic skill.
    #[error(transparent)]
    Periodic(#[from] PeriodicError),
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
    /// How the number of Gaussians was chosen, when the learner chose it.
    pub choice: Option<Choice>,
}

/// A step of the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The number of Gaussians is chosen.
    Choice,
    /// Demonstrations are brought to a common time and into canonical coordinates.
    Alignment,
    /// It is seen how well they agree there.
    Agreement,
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
            Self::Agreement => "agreement",
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
    let skipped = skipped(&folder)?;
    let (name, start, goal) = (&skill.skill, &skill.start_frame, &skill.goal_frame);
    if skill.proposes_frames {
        let all = read_folder_with_all_frames(&folder, name, skill.manifold, start, goal)?;
        let proposal = proposed_frames::propose(&skill, &all)?;
        let origin = proposal.origin();
        let mut trained = train_from(&proposal.skill, &all, components, seed, progress)?;
        let parameters = &mut trained.model.provenance.hyper_parameters;
        parameters.push(("other_frames_origin".into(), origin));
        trained.warnings.extend(proposal.warnings);
        trained.warnings.extend(skipped);
        return Ok(trained);
    }
    let others = &skill.other_frames;
    let demonstrations = read_folder(&folder, name, skill.manifold, start, goal, others)?;
    let mut trained = if skill.motion == MotionSettings::Periodic {
        train_periodic(skill, &demonstrations, components, seed)?
    } else {
        train_from(&skill, &demonstrations, components, seed, progress)?
    };
    trained.warnings.extend(skipped);
    Ok(trained)
}

/// Trains a skill that goes round. The number of its components is not chosen by the information criterion, which is
/// of mixtures that are learned.
fn train_periodic(
    skill: Skill,
    demonstrations: &[Demonstration],
    components: Components,
    seed: u64,
) -> Result<Trained, TrainError> {
    let count = match components {
        Components::Count(count) => count,
        Components::SkillFile | Components::Auto { .. } => skill.mixture.components,
    };
    let skill = skill.with_components(count).map_err(ChoiceError::Components)?;
    let mut trained = learn_periodic(&skill, demonstrations, seed)?;
    if let Components::Auto { .. } = components {
        trained.warnings.push(format!(
            "the number of components of a periodic skill is not chosen: it is that of the skill file, {count}"
        ));
    }
    if let Some(origin) = components.origin().filter(|_| matches!(components, Components::Count(_)))
    {
        let parameters = &mut trained.model.provenance.hyper_parameters;
        parameters.push(("mixture.components_origin".into(), origin));
    }
    Ok(trained)
}

fn learn_periodic(
    skill: &Skill,
    demonstrations: &[Demonstration],
    seed: u64,
) -> Result<Trained, TrainError> {
    let periodic::Learned { model, warnings, samples, times } =
        periodic::learn(skill, demonstrations, seed)?;
    let steps = [Step::Alignment, Step::Fit, Step::DemonstratedStarts, Step::Certificate];
    let times = steps.into_iter().zip(times).collect();
    Ok(Trained { model, warnings, times, samples, choice: None })
}

/// Trains a skill from its demonstrations.
fn train_from(
    skill: &Skill,
    demonstrations: &[Demonstration],
    components: Components,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Result<Trained, TrainError> {
    let started = Instant::now();
    let modes = modes::split(skill, demonstrations)?;
    let aligned = started.elapsed();
    progress(&Step::Alignment.to_string());
    let started = Instant::now();
    let (count, choice) = match components {
        Components::SkillFile => (skill.mixture.components, None),
        Components::Count(count) => (count, None),
        Components::Auto { least, most } => {
            let Mode { aligned, set, .. } = &modes.modes[0];
            let choice = choose(skill, (aligned, set), seed, least..=most, progress)?;
            (choice.components, Some(choice))
        }
    };
    let chosen = started.elapsed();
    let skill = skill.clone().with_components(count).map_err(ChoiceError::Components)?;
    let mut trained = learn_modes(&skill, modes, seed, progress)?;
    if let Some(origin) = components.origin() {
        let parameters = &mut trained.model.provenance.hyper_parameters;
        parameters.push(("mixture.components_origin".into(), origin));
    }
    if let Some(choice) = choice {
        trained.times.insert(0, (Step::Choice, chosen));
        trained.warnings.extend(choice.warning());
        trained.choice = Some(choice);
    }
    trained.times.insert(0, (Step::Alignment, aligned));
    Ok(trained)
}

/// Learns each mode from its demonstrations: the first one's model carries the others.
///
/// # Errors
/// [`TrainError`], of the first mode that fails.
///
/// # Panics
/// When there is no mode.
pub fn learn_modes(
    skill: &Skill,
    Modes { modes, told }: Modes,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Result<Trained, TrainError> {
    let count = modes.len();
    let mut warnings = told;
    for (number, mode) in (1..).zip(&modes) {
        if let ([only], true) = (&mode.recorded[..], count > 1) {
            warnings.push(format!(
                "mode {number} has one demonstration, `{}`: how far it may be trusted nobody can tell; give it \
                 again, or remove it if it is a mistake",
                only.name
            ));
        }
    }
    let mut all: Option<Trained> = None;
    for (number, mode) in (1..).zip(modes) {
        let trained = learn_mode(skill, mode, seed, progress)?;
        let named = |warning| if count > 1 { format!("mode {number}: {warning}") } else { warning };
        warnings.extend(trained.warnings.iter().cloned().map(named));
        match &mut all {
            None => all = Some(trained),
            Some(first) => {
                for ((_, sum), (_, time)) in first.times.iter_mut().zip(&trained.times) {
                    *sum += *time;
                }
                first.samples += trained.samples;
                first.model.other_modes.push(trained.model);
            }
        }
    }
    Ok(Trained { warnings, ..all.expect("there is a mode") })
}

/// Learns a model from demonstrations, and certifies it: its certificate may have failures. All of them are one
/// way of doing the skill.
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
    if skill.motion == MotionSettings::Periodic {
        return learn_periodic(skill, recorded, seed);
    }
    let started = Instant::now();
    let mode = Mode::of_all(skill, recorded)?;
    let aligned = started.elapsed();
    let mut trained = learn_mode(skill, mode, seed, progress)?;
    trained.times.insert(0, (Step::Alignment, aligned));
    Ok(trained)
}

/// [`learn`], of what is aligned.
fn learn_mode(
    skill: &Skill,
    mode: Mode,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Result<Trained, TrainError> {
    let mut clock = Clock { since: Instant::now(), times: Vec::new(), progress };
    let Mode { recorded, aligned, set, .. } = mode;
    let recorded = &recorded[..];
    let Aligned { demonstrations, alignments, .. } = &aligned;
    let names: Vec<&str> = demonstrations.iter().map(|d| d.name.as_str()).collect();
    let fitted = FittedPolicy::new(skill, demonstrations, set, seed, &mut |step| clock.done(step));
    let fitted = diagnosed(fitted, &names, |left_out| {
        let mut others = demonstrations.clone();
        others.remove(left_out);
        let set = canonicalise(skill, &others);
        set.is_ok_and(|set| FittedPolicy::new(skill, &others, set, seed, &mut |_| {}).is_ok())
    })?;
    let set = &fitted.set;
    let mut model = fitted.model(skill, demonstrations, seed);
    let uncertified = model.clone();
    let policy = LearnedPolicy::new(&uncertified)?;
    let certifier = Certifier::new(skill, demonstrations, set, &policy);
    model.fit.demonstrations = certifier.follow_demonstrations(recorded, alignments);
    clock.done(Step::DemonstratedStarts);
    let programs = &model.fit.programs;
    let faults: f64 = programs.iter().filter_map(|p| p.figure(Figure::ValleyFaults)).sum();
    let hears = &mut *clock.progress;
    let mut progress = || hears("random starts");
    model.certificate =
        certifier.certify(&model.fit.demonstrations, faults as u32, seed, &mut progress);
    clock.done(Step::Certificate);

    let profile = PhaseProfile::of(&skill.fit, mean_duration_s(demonstrations));
    let gripper = gripper_events::find(recorded, alignments, &profile);
    model.gripper = gripper.events;
    let span_m = skill.scale.span / set.scales[0];
    let mut warnings = plausibility::warnings(recorded);
    warnings.extend(gripper.warnings);
    warnings.extend(consistency::warnings(skill, recorded));
    warnings.extend(alignment_warnings(skill, alignments, recorded));
    warnings.extend(uninformative_frames(skill, demonstrations));
    warnings.extend(left_out_frames(skill, demonstrations, set));
    if matches!(skill.fit, FitSettings::Canonical(_)) {
        warnings.extend(proposed_frames::harmful(skill, demonstrations, set));
    }
    warnings.extend(fitted.agreement.warnings(skill, demonstrations));
    if let Some(paths) = paths(skill, demonstrations, set) {
        warnings.push(format!(
            "{}; what is learned is their mean, which nobody demonstrated: learn each from a folder of its own",
            paths.told
        ));
    }
    warnings.extend(fit_warnings(&model.fit, span_m));
    let samples = demonstrations.iter().map(|d| d.poses.len()).sum();
    Ok(Trained { model, warnings, times: clock.times, samples, choice: None })
}

/// What the steps in between give.
struct FittedPolicy {
    set: CanonicalSet,
    agreement: Agreement,
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
        set: CanonicalSet,
        seed: u64,
        done: &mut dyn FnMut(Step),
    ) -> Result<Self, TrainError> {
        let agreement = Agreement::new(skill, demonstrations, &set);
        done(Step::Agreement);
        let samples = Samples::new(skill, demonstrations, &set);
        let mixture = samples.learn(skill, skill.mixture.components, seed)?;
        done(Step::Mixture);
        let mut frames = mixture.stored_frames(skill, set.scales);
        for (p, frame) in frames.iter_mut().enumerate() {
            frame.agreement = agreement.frames[p].clone();
            frame.agreement_fraction = set.fractions.get(p).copied().flatten();
        }
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
        Ok(Self { set, agreement, mixture, frames, policy, programs })
    }

    /// The model without its certificate.
    fn model(&self, skill: &Skill, demonstrations: &[Demonstration], seed: u64) -> SkillModel {
        let mixture = &self.mixture;
        SkillModel {
            skill: skill.skill.clone(),
            manifold: skill.manifold,
            motion: Motion::Discrete,
            tool_frame: skill.tool_frame.clone(),
            start_frame: skill.start_frame.clone(),
            goal_frame: skill.goal_frame.clone(),
            canonical: stored_canonical(skill, demonstrations, &self.set),
            gaussians: mixture.stored_canonical(skill, self.set.scales),
            frames: self.frames.clone(),
            policy: self.policy.clone(),
            gripper: Vec::new(),
            fit: Fit {
                em_iterations: mixture.log_likelihoods.len() as u32,
                em_log_likelihood: mixture.log_likelihoods[mixture.log_likelihoods.len() - 1],
                programs: self.programs.clone(),
                duration_s: mean_duration_s(demonstrations),
                agreement: self.agreement.map.clone(),
                demonstrations: Vec::new(),
            },
            certificate: Certificate::none(),
            provenance: provenance(skill, demonstrations, seed),
            other_modes: Vec::new(),
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

/// What the alignment found that people should know.
fn alignment_warnings(
    skill: &Skill,
    alignments: &[Alignment],
    recorded: &[Demonstration],
) -> Vec<String> {
    let mut warnings = Vec::new();
    let named = || alignments.iter().zip(recorded).map(|(a, d)| (a, d.name.as_str()));
    if let Some((paused, name)) = named().max_by(|a, b| a.0.pauses_s.total_cmp(&b.0.pauses_s))
        && paused.pauses_s > 0.0
    {
        let count = alignments.iter().filter(|a| a.pauses_s > 0.0).count();
        warnings.push(format!(
            "{} pauses for {:.1} s where others do not: it is left out",
            with_others(name, count),
            paused.pauses_s
        ));
    }
    if let Some((shortest, name)) = named().min_by(|a, b| a.0.duration_s.total_cmp(&b.0.duration_s))
        && skill.smoothing.window_s > WINDOW_FRACTION_MAX * shortest.duration_s
    {
        warnings.push(format!(
            "key `smoothing.window_s` is {} s, and `{name}` moves for {:.2} s only: its path is smoothed away",
            skill.smoothing.window_s, shortest.duration_s
        ));
    }
    warnings
}

/// Frames that the skill file names and the path does not pass.
fn left_out_frames(
    skill: &Skill,
    demonstrations: &[Demonstration],
    set: &CanonicalSet,
) -> Vec<String> {
    if !matches!(skill.fit, FitSettings::Canonical(_)) {
        return Vec::new();
    }
    let acts = |index: usize| set.map.anchors().iter().any(|anchor| anchor.index == index);
    let named = skill.named_frames(&demonstrations[0]).enumerate();
    named
        .filter(|(index, _)| !acts(*index))
        .map(|(index, (name, _))| {
            let why = proposed_frames::why_left_out(skill, set, index);
            format!("the frame `{name}` is left out of the path: {why}")
        })
        .collect()
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
