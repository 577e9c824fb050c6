//! The physics: a point on two prismatic joints, stepped semi-implicitly.

use glam::{DVec2, DVec3};
use nalgebra::Vector2;
use tprmp_messages::JointCommand;
use tprmp_robot::{Chain, CollisionGeometry, forward_dynamics, inverse_dynamics};

use crate::episode::Episode;
use crate::error::SimError;
use crate::scene::Scene;

/// The plane is level.
const GRAVITY_M_S2: DVec3 = DVec3::ZERO;

/// What moves the point during a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Drive {
    /// These joint forces, as far as the effort limits allow \[N\].
    Force(Vector2<f64>),
    /// Friction brakes, as strong as the effort limits allow.
    Brake,
}

/// Robot, episode and clock.
#[derive(Debug)]
pub(crate) struct World {
    chain: Chain<2>,
    pub(crate) episode: Episode,
    /// Radius of the point \[m\].
    pub(crate) point_radius_m: f64,
    dt_s: f64,
    /// Steps of the scenario's clock so far.
    steps: u64,
    /// Whether the scenario's clock runs: from the first command on.
    pub(crate) moving: bool,
    position: Vector2<f64>,
    velocity: Vector2<f64>,
    /// Applied in the last step \[N\].
    pub(crate) force: Vector2<f64>,
}

impl World {
    /// The episode of a seed, the point at rest at its start.
    pub(crate) fn new(scene: &Scene, seed: u64, with_push: bool) -> Result<Self, SimError> {
        let chain = Chain::<2>::from_urdf(&scene.robot.urdf, scene.robot.tool_link.as_str())?;
        let radius = chain.collision_shapes().iter().find_map(|shape| match shape.geometry {
            CollisionGeometry::Sphere { radius } => Some(radius),
            _ => None,
        });
        let point_radius_m = radius.ok_or_else(|| {
            let problem = "expected a collision sphere on a moving link, found none";
            SimError::key(&scene.robot.urdf, "collision", problem)
        })?;
        let episode = Episode::draw(scene, seed, point_radius_m, with_push)?;
        let [x, y] = episode.start_position_m;
        Ok(Self {
            chain,
            episode,
            point_radius_m,
            dt_s: 1.0 / f64::from(scene.physics.rate_hz),
            steps: 0,
            moving: false,
            position: Vector2::new(x, y),
            velocity: Vector2::zeros(),
            force: Vector2::zeros(),
        })
    }

    /// The scenario's clock \[s\].
    pub(crate) fn time_s(&self) -> f64 {
        self.steps as f64 * self.dt_s
    }

    /// Joint positions \[m\].
    pub(crate) fn position(&self) -> DVec2 {
        DVec2::new(self.position[0], self.position[1])
    }

    /// Joint velocities \[m/s\].
    pub(crate) fn velocity(&self) -> DVec2 {
        DVec2::new(self.velocity[0], self.velocity[1])
    }

    /// Names of the joints, in order.
    pub(crate) fn joint_names(&self) -> &[String] {
        self.chain.joint_names()
    }

    /// Force limits \[N\].
    pub(crate) fn effort_max(&self) -> &Vector2<f64> {
        self.chain.effort_max()
    }

    /// Speed limits \[m/s\].
    pub(crate) fn velocity_max(&self) -> &Vector2<f64> {
        self.chain.velocity_max()
    }

    /// Gap between the point and the obstacle, negative in contact \[m\].
    pub(crate) fn clearance_m(&self) -> f64 {
        let obstacle = &self.episode.obstacle;
        (self.position() - obstacle.at(self.time_s()).position_m).length()
            - obstacle.radius_m
            - self.point_radius_m
    }

    /// Steps the point, and the scenario's clock if it runs. `true` when a limit cut the force.
    pub(crate) fn step(&mut self, drive: Drive) -> bool {
        let push = match &self.episode.push {
            Some(push) if self.moving => push.at(self.time_s()),
            _ => DVec2::ZERO,
        };
        let push = Vector2::new(push.x, push.y);
        let wanted = match drive {
            Drive::Force(force) => force,
            Drive::Brake => {
                let stop = -self.velocity / self.dt_s;
                let (q, qd) = (&self.position, &self.velocity);
                inverse_dynamics(&self.chain, q, qd, &stop, GRAVITY_M_S2) - push
            }
        };
        let most = self.chain.effort_max();
        self.force = wanted.zip_map(most, |force, most| force.clamp(-most, most));
        let total = self.force + push;
        let acceleration =
            forward_dynamics(&self.chain, &self.position, &self.velocity, &total, GRAVITY_M_S2)
                .expect("the mass matrix of two prismatic joints is constant and was used before");
        self.velocity += acceleration * self.dt_s;
        self.position += self.velocity * self.dt_s;
        for i in 0..2 {
            // Hard stops at the ends of the axes.
            let (low, high) = (self.chain.position_lower()[i], self.chain.position_upper()[i]);
            if !(low..=high).contains(&self.position[i]) {
                self.position[i] = self.position[i].clamp(low, high);
                self.velocity[i] = 0.0;
            }
        }
        self.steps += u64::from(self.moving);
        drive != Drive::Brake && self.force != wanted
    }
}

/// How a command that is obeyed moves the point.
pub(crate) fn force(command: &JointCommand) -> Drive {
    let [x, y] = [0, 1].map(|i| command.torque[i] + command.gravity_torque[i]);
    Drive::Force(Vector2::new(x, y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::tests::scene;

    fn world() -> World {
        World { moving: true, ..World::new(&scene(), 1, false).unwrap() }
    }

    #[test]
    fn a_command_acts_with_its_gravity_torque() {
        let mut command = JointCommand::default();
        command.torque[..2].copy_from_slice(&[3.0, -2.0]);
        command.gravity_torque[..2].copy_from_slice(&[1.0, 0.5]);
        assert_eq!(force(&command), Drive::Force(Vector2::new(4.0, -1.5)));
    }

    #[test]
    fn the_largest_numbers_leave_the_point_where_numbers_are() {
        let mut world = world();
        let mut command = JointCommand::default();
        command.torque[..2].copy_from_slice(&[f64::MAX, f64::MIN]);
        command.gravity_torque = command.torque;
        assert!(world.step(force(&command)), "the effort limit cuts an overflow, too");
        assert_eq!(world.force, Vector2::new(400.0, -400.0));
        assert!(world.position().is_finite() && world.velocity().is_finite());
    }

    #[test]
    fn the_effort_limit_cuts_the_force() {
        let mut world = world();
        assert!(world.step(Drive::Force(Vector2::new(1e6, -3.0))));
        assert_eq!(world.force, Vector2::new(400.0, -3.0));
        assert!((world.velocity() - DVec2::new(0.4, -0.003)).length() < 1e-12);
        assert!(!world.step(Drive::Force(Vector2::new(1.0, 1.0))));
    }

    #[test]
    fn brakes_stop_the_point_within_the_effort_limit_and_hold_it_against_a_push() {
        let mut world = world();
        world.velocity = Vector2::new(1.0, -0.2);
        let mut steps = 0;
        while world.velocity().length() > 1e-12 {
            assert!(!world.step(Drive::Brake));
            assert!(world.force.amax() <= 400.0);
            steps += 1;
            assert!(steps < 10);
        }
        // 1 m/s at 400 m/s² is 2.5 steps of a millisecond.
        assert_eq!(steps, 3);
        world.episode.push =
            Some(crate::episode::Push { force_n: [8.0, 0.0], time_s: 0.0, duration_s: 9.0 });
        let before = world.position();
        world.step(Drive::Brake);
        assert!((world.position() - before).length() < 1e-12);
    }

    #[test]
    fn a_constant_force_moves_the_point_as_it_should() {
        let mut world = world();
        let start = world.position();
        for _ in 0..1000 {
            world.step(Drive::Force(Vector2::new(2.0, 0.0)));
        }
        let moved = world.position() - start;
        assert!((moved.x - 1.0).abs() < 2e-3 && moved.y.abs() < 1e-12, "{moved}");
        assert!((world.time_s() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_clock_stands_still_before_the_first_command() {
        let mut world = World::new(&scene(), 1, true).unwrap();
        for _ in 0..10 {
            world.step(Drive::Brake);
        }
        assert_eq!(world.time_s(), 0.0);
        assert_eq!(world.position(), DVec2::from(world.episode.start_position_m));
    }
}
