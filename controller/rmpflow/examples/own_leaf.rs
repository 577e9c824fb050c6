//! A leaf of one's own in a tree: a point in the plane keeps to a rail while it goes to a goal and around a ball.
//!
//! A leaf needs three things: its task map (here the height above the rail), its force and metric there, and
//! the pullback to the robot's coordinates.

#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    clippy::disallowed_macros,
    reason = "a program may do what the crate never does"
)]

use glam::DVec3;
use nalgebra::{Matrix1, Matrix1x2, Matrix2, Vector1, Vector2};
use tprmp_rmpflow::leaves::{
    Avoidance, Barrier, FreeBall, JointDamping, Obstacle, Side, Steering, Task, Tick,
};
use tprmp_rmpflow::{Natural, ResolveError, Tree, TreeState};

/// Keeps to the line y = `height_m`: a spring and damping on z = y − height, M z̈ = −k z − d ż.
struct Rail {
    height_m: f64,
    inertia_kg: f64,
    stiffness_1_s2: f64,
    damping_1_s: f64,
}

impl Rail {
    fn add(&self, q: &Vector2<f64>, qd: &Vector2<f64>, root: &mut Natural<2>) {
        let (z, rate) = (q.y - self.height_m, qd.y);
        let acceleration = -self.stiffness_1_s2 * z - self.damping_1_s * rate;
        let leaf = Natural {
            force: Vector1::new(self.inertia_kg * acceleration),
            metric: Matrix1::new(self.inertia_kg),
        };
        // z = (0 1) q − height is linear in q: there is no drift.
        root.add_pullback(&leaf, &Matrix1x2::new(0.0, 1.0), &Vector1::zeros());
    }
}

fn main() -> Result<(), ResolveError> {
    let leaf = Barrier {
        activation_distance: 0.3,
        distance_min: 0.002,
        inertia: 1.0,
        rest_fraction: 0.1,
        approach_speed: 1.0,
        repulsion: 0.0,
        damping_1_s: 8.0,
    };
    let steering = Steering {
        range_m: 0.4,
        gain: 4.0,
        response_1_s: 8.0,
        approach_1_s: 1.0,
        speed_max_m_s: 2.0,
        side: Side::Plane,
    };
    let tree = Tree {
        joint_damping: JointDamping { inertia: 0.01, damping_1_s: 2.0 },
        joint_limits: None,
        joint_speed_limits: None,
        posture: None,
        self_collision: None,
        avoidance: Some(Avoidance { leaf, steering: Some(steering), margin_m: 0.01 }),
        obstacle_jerk_max: None,
    };
    let rail = Rail { height_m: 0.1, inertia_kg: 1.0, stiffness_1_s2: 16.0, damping_1_s: 8.0 };
    let ball = Obstacle::sphere(DVec3::new(0.6, 0.1, 0.0), 0.1, DVec3::ZERO);
    let goal = Vector2::new(1.2, 0.1);

    let (mut q, mut qd) = (Vector2::zeros(), Vector2::zeros());
    let mut state = TreeState::default();
    let (dt_s, mut clearance_min_m) = (0.002, f64::INFINITY);
    for _ in 0..4000 {
        // The task of this robot: a spring to the goal, in joint space already.
        let away: Vector2<f64> = q - goal;
        let mut natural = Natural { force: -away * 8.0 - qd * 8.0, metric: Matrix2::identity() };
        let energy = 4.0 * away.norm_squared() + 0.5 * qd.norm_squared();
        rail.add(&q, &qd, &mut natural);

        let space = |v: Vector2<f64>| DVec3::new(v.x, v.y, 0.0);
        let body =
            FreeBall { position: space(q), velocity: space(qd), radius: 0.02, goal: space(goal) };
        let tick = Tick {
            task: Task { natural, energy },
            position: q,
            velocity: qd,
            body: &body,
            obstacles: &[ball],
            dt_s,
        };
        let resolved = tree.evaluate(&tick, &mut state)?;
        clearance_min_m = resolved.proximity.clearance_min_m.min(clearance_min_m);
        qd += resolved.acceleration * dt_s;
        q += qd * dt_s;
    }
    println!("at {:.4} {:.4} m, never nearer to the ball than {clearance_min_m:.4} m", q.x, q.y);
    assert!((q - goal).norm() < 1e-3 && clearance_min_m > 0.0);
    Ok(())
}

#[test]
fn the_point_arrives_and_touches_nothing() -> Result<(), ResolveError> {
    main()
}
