//! What a seed draws from a scene, and how frames and obstacle move in it: closed formulas with
//! exact velocities.

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};

use crate::error::SimError;
use crate::scene::{Range, Scene};
use crate::shape::{PlanarPose, Stroke};

/// A seed draws at most so many obstacles until one leaves start and goal free.
const DRAWS_MAX: usize = 1000;

/// What a seed drew; lengths in `B`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Episode {
    pub(crate) seed: u64,
    pub(crate) start_position_m: [f64; 2],
    pub(crate) start_angle_rad: f64,
    pub(crate) goal: Goal,
    pub(crate) obstacle: Obstacle,
    pub(crate) push: Option<Push>,
}

/// The goal frame's origin goes round a circle, while the frame rotates to and fro.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Goal {
    pub(crate) centre_m: [f64; 2],
    pub(crate) circle_radius_m: f64,
    /// Negative: clockwise.
    pub(crate) circle_speed_rad_s: f64,
    pub(crate) circle_phase_rad: f64,
    pub(crate) rotation_amplitude_rad: f64,
    pub(crate) rotation_speed_rad_s: f64,
    pub(crate) rotation_phase_rad: f64,
}

/// The ball swings about a point of the stroke, through which it comes at the crossing time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Obstacle {
    pub(crate) radius_m: f64,
    pub(crate) crossing_m: [f64; 2],
    pub(crate) crossing_time_s: f64,
    /// Unit vector.
    pub(crate) direction: [f64; 2],
    pub(crate) swing_m: f64,
    pub(crate) speed_rad_s: f64,
}

/// A force on the point for a short time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Push {
    pub(crate) force_n: [f64; 2],
    pub(crate) time_s: f64,
    pub(crate) duration_s: f64,
}

/// A planar frame and its velocity, in `B`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FrameAt {
    pub(crate) pose: PlanarPose,
    /// \[m/s\]
    pub(crate) velocity_m_s: DVec2,
    /// About z \[rad/s\].
    pub(crate) angular_velocity_rad_s: f64,
}

/// The obstacle's centre and its velocity, in `B`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ObstacleAt {
    pub(crate) position_m: DVec2,
    /// \[m/s\]
    pub(crate) velocity_m_s: DVec2,
}

impl Goal {
    pub(crate) fn at(&self, time_s: f64) -> FrameAt {
        let phase = self.circle_speed_rad_s * time_s + self.circle_phase_rad;
        let rotation = self.rotation_speed_rad_s * time_s + self.rotation_phase_rad;
        let arm = self.circle_radius_m * DVec2::from_angle(phase);
        FrameAt {
            pose: PlanarPose {
                position_m: DVec2::from(self.centre_m) + arm,
                angle_rad: self.rotation_amplitude_rad * rotation.sin(),
            },
            velocity_m_s: self.circle_speed_rad_s * arm.perp(),
            angular_velocity_rad_s: self.rotation_amplitude_rad
                * self.rotation_speed_rad_s
                * rotation.cos(),
        }
    }
}

impl Obstacle {
    pub(crate) fn at(&self, time_s: f64) -> ObstacleAt {
        let (sin, cos) = (self.speed_rad_s * (time_s - self.crossing_time_s)).sin_cos();
        let swing = self.swing_m * DVec2::from(self.direction);
        ObstacleAt {
            position_m: DVec2::from(self.crossing_m) + swing * sin,
            velocity_m_s: swing * (self.speed_rad_s * cos),
        }
    }

    /// Least distance of its centre from a point, over all times \[m\].
    fn distance_min(&self, point: DVec2) -> f64 {
        let direction = DVec2::from(self.direction);
        let between = point - DVec2::from(self.crossing_m);
        let along = between.dot(direction).clamp(-self.swing_m, self.swing_m);
        (between - along * direction).length()
    }
}

impl Push {
    /// The force at a time \[N\].
    pub(crate) fn at(&self, time_s: f64) -> DVec2 {
        let on = (self.time_s..self.time_s + self.duration_s).contains(&time_s);
        if on { self.force_n.into() } else { DVec2::ZERO }
    }
}

impl Episode {
    /// The start frame.
    pub(crate) fn start(&self) -> PlanarPose {
        PlanarPose { position_m: self.start_position_m.into(), angle_rad: self.start_angle_rad }
    }

    /// Draws the episode of a seed, for a point of radius `point_radius_m`. With or without a
    /// push, all else is the same.
    pub(crate) fn draw(
        scene: &Scene,
        seed: u64,
        point_radius_m: f64,
        with_push: bool,
    ) -> Result<Self, SimError> {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |range: &Range| range.draw(&mut generator);
        let stroke = Stroke::lying_s(&scene.record);
        let settings = &scene.push;
        let push = Push {
            force_n: (draw(&settings.force_n) * DVec2::from_angle(draw(&settings.direction_rad)))
                .into(),
            time_s: draw(&settings.time_s),
            duration_s: settings.duration_s,
        };
        let settings = &scene.start;
        let offset = DVec2::new(draw(&settings.offset_x_m), draw(&settings.offset_y_m));
        let start = PlanarPose {
            position_m: stroke.start() + offset,
            angle_rad: draw(&settings.angle_rad),
        };
        let settings = &scene.goal;
        let offset = DVec2::new(draw(&settings.offset_x_m), draw(&settings.offset_y_m));
        let goal = Goal {
            centre_m: (stroke.end() + offset).into(),
            circle_radius_m: settings.circle_radius_m,
            circle_speed_rad_s: draw(&settings.circle_speed_rad_s) * draw_sign(&mut draw),
            circle_phase_rad: draw(&settings.circle_phase_rad),
            rotation_amplitude_rad: draw(&settings.rotation_amplitude_rad),
            rotation_speed_rad_s: draw(&settings.rotation_speed_rad_s),
            rotation_phase_rad: draw(&settings.rotation_phase_rad),
        };
        for _ in 0..DRAWS_MAX {
            let obstacle = draw_obstacle(scene, &stroke, &start, &goal, &mut draw);
            let size = obstacle.radius_m + point_radius_m;
            let from_start = obstacle.distance_min(start.position_m) - size;
            let from_goal =
                obstacle.distance_min(goal.centre_m.into()) - size - goal.circle_radius_m;
            if from_start >= scene.obstacle.start_clearance_min_m
                && from_goal >= scene.obstacle.goal_clearance_min_m
            {
                return Ok(Self {
                    seed,
                    start_position_m: start.position_m.into(),
                    start_angle_rad: start.angle_rad,
                    goal,
                    obstacle,
                    push: with_push.then_some(push),
                });
            }
        }
        let problem = format!(
            "expected ranges that leave the start {} m and the goal's circle {} m of clearance, \
             found none in {DRAWS_MAX} draws of seed {seed}",
            scene.obstacle.start_clearance_min_m, scene.obstacle.goal_clearance_min_m
        );
        Err(SimError::key(&scene.file, "obstacle", problem))
    }
}

fn draw_sign(draw: &mut impl FnMut(&Range) -> f64) -> f64 {
    if draw(&Range { low: -1.0, high: 1.0 }) < 0.0 { -1.0 } else { 1.0 }
}

fn draw_obstacle(
    scene: &Scene,
    stroke: &Stroke,
    start: &PlanarPose,
    goal: &Goal,
    draw: &mut impl FnMut(&Range) -> f64,
) -> Obstacle {
    let settings = &scene.obstacle;
    let crossing_time_s = draw(&settings.crossing_time_s);
    let fraction = draw(&settings.crossing_fraction);
    let end = goal.at(crossing_time_s).pose;
    let on_stroke = |fraction: f64| stroke.between(start, &end, fraction);
    let tangent =
        (on_stroke(fraction + 0.005) - on_stroke(fraction - 0.005)).normalize_or(DVec2::X);
    let across = DVec2::from_angle(draw(&settings.crossing_angle_rad)).rotate(tangent.perp());
    let swing_m = draw(&settings.swing_m);
    Obstacle {
        radius_m: draw(&settings.radius_m),
        crossing_m: on_stroke(fraction).into(),
        crossing_time_s,
        direction: (across * draw_sign(draw)).into(),
        swing_m,
        speed_rad_s: draw(&settings.crossing_speed_m_s) / swing_m,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::scene::tests::scene;

    const RADIUS: f64 = 0.05;

    pub(crate) fn episode(seed: u64) -> Episode {
        Episode::draw(&scene(), seed, RADIUS, true).unwrap()
    }

    #[test]
    fn a_seed_determines_all() {
        assert_eq!(episode(5), episode(5));
        assert_ne!(episode(5).obstacle, episode(6).obstacle);
        let calm = Episode::draw(&scene(), 5, RADIUS, false).unwrap();
        assert_eq!(calm, Episode { push: None, ..episode(5) });
    }

    #[test]
    fn velocities_agree_with_finite_differences() {
        let h = 1e-5;
        for seed in 0..20 {
            let episode = episode(seed);
            for i in 0..50 {
                let t = 0.37 * f64::from(i);
                let (before, now, after) =
                    (episode.goal.at(t - h), episode.goal.at(t), episode.goal.at(t + h));
                let linear = (after.pose.position_m - before.pose.position_m) / (2.0 * h);
                let angular = (after.pose.angle_rad - before.pose.angle_rad) / (2.0 * h);
                assert!((linear - now.velocity_m_s).length() < 1e-8);
                assert!((angular - now.angular_velocity_rad_s).abs() < 1e-8);
                let linear = (episode.obstacle.at(t + h).position_m
                    - episode.obstacle.at(t - h).position_m)
                    / (2.0 * h);
                assert!((linear - episode.obstacle.at(t).velocity_m_s).length() < 1e-8);
            }
        }
    }

    #[test]
    fn the_obstacle_crosses_the_stroke_but_leaves_start_and_goal_free() {
        let scene = scene();
        for seed in 0..200 {
            let Episode { start_position_m, goal, obstacle, .. } = episode(seed);
            let crossing = obstacle.at(obstacle.crossing_time_s);
            assert_eq!(crossing.position_m, DVec2::from(obstacle.crossing_m));
            assert!(crossing.velocity_m_s.length() >= scene.obstacle.crossing_speed_m_s.low - 1e-9);
            for i in 0..600 {
                let t = 0.05 * f64::from(i);
                let at = obstacle.at(t).position_m;
                let size = RADIUS + obstacle.radius_m;
                let clear = |point: DVec2| (at - point).length() - size;
                assert!(clear(start_position_m.into()) >= scene.obstacle.start_clearance_min_m);
                let goal = goal.at(t).pose.position_m;
                assert!(clear(goal) >= scene.obstacle.goal_clearance_min_m - 1e-9, "seed {seed}");
            }
        }
    }

    #[test]
    fn ranges_that_leave_no_room_are_an_error() {
        let mut scene = scene();
        scene.obstacle.goal_clearance_min_m = 4.0;
        let error = Episode::draw(&scene, 1, RADIUS, false).unwrap_err().to_string();
        assert!(error.contains("`obstacle`") && error.contains("seed 1"), "{error}");
    }
}
