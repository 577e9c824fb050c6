//! A ball that is drawn to a goal through obstacles goes around them, smoothly.

#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    clippy::disallowed_macros,
    reason = "tests may do what the crate never does"
)]

use glam::{DQuat, DVec3};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;
use tprmp_rmpflow::leaves::{
    Avoidance, Barrier, Body, FreeBall, JointDamping, Obstacle, Shape, Side, Steering, Task, Tick,
};
use tprmp_rmpflow::natural::Natural;
use tprmp_rmpflow::tree::{Tree, TreeState};
use tprmp_spatial::{PointMotion, Pose, Twist};

const DAMPING: f64 = 8.0;

fn tree<const N: usize>(side: Side) -> Tree<N> {
    let leaf = Barrier {
        activation_distance: 0.3,
        distance_min: 0.002,
        inertia: 1.0,
        rest_fraction: 0.1,
        approach_speed: 1.0,
        repulsion: 0.0,
        damping_1_s: DAMPING,
    };
    let steering = Steering {
        range_m: 0.4,
        gain: 4.0,
        response_1_s: DAMPING,
        approach_1_s: 1.0,
        speed_max_m_s: 4.0,
        side,
    };
    Tree {
        joint_damping: JointDamping { inertia: 0.0, damping_1_s: 0.0 },
        joint_limits: None,
        joint_speed_limits: None,
        posture: None,
        self_collision: None,
        avoidance: Some(Avoidance { leaf, steering: Some(steering), margin_m: 0.01 }),
        obstacle_jerk_max: Some(SVector::repeat(3000.0)),
    }
}

/// How a run went.
struct Run {
    goal_error: f64,
    clearance_min: f64,
    acceleration_max: f64,
    change_max: f64,
}

/// A ball of radius 2 cm with the inertia of 1 kg from the origin to `goal`, with a pull of 16 N at
/// most, among obstacles that may change with time.
fn run<const N: usize>(
    side: Side,
    goal: DVec3,
    dt: f64,
    seconds: f64,
    obstacles: impl Fn(f64) -> Vec<Obstacle>,
) -> Run {
    let tree = tree::<N>(side);
    let mut state = TreeState::default();
    let mut ball = FreeBall { position: DVec3::ZERO, velocity: DVec3::ZERO, radius: 0.02, goal };
    let to_vector = |v: DVec3| SVector::<f64, N>::from_fn(|i, _| v[i]);
    let mut result = Run {
        goal_error: f64::INFINITY,
        clearance_min: f64::INFINITY,
        acceleration_max: 0.0,
        change_max: 0.0,
    };
    let mut last: Option<SVector<f64, N>> = None;
    for step in 0..(seconds / dt).round() as usize {
        let now = obstacles(step as f64 * dt);
        let away = ball.position - goal;
        let force = -away * (16.0 / away.length().hypot(0.5)) - ball.velocity * DAMPING;
        let energy = 16.0 * away.length().hypot(0.5) - 8.0 + 0.5 * ball.velocity.length_squared();
        let natural = Natural { force: to_vector(force), metric: SMatrix::identity() };
        let tick = Tick {
            task: Task { natural, energy },
            position: to_vector(ball.position),
            velocity: to_vector(ball.velocity),
            body: &ball,
            obstacles: &now,
            dt_s: dt,
        };
        let a = tree.evaluate(&tick, &mut state).unwrap().acceleration;
        result.acceleration_max = result.acceleration_max.max(a.norm());
        if let Some(last) = last {
            result.change_max = result.change_max.max((a - last).amax());
        }
        last = Some(a);
        for i in 0..N {
            ball.velocity[i] += a[i] * dt;
        }
        ball.position += ball.velocity * dt;
        for obstacle in &now {
            let distance = obstacle.distance(ball.position, ball.radius);
            result.clearance_min = result.clearance_min.min(distance);
        }
    }
    result.goal_error = (ball.position - goal).length();
    result
}

#[test]
fn an_obstacle_met_exactly_head_on_is_passed_in_the_plane_and_in_space() {
    for dt in [0.01, 0.001] {
        for radius in [0.1, 0.3, 0.6, 0.9] {
            let center = DVec3::X * (radius + 0.6);
            let goal = center + DVec3::X * (radius + 0.3);
            let ball = || vec![Obstacle::sphere(center, radius, DVec3::ZERO)];
            let plane = run::<2>(Side::Plane, goal, dt, 12.0, |_| ball());
            let space = run::<3>(Side::Space(DVec3::Z), goal, dt, 12.0, |_| ball());
            for result in [plane, space] {
                assert!(result.goal_error < 1e-3, "{radius}: {}", result.goal_error);
                assert!(result.clearance_min > 0.0, "{radius}: {}", result.clearance_min);
                assert!(result.acceleration_max < 40.0, "{radius}: {}", result.acceleration_max);
            }
        }
    }
}

#[test]
fn shapes_with_edges_are_passed() {
    let shapes = [
        Shape::Box { half_size: DVec3::new(0.1, 0.3, 0.2) },
        Shape::Capsule { radius: 0.08, half_length: 0.25 },
    ];
    for shape in shapes {
        for rotation in 0..5 {
            let orientation = DQuat::from_rotation_x(f64::from(rotation) * 0.7)
                * DQuat::from_rotation_z(f64::from(rotation) * 0.3);
            let obstacle = Obstacle {
                shape,
                pose: Pose { position: DVec3::X * 0.8, orientation },
                velocity: Twist::ZERO,
            };
            let result =
                run::<3>(Side::Space(DVec3::Z), DVec3::X * 1.6, 0.002, 12.0, |_| vec![obstacle]);
            assert!(result.goal_error < 1e-3, "{shape:?} {rotation}: {}", result.goal_error);
            assert!(result.clearance_min > 0.0, "{shape:?} {rotation}: {}", result.clearance_min);
        }
    }
}

#[test]
fn a_row_of_balls_too_narrow_to_pass_is_gone_around() {
    // Three balls side by side across the path: a hollow between each two of them.
    let wall = |_: f64| {
        [-0.45, 0.0, 0.45]
            .map(|y| Obstacle::sphere(DVec3::new(1.0, y, 0.0), 0.22, DVec3::ZERO))
            .to_vec()
    };
    let result = run::<2>(Side::Plane, DVec3::X * 2.0, 0.005, 20.0, wall);
    assert!(result.goal_error < 1e-3, "{}", result.goal_error);
    assert!(result.clearance_min > 0.0, "{}", result.clearance_min);
    assert!(result.acceleration_max < 40.0, "{}", result.acceleration_max);
}

#[test]
fn a_goal_beside_an_obstacle_is_reached_exactly() {
    let goal = DVec3::new(0.8, 0.1, 0.0);
    let ball = |_: f64| vec![Obstacle::sphere(goal + DVec3::Y * 0.37, 0.3, DVec3::ZERO)];
    let result = run::<2>(Side::Plane, goal, 0.005, 12.0, ball);
    assert!(result.goal_error < 1e-4, "{}", result.goal_error);
}

#[test]
fn at_an_obstacle_that_covers_the_goal_the_ball_waits() {
    let ball = |t: f64| {
        let center = DVec3::X * if t < 6.0 { 1.0 } else { 1.0 + (t - 6.0) * 0.3 };
        let velocity = if t < 6.0 { DVec3::ZERO } else { DVec3::X * 0.3 };
        vec![Obstacle::sphere(center, 0.2, velocity)]
    };
    let goal = DVec3::new(0.95, 0.03, 0.0);
    let waiting = run::<2>(Side::Plane, goal, 0.002, 6.0, ball);
    let before = run::<2>(Side::Plane, goal, 0.002, 5.0, ball);
    assert!(waiting.clearance_min > 0.0);
    // It creeps towards the surface, ever more slowly; going around it would move by centimetres.
    assert!((waiting.goal_error - before.goal_error).abs() < 5e-3, "it goes around");
    assert!(waiting.goal_error < 0.3, "{}", waiting.goal_error);
    let then = run::<2>(Side::Plane, goal, 0.002, 14.0, ball);
    assert!(then.goal_error < 1e-3, "{}", then.goal_error);
}

#[test]
fn an_obstacle_that_comes_towards_the_ball_is_evaded() {
    let ball = |t: f64| {
        let velocity = DVec3::X * -0.5;
        vec![Obstacle::sphere(
            DVec3::X * 1.5 + velocity * t.min(5.0),
            0.2,
            if t < 5.0 { velocity } else { DVec3::ZERO },
        )]
    };
    let result = run::<3>(Side::Space(DVec3::Z), DVec3::X * 0.8, 0.002, 12.0, ball);
    assert!(result.goal_error < 1e-3, "{}", result.goal_error);
    assert!(result.clearance_min > 0.0, "{}", result.clearance_min);
}

/// What obstacles add to the acceleration changes by at most the jerk limit, whatever they do.
#[test]
fn obstacles_that_appear_jump_and_vanish_change_the_acceleration_gradually() {
    let dt = 0.001;
    let scene = |t: f64| match t {
        t if t < 0.5 => vec![],
        t if t < 0.8 => vec![Obstacle::sphere(DVec3::new(1.15, 0.02, 0.0), 0.2, DVec3::ZERO)],
        t if t < 1.2 => vec![Obstacle::sphere(DVec3::new(1.5, -0.3, 0.0), 0.2, DVec3::ZERO)],
        _ => vec![],
    };
    let result = run::<2>(Side::Plane, DVec3::X * 2.0, dt, 8.0, scene);
    // The pull itself changes by less than 0.2 m/s² a tick.
    assert!(result.change_max < 3000.0 * dt + 0.2, "{}", result.change_max);
    assert!(result.acceleration_max < 40.0, "{}", result.acceleration_max);
    assert!(result.goal_error < 1e-3, "{}", result.goal_error);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn random_balls_on_the_path_are_never_touched(
        places in prop::collection::vec(([0.4..1.8_f64, -0.5..0.5_f64, -0.5..0.5_f64], 0.05..0.25_f64), 1..6),
        goal in [1.8..2.4_f64, -0.4..0.4_f64, -0.4..0.4_f64],
    ) {
        let goal = DVec3::from(goal);
        let balls: Vec<_> = places
            .iter()
            .map(|(place, radius)| Obstacle::sphere(DVec3::from(*place), *radius, DVec3::ZERO))
            .filter(|o| o.distance(DVec3::ZERO, 0.02) > 0.05 && o.distance(goal, 0.02) > 0.05)
            .collect();
        let result = run::<3>(Side::Space(DVec3::Z), goal, 0.005, 15.0, |_| balls.clone());
        prop_assert!(result.clearance_min > 0.0, "{}", result.clearance_min);
        prop_assert!(result.goal_error < 1e-2, "{}", result.goal_error);
        prop_assert!(result.acceleration_max < 60.0, "{}", result.acceleration_max);
    }
}

/// A ball that may come nearer to half-spaces than to anything else.
struct Reaching(FreeBall, f64);

impl Body<3> for Reaching {
    fn count(&self) -> usize {
        1
    }

    fn ball(&self, i: usize) -> (DVec3, f64) {
        Body::<3>::ball(&self.0, i)
    }

    fn motion(&self, i: usize) -> PointMotion<3> {
        self.0.motion(i)
    }

    fn acts_within(&self, _: usize, shape: &Shape) -> f64 {
        if *shape == Shape::HalfSpace { self.1 } else { f64::INFINITY }
    }

    fn at_goal(&self, i: usize) -> Option<DVec3> {
        Body::<3>::at_goal(&self.0, i)
    }
}

#[test]
fn a_point_that_may_come_near_feels_nothing_above_and_stops_below() {
    let tree = tree::<3>(Side::Space(DVec3::X));
    let floor = [Obstacle { shape: Shape::HalfSpace, pose: Pose::IDENTITY, velocity: Twist::ZERO }];
    let acceleration = |within: f64, height: f64| {
        let position = DVec3::Z * height;
        let ball = FreeBall { position, velocity: -DVec3::Z, radius: 0.02, goal: -DVec3::Z };
        let natural = Natural { force: SVector::zeros(), metric: SMatrix::identity() };
        let tick = Tick {
            task: Task { natural, energy: 1.0 },
            position: position.into(),
            velocity: ball.velocity.into(),
            body: &Reaching(ball, within),
            obstacles: &floor,
            dt_s: 1.0,
        };
        tree.evaluate(&tick, &mut TreeState::default()).unwrap().acceleration[2]
    };
    // 3 cm of radius and margin: at 20 cm it is 17 cm from the floor.
    assert!(acceleration(f64::INFINITY, 0.2) > 0.1);
    assert_eq!(acceleration(0.1, 0.2), 0.0);
    assert!(acceleration(0.1, 0.05) > 10.0);
    assert_eq!(acceleration(0.0, 0.05), 0.0);
}
