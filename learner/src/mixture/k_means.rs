//! k-means: pieces for expectation maximisation to start from.

use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Bound on the iterations; some tens are usual.
const ITERATIONS_MAX: usize = 100;

/// Clusters samples, and returns 1 for the cluster (column) of each sample (row), 0 elsewhere.
///
/// The first centres are drawn as in k-means++ (Arthur and Vassilvitskii, 2007): each with the
/// probability of its squared distance to those before it. Clusters stay empty only when there are
/// fewer different samples than clusters.
///
/// # Panics
/// When there is no sample.
#[must_use]
pub fn responsibilities(
    samples: &[DVector<f64>],
    clusters: usize,
    random: &mut ChaCha8Rng,
) -> DMatrix<f64> {
    let mut centres = first_centres(samples, clusters, random);
    let mut nearest = vec![0; samples.len()];
    for _ in 0..ITERATIONS_MAX {
        let before = nearest.clone();
        for (sample, index) in samples.iter().zip(&mut nearest) {
            *index = closest(sample, &centres).0;
        }
        for (k, centre) in centres.iter_mut().enumerate() {
            let members = || samples.iter().zip(&nearest).filter(|(_, index)| **index == k);
            let count = members().count();
            if count > 0 {
                let sum: DVector<f64> = members().map(|(sample, _)| sample).sum();
                *centre = sum / count as f64;
            }
        }
        if nearest == before {
            break;
        }
    }
    let mut responsibilities = DMatrix::zeros(samples.len(), clusters);
    for (i, k) in nearest.into_iter().enumerate() {
        responsibilities[(i, k)] = 1.0;
    }
    responsibilities
}

fn first_centres(
    samples: &[DVector<f64>],
    clusters: usize,
    random: &mut ChaCha8Rng,
) -> Vec<DVector<f64>> {
    let mut centres = vec![samples[random.random_range(0..samples.len())].clone()];
    while centres.len() < clusters {
        let squares: Vec<f64> = samples.iter().map(|sample| closest(sample, &centres).1).collect();
        let mut left = random.random_range(0.0..1.0) * squares.iter().sum::<f64>();
        let drawn = squares.iter().position(|square| {
            left -= square;
            left < 0.0
        });
        // Rounding, or no two samples that differ: the last one serves.
        centres.push(samples[drawn.unwrap_or(samples.len() - 1)].clone());
    }
    centres
}

/// The nearest centre, the first of equals, and the squared distance to it.
fn closest(sample: &DVector<f64>, centres: &[DVector<f64>]) -> (usize, f64) {
    let square = |centre: &DVector<f64>| -> f64 {
        sample.iter().zip(centre.iter()).map(|(a, b)| (a - b) * (a - b)).sum()
    };
    let squares = centres.iter().map(square).enumerate();
    squares.min_by(|a, b| a.1.total_cmp(&b.1)).expect("there is a centre")
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn heaps_far_apart_are_found_whatever_the_seed() {
        let samples: Vec<_> = (0..60)
            .map(|i| {
                let heap = f64::from(i % 3) * 10.0;
                DVector::from_vec(vec![heap + 0.01 * f64::from(i), -heap])
            })
            .collect();
        for seed in 0..20 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let found = responsibilities(&samples, 3, &mut random);
            assert!(found.row_iter().all(|row| row.sum() == 1.0));
            for k in 0..3 {
                assert_eq!(found.column(k).sum(), 20.0);
            }
            for i in 3..60 {
                assert_eq!(found.row(i), found.row(i - 3));
            }
        }
    }

    #[test]
    fn equal_samples_leave_clusters_empty() {
        let samples = vec![DVector::from_element(2, 0.5); 10];
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let found = responsibilities(&samples, 4, &mut random);
        assert_eq!(found.column(0).sum(), 10.0);
        assert_eq!(found.sum(), 10.0);
    }
}
