//! Fits the field of one block.
//!
//! Everything is in normalised coordinates ẑ: ŷ, and last the phase times its length;
//! [`Fitted::physical`] scales back.

use nalgebra::{SMatrix, SVector};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_model::skill_model::{FieldModel, Figure, PolicyModel, Program, ProgramFit, valley};
use tprmp_rmpflow::policy::canonical::field::Component;

use crate::fit::basis::Shape;
use crate::fit::error::{NotSolved, Reason};
use crate::fit::program::FieldProgram;
use crate::fit::targets::{BlockPath, Guide, targets};
use crate::skill::FieldSettings;

/// A fitted field in normalised coordinates.
#[derive(Clone, Debug)]
pub struct Fitted<const N: usize> {
    /// What was settled before.
    pub shape: Shape<N>,
    /// The parameters.
    pub parameters: Vec<f64>,
    /// Figures of the program.
    pub figures: ProgramFit,
}

/// The shape of a block's field from the mixture's means and covariances in ẑ.
///
/// M_k = γ (C_k + σ₀² I)⁻¹; the goal's metric is γ times the mean of det(M_k/γ)^{1/N}. Components pass
/// into each other over a fraction of the phase between two of them.
///
/// # Errors
/// A covariance, or the metric that comes of it, is not positive definite.
pub fn shape<const N: usize>(
    means: &[SVector<f64, N>],
    covariances: &[SMatrix<f64, N, N>],
    goal: &SVector<f64, N>,
    settings: &FieldSettings,
) -> Result<Shape<N>, Reason> {
    let (mut components, sizes) = components(means, covariances, settings)?;
    let metric = settings.metric_scale * sizes / means.len() as f64;
    components.push(bare(*goal, SMatrix::identity() * metric));
    let phase_width = settings.phase_overlap * goal[N - 1] / means.len() as f64;
    Ok(Shape::new(components, phase_width, settings.damping_1_s))
}

/// The shape of a block's field that goes round, from the means and covariances of one round in ẑ, in order of their
/// phases.
///
/// * `length`  of a round in the last coordinate \[ŷ\]
///
/// # Errors
/// A covariance, or the metric that comes of it, is not positive definite.
pub fn round_shape<const N: usize>(
    means: &[SVector<f64, N>],
    covariances: &[SMatrix<f64, N, N>],
    length: f64,
    settings: &FieldSettings,
) -> Result<Shape<N>, Reason> {
    let (components, _) = components(means, covariances, settings)?;
    let phase_width = settings.phase_overlap * length / means.len() as f64;
    Ok(Shape::round(components, phase_width, settings.damping_1_s, length))
}

/// A component without a potential.
fn bare<const N: usize>(mean: SVector<f64, N>, metric: SMatrix<f64, N, N>) -> Component<N> {
    let (gradient, hessian) = (SVector::zeros(), SMatrix::zeros());
    Component { mean, metric, potential: 0.0, gradient, hessian }
}

/// The components of the mixture with their metrics, and Σ det(M_k/γ)^{1/N}.
fn components<const N: usize>(
    means: &[SVector<f64, N>],
    covariances: &[SMatrix<f64, N, N>],
    settings: &FieldSettings,
) -> Result<(Vec<Component<N>>, f64), Reason> {
    let identity = SMatrix::<f64, N, N>::identity();
    let mut components = Vec::with_capacity(means.len() + 1);
    let mut sizes = 0.0;
    for (mean, covariance) in means.iter().zip(covariances) {
        let widened = covariance + identity * settings.activation_width.powi(2);
        let factor = widened.cholesky().ok_or(Reason::Singular("a covariance"))?;
        let inverse = factor.inverse();
        let precision = (inverse + inverse.transpose()) * 0.5;
        let root_determinant: f64 = factor.l().diagonal().iter().product();
        sizes += root_determinant.powf(-2.0 / N as f64);
        let metric = precision * settings.metric_scale;
        metric.cholesky().ok_or(Reason::Singular("a metric"))?;
        components.push(bare(*mean, metric));
    }
    Ok((components, sizes))
}

/// Fits the field of a block.
///
/// The descent constraint is soft, so that contradictory demonstrations still give a model. Where the
/// valley of the potential does not fall towards the goal, it is repeated with more weight, at the fault
/// and at random points around it, and the program solved again.
///
/// # Errors
/// [`NotSolved`] when the solver finds no solution.
pub fn fit<const N: usize>(
    name: Program,
    shape: Shape<N>,
    paths: &[BlockPath<N>],
    settings: &FieldSettings,
    random: &mut impl Rng,
) -> Result<Fitted<N>, NotSolved> {
    let guide = match shape.round_length() {
        None => Guide::new(paths, &shape.goal(), settings),
        Some(length) => Guide::round(paths, length, settings),
    };
    let descents = guide.descents(random);
    let phase_length = shape.phase_length();
    let targets = targets(paths, settings);
    let failed = |reason| NotSolved::new(name, (reason, 0));
    let mut program =
        FieldProgram::new(name, &shape, &targets, &descents, settings).map_err(failed)?;
    let mut rounds = 0;
    loop {
        let (mut parameters, status, iterations) = program.solve()?;
        program.bring_goal_to_rest(&mut parameters).map_err(failed)?;
        let field = shape.field(&parameters);
        let (_, faults) = match shape.round_length() {
            None => valley::descent(&field, phase_length),
            Some(_) => valley::round_descent(&field, phase_length),
        };
        if faults.is_empty() || rounds == settings.refinement_rounds_max {
            let mut figures = program.figures(&parameters, status, iterations);
            figures.figures.push((Figure::RefinementRounds, rounds as f64));
            figures.figures.push((Figure::ValleyFaults, faults.len() as f64));
            return Ok(Fitted { shape, parameters, figures });
        }
        for point in faults {
            program.constrain(&guide.descent(point), settings.refinement_weight).map_err(failed)?;
            for _ in 0..settings.refinement_points {
                let offset = SVector::from_fn(|_, _| random.random_range(-1.0..1.0));
                let beside = guide.descent(point + offset * settings.refinement_radius);
                program.constrain(&beside, settings.refinement_weight).map_err(failed)?;
            }
        }
        rounds += 1;
    }
}

/// Fits the field of positions, and that of orientations where there is one, side by side. Each has a stream of random
/// numbers of its own, so that they can be fitted at once.
///
/// # Errors
/// [`NotSolved`]: a field's program has no solution.
pub(crate) fn fit_blocks(
    seed: u64,
    position: impl FnOnce(&mut ChaCha8Rng) -> Result<(FieldModel, ProgramFit), NotSolved> + Send,
    orientation: Option<
        impl FnOnce(&mut ChaCha8Rng) -> Result<(FieldModel, ProgramFit), NotSolved> + Send,
    >,
) -> Result<(PolicyModel, Vec<ProgramFit>), NotSolved> {
    let random = |stream| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        random
    };
    let (position, orientation) =
        rayon::join(|| position(&mut random(0)), || orientation.map(|fit| fit(&mut random(3))));
    let (position, figures) = position?;
    let mut programs = vec![figures];
    let orientation = orientation.transpose()?.map(|(field, figures)| {
        programs.push(figures);
        field
    });
    Ok((PolicyModel::Canonical { position, orientation }, programs))
}

impl<const N: usize> Fitted<N> {
    /// The field in physical coordinates, divided by the goal's metric, or the mean one where there is no goal: y = ŷ/s,
    /// and the phase from 0 to 1.
    ///
    /// With ẑ = T z, T diagonal, Φ(z) = c Φ̂(T z) and M(z) = c T M̂(T z) T give the same accelerations for
    /// any c; c = 1/(s² m_G) makes M_G the identity in y.
    #[must_use]
    pub fn physical(&self, length_scale: f64) -> (FieldModel, ProgramFit) {
        let s = length_scale;
        let phase_length = self.shape.phase_length();
        let scales = SVector::<f64, N>::from_fn(|i, _| if i + 1 < N { s } else { phase_length });
        let (mut components, fall) = self.shape.learned(&self.parameters);
        let goes_round = self.shape.round_length().is_some();
        let unit_metric = if goes_round {
            let mean = |c: &Component<N>| (0..N - 1).map(|i| c.metric[(i, i)]).sum::<f64>();
            components.iter().map(mean).sum::<f64>() / ((N - 1) * components.len()) as f64
        } else {
            components[components.len() - 1].metric[(0, 0)]
        };
        let c = 1.0 / (s * s * unit_metric);
        let both = scales * scales.transpose() * c;
        for component in &mut components {
            component.mean.component_div_assign(&scales);
            component.metric.component_mul_assign(&both);
            component.potential *= c;
            component.gradient.component_mul_assign(&(scales * c));
            component.hessian.component_mul_assign(&both);
        }
        let bare = self.shape.bare();
        let width = bare.phase_width() / phase_length;
        let mut field = FieldModel::from_parts(&components, width, bare.damping_1_s());
        field.fall_per_round = goes_round.then_some(fall * c);
        let mut figures = self.figures.clone();
        figures.figures.push((Figure::LengthScale, s));
        figures.figures.push((Figure::PhaseLength, phase_length));
        (field, figures)
    }
}
