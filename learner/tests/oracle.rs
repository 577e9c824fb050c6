//! The convex program against an independent implementation on synthetic data: `oracle.py` (numpy,
//! cvxpy) makes `oracle.json` with the data, the mixture and the solution found there.

use nalgebra::{DVector, Matrix3, Vector3};
use rand::SeedableRng;
use serde::Deserialize;
use tprmp_learner::fit::targets::BlockPath;
use tprmp_learner::fit::{fit, shape};
use tprmp_learner::mixture::tp_gmm::Samples;
use tprmp_learner::skill::{FieldSettings, FitSettings, Skill};
use tprmp_model::skill_model::{Figure, Program, ProgramStatus};

#[derive(Deserialize)]
struct Oracle {
    components: usize,
    goal: [f64; 3],
    points: Vec<Vec<[f64; 3]>>,
    velocities: Vec<Vec<[f64; 3]>>,
    accelerations: Vec<Vec<[f64; 3]>>,
    means: Vec<[f64; 3]>,
    metrics: Vec<[[f64; 3]; 3]>,
    parameters: Vec<f64>,
    residual: f64,
    hinge: f64,
    objective: f64,
    probe_points: Vec<[f64; 3]>,
    probe_velocities: Vec<[f64; 3]>,
    probe_accelerations: Vec<[f64; 3]>,
    probe_potentials: Vec<f64>,
}

#[test]
fn the_fit_agrees_with_an_independent_one() {
    let here = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(here.join("tests/oracle.json")).unwrap();
    let oracle: Oracle = serde_json::from_str(&text).unwrap();
    let skill = Skill::read(&here.join("../config/skills/planar.ron")).unwrap();
    let FitSettings::Canonical(settings) = &skill.fit else { panic!("a canonical skill") };
    // Random points are not the same in another language: descent is a constraint at the samples only.
    let settings = &FieldSettings {
        descent_points_random: 0,
        refinement_rounds_max: 0,
        phase_weight: 1.0,
        ..settings.clone()
    };

    let joint: Vec<Vec<DVector<f64>>> = oracle
        .points
        .iter()
        .map(|path| path.iter().map(|z| DVector::from_column_slice(&z[..2])).collect())
        .collect();
    let times = |path: &Vec<[f64; 3]>| {
        let last = (path.len() - 1) as f64;
        (0..path.len()).map(move |i| i as f64 / last).collect::<Vec<_>>()
    };
    let times = oracle.points.iter().flat_map(times).collect();
    let phases = oracle.points.iter().flatten().map(|z| z[2] / oracle.goal[2]).collect();
    let samples = Samples::canonical(&joint, times, phases);
    let mixture = samples.learn(&skill, oracle.components, 1).unwrap();
    let gaussians = &mixture.phased;
    let means: Vec<_> =
        gaussians.iter().map(|g| Vector3::from_column_slice(g.mean.as_slice())).collect();
    let covariances: Vec<_> =
        gaussians.iter().map(|g| g.covariance.fixed_view::<3, 3>(0, 0).into_owned()).collect();
    let goal = Vector3::from(oracle.goal);
    assert!((mixture.phase_length - goal[2]).abs() < 1e-12);
    let shape = shape(&means, &covariances, &goal, settings).unwrap();
    for (component, (mean, metric)) in
        shape.bare().components().iter().zip(oracle.means.iter().zip(&oracle.metrics))
    {
        let apart = component.mean - Vector3::from(*mean);
        assert!(apart.norm() < 1e-8, "{apart}");
        let metric = Matrix3::from_fn(|i, j| metric[i][j]);
        assert!((component.metric - metric).norm() < 1e-7);
    }

    let vectors = |rows: &Vec<[f64; 3]>| rows.iter().map(|y| Vector3::from(*y)).collect();
    let paths: Vec<_> = (0..oracle.points.len())
        .map(|i| BlockPath {
            points: vectors(&oracle.points[i]),
            velocities: vectors(&oracle.velocities[i]),
            accelerations: vectors(&oracle.accelerations[i]),
        })
        .collect();
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let fitted = fit(Program::PositionField, shape, &paths, settings, &mut random).unwrap();
    let figures = &fitted.figures;
    assert_eq!(figures.status, ProgramStatus::Solved);
    let [found, expected] = [figures.objective, oracle.objective];
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected} {figures:?}");
    assert!((figures.residual - oracle.residual).abs() < 1e-6);
    let hinge = figures.figure(Figure::Hinge).unwrap();
    assert!((hinge - oracle.hinge).abs() < 1e-6);

    let largest = oracle.parameters.iter().fold(0.0_f64, |m, p| m.max(p.abs()));
    for (mine, theirs) in fitted.parameters.iter().zip(&oracle.parameters) {
        assert!((mine - theirs).abs() < 1e-3 * largest, "{mine} {theirs}");
    }
    let field = fitted.shape.field(&fitted.parameters);
    for i in 0..oracle.probe_points.len() {
        let velocity = Vector3::from(oracle.probe_velocities[i]);
        let value = field.evaluate(&Vector3::from(oracle.probe_points[i]), &velocity);
        let acceleration = value.metric.cholesky().unwrap().solve(&value.force(&velocity));
        let expected = Vector3::from(oracle.probe_accelerations[i]);
        assert!((acceleration - expected).norm() < 1e-3 * (1.0 + expected.norm()));
        assert!((value.potential - oracle.probe_potentials[i]).abs() < 1e-3 * largest);
    }
}
