//! What a model file holds, but for the fit and the certificate.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use tprmp_rmpflow::policy::canonical::adaptation::{self, COORDINATES};
use tprmp_rmpflow::policy::canonical::restriction::upright;

use crate::skill_model::certificate::Certificate;
use crate::skill_model::fit::Fit;
use crate::skill_model::gripper::GripperEvent;

/// Space in which a skill moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Manifold {
    /// Positions in the plane.
    R2,
    /// Positions in space.
    R3,
    /// Positions in space, and the angle about the vertical, z of the base.
    #[serde(rename = "R3xS1")]
    R3S1,
    /// Orientations.
    S3,
    /// Poses: position and orientation.
    #[serde(rename = "R3xS3")]
    R3S3,
}

impl Manifold {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::R2, Self::R3, Self::R3S1, Self::S3, Self::R3S3];

    /// Dimension of the position block.
    #[must_use]
    pub fn position_dimension(self) -> usize {
        match self {
            Self::R2 => 2,
            Self::R3 | Self::R3S1 | Self::S3 | Self::R3S3 => 3,
        }
    }

    /// Whether the skill has an orientation block.
    #[must_use]
    pub fn has_orientation(self) -> bool {
        matches!(self, Self::R3S1 | Self::S3 | Self::R3S3)
    }

    /// Number of the coordinates of its blocks. A model on part of a pose has those of all poses.
    #[must_use]
    pub fn dimension(self) -> usize {
        self.position_dimension() + if self.has_orientation() { 3 } else { 0 }
    }

    /// Which coordinates of a pose it moves, displacement before rotation.
    #[must_use]
    pub fn moved(self) -> &'static [usize] {
        match self {
            Self::R2 => &[0, 1],
            Self::R3 => &[0, 1, 2],
            Self::R3S1 => &[0, 1, 2, 5],
            Self::S3 => &[3, 4, 5],
            Self::R3S3 => &[0, 1, 2, 3, 4, 5],
        }
    }

    /// A pose as a skill on it sees it; of R3xS1 it is turned from a reference about z alone.
    #[must_use]
    pub fn part_of(self, pose: &tprmp_spatial::Pose, reference: DQuat) -> tprmp_spatial::Pose {
        match self {
            Self::R2 | Self::R3 | Self::R3S3 => *pose,
            Self::R3S1 => {
                tprmp_spatial::Pose { orientation: upright(pose.orientation, reference), ..*pose }
            }
            Self::S3 => tprmp_spatial::Pose { position: DVec3::ZERO, ..*pose },
        }
    }

    /// Whether it moves part of a pose, by a policy on poses.
    #[must_use]
    pub fn is_part_of_pose(self) -> bool {
        matches!(self, Self::R3S1 | Self::S3)
    }
}

impl std::fmt::Display for Manifold {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::R2 => "R2",
            Self::R3 => "R3",
            Self::R3S1 => "R3xS1",
            Self::S3 => "S3",
            Self::R3S3 => "R3xS3",
        })
    }
}

/// Whether a skill ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Motion {
    /// It goes to its goal, and rests there.
    #[default]
    Discrete,
    /// It goes round for ever: it has a limit cycle in place of a goal, and does not end by itself.
    Periodic {
        /// How long a demonstrated round lasts \[s\].
        period_s: f64,
    },
}

impl Motion {
    /// Whether it goes to a goal.
    #[must_use]
    pub fn is_discrete(&self) -> bool {
        *self == Self::Discrete
    }

    /// How long a demonstrated round lasts \[s\]; `None` when it has no rounds.
    #[must_use]
    pub fn period_s(&self) -> Option<f64> {
        match self {
            Self::Discrete => None,
            Self::Periodic { period_s } => Some(*period_s),
        }
    }
}

/// A pose in canonical coordinates. Planar skills have `z = 0` and rotate about z only.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Position \[m\].
    pub position_m: [f64; 3],
    /// Unit quaternion w, x, y, z.
    pub quaternion_wxyz: [f64; 4],
}

/// A learned skill, valid once read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkillModel {
    /// Name of the skill.
    pub skill: String,
    /// Space in which it moves.
    pub manifold: Manifold,
    /// Whether it ends.
    #[serde(default, skip_serializing_if = "Motion::is_discrete")]
    pub motion: Motion,
    /// Frame of the robot that moves (a link's name).
    pub tool_frame: String,
    /// Name of the frame at which the skill starts.
    pub start_frame: String,
    /// Name of the frame to which the goal is fixed; the start frame when there is no other.
    pub goal_frame: String,
    /// Frames and goal in canonical coordinates.
    pub canonical: Canonical,
    /// Mixture over canonical position ⊕ orientation, in order.
    pub gaussians: Vec<Gaussian>,
    /// The same mixture seen from each frame: start, goal, others.
    pub frames: Vec<FrameMixture>,
    /// What moves the tool.
    pub policy: PolicyModel,
    /// What the gripper does, in order; none where the demonstrations say nothing of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gripper: Vec<GripperEvent>,
    /// How well the model was fitted.
    pub fit: Fit,
    /// What was proved, and what was tried.
    pub certificate: Certificate,
    /// Where the model comes from.
    pub provenance: Provenance,
    /// Other ways of doing the same skill, each learned from demonstrations of its own, with a certificate of
    /// its own: the same space, tool and frames. They have no others themselves.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub other_modes: Vec<SkillModel>,
}

/// Most modes of a skill.
pub const MODE_CAPACITY: usize = 8;

impl SkillModel {
    /// The axis along which the tool comes to its goal, in its own frame: of the last stretch of the path, from the mean
    /// of the last Gaussian but one. `None` without an orientation, or where that stretch is shorter than 5 mm.
    #[must_use]
    pub fn approach_axis(&self) -> Option<DVec3> {
        const LENGTH_MIN_M: f64 = 0.005;
        let [.., last, _] = &self.gaussians[..] else { return None };
        let (true, [x, y, z, ..]) = (self.manifold.has_orientation(), &last.mean[..]) else {
            return None;
        };
        let [w, i, j, k] = self.canonical.goal.quaternion_wxyz;
        let along = DVec3::from(self.canonical.goal.position_m) - DVec3::new(*x, *y, *z);
        let into_tool = DQuat::from_xyzw(i, j, k, w).inverse();
        (along.length() > LENGTH_MIN_M).then(|| into_tool * along.normalize())
    }

    /// The ways of doing the skill, at least one: itself, then its other modes.
    pub fn modes(&self) -> impl ExactSizeIterator<Item = &Self> + Clone {
        ModeIterator { model: self, next: 0 }
    }

    /// The limit cycle of a periodic skill in a line: its period, how far it runs beside what was demonstrated, and that
    /// it never stops; `None` for a skill that goes to a goal.
    #[must_use]
    pub fn cycle_line(&self) -> Option<String> {
        let period_s = self.motion.period_s()?;
        let Some(cycle) = &self.certificate.cycle else {
            return Some(format!("demonstrated in {period_s:.2} s a round; it was not examined"));
        };
        let angle = |radians: f64| match self.manifold.has_orientation() {
            true => format!(" and {:.1}°", radians.to_degrees()),
            false => String::new(),
        };
        Some(format!(
            "a round lasts {:.2} s, demonstrated in {period_s:.2} s; it runs {:.1} mm{} (rms), at most {:.1} mm{}, beside \
             the mean of {} demonstrated rounds; it never stops by itself",
            cycle.period_s,
            1e3 * cycle.beside_rms_m,
            angle(cycle.beside_rms_rad),
            1e3 * cycle.beside_max_m,
            angle(cycle.beside_max_rad),
            cycle.rounds.iter().sum::<u32>()
        ))
    }

    /// What its certificates do not hold for, of all modes, the mode named where there are several.
    #[must_use]
    pub fn failures(&self) -> Vec<String> {
        let count = self.modes().len();
        let of_mode = |(i, mode): (usize, &Self)| -> Vec<String> {
            let name = |failure: &String| match count {
                1 => failure.clone(),
                _ => format!("mode {} of {count}: {failure}", i + 1),
            };
            mode.certificate.failures.iter().map(name).collect()
        };
        self.modes().enumerate().flat_map(of_mode).collect()
    }
}

#[derive(Clone)]
struct ModeIterator<'a> {
    model: &'a SkillModel,
    next: usize,
}

impl<'a> Iterator for ModeIterator<'a> {
    type Item = &'a SkillModel;

    fn next(&mut self) -> Option<Self::Item> {
        let mode = match self.next {
            0 => Some(self.model),
            i => self.model.other_modes.get(i - 1),
        };
        self.next += usize::from(mode.is_some());
        mode
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = 1 + self.model.other_modes.len() - self.next;
        (left, Some(left))
    }
}

impl ExactSizeIterator for ModeIterator<'_> {}

/// The policy of a skill.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum PolicyModel {
    /// Fields in canonical coordinates.
    Canonical {
        /// Position field \[m\].
        position: FieldModel,
        /// Orientation field \[rad\]; present exactly when the manifold has an orientation.
        orientation: Option<FieldModel>,
    },
    /// The thesis': a product of Gaussians.
    Thesis(ThesisModel),
}

/// The thesis' policy on the product of the frames' Gaussians.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThesisModel {
    /// γ of the metric [thesis eq. 4.5].
    pub metric_scale: f64,
    /// δ of the potential [standard deviations, thesis eq. 4.11].
    pub huber_threshold: f64,
    /// φ⁰_k, one a component; the last one is zero.
    pub potentials: Vec<f64>,
    /// d_k, one a component.
    pub damping: Vec<f64>,
}

/// A mixture seen from a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameMixture {
    /// Name of the frame.
    pub name: String,
    /// Its Gaussians, in order.
    pub gaussians: Vec<FrameGaussian>,
    /// How far the demonstrations lie apart seen from it, root of the mean square [m, rad], at equal fractions
    /// of their common duration.
    #[serde(default)]
    pub agreement: Vec<[f64; 2]>,
    /// For a frame that is neither start nor goal: the least fraction of that distance against what start and
    /// goal frame see, by which it was decided whether the path passes it.
    #[serde(default)]
    pub agreement_fraction: Option<f64>,
}

/// A Gaussian over poses seen from a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameGaussian {
    /// Mean position in the frame \[m\]; two numbers in the plane.
    pub position_m: Vec<f64>,
    /// Mean orientation in the frame, unit quaternion w, x, y, z; for manifolds that have one.
    pub quaternion_wxyz: Option<[f64; 4]>,
    /// Covariance of (position in axes of the frame, rotation vector in axes of the mean), rows.
    pub covariance: Vec<Vec<f64>>,
}

/// Frames and goal in canonical coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Canonical {
    /// The start frame.
    pub start: Pose,
    /// The goal frame.
    pub goal_frame: Pose,
    /// Pose of the tool when the skill is done; of a periodic skill, the mean pose of a round.
    pub goal: Pose,
    /// Whether the path to the goal rotates with the frames, or only the tool's orientation does.
    pub rotate_positions: bool,
    /// Phase up to which the skill is fixed to the start frame, from 0.
    pub start_phase: f64,
    /// Phase from which on it is fixed to the goal frame, up to 1.
    pub goal_phase: f64,
    /// Further frames, in the order in which the skill passes them.
    pub waypoints: Vec<Waypoint>,
    /// How the path changes with the shift of the goal frame against the start frame, as far as the
    /// demonstrations differ in it; only without further frames.
    pub adaptation: Option<Adaptation>,
}

/// `y = y° − E(s) u`, see [`tprmp_rmpflow::policy::canonical::adaptation`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Adaptation {
    /// ℓ_p: largest displacement of the goal frame in the demonstrations \[m\]; 0 without any.
    pub reach_m: f64,
    /// ℓ_r: largest rotation of the goal frame in the demonstrations \[rad\]; 0 without any.
    pub reach_rad: f64,
    /// E_j for each of the B-splines over the phase, row by row: position \[m\] before rotation \[rad\];
    /// columns: displacement before rotation.
    pub coefficients: Vec<[[f64; COORDINATES]; COORDINATES]>,
}

impl From<&adaptation::Adaptation> for Adaptation {
    fn from(learned: &adaptation::Adaptation) -> Self {
        let [reach_m, reach_rad] = learned.reach;
        Self { reach_m, reach_rad, coefficients: learned.coefficients.to_vec() }
    }
}

impl Adaptation {
    /// As it is evaluated; `None` when it has not a matrix for each spline.
    #[must_use]
    pub fn evaluated(&self) -> Option<adaptation::Adaptation> {
        let coefficients = self.coefficients.as_slice().try_into().ok()?;
        Some(adaptation::Adaptation { reach: [self.reach_m, self.reach_rad], coefficients })
    }
}

/// A frame that the skill passes between its start and its goal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Waypoint {
    /// Name of the frame.
    pub frame: String,
    /// The frame.
    pub pose: Pose,
    /// Where the tool passes it \[m\]: there the path is fixed to the frame.
    pub point_m: [f64; 3],
    /// Phase at which the tool passes it, between those of the start and the goal frame.
    pub phase: f64,
}

/// A learned field of one block of D = 2 or 3 coordinates and the phase. Unit u is m or rad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldModel {
    /// Damping `d`: `B = d M` [1/s].
    pub damping_1_s: f64,
    /// Width over which components pass into each other, as a fraction of the phase.
    pub phase_width: f64,
    /// Components in order of phase; the last one is the goal's. Of a periodic skill, those of one round.
    pub components: Vec<Component>,
    /// By how much the potential falls in a round [u²/s²]: exactly for periodic skills.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fall_per_round: Option<f64>,
}

/// One component of a field, on D coordinates and the phase.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Component {
    /// Mean μ \[u\], and last its phase. Of a periodic skill, such that Σ w_k μ_k is the demonstrated path.
    pub mean: Vec<f64>,
    /// Riemannian metric, symmetric positive definite, rows; for the goal the identity but for the
    /// phase, whose entry is an inertia \[u²\].
    pub metric: Vec<Vec<f64>>,
    /// Potential at the mean, φ⁰ [u²/s²].
    pub potential: f64,
    /// Gradient of φ at the mean, g [u/s², last u²/s²].
    pub gradient: Vec<f64>,
    /// Hessian of φ, symmetric, rows [1/s², last u/s² and u²/s²].
    pub hessian: Vec<Vec<f64>>,
}

/// A Gaussian of the mixture in canonical coordinates: position \[m\] ⊕ orientation \[rad\].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gaussian {
    /// Weight in the mixture.
    pub prior: f64,
    /// Mean phase, 0 at the start, 1 at the end of the demonstrations.
    pub phase: f64,
    /// Mean.
    pub mean: Vec<f64>,
    /// Covariance, rows.
    pub covariance: Vec<Vec<f64>>,
}

/// Where a model comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the learner.
    pub tool_version: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Demonstrations, in order of their names.
    pub demonstrations: Vec<Source>,
    /// Every value of the skill file, `section.key` and its value as text.
    pub hyper_parameters: Vec<(String, String)>,
}

/// A file that went into a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// File name, without folders.
    pub file: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
    /// What it says of itself.
    #[serde(default, skip_serializing_if = "Remarks::is_empty")]
    pub remarks: Remarks,
}

/// What somebody wrote into a demonstration: nothing is learned from it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Remarks {
    /// Who gave it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// Anything.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub notes: Option<String>,
}

impl Remarks {
    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.operator.is_none() && self.notes.is_none()
    }
}
