//! How long one evaluation of the policy takes, what it is made of, and how it grows with
//! components, frames, obstacles and joints. `make bench` trains the models and runs it.
//!
//! Prints tables, and writes the group `evaluation` of `target/bench/results.json`. What is promised
//! is compared with the best of many short batches: the rest is the machine's. Criterion compares the
//! main rows with the run before. Benchmarks measure; no test asserts a time.

use std::fmt::Write as _;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DQuat, DVec3};
use nalgebra::SVector;
use serde_json::{Value, json};
use tprmp_bench::results::{self, Verdict};
use tprmp_bench::timing::{Line, Times, measure};
use tprmp_controller::policy::{RobotPolicy, Task, TaskParameters};
use tprmp_controller::startup::{self, Loaded};
use tprmp_model::controller_config::ControllerConfig;
use tprmp_model::skill_model::{self, FieldModel, SkillModel};
use tprmp_rmpflow::leaves::Obstacle;
use tprmp_rmpflow::natural::Natural;
use tprmp_rmpflow::policy::SkillPolicy;
use tprmp_rmpflow::policy::thesis::ThesisPolicy;
use tprmp_robot::{
    Chain, ControlPoint, ControlPoints, Kinematics, forward_kinematics,
    forward_kinematics_with_velocity, inverse_dynamics, point_position,
};
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);
/// Joint position and velocity of the UR5 near the box [rad, rad/s].
const POSITION: [f64; 6] = [-3.4, -1.7, 2.0, -1.9, -1.5, -0.3];
const VELOCITY: f64 = 0.1;

/// Everything that was measured.
struct Report<'a> {
    criterion: &'a mut Criterion,
    rows: Vec<Value>,
}

impl Report<'_> {
    /// A promised row: the limit, what it should come to, and settings.
    fn row(&mut self, name: &str, [must, aim]: [f64; 2], settings: &Value, mut work: impl FnMut()) {
        let times = measure(&mut work);
        self.criterion.bench_function(name, |b| b.iter(&mut work));
        let mut row = fields(name, &times, settings);
        row["must_us"] = must.into();
        row["aim_us"] = aim.into();
        row["verdict"] = json!(Verdict::at_most(times.best_us, must, "µs"));
        println!(
            "{name:<58} best {:>7.3} p50 {:>7.3} p99 {:>7.3} µs, must {must}, aim {aim}",
            times.best_us, times.p50_us, times.p99_us
        );
        self.rows.push(row);
    }

    /// Rows of what grows with a number, and the straight line through them.
    fn series(&mut self, series: &str, points: Vec<(usize, Times)>) {
        let best: Vec<_> = points.iter().map(|(x, t)| (*x as f64, t.best_us)).collect();
        let line = Line::through(&best);
        let mut table = String::new();
        for (x, times) in points {
            let mut row = fields(&format!("{series}: {x}"), &times, &json!({}));
            row["series"] = series.into();
            row["x"] = x.into();
            let _ = write!(table, " {x}: {:.3}", times.best_us);
            self.rows.push(row);
        }
        let Line { start, slope, deviation } = line;
        println!("{series} [µs]:{table}");
        println!("    {start:.3} + {slope:.4} each, off by at most {:.0} %", deviation * 100.0);
        self.rows.push(json!({
            "name": format!("{series}: straight line"), "start_us": start, "each_us": slope,
            "deviation_fraction": deviation,
        }));
    }
}

fn fields(name: &str, times: &Times, settings: &Value) -> Value {
    let Times { best_us, p50_us, p99_us, p999_us, max_us } = *times;
    let mut row = json!({
        "name": name, "best_us": best_us, "p50_us": p50_us, "p99_us": p99_us, "p999_us": p999_us,
        "max_us": max_us,
    });
    for (key, value) in settings.as_object().into_iter().flatten() {
        row[key] = value.clone();
    }
    row
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).into()
}

/// A configuration and the model that `make bench` trained for it.
fn load<const N: usize>(controller: &str, model: &str) -> (Loaded, Chain<N>, ControlPoints) {
    let config = root().join("config/controllers").join(controller);
    let model = results::folder().join(model);
    assert!(model.exists(), "{} is missing: run `make bench`", model.display());
    let loaded = startup::load(&config, &[model], true).expect("the shipped files are valid");
    let (chain, points) = startup::robot::<N>(&config, &loaded.config).expect("a valid robot");
    (loaded, chain, points)
}

/// Twelve spheres along the UR5: link, centre in its frame \[m\], radius \[m\].
const TWELVE: [(&str, [f64; 3], f64); 12] = [
    ("shoulder_link", [0.0, 0.0, 0.09], 0.1),
    ("upper_arm_link", [0.0, 0.0, 0.13], 0.1),
    ("upper_arm_link", [-0.14, 0.0, 0.136], 0.1),
    ("upper_arm_link", [-0.28, 0.0, 0.136], 0.1),
    ("upper_arm_link", [-0.425, 0.0, 0.13], 0.1),
    ("forearm_link", [-0.1, 0.0, 0.0165], 0.08),
    ("forearm_link", [-0.21, 0.0, 0.0165], 0.08),
    ("forearm_link", [-0.33, 0.0, 0.0165], 0.08),
    ("wrist_1_link", [0.0, 0.0, 0.1], 0.075),
    ("wrist_2_link", [0.0, 0.0, 0.085], 0.07),
    ("wrist_3_link", [0.0, 0.0, 0.06], 0.045),
    ("suction_tool", [0.0, 0.0, 0.06], 0.065),
];

/// A frame that moves and rotates, `step` after it was first seen.
fn moving(position: [f64; 3], yaw: f64, step: f64) -> MovingPose {
    MovingPose {
        velocity: Twist { linear: DVec3::new(0.1, -0.05, 0.0), angular: DVec3::Z * 0.2 },
        acceleration: SpatialAcceleration {
            linear: DVec3::new(0.05, 0.1, 0.0),
            angular: DVec3::ZERO,
        },
        ..MovingPose::at_rest(Pose {
            position: DVec3::from(position) + DVec3::X * step,
            orientation: DQuat::from_rotation_z(yaw + 0.1 * step),
        })
    }
}

/// Start and goal frame of the pick; both move.
fn pick_frames(step: f64) -> [MovingPose; 2] {
    let mut start = moving([0.41, 0.29, 0.31], 0.0, step);
    start.pose.orientation = DQuat::from_xyzw(0.72, -0.69, 0.0, 0.0).normalize();
    [start, moving([0.5, -0.25, 0.03], 0.3, step)]
}

/// Start and goal frame of the planar skill; both move.
fn planar_frames(step: f64) -> [MovingPose; 2] {
    [moving([-1.3, 0.0, 0.0], 0.1, step), moving([1.2, -0.1, 0.0], -0.1, step)]
}

/// Spheres around the arm, some within reach of its leaves, some not; they move.
fn obstacles(count: usize) -> Vec<Obstacle> {
    let place = |i: usize| {
        let angle = i as f64 * 2.4;
        let radius = 0.35 + 0.04 * (i % 6) as f64;
        DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.15 + 0.06 * (i % 8) as f64)
    };
    (0..count).map(|i| Obstacle::sphere(place(i), 0.06, DVec3::Y * 0.1)).collect()
}

/// Pairs of a point and an obstacle that are within reach of the avoidance: what they ask for is computed, all
/// others are passed over.
fn near_pairs(
    chain: &Chain<6>,
    points: &ControlPoints,
    config: &ControllerConfig,
    obstacles: &[Obstacle],
) -> usize {
    let mut kinematics = Kinematics::new();
    forward_kinematics(chain, &SVector::from(POSITION), &mut kinematics);
    let avoidance = config.collision.as_ref().expect("the pick avoids obstacles").leaf();
    let range = avoidance.steering.map_or(0.0, |steering| steering.range_m);
    let reach = range.max(avoidance.leaf.activation_distance);
    let is_near = |obstacle: &Obstacle, point: &ControlPoint| {
        let place = point_position(&kinematics, point.joint, point.centre);
        obstacle.distance(place, point.radius + avoidance.margin_m) < reach
    };
    let points = points.as_slice();
    obstacles.iter().map(|o| points.iter().filter(|p| is_near(o, p)).count()).sum()
}

/// A tick of the policy; in every second one the frames are those of the second kind.
fn tick<'a, const N: usize>(
    policy: &'a RobotPolicy<N>,
    q: SVector<f64, N>,
    frames: &'a [Vec<MovingPose>; 2],
    obstacles: &'a [Obstacle],
) -> impl FnMut() + 'a {
    let qd = SVector::<f64, N>::repeat(VELOCITY);
    let mut workspace = policy.workspace();
    let mut parity = 0;
    move || {
        parity = 1 - parity;
        let frames = &frames[parity];
        let goal_frame = frames.len() - 1;
        let parameters =
            TaskParameters { frames, goal_frame, obstacles, external: None, dt_s: 1e-3 };
        let decision = policy
            .evaluate(black_box(&q), black_box(&qd), &Task::Skill, &parameters, &mut workspace)
            .expect("the policy resolves");
        black_box(decision);
    }
}

/// What moves, and what moves on between two ticks.
fn both(frames: impl Fn(f64) -> [MovingPose; 2], step: f64) -> [Vec<MovingPose>; 2] {
    [frames(0.0).to_vec(), frames(step).to_vec()]
}

/// The same skill with another number of components: those before the goal's, over and over.
fn with_components(model: &SkillModel, count: usize) -> SkillModel {
    let mut model = model.clone();
    let repeated = |field: &mut FieldModel| {
        let goal = field.components.pop().expect("a field has components");
        let others = field.components.clone();
        field.components = others.into_iter().cycle().take(count - 1).chain([goal]).collect();
    };
    if let skill_model::PolicyModel::Canonical { position, orientation } = &mut model.policy {
        repeated(position);
        orientation.iter_mut().for_each(repeated);
    }
    model
}

/// The same product with other numbers of components and frames: those it has, over and over.
fn with_product(skill: &SkillPolicy, components: usize, frames: usize) -> SkillPolicy {
    let SkillPolicy::Pose(product) = skill else { panic!("the pick moves poses") };
    let (goal, others) = product.components().split_last().expect("a skill has components");
    let chosen = others.iter().cycle().take(components - 1).chain([goal]).map(|component| {
        let mut component = component.clone();
        component.gaussians = component.gaussians.iter().cycle().take(frames).copied().collect();
        component
    });
    let (scale, threshold) = (product.metric_scale(), product.huber_threshold());
    let product = ThesisPolicy::new(chosen.collect(), scale, threshold);
    SkillPolicy::Pose(product.expect("what was a skill is one"))
}

/// An arm of N revolute joints, with axes across one another.
fn arm<const N: usize>() -> Chain<N> {
    let mut urdf = String::from("<robot name=\"arm\"><link name=\"link_0\"/>");
    for i in 1..=N {
        let (before, roll) = (i - 1, if i % 2 == 0 { 1.5 } else { -1.2 });
        let _ = write!(
            urdf,
            "<joint name=\"joint_{i}\" type=\"revolute\"><parent link=\"link_{before}\"/>\
             <child link=\"link_{i}\"/><origin xyz=\"0.02 0.1 0.15\" rpy=\"{roll} 0.1 0\"/>\
             <axis xyz=\"0 0 1\"/><limit lower=\"-3\" upper=\"3\" velocity=\"3\" effort=\"100\"/>\
             </joint><link name=\"link_{i}\"><inertial><origin xyz=\"0 0.05 0.07\" rpy=\"0 0 0\"/>\
             <mass value=\"2\"/><inertia ixx=\"0.02\" ixy=\"0\" ixz=\"0\" iyy=\"0.02\" iyz=\"0\" \
             izz=\"0.01\"/></inertial></link>"
        );
    }
    urdf.push_str("</robot>");
    let file = results::folder().join(format!("arm_{N}.urdf"));
    std::fs::write(&file, urdf).expect("`target/bench` can be written");
    Chain::from_urdf(&file, format!("link_{N}").as_str()).expect("a valid robot")
}

/// Kinematics, dynamics, and what the root of the tree does, of an arm of N joints.
fn joints<const N: usize>() -> [(usize, Times); 3] {
    let chain = arm::<N>();
    let (q, qd) = (SVector::<f64, N>::repeat(0.4), SVector::<f64, N>::repeat(VELOCITY));
    let mut kinematics = Kinematics::new();
    let forward = measure(|| {
        forward_kinematics_with_velocity(&chain, black_box(&q), &qd, &mut kinematics);
        black_box(&kinematics);
    });
    let inverse = measure(|| {
        black_box(inverse_dynamics(&chain, black_box(&q), &qd, &qd, GRAVITY));
    });
    let mut leaf = Natural::<6>::zero();
    leaf.metric.fill_diagonal(2.0);
    let drift = kinematics.tool_drift.into();
    let root = measure(|| {
        let mut root = Natural::<N>::zero();
        root.metric.fill_diagonal(0.1);
        root.add_pullback(black_box(&leaf), &kinematics.tool_jacobian, &drift);
        black_box(root.resolve()).expect("a positive definite root");
    });
    [(N, forward), (N, inverse), (N, root)]
}

fn promised(report: &mut Report<'_>) {
    let (loaded, chain, points) = load::<6>("ur5_pick.ron", "pick.model.ron");
    let q = SVector::from(POSITION);
    let frames = both(pick_frames, 0.001);
    let policy = RobotPolicy::new(chain.clone(), loaded.policies(), &points, &loaded.config);
    let settings = json!({ "components": 15, "frames": 2, "obstacles": 0, "joints": 6 });
    let name = "tick, default policy, both frames moving";
    report.row(name, [3.0, 1.0], &settings, tick(&policy, q, &frames, &[]));
    let crowd = obstacles(8);
    let mut whole_arm = |points: &ControlPoints| {
        let config = &loaded.config;
        assert!(config.joint_limits.is_some() && config.self_collision.is_some(), "the whole arm");
        let count = points.as_slice().len();
        let near = near_pairs(&chain, points, config, &crowd);
        let policy = RobotPolicy::new(chain.clone(), loaded.policies(), points, config);
        let settings = json!({ "components": 15, "frames": 2, "obstacles": 8, "joints": 6,
            "control_points": count, "near_pairs": near });
        let name = format!("tick, whole arm, {count} points × 8 obstacles, {near} near");
        report.row(&name, [12.0, 5.0], &settings, tick(&policy, q, &frames, &crowd));
    };
    let twelve = TWELVE.map(|(link, at, radius)| (link.to_owned(), at.into(), radius));
    whole_arm(&ControlPoints::listed(&chain, &twelve).expect("links of the UR5"));
    // What the shipped configuration has: spheres that cover all collision shapes.
    whole_arm(&points);

    let (loaded, ..) = load::<6>("ur5_pick.ron", "pick_thesis.model.ron");
    let policy = RobotPolicy::new(chain.clone(), loaded.policies(), &points, &loaded.config);
    let settings = json!({ "components": 15, "frames": 2, "obstacles": 0, "joints": 6 });
    let still = both(pick_frames, 0.0);
    let name = "tick, thesis policy, frames unchanged";
    report.row(name, [3.0, 1.0], &settings, tick(&policy, q, &still, &[]));
    let name = "tick, thesis policy, both frames moved";
    report.row(name, [10.0, 3.0], &settings, tick(&policy, q, &frames, &[]));

    let (loaded, plane, points) = load::<2>("planar.ron", "planar.model.ron");
    let policy = RobotPolicy::new(plane, loaded.policies(), &points, &loaded.config);
    let frames = both(planar_frames, 0.001);
    let settings = json!({ "components": 9, "frames": 2, "obstacles": 0, "joints": 2 });
    let name = "tick, default policy in the plane, frames moving";
    let q = SVector::from([-0.2, 0.3]);
    report.row(name, [1.0, 0.4], &settings, tick(&policy, q, &frames, &[]));

    let q = SVector::from(POSITION);
    let qd = SVector::<f64, 6>::repeat(VELOCITY);
    let mut kinematics = Kinematics::new();
    let settings = json!({ "joints": 6 });
    report.row("FK, Jacobian and its drift", [0.87, 0.25], &settings, || {
        forward_kinematics_with_velocity(&chain, black_box(&q), &qd, &mut kinematics);
        black_box(&kinematics);
    });
    report.row("inverse dynamics", [0.99, 0.3], &settings, || {
        black_box(inverse_dynamics(&chain, black_box(&q), &qd, &qd, GRAVITY));
    });
}

fn growth(report: &mut Report<'_>) {
    let (loaded, chain, points) = load::<6>("ur5_pick.ron", "pick.model.ron");
    let q = SVector::from(POSITION);
    let frames = both(pick_frames, 0.001);
    let config = &loaded.config;
    let policy =
        |skill: SkillPolicy| RobotPolicy::new(chain.clone(), vec![vec![skill]], &points, config);
    let default = |count: usize| {
        let model = with_components(&loaded.skills[0].model, count);
        let policy = policy(model.policy().expect("what was a skill is one"));
        (count, measure(tick(&policy, q, &frames, &[])))
    };
    report.series("components, default policy", [5, 10, 15, 20, 30, 40, 50].map(default).into());
    let whole = policy(loaded.skills[0].model.policy().expect("a skill"));
    let crowded = |count: usize| {
        let crowd = obstacles(count);
        (count, measure(tick(&whole, q, &frames, &crowd)))
    };
    let counts = [0, 4, 8, 16, 24, 32];
    report.series("obstacles, default policy", counts.map(crowded).into());
    let near = counts.map(|count| near_pairs(&chain, &points, config, &obstacles(count)));
    println!("    an obstacle costs what its near pairs do; pairs that are near: {near:?}");

    let (thesis, ..) = load::<6>("ur5_pick.ron", "pick_thesis.model.ron");
    let still = both(pick_frames, 0.0);
    let product = |components: usize, frames: &[Vec<MovingPose>; 2]| {
        let policy = policy(with_product(&thesis.skills[0].modes[0], components, frames[0].len()));
        measure(tick(&policy, q, frames, &[]))
    };
    let counts = [5, 10, 15, 20, 30, 40, 50];
    let rows = counts.map(|count| (count, product(count, &still)));
    report.series("components, thesis policy, frames unchanged", rows.into());
    let rows = counts.map(|count| (count, product(count, &frames)));
    report.series("components, thesis policy, frames moved", rows.into());
    let rows = [1, 2, 3, 4, 6, 8].map(|count| {
        let repeated =
            |set: &Vec<MovingPose>| set.iter().cycle().take(count).copied().collect::<Vec<_>>();
        (count, product(15, &frames.each_ref().map(repeated)))
    });
    report.series("frames, thesis policy, frames moved", rows.into());

    let all = [
        joints::<2>(),
        joints::<3>(),
        joints::<4>(),
        joints::<5>(),
        joints::<6>(),
        joints::<7>(),
        joints::<8>(),
    ];
    for (i, name) in ["kinematics", "inverse dynamics", "pullback and resolve"].iter().enumerate() {
        report.series(&format!("joints, {name}"), all.map(|times| times[i]).into());
    }
}

fn evaluation(criterion: &mut Criterion) {
    let mut report = Report { criterion, rows: Vec::new() };
    promised(&mut report);
    growth(&mut report);
    results::replace("evaluation", &report.rows).unwrap_or_else(|e| panic!("{e}"));
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = evaluation
}
criterion_main!(benches);
