//! How long one evaluation of the policy takes, and what it is made of. `make bench` trains the
//! models and runs it. Benchmarks measure; no test asserts a time.

#![expect(missing_docs, reason = "the macros of criterion make public functions without them")]

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DQuat, DVec3};
use nalgebra::SVector;
use tprmp_controller::policy::{Policy, Task, TaskParameters};
use tprmp_controller::startup;
use tprmp_rmpflow::frame_map::{FrameMotion, Pose};
use tprmp_rmpflow::leaves::{Obstacle, Shape};
use tprmp_robot::{Kinematics, forward_kinematics_with_velocity, inverse_dynamics};

/// A configuration and the model that `make bench` trained for it.
fn policy<const N: usize>(controller: &str, model: &str) -> Policy<N> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = root.join("config/controllers").join(controller);
    let model = root.join("target/bench").join(model);
    assert!(model.exists(), "{} is missing: run `make bench`", model.display());
    let loaded = startup::load(&config, &model, false).expect("the shipped files are valid");
    let (chain, points) = startup::robot::<N>(&config, &loaded.config).expect("a valid robot");
    Policy::new(chain, loaded.skill, &points, &loaded.config)
}

/// A frame that moves and turns.
fn moving(position: [f64; 3], yaw: f64) -> FrameMotion {
    FrameMotion {
        linear_velocity: DVec3::new(0.1, -0.05, 0.0),
        linear_acceleration: DVec3::new(0.05, 0.1, 0.0),
        angular_velocity: DVec3::Z * 0.2,
        ..FrameMotion::at_rest(Pose {
            position: position.into(),
            orientation: DQuat::from_rotation_z(yaw),
        })
    }
}

fn tick<const N: usize>(
    criterion: &mut Criterion,
    name: &str,
    policy: &Policy<N>,
    q: SVector<f64, N>,
    frames: [FrameMotion; 2],
    obstacles: &[Obstacle],
) {
    let qd = SVector::<f64, N>::repeat(0.1);
    let parameters = TaskParameters { frames: &frames, goal_frame: 1, obstacles, dt_s: 1e-3 };
    let mut workspace = policy.workspace();
    criterion.bench_function(name, |b| {
        b.iter(|| {
            policy
                .evaluate(black_box(&q), black_box(&qd), &Task::Skill, &parameters, &mut workspace)
                .expect("the shipped policy resolves")
        });
    });
}

fn evaluation(criterion: &mut Criterion) {
    let pick = policy::<6>("ur5_pick.ron", "pick.model.ron");
    let q = SVector::<f64, 6>::from([-3.4, -1.7, 2.0, -1.9, -1.5, -0.3]);
    let home = Pose {
        position: DVec3::new(0.41, 0.29, 0.31),
        orientation: DQuat::from_xyzw(0.72, -0.69, 0.0, 0.0).normalize(),
    };
    let frames = [FrameMotion::at_rest(home), moving([0.5, -0.25, 0.03], 0.3)];
    let obstacles = [
        Obstacle::sphere(DVec3::new(0.48, 0.0, 0.25), 0.06, DVec3::Y * 0.1),
        Obstacle::half_space(DVec3::ZERO, DVec3::Z, DVec3::ZERO),
    ];
    tick(criterion, "tick, UR5, R3xS3, no obstacles", &pick, q, frames, &[]);
    tick(criterion, "tick, UR5, R3xS3, sphere and table", &pick, q, frames, &obstacles);

    // Eight obstacles of all shapes around the arm, some within reach of its leaves.
    let crowd = [
        obstacles[0],
        obstacles[1],
        Obstacle::sphere(DVec3::new(0.2, 0.3, 0.5), 0.08, DVec3::X * 0.1),
        Obstacle::sphere(DVec3::new(0.6, 0.3, 0.2), 0.05, DVec3::ZERO),
        Obstacle {
            shape: Shape::Capsule { radius: 0.04, half_length: 0.2 },
            ..Obstacle::sphere(DVec3::new(0.3, -0.2, 0.5), 0.0, DVec3::Y * 0.05)
        },
        Obstacle {
            shape: Shape::Box { half_size: DVec3::new(0.1, 0.05, 0.2) },
            angular_velocity: DVec3::Z * 0.3,
            ..Obstacle::sphere(DVec3::new(0.5, 0.4, 0.3), 0.0, DVec3::ZERO)
        },
        Obstacle::sphere(DVec3::new(0.0, 0.4, 0.3), 0.06, DVec3::ZERO),
        Obstacle::half_space(DVec3::new(-0.6, 0.0, 0.0), DVec3::X, DVec3::ZERO),
    ];
    tick(criterion, "tick, UR5, R3xS3, whole arm, 8 obstacles", &pick, q, frames, &crowd);

    let planar = policy::<2>("planar.ron", "planar.model.ron");
    let frames = [moving([-1.3, 0.0, 0.0], 0.1), moving([1.2, -0.1, 0.0], -0.1)];
    let q = SVector::<f64, 2>::from([-0.2, 0.3]);
    tick(criterion, "tick, point, R2, no obstacles", &planar, q, frames, &[]);

    let chain = pick.chain();
    let q = SVector::<f64, 6>::from([-3.4, -1.7, 2.0, -1.9, -1.5, -0.3]);
    let qd = SVector::<f64, 6>::repeat(0.1);
    let mut kinematics = Kinematics::new();
    criterion.bench_function("FK, Jacobian and its drift, UR5", |b| {
        b.iter(|| {
            forward_kinematics_with_velocity(chain, black_box(&q), &qd, &mut kinematics);
            kinematics.tool_position
        });
    });
    let gravity = DVec3::new(0.0, 0.0, -9.81);
    criterion.bench_function("inverse dynamics, UR5", |b| {
        b.iter(|| inverse_dynamics(chain, black_box(&q), &qd, &qd, gravity));
    });
}

criterion_group!(benches, evaluation);
criterion_main!(benches);
