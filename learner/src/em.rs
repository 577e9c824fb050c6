//! Expectation maximisation of Gaussians that several views of the same samples share.
//!
//! A view is a coordinate system: a frame, or the canonical space. Responsibilities are common to
//! all views; each view has means and covariances of its own  [thesis eq. 3.4–3.5]. Coordinates are
//! Euclidean ones, orientations, or both: means on S³ are those of the least sum of squared angles,
//! covariances stand in the tangent space at the mean, as rotation vectors in its own axes.

use std::ops::Range;

use glam::{DQuat, DVec3};
use nalgebra::{DMatrix, DVector};
use tprmp_rmpflow::rotation::rotation_vector;

use crate::orientation::mean_orientation;
use crate::skill::Ordering;

/// Most coordinates of a view: time, position, rotation.
const DIMENSION_MAX: usize = 7;
/// A component without samples must not divide by zero.
const WEIGHT_FLOOR: f64 = 1e-9;

/// The samples in one coordinate system.
#[derive(Clone, Debug)]
pub struct View {
    /// Euclidean coordinates, one column a sample.
    pub euclidean: DMatrix<f64>,
    /// Orientations, one a sample, for views that have them.
    pub orientations: Option<Vec<DQuat>>,
    /// Factor on rotation vectors, which makes them comparable with the other coordinates [1/rad].
    pub rotation_scale: f64,
}

/// A Gaussian of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian {
    /// Mean of the Euclidean coordinates.
    pub mean: DVector<f64>,
    /// Mean orientation.
    pub orientation: Option<DQuat>,
    /// Covariance of (Euclidean coordinates, scaled rotation vector in axes of the mean), without
    /// the regularisation.
    pub covariance: DMatrix<f64>,
}

/// What is known of the order of the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topology {
    /// Nothing: a mixture.
    Mixture,
    /// States are passed in order, none left out: a left–right hidden Markov model
    /// [Rabiner 1989, section IV.B].
    LeftRight,
}

/// Samples, and where the iterations start.
#[derive(Clone, Debug)]
pub struct Data {
    /// At least one.
    pub views: Vec<View>,
    /// The samples of each demonstration.
    pub sequences: Vec<Range<usize>>,
    /// Time of each sample as a share of its demonstration's.
    pub times: Vec<f64>,
    /// Responsibility of component k (column) for sample i (row).
    pub responsibilities: DMatrix<f64>,
}

/// Settings of the iterations.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// What is known of the order of the samples.
    pub topology: Topology,
    /// How many.
    pub iterations: u32,
    /// Added to the covariances' diagonal wherever they are inverted.
    pub regularisation: f64,
    /// How the components of a mixture are put in order; states of a left–right model are.
    pub ordering: Ordering,
}

/// What expectation maximisation found.
#[derive(Clone, Debug)]
pub struct Maximised {
    /// Responsibility of component k (column) for sample i (row), components in order.
    pub responsibilities: DMatrix<f64>,
    /// Share of the samples of each component.
    pub priors: Vec<f64>,
    /// Mean time of each component's samples.
    pub times: Vec<f64>,
    /// Gaussians of each view.
    pub gaussians: Vec<Vec<Gaussian>>,
    /// Mean log-likelihood of a sample after each maximisation [nat].
    pub log_likelihoods: Vec<f64>,
}

impl View {
    /// Samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.euclidean.ncols()
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Dimension of the tangent space.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.euclidean.nrows() + if self.orientations.is_some() { 3 } else { 0 }
    }

    /// Sample i as seen from a mean: Euclidean difference ⊕ s log(μ⁻¹ q).
    fn offset(&self, i: usize, gaussian: &Gaussian, offset: &mut [f64; DIMENSION_MAX]) {
        let n = self.euclidean.nrows();
        let column = self.euclidean.column(i);
        for ((entry, x), mean) in offset.iter_mut().zip(column.iter()).zip(gaussian.mean.iter()) {
            *entry = x - mean;
        }
        if let (Some(all), Some(mean)) = (&self.orientations, gaussian.orientation) {
            let rotation = rotation_vector(mean.conjugate() * all[i]) * self.rotation_scale;
            offset[n..n + 3].copy_from_slice(&rotation.to_array());
        }
    }

    /// Mean and covariance of weighted samples  [thesis eq. 3.5].
    #[must_use]
    pub fn gaussian(&self, weights: &[f64]) -> Gaussian {
        let sum = weights.iter().sum::<f64>() + WEIGHT_FLOOR;
        let mut mean = DVector::zeros(self.euclidean.nrows());
        for (sample, weight) in self.euclidean.column_iter().zip(weights) {
            mean.axpy(weight / sum, &sample, 1.0);
        }
        let orientation = self.orientations.as_ref().map(|all| mean_orientation(all, weights));
        let n = self.dimension();
        let mut gaussian = Gaussian { mean, orientation, covariance: DMatrix::zeros(n, n) };
        let mut offset = [0.0; DIMENSION_MAX];
        let mut covariance = DMatrix::zeros(n, n);
        for (i, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
            self.offset(i, &gaussian, &mut offset);
            for a in 0..n {
                let scaled = weight / sum * offset[a];
                for b in 0..=a {
                    covariance[(a, b)] += scaled * offset[b];
                }
            }
        }
        covariance.fill_upper_triangle_with_lower_triangle();
        gaussian.covariance = covariance;
        gaussian
    }

    /// Adds ln N of every sample (row) under every Gaussian (column).
    fn add_log_densities(
        &self,
        gaussians: &[Gaussian],
        regularisation: f64,
        sum: &mut DMatrix<f64>,
    ) {
        let n = self.dimension();
        let mut offset = [0.0; DIMENSION_MAX];
        for (k, gaussian) in gaussians.iter().enumerate() {
            let regular = &gaussian.covariance + DMatrix::identity(n, n) * regularisation;
            let factor =
                regular.cholesky().expect("a regularised covariance is positive definite").unpack();
            let root: f64 = factor.diagonal().iter().map(|x| x.ln()).sum();
            let constant = -root - 0.5 * n as f64 * std::f64::consts::TAU.ln();
            for i in 0..self.len() {
                self.offset(i, gaussian, &mut offset);
                let mut square = 0.0;
                for a in 0..n {
                    let mut rest = offset[a];
                    for b in 0..a {
                        rest -= factor[(a, b)] * offset[b];
                    }
                    offset[a] = rest / factor[(a, a)];
                    square += offset[a] * offset[a];
                }
                sum[(i, k)] += constant - 0.5 * square;
            }
        }
    }
}

/// Alternates maximisation and expectation. Without regularisation the likelihood never falls.
/// Components that lose all samples keep a vanishing weight.
///
/// # Panics
/// When a covariance is singular, which a positive regularisation excludes.
#[must_use]
pub fn maximise(data: &Data, settings: &Settings) -> Maximised {
    let mut responsibilities = data.responsibilities.clone();
    let mut stays = stays(&responsibilities, data.sequences.len());
    let mut log_likelihoods = Vec::with_capacity(settings.iterations as usize);
    for _ in 0..settings.iterations {
        let mut densities = DMatrix::zeros(responsibilities.nrows(), responsibilities.ncols());
        for view in &data.views {
            let gaussians = gaussians(view, &responsibilities);
            view.add_log_densities(&gaussians, settings.regularisation, &mut densities);
        }
        let total = match settings.topology {
            Topology::Mixture => mixture_expectation(densities, &mut responsibilities),
            Topology::LeftRight => left_right_expectation(
                &densities,
                &data.sequences,
                &mut stays,
                &mut responsibilities,
            ),
        };
        log_likelihoods.push(total / responsibilities.nrows() as f64);
    }
    let mut times = mean_times(&responsibilities, &data.times);
    if settings.topology == Topology::Mixture && settings.ordering == Ordering::MeanTime {
        responsibilities = in_order(&responsibilities, &times);
        times = mean_times(&responsibilities, &data.times);
    }
    let priors = weight_sums(&responsibilities)
        .map(|sum| (sum + WEIGHT_FLOOR) / responsibilities.nrows() as f64)
        .collect();
    let gaussians = data.views.iter().map(|view| gaussians(view, &responsibilities)).collect();
    Maximised { responsibilities, priors, times, gaussians, log_likelihoods }
}

/// The Gaussians of a view for given responsibilities, its own or those learned in other views.
#[must_use]
pub fn gaussians(view: &View, responsibilities: &DMatrix<f64>) -> Vec<Gaussian> {
    responsibilities.column_iter().map(|weights| view.gaussian(weights.as_slice())).collect()
}

/// Responsibilities with their components in order of mean time.
#[must_use]
pub fn in_order(responsibilities: &DMatrix<f64>, times: &[f64]) -> DMatrix<f64> {
    let mut order: Vec<usize> = (0..responsibilities.ncols()).collect();
    order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
    let columns: Vec<_> = order.iter().map(|k| responsibilities.column(*k)).collect();
    DMatrix::from_columns(&columns)
}

/// Mean time of each component's samples.
#[must_use]
pub fn mean_times(responsibilities: &DMatrix<f64>, times: &[f64]) -> Vec<f64> {
    let mean = |weights: &[f64]| -> f64 {
        let sum = weights.iter().sum::<f64>() + WEIGHT_FLOOR;
        weights.iter().zip(times).map(|(weight, time)| weight * time).sum::<f64>() / sum
    };
    responsibilities.column_iter().map(|weights| mean(weights.as_slice())).collect()
}

fn weight_sums(responsibilities: &DMatrix<f64>) -> impl Iterator<Item = f64> + '_ {
    responsibilities.column_iter().map(|weights| weights.sum())
}

/// γ_ik ∝ π_k Π_p N_p(ζ_i^(p))  [thesis eq. 3.4]; `terms` are the logarithms of the products.
/// Returns the log-likelihood of all samples.
fn mixture_expectation(mut terms: DMatrix<f64>, responsibilities: &mut DMatrix<f64>) -> f64 {
    let count = terms.nrows() as f64;
    let logs: Vec<f64> =
        weight_sums(responsibilities).map(|sum| ((sum + WEIGHT_FLOOR) / count).ln()).collect();
    let mut total = 0.0;
    for (mut row, mut result) in terms.row_iter_mut().zip(responsibilities.row_iter_mut()) {
        row.iter_mut().zip(&logs).for_each(|(term, log)| *term += log);
        let top = row.max();
        row.iter_mut().for_each(|x| *x = (*x - top).exp());
        let sum = row.sum();
        total += top + sum.ln();
        result.copy_from(&(row / sum));
    }
    total
}

/// Probability of staying in each state, from how long the states last.
fn stays(responsibilities: &DMatrix<f64>, sequences: usize) -> Vec<f64> {
    let stay = |sum: f64| 1.0 - (sequences as f64 / sum.max(WEIGHT_FLOOR)).min(0.5);
    weight_sums(responsibilities).map(stay).collect()
}

/// Forward–backward in logarithms, and the re-estimated probabilities of staying
/// [Rabiner 1989, eq. 19–27, 37–40]. A demonstration starts in the first state. Returns the
/// log-likelihood of all samples.
fn left_right_expectation(
    densities: &DMatrix<f64>,
    sequences: &[Range<usize>],
    stays: &mut [f64],
    responsibilities: &mut DMatrix<f64>,
) -> f64 {
    let states = stays.len();
    // The last state is never left.
    let stay: Vec<f64> =
        (0..states).map(|k| if k + 1 == states { 0.0 } else { stays[k].ln() }).collect();
    let go: Vec<f64> = stays.iter().map(|stay| (1.0 - stay).ln()).collect();
    let (mut stayed, mut went) = (vec![0.0; states], vec![0.0; states]);
    let mut total = 0.0;
    for range in sequences {
        let count = range.len();
        let density = |t: usize, k: usize| densities[(range.start + t, k)];
        let mut forward = DMatrix::from_element(count, states, f64::NEG_INFINITY);
        forward[(0, 0)] = density(0, 0);
        for t in 1..count {
            for k in 0..states {
                let from_before =
                    if k > 0 { forward[(t - 1, k - 1)] + go[k - 1] } else { f64::NEG_INFINITY };
                forward[(t, k)] =
                    log_add(forward[(t - 1, k)] + stay[k], from_before) + density(t, k);
            }
        }
        let mut backward = DMatrix::zeros(count, states);
        for t in (0..count - 1).rev() {
            for k in 0..states {
                let remain = stay[k] + density(t + 1, k) + backward[(t + 1, k)];
                backward[(t, k)] = if k + 1 < states {
                    let leave = go[k] + density(t + 1, k + 1) + backward[(t + 1, k + 1)];
                    log_add(remain, leave)
                } else {
                    remain
                };
            }
        }
        let likelihood = forward.row(count - 1).iter().copied().fold(f64::NEG_INFINITY, log_add);
        total += likelihood;
        for t in 0..count {
            for k in 0..states {
                let here = forward[(t, k)] - likelihood;
                responsibilities[(range.start + t, k)] = (here + backward[(t, k)]).exp();
                if t + 1 < count && k + 1 < states {
                    let remain = here + stay[k] + density(t + 1, k) + backward[(t + 1, k)];
                    stayed[k] += remain.exp();
                    let leave = here + go[k] + density(t + 1, k + 1) + backward[(t + 1, k + 1)];
                    went[k] += leave.exp();
                }
            }
        }
    }
    for ((stay, stayed), went) in stays.iter_mut().zip(stayed).zip(went) {
        if stayed + went > WEIGHT_FLOOR {
            *stay = stayed / (stayed + went);
        }
    }
    total
}

/// ln(eᵃ + eᵇ).
fn log_add(a: f64, b: f64) -> f64 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if low == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

/// A view of orientations and positions, e.g. of poses seen from a frame.
#[must_use]
pub fn pose_view(
    positions: &[DVec3],
    dimension: usize,
    position_scale: f64,
    orientations: Option<(Vec<DQuat>, f64)>,
) -> View {
    let euclidean =
        DMatrix::from_fn(dimension, positions.len(), |a, i| positions[i][a] * position_scale);
    let (orientations, rotation_scale) = orientations.unzip();
    View { euclidean, orientations, rotation_scale: rotation_scale.unwrap_or(1.0) }
}
