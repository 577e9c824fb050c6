//! Fits the thesis' policy on the products of the frames' Gaussians  [thesis section 4.2.4, 4.2.6].
//!
//! **Potential.** Its natural gradient follows the demonstrated direction of motion:
//!
//! ```text
//! minimise    Σ_i Σ_t ‖ζ̂_it + M_i⁻¹ ∇Φ_i(ζ_it)‖          [thesis eq. 4.15]
//! subject to  0 = φ⁰_K ≤ φ⁰_{k+1} ≤ φ⁰_k                   [thesis eq. 4.16]
//! ```
//!
//! ζ̂ is the unit vector of the velocity. ∇Φ is affine in φ⁰, and a sum of norms that are not squared
//! is a second-order cone program, not a quadratic one. Φ is determined up to a constant; φ⁰_K = 0
//! fixes it, and with it the energy below.
//!
//! **Damping.** The energy that it dissipates along a demonstration, D_it = Σ_{s<t} ẋᵀB(d)ẋ Δt, is
//! the energy that the demonstration loses:
//!
//! ```text
//! minimise    Σ_i |H_i − D_iT|                               [thesis eq. 4.20], or
//!             Σ_i 1/T Σ_t |H_i1 − H_it − D_it|               the whole profile
//! subject to  ε ≤ d_1,  d_k ≤ d_{k+1}                        [thesis eq. 4.21]
//! ```
//!
//! with H = ½ẋᵀMẋ + Φ. The first has as many equations as demonstrations for K unknowns; of its many
//! solutions an interior-point method ends in the middle, as the published ones do.

use glam::DVec3;
use nalgebra::{Cholesky, DMatrix, SVector};
use rayon::prelude::*;
use tprmp_model::skill_model::{
    ActiveConstraints, Constraints, Figure, FrameMixture, Manifold, PolicyModel, Program,
    ProgramFit, ThesisModel, thesis_policy,
};
use tprmp_rmpflow::policy::thesis::{GaussianField, ThesisState};
use tprmp_spatial::rotation::rotation_vector;
use tprmp_spatial::{MovingPose, Pose};

use crate::alignment::rest::DemonstrationError;
use crate::canonical::savitzky_golay::smooth;
use crate::demonstration::Demonstration;
use crate::fit::conic::{Affine, ConicProgram, Solution};
use crate::fit::error::{FitError, NotSolved};
use crate::skill::{DampingTarget, Skill, ThesisSettings};

/// Neighbours that differ by less than this fraction of the largest value are equal.
const ACTIVE: f64 = 1e-4;

/// A sample of a demonstration in the chart of its field.
#[derive(Clone, Copy, Debug)]
pub struct Sample<const D: usize> {
    /// ζ [m, rad].
    pub point: SVector<f64, D>,
    /// ζ̇ [m/s, rad/s].
    pub velocity: SVector<f64, D>,
    /// Time until the next sample \[s\].
    pub step_s: f64,
}

/// A demonstration, and the field of the products with its frames.
#[derive(Clone, Debug)]
pub struct Demonstrated<const D: usize> {
    /// Its samples, in order.
    pub samples: Vec<Sample<D>>,
    /// The field.
    pub field: GaussianField<D>,
}

/// What potential and damping are fitted to.
pub struct ThesisFit<'a> {
    /// The learned mixture of each frame.
    pub mixture: &'a [FrameMixture],
    /// The skill.
    pub skill: &'a Skill,
    /// How its policy is fitted.
    pub settings: &'a ThesisSettings,
    /// The demonstrations, without rests.
    pub demonstrations: &'a [Demonstration],
}

impl ThesisFit<'_> {
    /// Fits potential and damping.
    ///
    /// # Errors
    /// The Gaussians of the frames cannot be multiplied, or a program is not solved.
    pub fn fit(&self) -> Result<(PolicyModel, Vec<ProgramFit>), FitError> {
        match self.skill.manifold {
            Manifold::R2 => self.fit_in::<2>(),
            Manifold::R3 => self.fit_in::<3>(),
            Manifold::R3S1 | Manifold::S3 | Manifold::R3S3 => self.fit_in::<6>(),
        }
    }

    fn fit_in<const D: usize>(&self) -> Result<(PolicyModel, Vec<ProgramFit>), FitError> {
        let components = self.mixture[0].gaussians.len();
        let mut thesis = ThesisModel {
            metric_scale: self.settings.metric_scale,
            huber_threshold: self.settings.huber_threshold,
            potentials: vec![0.0; components],
            damping: vec![self.settings.damping_min; components],
        };
        let demonstrated = |thesis: &ThesisModel| -> Result<Vec<_>, DemonstrationError> {
            self.demonstrations.par_iter().map(|d| self.in_chart::<D>(thesis, d)).collect()
        };
        let (potentials, potential_fit) = fit_potential(&demonstrated(&thesis)?, self.settings)?;
        thesis.potentials = potentials;
        let (damping, damping_fit) = fit_damping(&demonstrated(&thesis)?, self.settings)?;
        thesis.damping = damping;
        Ok((PolicyModel::Thesis(thesis), vec![potential_fit, damping_fit]))
    }

    /// The samples of a demonstration in the chart of the field with its frames.
    fn in_chart<const D: usize>(
        &self,
        thesis: &ThesisModel,
        demonstration: &Demonstration,
    ) -> Result<Demonstrated<D>, DemonstrationError> {
        let not_a_product = || DemonstrationError {
            name: demonstration.name.clone(),
            problem: "the Gaussians of its frames cannot be multiplied".into(),
        };
        let products = thesis_policy::<D>(self.mixture, thesis).map_err(|_| not_a_product())?;
        let frames = self.skill.frames(demonstration);
        let frames: Vec<_> = frames.into_iter().map(MovingPose::at_rest).collect();
        let mut state = ThesisState::default();
        products.update(&frames, &mut state);
        let field = state.field().ok_or_else(not_a_product)?.clone();
        let chart = state.goal().orientation.conjugate();
        let dt = demonstration.sampling_time_s;
        let smoothed = |samples: Vec<DVec3>| {
            if self.settings.kaiser_smoothing.is_some() {
                let velocities = differences(&samples, dt);
                return (samples, velocities);
            }
            let smoothing = &self.skill.smoothing;
            let path = smooth(&samples, dt, smoothing.window_s, smoothing.degree);
            (path.points, path.velocities)
        };
        let rotation = |pose: &Pose| match D {
            6 => rotation_vector(chart * pose.orientation),
            _ => DVec3::ZERO,
        };
        let poses = &demonstration.poses;
        let (position, linear) = smoothed(poses.iter().map(|pose| pose.position).collect());
        let (rotation, angular) = smoothed(poses.iter().map(rotation).collect());
        let joined = |linear: DVec3, angular: DVec3| {
            SVector::<f64, D>::from_fn(|i, _| if i < 3 { linear[i] } else { angular[i - 3] })
        };
        let stride = self.settings.stride;
        let sample = |i: usize| Sample {
            point: joined(position[i], rotation[i]),
            velocity: joined(linear[i], angular[i]),
            step_s: dt * stride as f64,
        };
        let samples = (0..poses.len()).step_by(stride).map(sample).collect();
        Ok(Demonstrated { samples, field })
    }
}

/// Velocities as differences to the next sample; the last one is repeated.
fn differences(samples: &[DVec3], sampling_time_s: f64) -> Vec<DVec3> {
    let mut velocities: Vec<_> =
        samples.windows(2).map(|pair| (pair[1] - pair[0]) / sampling_time_s).collect();
    velocities.extend(velocities.last().copied());
    velocities
}

/// φ⁰_k by eq. 4.15–4.16, from fields the bias potentials of which are zero.
///
/// # Errors
/// [`NotSolved`] when the solver finds no solution.
///
/// # Panics
/// When there is no demonstration.
pub fn fit_potential<const D: usize>(
    all: &[Demonstrated<D>],
    settings: &ThesisSettings,
) -> Result<(Vec<f64>, ProgramFit), NotSolved> {
    // Rows of ζ̂ + M⁻¹∇Φ as affine functions of φ⁰_1 … φ⁰_{K−1}.
    let free = all[0].field.components().len() - 1;
    let mut residuals: Vec<[Affine; D]> = Vec::new();
    for one in all {
        let speed = |sample: &Sample<D>| sample.velocity.norm();
        let fastest = one.samples.iter().map(speed).fold(0.0, f64::max);
        for sample in
            one.samples.iter().filter(|s| speed(s) > settings.speed_fraction_min * fastest)
        {
            let value = one.field.evaluate(&sample.point, &SVector::zeros());
            let terms = one.field.terms(&sample.point);
            let gradient: SVector<f64, D> =
                terms.iter().map(|t| t.attraction + t.weight_gradient * t.potential).sum();
            let Some(metric) = Cholesky::new(value.metric) else { continue };
            let constant = sample.velocity.normalize() + metric.solve(&gradient);
            let columns: Vec<_> =
                terms[..free].iter().map(|term| metric.solve(&term.weight_gradient)).collect();
            residuals.push(std::array::from_fn(|i| Affine {
                constant: constant[i],
                coefficients: columns.iter().map(|c| c[i]).enumerate().collect(),
            }));
        }
    }
    let count = residuals.len();
    // x = (φ⁰_1 … φ⁰_{K−1}, one norm a sample); the mean norm is minimised.
    let mut linear = vec![0.0; free];
    linear.extend(std::iter::repeat_n(1.0 / count.max(1) as f64, count));
    let mut program = ConicProgram::new(DMatrix::zeros(0, 0), linear);
    program.require_nonnegative((0..free).map(|k| falls(k, free)).collect());
    for (j, residual) in residuals.iter().enumerate() {
        let mut cone = vec![Affine { constant: 0.0, coefficients: vec![(free + j, 1.0)] }];
        cone.extend(residual.iter().cloned());
        program.require_second_order(cone);
    }
    let solution =
        program.solve().map_err(|failure| NotSolved::new(Program::Potential, failure))?;
    let mut potentials = solution.x[..free].to_vec();
    potentials.push(0.0);
    // What the solver's tolerance left of the order.
    for k in (0..free).rev() {
        potentials[k] = potentials[k].max(potentials[k + 1]);
    }
    let norm = |residual: &[Affine; D]| -> f64 {
        residual.iter().map(|row| row.at(&potentials).powi(2)).sum::<f64>().sqrt()
    };
    let residual = residuals.iter().map(norm).sum::<f64>() / count.max(1) as f64;
    let equal = equal_neighbours(&potentials);
    let active = vec![active(Constraints::PotentialOrder, equal, free)];
    Ok((potentials, figures(Program::Potential, &solution, residual, active, count)))
}

/// φ⁰_k − φ⁰_{k+1}; the last φ⁰ is zero.
fn falls(k: usize, free: usize) -> Affine {
    let mut coefficients = vec![(k, 1.0)];
    if k + 1 < free {
        coefficients.push((k + 1, -1.0));
    }
    Affine { constant: 0.0, coefficients }
}

/// d_k by eq. 4.18–4.21, with the potentials of the fields.
///
/// # Errors
/// [`NotSolved`] when the solver finds no solution.
///
/// # Panics
/// When there is no demonstration.
pub fn fit_damping<const D: usize>(
    all: &[Demonstrated<D>],
    settings: &ThesisSettings,
) -> Result<(Vec<f64>, ProgramFit), NotSolved> {
    let components = all[0].field.components().len();
    let rows = energy_rows(all, settings.damping_target, components);
    let size = rows.iter().map(|row| row.lost.abs()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    // x = (d_1 … d_K, one absolute value a row), d in units of an even damping that dissipates the
    // energy, energies in units of the largest.
    let scale = 1.0 / (size * all.len() as f64);
    let most = |row: &EnergyRow| row.dissipated.iter().sum::<f64>();
    let even = size / rows.iter().map(most).fold(f64::MIN_POSITIVE, f64::max);
    let mut nonnegative =
        vec![Affine { constant: -settings.damping_min / even, coefficients: vec![(0, 1.0)] }];
    nonnegative.extend(
        (1..components)
            .map(|k| Affine { constant: 0.0, coefficients: vec![(k - 1, -1.0), (k, 1.0)] }),
    );
    for (j, EnergyRow { lost, dissipated, .. }) in rows.iter().enumerate() {
        for sign in [1.0, -1.0] {
            let mut coefficients: Vec<(usize, f64)> =
                dissipated.iter().map(|x| sign * x * even / size).enumerate().collect();
            coefficients.push((components + j, 1.0));
            nonnegative.push(Affine { constant: -sign * lost / size, coefficients });
        }
    }
    let mut linear = vec![0.0; components];
    linear.extend(rows.iter().map(|row| row.weight / all.len() as f64));
    let mut program = ConicProgram::new(DMatrix::zeros(0, 0), linear);
    program.require_nonnegative(nonnegative);
    let solution = program.solve().map_err(|failure| NotSolved::new(Program::Damping, failure))?;
    let mut damping: Vec<f64> = solution.x[..components].iter().map(|d| d * even).collect();
    // What the solver's tolerance left of bound and order.
    let mut least = settings.damping_min;
    for d in &mut damping {
        *d = d.max(least);
        least = *d;
    }
    let error = |EnergyRow { weight, lost, dissipated }: &EnergyRow| {
        let sum: f64 = dissipated.iter().zip(&damping).map(|(x, d)| x * d).sum();
        weight * (lost - sum).abs()
    };
    let residual = rows.iter().map(error).sum::<f64>() * scale;
    let at_floor = damping.iter().filter(|d| **d <= settings.damping_min * (1.0 + ACTIVE)).count();
    let active = vec![
        active(Constraints::DampingMin, at_floor, components),
        active(Constraints::DampingOrder, equal_neighbours(&damping), components - 1),
    ];
    Ok((damping, figures(Program::Damping, &solution, residual, active, rows.len())))
}

/// weight · |energy lost − Σ d_k dissipated_k|.
struct EnergyRow {
    weight: f64,
    lost: f64,
    dissipated: Vec<f64>,
}

fn energy_rows<const D: usize>(
    all: &[Demonstrated<D>],
    target: DampingTarget,
    components: usize,
) -> Vec<EnergyRow> {
    let mut rows = Vec::new();
    for one in all {
        let energy = |sample: &Sample<D>| {
            one.field.evaluate(&sample.point, &sample.velocity).energy(&sample.velocity)
        };
        let at_start = energy(&one.samples[0]);
        let mut dissipated = vec![0.0; components];
        let weight = 1.0 / one.samples.len() as f64;
        for sample in &one.samples {
            if target == DampingTarget::EnergyProfile {
                let lost = at_start - energy(sample);
                rows.push(EnergyRow { weight, lost, dissipated: dissipated.clone() });
            }
            let terms = one.field.terms(&sample.point);
            let power = sample.velocity.norm_squared() * sample.step_s;
            for (sum, term) in dissipated.iter_mut().zip(terms) {
                *sum += term.weight * power;
            }
        }
        if target == DampingTarget::TotalEnergy {
            rows.push(EnergyRow { weight: 1.0, lost: at_start, dissipated });
        }
    }
    rows
}

fn equal_neighbours(values: &[f64]) -> usize {
    let largest = values.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    values.windows(2).filter(|pair| (pair[0] - pair[1]).abs() <= ACTIVE * largest).count()
}

fn active(name: Constraints, active: usize, count: usize) -> ActiveConstraints {
    ActiveConstraints { name, active: active as u32, count: count as u32 }
}

fn figures(
    name: Program,
    solution: &Solution,
    residual: f64,
    active: Vec<ActiveConstraints>,
    samples: usize,
) -> ProgramFit {
    ProgramFit {
        name,
        status: solution.status,
        iterations: solution.iterations,
        objective: solution.objective,
        residual,
        active,
        figures: vec![(Figure::Samples, samples as f64)],
    }
}
