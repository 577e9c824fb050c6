//! The task-parameterised Gaussian mixture of a skill: what its demonstrations have in common, seen
//! from each frame and in canonical coordinates  [thesis section 3.4].

use glam::{DQuat, DVec3};
use nalgebra::{DMatrix, DVector, Matrix};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tprmp_model::skill_model;
use tprmp_spatial::Pose;

use crate::canonical::{CanonicalDemonstration, CanonicalSet};
use crate::demonstration::Demonstration;
use crate::mixture::expectation_maximisation::{
    Data, Maximised, Settings, Topology, in_order, maximise, mean_times,
};
use crate::mixture::k_means;
use crate::mixture::view::{Gaussian, Singular, View};
use crate::skill::{Initialisation, MixtureModel, Skill};

/// Fewest samples a component must hold on average: fewer are a plane at best, and no covariance.
const SAMPLES_PER_COMPONENT_MIN: usize = 3;
/// A component with a smaller prior holds no samples.
const PRIOR_MIN: f64 = 1e-6;
/// Frames are fixed to each other when they are so to this distance [m] …
const SAME_PLACE_M: f64 = 1e-6;
/// … and this angle [rad].
const SAME_ROTATION_RAD: f64 = 1e-6;

/// All samples of a skill, in every coordinate system in which they are looked at.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Canonical position ⊕ rotation vector, normalised.
    canonical: View,
    /// Names of the frames, and the samples seen from them, normalised.
    frames: Vec<(String, View)>,
    /// The samples of each demonstration.
    sequences: Vec<std::ops::Range<usize>>,
    /// Time of each sample as a fraction of its demonstration's.
    times: Vec<f64>,
    /// Length of each demonstration up to each sample, as a fraction of its whole length.
    lengths: Vec<f64>,
    /// Phase of each sample.
    phases: Vec<f64>,
    /// Mean length of the canonical paths: what time and phase are multiplied by where they are a
    /// coordinate.
    mean_length: f64,
}

/// A task-parameterised Gaussian mixture in normalised coordinates.
#[derive(Clone, Debug)]
pub struct TpGmm {
    /// Fraction of the samples of each component.
    pub priors: Vec<f64>,
    /// Mean time of each component, as a fraction of the demonstrations'.
    pub phases: Vec<f64>,
    /// Gaussians in canonical coordinates.
    pub canonical: Vec<Gaussian>,
    /// The same in canonical coordinates and the phase, times [`TpGmm::phase_length`], as the last one.
    pub phased: Vec<Gaussian>,
    /// Length that the phase stands for: the mean of the canonical paths'.
    pub phase_length: f64,
    /// Gaussians seen from each frame.
    pub frames: Vec<(String, Vec<Gaussian>)>,
    /// Mean log-likelihood of a sample after each iteration \[nat\].
    pub log_likelihoods: Vec<f64>,
    /// Free parameters of the model.
    pub parameters: usize,
}

/// Why there is no mixture.
#[derive(Debug, thiserror::Error)]
pub enum MixtureError {
    /// It has more components than the demonstrations can fill.
    #[error(
        "the mixture has too many components: {problem}, but key `mixture.components` asks for \
         {components}"
    )]
    TooMany {
        /// Components that were asked for.
        components: usize,
        /// What is wrong.
        problem: String,
    },
    /// A covariance cannot be inverted.
    #[error(
        "a covariance of the mixture is not positive definite: raise key `mixture.regularisation`, \
         found {regularisation:e}, or look for demonstrations with positions of another size"
    )]
    Singular {
        /// The setting.
        regularisation: f64,
    },
}

impl Samples {
    /// The samples of aligned demonstrations.
    ///
    /// # Panics
    /// When a path has no length, or a demonstration not the frames of the skill.
    #[must_use]
    pub fn new(skill: &Skill, demonstrations: &[Demonstration], set: &CanonicalSet) -> Self {
        let count = skill.named_frames(&demonstrations[0]).count();
        let frames = (0..count).map(|p| frame_view(skill, demonstrations, set.scales, p)).collect();
        let times = set.demonstrations.iter().flat_map(|d| &d.times).copied().collect();
        let phases = set.demonstrations.iter().flat_map(|d| &d.phases).map(|phase| phase[0]);
        Self { frames, ..Self::canonical(&joint_paths(skill, set), times, phases.collect()) }
    }

    /// The samples of paths in canonical coordinates alone, seen from no frame, with the fraction of the
    /// time and the phase of each.
    ///
    /// # Panics
    /// When there is no path, or one has no length.
    #[must_use]
    pub fn canonical(joint: &[Vec<DVector<f64>>], times: Vec<f64>, phases: Vec<f64>) -> Self {
        let (mut sequences, mut lengths) = (Vec::new(), Vec::new());
        let mut whole = 0.0;
        for path in joint {
            let first = lengths.len();
            let arc = arc_lengths(path);
            let length = arc[path.len() - 1];
            assert!(length > 0.0, "a path has a length");
            whole += length;
            lengths.extend(arc.iter().map(|arc| arc / length));
            sequences.push(first..lengths.len());
        }
        let columns: Vec<DVector<f64>> = joint.iter().flatten().cloned().collect();
        let euclidean = DMatrix::from_columns(&columns);
        let canonical = View::euclidean(euclidean);
        let mean_length = whole / joint.len() as f64;
        Self { canonical, frames: Vec::new(), sequences, times, lengths, phases, mean_length }
    }

    /// How many.
    #[must_use]
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// Most components they can fill.
    #[must_use]
    pub fn components_max(&self) -> usize {
        self.len() / SAMPLES_PER_COMPONENT_MIN
    }

    /// Canonical coordinates behind the time, which is stretched to the length of the path.
    fn time_driven(&self) -> View {
        let times = DMatrix::from_fn(1, self.len(), |_, i| self.times[i] * self.mean_length);
        let n = self.canonical.euclidean.nrows();
        let mut euclidean = DMatrix::zeros(n + 1, self.len());
        euclidean.rows_mut(0, 1).copy_from(&times);
        euclidean.rows_mut(1, n).copy_from(&self.canonical.euclidean);
        View::euclidean(euclidean)
    }

    /// Canonical coordinates before the phase, which is stretched to the length of the path.
    fn phased(&self) -> View {
        let n = self.canonical.euclidean.nrows();
        let mut euclidean = self.canonical.euclidean.clone().insert_row(n, 0.0);
        for (entry, phase) in euclidean.row_mut(n).iter_mut().zip(&self.phases) {
            *entry = phase * self.mean_length;
        }
        View::euclidean(euclidean)
    }

    /// Responsibilities to start from.
    fn initial(
        &self,
        components: usize,
        initialisation: Initialisation,
        seed: u64,
    ) -> DMatrix<f64> {
        let pieces = |fractions: &[f64]| {
            DMatrix::from_fn(self.len(), components, |i, k| {
                let piece = (fractions[i] * components as f64) as usize;
                if piece.min(components - 1) == k { 1.0 } else { 0.0 }
            })
        };
        match initialisation {
            Initialisation::ArcLength => pieces(&self.lengths),
            Initialisation::EqualTime => pieces(&self.times),
            Initialisation::KMeans => {
                // A stream of its own: the random points of the fit stay what they are.
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                random.set_stream(1);
                let view = self.time_driven();
                let samples: Vec<DVector<f64>> =
                    view.euclidean.column_iter().map(Matrix::into_owned).collect();
                let found = k_means::responsibilities(&samples, components, &mut random);
                in_order(&found, &mean_times(&found, &self.times))
            }
        }
    }

    /// Learns a mixture of `components` Gaussians.
    ///
    /// # Errors
    /// What is wrong, and how many components fit, when the samples cannot fill them.
    pub fn learn(
        &self,
        skill: &Skill,
        components: usize,
        seed: u64,
    ) -> Result<TpGmm, MixtureError> {
        let found = if components > self.components_max() {
            let problem = format!("the demonstrations have only {} samples together", self.len());
            Err(MixtureError::TooMany { components, problem })
        } else {
            self.learn_exactly(skill, components, seed)
        };
        found.map_err(|error| match error {
            MixtureError::TooMany { problem, .. } => {
                let fits = |k: &usize| self.learn_exactly(skill, *k, seed).is_ok();
                let most = (1..components.min(self.components_max() + 1)).rev().find(fits);
                let most = most.map_or("none fits".to_owned(), |most| format!("{most} fit"));
                MixtureError::TooMany { components, problem: format!("{problem}, {most}") }
            }
            other => other,
        })
    }

    /// The same, of no more than [`Samples::components_max`], without a search for how many would fit: where many numbers
    /// are tried.
    ///
    /// # Errors
    /// What is wrong.
    pub(crate) fn learn_exactly(
        &self,
        skill: &Skill,
        components: usize,
        seed: u64,
    ) -> Result<TpGmm, MixtureError> {
        let too_many = |problem: String| MixtureError::TooMany { components, problem };
        let settings = &skill.mixture;
        let responsibilities = self.initial(components, settings.initialisation, seed);
        let frames = || self.frames.iter().map(|(_, view)| view.clone()).collect();
        let (views, topology) = match settings.model {
            MixtureModel::TpGmm => (frames(), Topology::Mixture),
            MixtureModel::TpLeftRightHmm => (frames(), Topology::LeftRight),
            MixtureModel::TimeDrivenGmm => (vec![self.time_driven()], Topology::Mixture),
        };
        // Means and covariances of each view, and priors or probabilities of staying.
        let each = |view: &View| view.dimension() + view.dimension() * (view.dimension() + 1) / 2;
        let parameters = components - 1 + components * views.iter().map(each).sum::<usize>();
        let data = Data {
            views,
            sequences: self.sequences.clone(),
            times: self.times.clone(),
            responsibilities,
        };
        let maximised = maximise(
            &data,
            &Settings {
                topology,
                iterations: settings.iterations,
                regularisation: settings.regularisation,
                ordering: settings.ordering,
            },
        )
        .map_err(|Singular| MixtureError::Singular { regularisation: settings.regularisation })?;
        let Maximised { responsibilities, priors, log_likelihoods, .. } = maximised;
        if let Some(k) = priors.iter().position(|prior| *prior < PRIOR_MIN) {
            return Err(too_many(format!("component {} holds no samples", k + 1)));
        }
        let scaled = |view: &View| -> Vec<Gaussian> {
            let mut all = view.gaussians(&responsibilities);
            all.iter_mut().for_each(|g| g.covariance *= settings.covariance_scale);
            all
        };
        Ok(TpGmm {
            priors,
            phases: mean_times(&responsibilities, &self.phases),
            canonical: scaled(&self.canonical),
            phased: scaled(&self.phased()),
            phase_length: self.mean_length,
            frames: self.frames.iter().map(|(name, view)| (name.clone(), scaled(view))).collect(),
            log_likelihoods,
            parameters,
        })
    }
}

/// The demonstrations in normalised position ⊕ orientation.
fn joint_paths(skill: &Skill, set: &CanonicalSet) -> Vec<Vec<DVector<f64>>> {
    let (n, dimension) = (skill.manifold.position_dimension(), skill.manifold.dimension());
    let joined = |(position, rotation): (&DVec3, &DVec3)| {
        let position = position.to_array().map(|x| x * set.scales[0]);
        let rotation = rotation.to_array().map(|x| x * set.scales[1]);
        let all = position[..n].iter().chain(&rotation).copied();
        DVector::from_iterator(dimension, all.take(dimension))
    };
    let path = |d: &CanonicalDemonstration| -> Vec<DVector<f64>> {
        d.position.points.iter().zip(&d.rotation.points).map(joined).collect()
    };
    set.demonstrations.iter().map(path).collect()
}

fn arc_lengths(path: &[DVector<f64>]) -> Vec<f64> {
    let mut arc = vec![0.0];
    for pair in path.windows(2) {
        arc.push(arc[arc.len() - 1] + (&pair[1] - &pair[0]).norm());
    }
    arc
}

/// The demonstrated poses seen from frame p  [thesis eq. 3.3].
fn frame_view(
    skill: &Skill,
    demonstrations: &[Demonstration],
    scales: [f64; 2],
    p: usize,
) -> (String, View) {
    let (mut positions, mut orientations): (Vec<DVec3>, Vec<DQuat>) = (Vec::new(), Vec::new());
    for demonstration in demonstrations {
        let from_frame = skill.frames(demonstration)[p].inverse();
        for pose in &demonstration.poses {
            let seen = from_frame.compose(pose);
            positions.push(seen.position);
            orientations.push(seen.orientation);
        }
    }
    let orientations = skill.manifold.has_orientation().then_some((orientations, scales[1]));
    let view =
        View::poses(&positions, skill.manifold.position_dimension(), scales[0], orientations);
    let name = skill.named_frames(&demonstrations[0]).nth(p).expect("p is one of the frames").0;
    (name.into(), view)
}

/// A Gaussian in physical coordinates, with the regularisation and in axes of the mean.
fn physical(skill: &Skill, gaussian: &Gaussian, scales: [f64; 2]) -> (Vec<f64>, Vec<Vec<f64>>) {
    let n = skill.manifold.dimension();
    let scale = |i: usize| scales[usize::from(i >= skill.manifold.position_dimension())];
    let regularisation = skill.mixture.regularisation * skill.mixture.covariance_scale;
    let regular = &gaussian.covariance + DMatrix::identity(n, n) * regularisation;
    let entry = |i: usize, j: usize| regular[(i, j)] / (scale(i) * scale(j));
    let mean = gaussian.mean.iter().enumerate().map(|(i, x)| x / scale(i)).collect();
    (mean, (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect())
}

impl TpGmm {
    /// The Gaussians in canonical coordinates, as the model file stores them.
    #[must_use]
    pub fn stored_canonical(&self, skill: &Skill, scales: [f64; 2]) -> Vec<skill_model::Gaussian> {
        let stored = |(k, gaussian): (usize, &Gaussian)| {
            let (mean, covariance) = physical(skill, gaussian, scales);
            let (prior, phase) = (self.priors[k], self.phases[k]);
            skill_model::Gaussian { prior, phase, mean, covariance }
        };
        self.canonical.iter().enumerate().map(stored).collect()
    }

    /// The Gaussians seen from the frames, as the model file stores them.
    #[must_use]
    pub fn stored_frames(&self, skill: &Skill, scales: [f64; 2]) -> Vec<skill_model::FrameMixture> {
        let stored = |gaussian: &Gaussian| {
            let (position_m, covariance) = physical(skill, gaussian, scales);
            let quaternion_wxyz = gaussian.orientation.map(|q| [q.w, q.x, q.y, q.z]);
            skill_model::FrameGaussian { position_m, quaternion_wxyz, covariance }
        };
        self.frames
            .iter()
            .map(|(name, gaussians)| skill_model::FrameMixture {
                name: name.clone(),
                gaussians: gaussians.iter().map(stored).collect(),
                agreement: Vec::new(),
                agreement_fraction: None,
            })
            .collect()
    }
}

/// What the user should know about the frames: those that are fixed to each other in all
/// demonstrations cannot be told apart by them. Their covariances are equal, so that a product of
/// Gaussians (eq. 3.6) moves by the mean of their displacements.
#[must_use]
pub fn uninformative_frames(skill: &Skill, demonstrations: &[Demonstration]) -> Vec<String> {
    let all: Vec<Vec<Pose>> = demonstrations.iter().map(|d| skill.frames(d)).collect();
    let names: Vec<&str> = skill.named_frames(&demonstrations[0]).map(|(name, _)| name).collect();
    let relative = |frames: &[Pose], p: usize, q: usize| frames[p].inverse().compose(&frames[q]);
    // Frames fixed to one another form groups; each is reported once, with its first member.
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for q in 0..names.len() {
        let fixed_to = |p: usize| {
            let first = relative(&all[0], p, q);
            all.iter().all(|frames| {
                let other = relative(frames, p, q);
                (other.position - first.position).length() < SAME_PLACE_M
                    && other.rotation_from(&first).length() < SAME_ROTATION_RAD
            })
        };
        match groups.iter_mut().find(|group| fixed_to(group[0])) {
            Some(group) => group.push(q),
            None => groups.push(vec![q]),
        }
    }
    let together = groups.iter().filter(|group| group.len() > 1);
    together
        .map(|group| {
            let quoted: Vec<_> = group.iter().map(|p| format!("`{}`", names[*p])).collect();
            let how_many = match demonstrations.len() {
                1 => "in the only demonstration".to_owned(),
                count => format!("in all {count} demonstrations"),
            };
            format!(
                "the frames {} lie the same way to each other {how_many}: their covariances carry \
                 no information about which of them a motion belongs to. A product of Gaussians \
                 (the thesis' policy) moves by 1/{} of the displacement of one of them; the \
                 canonical policy starts at `{}` and ends at `{}` by definition. Demonstrate the \
                 skill with frames that differ",
                quoted.join(" and "),
                group.len(),
                skill.start_frame,
                skill.goal_frame,
            )
        })
        .collect()
}
