//! Skill files: what to learn, and every number the learning depends on.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tprmp_model::renamed_keys;
use tprmp_model::skill_model::{FRAME_CAPACITY, Manifold};
use tprmp_rmpflow::policy::canonical::field::COMPONENT_CAPACITY;
use tprmp_spatial::Pose;

use crate::demonstration::{DURATION_MAX_S, Demonstration};
use crate::file_error::{FileError, read_text};

/// Schema version this module reads.
pub const SCHEMA: &str = "tprmp-skill/3";
/// Largest shape of a running mean's window.
const SHAPE_MAX: f64 = 100.0;
/// Most steps of a rollout of the certificate.
const ROLLOUT_STEPS_MAX: f64 = 1e6;

/// A skill to be learned. There are no defaults: what is missing is an error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Skill {
    /// Schema version.
    pub schema: String,
    /// Name of the skill, as in its demonstrations.
    pub skill: String,
    /// Space in which it moves.
    pub manifold: Manifold,
    /// Frame of the robot that moves.
    pub tool_frame: String,
    /// Frame at which the skill starts.
    pub start_frame: String,
    /// Frame to which the goal is fixed; the start frame when there is no other.
    pub goal_frame: String,
    /// Further frames whose Gaussians are learned.
    pub other_frames: Vec<String>,
    /// Folder of demonstrations, relative to the skill file.
    pub demonstrations: PathBuf,
    /// Smoothing of the demonstrations.
    pub smoothing: Smoothing,
    /// Lengths in which the field is fitted.
    pub scale: Scale,
    /// Gaussian mixture.
    pub mixture: Mixture,
    /// The policy that is fitted, by name, and its settings.
    pub fit: FitSettings,
    /// What the fitted policy is examined for.
    pub certification: Certification,
}

/// Which policy is fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum FitSettings {
    /// One field in canonical coordinates, on which frames act as a map of the space.
    Canonical(FieldSettings),
    /// The thesis' policy: a product of Gaussians, Huber potentials, damping by energy.
    Thesis(ThesisSettings),
}

impl FitSettings {
    /// What the demonstrations are smoothed by before anything else.
    #[must_use]
    pub fn kaiser_smoothing(&self) -> Option<KaiserSmoothing> {
        match self {
            Self::Canonical(_) => None,
            Self::Thesis(settings) => settings.kaiser_smoothing,
        }
    }
}

/// Savitzky–Golay smoothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Smoothing {
    /// Length of the window [s].
    pub window_s: f64,
    /// Degree of the polynomial.
    pub degree: usize,
    /// Fraction of the largest speed below which the start and the end count as rest, and are cut.
    pub rest_speed_fraction: f64,
}

/// Each block is fitted in coordinates ŷ = s y in which the demonstrations have a given span
/// (diagonal of their bounding box along the axes of the goal frame), because all lengths of
/// [`FieldSettings`] refer to it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scale {
    /// Span of the demonstrations in ŷ.
    pub span: f64,
    /// A smaller span of the positions is taken as this [m].
    pub position_span_min_m: f64,
    /// A smaller span of the orientations is taken as this [rad].
    pub orientation_span_min_rad: f64,
}

/// Expectation maximisation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mixture {
    /// What the samples are taken to be drawn from.
    pub model: MixtureModel,
    /// Gaussians K, without the goal's component.
    pub components: usize,
    /// Where the iterations start.
    pub initialisation: Initialisation,
    /// How the components are put in order.
    pub ordering: Ordering,
    /// Most iterations; fewer when the likelihood changes no more.
    pub iterations: u32,
    /// Added to the covariances' diagonal in each iteration [ŷ²].
    pub regularisation: f64,
    /// Factor on the covariances after the last iteration.
    pub covariance_scale: f64,
}

/// What the samples are taken to be drawn from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MixtureModel {
    /// Task-parameterised Gaussian mixture: samples in all frames, without their order in time
    /// [thesis eq. 3.4–3.5].
    TpGmm,
    /// Task-parameterised left–right hidden Markov model: the same Gaussians as states that are
    /// passed in order, none left out.
    TpLeftRightHmm,
    /// Time-driven Gaussian mixture: the time is a coordinate beside the canonical ones.
    TimeDrivenGmm,
}

/// How the components are put in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Ordering {
    /// By the mean time of their samples after the last iteration.
    MeanTime,
    /// As they were initialised.
    Initial,
}

/// Where expectation maximisation starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Initialisation {
    /// Each path is cut into K pieces of equal arc length.
    ArcLength,
    /// Each path is cut into K pieces of equal time.
    EqualTime,
    /// Clusters of (phase, coordinates) by k-means, from seeded centres.
    KMeans,
}

/// Field of a block. Lengths are in ŷ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldSettings {
    /// Damping d in B = d M [1/s].
    pub damping_1_s: f64,
    /// σ₀: M_k = γ (C_k + σ₀² I)⁻¹ [ŷ].
    pub activation_width: f64,
    /// Width over which components pass into each other, as a fraction of the phase between two of them.
    pub phase_overlap: f64,
    /// Weight of the phase's acceleration in the residual against the others'.
    pub phase_weight: f64,
    /// γ in M_k.
    pub metric_scale: f64,
    /// Offsets of the tube points from the demonstrations [ŷ].
    pub tube_offsets: Vec<f64>,
    /// Every how many samples there are tube points.
    pub tube_stride: usize,
    /// Weight of all tube points together.
    pub tube_weight: f64,
    /// Speed towards the demonstration per offset [1/s].
    pub tube_attraction_1_s: f64,
    /// Slower samples show no direction [ŷ/s].
    pub tube_speed_min: f64,
    /// ρ: weight of the demanded descent.
    pub descent_weight: f64,
    /// ε: speed of descent demanded along the demonstrations [ŷ/s].
    pub descent_speed: f64,
    /// Distance to the goal below which the demanded speed falls [ŷ].
    pub descent_slowdown: f64,
    /// Distance over which the demanded direction bends towards the demonstration [ŷ].
    pub descent_attraction: f64,
    /// Distance within which the demanded direction is the goal's [ŷ].
    pub descent_goal_radius: f64,
    /// Every how many samples descent is demanded.
    pub descent_stride: usize,
    /// Seeded random points at which descent is demanded besides.
    pub descent_points_random: usize,
    /// How often the fit may be solved again with louder demands where its valley does not fall.
    pub refinement_rounds_max: usize,
    /// How far in each coordinate they lie from the demonstrations [ŷ].
    pub descent_radius: f64,
    /// How far in the phase, times its length [ŷ].
    pub descent_phase_radius: f64,
    /// Least stiffness of each component across the way, relative to its metric [1/s²].
    pub stiffness_min_1_s2: f64,
    /// Least Hessian at the goal, relative to the metric [1/s²].
    pub goal_hessian_min_1_s2: f64,
    /// λ: weight of ‖C p‖².
    pub regularisation: f64,
    /// Length at which the parameters are compared by C [ŷ].
    pub regularisation_length: f64,
}

/// The thesis' policy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThesisSettings {
    /// γ: M = γ Σ w̃_k Σ̂_k⁻¹ [thesis eq. 4.5].
    pub metric_scale: f64,
    /// δ: distance in standard deviations at which the potential goes from square to cone
    /// [thesis eq. 4.11].
    pub huber_threshold: f64,
    /// ε: least damping coefficient [thesis eq. 4.21].
    pub damping_min: f64,
    /// What the dissipated energy is compared with.
    pub damping_target: DampingTarget,
    /// Every how many samples of a demonstration enter the fits.
    pub stride: usize,
    /// How the demonstrations are smoothed before anything else: the model, its rollouts and its
    /// certificate are of the smoothed ones. The mixture and both fits then take points as they are and
    /// velocities as differences of neighbours. `None`: the fits are smoothed as `smoothing` says.
    #[serde(deserialize_with = "Option::deserialize")]
    pub kaiser_smoothing: Option<KaiserSmoothing>,
}

/// A running mean with a Kaiser window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KaiserSmoothing {
    /// Length of the window [s].
    pub window_s: f64,
    /// β: the larger, the narrower the window.
    pub shape: f64,
}

/// What the dissipated energy is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DampingTarget {
    /// The whole energy at the start, once a demonstration [thesis eq. 4.20]: as many equations as
    /// demonstrations.
    TotalEnergy,
    /// The energy lost since the start, at each sample.
    EnergyProfile,
}

/// What a fitted policy is examined for; what it fails stands in its model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certification {
    /// Longest rollout [s].
    pub horizon_s: f64,
    /// Step of the rollouts from random starts, that of a slow controller [s].
    pub step_s: f64,
    /// Random starts with the frames of the demonstrations.
    pub random_starts: u32,
    /// Random starts with displaced frames.
    pub displaced_starts: u32,
    /// Radius around the demonstrated points in which they lie [ŷ].
    pub random_start_radius: f64,
    /// How far frames are displaced, as a fraction of the distance between start frame and goal.
    pub frame_translation_fraction: f64,
    /// How far frames are turned [rad].
    pub frame_rotation_rad: f64,
    /// Largest rise of the energy in a step, relative to that at the start.
    pub energy_rise_max: f64,
    /// A rollout reached the goal when it ends this near [m].
    pub goal_tolerance_m: f64,
    /// … and this near [rad].
    pub goal_tolerance_rad: f64,
}

impl Skill {
    /// Reads and validates a skill file.
    ///
    /// # Errors
    /// [`FileError`], naming the file and the key or line: missing, not RON, a key of the last
    /// version, an unknown or missing key, or a value outside its range.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text = read_text(path)?;
        if let Some(key) = renamed_keys(&text).first() {
            return Err(FileError::syntax(path, key.line, key.column, key.to_string()));
        }
        // `fit: Canonical(damping_1_s: …)` instead of two pairs of parentheses.
        let options = ron::Options::default()
            .with_default_extension(ron::extensions::Extensions::UNWRAP_VARIANT_NEWTYPES);
        let skill: Self = options.from_str(&text).map_err(|e| {
            FileError::syntax(path, e.span.start.line, e.span.start.col, e.code.to_string())
        })?;
        skill
            .validate()
            .map_err(|(key, problem)| FileError::key(path, key, problem))
            .map(|()| skill)
    }

    /// The same skill with another number of Gaussians.
    ///
    /// # Errors
    /// What was expected, when the number is outside the range of `mixture.components`.
    pub fn with_components(mut self, components: usize) -> Result<Self, String> {
        self.mixture.components = components;
        self.validate_counts().map_err(|(_, problem)| problem).map(|()| self)
    }

    /// The frames of a demonstration by name, in the skill's order: start, goal unless it is the same,
    /// then the others.
    ///
    /// # Panics
    /// When the demonstration lacks one of them; [`read_folder`](crate::demonstration::read_folder)
    /// refuses such.
    pub fn named_frames<'a>(
        &'a self,
        demonstration: &'a Demonstration,
    ) -> impl Iterator<Item = (&'a str, Pose)> {
        let start = (self.start_frame != self.goal_frame)
            .then_some((self.start_frame.as_str(), demonstration.start));
        let goal = (self.goal_frame.as_str(), demonstration.goal_frame);
        let others = self.other_frames.iter();
        let others = others.map(|name| (name.as_str(), demonstration.other_frames[name]));
        start.into_iter().chain([goal]).chain(others)
    }

    /// The poses of [`Skill::named_frames`].
    #[must_use]
    pub fn frames(&self, demonstration: &Demonstration) -> Vec<Pose> {
        self.named_frames(demonstration).map(|(_, pose)| pose).collect()
    }

    /// Every value as `section.key` and text, in order of the keys.
    #[must_use]
    pub fn values(&self) -> Vec<(String, String)> {
        let value = serde_json::to_value(self).expect("plain numbers and strings serialise");
        let mut values = Vec::new();
        flatten("", &value, &mut values);
        values
    }

    fn validate(&self) -> Result<(), (&'static str, String)> {
        if self.schema != SCHEMA {
            return Err(("schema", format!("expected `{SCHEMA}`, found `{}`", self.schema)));
        }
        for (key, name) in [
            ("skill", &self.skill),
            ("tool_frame", &self.tool_frame),
            ("start_frame", &self.start_frame),
            ("goal_frame", &self.goal_frame),
        ] {
            if name.is_empty() {
                return Err((key, "expected a name, found an empty one".into()));
            }
        }
        let mut frames = vec![&self.start_frame, &self.goal_frame];
        frames.dedup();
        for name in &self.other_frames {
            if name.is_empty() || frames.contains(&name) {
                let problem = format!(
                    "expected names that differ from each other and those of start and goal, found `{name}`"
                );
                return Err(("other_frames", problem));
            }
            frames.push(name);
        }
        if frames.len() > FRAME_CAPACITY {
            let problem = format!(
                "expected at most {FRAME_CAPACITY} frames together, found {}",
                frames.len()
            );
            return Err(("other_frames", problem));
        }
        self.validate_positive()?;
        self.validate_shape()?;
        self.validate_counts()
    }

    fn validate_positive(&self) -> Result<(), (&'static str, String)> {
        let c = &self.certification;
        let mut positive = vec![
            ("smoothing.window_s", self.smoothing.window_s),
            ("smoothing.rest_speed_fraction", self.smoothing.rest_speed_fraction),
            ("scale.span", self.scale.span),
            ("scale.position_span_min_m", self.scale.position_span_min_m),
            ("scale.orientation_span_min_rad", self.scale.orientation_span_min_rad),
            ("mixture.regularisation", self.mixture.regularisation),
            ("mixture.covariance_scale", self.mixture.covariance_scale),
            ("certification.horizon_s", c.horizon_s),
            ("certification.step_s", c.step_s),
            ("certification.random_start_radius", c.random_start_radius),
            ("certification.goal_tolerance_m", c.goal_tolerance_m),
            ("certification.goal_tolerance_rad", c.goal_tolerance_rad),
        ];
        if self.smoothing.rest_speed_fraction >= 0.5 {
            let problem = format!(
                "expected a fraction below 0.5, found {}",
                self.smoothing.rest_speed_fraction
            );
            return Err(("smoothing.rest_speed_fraction", problem));
        }
        for (key, value) in [
            ("certification.frame_translation_fraction", c.frame_translation_fraction),
            ("certification.frame_rotation_rad", c.frame_rotation_rad),
            ("certification.energy_rise_max", c.energy_rise_max),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err((key, format!("expected a number from zero on, found {value}")));
            }
        }
        match &self.fit {
            FitSettings::Canonical(f) => positive.extend(f.positive()),
            FitSettings::Thesis(t) => positive.extend([
                ("fit.metric_scale", t.metric_scale),
                ("fit.huber_threshold", t.huber_threshold),
                ("fit.damping_min", t.damping_min),
            ]),
        }
        if let Some(mean) = self.fit.kaiser_smoothing() {
            positive.extend([
                ("fit.kaiser_smoothing.window_s", mean.window_s),
                ("fit.kaiser_smoothing.shape", mean.shape),
            ]);
        }
        match positive.iter().find(|(_, x)| !(x.is_finite() && *x > 0.0)) {
            None => Ok(()),
            Some((key, x)) => Err((key, format!("expected a positive number, found {x}"))),
        }
    }

    /// I₀ of a larger shape is no number; a window of this one is a few samples wide.
    fn validate_shape(&self) -> Result<(), (&'static str, String)> {
        match self.fit.kaiser_smoothing() {
            Some(mean) if mean.shape > SHAPE_MAX => {
                let problem = format!("expected at most {SHAPE_MAX}, found {}", mean.shape);
                Err(("fit.kaiser_smoothing.shape", problem))
            }
            _ => Ok(()),
        }
    }

    fn validate_counts(&self) -> Result<(), (&'static str, String)> {
        let mut counts = vec![
            ("smoothing.degree", self.smoothing.degree, 2, 5),
            ("mixture.components", self.mixture.components, 1, COMPONENT_CAPACITY - 1),
            ("mixture.iterations", self.mixture.iterations as usize, 1, 1000),
            ("certification.random_starts", self.certification.random_starts as usize, 0, 10_000),
            (
                "certification.displaced_starts",
                self.certification.displaced_starts as usize,
                0,
                10_000,
            ),
        ];
        match &self.fit {
            FitSettings::Canonical(f) => counts.extend([
                ("fit.tube_stride", f.tube_stride, 1, 1000),
                ("fit.descent_stride", f.descent_stride, 1, 1000),
                ("fit.descent_points_random", f.descent_points_random, 1, 10_000),
                ("fit.refinement_rounds_max", f.refinement_rounds_max, 0, 100),
            ]),
            FitSettings::Thesis(t) => counts.push(("fit.stride", t.stride, 1, 1000)),
        }
        let c = &self.certification;
        if !(c.horizon_s <= DURATION_MAX_S && c.horizon_s / c.step_s <= ROLLOUT_STEPS_MAX) {
            let problem = format!(
                "expected at most {DURATION_MAX_S} s, and {ROLLOUT_STEPS_MAX} steps of \
                 `certification.step_s`, found {} s and steps of {} s",
                c.horizon_s, c.step_s
            );
            return Err(("certification.horizon_s", problem));
        }
        for (key, count, least, most) in counts {
            if !(least..=most).contains(&count) {
                return Err((key, format!("expected {least} to {most}, found {count}")));
            }
        }
        Ok(())
    }
}

impl FieldSettings {
    /// The values that have to be positive, and their keys.
    fn positive(&self) -> Vec<(&'static str, f64)> {
        let mut values = vec![
            ("fit.damping_1_s", self.damping_1_s),
            ("fit.activation_width", self.activation_width),
            ("fit.phase_overlap", self.phase_overlap),
            ("fit.phase_weight", self.phase_weight),
            ("fit.metric_scale", self.metric_scale),
            ("fit.tube_weight", self.tube_weight),
            ("fit.tube_attraction_1_s", self.tube_attraction_1_s),
            ("fit.tube_speed_min", self.tube_speed_min),
            ("fit.descent_weight", self.descent_weight),
            ("fit.descent_speed", self.descent_speed),
            ("fit.descent_slowdown", self.descent_slowdown),
            ("fit.descent_attraction", self.descent_attraction),
            ("fit.descent_goal_radius", self.descent_goal_radius),
            ("fit.descent_radius", self.descent_radius),
            ("fit.descent_phase_radius", self.descent_phase_radius),
            ("fit.stiffness_min_1_s2", self.stiffness_min_1_s2),
            ("fit.goal_hessian_min_1_s2", self.goal_hessian_min_1_s2),
            ("fit.regularisation", self.regularisation),
            ("fit.regularisation_length", self.regularisation_length),
        ];
        values.extend(self.tube_offsets.iter().map(|x| ("fit.tube_offsets", *x)));
        values
    }
}

fn flatten(prefix: &str, value: &serde_json::Value, values: &mut Vec<(String, String)>) {
    match value {
        serde_json::Value::Object(map) => {
            for (key, value) in map {
                let dot = if prefix.is_empty() { "" } else { "." };
                flatten(&format!("{prefix}{dot}{key}"), value, values);
            }
        }
        serde_json::Value::String(text) => values.push((prefix.into(), text.clone())),
        other => values.push((prefix.into(), other.to_string())),
    }
}
