//! The skill's frames and the obstacles, checked, with the frames' accelerations.

use glam::{DQuat, DVec3};
use tprmp_messages::{
    Frame, NAME_CAPACITY, OBSTACLE_CAPACITY, ObstacleKind, PublishedFrames, Reason,
};
use tprmp_model::controller_config::FrameObserver;
use tprmp_rmpflow::leaves::{Obstacle, Shape};
use tprmp_rmpflow::policy::FRAME_CAPACITY;
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

/// Farther away than any frame or obstacle is believed to be \[m\].
const NOWHERE: DVec3 = DVec3::new(0.0, 0.0, 1e6);

/// The frames a skill needs and the obstacles, checked, in fixed storage.
#[derive(Debug)]
pub struct Scene {
    names: Vec<[u8; NAME_CAPACITY]>,
    /// Those that have to be published.
    needed: Vec<[u8; NAME_CAPACITY]>,
    /// Which of them are where the tool is when the skill starts.
    at_tool: Vec<bool>,
    /// The publisher of states with which the skill started at the tool, by its number.
    started_with: Option<u32>,
    /// In the order of the names, as they were announced.
    announced: Vec<MovingPose>,
    /// Where they will be.
    frames: Vec<MovingPose>,
    /// How far ahead everything is seen \[s\].
    ahead_s: f64,
    goal_frame: usize,
    obstacles: [Obstacle; OBSTACLE_CAPACITY],
    obstacle_count: usize,
    /// Whether obstacles were believed once.
    known: bool,
    /// When each frame was measured.
    times_ns: Vec<Option<u64>>,
}

impl Scene {
    /// A scene of these frames, none of them known yet; the goal is fixed to that of index `goal_frame`.
    ///
    /// # Panics
    /// When there are more than [`FRAME_CAPACITY`] frames, or the goal's is none of them.
    #[must_use]
    pub fn new(names: Vec<[u8; NAME_CAPACITY]>, goal_frame: usize) -> Self {
        assert!(names.len() <= FRAME_CAPACITY && goal_frame < names.len(), "frames of a model");
        let nothing = Obstacle::sphere(DVec3::NAN, 0.0, DVec3::ZERO);
        Self {
            announced: vec![MovingPose::at_rest(Pose::IDENTITY); names.len()],
            frames: vec![MovingPose::at_rest(Pose::IDENTITY); names.len()],
            times_ns: vec![None; names.len()],
            ahead_s: 0.0,
            needed: names.clone(),
            at_tool: vec![false; names.len()],
            started_with: None,
            names,
            goal_frame,
            obstacles: [nothing; OBSTACLE_CAPACITY],
            obstacle_count: 0,
            known: false,
        }
    }

    /// This scene with frames that nobody has to publish: `at_tool` says of each whether it is where the tool is
    /// when the skill starts. Allocates: at start-up only.
    ///
    /// # Panics
    /// When it does not say so of each.
    #[must_use]
    pub fn starting_at_tool(self, at_tool: Vec<bool>) -> Self {
        assert_eq!(at_tool.len(), self.names.len(), "a mark for each frame");
        let published = self.names.iter().zip(&at_tool).filter(|(_, at_tool)| !**at_tool);
        Self { needed: published.map(|(name, _)| *name).collect(), at_tool, ..self }
    }

    /// Whether frames wait for the skill to start at the tool, with this publisher of states: one that is
    /// started again starts the skill again.
    #[must_use]
    pub fn awaits_start(&self, publisher: u32) -> bool {
        self.started_with != Some(publisher) && self.at_tool.contains(&true)
    }

    /// Lets the skill start at this tool.
    pub fn start_at(&mut self, tool: &Pose, publisher: u32) {
        for (i, _) in self.at_tool.iter().enumerate().filter(|(_, at_tool)| **at_tool) {
            self.announced[i] = MovingPose::at_rest(*tool);
            self.frames[i] = self.announced[i];
        }
        self.started_with = Some(publisher);
    }

    /// Where a frame that nobody has to publish is published all the same.
    pub fn published_starts<'a>(
        &'a self,
        published: &'a PublishedFrames<'_>,
    ) -> impl Iterator<Item = &'a Frame> + 'a {
        let names = self.names.iter().zip(&self.at_tool).filter(|(_, at_tool)| **at_tool);
        let claims = names.flat_map(|(name, _)| published.claims(name));
        claims.map(|claim| claim.frame).filter(|frame| frame.valid == 1)
    }

    /// This scene as it will be in `ahead_s` \[s\], when an arm with a lag has come to where it is told to be:
    /// p′ = p + T ṗ, ṗ′ = ṗ + T p̈. That is the inverse of a lag of first order.
    #[must_use]
    pub fn seen_ahead(self, ahead_s: f64) -> Self {
        Self { ahead_s, ..self }
    }

    /// The skill's frames, in its order.
    #[must_use]
    pub fn frames(&self) -> &[MovingPose] {
        &self.frames
    }

    /// Their names.
    #[must_use]
    pub fn names(&self) -> &[[u8; NAME_CAPACITY]] {
        &self.names
    }

    /// The names of those that have to be published.
    #[must_use]
    pub fn needed(&self) -> &[[u8; NAME_CAPACITY]] {
        &self.needed
    }

    /// Which of the frames the goal is fixed to.
    #[must_use]
    pub fn goal_frame(&self) -> usize {
        self.goal_frame
    }

    /// The obstacles.
    #[must_use]
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles[..self.obstacle_count]
    }

    /// Leaves an obstacle out until the next update. Its place stays, by which others are known.
    pub fn leave_out(&mut self, index: usize) {
        self.obstacles[index] = Obstacle::sphere(NOWHERE, 0.0, DVec3::ZERO);
    }

    /// Whether obstacles were believed once.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.known
    }

    /// Takes over the obstacles of another scene.
    pub fn keep_obstacles(&mut self, other: &Self) {
        self.obstacles = other.obstacles;
        (self.obstacle_count, self.known) = (other.obstacle_count, other.known);
    }

    /// Updates with what all sources have published, all of it or nothing.
    ///
    /// # Errors
    /// The reason for which the arm has to stop; the scene is as it was.
    pub fn update(
        &mut self,
        published: &PublishedFrames<'_>,
        observer: &FrameObserver,
    ) -> Result<(), Reason> {
        check_sources(published)?;
        let mut now = [(MovingPose::at_rest(Pose::IDENTITY), 0); FRAME_CAPACITY];
        let all = now.iter_mut().zip(&self.names).zip(&self.at_tool);
        for ((now, name), _) in all.filter(|(_, at_tool)| !**at_tool) {
            let found = published.find(name)?;
            found.frame.check()?;
            *now = (moving_pose(found.frame), found.message.time_ns);
        }
        let mut obstacles = self.obstacles;
        let mut count = 0;
        for message in published.messages() {
            for obstacle in message.present()? {
                let kind = obstacle.check()?;
                *obstacles.get_mut(count).ok_or(Reason::ObstacleCount)? = shaped(obstacle, kind);
                count += 1;
            }
        }
        for (i, (now, time_ns)) in now.iter().enumerate().take(self.names.len()) {
            if self.at_tool[i] {
                continue;
            }
            let last_ns = self.times_ns[i].replace(*time_ns);
            let elapsed_s = last_ns.map(|last| time_ns.saturating_sub(last) as f64 * 1e-9);
            self.announced[i] = observed(&self.announced[i], now, elapsed_s, observer);
            self.frames[i] = moved(&self.announced[i], self.ahead_s);
        }
        if self.ahead_s > 0.0 {
            for obstacle in &mut obstacles[..count] {
                obstacle.pose = displaced(&obstacle.pose, &obstacle.velocity, self.ahead_s);
            }
        }
        self.obstacles = obstacles;
        self.obstacle_count = count;
        self.known = true;
        Ok(())
    }
}

/// What holds of each source by itself, and of all of them together.
fn check_sources(published: &PublishedFrames<'_>) -> Result<(), Reason> {
    if published.named_twice().is_some() {
        return Err(Reason::FrameTwice);
    }
    if published.left_out().is_some() {
        return Err(Reason::FrameCount);
    }
    for message in published.messages().filter(|message| published.is_fresh(message)) {
        // Also frames that the skill does not need: a number that is none makes all others doubtful.
        for frame in message.listed()?.iter().filter(|frame| frame.valid == 1) {
            frame.check()?;
        }
    }
    Ok(())
}

/// A frame whose acceleration is smaller has none [m/s² or rad/s²].
const ACCELERATION_REST: f64 = 1e-9;

/// The frame as it is now, with an acceleration of limited size: the filtered derivative of its
/// velocity.
fn observed(
    last: &MovingPose,
    now: &MovingPose,
    elapsed_s: Option<f64>,
    observer: &FrameObserver,
) -> MovingPose {
    let (mut linear, mut angular) = (DVec3::ZERO, DVec3::ZERO);
    if let Some(elapsed_s) = elapsed_s {
        linear = last.acceleration.linear;
        angular = last.acceleration.angular;
        if elapsed_s > 0.0 {
            let fraction = elapsed_s / (elapsed_s + observer.time_constant_s);
            let rate = (now.velocity.linear - last.velocity.linear) / elapsed_s;
            linear += (rate - linear) * fraction;
            let rate = (now.velocity.angular - last.velocity.angular) / elapsed_s;
            angular += (rate - angular) * fraction;
        }
    }
    // Velocities at the edge of what a number holds must not stay in the filter.
    if !(linear.is_finite() && angular.is_finite()) {
        (linear, angular) = (DVec3::ZERO, DVec3::ZERO);
    }
    // A frame that comes to rest would leave ever smaller numbers, at last subnormal ones, with which
    // processors are slow.
    let rest = |a: DVec3| if a.length() < ACCELERATION_REST { DVec3::ZERO } else { a };
    let (linear_max, angular_max) =
        (observer.linear_acceleration_max_m_s2, observer.angular_acceleration_max_rad_s2);
    MovingPose {
        acceleration: SpatialAcceleration {
            linear: rest(linear.clamp_length_max(linear_max)),
            angular: rest(angular.clamp_length_max(angular_max)),
        },
        ..*now
    }
}

/// A frame after `time_s` \[s\].
fn moved(frame: &MovingPose, time_s: f64) -> MovingPose {
    if time_s <= 0.0 {
        return *frame;
    }
    let mut moved = *frame;
    moved.pose = displaced(&frame.pose, &frame.velocity, time_s);
    moved.velocity.linear += frame.acceleration.linear * time_s;
    moved.velocity.angular += frame.acceleration.angular * time_s;
    moved
}

/// A pose after `time_s` \[s\] at a constant velocity.
fn displaced(pose: &Pose, velocity: &Twist, time_s: f64) -> Pose {
    Pose {
        position: pose.position + velocity.linear * time_s,
        orientation: DQuat::from_scaled_axis(velocity.angular * time_s) * pose.orientation,
    }
}

/// The pose of a checked frame.
#[must_use]
pub fn pose(frame: &Frame) -> Pose {
    Pose { position: frame.position.into(), orientation: unit(frame.quaternion) }
}

fn unit([w, x, y, z]: [f64; 4]) -> DQuat {
    DQuat::from_xyzw(x, y, z, w).normalize()
}

/// A checked frame.
fn moving_pose(frame: &Frame) -> MovingPose {
    MovingPose {
        velocity: Twist {
            linear: frame.linear_velocity.into(),
            angular: frame.angular_velocity.into(),
        },
        ..MovingPose::at_rest(pose(frame))
    }
}

/// A checked obstacle.
fn shaped(obstacle: &tprmp_messages::Obstacle, kind: ObstacleKind) -> Obstacle {
    let [x, y, z] = obstacle.size;
    let (shape, rotates) = match kind {
        ObstacleKind::Sphere => (Shape::Sphere { radius: x }, false),
        ObstacleKind::Capsule => (Shape::Capsule { radius: x, half_length: 0.5 * y }, true),
        ObstacleKind::Box => (Shape::Box { half_size: 0.5 * DVec3::new(x, y, z) }, true),
        ObstacleKind::HalfSpace => (Shape::HalfSpace, true),
    };
    // A ball looks the same from all sides: its orientation may be left out.
    Obstacle {
        shape,
        pose: Pose {
            position: obstacle.position.into(),
            orientation: if rotates { unit(obstacle.quaternion) } else { DQuat::IDENTITY },
        },
        velocity: Twist {
            linear: obstacle.linear_velocity.into(),
            angular: if rotates { obstacle.angular_velocity.into() } else { DVec3::ZERO },
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_messages::{TaskFrames, name_bytes};

    const OBSERVER: FrameObserver = FrameObserver {
        time_constant_s: 0.02,
        linear_acceleration_max_m_s2: 30.0,
        angular_acceleration_max_rad_s2: 60.0,
    };

    fn message() -> TaskFrames {
        let frame = |name: &str| Frame {
            name: name_bytes(name).unwrap(),
            valid: 1,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            ..Default::default()
        };
        let mut message =
            TaskFrames { frame_count: 2, obstacle_count: 1, time_ns: 1, ..Default::default() };
        message.frames[0] = frame("start");
        message.frames[1] = frame("end");
        message.obstacles[0] = tprmp_messages::Obstacle {
            valid: 1,
            quaternion: [1.0, 0.0, 0.0, 0.0],
            size: [0.06, 0.0, 0.0],
            ..Default::default()
        };
        message
    }

    fn cuboid(message: &mut TaskFrames) -> &mut tprmp_messages::Obstacle {
        let obstacle = &mut message.obstacles[0];
        obstacle.kind = ObstacleKind::Box.to_wire();
        obstacle.size = [0.1, 0.2, 0.3];
        obstacle
    }

    #[test]
    fn every_kind_of_obstacle_is_read_with_its_size_and_motion() {
        let mut scene = scene();
        let mut message = message();
        message.obstacle_count = 3;
        message.obstacles[1] = message.obstacles[0];
        message.obstacles[1].kind = ObstacleKind::Capsule.to_wire();
        message.obstacles[1].size = [0.05, 0.4, 0.0];
        message.obstacles[1].angular_velocity = [0.0, 1.0, 0.0];
        message.obstacles[2] = *cuboid(&mut message.clone());
        message.obstacles[2].linear_velocity = [0.1, 0.0, 0.0];
        update(&mut scene, &message).unwrap();
        let [ball, capsule, cuboid] = scene.obstacles() else { panic!("three obstacles") };
        assert_eq!(ball.shape, Shape::Sphere { radius: 0.06 });
        assert_eq!(capsule.shape, Shape::Capsule { radius: 0.05, half_length: 0.2 });
        assert_eq!(capsule.velocity.angular, DVec3::Y);
        assert_eq!(cuboid.shape, Shape::Box { half_size: DVec3::new(0.05, 0.1, 0.15) });
        assert_eq!(cuboid.velocity.linear, DVec3::X * 0.1);
    }

    /// Updates with one source alone.
    fn update(scene: &mut Scene, message: &TaskFrames) -> Result<(), Reason> {
        scene.update(&PublishedFrames::of(&[message], message.time_ns, 1), &OBSERVER)
    }

    fn scene() -> Scene {
        Scene::new(["start", "end"].map(|name| name_bytes(name).unwrap()).to_vec(), 1)
    }

    #[test]
    fn a_start_frame_at_the_tool_is_not_needed_and_stays_until_another_publisher_comes() {
        let mut scene = scene().starting_at_tool(vec![true, false]);
        let mut message = message();
        (message.frame_count, message.frames[0]) = (1, message.frames[1]);
        update(&mut scene, &message).unwrap();
        assert_eq!(scene.needed(), &[name_bytes("end").unwrap()]);
        assert!(scene.awaits_start(1));
        let tool = Pose { position: DVec3::new(0.1, 0.2, 0.3), ..Pose::IDENTITY };
        scene.start_at(&tool, 1);
        update(&mut scene, &message).unwrap();
        assert_eq!(scene.frames()[0].pose, tool);
        assert!(!scene.awaits_start(1) && scene.awaits_start(2));
        message.frames[0].name = name_bytes("other").unwrap();
        assert_eq!(update(&mut scene, &message), Err(Reason::FrameMissing));
    }

    #[test]
    fn an_arm_with_a_lag_sees_everything_where_it_will_be() {
        let mut scene = scene().seen_ahead(0.1);
        let mut message = message();
        message.frames[1].linear_velocity = [0.2, 0.0, 0.0];
        message.frames[1].angular_velocity = [0.0, 0.0, 0.5];
        message.obstacles[0].linear_velocity = [0.0, 0.3, 0.0];
        update(&mut scene, &message).unwrap();
        let pose = scene.frames()[1].pose;
        assert!((pose.position - DVec3::X * 0.02).length() < 1e-12);
        assert!((pose.orientation - DQuat::from_rotation_z(0.05)).length() < 1e-12);
        assert!((scene.obstacles()[0].pose.position - DVec3::Y * 0.03).length() < 1e-12);
        // What was announced is not moved twice.
        message.time_ns += 2_000_000;
        update(&mut scene, &message).unwrap();
        assert_eq!(scene.frames()[1].pose, pose);
        assert_eq!(scene.frames()[1].acceleration.linear, DVec3::ZERO);
    }

    #[test]
    fn every_defect_has_its_reason_and_changes_nothing() {
        type Edit = fn(&mut TaskFrames);
        let cases: [(Edit, Reason); 21] = [
            (|m| m.obstacles[0].position[0] = 1e200, Reason::FrameNotFinite),
            (|m| m.frames[1].linear_velocity[0] = -1e200, Reason::FrameNotFinite),
            (|m| m.obstacles[0].valid = 255, Reason::ObstacleUnknown),
            (|m| m.frames[1].valid = 0, Reason::FrameMissing),
            (|m| m.frames[1].position[0] = 512.0, Reason::FrameFar),
            (|m| m.obstacles[0].size[0] = 0.0, Reason::ObstacleSize),
            (|m| m.frame_count = 1, Reason::FrameMissing),
            (|m| m.frame_count = 99, Reason::FrameCount),
            (|m| m.frames[0].name[0] = b'x', Reason::FrameMissing),
            (|m| m.frames[0].position[2] = f64::NAN, Reason::FrameNotFinite),
            (|m| m.frames[1].angular_velocity[0] = f64::INFINITY, Reason::FrameNotFinite),
            (|m| m.frames[1].quaternion = [1.1, 0.0, 0.0, 0.0], Reason::QuaternionNotUnit),
            (|m| m.obstacle_count = 99, Reason::ObstacleCount),
            (|m| m.obstacles[0].kind = 7, Reason::ObstacleUnknown),
            (|m| m.obstacles[0].size[0] = -1.0, Reason::ObstacleSize),
            (|m| m.obstacles[0].linear_velocity[1] = f64::NAN, Reason::FrameNotFinite),
            (|m| m.obstacles[0].angular_velocity[1] = f64::NAN, Reason::FrameNotFinite),
            (|m| cuboid(m).size[2] = -0.1, Reason::ObstacleSize),
            (|m| m.obstacles[0].size[0] = 60.0, Reason::ObstacleSize),
            (|m| cuboid(m).quaternion[0] = 0.9, Reason::ObstacleQuaternion),
            (|m| cuboid(m).size[1] = f64::INFINITY, Reason::FrameNotFinite),
        ];
        for (i, (edit, reason)) in cases.into_iter().enumerate() {
            let mut scene = scene();
            update(&mut scene, &message()).unwrap();
            let mut bad = message();
            bad.frames[0].position[0] = 9.0;
            edit(&mut bad);
            assert_eq!(update(&mut scene, &bad), Err(reason), "case {i}");
            assert_eq!(scene.frames()[0].pose.position.x, 0.0, "case {i}");
            assert_eq!(scene.obstacles().len(), 1, "case {i}");
        }
    }

    #[test]
    fn the_observer_finds_the_acceleration_of_a_circle_and_believes_no_jump() {
        let mut scene = scene();
        let mut message = message();
        let (radius, omega) = (0.15, 0.94);
        for step in 0..2000_u32 {
            let t = f64::from(step) * 0.002;
            message.time_ns = 1 + u64::from(step) * 2_000_000;
            let (s, c) = (omega * t).sin_cos();
            message.frames[1].linear_velocity = [-s * radius * omega, c * radius * omega, 0.0];
            update(&mut scene, &message).unwrap();
            if step > 100 {
                let exact = DVec3::new(-c, -s, 0.0) * (radius * omega * omega);
                let error = (scene.frames()[1].acceleration.linear - exact).length();
                assert!(error < 0.03 * exact.length(), "{error}");
            }
        }
        for _ in 0..2000 {
            message.time_ns += 2_000_000;
            update(&mut scene, &message).unwrap();
        }
        assert_eq!(scene.frames()[1].acceleration.linear, DVec3::ZERO, "at a constant velocity");
        message.time_ns += 2_000_000;
        message.frames[1].linear_velocity = [1e6, 0.0, 0.0];
        update(&mut scene, &message).unwrap();
        assert!(scene.frames()[1].acceleration.linear.length() < 30.0 + 1e-9);
    }

    /// A source of other frames and obstacles than those of `message`.
    fn other(name: &str, obstacles: u32) -> TaskFrames {
        let mut other = TaskFrames::of_source(name).unwrap();
        other.obstacles = [message().obstacles[0]; OBSTACLE_CAPACITY];
        (other.time_ns, other.obstacle_count) = (1, obstacles);
        other
    }

    #[test]
    fn frames_come_from_several_sources_and_obstacles_from_all_of_them() {
        let (mut start, mut end) = (message(), other("camera", 2));
        start.frame_count = 1;
        (end.frame_count, end.frames[0]) = (1, message().frames[1]);
        end.frames[0].position[0] = 0.5;
        let mut scene = scene();
        scene.update(&PublishedFrames::of(&[&start, &end], 1, 1), &OBSERVER).unwrap();
        assert_eq!(scene.frames()[1].pose.position, DVec3::X * 0.5);
        assert_eq!(scene.obstacles().len(), 3);
        end.frame_count = 2;
        end.frames[1] = message().frames[0];
        let twice = scene.update(&PublishedFrames::of(&[&start, &end], 1, 1), &OBSERVER);
        assert_eq!(twice, Err(Reason::FrameTwice));
    }

    #[test]
    fn one_source_does_not_disturb_how_another_s_frames_accelerate() {
        let (mut fast, slow) = (message(), other("slow", 0));
        let mut scene = scene();
        for step in 0..1000_u32 {
            fast.time_ns = 1 + u64::from(step / 2) * 2_000_000;
            fast.frames[1].linear_velocity[0] = f64::from(step / 2) * 2e-3;
            let published = PublishedFrames::of(&[&fast, &slow], fast.time_ns, u64::MAX);
            scene.update(&published, &OBSERVER).unwrap();
        }
        assert!((scene.frames()[1].acceleration.linear.x - 1.0).abs() < 1e-6);
    }

    #[test]
    fn obstacles_of_all_sources_together_are_at_most_as_many_as_are_carried() {
        let (message, most) = (message(), OBSTACLE_CAPACITY as u32);
        for (count, expected) in [(most - 1, Ok(())), (most, Err(Reason::ObstacleCount))] {
            let other = other("tracker", count);
            let published = PublishedFrames::of(&[&message, &other], 1, 1);
            assert_eq!(scene().update(&published, &OBSERVER), expected);
        }
    }
}
