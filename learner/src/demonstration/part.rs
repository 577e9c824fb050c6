//! Demonstrations of poses, for a skill that moves part of one.

use std::path::Path;

use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use crate::demonstration::recorded::Demonstration;
use crate::file_error::FileError;

/// A skill on R3xS1 leaves the tilt of the tool alone: one that is tilted by more, against its first pose in the first file, is no
/// demonstration of it \[rad\].
const TILT_MAX_RAD: f64 = core::f64::consts::FRAC_PI_4;

/// Whether a skill on this manifold can be learned from demonstrations on the other one.
pub(super) fn is_learned_from(skill: Manifold, recorded: Manifold) -> bool {
    skill == recorded || (recorded == Manifold::R3S3 && skill.position_dimension() == 3)
}

/// Leaves of the demonstrations what a skill on a manifold moves. For R3xS1 poses and frames are turned about z alone, from
/// where they are in the first file.
///
/// # Errors
/// Where a tool or a frame is tilted too far for that, naming file and key.
pub(crate) fn leave_part(
    demonstrations: &mut [Demonstration],
    manifold: Manifold,
    folder: &Path,
    [start, goal]: [&str; 2],
) -> Result<(), FileError> {
    let Some(first) = demonstrations.first().cloned() else { return Ok(()) };
    for demonstration in demonstrations.iter_mut().filter(|d| d.manifold != manifold) {
        let file = folder.join(&demonstration.name);
        let part = |pose: &mut Pose, of: &Pose, key: &dyn Fn() -> String| {
            let seen = manifold.part_of(pose, of.orientation);
            let tilt = seen.orientation.angle_between(pose.orientation);
            if tilt > TILT_MAX_RAD {
                let problem = format!(
                    "expected it tilted by at most {:.0}° against the first demonstration, since a skill on {manifold} \
                     moves the angle about z alone, found {:.0}°: use R3xS3, or leave this file out",
                    TILT_MAX_RAD.to_degrees(),
                    tilt.to_degrees()
                );
                return Err(FileError::key(&file, key(), problem));
            }
            *pose = seen;
            Ok(())
        };
        for (i, pose) in demonstration.poses.iter_mut().enumerate() {
            part(pose, &first.poses[0], &|| format!("samples[{i}]"))?;
        }
        part(&mut demonstration.start, &first.start, &|| format!("frames.{start}"))?;
        part(&mut demonstration.goal_frame, &first.goal_frame, &|| format!("frames.{goal}"))?;
        for (name, pose) in &mut demonstration.other_frames {
            let of = first.other_frames.get(name).copied().unwrap_or(*pose);
            part(pose, &of, &|| format!("frames.{name}"))?;
        }
        if !manifold.has_orientation() {
            demonstration
                .poses
                .iter_mut()
                .for_each(|pose| pose.orientation = Pose::IDENTITY.orientation);
        }
        demonstration.manifold = manifold;
    }
    Ok(())
}
