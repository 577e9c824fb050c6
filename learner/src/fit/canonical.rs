//! Fits the canonical policy: a field of positions, and one of orientations where the skill has them.

use glam::DVec3;
use nalgebra::{SMatrix, SVector};
use rand_chacha::ChaCha8Rng;
use tprmp_model::skill_model::{FieldModel, PolicyModel, Program, ProgramFit};

use crate::canonical::CanonicalSet;
use crate::canonical::path::Path;
use crate::fit::error::NotSolved;
use crate::fit::field::{self, fit_blocks, shape};
use crate::fit::targets::BlockPath;
use crate::mixture::tp_gmm::TpGmm;
use crate::skill::{FieldSettings, Skill};

/// Fits both fields, side by side, to the mixture of the demonstrations.
///
/// # Errors
/// [`NotSolved`]: a field's program has no solution.
pub fn fit(
    skill: &Skill,
    settings: &FieldSettings,
    mixture: &TpGmm,
    set: &CanonicalSet,
    seed: u64,
) -> Result<(PolicyModel, Vec<ProgramFit>), NotSolved> {
    let plane = skill.manifold.position_dimension() == 2;
    let position = Block {
        program: Program::PositionField,
        paths: set.demonstrations.iter().map(|d| &d.position).collect(),
        scale: set.scales[0],
        goal: set.map.goal().position,
        first: 0,
    };
    let orientation = skill.manifold.has_orientation().then(|| Block {
        program: Program::OrientationField,
        paths: set.demonstrations.iter().map(|d| &d.rotation).collect(),
        scale: set.scales[1],
        goal: DVec3::ZERO,
        first: skill.manifold.position_dimension(),
    });
    fit_blocks(
        seed,
        |random| match plane {
            true => position.fit::<3>(settings, mixture, set, random),
            false => position.fit::<4>(settings, mixture, set, random),
        },
        orientation.map(|block| {
            move |random: &mut ChaCha8Rng| block.fit::<4>(settings, mixture, set, random)
        }),
    )
}

/// One block of the joint coordinates.
struct Block<'a> {
    program: Program,
    paths: Vec<&'a Path>,
    /// ŷ = scale · y.
    scale: f64,
    goal: DVec3,
    /// Its first joint coordinate.
    first: usize,
}

impl Block<'_> {
    /// Fits the field on the block's coordinates and the phase, N together.
    fn fit<const N: usize>(
        &self,
        settings: &FieldSettings,
        mixture: &TpGmm,
        set: &CanonicalSet,
        random: &mut ChaCha8Rng,
    ) -> Result<(FieldModel, ProgramFit), NotSolved> {
        let normalised = |y: &DVec3, phase: f64| {
            let block = y.to_array();
            let last = phase * mixture.phase_length;
            let entry = |i| if i + 1 < N { block[i] * self.scale } else { last };
            SVector::<f64, N>::from_fn(|i, _| entry(i))
        };
        let all = |points: &[DVec3], phases: &[[f64; 3]], derivative: usize| {
            points.iter().zip(phases).map(|(y, s)| normalised(y, s[derivative])).collect()
        };
        let paths: Vec<_> = std::iter::zip(&self.paths, &set.demonstrations)
            .map(|(path, demonstration)| BlockPath {
                points: all(&path.points, &demonstration.phases, 0),
                velocities: all(&path.velocities, &demonstration.phases, 1),
                accelerations: all(&path.accelerations, &demonstration.phases, 2),
            })
            .collect();
        // The block's rows and columns of the joint Gaussians, and the phase's.
        let gaussians = &mixture.phased;
        let at = |i: usize| {
            if i + 1 < N { self.first + i } else { gaussians[0].mean.len() - 1 }
        };
        let means: Vec<_> =
            gaussians.iter().map(|g| SVector::<f64, N>::from_fn(|i, _| g.mean[at(i)])).collect();
        let covariances: Vec<_> = gaussians
            .iter()
            .map(|g| SMatrix::<f64, N, N>::from_fn(|i, j| g.covariance[(at(i), at(j))]))
            .collect();
        let shape = shape(&means, &covariances, &normalised(&self.goal, 1.0), settings)
            .map_err(|reason| NotSolved::new(self.program, (reason, 0)))?;
        let fitted = field::fit(self.program, shape, &paths, settings, random)?;
        let (mut field, figures) = fitted.physical(self.scale);
        // Scaled there and back the goal may be a rounding error away.
        let goal = field.components.last_mut().expect("the goal has a component");
        goal.mean = self.goal.to_array()[..N - 1].to_vec();
        goal.mean.push(1.0);
        Ok((field, figures))
    }
}
