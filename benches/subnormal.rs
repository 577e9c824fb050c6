//! Whether numbers close to zero slow a tick down: processors compute with subnormal ones (below
//! 2.2e-308) by microcode. The loop does not flush them to zero, since Rust assumes the processor's
//! ordinary arithmetic; this measures what they cost. Cases are measured alternately, best of batches.

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use glam::DVec3;
use nalgebra::SVector;
use tprmp_bench::results::{self, Verdict};
use tprmp_controller::policy::{RobotPolicy, Task, TaskParameters};
use tprmp_controller::startup;
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

const BATCHES: usize = 60;
const BATCH: u32 = 100;
/// A subnormal number.
const TINY: f64 = 1e-310;
/// A tick may take so many times as long with them.
const RATIO_MAX: f64 = 3.0;

fn policy<const N: usize>(controller: &str, model: &str) -> RobotPolicy<N> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = root.join("config/controllers").join(controller);
    let model = root.join("target/bench").join(model);
    assert!(model.exists(), "{} is missing: run `make bench`", model.display());
    let loaded = startup::load(&config, &[model], false).expect("the shipped files are valid");
    let (chain, points) = startup::robot::<N>(&config, &loaded.config).expect("a valid robot");
    RobotPolicy::new(chain, loaded.policies(), &points, &loaded.config)
}

/// Joint positions, their speed, and that of the frames.
struct Case<const N: usize> {
    q: SVector<f64, N>,
    speed: f64,
}

/// Frames that all move and accelerate by this much, along each axis.
fn frames(positions: [[f64; 3]; 2], rate: f64) -> [MovingPose; 2] {
    positions.map(|position| MovingPose {
        velocity: Twist { linear: DVec3::splat(rate), angular: DVec3::Z * rate },
        acceleration: SpatialAcceleration { linear: DVec3::splat(rate), angular: DVec3::Z * rate },
        ..MovingPose::at_rest(Pose { position: position.into(), ..Pose::IDENTITY })
    })
}

/// Best time of a tick in each case \[ns\].
fn measure<const N: usize>(
    policy: &RobotPolicy<N>,
    positions: [[f64; 3]; 2],
    cases: &[Case<N>],
) -> Vec<f64> {
    let mut best = vec![f64::INFINITY; cases.len()];
    let mut workspace = policy.workspace();
    for _ in 0..BATCHES {
        for (best, case) in best.iter_mut().zip(cases) {
            let frames = frames(positions, case.speed);
            let parameters = TaskParameters {
                frames: &frames,
                goal_frame: 1,
                obstacles: &[],
                external: None,
                dt_s: 1e-3,
            };
            let qd = SVector::repeat(case.speed);
            let since = Instant::now();
            for _ in 0..BATCH {
                let (q, qd) = (black_box(&case.q), black_box(&qd));
                let decision = policy.evaluate(q, qd, &Task::Skill, &parameters, &mut workspace);
                let _ = black_box(decision);
            }
            *best = best.min(since.elapsed().as_nanos() as f64 / f64::from(BATCH));
        }
    }
    best
}

fn row(name: &str, ordinary_ns: f64, subnormal_ns: f64) -> serde_json::Value {
    let verdict = Verdict::at_most(subnormal_ns / ordinary_ns, RATIO_MAX, "times as long");
    println!(
        "{name:<44} {ordinary_ns:>8.0} ns {subnormal_ns:>8.0} ns  {}: {}",
        verdict.found,
        verdict.word()
    );
    serde_json::json!({
        "group": "subnormal", "name": name, "ordinary_ns": ordinary_ns,
        "subnormal_ns": subnormal_ns, "verdict": verdict,
    })
}

fn main() {
    println!("{:<44} {:>11} {:>11}", "a tick", "ordinary", "subnormal");
    let mut rows = Vec::new();

    let pick = policy::<6>("ur5_pick.ron", "pick.model.ron");
    let q = SVector::<f64, 6>::from([-3.4, -1.7, 2.0, -1.9, -1.5, -0.3]);
    let cases = [Case { q, speed: 0.1 }, Case { q, speed: TINY }];
    let times = measure(&pick, [[0.41, 0.29, 0.31], [0.5, -0.25, 0.03]], &cases);
    rows.push(row("UR5, subnormal velocities", times[0], times[1]));

    let planar = policy::<2>("planar.ron", "planar.model.ron");
    let positions = [[-1.3, 0.0, 0.0], [1.2, -0.1, 0.0]];
    let q = SVector::<f64, 2>::from([-0.2, 0.3]);
    let cases = [Case { q, speed: 0.1 }, Case { q, speed: TINY }];
    let times = measure(&planar, positions, &cases);
    rows.push(row("point, subnormal velocities", times[0], times[1]));

    // Away from the skill, where weights of Gaussians vanish through the subnormal numbers.
    let cases: Vec<_> = (0..160)
        .map(|k| Case { q: q + SVector::from([0.0, 0.025 * f64::from(k)]), speed: 0.1 })
        .collect();
    let times = measure(&planar, positions, &cases);
    let slowest = times.iter().copied().fold(0.0, f64::max);
    rows.push(row("point, slowest place up to 4 m away", times[0], slowest));

    results::replace("subnormal", &rows).expect("target/bench can be written");
}
