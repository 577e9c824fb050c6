//! The whole way from demonstrations to a model.

use std::path::Path as FilePath;
use std::time::{Duration, Instant};

use glam::DVec3;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tprmp_model::skill_model::{
    FieldFit, FieldModel, Fit, Gaussian, Provenance, Rollouts, SkillModel, Source,
};

use crate::canonical::{CanonicalSet, canonicalise};
use crate::components::{self, Choice, Components};
use crate::demonstration::{self, Demonstration};
use crate::em::{Mixture, PhaseSamples, maximise, phase_samples};
use crate::error::LearnerError;
use crate::fit::{fit, shape};
use crate::k_means;
use crate::plausibility;
use crate::savitzky_golay::Path;
use crate::skill::{Initialisation, Skill};
use crate::targets::BlockPath;
use crate::verify::Verifier;

/// Fewest samples a component must hold on average.
pub(crate) const SAMPLES_PER_COMPONENT_MIN: usize = 3;
/// A demonstration is warned of when it is left by more than this share of the skill's span.
const PATH_SHARE_MAX: f64 = 0.05;
/// A component with a smaller prior holds no samples.
pub(crate) const PRIOR_MIN: f64 = 1e-6;

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

/// Learns a model from demonstrations.
///
/// # Errors
/// [`LearnerError`]: the demonstrations cannot be learned from, a convex program is not solved, or
/// a demonstrated start does not reach the goal.
///
/// # Panics
/// When there is no demonstration.
pub fn learn(
    skill: &Skill,
    demonstrations: &[Demonstration],
    seed: u64,
    progress: &mut dyn FnMut(&str),
) -> Result<Trained, LearnerError> {
    let mut clock = Clock { since: Instant::now(), times: Vec::new(), progress };
    let set = canonicalise(demonstrations, &skill.smoothing, &skill.scale)?;
    clock.step("canonical coordinates");

    let dimension = skill.manifold.position_dimension();
    let has_orientation = skill.manifold.has_orientation();
    let paths = |rotation: bool| -> Vec<&Path> {
        set.demonstrations
            .iter()
            .map(|d| if rotation { &d.rotation } else { &d.position })
            .collect()
    };
    let scales = set.scales;
    let (mixture, phase_length) = mixture(skill, &set, seed)?;
    clock.step("mixture");

    let field = |block, first, random: &mut ChaCha8Rng| {
        let rotation = first > 0;
        let scale = scales[usize::from(rotation)];
        let goal = if rotation { DVec3::ZERO } else { set.map.canonical().goal.position };
        let part = BlockPart { block, paths: paths(rotation), scale, goal, first };
        if !rotation && dimension == 2 {
            part.fit::<2>(skill, &mixture, random)
        } else {
            part.fit::<3>(skill, &mixture, random)
        }
    };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (position, position_fit) = field("position", 0, &mut random)?;
    clock.step("position field");
    let mut orientation = None;
    if has_orientation {
        orientation = Some(field("orientation", dimension, &mut random)?);
        clock.step("orientation field");
    }
    let (orientation, orientation_fit) = orientation.unzip();

    let verifier = Verifier::new(&set.map, &position, orientation.as_ref(), &skill.verification);
    let radii = scales.map(|s| skill.verification.random_start_radius / s);
    let told = &mut *clock.progress;
    let rollouts =
        verifier.verify(demonstrations, &set, radii, &mut random, &mut || told("rollout"))?;
    clock.step("rollouts");

    let fits: Vec<_> = std::iter::once(("position", &position_fit))
        .chain(orientation_fit.as_ref().map(|fit| ("orientation", fit)))
        .collect();
    let mut warnings = warnings(&fits, &rollouts, skill.scale.span / scales[0]);
    warnings.extend(plausibility::warnings(demonstrations));
    let model = SkillModel {
        skill: skill.skill.clone(),
        manifold: skill.manifold,
        tool_frame: skill.tool_frame.clone(),
        start_frame: skill.start_frame.clone(),
        goal_frame: skill.goal_frame.clone(),
        canonical: (*set.map.canonical()).into(),
        gaussians: gaussians(skill, &mixture, phase_length, scales),
        fit: Fit {
            em_iterations: skill.mixture.iterations,
            em_log_likelihood: mixture.log_likelihoods[mixture.log_likelihoods.len() - 1],
            position: position_fit,
            orientation: orientation_fit,
            rollouts,
        },
        position,
        orientation,
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
    let samples = demonstrations.iter().map(|d| d.poses.len()).sum();
    Ok(Trained { model, warnings, times: clock.times, samples, choice: None })
}

/// The demonstrations in normalised position ⊕ orientation, without the phase.
pub(crate) fn joint_paths(skill: &Skill, set: &CanonicalSet) -> Vec<Vec<DVector<f64>>> {
    let dimension = skill.manifold.position_dimension();
    set.demonstrations
        .iter()
        .map(|d| {
            let pairs = d.position.points.iter().zip(&d.rotation.points);
            let joined = pairs.map(|(position, rotation)| {
                let position = position.to_array().map(|x| x * set.scales[0]);
                let rotation = rotation.to_array().map(|x| x * set.scales[1]);
                let all = position[..dimension].iter().chain(&rotation).copied();
                DVector::from_iterator(
                    skill.manifold.dimension(),
                    all.take(skill.manifold.dimension()),
                )
            });
            joined.collect()
        })
        .collect()
}

/// Samples with their phase and `components` pieces to start from.
pub(crate) fn initialised(
    joint: &[Vec<DVector<f64>>],
    components: usize,
    initialisation: Initialisation,
    seed: u64,
) -> PhaseSamples {
    let mut data = phase_samples(joint, components);
    if initialisation == Initialisation::KMeans {
        // A stream of its own: the random points of the fit stay what they are.
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(1);
        data.responsibilities = k_means::responsibilities(&data.samples, components, &mut random);
    }
    data
}

/// The mixture over normalised position ⊕ orientation, and the length that phase one stands for.
fn mixture(skill: &Skill, set: &CanonicalSet, seed: u64) -> Result<(Mixture, f64), LearnerError> {
    let joint = joint_paths(skill, set);
    let components = skill.mixture.components;
    let samples: usize = joint.iter().map(Vec::len).sum();
    let too_many = |problem: String| LearnerError::Mixture { components, problem };
    if samples < SAMPLES_PER_COMPONENT_MIN * components {
        return Err(too_many(format!("the demonstrations have only {samples} samples together")));
    }
    let data = initialised(&joint, components, skill.mixture.initialisation, seed);
    let mixture = maximise(&data, skill.mixture.iterations, skill.mixture.regularisation);
    if let Some(k) = mixture.priors.iter().position(|prior| *prior < PRIOR_MIN) {
        return Err(too_many(format!("component {} holds no samples", k + 1)));
    }
    Ok((mixture, data.length))
}

/// One block of the joint coordinates.
struct BlockPart<'a> {
    block: &'static str,
    paths: Vec<&'a Path>,
    /// ŷ = scale · y.
    scale: f64,
    goal: DVec3,
    /// Its first joint coordinate.
    first: usize,
}

impl BlockPart<'_> {
    fn fit<const D: usize>(
        &self,
        skill: &Skill,
        mixture: &Mixture,
        random: &mut ChaCha8Rng,
    ) -> Result<(FieldModel, FieldFit), LearnerError> {
        // The mixture's first coordinate is the phase.
        let at = 1 + self.first;
        let normalised =
            |y: &DVec3| SVector::<f64, D>::from_fn(|i, _| y.to_array()[i] * self.scale);
        let all = |points: &[DVec3]| points.iter().map(normalised).collect();
        let paths: Vec<_> = self
            .paths
            .iter()
            .map(|path| BlockPath {
                points: all(&path.points),
                velocities: all(&path.velocities),
                accelerations: all(&path.accelerations),
            })
            .collect();
        let means: Vec<_> =
            mixture.means.iter().map(|m| SVector::<f64, D>::from_fn(|i, _| m[at + i])).collect();
        let covariances: Vec<_> = mixture
            .covariances
            .iter()
            .map(|c| SMatrix::<f64, D, D>::from_fn(|i, j| c[(at + i, at + j)]))
            .collect();
        let shape = shape(&means, &covariances, &normalised(&self.goal), &skill.field);
        let fitted = fit(self.block, shape, &paths, &skill.field, random)?;
        let (mut field, figures) = fitted.physical(self.scale);
        // Scaled there and back the goal may be a rounding error away.
        let goal = field.components.last_mut().expect("the goal has a component");
        goal.mean = self.goal.to_array()[..D].to_vec();
        Ok((field, figures))
    }
}

/// The mixture in physical coordinates, without its phase and with its regularisation.
fn gaussians(
    skill: &Skill,
    mixture: &Mixture,
    phase_length: f64,
    scales: [f64; 2],
) -> Vec<Gaussian> {
    let n = skill.manifold.dimension();
    let position = skill.manifold.position_dimension();
    let scale = |i: usize| scales[usize::from(i >= position)];
    let parts = mixture.priors.iter().zip(&mixture.means).zip(&mixture.covariances);
    parts
        .map(|((prior, mean), covariance)| {
            let regular =
                covariance + DMatrix::identity(n + 1, n + 1) * skill.mixture.regularisation;
            let entry = |i: usize, j: usize| regular[(i + 1, j + 1)] / (scale(i) * scale(j));
            Gaussian {
                prior: *prior,
                phase: mean[0] / phase_length,
                mean: (0..n).map(|i| mean[i + 1] / scale(i)).collect(),
                covariance: (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect(),
            }
        })
        .collect()
}

fn warnings(fits: &[(&str, &FieldFit)], rollouts: &Rollouts, span_m: f64) -> Vec<String> {
    let mut warnings = Vec::new();
    for (block, fit) in fits {
        if fit.status != "Solved" {
            warnings.push(format!(
                "the {block} field was solved to a reduced accuracy only ({})",
                fit.status
            ));
        }
    }
    for (block, fit) in fits.iter().filter(|(_, fit)| fit.stray_attractors > 0) {
        let count = fit.stray_attractors;
        warnings.push(format!("the {block} field keeps {count} attractors besides the goal"));
    }
    for row in &rollouts.demonstrations {
        if row.path_rms_m > PATH_SHARE_MAX * span_m {
            warnings.push(format!(
                "`{}` is left by {:.1} mm (rms) where {span_m:.2} m are spanned: does it \
                 contradict the others?",
                row.name,
                row.path_rms_m * 1e3
            ));
        }
    }
    let missed = rollouts.random_starts - rollouts.random_starts_reached;
    if missed > 0 {
        let starts = rollouts.random_starts;
        warnings.push(format!(
            "{missed} of {starts} random starts around the demonstrations do not reach the goal"
        ));
    }
    warnings
}
