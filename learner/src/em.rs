//! Expectation maximisation of a Gaussian mixture on (phase · length, y), with y the joint
//! coordinates of position and orientation  [thesis eq. 3.4, with the phase as a coordinate].

use nalgebra::{DMatrix, DVector};

/// A Gaussian mixture in order of phase; the first coordinate is the phase times the length.
#[derive(Clone, Debug)]
pub struct Mixture {
    /// Weights, which sum to one.
    pub priors: Vec<f64>,
    /// Means.
    pub means: Vec<DVector<f64>>,
    /// Covariances, without the regularisation.
    pub covariances: Vec<DMatrix<f64>>,
    /// Mean log-likelihood of a sample after each maximisation [nat].
    pub log_likelihoods: Vec<f64>,
}

/// Samples of several paths with their phase, and responsibilities to start from.
#[derive(Clone, Debug)]
pub struct PhaseSamples {
    /// (phase · length, y) of all samples of all paths.
    pub samples: Vec<DVector<f64>>,
    /// Mean length of the paths.
    pub length: f64,
    /// Responsibility of component k (column) for sample i (row).
    pub responsibilities: DMatrix<f64>,
}

/// Puts paths side by side, the phase running evenly in time from 0 to 1, and cuts each into
/// `components` pieces of equal arc length to start from.
///
/// # Panics
/// When a path has no length.
#[must_use]
pub fn phase_samples(paths: &[Vec<DVector<f64>>], components: usize) -> PhaseSamples {
    let arcs: Vec<Vec<f64>> = paths.iter().map(|path| arc_lengths(path)).collect();
    let lengths: Vec<f64> = arcs.iter().map(|arc| arc[arc.len() - 1]).collect();
    assert!(lengths.iter().all(|l| *l > 0.0), "a path has a length");
    let length = lengths.iter().sum::<f64>() / lengths.len() as f64;
    let count = paths.iter().map(Vec::len).sum();
    let mut samples = Vec::with_capacity(count);
    let mut responsibilities = DMatrix::zeros(count, components);
    for (path, arc) in paths.iter().zip(&arcs) {
        let last = path.len() - 1;
        for (i, y) in path.iter().enumerate() {
            let phase = i as f64 / last as f64;
            let piece = (arc[i] / arc[last] * components as f64) as usize;
            responsibilities[(samples.len(), piece.min(components - 1))] = 1.0;
            samples.push(y.clone().insert_row(0, phase * length));
        }
    }
    PhaseSamples { samples, length, responsibilities }
}

fn arc_lengths(path: &[DVector<f64>]) -> Vec<f64> {
    let mut arc = vec![0.0];
    for pair in path.windows(2) {
        arc.push(arc[arc.len() - 1] + (&pair[1] - &pair[0]).norm());
    }
    arc
}

/// Alternates maximisation and expectation. `regularisation` is added to the covariances' diagonal
/// wherever they are inverted; without it the likelihood never falls. Components that lose all
/// samples keep a vanishing weight.
///
/// # Panics
/// When a covariance is singular, which a positive regularisation excludes.
#[must_use]
pub fn maximise(data: &PhaseSamples, iterations: u32, regularisation: f64) -> Mixture {
    let mut responsibilities = data.responsibilities.clone();
    let mut log_likelihoods = Vec::with_capacity(iterations as usize);
    for _ in 0..iterations {
        let mixture = maximisation(&data.samples, &responsibilities);
        log_likelihoods.push(expectation(
            &data.samples,
            &mixture,
            regularisation,
            &mut responsibilities,
        ));
    }
    let mixture = maximisation(&data.samples, &responsibilities);
    let mut order: Vec<usize> = (0..mixture.means.len()).collect();
    order.sort_by(|a, b| mixture.means[*a][0].total_cmp(&mixture.means[*b][0]));
    Mixture {
        priors: order.iter().map(|k| mixture.priors[*k]).collect(),
        means: order.iter().map(|k| mixture.means[*k].clone()).collect(),
        covariances: order.iter().map(|k| mixture.covariances[*k].clone()).collect(),
        log_likelihoods,
    }
}

/// Priors, means and covariances for given responsibilities  [thesis eq. 3.4, M step].
fn maximisation(samples: &[DVector<f64>], responsibilities: &DMatrix<f64>) -> Mixture {
    let dimension = samples[0].len();
    let components = responsibilities.ncols();
    let mut mixture = Mixture {
        priors: Vec::with_capacity(components),
        means: Vec::with_capacity(components),
        covariances: Vec::with_capacity(components),
        log_likelihoods: Vec::new(),
    };
    for k in 0..components {
        let weights = responsibilities.column(k);
        // A component without samples must not divide by zero.
        let sum = weights.sum() + 1e-9;
        let mut mean = DVector::zeros(dimension);
        for (sample, weight) in samples.iter().zip(weights.iter()) {
            mean.axpy(weight / sum, sample, 1.0);
        }
        let mut covariance = DMatrix::zeros(dimension, dimension);
        for (sample, weight) in samples.iter().zip(weights.iter()) {
            let offset = sample - &mean;
            covariance.ger(weight / sum, &offset, &offset, 1.0);
        }
        mixture.priors.push(sum / samples.len() as f64);
        mixture.means.push(mean);
        mixture.covariances.push(covariance);
    }
    mixture
}

/// Responsibilities for a given mixture [thesis eq. 3.4, E step]; returns the mean log-likelihood.
fn expectation(
    samples: &[DVector<f64>],
    mixture: &Mixture,
    regularisation: f64,
    responsibilities: &mut DMatrix<f64>,
) -> f64 {
    let dimension = samples[0].len();
    let factors: Vec<_> = mixture
        .covariances
        .iter()
        .map(|c| {
            let regular = c + DMatrix::identity(dimension, dimension) * regularisation;
            regular.cholesky().expect("a regularised covariance is positive definite")
        })
        .collect();
    let constants: Vec<f64> = factors
        .iter()
        .zip(&mixture.priors)
        .map(|(factor, prior)| {
            let root: f64 = factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum();
            prior.ln() - root - 0.5 * dimension as f64 * std::f64::consts::TAU.ln()
        })
        .collect();
    let mut total = 0.0;
    for (i, sample) in samples.iter().enumerate() {
        let mut row = responsibilities.row_mut(i);
        for (k, factor) in factors.iter().enumerate() {
            let mut offset = sample - &mixture.means[k];
            factor.l_dirty().solve_lower_triangular_mut(&mut offset);
            row[k] = constants[k] - 0.5 * offset.norm_squared();
        }
        let top = row.max();
        row.iter_mut().for_each(|x| *x = (*x - top).exp());
        let sum = row.sum();
        row /= sum;
        total += top + sum.ln();
    }
    total / samples.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    fn noisy_paths() -> Vec<Vec<DVector<f64>>> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut noise = move || random.random_range(-0.05..0.05);
        (0..4)
            .map(|_| {
                (0..80)
                    .map(|i| {
                        let t = f64::from(i) / 79.0;
                        DVector::from_vec(vec![2.0 * t + noise(), (3.0 * t).sin() + noise()])
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn responsibilities_sum_to_one_and_the_likelihood_never_falls() {
        let data = phase_samples(&noisy_paths(), 5);
        let mixture = maximise(&data, 30, 0.0);
        for pair in mixture.log_likelihoods.windows(2) {
            assert!(pair[1] >= pair[0] - 1e-12, "{pair:?}");
        }
        let mut responsibilities = data.responsibilities.clone();
        expectation(&data.samples, &mixture, 0.0, &mut responsibilities);
        for row in responsibilities.row_iter() {
            assert!((row.sum() - 1.0).abs() < 1e-12);
            assert!(row.iter().all(|r| (0.0..=1.0).contains(r)));
        }
        assert!((mixture.priors.iter().sum::<f64>() - 1.0).abs() < 1e-8);
    }

    #[test]
    fn means_come_in_order_of_phase_and_cover_the_path() {
        let data = phase_samples(&noisy_paths(), 5);
        let mixture = maximise(&data, 15, 1e-3);
        assert!(mixture.means.windows(2).all(|pair| pair[0][0] < pair[1][0]));
        assert!(mixture.means[0][0] < 0.25 * data.length);
        assert!(mixture.means[4][0] > 0.75 * data.length);
    }
}
