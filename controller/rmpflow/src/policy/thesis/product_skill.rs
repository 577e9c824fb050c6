//! The thesis' skill (TP-RMP): Gaussians seen from all frames, multiplied in the world, and the
//! field of their mixture as a leaf on the pose of the tool  [thesis section 4.2, algorithm 4.1].
//!
//! ```text
//! N(μ̂_k, Σ̂_k) ∝ Π_p N(A_p μ_kp + b_p, A_p Σ_kp A_pᵀ)          [thesis eq. 3.6]
//! M ÿ = −∇Φ − ξ − B ẏ on the mixture of the N(μ̂_k, Σ̂_k)        [thesis eq. 4.4]
//! ```
//!
//! **One chart.** For R³ × S³ the field lives in y = \[x; r\] with q = c exp(r), c the orientation of
//! the last product, the goal. A product with mean orientation q̂_k has its mean at r_k = log(c⁻¹ q̂_k),
//! and its precision, given in body axes at q̂_k, becomes Tᵀ Λ̂_k T with T = diag(I, J_r(r_k)). This
//! departs from the thesis, which takes logarithms at each mean and leaves out their derivatives:
//! here potential, metric and curvature are derivatives of one another, so that V = Φ + ½ ẏᵀMẏ never
//! rises while the frames stand still. The chart ends at |r| = π: opposite to the goal's orientation
//! the policy jumps.
//!
//! **Frames are frozen.** As in the thesis' algorithm the products are those of the frames as they
//! are at the instant; velocities and accelerations of the frames do not enter. A goal that moves is
//! followed with a lag, and V may rise while it moves.

use glam::{DMat3, DVec3};
use nalgebra::{SMatrix, SVector, Vector6};

use crate::lanes::{self, Kernel, LANES, Lanes, Quad};
use crate::policy::canonical::field::{COMPONENT_CAPACITY, FieldValue};
use crate::policy::thesis::gaussian_field::GaussianField;
use crate::policy::thesis::gaussian_product::{PoseGaussian, block_diagonal, strongest, tangent};
use crate::policy::thesis::product_quad::{Frame, PoseQuad};
use crate::policy::value::{FRAME_CAPACITY, SkillInertia, SkillValue};
use tprmp_spatial::rotation::{Chart, orientation_chart};
use tprmp_spatial::{MovingPose, Pose, Twist};

/// One component, as the frames see it.
#[derive(Debug, Clone, PartialEq)]
pub struct ProductComponent<const D: usize> {
    /// N(μ_kp, Σ_kp) in the coordinates of each frame p, in the order of the skill's frames.
    pub gaussians: Box<[PoseGaussian<D>]>,
    /// φ⁰_k, the bias potential.
    pub potential: f64,
    /// d_k ≥ 0 \[s/m² or s/rad²\].
    pub damping: f64,
}

/// Why a skill could not be built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProductSkillError {
    /// There is no component, or there are more than [`COMPONENT_CAPACITY`].
    ComponentCount(usize),
    /// A component is seen from no frame, from more than [`FRAME_CAPACITY`], or from another number
    /// of them than the first one.
    FrameCount {
        /// The component.
        component: usize,
        /// Its number of frames.
        frames: usize,
    },
    /// A precision is not positive definite or not finite.
    Precision {
        /// The component.
        component: usize,
        /// The frame.
        frame: usize,
    },
}

/// A skill on R² (D = 2), R³ (D = 3) or R³ × S³ (D = 6): immutable. Its last component is the goal's.
#[derive(Debug, Clone)]
pub struct ProductSkill<const D: usize> {
    components: Box<[ProductComponent<D>]>,
    /// The same, as they are evaluated.
    quads: Box<[SkillQuad<D>]>,
    frame_count: usize,
    /// γ \[s²\].
    metric_scale: f64,
    /// δ.
    huber_threshold: f64,
    /// Mean linear eigenvalue of γ Λ̂ of the goal's component; no pose of the frames changes it.
    goal_inertia: f64,
}

/// Four components side by side, one in each lane.
#[derive(Debug, Clone)]
struct SkillQuad<const D: usize> {
    /// What each frame sees.
    factors: Box<[PoseQuad<D>]>,
    /// For each lane, the frame that sees the Gaussian of the largest det Λ_p; no pose of the
    /// frames changes that.
    strongest: [usize; LANES],
    /// 1, or 0 in the lanes beyond the last component, which repeat that.
    presence: Quad,
    potential: Quad,
    damping: Quad,
}

/// What a skill needs between calls: the field of the frames as they were. It belongs to one skill.
#[derive(Debug, Clone)]
pub struct ProductState<const D: usize> {
    /// The frames of the field; not finite where there is none, so that they equal no others.
    frames: [Pose; FRAME_CAPACITY],
    goal: Pose,
    field: GaussianField<D>,
    /// Whether there is a field.
    defined: bool,
    /// Where the factors of a product are put together.
    factors: [PoseQuad<D>; FRAME_CAPACITY],
}

/// A moving pose x in the coordinates y of the field: ẏ = J ẋ and ÿ = J (ẍ − b), with ẋ and ẍ on
/// \[linear; angular\] in the world.
#[derive(Debug, Clone, Copy)]
pub struct Coordinates<const D: usize> {
    /// y \[m, rad\].
    pub point: SVector<f64, D>,
    /// ẏ \[m/s, rad/s\].
    pub velocity: SVector<f64, D>,
    /// J, D×6.
    pub jacobian: SMatrix<f64, D, 6>,
    /// b \[m/s², rad/s²\].
    pub bias: Vector6<f64>,
}

impl<const D: usize> ProductState<D> {
    /// A state without a field.
    #[must_use]
    pub fn new() -> Self {
        Self {
            frames: [Pose::UNDEFINED; FRAME_CAPACITY],
            goal: Pose::UNDEFINED,
            field: GaussianField::NONE,
            defined: false,
            factors: [PoseQuad::NONE; FRAME_CAPACITY],
        }
    }

    /// The mean of the goal's product for the frames of the last call, in the world; not finite when
    /// there is none.
    ///
    /// For D < 6 its orientation, and for D = 2 its height, is that of the Gaussian that is the
    /// strongest at the goal.
    #[must_use]
    pub fn goal(&self) -> Pose {
        self.goal
    }

    /// The field for the frames of the last call; `None` before the first, and when there is no
    /// product of the Gaussians.
    #[must_use]
    pub fn field(&self) -> Option<&GaussianField<D>> {
        self.defined.then_some(&self.field)
    }

    /// A moving pose in the coordinates of the field.
    ///
    /// * `velocity`  of the pose, in the world
    #[must_use]
    pub fn coordinates(&self, pose: &Pose, velocity: &Twist) -> Coordinates<D> {
        if D < 6 {
            return Coordinates {
                point: tangent(pose.position, DVec3::ZERO),
                velocity: tangent(velocity.linear, DVec3::ZERO),
                jacobian: block_diagonal(DMat3::IDENTITY, DMat3::ZERO),
                bias: Vector6::zeros(),
            };
        }
        let chart = orientation_chart(self.goal.orientation, pose.orientation, velocity.angular);
        Coordinates {
            point: tangent(pose.position, chart.rotation),
            velocity: tangent(velocity.linear, chart.velocity),
            jacobian: block_diagonal(DMat3::IDENTITY, chart.jacobian),
            bias: tangent(DVec3::ZERO, chart.bias),
        }
    }
}

impl<const D: usize> Default for ProductState<D> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const D: usize> ProductSkill<D> {
    /// A skill of these components, the last of which is the goal's.
    ///
    /// * `metric_scale`  γ > 0 \[s²\]
    /// * `huber_threshold`  δ > 0
    ///
    /// # Errors
    /// When the number of components or frames does not fit, or a precision is not positive
    /// definite.
    pub fn new(
        components: Box<[ProductComponent<D>]>,
        metric_scale: f64,
        huber_threshold: f64,
    ) -> Result<Self, ProductSkillError> {
        let count = components.len();
        let (Some(first), Some(goal)) = (components.first(), components.last()) else {
            return Err(ProductSkillError::ComponentCount(0));
        };
        if count > COMPONENT_CAPACITY {
            return Err(ProductSkillError::ComponentCount(count));
        }
        let frame_count = first.gaussians.len();
        for (k, component) in components.iter().enumerate() {
            let frames = component.gaussians.len();
            if frames == 0 || frames > FRAME_CAPACITY || frames != frame_count {
                return Err(ProductSkillError::FrameCount { component: k, frames });
            }
            for (p, gaussian) in component.gaussians.iter().enumerate() {
                if strongest(&[*gaussian]).is_none() {
                    return Err(ProductSkillError::Precision { component: k, frame: p });
                }
            }
        }
        // The trace of a sum of turned blocks is the sum of the blocks' traces.
        let linear = D.min(3);
        let trace: f64 =
            goal.gaussians.iter().flat_map(|g| (0..linear).map(|i| g.precision[(i, i)])).sum();
        let goal_inertia = metric_scale * trace / linear as f64;
        let quads =
            components.chunks(LANES).map(|group| SkillQuad::new(group, frame_count)).collect();
        Ok(Self { frame_count, metric_scale, huber_threshold, goal_inertia, quads, components })
    }

    /// Its components, the last of which is the goal's.
    #[must_use]
    pub fn components(&self) -> &[ProductComponent<D>] {
        &self.components
    }

    /// γ \[s²\].
    #[must_use]
    pub fn metric_scale(&self) -> f64 {
        self.metric_scale
    }

    /// δ.
    #[must_use]
    pub fn huber_threshold(&self) -> f64 {
        self.huber_threshold
    }

    /// How many frames it is seen from.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.frame_count
    }

    /// Brings the state up to the frames: nothing to do when they are where they were, bit for bit.
    ///
    /// * `frames`  in the order of the skill's frames; of those beyond them nothing is read
    ///
    /// Hot path: no allocation; when a frame has moved, O(K P D³) and the iterations of
    /// [`product`](crate::policy::thesis::gaussian_product::product) for each component.
    pub fn update(&self, frames: &[MovingPose], state: &mut ProductState<D>) {
        let Some(frames) = frames.get(..self.frame_count) else {
            state.frames = [Pose::UNDEFINED; FRAME_CAPACITY];
            (state.defined, state.goal) = (false, Pose::UNDEFINED);
            return;
        };
        if frames.iter().zip(&state.frames).all(|(now, then)| now.pose == *then) {
            return;
        }
        for (then, now) in state.frames.iter_mut().zip(frames) {
            *then = now.pose;
        }
        let goal = lanes::run(Update { skill: self, state });
        state.defined = goal.is_some();
        state.goal = goal.unwrap_or(Pose::UNDEFINED);
    }

    /// Evaluates the skill for a moving pose.
    ///
    /// * `inertia`  force and metric are scaled so that the mean linear eigenvalue of the goal
    ///   component's γ Λ̂ is `linear_kg`; the ratio of angular to linear inertia is learned, and
    ///   `angular_kg_m2` does not enter
    /// * `frames`  in the order of the skill's frames; their velocities do not enter
    /// * `velocity`  of the pose, in the world
    /// * `state`  of the last call, brought up to these frames
    ///
    /// For D = 2 there is no force and no inertia in height and rotation, for D = 3 none in
    /// rotation.
    ///
    /// Hot path: no allocation. Input that is not finite, or fewer frames than the skill has, gives
    /// output that is not finite.
    #[must_use]
    pub fn evaluate(
        &self,
        inertia: &SkillInertia,
        frames: &[MovingPose],
        pose: &Pose,
        velocity: &Twist,
        state: &mut ProductState<D>,
    ) -> SkillValue {
        self.update(frames, state);
        if !state.defined {
            return SkillValue::undefined();
        }
        let scale = inertia.linear_kg / self.goal_inertia;
        let mut value = SkillValue::zero();
        let chart = (D == 6)
            .then(|| orientation_chart(state.goal.orientation, pose.orientation, velocity.angular));
        let (rotation, rate) =
            chart.as_ref().map_or((DVec3::ZERO, DVec3::ZERO), |c| (c.rotation, c.velocity));
        let (point, velocity) = (tangent(pose.position, rotation), tangent(velocity.linear, rate));
        let field = state.field.evaluate(&point, &velocity);
        pull_back(&field, &velocity, scale, chart.as_ref(), &mut value);
        value
    }
}

/// Sets the leaf of the field on \[linear; angular\] of the pose: as
/// [`add_pullback`](crate::natural::Natural::add_pullback) with J = diag(I, J_r) of the chart, without
/// the zeros.
fn pull_back<const D: usize>(
    field: &FieldValue<D>,
    velocity: &SVector<f64, D>,
    scale: f64,
    chart: Option<&Chart>,
    value: &mut SkillValue,
) {
    value.energy = field.energy(velocity) * scale;
    let force = field.force(velocity) * scale;
    let metric = field.metric * scale;
    let natural = &mut value.natural;
    for i in 0..D.min(3) {
        natural.force[i] = force[i];
        for j in 0..D.min(3) {
            natural.metric[(i, j)] = metric[(i, j)];
        }
    }
    let (Some(chart), 6) = (chart, D) else { return };
    let vector = |first: usize| DVec3::new(force[first], force[first + 1], force[first + 2]);
    let block = |row: usize, column: usize| {
        DMat3::from_cols_array(&core::array::from_fn(|n| metric[(row + n % 3, column + n / 3)]))
    };
    let (jacobian, back) = (chart.jacobian, chart.jacobian.transpose());
    let drift = jacobian * chart.bias;
    let (cross, angular) = (block(0, 3) * jacobian, block(3, 3));
    let linear = vector(0) + block(0, 3) * drift;
    let turning = back * (vector(3) + angular * drift);
    let angular = back * angular * jacobian;
    for i in 0..3 {
        natural.force[i] = linear[i];
        natural.force[i + 3] = turning[i];
        for j in 0..3 {
            natural.metric[(i, j + 3)] = cross.col(j)[i];
            natural.metric[(j + 3, i)] = cross.col(j)[i];
            natural.metric[(i + 3, j + 3)] = angular.col(j)[i];
        }
    }
}

impl<const D: usize> SkillQuad<D> {
    /// Of one to four components, seen from as many frames.
    fn new(components: &[ProductComponent<D>], frame_count: usize) -> Self {
        let mut quad = Self {
            factors: vec![PoseQuad::NONE; frame_count].into(),
            strongest: [0; LANES],
            presence: [0.0; LANES],
            potential: [0.0; LANES],
            damping: [0.0; LANES],
        };
        for lane in 0..LANES {
            quad.presence[lane] = f64::from(u8::from(lane < components.len()));
            let component = &components[lane.min(components.len() - 1)];
            for (factor, gaussian) in quad.factors.iter_mut().zip(&component.gaussians) {
                factor.set(lane, gaussian);
            }
            quad.strongest[lane] = strongest(&component.gaussians).unwrap_or(0);
            quad.potential[lane] = component.potential;
            quad.damping[lane] = component.damping;
        }
        quad
    }
}

/// The field of the frames of a state, and the mean of its goal; `None` when they are not finite.
struct Update<'a, const D: usize> {
    skill: &'a ProductSkill<D>,
    state: &'a mut ProductState<D>,
}

impl<const D: usize> Kernel for Update<'_, D> {
    type Output = Option<Pose>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<Pose> {
        let Self { skill, state } = self;
        let mut frames = [Frame::new(&Pose::IDENTITY); FRAME_CAPACITY];
        for (frame, pose) in frames.iter_mut().zip(&state.frames).take(skill.frame_count) {
            *frame = Frame::new(pose);
        }
        let field = &mut state.field;
        field.count = skill.components.len();
        field.metric_scale = skill.metric_scale;
        field.huber_threshold = skill.huber_threshold;
        // The last group is the first to be evaluated: the goal is the centre of the chart.
        let mut goal = None;
        for (quad, result) in skill.quads.iter().zip(&mut field.quads).rev() {
            for ((factor, frame), moved) in quad.factors.iter().zip(&frames).zip(&mut state.factors)
            {
                factor.transform::<L>(frame, moved);
            }
            let factors = state.factors.get(..skill.frame_count)?;
            let (product, determinant) = PoseQuad::product::<L>(factors, &quad.strongest)?;
            let last = (skill.components.len() - 1) % LANES;
            let center = goal.get_or_insert_with(|| product.get(last).mean);
            product.chart::<L>(determinant, center.orientation, result);
            result.normaliser = (L::load(&result.normaliser) * L::load(&quad.presence)).store();
            result.potential = quad.potential;
            result.damping = quad.damping;
        }
        goal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::natural::Natural;
    use glam::DQuat;
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;

    const INERTIA: SkillInertia = SkillInertia { linear_kg: 2.0, angular_kg_m2: 0.0 };
    const COMPONENTS: usize = 4;
    const SCALE: f64 = 0.01;
    const THRESHOLD: f64 = 1.5;

    fn turned(rotation: [f64; 3]) -> DQuat {
        DQuat::from_scaled_axis(rotation.into())
    }

    /// A path of Gaussians from the first frame's origin to the second one's, precise at the start in
    /// the first frame and at the end in the second.
    fn skill<const D: usize>() -> ProductSkill<D> {
        let gaussian = |fraction: f64, origin: DVec3, weight: f64| {
            let mean = Pose {
                position: DVec3::new(0.4, -0.3, 0.2) * fraction + origin,
                orientation: turned([0.1, 0.2 - 0.6 * fraction, 0.5 * fraction]),
            };
            let root = SMatrix::<f64, D, D>::from_fn(|i, j| {
                ((i * 7 + j * 3) as f64 + 5.0 * fraction).sin() + if i == j { 2.0 } else { 0.0 }
            });
            PoseGaussian { mean, precision: root * root.transpose() * (20.0 * weight) }
        };
        let component = |k: usize| {
            let fraction = k as f64 / (COMPONENTS - 1) as f64;
            let from_goal = DVec3::new(-0.4, 0.3, -0.2);
            ProductComponent {
                gaussians: Box::new([
                    gaussian(fraction, DVec3::ZERO, 1.2 - fraction),
                    gaussian(fraction, from_goal, 0.2 + fraction),
                ]),
                potential: 12.0 * (1.0 - fraction),
                damping: 15.0 + 10.0 * fraction,
            }
        };
        ProductSkill::new((0..COMPONENTS).map(component).collect(), SCALE, THRESHOLD).unwrap()
    }

    fn at(position: [f64; 3], orientation: DQuat) -> MovingPose {
        MovingPose::at_rest(Pose { position: position.into(), orientation })
    }

    fn frames() -> [MovingPose; 2] {
        [
            at([0.1, 0.2, 0.3], turned([0.0, 0.0, 0.4])),
            at([0.55, -0.15, 0.45], turned([0.0, 0.0, -0.3])),
        ]
    }

    fn twist([linear, angular]: [DVec3; 2]) -> Twist {
        Twist { linear, angular }
    }

    fn evaluate<const D: usize>(
        skill: &ProductSkill<D>,
        frames: &[MovingPose],
        pose: &Pose,
        velocity: [DVec3; 2],
    ) -> SkillValue {
        skill.evaluate(&INERTIA, frames, pose, &twist(velocity), &mut ProductState::new())
    }

    /// The acceleration, zero where the skill has no inertia.
    fn acceleration<const D: usize>(natural: &Natural<6>) -> [DVec3; 2] {
        let mut natural = *natural;
        for i in D..6 {
            assert!(natural.force[i] == 0.0);
            assert!(natural.metric.row(i).norm() + natural.metric.column(i).norm() == 0.0);
            natural.metric[(i, i)] = 1.0;
        }
        let a = natural.resolve().unwrap();
        [DVec3::new(a[0], a[1], a[2]), DVec3::new(a[3], a[4], a[5])]
    }

    /// Eq. 3.6 and 4.4 to 4.17 as they are printed, with δ in 4.13: force, metric and energy of the
    /// policy that is not scaled.
    fn as_printed(
        skill: &ProductSkill<3>,
        frames: &[MovingPose],
        x: Vector3<f64>,
        v: Vector3<f64>,
    ) -> (Vector3<f64>, Matrix3<f64>, f64) {
        let mut mixture = Vec::new();
        for component in skill.components() {
            let (mut inverse, mut weighted) = (Matrix3::zeros(), Vector3::zeros());
            for (gaussian, frame) in component.gaussians.iter().zip(frames) {
                let q = frame.pose.orientation;
                let a = Matrix3::from_column_slice(&DMat3::from_quat(q).to_cols_array());
                let b = Vector3::from(frame.pose.position.to_array());
                let mean = a * Vector3::from(gaussian.mean.position.to_array()) + b;
                let covariance = a * gaussian.precision.try_inverse().unwrap() * a.transpose();
                inverse += covariance.try_inverse().unwrap();
                weighted += covariance.try_inverse().unwrap() * mean;
            }
            let covariance = inverse.try_inverse().unwrap();
            mixture.push((covariance * weighted, covariance, component));
        }
        let pull = |k: usize| mixture[k].1.try_inverse().unwrap() * (x - mixture[k].0);
        let densities: Vec<f64> = (0..COMPONENTS)
            .map(|k| {
                (-0.5 * (x - mixture[k].0).dot(&pull(k))).exp() / mixture[k].1.determinant().sqrt()
            })
            .collect();
        let w: Vec<f64> = densities.iter().map(|d| d / densities.iter().sum::<f64>()).collect();
        let mean_pull: Vector3<f64> = (0..COMPONENTS).map(|j| pull(j) * w[j]).sum();
        let (mut metric, mut curvature) = (Matrix3::zeros(), Vector3::zeros());
        let (mut potential, mut gradient, mut damping) = (0.0, Vector3::zeros(), 0.0);
        for k in 0..COMPONENTS {
            let (mean, covariance, component) = &mixture[k];
            let precision = covariance.try_inverse().unwrap();
            let weight_gradient = (mean_pull - pull(k)) * w[k];
            metric += precision * (SCALE * w[k]);
            curvature += (precision * v * weight_gradient.dot(&v)
                - weight_gradient * (0.5 * v.dot(&(precision * v))))
                * SCALE;
            let norm = (x - mean).dot(&pull(k)).sqrt();
            let (local, slope) = if norm <= THRESHOLD {
                (0.5 * norm * norm, pull(k))
            } else {
                (THRESHOLD * (norm - 0.5 * THRESHOLD), pull(k) * (THRESHOLD / norm))
            };
            potential += w[k] * (component.potential + local);
            gradient += slope * w[k] + weight_gradient * (component.potential + local);
            damping += w[k] * component.damping;
        }
        let force = -gradient - curvature - v * damping;
        (force, metric, potential + 0.5 * v.dot(&(metric * v)))
    }

    fn vector(size: f64) -> impl Strategy<Value = DVec3> {
        let component = -size..size;
        (component.clone(), component.clone(), component).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    fn motion() -> impl Strategy<Value = (Pose, [DVec3; 2])> {
        (vector(0.4), vector(0.7), vector(0.5), vector(0.8)).prop_map(|(x, r, linear, angular)| {
            let position = DVec3::new(0.3, 0.0, 0.35) + x;
            (Pose { position, orientation: DQuat::from_scaled_axis(r) }, [linear, angular])
        })
    }

    /// Moving frames and tool turns the acceleration and moves the goal.
    fn is_equivariant<const D: usize>(
        (pose, velocity): &(Pose, [DVec3; 2]),
        transforms: &Pose,
    ) -> bool {
        let skill = skill::<D>();
        let turn = transforms.orientation;
        let velocity = if D < 3 { velocity.map(|v| DVec3::new(v.x, v.y, 0.0)) } else { *velocity };
        let moved = frames().map(|f| MovingPose::at_rest(transforms.compose(&f.pose)));
        let here = evaluate(&skill, &frames(), pose, velocity);
        let there = evaluate(&skill, &moved, &transforms.compose(pose), velocity.map(|v| turn * v));
        let (a, b) = (acceleration::<D>(&here.natural), acceleration::<D>(&there.natural));
        let (mut state, mut moved_state) = (ProductState::new(), ProductState::new());
        skill.update(&frames(), &mut state);
        skill.update(&moved, &mut moved_state);
        let (goal, image) = (transforms.compose(&state.goal()), moved_state.goal());
        let error = (turn * a[0] - b[0]).length() + (turn * a[1] - b[1]).length();
        error < 1e-8 * (1.0 + a[0].length() + a[1].length())
            && (here.energy - there.energy).abs() < 1e-9 * (1.0 + here.energy)
            && (goal.position - image.position).length() < 1e-10
            && goal.rotation_from(&image).length() < 1e-10
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn in_space_it_is_the_thesis_as_printed((pose, [linear, angular]) in motion()) {
            let skill = skill::<3>();
            let (x, v) = (pose.position.to_array().into(), linear.to_array().into());
            let (force, metric, energy) = as_printed(&skill, &frames(), x, v);
            let scale = INERTIA.linear_kg / skill.goal_inertia;
            let found = evaluate(&skill, &frames(), &pose, [linear, angular]);
            let force_found = found.natural.force.fixed_rows::<3>(0).into_owned();
            let metric_found = found.natural.metric.fixed_view::<3, 3>(0, 0).into_owned();
            let norm = 1.0 + (force * scale).norm();
            prop_assert!((force_found - force * scale).norm() < 1e-9 * norm);
            prop_assert!((metric_found - metric * scale).norm() < 1e-9 * norm);
            prop_assert!((found.energy - energy * scale).abs() < 1e-9 * norm);
        }

        #[test]
        fn it_moves_with_the_frames(
            motion in motion(), shift in vector(2.0), turn in vector(1.8), yaw in -3.0..3.0,
        ) {
            let transforms =
                Pose { position: shift, orientation: DQuat::from_scaled_axis(turn) };
            let plane = Pose {
                position: DVec3::new(shift.x, shift.y, 0.0),
                orientation: DQuat::from_rotation_z(yaw),
            };
            prop_assert!(is_equivariant::<2>(&motion, &plane));
            prop_assert!(is_equivariant::<3>(&motion, &transforms));
            prop_assert!(is_equivariant::<6>(&motion, &transforms));
        }

        #[test]
        fn both_quaternions_of_an_orientation_are_the_same(
            (pose, velocity) in motion(), flips in any::<[bool; 3]>(),
        ) {
            let flip = |q: DQuat, flip: bool| if flip { -q } else { q };
            let skill = skill::<6>();
            let mut flipped = frames();
            for (frame, sign) in flipped.iter_mut().zip(flips) {
                frame.pose.orientation = flip(frame.pose.orientation, sign);
            }
            let other = Pose { orientation: flip(pose.orientation, flips[2]), ..pose };
            let a = evaluate(&skill, &frames(), &pose, velocity).natural;
            let b = evaluate(&skill, &flipped, &other, velocity).natural;
            prop_assert!((a.force - b.force).norm() < 1e-10 * (1.0 + a.force.norm()));
            prop_assert!((a.metric - b.metric).norm() < 1e-10 * a.metric.norm());
        }

        /// The state of other frames, then of these, gives what a fresh one gives: bit for bit.
        #[test]
        fn a_state_that_was_used_gives_what_a_fresh_one_gives((pose, velocity) in motion()) {
            let skill = skill::<6>();
            let mut moved = frames();
            moved[1].pose.position.x += 0.1;
            let mut state = ProductState::new();
            for frames in [frames(), frames(), moved, moved, frames()] {
                let used = skill.evaluate(&INERTIA, &frames, &pose, &twist(velocity), &mut state);
                let fresh = evaluate(&skill, &frames, &pose, velocity);
                prop_assert!(used.natural == fresh.natural && used.energy == fresh.energy);
            }
        }
    }

    /// Integrates the resolved acceleration of the pose; `each` sees every value.
    fn rollout<const D: usize>(seconds: f64, mut each: impl FnMut(&SkillValue)) -> (Pose, Pose) {
        let skill = skill::<D>();
        let mut state = ProductState::new();
        let dt = 2e-4;
        let mut pose =
            Pose { position: DVec3::new(0.05, 0.35, 0.2), orientation: turned([0.8, -0.4, 0.9]) };
        let (mut linear, mut angular) = (DVec3::new(0.2, 0.1, -0.1), DVec3::new(0.3, -0.4, 0.5));
        if D < 6 {
            angular = DVec3::ZERO;
        }
        let moved = |pose: &Pose, linear: DVec3, angular: DVec3, h: f64| Pose {
            position: pose.position + linear * h,
            orientation: (DQuat::from_scaled_axis(angular * h) * pose.orientation).normalize(),
        };
        for _ in 0..(seconds / dt) as usize {
            let velocity = Twist { linear, angular };
            let value = skill.evaluate(&INERTIA, &frames(), &pose, &velocity, &mut state);
            each(&value);
            let [a, alpha] = acceleration::<D>(&value.natural);
            let (v2, w2) = (linear + a * (dt / 2.0), angular + alpha * (dt / 2.0));
            let middle = moved(&pose, (linear + v2) * 0.5, (angular + w2) * 0.5, dt / 2.0);
            let value = skill.evaluate(&INERTIA, &frames(), &middle, &twist([v2, w2]), &mut state);
            let [a, alpha] = acceleration::<D>(&value.natural);
            pose = moved(&pose, linear + a * (dt / 2.0), angular + alpha * (dt / 2.0), dt);
            linear += a * dt;
            angular += alpha * dt;
        }
        (pose, state.goal())
    }

    fn energy_never_rises<const D: usize>() {
        let (mut first, mut last) = (None, f64::INFINITY);
        let (pose, goal) = rollout::<D>(8.0, |value| {
            let rise = value.energy - last;
            assert!(rise <= 1e-9 * value.energy.abs(), "{rise:e} at {last}");
            last = value.energy;
            first.get_or_insert(last);
        });
        let fell = last / first.unwrap();
        assert!(fell < 0.5, "{fell}");
        let away = (pose.position - goal.position).truncate().length();
        assert!(away < 0.1, "{away} m away");
    }

    #[test]
    fn energy_never_rises_in_the_plane() {
        energy_never_rises::<2>();
    }

    #[test]
    fn energy_never_rises_in_space() {
        energy_never_rises::<3>();
    }

    #[test]
    fn energy_never_rises_on_poses() {
        energy_never_rises::<6>();
    }

    /// Along a motion of the pose: ẏ and ÿ of the coordinates by finite differences.
    #[test]
    fn coordinates_change_as_their_jacobian_and_bias_say() {
        let (skill, mut state) = (skill::<6>(), ProductState::new());
        skill.update(&frames(), &mut state);
        let (linear, pull) = (DVec3::new(0.3, -0.2, 0.1), DVec3::new(0.5, 0.4, -0.6));
        let (angular, spin) = (DVec3::new(0.4, 0.7, -0.2), DVec3::new(-0.3, 0.2, 0.5));
        let start = turned([0.9, -0.2, 0.5]);
        // ω(t) = ω₀ + ω̇ t to second order in t.
        let at = |t: f64| Pose {
            position: DVec3::splat(0.2) + linear * t + pull * (0.5 * t * t),
            orientation: DQuat::from_scaled_axis(angular * t + spin * (0.5 * t * t)) * start,
        };
        let point = |t: f64| state.coordinates(&at(t), &Twist::ZERO).point;
        let now = state.coordinates(&at(0.0), &Twist { linear, angular });
        let h = 1e-4;
        let velocity = (point(h) - point(-h)) / (2.0 * h);
        let second = (point(h) - point(0.0) * 2.0 + point(-h)) / (h * h);
        let rate = now.jacobian * (tangent::<6>(pull, spin) - now.bias);
        assert!((now.velocity - velocity).norm() < 1e-7);
        assert!((rate - second).norm() < 1e-6);
    }

    #[test]
    fn the_goal_has_the_wanted_mean_inertia() {
        let (skill, mut state) = (skill::<6>(), ProductState::new());
        skill.update(&frames(), &mut state);
        let goal = state.field().unwrap().components().last().unwrap().precision;
        let mean = goal.fixed_view::<3, 3>(0, 0).trace() / 3.0 * SCALE;
        assert!((mean - skill.goal_inertia).abs() < 1e-12 * mean);
    }

    #[test]
    fn frames_that_are_missing_or_not_finite_give_what_no_one_resolves() {
        let (skill, mut state) = (skill::<3>(), ProductState::new());
        let pose = Pose::IDENTITY;
        let mut resolves = |frames: &[MovingPose]| {
            let value = skill.evaluate(&INERTIA, frames, &pose, &Twist::ZERO, &mut state);
            let goal = state.goal().position.is_finite();
            let mut natural = value.natural;
            for i in 3..6 {
                natural.metric[(i, i)] += 1.0;
            }
            assert_eq!(natural.resolve().is_ok(), goal);
            goal
        };
        let mut lost = frames();
        lost[1].pose.position.z = f64::NAN;
        assert!(resolves(&frames()));
        assert!(!resolves(&frames()[..1]));
        assert!(resolves(&frames()));
        assert!(!resolves(&lost));
        assert!(resolves(&frames()));
    }

    #[test]
    fn every_machine_gives_the_same_bits() {
        let skill = skill::<6>();
        let fields = [false, true].map(|portable| {
            let mut state = ProductState::new();
            for (own, frame) in state.frames.iter_mut().zip(frames()) {
                *own = frame.pose;
            }
            let update = Update { skill: &skill, state: &mut state };
            let goal = if portable { lanes::run_portable(update) } else { lanes::run(update) };
            let components: Vec<_> = state.field.components().collect();
            (goal, components, state.field.quads.map(|quad| quad.normaliser))
        });
        assert_eq!(fields[0], fields[1]);
        assert!(fields[0].0.is_some());
    }

    #[test]
    fn what_makes_no_skill_is_refused() {
        let good = skill::<3>().components;
        let error = |components: Vec<ProductComponent<3>>| {
            ProductSkill::new(components.into(), SCALE, THRESHOLD).unwrap_err()
        };
        assert_eq!(error(vec![]), ProductSkillError::ComponentCount(0));
        let many = vec![good[0].clone(); COMPONENT_CAPACITY + 1];
        assert_eq!(error(many), ProductSkillError::ComponentCount(COMPONENT_CAPACITY + 1));
        let with = |frames: usize| ProductComponent {
            gaussians: vec![good[0].gaussians[0]; frames].into(),
            ..good[0].clone()
        };
        for (components, component, frames) in [
            (vec![with(0)], 0, 0),
            (vec![with(FRAME_CAPACITY + 1)], 0, FRAME_CAPACITY + 1),
            (vec![with(2), with(3)], 1, 3),
        ] {
            let expected = ProductSkillError::FrameCount { component, frames };
            assert_eq!(error(components), expected);
        }
        let mut flat = with(2);
        flat.gaussians[1].precision.fill(0.0);
        let expected = ProductSkillError::Precision { component: 1, frame: 1 };
        assert_eq!(error(vec![with(2), flat]), expected);
    }
}
