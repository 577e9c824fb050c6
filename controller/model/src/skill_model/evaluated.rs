//! A model in the form in which the controller and the learner's rollouts evaluate it.

use glam::{DQuat, DVec3};
use nalgebra::SMatrix;
use tprmp_rmpflow::policy::canonical::frame_map::{Anchor, FrameMap, FrameMapError};
use tprmp_rmpflow::policy::canonical::policy::{CanonicalPolicy, PositionField};
use tprmp_rmpflow::policy::canonical::restriction::Restriction;
use tprmp_rmpflow::policy::canonical::rounds::Cycle;
use tprmp_rmpflow::policy::thesis::{
    PoseGaussian, ThesisComponent, ThesisPolicy, ThesisPolicyError,
};
use tprmp_rmpflow::policy::{FRAME_CAPACITY, SkillPolicy};

use crate::skill_model::model::{
    Adaptation, FieldModel, FrameGaussian, FrameMixture, Manifold, PolicyModel, Pose, SkillModel,
    ThesisModel, Waypoint,
};

/// Why a model cannot be evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EvaluationError {
    /// The frames make no map.
    #[error("the frames cannot be followed ({0:?})")]
    Frames(FrameMapError),
    /// The Gaussians of the frames do not multiply.
    #[error("the Gaussians of the frames cannot be multiplied ({0:?})")]
    Product(ThesisPolicyError),
    /// The thesis' policy moves all of a pose.
    #[error("the thesis' policy moves all of a pose, R3xS1 and S3 are parts of one")]
    PartOfPose,
}

impl From<FrameMapError> for EvaluationError {
    fn from(error: FrameMapError) -> Self {
        Self::Frames(error)
    }
}

impl From<ThesisPolicyError> for EvaluationError {
    fn from(error: ThesisPolicyError) -> Self {
        Self::Product(error)
    }
}

impl SkillModel {
    /// The policy, ready to be evaluated. Its frames are the first ones of the model's.
    ///
    /// # Errors
    /// [`EvaluationError`], which a model that was read and validated gives only when its numbers
    /// are at the edge of what can be computed with.
    pub fn policy(&self) -> Result<SkillPolicy, EvaluationError> {
        Ok(match &self.policy {
            PolicyModel::Canonical { position, orientation } => {
                SkillPolicy::Canonical(self.canonical_skill(position, orientation.as_ref())?)
            }
            PolicyModel::Thesis(thesis) => match self.manifold {
                Manifold::R2 => SkillPolicy::Plane(thesis_policy(&self.frames, thesis)?),
                Manifold::R3 => SkillPolicy::Space(thesis_policy(&self.frames, thesis)?),
                Manifold::R3S1 | Manifold::S3 => return Err(EvaluationError::PartOfPose),
                Manifold::R3S3 => SkillPolicy::Pose(thesis_policy(&self.frames, thesis)?),
            },
        })
    }

    /// The map of the model's frames.
    ///
    /// # Errors
    /// When the phases of the waypoints are not in order, which a valid model's are.
    ///
    /// # Panics
    /// When a waypoint is none of the model's frames.
    pub fn frame_map(&self) -> Result<FrameMap, FrameMapError> {
        let canonical = &self.canonical;
        let index = |name: &str| {
            self.frames.iter().position(|frame| frame.name == name).expect("a frame of the model")
        };
        let anchor = |name: &str, pose: &Pose, point_m: [f64; 3], phase| Anchor {
            index: index(name),
            frame: (*pose).into(),
            point: DVec3::from_array(point_m),
            phase,
        };
        let mut anchors = Vec::new();
        if self.start_frame != self.goal_frame {
            let start = &canonical.start;
            anchors.push(anchor(&self.start_frame, start, start.position_m, canonical.start_phase));
        }
        for waypoint in &canonical.waypoints {
            let Waypoint { frame, pose, point_m, phase } = waypoint;
            anchors.push(anchor(frame, pose, *point_m, *phase));
        }
        let goal = &canonical.goal;
        let (frame, phase) = (&canonical.goal_frame, canonical.goal_phase);
        anchors.push(anchor(&self.goal_frame, frame, goal.position_m, phase));
        let map = FrameMap::new(&anchors, (*goal).into(), canonical.rotate_positions)?;
        let adaptation = canonical.adaptation.as_ref();
        Ok(map.with_adaptation(adaptation.and_then(Adaptation::evaluated)))
    }

    fn canonical_skill(
        &self,
        position: &FieldModel,
        orientation: Option<&FieldModel>,
    ) -> Result<CanonicalPolicy, FrameMapError> {
        let cycle = position.fall_per_round.map(|fall| {
            let of_rotation = orientation.and_then(|field| field.fall_per_round);
            Cycle { fall_per_round: [fall, of_rotation.unwrap_or(0.0)] }
        });
        let position = match self.manifold {
            Manifold::R2 => PositionField::Plane(Box::new(position.field())),
            Manifold::R3 | Manifold::R3S1 | Manifold::S3 | Manifold::R3S3 => {
                PositionField::Space(Box::new(position.field()))
            }
        };
        let map = self.frame_map()?;
        Ok(CanonicalPolicy {
            restriction: self.restriction(&map),
            map,
            position,
            orientation: orientation.map(|field| Box::new(field.field())),
            cycle,
        })
    }

    /// What of a pose the policy moves. Angles count from how goal and frames lie in canonical coordinates, where
    /// their tilt is that of the demonstrations.
    fn restriction(&self, map: &FrameMap) -> Option<Restriction> {
        match self.manifold {
            Manifold::R2 | Manifold::R3 | Manifold::R3S3 => None,
            Manifold::S3 => Some(Restriction::Rotation),
            Manifold::R3S1 => {
                let mut frames = [DQuat::IDENTITY; FRAME_CAPACITY];
                for anchor in map.anchors() {
                    frames[anchor.index] = anchor.frame.orientation;
                }
                Some(Restriction::Yaw { tool: map.goal().orientation, frames })
            }
        }
    }
}

/// The thesis' policy on the product of the frames' Gaussians, on a manifold of dimension D.
///
/// # Errors
/// When the Gaussians cannot be multiplied.
///
/// # Panics
/// When D is not the dimension of the manifold, a frame has not as many Gaussians as `thesis` has
/// potentials, or there is no frame.
pub fn thesis_policy<const D: usize>(
    frames: &[FrameMixture],
    thesis: &ThesisModel,
) -> Result<ThesisPolicy<D>, ThesisPolicyError> {
    let component = |k: usize| {
        let gaussian = |p: usize| {
            pose_gaussian(&frames[p].gaussians[k])
                .ok_or(ThesisPolicyError::Precision { component: k, frame: p })
        };
        let gaussians = (0..frames.len()).map(gaussian).collect::<Result<_, _>>()?;
        let (potential, damping) = (thesis.potentials[k], thesis.damping[k]);
        Ok(ThesisComponent { gaussians, potential, damping })
    };
    let components = (0..thesis.potentials.len()).map(component).collect::<Result<_, _>>()?;
    ThesisPolicy::new(components, thesis.metric_scale, thesis.huber_threshold)
}

fn pose_gaussian<const D: usize>(gaussian: &FrameGaussian) -> Option<PoseGaussian<D>> {
    let rows = &gaussian.covariance;
    assert_eq!(rows.len(), D, "dimension of the manifold");
    let p = &gaussian.position_m;
    let position = DVec3::new(p[0], p[1], p.get(2).copied().unwrap_or(0.0));
    let [w, x, y, z] = gaussian.quaternion_wxyz.unwrap_or([1.0, 0.0, 0.0, 0.0]);
    let mean = tprmp_spatial::Pose { position, orientation: DQuat::from_xyzw(x, y, z, w) };
    PoseGaussian::from_covariance(mean, &SMatrix::from_fn(|i, j| rows[i][j]))
}
