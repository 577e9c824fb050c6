//! Under which conditions a policy is followed: frames, how the goal moves, what pushes, and what is in
//! the way.

use glam::{DQuat, DVec3};
use tprmp_learner::canonical::mean_goal;
use tprmp_learner::certify::policy::Body;
use tprmp_model::skill_model::Manifold;
use tprmp_rmpflow::leaves::{Avoidance, Obstacle};
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

use crate::dataset::SkillSet;

/// Step of all rollouts, as in the thesis \[s\].
pub const STEP_S: f64 = 0.01;
/// How long a rollout may take \[s\].
pub const DURATION_S: f64 = 20.0;
/// Angular speed of the goal on its circle, as in the thesis [rad/s].
pub const CIRCLE_SPEED_RAD_S: f64 = std::f64::consts::PI;
/// Radius of that circle where nothing else is said, at a scale of one \[m\].
pub const CIRCLE_RADIUS_M: f64 = 0.2;

/// How the goal frame moves until the body is near the goal; then it stops.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GoalMotion {
    /// Radius of its circle around where it was demonstrated \[m\].
    pub radius_m: f64,
    /// Angular speed on the circle [rad/s].
    pub speed_rad_s: f64,
    /// How far it turns about z to either side \[rad\].
    pub rotation_rad: f64,
    /// Angular frequency of that [rad/s].
    pub rotation_speed_rad_s: f64,
    /// It stops when the body is so near \[m\].
    pub stops_within_m: f64,
}

impl GoalMotion {
    /// On a circle.
    #[must_use]
    pub fn circle(radius_m: f64, speed_rad_s: f64, stops_within_m: f64) -> Self {
        Self { radius_m, speed_rad_s, stops_within_m, ..Self::default() }
    }

    /// The frame that was demonstrated at this pose, as it has moved at a time.
    #[must_use]
    pub fn at(&self, demonstrated: &Pose, time_s: f64) -> MovingPose {
        let (sin, cos) = (self.speed_rad_s * time_s).sin_cos();
        let out = DVec3::new(cos, sin, 0.0) * self.radius_m;
        let along = DVec3::new(-sin, cos, 0.0) * (self.radius_m * self.speed_rad_s);
        let (rotation_sin, rotation_cos) = (self.rotation_speed_rad_s * time_s).sin_cos();
        let (a, w) = (self.rotation_rad, self.rotation_speed_rad_s);
        MovingPose {
            pose: Pose {
                position: demonstrated.position + out,
                orientation: DQuat::from_rotation_z(a * rotation_sin) * demonstrated.orientation,
            },
            velocity: Twist { linear: along, angular: DVec3::Z * (a * w * rotation_cos) },
            acceleration: SpatialAcceleration {
                linear: -out * self.speed_rad_s.powi(2),
                angular: DVec3::Z * (-a * w * w * rotation_sin),
            },
        }
    }
}

/// A force for a while, across the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// Size \[N\].
    pub force_n: f64,
    /// When it begins and ends \[s\].
    pub during_s: [f64; 2],
    /// With the direction (v_y, v_x), which is not orthogonal, as in the thesis' code.
    pub as_published: bool,
}

impl Push {
    /// The force at a time, on a body of this velocity \[N\].
    #[must_use]
    pub fn force(&self, time_s: f64, velocity: DVec3) -> DVec3 {
        let [from, to] = self.during_s;
        if time_s < from - 1e-9 || time_s > to + 1e-9 {
            return DVec3::ZERO;
        }
        let v = velocity.normalize_or_zero();
        let direction = if self.as_published {
            DVec3::new(v.y, v.x, 0.0)
        } else {
            DVec3::new(-v.y, v.x, 0.0).normalize_or_zero()
        };
        direction * self.force_n
    }
}

/// A ball (in the plane: a disc) that goes along with half the goal's transforms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Centre when the goal is where it was demonstrated \[m\].
    pub center: DVec3,
    /// Radius \[m\].
    pub radius_m: f64,
    /// How the body avoids it.
    pub avoidance: Avoidance,
}

impl Ball {
    /// Where it is when the goal frame, demonstrated at `demonstrated`, is as it is.
    #[must_use]
    pub fn at(&self, goal_frame: &MovingPose, demonstrated: &Pose) -> Obstacle {
        let shift = goal_frame.pose.position - demonstrated.position;
        let velocity = goal_frame.velocity.linear * 0.5;
        Obstacle::sphere(self.center + shift * 0.5, self.radius_m, velocity)
    }

    /// Whether the task can be done: while the goal goes round, neither the goal nor the start is in
    /// the ball or nearer to it than `room_m`.
    #[must_use]
    pub fn leaves_room(&self, conditions: &Conditions, room_m: f64) -> bool {
        let goal_frame = conditions.frames[1];
        let lever = conditions.goal(&MovingPose::at_rest(goal_frame)).position;
        (0..24).all(|i| {
            let angle = std::f64::consts::TAU * f64::from(i) / 24.0;
            let out = DVec3::new(angle.cos(), angle.sin(), 0.0) * conditions.goal_motion.radius_m;
            let center = self.center + out * 0.5;
            let free = |p: DVec3| (p - center).length() > self.radius_m + room_m;
            free(lever + out) && (i > 0 || free(conditions.start.pose.position))
        })
    }
}

/// The conditions of a rollout.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// Space in which the body moves.
    pub manifold: Manifold,
    /// Frames of the skill; the second is the goal's.
    pub frames: Vec<Pose>,
    /// The goal seen from the goal frame.
    pub grasp: Pose,
    /// The body at the start.
    pub start: Body,
    /// As in the thesis, the goal stops when the body is near the goal that the policy itself has.
    pub own_goal: bool,
    /// Step \[s\].
    pub step_s: f64,
    /// Longest duration \[s\].
    pub duration_s: f64,
    /// How the goal frame moves.
    pub goal_motion: GoalMotion,
    /// What pushes.
    pub push: Option<Push>,
    /// What is in the way.
    pub ball: Option<Ball>,
    /// By what the lengths are multiplied by which a rollout is ended (see [`SkillSet::scale`]).
    pub scale: f64,
}

impl Conditions {
    /// The frames of a demonstration, at rest.
    #[must_use]
    pub fn demonstrated(set: &SkillSet, demonstration: usize) -> Self {
        let demonstrated = &set.demonstrations[demonstration];
        let frames = [demonstrated.start, demonstrated.goal_frame]
            .into_iter()
            .chain(demonstrated.other_frames.values().copied());
        Self {
            manifold: set.manifold,
            frames: frames.collect(),
            grasp: mean_goal(&set.demonstrations),
            start: Body::at_rest(set.motion(demonstration)[0]),
            own_goal: false,
            step_s: STEP_S,
            duration_s: DURATION_S,
            goal_motion: GoalMotion::default(),
            push: None,
            ball: None,
            scale: set.scale(),
        }
    }

    /// The goal for a pose of the goal frame.
    #[must_use]
    pub fn goal(&self, goal_frame: &MovingPose) -> Pose {
        goal_frame.pose.compose(&self.grasp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orthogonal_push_does_no_work_and_a_published_one_does() {
        let velocity = DVec3::new(0.6, 0.8, 0.0);
        let push = Push { force_n: 10.0, during_s: [0.5, 1.5], as_published: false };
        assert!(push.force(1.0, velocity).dot(velocity).abs() < 1e-12);
        assert!((push.force(1.0, velocity).length() - 10.0).abs() < 1e-12);
        assert_eq!(push.force(0.4, velocity), DVec3::ZERO);
        let published = Push { as_published: true, ..push };
        assert!((published.force(1.0, velocity).dot(velocity) - 9.6).abs() < 1e-12);
    }
}
