//! Periodic skills, such as wiping and stirring: they have a limit cycle in place of a goal.
//!
//! 1. a recording is followed along its length, seen from its frame (`trace`), which tells rests and paces apart from
//!    the path; the length after which it comes again is the period (`recurrence`);
//! 2. dynamic programming says where of the round each recording is (`tracking`): what goes before and after
//!    is left out, and what goes round is cut into complete rounds (`laps`); several recordings of one closed round
//!    each will do as well;
//! 3. the rounds are brought to a common time (`rounds`), closed, and smoothed by their harmonics (`smoothing`), so that
//!    the window of smoothing cuts no fast round;
//! 4. the fields are fitted on the cover of the circle of phases (`fit`), by the convex program of all skills, where
//!    copies of a component have its parameters, and D, by which the potential falls in a round, is one more; fast
//!    rounds are fitted in slow motion: a damping that is small against the pace would not hold the phase;
//! 5. rollouts have to come to one cycle, from wherever they start (`certificate`).
//!
//! The phase of a round rises evenly in time, ṡ = 1/T.

mod certificate;
mod fit;
mod laps;
mod recurrence;
mod rounds;
mod smoothing;
mod trace;
mod tracking;

use std::time::{Duration, Instant};

use tprmp_model::skill_model::{
    Canonical, Certificate, EvaluationError, Figure, Fit, Motion, PolicyModel, ProgramFit,
    SkillModel,
};

use crate::alignment::rest::DemonstrationError;
use crate::certify::policy::LearnedPolicy;
use crate::demonstration::{Demonstration, plausibility};
use crate::fit::FitError;
use crate::fit_warnings::reduced;
use crate::periodic::certificate::CycleCertifier;
use crate::periodic::rounds::Rounds;
use crate::provenance::provenance;
use crate::skill::{FitSettings, Skill};

/// A cycle that runs farther beside the mean round than this fraction of the skill's span is warned of, …
const PATH_FRACTION_MAX: f64 = 0.03;
/// … and one by another period than this fraction.
const PERIOD_FRACTION_MAX: f64 = 0.1;

/// What is learned slower than this is told.
const SLOW_MOTION: f64 = 1.05;

/// Why there is no model.
#[derive(Debug, thiserror::Error)]
pub enum PeriodicError {
    /// A demonstration cannot be learned from.
    #[error(transparent)]
    Demonstration(#[from] DemonstrationError),
    /// The policy is not fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The learned numbers cannot be computed with.
    #[error("the learned policy cannot be evaluated: {0}")]
    Evaluation(#[from] EvaluationError),
}

/// A periodic skill as it was learned.
#[derive(Clone, Debug)]
pub struct Learned {
    /// The model: its certificate may have failures.
    pub model: SkillModel,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Samples of all rounds.
    pub samples: usize,
    /// How long it took to find the rounds, to fit, to roll out from the demonstrated starts, and to certify.
    pub times: [Duration; 4],
}

/// Learns a periodic skill from its demonstrations, and certifies it.
///
/// # Errors
/// [`PeriodicError`]: no rounds are found, a convex program is not solved, or the fit is not of the canonical policy.
pub fn learn(
    skill: &Skill,
    demonstrations: &[Demonstration],
    seed: u64,
) -> Result<Learned, PeriodicError> {
    let mut since = Instant::now();
    let mut times = [Duration::ZERO; 4];
    let mut done = |step: usize| {
        times[step] = since.elapsed();
        since = Instant::now();
    };
    let FitSettings::Canonical(settings) = &skill.fit else {
        let problem = "a periodic skill is learned by `fit: Canonical`".into();
        return Err(DemonstrationError { name: skill.skill.clone(), problem }.into());
    };
    let rounds = Rounds::find(skill, demonstrations)?;
    done(0);
    let gaussians = fit::gaussians(skill, &rounds);
    let (settings, faster) = fit::in_slow_motion(settings, rounds.period_s);
    let (policy, programs) =
        fit::fit(skill, &settings, &rounds, &gaussians, seed).map_err(FitError::from)?;
    let mut model = model(skill, demonstrations, &rounds, seed, (policy, programs));
    (model.gaussians, model.frames) = {
        let (canonical, frame) = fit::stored(skill, &rounds, &gaussians);
        (canonical, vec![frame])
    };
    done(1);
    let policy = LearnedPolicy::new(&model)?;
    let certifier = CycleCertifier { skill, demonstrations, rounds: &rounds, policy: &policy };
    let (rows, cycle) = certifier.follow_demonstrations();
    done(2);
    let programs = &model.fit.programs;
    let faults: f64 = programs.iter().filter_map(|p| p.figure(Figure::ValleyFaults)).sum();
    let fall = policy.fall_per_round();
    let certificate = certifier.certify(&rows, cycle, (faults as u32, fall), seed);
    done(3);
    (model.fit.demonstrations, model.certificate) = (rows, certificate);
    let mut warnings = plausibility::warnings(demonstrations);
    if faster > SLOW_MOTION {
        warnings.push(format!(
            "a round lasts {:.2} s, too fast for key `fit.damping_1_s`, {}: it is learned in slow motion, {faster:.1} \
             times slower, so that the model's damping is {:.1} 1/s and its stiffness {:.0} times the skill file's; the robot has to accelerate \
             the tool by up to {:.1} m/s²",
            rounds.period_s,
            settings.damping_1_s / faster,
            settings.damping_1_s,
            faster * faster,
            rounds.acceleration_max_m_s2()
        ));
    }
    warnings.extend(self::warnings(skill, demonstrations, &rounds, &model));
    Ok(Learned { model, warnings, samples: rounds.all.len() * rounds.phases.len(), times })
}

/// The model without its Gaussians and its certificate.
fn model(
    skill: &Skill,
    demonstrations: &[Demonstration],
    rounds: &Rounds,
    seed: u64,
    (policy, programs): (PolicyModel, Vec<ProgramFit>),
) -> SkillModel {
    let map = rounds.map();
    SkillModel {
        skill: skill.skill.clone(),
        manifold: skill.manifold,
        motion: Motion::Periodic { period_s: rounds.period_s },
        tool_frame: skill.tool_frame.clone(),
        start_frame: skill.start_frame.clone(),
        goal_frame: skill.goal_frame.clone(),
        canonical: Canonical {
            start: rounds.mean_poses()[0].into(),
            goal_frame: map.goal_frame().into(),
            goal: map.goal().into(),
            rotate_positions: map.rotate_positions(),
            start_phase: 0.0,
            goal_phase: 0.0,
            waypoints: Vec::new(),
            adaptation: None,
        },
        gaussians: Vec::new(),
        frames: Vec::new(),
        policy,
        gripper: Vec::new(),
        fit: Fit {
            em_iterations: 0,
            em_log_likelihood: 0.0,
            programs,
            duration_s: rounds.period_s,
            agreement: fit::agreement(rounds),
            demonstrations: Vec::new(),
        },
        certificate: Certificate::none(),
        provenance: provenance(skill, demonstrations, seed),
        other_modes: Vec::new(),
    }
}

fn warnings(
    skill: &Skill,
    demonstrations: &[Demonstration],
    rounds: &Rounds,
    model: &SkillModel,
) -> Vec<String> {
    let mut warnings = Vec::new();
    if let Some(with) = demonstrations.iter().find(|d| d.gripper.is_some()) {
        warnings.push(format!(
            "`{}` says what the gripper does, which is left out of a periodic skill",
            with.name
        ));
    }
    warnings.extend(reduced(&model.fit.programs));
    let Some(cycle) = &model.certificate.cycle else { return warnings };
    let span_m = skill.scale.span / rounds.scales[0];
    if cycle.beside_max_m > PATH_FRACTION_MAX * span_m {
        warnings.push(format!(
            "the limit cycle runs up to {:.1} mm beside the mean of the demonstrated rounds, where {span_m:.2} m are \
             spanned: do they contradict each other, or are they too fast for `fit.damping_1_s`?",
            1e3 * cycle.beside_max_m
        ));
    }
    let ratio = cycle.period_s / cycle.demonstrated_period_s;
    if (ratio - 1.0).abs() > PERIOD_FRACTION_MAX {
        warnings.push(format!(
            "a round lasts {:.2} s, and was demonstrated in {:.2} s",
            cycle.period_s, cycle.demonstrated_period_s
        ));
    }
    warnings
}
