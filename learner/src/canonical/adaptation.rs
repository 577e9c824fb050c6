//! Learns how the path adapts to its goal: a ridge regression of the demonstrations on the shift of
//! their goal frames, in canonical coordinates (see [`tprmp_rmpflow::policy::canonical::adaptation`]).
//!
//! ```text
//! minimise  mean over i, s  |y°_i(s) − m(s) − Σ_j b_j(s) E_j u_i|² + λ Σ_j |E_j|²
//! ```
//!
//! Positions and rotations are learned apart. Which part of the shift they follow, translation, rotation
//! or both, and how strong λ is, is chosen by the leave-one-out prediction error: each demonstration is
//! predicted from the others. Where that is no better than by their mean, nothing is learned: what is
//! left is chance.

use std::array::from_fn;

use glam::DVec3;
use nalgebra::{DMatrix, DVector};
use tprmp_rmpflow::policy::canonical::adaptation::{
    Adaptation, COORDINATES, Coefficients, SPLINES, splines,
};
use tprmp_spatial::jet::Vec3;

use crate::skill::AdaptationSettings;

/// Fewest demonstrations that tell chance from more: without one of two there is no difference left to
/// learn from.
pub const DEMONSTRATIONS_MIN: usize = 3;

/// What the regression knows of a demonstration.
#[derive(Clone, Debug)]
pub struct Observation {
    /// Translation \[m\] and rotation \[rad\] of its goal frame against its start frame.
    pub shift: [DVec3; 2],
    /// Positions and rotations y° at the compared phases \[ŷ\].
    pub path: Vec<[DVec3; 2]>,
}

/// Whether paths begin and end together, as the splines do: at both ends they lie apart by no more than
/// this fraction of their mean distance.
fn meet(paths: &[Vec<DVec3>], fraction: f64) -> bool {
    let count = paths.len() as f64;
    let apart = |step: usize| {
        let mean = paths.iter().map(|path| path[step]).sum::<DVec3>() / count;
        paths.iter().map(|path| (path[step] - mean).length_squared()).sum::<f64>()
    };
    let steps = paths[0].len();
    let mean = (0..steps).map(apart).sum::<f64>() / steps as f64;
    apart(0).max(apart(steps - 1)) <= fraction * fraction * mean
}

/// What was learned.
#[derive(Clone, Copy, Debug)]
pub struct Learned {
    /// `None` where the mean of the demonstrations predicts as well.
    pub adaptation: Option<Adaptation>,
    /// Leave-one-out prediction error [ŷ, rms]; without others, 0.
    pub error: f64,
}

/// Learns from demonstrations.
///
/// * `phases`  at which the paths are compared
/// * `scales`  ŷ per m and per rad
#[must_use]
pub fn learn(
    observations: &[Observation],
    phases: &[f64],
    scales: [f64; 2],
    settings: &AdaptationSettings,
) -> Learned {
    let reach = [0, 1].map(|i| {
        let most = observations.iter().map(|one| one.shift[i].length()).fold(0.0, f64::max);
        let scale = if i == 0 { scales[0] } else { 1.0 };
        if most * scale < settings.shift_min { 0.0 } else { most }
    });
    let shifts: Vec<[DVec3; 2]> = observations
        .iter()
        .map(|one| {
            let shift = one.shift.map(|v| Vec3(v.to_array()));
            Adaptation::bounded(reach, shift).map(Vec3::value)
        })
        .collect();
    let values: Vec<[f64; SPLINES]> = phases.iter().map(|phase| spline_values(*phase)).collect();
    let mut coefficients = [[[0.0; COORDINATES]; COORDINATES]; SPLINES];
    let (mut squared, mut adapts) = (0.0, false);
    for block in 0..2 {
        let paths: Vec<Vec<DVec3>> =
            observations.iter().map(|one| one.path.iter().map(|p| p[block]).collect()).collect();
        let by_mean = Regression::new(&shifts, &paths, &values, &[]).prediction_error(1.0);
        let mut best = (by_mean, None);
        let meet = || meet(&paths, settings.end_spread_fraction_max);
        if observations.len() >= DEMONSTRATIONS_MIN && by_mean > 0.0 && meet() {
            for parts in [&[0][..], &[1], &[0, 1]] {
                if parts.iter().any(|part| reach[*part] == 0.0) {
                    continue;
                }
                let regression = Regression::new(&shifts, &paths, &values, parts);
                for ridge in settings.ridges.iter().copied() {
                    let error = regression.prediction_error(ridge);
                    if error < best.0.min(settings.error_fraction_max * by_mean) {
                        best = (error, Some((parts, ridge)));
                    }
                }
            }
        }
        squared += best.0 * best.0;
        if let Some((parts, ridge)) = best.1 {
            adapts = true;
            let regression = Regression::new(&shifts, &paths, &values, parts);
            regression.write(ridge, block, scales[block], &mut coefficients);
        }
    }
    let adaptation = adapts.then_some(Adaptation { reach, coefficients });
    Learned { adaptation, error: squared.sqrt() }
}

fn spline_values(phase: f64) -> [f64; SPLINES] {
    let mut values = [0.0; SPLINES];
    let (first, active) = splines(phase);
    for (j, value) in (first..).zip(active) {
        if let Some(entry) = usize::try_from(j).ok().and_then(|j| values.get_mut(j)) {
            *entry = value[0];
        }
    }
    values
}

/// The regression of one block on some parts of the shift.
struct Regression<'a> {
    paths: &'a [Vec<DVec3>],
    values: &'a [[f64; SPLINES]],
    parts: &'a [usize],
    /// The parts of u, one vector a demonstration.
    inputs: Vec<DVector<f64>>,
    /// Σ_s b_j b_k, divided by the number of phases.
    gram: DMatrix<f64>,
    /// Σ_s b_j y°, likewise; a row for each j.
    projected: Vec<DMatrix<f64>>,
}

/// Means over some demonstrations, and the regression on the differences from them.
struct Solution {
    input: DVector<f64>,
    /// Rows: first all j of the first entry of u, …; columns: coordinates of the block.
    weights: DMatrix<f64>,
}

impl<'a> Regression<'a> {
    fn new(
        shifts: &[[DVec3; 2]],
        paths: &'a [Vec<DVec3>],
        values: &'a [[f64; SPLINES]],
        parts: &'a [usize],
    ) -> Self {
        let input = |shift: &[DVec3; 2]| {
            let entries = parts.iter().flat_map(|part| shift[*part].to_array());
            DVector::from_iterator(3 * parts.len(), entries)
        };
        let count = values.len() as f64;
        let entry = |j: usize, k: usize| values.iter().map(|b| b[j] * b[k]).sum::<f64>() / count;
        let project = |path: &Vec<DVec3>| {
            DMatrix::from_fn(SPLINES, 3, |j, c| {
                path.iter().zip(values).map(|(y, b)| b[j] * y[c]).sum::<f64>() / count
            })
        };
        Self {
            paths,
            values,
            parts,
            inputs: shifts.iter().map(input).collect(),
            gram: DMatrix::from_fn(SPLINES, SPLINES, entry),
            projected: paths.iter().map(project).collect(),
        }
    }

    /// All demonstrations but one.
    fn others(&self, left_out: Option<usize>) -> Vec<usize> {
        (0..self.paths.len()).filter(|i| Some(*i) != left_out).collect()
    }

    /// Solves the normal equations, whose matrix is a Kronecker product plus λ.
    ///
    /// `None` when λ is too small for it.
    fn solve(&self, of: &[usize], ridge: f64) -> Option<Solution> {
        let fraction = 1.0 / of.len() as f64;
        let size = 3 * self.parts.len();
        let input =
            of.iter().fold(DVector::zeros(size), |sum, i| sum + &self.inputs[*i]) * fraction;
        if size == 0 {
            return Some(Solution { input, weights: DMatrix::zeros(0, 3) });
        }
        let mean = of.iter().fold(DMatrix::zeros(SPLINES, 3), |sum, i| sum + &self.projected[*i]);
        let mean = mean * fraction;
        let mut covariance = DMatrix::zeros(size, size);
        let mut right = DMatrix::zeros(size * SPLINES, 3);
        for i in of {
            let away = &self.inputs[*i] - &input;
            covariance += &away * away.transpose() * fraction;
            right += away.kronecker(&((&self.projected[*i] - &mean) * fraction));
        }
        let mut matrix = covariance.kronecker(&self.gram);
        for i in 0..matrix.nrows() {
            matrix[(i, i)] += ridge;
        }
        let factor = matrix.cholesky()?;
        Some(Solution { input, weights: factor.solve(&right) })
    }

    /// How far each demonstration lies from what the others predict [ŷ, rms over all]; infinite without
    /// a solution.
    fn prediction_error(&self, ridge: f64) -> f64 {
        if self.paths.len() < 2 {
            return 0.0;
        }
        let mut sum = 0.0;
        for (i, path) in self.paths.iter().enumerate() {
            let others = self.others(Some(i));
            let Some(solution) = self.solve(&others, ridge) else { return f64::INFINITY };
            let away = &self.inputs[i] - &solution.input;
            // Σ_a W_{a j} (u − ū)_a for each j.
            let shifted: Vec<DVec3> = (0..SPLINES)
                .map(|j| {
                    let entry = |c: usize| -> f64 {
                        (0..away.len())
                            .map(|a| solution.weights[(a * SPLINES + j, c)] * away[a])
                            .sum()
                    };
                    DVec3::new(entry(0), entry(1), entry(2))
                })
                .collect();
            for (step, y) in path.iter().enumerate() {
                let mean = others.iter().map(|k| self.paths[*k][step]).sum::<DVec3>();
                let adapted = shifted.iter().zip(self.values[step]).map(|(e, b)| *e * b);
                let adapted: DVec3 = adapted.sum();
                sum += (*y - mean / others.len() as f64 - adapted).length_squared();
            }
        }
        (sum / (self.paths.len() * self.values.len()) as f64).sqrt()
    }

    /// Writes the regression on all demonstrations into the rows of a block.
    fn write(
        &self,
        ridge: f64,
        block: usize,
        scale: f64,
        coefficients: &mut [Coefficients; SPLINES],
    ) {
        let Some(solution) = self.solve(&self.others(None), ridge) else { return };
        for (j, matrix) in coefficients.iter_mut().enumerate() {
            for (k, part) in self.parts.iter().enumerate() {
                for a in 0..3 {
                    let row = (3 * k + a) * SPLINES + j;
                    let [x, y, z]: [f64; 3] = from_fn(|c| solution.weights[(row, c)] / scale);
                    for (c, entry) in [x, y, z].into_iter().enumerate() {
                        matrix[3 * block + c][3 * part + a] = entry;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALES: [f64; 2] = [2.0, 1.0];

    fn phases() -> Vec<f64> {
        (0..50).map(|i| f64::from(i) / 49.0).collect()
    }

    fn settings() -> AdaptationSettings {
        AdaptationSettings {
            ridges: vec![0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0003],
            error_fraction_max: 0.8,
            shift_min: 0.03,
            end_spread_fraction_max: 0.5,
        }
    }

    fn learned(observations: &[Observation]) -> Learned {
        learn(observations, &phases(), SCALES, &settings())
    }

    /// A path that swings out by `swing` times the displacement of its goal, and noise.
    fn demonstrated(count: u32, swing: f64, noise: f64) -> Vec<Observation> {
        let one = |i: u32| {
            let s = f64::from(i);
            let shift = DVec3::new((s * 1.7).sin(), (s * 2.9).cos(), 0.3 * (s * 0.7).sin()) * 0.1;
            let point = |phase: &f64| {
                let wide = (std::f64::consts::PI * phase).sin().powi(4);
                let chance = DVec3::new((s * 91.7).sin(), (s * 47.3).cos(), (s * 73.1).sin());
                let straight = DVec3::new(*phase, 0.3 * phase * phase, 0.0);
                let swung = DVec3::new(shift.y, -shift.x, 0.0) * (swing * wide);
                [(straight + swung + chance * (noise * wide)) * SCALES[0], DVec3::ZERO]
            };
            Observation { shift: [shift, DVec3::ZERO], path: phases().iter().map(point).collect() }
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn a_path_that_swings_out_with_its_goal_is_predicted() {
        let learned = learned(&demonstrated(6, 0.8, 0.0));
        let adaptation = learned.adaptation.expect("it adapts");
        assert!(learned.error < 0.02, "{}", learned.error);
        // In the middle of the path, where the swing is widest: row y, column x.
        let (at, phase) = (SPLINES / 2, 0.5);
        let value = splines(phase).1[1][0];
        assert!(value > 0.6, "the middle one of the splines");
        let slope = adaptation.coefficients[at][1][0] / adaptation.reach[0];
        assert!((-1.1..-0.6).contains(&slope), "{slope}");
        assert!(
            adaptation
                .coefficients
                .iter()
                .flatten()
                .skip(3)
                .step_by(6)
                .flatten()
                .all(|x| *x == 0.0)
        );
        assert_eq!(adaptation.reach[1], 0.0);
    }

    #[test]
    fn paths_that_begin_apart_do_not_adapt() {
        let mut observations = demonstrated(6, 0.8, 0.0);
        for one in &mut observations {
            let aside = DVec3::Z * one.shift[0].x;
            one.path.iter_mut().for_each(|point| point[0] += aside * 3.0);
        }
        assert!(learned(&observations).adaptation.is_none());
    }

    #[test]
    fn what_is_chance_is_not_learned() {
        for count in [2, 3, 6] {
            let learned = learned(&demonstrated(count, 0.0, 0.05));
            assert!(learned.adaptation.is_none(), "{count}");
            assert!(learned.error > 0.0);
        }
        let same = learned(&demonstrated(3, 0.0, 0.0));
        assert!(same.adaptation.is_none() && same.error < 1e-12);
        assert_eq!(learned(&demonstrated(1, 0.0, 0.0)).error, 0.0);
    }
}
