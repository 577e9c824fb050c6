//! Recomputes of a certificate what is a property of the model alone, in milliseconds: a checksum
//! says that a file was not damaged, not that what it claims is so.

use std::path::Path;

use tprmp_rmpflow::policy::SkillPolicy;
use tprmp_spatial::{MovingPose, Pose};

use crate::skill_model::blocks::blocks;
use crate::skill_model::certificate::BlockCertificate;
use crate::skill_model::file::ModelError;
use crate::skill_model::model::SkillModel;

/// How far a figure may be from the certificate's, as a fraction of it: the machine may be another one.
const TOLERANCE: f64 = 1e-6;
/// And beyond that, for those that are zero but for rounding.
const ROUNDING: f64 = 1e-9;

/// Compares the certificate of a model with what its metric, its valley and its goal are. One that has
/// failures claims nothing. `policy` is the model's, `path` its file.
///
/// # Errors
/// [`ModelError::Invalid`]: a figure is another, or not one with which a certificate holds.
pub fn verify(model: &SkillModel, policy: &SkillPolicy, path: &Path) -> Result<(), ModelError> {
    if !model.certificate.holds() {
        return Ok(());
    }
    let frame = |name: &str| -> Pose {
        let canonical = &model.canonical;
        let waypoint = canonical.waypoints.iter().find(|waypoint| waypoint.frame == name);
        match waypoint {
            Some(waypoint) => waypoint.pose.into(),
            None if name == model.goal_frame => canonical.goal_frame.into(),
            None => canonical.start.into(),
        }
    };
    let frames: Vec<MovingPose> =
        model.frames.iter().map(|one| MovingPose::at_rest(frame(&one.name))).collect();
    let found = blocks(policy, &frames, &model.canonical.goal.into());
    let claimed = &model.certificate.blocks;
    let invalid = |key: String, problem: String| ModelError::Invalid {
        path: path.into(),
        key: format!("certificate.{key}"),
        problem: format!("{problem}: the certificate is not this model's; train it again"),
    };
    if found.len() != claimed.len() {
        let problem = format!("expected {} of them, found {}", found.len(), claimed.len());
        return Err(invalid("blocks".into(), problem));
    }
    for (i, (claimed, found)) in claimed.iter().zip(&found).enumerate() {
        compare(claimed, found, policy.is_periodic())
            .map_err(|(figure, problem)| invalid(format!("blocks[{i}].{figure}"), problem))?;
    }
    Ok(())
}

/// The first figure that is wrong, and what was expected and found.
fn compare(
    claimed: &BlockCertificate,
    found: &BlockCertificate,
    is_periodic: bool,
) -> Result<(), (&'static str, String)> {
    let (least, most) = (found.metric_eigenvalue_min, found.metric_eigenvalue_max);
    if !(least > 0.0 && most.is_finite()) {
        let problem =
            format!("expected a positive definite metric, recomputed {least:e} to {most:e}");
        return Err(("metric_eigenvalue_min", problem));
    }
    // A product of Gaussians depends on where the frames are: those of the certificate are not in the file.
    let (Some(of_claimed), Some(of_found)) = (&claimed.valley, &found.valley) else {
        return match (&claimed.valley, &found.valley) {
            (None, None) => Ok(()),
            _ => Err(("valley", "expected one exactly where the policy is a field".into())),
        };
    };
    if let Some([low, high]) = of_found.unproved {
        let to = if is_periodic { "all along a round" } else { "towards the goal" };
        let problem = format!(
            "expected a potential that falls {to}, not proved between the phases {low:.4} and {high:.4}"
        );
        return Err(("valley.unproved", problem));
    }
    for (figure, claimed, found, is_positive) in [
        ("metric_eigenvalue_min", claimed.metric_eigenvalue_min, least, true),
        ("metric_eigenvalue_max", claimed.metric_eigenvalue_max, most, true),
        ("goal_gradient", claimed.goal_gradient, found.goal_gradient, false),
        (
            "goal_hessian_min_1_s2",
            claimed.goal_hessian_min_1_s2,
            found.goal_hessian_min_1_s2,
            !is_periodic,
        ),
        (
            "valley.stiffness_min_1_s2",
            of_claimed.stiffness_min_1_s2,
            of_found.stiffness_min_1_s2,
            true,
        ),
        ("valley.descent_min", of_claimed.descent_min, of_found.descent_min, true),
    ] {
        let away = (claimed - found).abs();
        let is_same = away <= TOLERANCE * found.abs() + ROUNDING;
        if !is_same || (is_positive && found <= 0.0) {
            let positive = if is_positive { ", above zero" } else { "" };
            let problem = format!("recomputed {found:e}{positive}, found {claimed:e}");
            return Err((figure, problem));
        }
    }
    Ok(())
}
