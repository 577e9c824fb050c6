//! The components of a round, and the fields that are fitted to it.

use glam::{DQuat, DVec3};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use rand_chacha::ChaCha8Rng;
use tprmp_model::skill_model::{
    FieldModel, FrameGaussian, FrameMixture, Gaussian, PolicyModel, Program, ProgramFit, copies,
};

use crate::canonical::path::Path;
use crate::fit::targets::BlockPath;
use crate::fit::{self, NotSolved, round_shape};
use crate::periodic::rounds::{Round, Rounds};
use crate::skill::{FieldSettings, Skill};

/// Width of a component over the phase, as a fraction of the phase between two of them.
const WIDTH: f64 = 0.35;
/// Keeps means apart that hardly differ in their weights, against a sum of squares of some ten.
const RIDGE: f64 = 1e-5;
/// Steps of a round at which rounds are compared.
const AGREEMENT_STEPS: usize = 50;

/// Damping times period: with less a round runs faster than its field can follow, and falls into one that is smaller
/// and slower.
const PACE_MIN: f64 = 16.0;

/// A Gaussian over ŷ of position and orientation, and the phase times its length.
pub(super) struct RoundGaussian {
    phase: f64,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// The Gaussians of a round, at equal steps of the phase, in order.
pub(super) fn gaussians(skill: &Skill, rounds: &Rounds) -> Vec<RoundGaussian> {
    let count = skill.mixture.components;
    (0..count).map(|k| gaussian(skill, rounds, (k as f64 + 0.5) / count as f64)).collect()
}

fn gaussian(skill: &Skill, rounds: &Rounds, phase: f64) -> RoundGaussian {
    let positions = skill.manifold.position_dimension();
    let n = skill.manifold.dimension() + 1;
    let [metres, radians] = rounds.scales;
    let width = WIDTH / skill.mixture.components as f64;
    let joint = |round: &Round, i: usize, away: f64| {
        let (p, r) = (round.position.points[i], round.rotation.points[i]);
        DVector::from_fn(n, |row, _| match row {
            row if row + 1 == n => (phase + away) * rounds.length,
            row if row < positions => metres * p[row],
            row => radians * r[row - positions],
        })
    };
    let mut samples = Vec::new();
    for round in &rounds.all {
        for (i, own) in rounds.phases.iter().enumerate() {
            let away = (own - phase + 0.5).rem_euclid(1.0) - 0.5;
            let weight = (-0.5 * (away / width).powi(2)).exp();
            samples.push((weight, joint(round, i, away)));
        }
    }
    let sum: f64 = samples.iter().map(|(weight, _)| weight).sum();
    let mut mean = samples.iter().fold(DVector::zeros(n), |mean, (w, x)| mean + x * (w / sum));
    mean[n - 1] = phase * rounds.length;
    let spread = samples.iter().fold(DMatrix::zeros(n, n), |covariance, (w, x)| {
        let away = x - &mean;
        covariance + &away * away.transpose() * (w / sum)
    });
    let settings = &skill.mixture;
    let regular = DMatrix::identity(n, n) * settings.regularisation;
    RoundGaussian { phase, mean, covariance: (spread + regular) * settings.covariance_scale }
}

/// The Gaussians as a model stores them: in canonical coordinates, and seen from the frame.
pub(super) fn stored(
    skill: &Skill,
    rounds: &Rounds,
    gaussians: &[RoundGaussian],
) -> (Vec<Gaussian>, FrameMixture) {
    let n = skill.manifold.dimension();
    let positions = skill.manifold.position_dimension();
    let scale = |i: usize| rounds.scales[usize::from(i >= positions)];
    let physical = |g: &RoundGaussian| -> (Vec<f64>, Vec<Vec<f64>>) {
        let entry = |i: usize, j: usize| g.covariance[(i, j)] / (scale(i) * scale(j));
        let covariance = (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect();
        ((0..n).map(|i| g.mean[i] / scale(i)).collect(), covariance)
    };
    let canonical = gaussians.iter().map(|g| {
        let (mean, covariance) = physical(g);
        Gaussian { prior: 1.0 / gaussians.len() as f64, phase: g.phase, mean, covariance }
    });
    let of_frame = gaussians.iter().map(|g| {
        let (mean, covariance) = physical(g);
        let rotation = || DVec3::from_slice(&mean[positions..]);
        let quaternion = skill.manifold.has_orientation().then(|| {
            let q = rounds.centre.orientation * DQuat::from_scaled_axis(rotation());
            [q.w, q.x, q.y, q.z]
        });
        FrameGaussian {
            position_m: mean[..positions].to_vec(),
            quaternion_wxyz: quaternion,
            covariance,
        }
    });
    let frame = FrameMixture {
        name: skill.goal_frame.clone(),
        gaussians: of_frame.collect(),
        agreement: agreement(rounds),
        agreement_fraction: None,
    };
    (canonical.collect(), frame)
}

/// How far the rounds lie apart, root of the mean square [m, rad], at equal fractions of a round.
pub(super) fn agreement(rounds: &Rounds) -> Vec<[f64; 2]> {
    let count = rounds.phases.len();
    let at = |step: usize| {
        let i = step * count / AGREEMENT_STEPS % count;
        let rms = |of: fn(&Round) -> &Path, mean: &[DVec3]| {
            let away =
                rounds.all.iter().map(|round| (of(round).points[i] - mean[i]).length_squared());
            (away.sum::<f64>() / rounds.all.len() as f64).sqrt()
        };
        let [position, rotation] = &rounds.mean;
        [rms(|round| &round.position, position), rms(|round| &round.rotation, rotation)]
    };
    (0..=AGREEMENT_STEPS).map(at).collect()
}

/// The settings with which rounds of a period \[s\] can be followed, and how many times faster these are than those of the
/// skill file: all that is per time goes with them, as if the rounds had been demonstrated slower.
pub(super) fn in_slow_motion(settings: &FieldSettings, period_s: f64) -> (FieldSettings, f64) {
    let faster = (PACE_MIN / (settings.damping_1_s * period_s)).max(1.0);
    let mut own = settings.clone();
    for rate in [
        &mut own.damping_1_s,
        &mut own.tube_attraction_1_s,
        &mut own.tube_speed_min,
        &mut own.descent_speed,
    ] {
        *rate *= faster;
    }
    for stiffness in
        [&mut own.stiffness_min_1_s2, &mut own.stiffness_max_1_s2, &mut own.goal_hessian_min_1_s2]
    {
        *stiffness *= faster * faster;
    }
    (own, faster)
}

/// Fits both fields, side by side.
///
/// # Errors
/// [`NotSolved`]: a field's program has no solution.
pub(super) fn fit(
    skill: &Skill,
    settings: &FieldSettings,
    rounds: &Rounds,
    gaussians: &[RoundGaussian],
    seed: u64,
) -> Result<(PolicyModel, Vec<ProgramFit>), NotSolved> {
    let block = |program, of: fn(&Round) -> &Path, scale, first| Block {
        program,
        of,
        scale,
        first,
        settings,
        rounds,
        gaussians,
    };
    let plane = skill.manifold.position_dimension() == 2;
    let position = block(Program::PositionField, |round| &round.position, rounds.scales[0], 0);
    let first = skill.manifold.position_dimension();
    let orientation = skill.manifold.has_orientation().then(|| {
        block(Program::OrientationField, |round| &round.rotation, rounds.scales[1], first)
    });
    fit::fit_blocks(
        seed,
        |random| match plane {
            true => position.fit::<3>(random),
            false => position.fit::<4>(random),
        },
        orientation.map(|block| move |random: &mut ChaCha8Rng| block.fit::<4>(random)),
    )
}

/// One block of the joint coordinates.
struct Block<'a> {
    program: Program,
    of: fn(&Round) -> &Path,
    /// ŷ = scale · y.
    scale: f64,
    /// Its first joint coordinate.
    first: usize,
    settings: &'a FieldSettings,
    rounds: &'a Rounds,
    gaussians: &'a [RoundGaussian],
}

impl Block<'_> {
    /// Fits the field on the block's coordinates and the phase, N together.
    fn fit<const N: usize>(
        &self,
        random: &mut ChaCha8Rng,
    ) -> Result<(FieldModel, ProgramFit), NotSolved> {
        let Rounds { length, period_s, .. } = *self.rounds;
        let joined = |y: &DVec3, last: f64| {
            let block = y.to_array();
            SVector::<f64, N>::from_fn(|i, _| if i + 1 < N { block[i] * self.scale } else { last })
        };
        let path = |round: &Round| {
            let path = (self.of)(round);
            let phases = self.rounds.phases.iter();
            let moving = |y| joined(y, length / period_s);
            BlockPath {
                points: path
                    .points
                    .iter()
                    .zip(phases)
                    .map(|(y, s)| joined(y, s * length))
                    .collect(),
                velocities: path.velocities.iter().map(moving).collect(),
                accelerations: path.accelerations.iter().map(|y| joined(y, 0.0)).collect(),
            }
        };
        let paths: Vec<_> = self.rounds.all.iter().map(path).collect();
        let last = self.gaussians[0].mean.len() - 1;
        let at = |i: usize| if i + 1 < N { self.first + i } else { last };
        let means = self.means::<N>(&paths);
        let covariances: Vec<_> = self
            .gaussians
            .iter()
            .map(|g| SMatrix::<f64, N, N>::from_fn(|i, j| g.covariance[(at(i), at(j))]))
            .collect();
        let shape = round_shape(&means, &covariances, length, self.settings)
            .map_err(|reason| NotSolved::new(self.program, (reason, 0)))?;
        Ok(fit::fit(self.program, shape, &paths, self.settings, random)?.physical(self.scale))
    }

    /// Means μ_k with which Σ w_k μ_k is nearest to the mean of the paths at all phases. The mean of the samples around
    /// a phase lies inside of what is curved; what the field does depends on neither.
    fn means<const N: usize>(&self, paths: &[BlockPath<N>]) -> Vec<SVector<f64, N>> {
        let (count, phases) = (self.gaussians.len(), &self.rounds.phases);
        let width = self.settings.phase_overlap / count as f64;
        let own: Vec<f64> = self.gaussians.iter().map(|g| g.phase).collect();
        let copies = copies(&own, width);
        let mut weights = DMatrix::zeros(phases.len(), count);
        for (i, phase) in phases.iter().enumerate() {
            for copy in &copies {
                let away = phase - own[copy.component] - f64::from(copy.round);
                weights[(i, copy.component)] += (-0.5 * (away / width).powi(2)).exp();
            }
            let sum: f64 = weights.row(i).sum();
            weights.row_mut(i).unscale_mut(sum);
        }
        let mean = DMatrix::from_fn(phases.len(), N - 1, |i, j| {
            paths.iter().map(|path| path.points[i][j]).sum::<f64>() / paths.len() as f64
        });
        let square = weights.tr_mul(&weights) + DMatrix::identity(count, count) * RIDGE;
        let solved = square.cholesky().map(|factor| factor.solve(&weights.tr_mul(&mean)));
        let last = self.gaussians[0].mean.len() - 1;
        let at = |k: usize, i: usize| match &solved {
            _ if i + 1 == N => self.gaussians[k].mean[last],
            Some(means) => means[(k, i)],
            None => self.gaussians[k].mean[self.first + i],
        };
        (0..count).map(|k| SVector::from_fn(|i, _| at(k, i))).collect()
    }
}
