//! Products of Gaussians, their field, and the thesis' programs against an independent
//! implementation: `thesis_oracle.py` makes `thesis_oracle.json` of data and solutions.

use glam::{DQuat, DVec3};
use nalgebra::{Matrix2, Vector2};
use serde::Deserialize;
use tprmp_learner::fit::thesis::{Demonstrated, Sample, fit_damping, fit_potential};
use tprmp_learner::skill::{DampingTarget, ThesisSettings};
use tprmp_model::skill_model::{
    FrameGaussian, FrameMixture, ProgramStatus, ThesisModel, thesis_policy,
};
use tprmp_rmpflow::policy::thesis::{GaussianField, ThesisState};
use tprmp_spatial::{MovingPose, Pose};

type Vector = [f64; 2];
type Matrix = [[f64; 2]; 2];

#[derive(Deserialize)]
struct Oracle {
    metric_scale: f64,
    huber_threshold: f64,
    damping_min: f64,
    step_s: f64,
    frames: Vec<Mixture>,
    demonstrations: Vec<Demonstration>,
    potentials: Vec<f64>,
    potential_objective: f64,
    damping: Vec<Damping>,
}

#[derive(Deserialize)]
struct Mixture {
    means: Vec<Vector>,
    covariances: Vec<Matrix>,
}

#[derive(Deserialize)]
struct Demonstration {
    frames: Vec<Frame>,
    points: Vec<Vector>,
    velocities: Vec<Vector>,
    means: Vec<Vector>,
    precisions: Vec<Matrix>,
    probes: Vec<Probe>,
}

#[derive(Deserialize)]
struct Frame {
    angle_rad: f64,
    origin_m: Vector,
}

#[derive(Deserialize)]
struct Probe {
    point: Vector,
    velocity: Vector,
    weights: Vec<f64>,
    potential: f64,
    gradient: Vector,
    metric: Matrix,
    curvature: Vector,
}

#[derive(Deserialize)]
struct Damping {
    target: DampingTarget,
    demonstrations: usize,
    damping: Vec<f64>,
    objective: f64,
}

fn matrix(rows: &Matrix) -> Matrix2<f64> {
    Matrix2::from_fn(|i, j| rows[i][j])
}

impl Oracle {
    fn read() -> Self {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/thesis_oracle.json");
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
    }

    fn settings(&self, damping_target: DampingTarget) -> ThesisSettings {
        ThesisSettings {
            metric_scale: self.metric_scale,
            huber_threshold: self.huber_threshold,
            damping_min: self.damping_min,
            damping_target,
            speed_fraction_min: 0.02,
            stride: 1,
            kaiser_smoothing: None,
        }
    }

    /// The field with the frames of a demonstration.
    fn field(&self, demonstration: &Demonstration, potentials: &[f64]) -> GaussianField<2> {
        let mixture = |(p, frame): (usize, &Mixture)| FrameMixture {
            agreement: Vec::new(),
            agreement_fraction: None,
            name: format!("frame {p}"),
            gaussians: std::iter::zip(&frame.means, &frame.covariances)
                .map(|(mean, covariance)| FrameGaussian {
                    position_m: mean.to_vec(),
                    quaternion_wxyz: None,
                    covariance: covariance.map(|row| row.to_vec()).to_vec(),
                })
                .collect(),
        };
        let frames: Vec<_> = self.frames.iter().enumerate().map(mixture).collect();
        let thesis = ThesisModel {
            metric_scale: self.metric_scale,
            huber_threshold: self.huber_threshold,
            potentials: potentials.to_vec(),
            damping: vec![1.0; potentials.len()],
        };
        let policy = thesis_policy::<2>(&frames, &thesis).unwrap();
        let at = |frame: &Frame| {
            let [x, y] = frame.origin_m;
            MovingPose::at_rest(Pose {
                position: DVec3::new(x, y, 0.0),
                orientation: DQuat::from_rotation_z(frame.angle_rad),
            })
        };
        let mut state = ThesisState::default();
        policy.update(&demonstration.frames.iter().map(at).collect::<Vec<_>>(), &mut state);
        state.field().unwrap().clone()
    }

    fn demonstrated(&self, potentials: &[f64]) -> Vec<Demonstrated<2>> {
        let in_chart = |demonstration: &Demonstration| Demonstrated {
            samples: std::iter::zip(&demonstration.points, &demonstration.velocities)
                .map(|(point, velocity)| Sample {
                    point: Vector2::from(*point),
                    velocity: Vector2::from(*velocity),
                    step_s: self.step_s,
                })
                .collect(),
            field: self.field(demonstration, potentials),
        };
        self.demonstrations.iter().map(in_chart).collect()
    }
}

#[track_caller]
fn assert_near(found: &[f64], expected: &[f64], fraction: f64) {
    let largest = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < fraction * largest, "{found} {expected}");
    }
}

#[test]
fn products_of_gaussians_agree_with_eq_3_6() {
    let oracle = Oracle::read();
    for demonstration in &oracle.demonstrations {
        let field = oracle.field(demonstration, &oracle.potentials);
        for (k, (mean, precision)) in field.components().enumerate() {
            assert!((mean - Vector2::from(demonstration.means[k])).norm() < 1e-12);
            let expected = matrix(&demonstration.precisions[k]);
            assert!((precision - expected).norm() < 1e-10 * expected.norm());
        }
    }
}

#[test]
fn the_field_agrees_with_eq_4_5_to_4_14() {
    let oracle = Oracle::read();
    for demonstration in &oracle.demonstrations {
        let field = oracle.field(demonstration, &oracle.potentials);
        for probe in &demonstration.probes {
            let (point, velocity) = (Vector2::from(probe.point), Vector2::from(probe.velocity));
            let value = field.evaluate(&point, &velocity);
            let terms = &field.terms(&point)[..probe.weights.len()];
            let weights: Vec<_> = terms.iter().map(|term| term.weight).collect();
            assert_near(&weights, &probe.weights, 1e-10);
            assert!((value.potential - probe.potential).abs() < 1e-10 * probe.potential.abs());
            assert_near(value.gradient.as_slice(), &probe.gradient, 1e-9);
            let metric = matrix(&probe.metric);
            // Near the middle of a component terms of the size of the metric cancel.
            let size = 1e-12 * metric.norm() + 1e-9 * Vector2::from(probe.curvature).norm();
            assert!((value.curvature - Vector2::from(probe.curvature)).norm() < size);
            assert!((value.metric - metric).norm() < 1e-10 * metric.norm());
        }
    }
}

#[test]
fn the_potentials_agree_with_eq_4_15_and_4_16() {
    let oracle = Oracle::read();
    let demonstrated = oracle.demonstrated(&vec![0.0; oracle.potentials.len()]);
    let (potentials, figures) =
        fit_potential(&demonstrated, &oracle.settings(DampingTarget::TotalEnergy)).unwrap();
    assert_eq!(figures.status, ProgramStatus::Solved);
    assert!((figures.residual / oracle.potential_objective - 1.0).abs() < 1e-7);
    assert!((figures.objective / oracle.potential_objective - 1.0).abs() < 1e-7);
    assert_near(&potentials, &oracle.potentials, 2e-4);
    // They never rise; between two of them the constraint holds with equality.
    assert!(potentials.is_sorted_by(|a, b| a >= b));
    assert_eq!(potentials[4], 0.0);
    assert_eq!((figures.active[0].active, figures.active[0].count), (1, 4));
}

#[test]
fn the_damping_agrees_with_eq_4_17_to_4_21() {
    let oracle = Oracle::read();
    assert_eq!(oracle.damping.len(), 3);
    let demonstrated = oracle.demonstrated(&oracle.potentials);
    for expected in &oracle.damping {
        let some = &demonstrated[..expected.demonstrations];
        let (damping, figures) = fit_damping(some, &oracle.settings(expected.target)).unwrap();
        assert_eq!(figures.status, ProgramStatus::Solved);
        assert!((figures.residual - expected.objective).abs() < 1e-6, "{}", figures.residual);
        // As many equations as demonstrations leave the rest open.
        if expected.target == DampingTarget::EnergyProfile {
            assert_near(&damping, &expected.damping, 1e-3);
        }
        assert!(damping[0] >= oracle.damping_min && damping.is_sorted());
    }
}
