//! Means of orientations, of poses, and of the frames of demonstrations.

use glam::{DQuat, DVec3};
use nalgebra::{Matrix4, Vector4};
use tprmp_spatial::Pose;
use tprmp_spatial::rotation::rotation_vector;

use crate::demonstration::Demonstration;

/// Bound on the iterations of the mean; some five are usual.
const ITERATIONS_MAX: usize = 100;
/// The iterations end with a smaller step [rad].
const STEP_MIN_RAD: f64 = 1e-15;
/// Frames are fixed to each other when they move less than this [m] …
const FIXED_M: f64 = 1e-9;
/// … and rotate less than this [rad]: rounding.
const FIXED_RAD: f64 = 1e-9;

/// The weighted mean of rotations: the one with the least weighted sum of squared angles, by
/// Gauss–Newton from the eigenvector of Σ w q qᵀ of the largest eigenvalue. A quaternion and its
/// negative are the same rotation. Without any weight all count the same.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn mean_orientation(orientations: &[DQuat], weights: &[f64]) -> DQuat {
    assert!(!orientations.is_empty(), "at least one orientation");
    let sum: f64 = weights.iter().sum();
    let even = 1.0 / orientations.len() as f64;
    let weight = |i: usize| if sum > 0.0 { weights[i] / sum } else { even };
    let mut moment = Matrix4::<f64>::zeros();
    for (i, q) in orientations.iter().enumerate() {
        let q = Vector4::from(q.to_array());
        moment += q * q.transpose() * weight(i);
    }
    let eigen = moment.symmetric_eigen();
    let largest = eigen.eigenvalues.imax();
    let start = eigen.eigenvectors.column(largest);
    let mut mean = DQuat::from_xyzw(start[0], start[1], start[2], start[3]).normalize();
    for _ in 0..ITERATIONS_MAX {
        let step: DVec3 = orientations
            .iter()
            .enumerate()
            .filter(|(i, _)| weight(*i) > 0.0)
            .map(|(i, q)| rotation_vector(mean.conjugate() * *q) * weight(i))
            .sum();
        mean = (mean * DQuat::from_scaled_axis(step)).normalize();
        if step.length() < STEP_MIN_RAD {
            break;
        }
    }
    // Of the two quaternions, the one with w ≥ 0: so the result does not depend on the inputs'.
    if mean.w < 0.0 { -mean } else { mean }
}

/// The start of a skill that has no start frame: where the tool is on average at first, seen from
/// the goal frame.
#[must_use]
pub fn mean_start(demonstrations: &[Demonstration]) -> Pose {
    let start = |d: &Demonstration| {
        d.goal_frame.inverse().compose(d.poses.first().expect("a demonstration has points"))
    };
    mean_pose(&demonstrations.iter().map(start).collect::<Vec<_>>())
}

/// Frames and goal in the mean of the demonstrations.
pub struct MeanFrames {
    /// The start frame.
    pub start: Pose,
    /// The goal frame.
    pub goal_frame: Pose,
    /// Pose of the tool at the end.
    pub goal: Pose,
}

/// The means over demonstrations, of which there is at least one.
pub fn mean_frames(demonstrations: &[Demonstration]) -> MeanFrames {
    let poses = |f: &dyn Fn(&Demonstration) -> Pose| -> Vec<Pose> {
        demonstrations.iter().map(f).collect()
    };
    let goal_frame = mean_pose(&poses(&|d| d.goal_frame));
    let between = poses(&|d| d.goal_frame.inverse().compose(&d.start));
    let fixed = between.iter().all(|pose| {
        (pose.position - between[0].position).length() < FIXED_M
            && pose.rotation_from(&between[0]).length() < FIXED_RAD
    });
    // Frames that are fixed to each other are so in canonical coordinates.
    let start =
        if fixed { goal_frame.compose(&between[0]) } else { mean_pose(&poses(&|d| d.start)) };
    let grasp = mean_pose(&poses(&|d| {
        d.goal_frame.inverse().compose(d.poses.last().expect("a demonstration has points"))
    }));
    let mut goal = goal_frame.compose(&grasp);
    goal.orientation = if demonstrations[0].manifold.has_orientation() {
        goal.orientation.normalize()
    } else {
        goal_frame.orientation
    };
    MeanFrames { start, goal_frame, goal }
}

/// The mean goal, seen from the goal frame.
#[must_use]
pub fn mean_goal(demonstrations: &[Demonstration]) -> Pose {
    let mean = mean_frames(demonstrations);
    mean.goal_frame.inverse().compose(&mean.goal)
}

/// The mean of poses.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn mean_pose(poses: &[Pose]) -> Pose {
    let orientations: Vec<_> = poses.iter().map(|p| p.orientation).collect();
    let position = poses.iter().map(|p| p.position).sum::<DVec3>() / poses.len() as f64;
    let weights = vec![1.0; poses.len()];
    Pose { position, orientation: mean_orientation(&orientations, &weights) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_orientation_does_not_see_the_hemisphere() {
        let vectors = [[0.2, 0.1, 3.0], [0.25, 0.0, 3.05], [0.1, 0.1, 2.9], [0.2, -0.1, 3.1]];
        let all: Vec<_> = vectors.map(|v| DQuat::from_scaled_axis(v.into())).to_vec();
        let mean = mean_orientation(&all, &[1.0; 4]);
        for signs in 0..16 {
            let flipped: Vec<_> = all
                .iter()
                .enumerate()
                .map(|(i, q)| if signs >> i & 1 == 1 { -*q } else { *q })
                .collect();
            let other = mean_orientation(&flipped, &[1.0; 4]);
            assert!((other - mean).length() < 1e-14);
        }
        // It is a stationary point of the sum of squared angles.
        let sum: DVec3 = all.iter().map(|q| rotation_vector(mean.conjugate() * *q)).sum();
        assert!(sum.length() < 1e-13);
    }

    #[test]
    fn mean_of_two_is_half_way() {
        let (a, b) = (DQuat::from_rotation_x(0.3), DQuat::from_rotation_x(1.1));
        let mean = mean_orientation(&[a, -b], &[1.0, 1.0]);
        assert!((mean - DQuat::from_rotation_x(0.7)).length() < 1e-14);
    }

    #[test]
    fn weights_count() {
        let (a, b) = (DQuat::from_rotation_x(0.0), DQuat::from_rotation_x(1.0));
        let mean = mean_orientation(&[a, b], &[1.0, 3.0]);
        assert!((mean - DQuat::from_rotation_x(0.75)).length() < 1e-14);
        let even = mean_orientation(&[a, b], &[0.0, 0.0]);
        assert!((even - DQuat::from_rotation_x(0.5)).length() < 1e-14);
    }
}
