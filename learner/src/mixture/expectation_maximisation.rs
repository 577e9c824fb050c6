//! Expectation maximisation of Gaussians that several views of the same samples share.
//!
//! A view is a coordinate system: a frame, or the canonical space. Responsibilities are common to
//! all views; each view has means and covariances of its own  [thesis eq. 3.4–3.5].

use std::ops::Range;

use nalgebra::DMatrix;

use crate::mixture::left_right;
use crate::mixture::view::{Gaussian, Singular, View, WEIGHT_FLOOR};
use crate::skill::Ordering;

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
    /// Time of each sample as a fraction of its demonstration's.
    pub times: Vec<f64>,
    /// Responsibility of component k (column) for sample i (row).
    pub responsibilities: DMatrix<f64>,
}

/// Settings of the iterations.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// What is known of the order of the samples.
    pub topology: Topology,
    /// Most iterations; fewer when the likelihood changes no more.
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
    /// Fraction of the samples of each component.
    pub priors: Vec<f64>,
    /// Mean time of each component's samples.
    pub times: Vec<f64>,
    /// Gaussians of each view.
    pub gaussians: Vec<Vec<Gaussian>>,
    /// Mean log-likelihood of a sample after each maximisation \[nat\].
    pub log_likelihoods: Vec<f64>,
}

/// The iterations end when the mean log-likelihood of a sample changes by less [nat].
const CONVERGED: f64 = 5e-8;

/// Alternates maximisation and expectation. Without regularisation the likelihood never falls in
/// Euclidean coordinates; with orientations it may, by some 1e-6 nat a sample, because their mean is
/// the intrinsic one and not quite the most likely. Components that lose all samples keep a vanishing weight.
///
/// # Errors
/// A covariance is singular, which a regularisation of a size with the samples excludes.
pub fn maximise(data: &Data, settings: &Settings) -> Result<Maximised, Singular> {
    let mut responsibilities = data.responsibilities.clone();
    let mut stays = left_right::stays(&responsibilities, data.sequences.len());
    let mut log_likelihoods = Vec::with_capacity(settings.iterations as usize);
    for _ in 0..settings.iterations {
        let mut densities = DMatrix::zeros(responsibilities.nrows(), responsibilities.ncols());
        for view in &data.views {
            let gaussians = view.gaussians(&responsibilities);
            view.add_log_densities(&gaussians, settings.regularisation, &mut densities)?;
        }
        let total = match settings.topology {
            Topology::Mixture => mixture_expectation(densities, &mut responsibilities),
            Topology::LeftRight => left_right::expectation(
                &densities,
                &data.sequences,
                &mut stays,
                &mut responsibilities,
            ),
        };
        log_likelihoods.push(total / responsibilities.nrows() as f64);
        if let [.., before, now] = log_likelihoods[..]
            && (now - before).abs() < CONVERGED
        {
            break;
        }
    }
    let mut times = mean_times(&responsibilities, &data.times);
    if settings.topology == Topology::Mixture && settings.ordering == Ordering::MeanTime {
        responsibilities = in_order(&responsibilities, &times);
        times = mean_times(&responsibilities, &data.times);
    }
    let priors = weight_sums(&responsibilities)
        .map(|sum| (sum + WEIGHT_FLOOR) / responsibilities.nrows() as f64)
        .collect();
    let gaussians = data.views.iter().map(|view| view.gaussians(&responsibilities)).collect();
    Ok(Maximised { responsibilities, priors, times, gaussians, log_likelihoods })
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use nalgebra::DVector;
    use proptest::prelude::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const COMPONENTS: usize = 3;
    /// Samples of the demonstrations: enough for 6×6 covariances without regularisation.
    const LENGTHS: [usize; 3] = [34, 40, 31];

    /// What the coordinates of a view are.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Coordinates {
        Euclidean,
        Orientations,
        Both,
    }

    fn coordinates() -> impl Strategy<Value = Coordinates> {
        prop_oneof![
            Just(Coordinates::Euclidean),
            Just(Coordinates::Orientations),
            Just(Coordinates::Both)
        ]
    }

    fn topology() -> impl Strategy<Value = Topology> {
        prop_oneof![Just(Topology::Mixture), Just(Topology::LeftRight)]
    }

    fn ball(random: &mut ChaCha8Rng, radius: f64) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| random.random_range(-radius..radius)))
    }

    /// A bow that is demonstrated three times, with noise, and seen from `views` places; orientations
    /// rotate by up to 2 rad. It starts from pieces of equal time.
    fn demonstrated(coordinates: Coordinates, views: usize, seed: u64) -> Data {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (mut positions, mut orientations, mut times) = (Vec::new(), Vec::new(), Vec::new());
        let mut sequences = Vec::new();
        for length in LENGTHS {
            sequences.push(times.len()..times.len() + length);
            for i in 0..length {
                let t = i as f64 / (length - 1) as f64;
                let bow = DVec3::new(t, 0.4 * (3.0 * t).sin(), 0.3 * t * t);
                positions.push(bow + ball(&mut random, 0.1));
                let rotation = DVec3::new(1.2, -0.7, 1.5) * t + ball(&mut random, 0.2);
                orientations.push(DQuat::from_scaled_axis(rotation));
                times.push(t);
            }
        }
        let view = |_| {
            let (rotation, origin) = (ball(&mut random, 2.0), ball(&mut random, 1.0));
            let rotation = DQuat::from_scaled_axis(rotation);
            let seen: Vec<_> = positions.iter().map(|x| rotation * *x + origin).collect();
            let rotated = || orientations.iter().map(|q| rotation * *q).collect();
            match coordinates {
                Coordinates::Euclidean => View::poses(&seen, 3, 1.3, None),
                Coordinates::Orientations => View::poses(&seen, 0, 1.0, Some((rotated(), 0.8))),
                Coordinates::Both => View::poses(&seen, 3, 1.3, Some((rotated(), 0.8))),
            }
        };
        let views = (0..views).map(view).collect();
        let responsibilities = DMatrix::from_fn(times.len(), COMPONENTS, |i, k| {
            let piece = ((times[i] * COMPONENTS as f64) as usize).min(COMPONENTS - 1);
            f64::from(u8::from(piece == k))
        });
        Data { views, sequences, times, responsibilities }
    }

    fn settings(topology: Topology, iterations: u32, regularisation: f64) -> Settings {
        Settings { topology, iterations, regularisation, ordering: Ordering::MeanTime }
    }

    /// Rows of positive numbers that sum to one.
    fn random_rows(random: &mut ChaCha8Rng, rows: usize, columns: usize) -> DMatrix<f64> {
        let mut matrix = DMatrix::from_fn(rows, columns, |_, _| random.random_range(0.05..1.0));
        for mut row in matrix.row_iter_mut() {
            let sum = row.sum();
            row /= sum;
        }
        matrix
    }

    /// Every path through `states` states in `length` samples: it starts in the first, and stays or
    /// goes to the next.
    fn monotone_paths(states: usize, length: usize) -> Vec<Vec<usize>> {
        let mut paths = vec![vec![0]];
        for _ in 1..length {
            let longer = |path: &Vec<usize>| -> Vec<Vec<usize>> {
                let last = path[path.len() - 1];
                let next = last..(last + 2).min(states);
                next.map(|state| [path.as_slice(), &[state]].concat()).collect()
            };
            paths = paths.iter().flat_map(longer).collect();
        }
        paths
    }

    #[derive(Clone)]
    struct Textbook {
        prior: f64,
        means: Vec<DVector<f64>>,
        covariances: Vec<DMatrix<f64>>,
    }

    /// Eq. 3.5 for component k, as it stands.
    fn textbook_maximisation(data: &Data, gamma: &DMatrix<f64>, k: usize) -> Textbook {
        let count = gamma.nrows();
        let sum: f64 = (0..count).map(|i| gamma[(i, k)]).sum();
        let (mut means, mut covariances) = (Vec::new(), Vec::new());
        for view in &data.views {
            let z = &view.euclidean;
            let mean: DVector<f64> =
                (0..count).map(|i| z.column(i) * gamma[(i, k)]).sum::<DVector<f64>>() / sum;
            let square = |i: usize| {
                let away = z.column(i) - &mean;
                &away * away.transpose() * gamma[(i, k)]
            };
            covariances.push((0..count).map(square).sum::<DMatrix<f64>>() / sum);
            means.push(mean);
        }
        Textbook { prior: sum / count as f64, means, covariances }
    }

    /// Eq. 3.4 as it stands, and the mean of the logarithm of its denominator.
    fn textbook_expectation(data: &Data, all: &[Textbook]) -> (DMatrix<f64>, f64) {
        let density = |i: usize, one: &Textbook| -> f64 {
            let mut product = one.prior;
            for ((view, mean), covariance) in
                data.views.iter().zip(&one.means).zip(&one.covariances)
            {
                let away = view.euclidean.column(i) - mean;
                let inverse = covariance.clone().try_inverse().unwrap();
                let square = (away.transpose() * inverse * &away)[(0, 0)];
                let volume = (covariance * std::f64::consts::TAU).determinant().sqrt();
                product *= (-0.5 * square).exp() / volume;
            }
            product
        };
        let count = data.times.len();
        let terms = DMatrix::from_fn(count, all.len(), |i, k| density(i, &all[k]));
        let log = (0..count).map(|i| terms.row(i).sum().ln()).sum::<f64>() / count as f64;
        (DMatrix::from_fn(count, all.len(), |i, k| terms[(i, k)] / terms.row(i).sum()), log)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..Default::default() })]

        #[test]
        fn responsibilities_are_fractions(
            coordinates in coordinates(), topology in topology(), views in 1..4_usize,
            seed in any::<u64>(),
        ) {
            let found = maximise(&demonstrated(coordinates, views, seed), &settings(topology, 6, 1e-3)).unwrap();
            for row in found.responsibilities.row_iter() {
                prop_assert!((row.sum() - 1.0).abs() < 1e-10);
                prop_assert!(row.iter().all(|fraction| (0.0..=1.0 + 1e-12).contains(fraction)));
            }
            prop_assert!((found.priors.iter().sum::<f64>() - 1.0).abs() < 1e-8);
        }

        #[test]
        fn the_iterations_end_when_nothing_changes(topology in topology(), seed in any::<u64>()) {
            let data = demonstrated(Coordinates::Euclidean, 1, seed);
            let found = maximise(&data, &settings(topology, 1000, 1e-3)).unwrap().log_likelihoods;
            let change = |pair: &[f64]| (pair[1] - pair[0]).abs();
            prop_assert!(found.len() < 1000);
            prop_assert!(found.windows(2).rev().skip(1).all(|pair| change(pair) >= CONVERGED));
            prop_assert!(change(&found[found.len() - 2..]) < CONVERGED);
        }

        #[test]
        fn the_likelihood_never_falls_without_regularisation(
            topology in topology(), views in 1..3_usize, seed in any::<u64>(),
        ) {
            let data = demonstrated(Coordinates::Euclidean, views, seed);
            let found = maximise(&data, &settings(topology, 12, 0.0)).unwrap();
            for pair in found.log_likelihoods.windows(2) {
                prop_assert!(pair[1] > pair[0] - 1e-9, "{:?}", found.log_likelihoods);
            }
        }

        /// The intrinsic mean weighs all directions the same, the most likely one would weigh them by
        /// the covariance. Near convergence the likelihood may fall by some 1e-6 nat a sample.
        #[test]
        fn with_orientations_the_likelihood_hardly_falls(
            only in any::<bool>(), topology in topology(), seed in any::<u64>(),
        ) {
            let coordinates =
                if only { Coordinates::Orientations } else { Coordinates::Both };
            let found = maximise(&demonstrated(coordinates, 2, seed), &settings(topology, 12, 0.0)).unwrap();
            prop_assert!(found.log_likelihoods.last() > found.log_likelihoods.first());
            for pair in found.log_likelihoods.windows(2) {
                prop_assert!(pair[1] > pair[0] - 1e-5, "{:?}", found.log_likelihoods);
            }
        }

        #[test]
        fn components_are_in_order_of_time(
            coordinates in coordinates(), topology in topology(), seed in any::<u64>(),
        ) {
            let mut data = demonstrated(coordinates, 1, seed);
            if topology == Topology::Mixture {
                // A mixture may start in any order.
                data.responsibilities.swap_columns(0, 2);
            }
            let found = maximise(&data, &settings(topology, 6, 1e-3)).unwrap();
            prop_assert!(found.times.is_sorted(), "{:?}", found.times);
            prop_assert_eq!(&found.times, &mean_times(&found.responsibilities, &data.times));
            let again = data.views[0].gaussians(&found.responsibilities);
            prop_assert_eq!(&found.gaussians[0], &again);
        }

        #[test]
        fn components_stay_as_initialised_when_asked_to(seed in any::<u64>()) {
            let mut data = demonstrated(Coordinates::Euclidean, 1, seed);
            data.responsibilities.swap_columns(0, 2);
            let ordered = settings(Topology::Mixture, 6, 1e-3);
            let by_time = maximise(&data, &ordered).unwrap();
            let initial = maximise(&data, &Settings { ordering: Ordering::Initial, ..ordered }).unwrap();
            prop_assert!(initial.times.iter().rev().is_sorted(), "{:?}", initial.times);
            let reversed: Vec<_> = initial.gaussians[0].iter().rev().cloned().collect();
            prop_assert_eq!(&by_time.gaussians[0], &reversed);
        }

        #[test]
        fn both_quaternions_of_an_orientation_are_the_same(
            only in any::<bool>(), topology in topology(), seed in any::<u64>(),
            flips in prop::collection::vec(any::<bool>(), 105),
        ) {
            let coordinates =
                if only { Coordinates::Orientations } else { Coordinates::Both };
            let mut data = demonstrated(coordinates, 2, seed);
            let settings = settings(topology, 4, 1e-3);
            let before = maximise(&data, &settings).unwrap();
            for view in &mut data.views {
                for (q, flip) in view.orientations.iter_mut().flatten().zip(&flips) {
                    *q = if *flip { -*q } else { *q };
                }
            }
            let after = maximise(&data, &settings).unwrap();
            let change = (&after.responsibilities - &before.responsibilities).amax();
            prop_assert!(change < 1e-10, "{change:e}");
            for (a, b) in after.gaussians.iter().flatten().zip(before.gaussians.iter().flatten()) {
                prop_assert!((&a.mean - &b.mean).amax() < 1e-10 || a.mean.is_empty());
                prop_assert!((a.orientation.unwrap() - b.orientation.unwrap()).length() < 1e-10);
                prop_assert!((&a.covariance - &b.covariance).amax() < 1e-10);
            }
        }

        #[test]
        fn a_step_of_a_mixture_is_that_of_the_textbook(views in 1..3_usize, seed in any::<u64>()) {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut data = demonstrated(Coordinates::Euclidean, views, seed);
            data.responsibilities = random_rows(&mut random, data.times.len(), COMPONENTS);
            let maximised = |gamma: &DMatrix<f64>| -> Vec<_> {
                (0..COMPONENTS).map(|k| textbook_maximisation(&data, gamma, k)).collect()
            };
            let (gamma, log) = textbook_expectation(&data, &maximised(&data.responsibilities));
            let settings =
                Settings { ordering: Ordering::Initial, ..settings(Topology::Mixture, 1, 0.0) };
            let found = maximise(&data, &settings).unwrap();
            prop_assert!((found.log_likelihoods[0] - log).abs() < 1e-7);
            prop_assert!((&found.responsibilities - &gamma).amax() < 1e-7);
            for (k, expected) in maximised(&gamma).iter().enumerate() {
                prop_assert!((found.priors[k] - expected.prior).abs() < 1e-7);
                for p in 0..views {
                    let gaussian = &found.gaussians[p][k];
                    prop_assert!((&gaussian.mean - &expected.means[p]).amax() < 1e-7);
                    prop_assert!((&gaussian.covariance - &expected.covariances[p]).amax() < 1e-7);
                }
            }
        }

        #[test]
        fn forward_backward_is_the_sum_over_all_monotone_paths(seed in any::<u64>()) {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let (states, sequences) = (3, [0..6, 6..10]);
            let densities = DMatrix::from_fn(10, states, |_, _| random.random_range(-4.0..1.0));
            let before: Vec<f64> = (0..states).map(|_| random.random_range(0.1..0.9)).collect();
            let mut stays = before.clone();
            let mut found = DMatrix::zeros(10, states);
            let log = left_right::expectation(&densities, &sequences, &mut stays, &mut found);

            let (mut expected, mut expected_log) = (DMatrix::zeros(10, states), 0.0);
            let (mut stayed, mut went) = ([0.0; 2], [0.0; 2]);
            for sequence in sequences {
                let paths = monotone_paths(states, sequence.len());
                let probability = |path: &Vec<usize>| -> f64 {
                    let seen: f64 = path.iter().enumerate()
                        .map(|(t, state)| densities[(sequence.start + t, *state)])
                        .sum();
                    let steps = path.windows(2).map(|step| match step {
                        [2, _] => 1.0,
                        [from, to] if from == to => before[*from],
                        step => 1.0 - before[step[0]],
                    });
                    seen.exp() * steps.product::<f64>()
                };
                let whole: f64 = paths.iter().map(probability).sum();
                expected_log += whole.ln();
                for path in &paths {
                    let fraction = probability(path) / whole;
                    for (t, state) in path.iter().enumerate() {
                        expected[(sequence.start + t, *state)] += fraction;
                    }
                    for step in path.windows(2).filter(|step| step[0] < 2) {
                        let sum = if step[0] == step[1] { &mut stayed } else { &mut went };
                        sum[step[0]] += fraction;
                    }
                }
            }
            prop_assert!((log - expected_log).abs() < 1e-12);
            prop_assert!((&found - &expected).amax() < 1e-12);
            for k in 0..2 {
                prop_assert!((stays[k] - stayed[k] / (stayed[k] + went[k])).abs() < 1e-12);
            }
        }

        #[test]
        fn a_state_is_entered_from_its_predecessor_alone(
            coordinates in coordinates(), seed in any::<u64>(),
        ) {
            let data = demonstrated(coordinates, 1, seed);
            let found = maximise(&data, &settings(Topology::LeftRight, 6, 1e-3)).unwrap();
            for sequence in &data.sequences {
                // P(state ≥ k at sample t).
                let reached = |t: usize, k: usize| -> f64 {
                    (k..COMPONENTS).map(|j| found.responsibilities[(sequence.start + t, j)]).sum()
                };
                for t in 0..sequence.len() {
                    for k in t + 1..COMPONENTS {
                        prop_assert_eq!(reached(t, k), 0.0);
                    }
                }
                for t in 1..sequence.len() {
                    for k in 1..COMPONENTS {
                        prop_assert!(reached(t, k) > reached(t - 1, k) - 1e-10);
                        prop_assert!(reached(t, k) < reached(t - 1, k - 1) + 1e-10);
                    }
                }
            }
        }
    }
}
