//! Random starts around demonstrated points.

use glam::{DQuat, DVec3};
use rand::Rng;
use tprmp_model::skill_model::Manifold;
use tprmp_rmpflow::policy::canonical::frame_map::Canonical;
use tprmp_spatial::{MovingPose, Pose};

use crate::canonical::{ANGLE_MAX_RAD, CanonicalSet};
use crate::demonstration::Demonstration;
use crate::skill::Skill;

/// A start with frames: one rollout of the certificate.
pub(crate) struct Start {
    /// Frames, in the order of the skill.
    pub frames: Vec<MovingPose>,
    /// Pose of the tool.
    pub pose: Pose,
    /// Where it should end.
    pub goal: Pose,
}

/// Draws starts.
pub(crate) struct Starts<'a> {
    /// The skill.
    pub skill: &'a Skill,
    /// Its demonstrations …
    pub demonstrations: &'a [Demonstration],
    /// … in canonical coordinates.
    pub set: &'a CanonicalSet,
}

impl Starts<'_> {
    /// Random starts around demonstrated points, with the frames of their demonstration or with
    /// displaced ones.
    pub(crate) fn draw(&self, count: u32, displaced: bool, random: &mut impl Rng) -> Vec<Start> {
        (0..count).map(|_| self.draw_one(displaced, random)).collect()
    }

    fn draw_one(&self, displaced: bool, random: &mut impl Rng) -> Start {
        let (skill, set) = (self.skill, self.set);
        let index = random.random_range(0..self.demonstrations.len());
        let mut frames = skill.frames(&self.demonstrations[index]);
        let demonstrated = &set.demonstrations[index];
        let sample = random.random_range(0..demonstrated.position.points.len());
        let radius = skill.certification.random_start_radius;
        let [linear, angular] = set.scales.map(|scale| radius / scale);
        let mut near = Canonical {
            position: demonstrated.position.points[sample] + self.in_ball(linear, random),
            rotation: DVec3::ZERO,
        };
        let phase = demonstrated.phases[sample][0];
        if skill.manifold.has_orientation() {
            near.rotation = (demonstrated.rotation.points[sample] + in_ball(angular, random))
                .clamp_length_max(ANGLE_MAX_RAD);
        }
        if displaced {
            frames.iter_mut().for_each(|frame| *frame = self.displaced(frame, random));
        }
        let goal_frame = frames[skill.goal_index()];
        let frames = at_rest(&frames);
        let transforms = set.map.transforms(&frames).expect("they are the skill's frames");
        let mut pose = set.map.forward(&transforms, phase, &near);
        if !skill.manifold.has_orientation() {
            pose.orientation = DQuat::IDENTITY;
        }
        let pose = skill.manifold.part_of(&pose, set.map.goal().orientation);
        Start { pose, goal: self.goal(&goal_frame), frames }
    }

    /// The goal of the demonstrations where the goal frame is.
    pub(crate) fn goal(&self, goal_frame: &Pose) -> Pose {
        let map = &self.set.map;
        goal_frame.compose(&map.goal_frame().inverse().compose(&map.goal()))
    }

    fn displaced(&self, frame: &Pose, random: &mut impl Rng) -> Pose {
        let settings = &self.skill.certification;
        let points = self.set.map.anchors().iter().map(|anchor| anchor.point);
        let from_start = points.map(|point| (point - self.set.start.position).length());
        let radius = settings.frame_translation_fraction * from_start.fold(0.0, f64::max);
        let position = frame.position + self.in_ball(radius, random);
        let rotation = if matches!(self.skill.manifold, Manifold::R2 | Manifold::R3S1) {
            DVec3::Z * (settings.frame_rotation_rad * random.random_range(-1.0..=1.0))
        } else {
            in_ball(settings.frame_rotation_rad, random)
        };
        let orientation = DQuat::from_scaled_axis(rotation) * frame.orientation;
        self.skill.manifold.part_of(&Pose { position, orientation }, frame.orientation)
    }

    /// A point in a ball, or a disc in the plane.
    fn in_ball(&self, radius: f64, random: &mut impl Rng) -> DVec3 {
        let mut point = in_ball(radius, random);
        if self.skill.manifold == Manifold::R2 {
            point.z = 0.0;
        }
        point
    }
}

/// Frames that do not move.
pub(crate) fn at_rest(frames: &[Pose]) -> Vec<MovingPose> {
    frames.iter().copied().map(MovingPose::at_rest).collect()
}

/// A point in a ball, evenly distributed.
pub(crate) fn in_ball(radius: f64, random: &mut impl Rng) -> DVec3 {
    // One try in two hits; 64 misses in a row do not happen.
    for _ in 0..64 {
        let point = DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
        if point.length() <= 1.0 {
            return point * radius;
        }
    }
    DVec3::ZERO
}
