//! The published obstacle that is what the gripper holds: it moves with the tool, which need not keep clear of it.

use glam::DVec3;
use tprmp_rmpflow::leaves::{Obstacle, Shape};

/// Which of the obstacles the gripper holds.
#[derive(Debug)]
pub struct GrippedObstacle {
    /// Its centre in the tool's frame \[m\].
    pub centre_m: DVec3,
    /// Only an obstacle that is nearer to there is it \[m\].
    pub within_m: f64,
    /// How it was seen last.
    last: Option<(Shape, DVec3)>,
}

impl GrippedObstacle {
    /// Nothing is held yet.
    #[must_use]
    pub fn new(centre_m: DVec3, within_m: f64) -> Self {
        Self { centre_m, within_m, last: None }
    }

    /// Nothing is held any more; whether something was.
    pub fn release(&mut self) -> bool {
        self.last.take().is_some()
    }

    /// Which one is held, where the object's centre is at `centre` \[m\] by the tool. Once found it is followed from where it
    /// was seen last: its publisher may see it move with the tool, late, or not at all. No allocation.
    pub fn find(&mut self, obstacles: &[Obstacle], centre: DVec3) -> Option<usize> {
        let (shape, near) = self.last.map_or((None, centre), |(shape, at)| (Some(shape), at));
        let distance = |obstacle: &Obstacle| {
            let position = obstacle.pose.position;
            let alike = shape.is_none_or(|shape| shape == obstacle.shape);
            let is_body = obstacle.shape != Shape::HalfSpace;
            let distance = position.distance(near).min(position.distance(centre));
            // What is not a number is nowhere.
            (alike && is_body && distance < self.within_m).then_some(distance)
        };
        let near = obstacles.iter().enumerate().filter_map(|(i, o)| Some((i, distance(o)?)));
        let (nearest, _) = near.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let Obstacle { shape, pose, .. } = obstacles[nearest];
        self.last = Some((shape, pose.position));
        Some(nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(x: f64, radius: f64) -> Obstacle {
        Obstacle::sphere(DVec3::X * x, radius, DVec3::ZERO)
    }

    #[test]
    fn the_nearest_one_is_held_and_followed_and_nothing_else_is() {
        let mut gripped = GrippedObstacle::new(DVec3::ZERO, 0.05);
        let floor = Obstacle { shape: Shape::HalfSpace, ..ball(0.0, 0.0) };
        let far = ball(0.1, 0.02);
        assert_eq!(gripped.find(&[floor, far], DVec3::ZERO), None);
        assert_eq!(gripped.find(&[floor, far], DVec3::NAN), None);
        assert_eq!(
            gripped.find(&[floor, ball(0.04, 0.02), ball(0.01, 0.03)], DVec3::ZERO),
            Some(2)
        );
        // Its publisher does not see it move; another one passes close by.
        let tool = DVec3::X * 0.3;
        let others = [ball(0.3, 0.02), ball(0.01, 0.03)];
        assert_eq!(gripped.find(&others, tool), Some(1));
        // It is seen at the tool again, in another place of the list.
        assert_eq!(gripped.find(&[ball(0.31, 0.03), others[0]], tool), Some(0));
        assert_eq!(gripped.find(&[others[0]], tool), None);
        assert!(gripped.release() && !gripped.release());
        assert_eq!(gripped.find(&others, tool), Some(0));
    }
}
