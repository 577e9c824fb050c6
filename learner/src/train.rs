//! The whole way from demonstrations to a model.

use std::path::Path as FilePath;
use std::time::{Duration, Instant};

use glam::DVec3;
use nalgebra::{SMatrix, SVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tprmp_model::skill_model::{
    Canonical, Certificate, DemonstrationRollout, FieldModel, Fit, FrameMixture, Policy,
    ProgramFit, Provenance, SkillModel, Source, Waypoint,
};
use tprmp_rmpflow::policy::canonical::frame_map::Anchor;

use crate::canonical::kaiser_smoothing::kaiser_smoothing;
use crate::canonical::savitzky_golay::Path;
use crate::canonical::{CanonicalDemonstration, CanonicalSet, canonicalise, mean_start};
use crate::certify::Examiner;
use crate::certify::policy::Learned;
use crate::demonstration::plausibility;
use crate::demonstration::{self, Demonstration};
use crate::error::LearnerError;
use crate::fit::targets::BlockPath;
use crate::fit::thesis;
use crate::fit::{VALLEY_FAULTS, fit, shape};
use crate::mixture::components::{self, Choice, Components};
use crate::mixture::tp_gmm::{Samples, TpGmm, frames, uninformative_frames};
use crate::skill::{FieldSettings, FitSettings, Skill};

/// A demonstration is warned of when it is left by more than this fraction of the skill's span.
const PATH_FRACTION_MAX: f64 = 0.05;

/// A trained model, and how the training went.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The model.
    pub model: SkillModel,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Wall time of each step, in order.
    pub times: Vec<(&'static str, Duration)>,
    /// Samples of all demonstrations.
    pub samples: usize,
    /// How the number of Gaussians was chosen, when the learner chose it.
    pub choice: Option<Choice>,
}

/// Wall times of the steps, and who is told about them.
struct Clock<'a> {
    since: Instant,
    times: Vec<(&'static str, Duration)>,
    progress: &'a mut dyn FnMut(&str),
}

impl Clock<'_> {
    fn step(&mut self, name: &'static str) {
        let now = Instant::now();
        self.times.push((name, now - self.since));
        self.since = now;
        (self.progress)(name);
    }
}

/// Trains a skill file's model with `components` Gaussians. `progress` is told the name of what is done.
///
/// # Errors
/// [`LearnerError`], naming the file and key, or the part that failed.
pub fn train(
    skill_file: &FilePath,
    components: Components,
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Result<Trained, LearnerError> {
    let skill = Skill::read(skill_file)?;
    let folder = skill_file.parent().unwrap_or(FilePath::new("")).join(&skill.demonstrations);
    if !folder.is_dir() {
        let problem = format!(
            "expected a folder of demonstrations, relative to this file, found `{}`, which is none",
            skill.demonstrations.display()
        );
        return Err(LearnerError::key(skill_file, "demonstrations", problem));
    }
    let demonstrations = demonstration::read_folder(
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
    let choice = match components {
        Components::Auto { least, most } => {
            Some(components::choose(&skill, &demonstrations, seed, least..=most, progress)?)
        }
        Components::SkillFile | Components::Count(_) => None,
    };
    let count = match (&choice, components) {
        (Some(choice), _) => choice.components,
        (None, Components::Count(count)) => count,
        (None, _) => skill.mixture.components,
    };
    let chosen = started.elapsed();
    let skill = skill.with_components(count).map_err(LearnerError::Components)?;
    let mut trained = learn(&skill, &demonstrations, seed, progress)?;
    trained.model.provenance.hyper_parameters.push(("mixture.components_origin".into(), origin));
    if let Some(choice) = choice {
        trained.times.insert(0, ("choice of K", chosen));
        trained.warnings.extend(choice.warning());
        trained.choice = Some(choice);
    }
    Ok(trained)
}

/// Learns a model from demonstrations, and examines it: its certificate may have failures.
///
/// # Errors
/// [`LearnerError`]: the demonstrations cannot be learned from, or a convex program is not solved.
///
/// # Panics
/// When there is no demonstration.
pub fn learn(
    skill: &Skill,
    shown: &[Demonstration],
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Result<Trained, LearnerError> {
    let mut clock = Clock { since: Instant::now(), times: Vec::new(), progress };
    let demonstrations = &prepared(skill, shown);
    let names: Vec<&str> = demonstrations.iter().map(|d| d.name.as_str()).collect();
    let fitted = Fitted::new(skill, demonstrations, seed, &mut |done| clock.step(done));
    let Fitted { set, mixture, frames: mixtures, policy, programs } =
        blaming(fitted, &names, |left_out| {
            let mut others = demonstrations.clone();
            others.remove(left_out);
            Fitted::new(skill, &others, seed, &mut |_| {}).is_ok()
        })?;
    let mut model = SkillModel {
        skill: skill.skill.clone(),
        manifold: skill.manifold,
        tool_frame: skill.tool_frame.clone(),
        start_frame: skill.start_frame.clone(),
        goal_frame: skill.goal_frame.clone(),
        canonical: stored_canonical(skill, demonstrations, &set),
        gaussians: mixture.stored_canonical(skill, set.scales),
        frames: mixtures,
        policy,
        fit: Fit {
            em_iterations: mixture.log_likelihoods.len() as u32,
            em_log_likelihood: mixture.log_likelihoods[mixture.log_likelihoods.len() - 1],
            programs,
            demonstrations: Vec::new(),
        },
        certificate: Certificate::none(),
        provenance: Provenance {
            tool_version: env!("CARGO_PKG_VERSION").into(),
            seed,
            demonstrations: demonstrations
                .iter()
                .map(|d| Source { file: d.name.clone(), sha256: d.sha256.clone() })
                .collect(),
            hyper_parameters: skill.values(),
        },
    };

    let unexamined = model.clone();
    let policy = Learned::new(&unexamined)?;
    let examiner = Examiner::new(skill, demonstrations, &set, &policy);
    model.fit.demonstrations = examiner.follow_demonstrations();
    clock.step("demonstrated starts");
    let faults = figure_sum(&model.fit.programs, VALLEY_FAULTS) as u32;
    let told = &mut *clock.progress;
    model.certificate =
        examiner.certify(&model.fit.demonstrations, faults, seed, &mut || told("random starts"));
    clock.step("certificate");

    let mut warnings = plausibility::warnings(shown);
    warnings.extend(uninformative_frames(skill, demonstrations));
    let span_m = skill.scale.span / set.scales[0];
    warnings.extend(fit_warnings(&model.fit.programs, &model.fit.demonstrations, span_m));
    let samples = demonstrations.iter().map(|d| d.poses.len()).sum();
    Ok(Trained { model, warnings, times: clock.times, samples, choice: None })
}

/// Demonstrations, their mixture, and the policy that is fitted to it.
struct Fitted {
    set: CanonicalSet,
    mixture: TpGmm,
    frames: Vec<FrameMixture>,
    policy: Policy,
    programs: Vec<ProgramFit>,
}

impl Fitted {
    /// `done` is told the name of each step that is done.
    fn new(
        skill: &Skill,
        demonstrations: &[Demonstration],
        seed: u64,
        done: &mut dyn FnMut(&'static str),
    ) -> Result<Self, LearnerError> {
        let set = canonicalise(skill, demonstrations)?;
        done("canonical coordinates");
        let samples = Samples::new(skill, demonstrations, &set);
        let mixture = samples.learn(skill, skill.mixture.components, seed)?;
        done("mixture");
        let frames = mixture.stored_frames(skill, set.scales);
        let (policy, programs) = match &skill.fit {
            FitSettings::Canonical(settings) => {
                let parts = CanonicalParts { skill, settings, mixture: &mixture, set: &set };
                let fitted = parts.fit(seed)?;
                done("fields");
                fitted
            }
            FitSettings::Thesis(settings) => {
                let fitted = thesis::fit(&frames, skill, settings, demonstrations, &set)?;
                done("potential and damping");
                fitted
            }
        };
        Ok(Self { set, mixture, frames, policy, programs })
    }
}

/// Frames and goal as the model file stores them.
fn stored_canonical(
    skill: &Skill,
    demonstrations: &[Demonstration],
    set: &CanonicalSet,
) -> Canonical {
    let map = &set.map;
    let names: Vec<String> =
        frames(skill, &demonstrations[0]).into_iter().map(|(name, _)| name).collect();
    let waypoint = |anchor: &Anchor| Waypoint {
        frame: names[anchor.index].clone(),
        pose: anchor.frame.into(),
        point_m: anchor.point.to_array(),
        phase: anchor.phase,
    };
    let ends = [&skill.start_frame, &skill.goal_frame];
    let ways = map.anchors().iter().filter(|anchor| !ends.contains(&&names[anchor.index]));
    let goal = map.anchors()[map.anchors().len() - 1];
    Canonical {
        start: set.start.into(),
        goal_frame: map.goal_frame().into(),
        goal: map.goal().into(),
        rotate_positions: map.rotate_positions(),
        start_phase: map.anchors()[0].phase.min(goal.phase),
        goal_phase: goal.phase,
        waypoints: ways.map(waypoint).collect(),
        adaptation: map.adaptation().map(Into::into),
    }
}

/// Demonstrations as they are learned from: smoothed by a running mean where the fit asks for it, and
/// with a start frame that is fixed to the goal frame for skills that have no other.
pub fn prepared(skill: &Skill, demonstrations: &[Demonstration]) -> Vec<Demonstration> {
    let mut demonstrations = demonstrations.to_vec();
    if let Some(settings) = skill.fit.kaiser_smoothing() {
        for demonstration in &mut demonstrations {
            let (poses, dt) = (&demonstration.poses, demonstration.sampling_time_s);
            demonstration.poses = kaiser_smoothing(poses, dt, settings);
        }
    }
    if skill.start_frame == skill.goal_frame {
        let start = mean_start(&demonstrations);
        for demonstration in &mut demonstrations {
            demonstration.start = demonstration.goal_frame.compose(&start);
        }
    }
    demonstrations
}

/// Sum over programs of a figure that some of them have.
fn figure_sum(programs: &[ProgramFit], name: &str) -> f64 {
    let all = programs.iter().flat_map(|program| &program.figures);
    all.filter(|(figure, _)| figure == name).map(|(_, value)| value).sum()
}

/// What the canonical policy is fitted from.
struct CanonicalParts<'a> {
    skill: &'a Skill,
    settings: &'a FieldSettings,
    mixture: &'a TpGmm,
    set: &'a CanonicalSet,
}

impl CanonicalParts<'_> {
    /// Fits the fields of position and orientation.
    fn fit(&self, seed: u64) -> Result<(Policy, Vec<ProgramFit>), LearnerError> {
        let manifold = self.skill.manifold;
        let shown = &self.set.demonstrations;
        // Each block has a stream of random numbers of its own, so that they can be fitted at once.
        let random = |stream| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(stream);
            random
        };
        let position = || {
            let part = BlockPart {
                name: "position field",
                paths: shown.iter().map(|d| d.position.clone()).collect(),
                scale: self.set.scales[0],
                goal: self.set.map.goal().position,
                first: 0,
            };
            if manifold.position_dimension() == 2 {
                part.fit::<3>(self, &mut random(0))
            } else {
                part.fit::<4>(self, &mut random(0))
            }
        };
        let orientation = || {
            let part = BlockPart {
                name: "orientation field",
                paths: shown.iter().map(|d| d.rotation.clone()).collect(),
                scale: self.set.scales[1],
                goal: DVec3::ZERO,
                first: manifold.position_dimension(),
            };
            manifold.has_orientation().then(|| part.fit::<4>(self, &mut random(3)))
        };
        let (position, orientation) = rayon::join(position, orientation);
        let (position, figures) = position?;
        let mut programs = vec![figures];
        let orientation = match orientation {
            None => None,
            Some(fitted) => {
                let (field, figures) = fitted?;
                programs.push(figures);
                Some(field)
            }
        };
        Ok((Policy::Canonical { position, orientation }, programs))
    }
}

/// One block of the joint coordinates.
struct BlockPart {
    name: &'static str,
    paths: Vec<Path>,
    /// ŷ = scale · y.
    scale: f64,
    goal: DVec3,
    /// Its first joint coordinate.
    first: usize,
}

impl BlockPart {
    /// Fits the field on the block's coordinates and the phase, N together.
    fn fit<const N: usize>(
        &self,
        parts: &CanonicalParts,
        random: &mut ChaCha8Rng,
    ) -> Result<(FieldModel, ProgramFit), LearnerError> {
        let length = parts.mixture.phase_length;
        let normalised = |y: &DVec3, phase: f64| {
            let block = y.to_array();
            let entry = |i| if i + 1 < N { block[i] * self.scale } else { phase * length };
            SVector::<f64, N>::from_fn(|i, _| entry(i))
        };
        let all = |points: &[DVec3], phases: &[[f64; 3]], derivative: usize| {
            points.iter().zip(phases).map(|(y, s)| normalised(y, s[derivative])).collect()
        };
        let paths: Vec<_> = self
            .paths
            .iter()
            .zip(&parts.set.demonstrations)
            .map(|(path, CanonicalDemonstration { phases, .. })| BlockPath {
                points: all(&path.points, phases, 0),
                velocities: all(&path.velocities, phases, 1),
                accelerations: all(&path.accelerations, phases, 2),
            })
            .collect();
        // The block's rows and columns of the joint Gaussians, and the phase's.
        let gaussians = &parts.mixture.phased;
        let at = |i: usize| {
            if i + 1 < N { self.first + i } else { gaussians[0].mean.len() - 1 }
        };
        let means: Vec<_> =
            gaussians.iter().map(|g| SVector::<f64, N>::from_fn(|i, _| g.mean[at(i)])).collect();
        let covariances: Vec<_> = gaussians
            .iter()
            .map(|g| SMatrix::<f64, N, N>::from_fn(|i, j| g.covariance[(at(i), at(j))]))
            .collect();
        let settings = parts.settings;
        let shape = shape(&means, &covariances, &normalised(&self.goal, 1.0), settings);
        let fitted = fit(self.name, shape, &paths, settings, random)?;
        let (mut field, figures) = fitted.physical(self.scale);
        // Scaled there and back the goal may be a rounding error away.
        let goal = field.components.last_mut().expect("the goal has a component");
        goal.mean = self.goal.to_array()[..N - 1].to_vec();
        goal.mean.push(1.0);
        Ok((field, figures))
    }
}

/// Names the demonstrations without any one of which a program that failed is solved.
fn blaming<T>(
    fitted: Result<T, LearnerError>,
    names: &[&str],
    is_solved_without: impl Fn(usize) -> bool,
) -> Result<T, LearnerError> {
    fitted.map_err(|error| match error {
        LearnerError::NotSolved { program, status, iterations, .. } => {
            let causes = if names.len() == 1 {
                vec![names[0].to_owned()]
            } else {
                let causing = (0..names.len()).filter(|i| is_solved_without(*i));
                causing.map(|i| names[i].to_owned()).collect()
            };
            LearnerError::NotSolved { program, status, iterations, causes }
        }
        other => other,
    })
}

fn fit_warnings(
    programs: &[ProgramFit],
    demonstrations: &[DemonstrationRollout],
    span_m: f64,
) -> Vec<String> {
    let mut warnings = Vec::new();
    for program in programs.iter().filter(|program| program.status != "Solved") {
        warnings.push(format!(
            "the {} was solved to a reduced accuracy only ({})",
            program.name, program.status
        ));
    }
    for row in demonstrations {
        if row.path_rms_m > PATH_FRACTION_MAX * span_m {
            warnings.push(format!(
                "`{}` is left by {:.1} mm (rms) where {span_m:.2} m are spanned: does it \
                 contradict the others?",
                row.name,
                row.path_rms_m * 1e3
            ));
        }
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demonstration_without_which_a_program_is_solved_is_named() {
        let failed = || -> Result<(), LearnerError> {
            let (program, status) = ("potential", "NumericalError".into());
            Err(LearnerError::NotSolved { program, status, iterations: 7, causes: Vec::new() })
        };
        let names = ["01.json", "02.json", "03.json"];
        let told = |solved_without: &[usize]| {
            let blamed = blaming(failed(), &names, |i| solved_without.contains(&i));
            blamed.unwrap_err().to_string()
        };
        let one = told(&[1]);
        assert!(one.contains("`02.json` causes it") && one.contains("potential"), "{one}");
        let several = told(&[0, 2]);
        assert!(several.contains("`01.json`, `03.json`"), "{several}");
        assert!(told(&[]).contains("no single demonstration"));
        // The only one is to blame, and is not left out.
        let only = blaming(failed(), &names[..1], |_| unreachable!("nothing is left"));
        assert!(only.unwrap_err().to_string().contains("`01.json` causes it"));
        assert!(blaming(Ok(()), &names, |_| false).is_ok());
    }
}
