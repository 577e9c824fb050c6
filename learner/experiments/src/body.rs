//! The body that obeys a policy, and how the shipped controller keeps it slow and clear of obstacles.

use std::path::Path;

use glam::DVec3;
use nalgebra::DMatrix;
use tprmp_learner::certify::policy::{DesiredMotion, LearnedPolicy};
use tprmp_model::controller_config;
use tprmp_model::skill_model::{EvaluationError, PolicyModel, SkillModel};
use tprmp_rmpflow::leaves::{Avoidance, Side, Steering};
use tprmp_rmpflow::natural::Natural;
use tprmp_rmpflow::policy::{SkillInertia, SpeedGovernor};

use crate::error::ExperimentsError;
use crate::experiment::Space;

/// Inertia of the body, that of the default policy at its goal included: about what γ = 0.25 gives a
/// skill of 2.75 m, so that a force does to all what it does to the thesis' policy.
pub(crate) const INERTIA: SkillInertia = SkillInertia { linear_kg: 5.0, angular_kg_m2: 0.05 };

/// The controller whose leaves are taken, in the configuration folder.
const CONTROLLER: &str = "controllers/planar.ron";

/// What the shipped controller adds to a policy, at some scale.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ControllerLeaves {
    /// Keeps the default policy within a speed: far from its demonstrations a field asks for any.
    pub(crate) governor: SpeedGovernor,
    avoidance: Avoidance,
    steering: Steering,
    scale: f64,
}

impl ControllerLeaves {
    /// Reads them from the configuration folder.
    ///
    /// # Errors
    /// [`ExperimentsError`]: the file is refused, or does not steer around obstacles.
    pub(crate) fn read(config: &Path) -> Result<Self, ExperimentsError> {
        let path = config.join(CONTROLLER);
        let unconfigured = |key| ExperimentsError::Unconfigured { path: path.clone(), key };
        let file = controller_config::read(&path)?;
        let collision = file.collision.as_ref().ok_or_else(|| unconfigured("collision"))?;
        let mut avoidance = collision.leaf();
        avoidance.leaf.inertia = INERTIA.linear_kg;
        let steering = avoidance.steering.ok_or_else(|| unconfigured("collision.steering"))?;
        Ok(Self { governor: file.skill.governor, avoidance, steering, scale: 1.0 })
    }

    /// The same for skills that are larger by a factor: lengths and speeds go with it, times and masses stay.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        let mut scaled = *self;
        scaled.scale *= factor;
        let leaf = &mut scaled.avoidance.leaf;
        for length in [
            &mut scaled.governor.linear_max_m_s,
            &mut scaled.avoidance.margin_m,
            &mut scaled.steering.range_m,
            &mut scaled.steering.speed_max_m_s,
            &mut leaf.activation_distance,
            &mut leaf.distance_min,
            &mut leaf.approach_speed,
        ] {
            *length *= factor;
        }
        scaled.avoidance.leaf.repulsion *= factor * factor;
        scaled
    }

    /// How obstacles are avoided: in space over them where the task favours no side.
    pub(crate) fn avoidance(&self, space: Space) -> Avoidance {
        let side = match space {
            Space::Planar => Side::Plane,
            Space::Pick => Side::Space(DVec3::Z),
        };
        Avoidance { steering: Some(Steering { side, ..self.steering }), ..self.avoidance }
    }

    /// A learned model as it is evaluated. Only the default policy has a governor.
    ///
    /// # Errors
    /// When it cannot be evaluated.
    pub(crate) fn policy(&self, model: &SkillModel) -> Result<LearnedPolicy, EvaluationError> {
        // Precisions grow as a skill shrinks: the thesis' policy is given the inertia that it has at a scale of one.
        let square = self.scale * self.scale;
        let linear_kg = thesis_inertia_kg(model).map_or(INERTIA.linear_kg, |kg| kg * square);
        let angular_kg_m2 = INERTIA.angular_kg_m2 * square;
        let canonical = matches!(model.policy, PolicyModel::Canonical { .. });
        let governor = canonical.then_some(self.governor);
        LearnedPolicy::with(model, SkillInertia { linear_kg, angular_kg_m2 }, governor)
    }
}

/// The thesis' policy has an inertia of its own, γ Σ Λ at the goal's component; the mean of its linear
/// eigenvalues [kg].
fn thesis_inertia_kg(model: &SkillModel) -> Option<f64> {
    let PolicyModel::Thesis(thesis) = &model.policy else { return None };
    let n = model.manifold.position_dimension();
    let mut trace = 0.0;
    for frame in &model.frames {
        let covariance = &frame.gaussians.last()?.covariance;
        let d = covariance.len();
        let precision = DMatrix::from_fn(d, d, |i, j| covariance[i][j]).try_inverse()?;
        trace += (0..n).map(|i| precision[(i, i)]).sum::<f64>();
    }
    Some(thesis.metric_scale * trace / n as f64)
}

/// The desired motion of a point with the body's inertia: an acceleration [m/s²].
pub(crate) fn point_motion(acceleration: DVec3) -> DesiredMotion {
    let mut natural = Natural::zero();
    for i in 0..3 {
        natural.metric[(i, i)] = INERTIA.linear_kg;
        natural.metric[(i + 3, i + 3)] = INERTIA.angular_kg_m2;
        natural.force[i] = INERTIA.linear_kg * acceleration[i];
    }
    DesiredMotion { natural, energy: f64::NAN }
}
