//! What stands in a skill file: what to learn, and every number that was chosen for it. There are no
//! defaults: what is missing is an error.
//!
//! Numbers that follow from others, tolerances, bounds of iterations and what is only warned of stand in
//! the code, each beside its reason.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tprmp_model::skill_model::Manifold;

/// A skill to be learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Skill {
    /// Schema version.
    pub schema: String,
    /// Name of the skill, as in its demonstrations.
    pub skill: String,
    /// Space in which it moves.
    pub manifold: Manifold,
    /// Whether it ends.
    #[serde(default, skip_serializing_if = "MotionSettings::is_discrete")]
    pub motion: MotionSettings,
    /// Frame of the robot that moves.
    pub tool_frame: String,
    /// Frame at which the skill starts.
    pub start_frame: String,
    /// Frame to which the goal is fixed; the start frame when there is no other.
    pub goal_frame: String,
    /// Further frames whose Gaussians are learned.
    pub other_frames: Vec<String>,
    /// Whether the file says `Auto` in their place: the frames that all demonstrations hold are tried, and those
    /// that matter become [`other_frames`](Self::other_frames).
    #[serde(skip)]
    pub proposes_frames: bool,
    /// Folder of demonstrations, relative to the skill file.
    pub demonstrations: PathBuf,
    /// Whether demonstrations that contradict each other are learned as ways of their own.
    #[serde(default)]
    pub modes: ModeSettings,
    /// Smoothing of the demonstrations.
    pub smoothing: Smoothing,
    /// Lengths in which the field is fitted.
    pub scale: Scale,
    /// How the demonstrations are brought to a common time.
    #[serde(default = "AlignmentSettings::joint")]
    pub alignment: AlignmentSettings,
    /// Gaussian mixture.
    pub mixture: Mixture,
    /// How the frames act on the space.
    pub frame_map: FrameMapSettings,
    /// The policy that is fitted, by name, and its settings.
    pub fit: FitSettings,
    /// What the fitted policy is certified for.
    pub certification: Certification,
}

/// Whether a skill ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MotionSettings {
    /// It goes to a goal.
    #[default]
    Discrete,
    /// It goes round for ever, on a limit cycle (see [`periodic`](crate::periodic)).
    Periodic,
}

impl MotionSettings {
    fn is_discrete(&self) -> bool {
        *self == Self::Discrete
    }
}

/// What becomes of demonstrations that contradict each other (see [`modes`](crate::modes)).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ModeSettings {
    /// Each way of doing it is a mode of the model.
    #[default]
    Auto,
    /// All are one: their mean is learned.
    One,
}

/// Which policy is fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "a skill has one of them")]
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
    /// Length of the window \[s\].
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
    /// A smaller span of the positions is taken as this \[m\].
    pub position_span_min_m: f64,
    /// A smaller span of the orientations is taken as this \[rad\].
    pub orientation_span_min_rad: f64,
}

/// How demonstrations are brought to a common time (see [`alignment`](crate::alignment)).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlignmentSettings {
    /// What says which samples of the demonstrations belong together.
    pub method: AlignmentMethod,
    /// A slow stretch of this length or more is a pause \[s\]: kept when all demonstrations make it.
    pub pause_min_s: f64,
    /// Places of the path at which demonstrations are compared.
    pub places: usize,
    /// How often maps and what they have in common are found anew, at most.
    pub rounds: usize,
    /// λ: weight of (γ′ − 1)², the change of pace, against half the squared distance in standard deviations.
    pub stiffness: f64,
    /// Width of the Gaussian that smooths the pace, as a fraction of the path.
    pub width: f64,
    /// Demonstrations are never taken to agree better than this \[ŷ\].
    pub agreement_floor: f64,
}

impl AlignmentSettings {
    /// Those of the shipped skill files, for files of the schema before, which have none.
    #[must_use]
    pub fn shipped(fit: &FitSettings) -> Self {
        match fit {
            FitSettings::Canonical(_) => Self::joint(),
            // As published.
            FitSettings::Thesis(_) => Self { method: AlignmentMethod::Clock, ..Self::joint() },
        }
    }

    fn joint() -> Self {
        Self {
            method: AlignmentMethod::Joint,
            pause_min_s: 0.25,
            places: 150,
            rounds: 10,
            stiffness: 10.0,
            width: 0.03,
            agreement_floor: 0.03,
        }
    }
}

/// What says which samples of several demonstrations belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum AlignmentMethod {
    /// The same fraction of the time between the rests: for teachers that keep time.
    Clock,
    /// The same fraction of the path's length.
    ArcLength,
    /// Dynamic time warping onto the mean of all, seen from the goal frame.
    Barycentre,
    /// The same, seen from all frames at once: at each place that frame counts from which they agree.
    Joint,
}

/// How the map of the frames is chosen (see [`canonical`](crate::canonical)).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameMapSettings {
    /// Phases at which demonstrations are compared.
    pub phases_compared: usize,
    /// Positions rotate with the frames unless the demonstrations predict each other better when they do
    /// not: then the error is this fraction of it or less.
    pub upright_error_fraction_max: f64,
    /// The change from the start to the goal frame takes the whole path unless the demonstrations lie
    /// this fraction as far apart, or less, when it begins later or ends earlier …
    pub change_spread_fraction_max: f64,
    /// … at one of so many phases of the first and of the second half …
    pub changes_compared: usize,
    /// … over no less than this part of the phase.
    pub change_phase_min: f64,
    /// A further frame acts where the demonstrations seen from it lie this fraction or less as far apart
    /// as seen from start and goal frame …
    pub agreement_fraction_max: f64,
    /// … counting differences below this fraction of the demonstrations' span as none.
    pub agreement_floor_fraction: f64,
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
    /// Added to the covariances' diagonal in each iteration \[ŷ²\].
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

/// What files of before this key have.
fn stiffness_max() -> f64 {
    128.0
}

/// Field of a block. Lengths are in ŷ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldSettings {
    /// Damping d in B = d M [1/s].
    pub damping_1_s: f64,
    /// A demonstration that begins in motion is followed from rest, and caught up with at this multiple
    /// of the damping.
    pub catch_up_ratio: f64,
    /// σ₀: M_k = γ (C_k + σ₀² I)⁻¹ \[ŷ\].
    pub activation_width: f64,
    /// Width over which components pass into each other, as a fraction of the phase between two of them.
    pub phase_overlap: f64,
    /// Weight of the phase's acceleration in the residual against the others'.
    pub phase_weight: f64,
    /// γ in M_k.
    pub metric_scale: f64,
    /// Offsets of the tube points from the demonstrations \[ŷ\].
    pub tube_offsets: Vec<f64>,
    /// A tube point is dropped when another part of the path is nearer than this fraction of its offset.
    pub tube_clearance_fraction: f64,
    /// Every how many samples there are tube points.
    pub tube_stride: usize,
    /// Weight of all tube points together.
    pub tube_weight: f64,
    /// Speed towards the demonstration per offset [1/s].
    pub tube_attraction_1_s: f64,
    /// Slower samples show no direction [ŷ/s].
    pub tube_speed_min: f64,
    /// τ: weight of the descent constraint.
    pub descent_weight: f64,
    /// ε: least speed of descent along the demonstrations [ŷ/s].
    pub descent_speed: f64,
    /// Distance to the goal below which this speed falls to zero \[ŷ\].
    pub descent_slowdown: f64,
    /// Distance over which the direction of descent turns towards the demonstration \[ŷ\].
    pub descent_attraction: f64,
    /// Distance within which the direction of descent is the goal's \[ŷ\].
    pub descent_goal_radius: f64,
    /// Every how many samples descent is a constraint.
    pub descent_stride: usize,
    /// Seeded random points at which descent is a constraint besides.
    pub descent_points_random: usize,
    /// Random points nearer to the goal are left to its Hessian \[ŷ\].
    pub descent_goal_distance_min: f64,
    /// How far in each coordinate they lie from the demonstrations \[ŷ\].
    pub descent_radius: f64,
    /// How far in the phase, times its length \[ŷ\].
    pub descent_phase_radius: f64,
    /// How often the fit may be solved again with more weight where its valley does not fall.
    pub refinement_rounds_max: usize,
    /// Weight of a refined constraint against that of a checked point.
    pub refinement_weight: f64,
    /// Random points around a fault of the valley that are refined with it …
    pub refinement_points: usize,
    /// … within half the side of this box \[ŷ\].
    pub refinement_radius: f64,
    /// Fewest samples of a demonstration that a stride leaves, so that sparsely sampled demonstrations
    /// count as well.
    pub stride_samples_min: usize,
    /// Least stiffness of each component across the path, relative to its metric [1/s²].
    pub stiffness_min_1_s2: f64,
    /// Largest stiffness of each component across the path, relative to its metric \[1/s²\].
    #[serde(default = "stiffness_max")]
    pub stiffness_max_1_s2: f64,
    /// Least Hessian at the goal, relative to the metric [1/s²].
    pub goal_hessian_min_1_s2: f64,
    /// λ: weight of ‖C p‖².
    pub regularisation: f64,
    /// Length at which the parameters are compared by C \[ŷ\].
    pub regularisation_length: f64,
    /// How the path adapts to its goal.
    pub adaptation: AdaptationSettings,
}

/// The regression of the path on the goal's shift (see [`adaptation`](crate::canonical::adaptation)).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdaptationSettings {
    /// λ that are tried, from strong to weak.
    pub ridges: Vec<f64>,
    /// A regression is taken when its leave-one-out prediction error is this fraction of the mean's, or
    /// less.
    pub error_fraction_max: f64,
    /// Smaller shifts were not demonstrated [ŷ, or rad].
    pub shift_min: f64,
    /// Paths are compared when at both ends they lie apart by no more than this fraction of their mean
    /// distance: the splines begin and end at zero.
    pub end_spread_fraction_max: f64,
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
    /// Slower samples show no direction: fraction of the demonstration's largest speed.
    pub speed_fraction_min: f64,
    /// Every how many samples of a demonstration enter the fits.
    pub stride: usize,
    /// How the demonstrations are smoothed before anything else: the model, its rollouts and its
    /// certificate are of the smoothed ones. The mixture and both fits then take points as they are and
    /// velocities as differences of neighbours. `None`: the fits are smoothed as `smoothing` says.
    #[serde(deserialize_with = "Option::deserialize")]
    pub kaiser_smoothing: Option<KaiserSmoothing>,
}

/// Smoothing by the mean over a Kaiser window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KaiserSmoothing {
    /// Length of the window \[s\].
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

/// What a fitted policy is certified for; what it fails stands in its model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certification {
    /// Longest rollout \[s\].
    pub horizon_s: f64,
    /// Step of the rollouts from the demonstrated starts, that of a fast controller \[s\].
    pub demonstration_step_s: f64,
    /// Step of the rollouts from random starts, that of a slow controller \[s\].
    pub step_s: f64,
    /// Random starts with the frames of the demonstrations.
    pub random_starts: u32,
    /// Random starts with displaced frames.
    pub displaced_starts: u32,
    /// Radius around the demonstrated points in which they lie \[ŷ\].
    pub random_start_radius: f64,
    /// How far frames are displaced, as a fraction of the distance between start frame and goal.
    pub frame_translation_fraction: f64,
    /// How far frames are rotated \[rad\].
    pub frame_rotation_rad: f64,
    /// A rollout stops once it is nearer to the goal than this fraction of the tolerance.
    pub arrival_fraction: f64,
    /// The goal is at rest below this |M⁻¹∇Φ| [m/s² or rad/s²].
    pub goal_gradient_max: f64,
    /// Largest rise of the energy in a step, relative to that at the start.
    pub energy_rise_max: f64,
    /// A rollout reached the goal when it ends this near \[m\].
    pub goal_tolerance_m: f64,
    /// … and this near \[rad\].
    pub goal_tolerance_rad: f64,
}
