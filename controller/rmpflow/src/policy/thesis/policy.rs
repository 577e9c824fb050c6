//! The policy: the products of the frames' Gaussians, and their field in one chart  [thesis eq. 4.4].
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

use core::array::from_fn;

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, Matrix6, SVector, Vector3, Vector6};

use crate::lanes::{self, Kernel, LANES, Lanes, Quad, splat_all, store_all, store_rows};
use crate::natural::Natural;
use crate::policy::canonical::field::COMPONENT_CAPACITY;
use crate::policy::thesis::field::{GaussianField, Group};
use crate::policy::thesis::product::{PoseGaussian, PoseGroup, Product, congruence, strongest};
use crate::policy::thesis::rotation::Rotation;
use crate::policy::value::{FRAME_CAPACITY, SkillInertia, SkillValue};
use tprmp_spatial::rotation::{Chart, orientation_chart};
use tprmp_spatial::{MovingPose, Pose, Twist};

/// One component, as the frames see it.
#[derive(Debug, Clone, PartialEq)]
pub struct ThesisComponent<const D: usize> {
    /// N(μ_kp, Σ_kp) in the coordinates of each frame p, in the order of the policy's frames.
    pub gaussians: Box<[PoseGaussian<D>]>,
    /// φ⁰_k, the bias potential.
    pub potential: f64,
    /// d_k ≥ 0 \[s/m² or s/rad²\].
    pub damping: f64,
}

/// Why a policy could not be built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ThesisPolicyError {
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
    /// A precision is not positive definite, or a Gaussian not finite.
    Precision {
        /// The component.
        component: usize,
        /// The frame.
        frame: usize,
    },
}

/// A policy on R² (D = 2), R³ (D = 3) or R³ × S³ (D = 6): immutable. Its last component is the
/// goal's.
#[derive(Debug, Clone)]
pub struct ThesisPolicy<const D: usize> {
    components: Box<[ThesisComponent<D>]>,
    /// The same, as they are evaluated.
    groups: Box<[ComponentGroup<D>]>,
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
struct ComponentGroup<const D: usize> {
    /// What each frame sees.
    factors: Box<[PoseGroup<D>]>,
    /// For each lane, the frame that sees the Gaussian of the largest det Λ_p; no pose of the
    /// frames changes that.
    strongest: [usize; LANES],
    /// 1, or 0 in the lanes beyond the last component, which repeat that.
    presence: Quad,
    potential: Quad,
    damping: Quad,
}

/// What a policy needs between calls: the field of the frames as they were. It belongs to one policy.
#[derive(Debug, Clone)]
pub struct ThesisState<const D: usize> {
    /// The frames of the field; not finite where there is none, so that they equal no others.
    frames: [Pose; FRAME_CAPACITY],
    /// Not finite when there is no field.
    goal: Pose,
    field: GaussianField<D>,
    /// Where the factors of a product are put together.
    factors: [PoseGroup<D>; FRAME_CAPACITY],
}

impl<const D: usize> Default for ThesisState<D> {
    /// A state without a field.
    fn default() -> Self {
        Self {
            frames: [Pose::UNDEFINED; FRAME_CAPACITY],
            goal: Pose::UNDEFINED,
            field: GaussianField::NONE,
            factors: [PoseGroup::NONE; FRAME_CAPACITY],
        }
    }
}

impl<const D: usize> ThesisState<D> {
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
        self.goal.position.is_finite().then_some(&self.field)
    }

    /// A pose in the coordinates y = \[x; r\] of the field \[m, rad\].
    #[must_use]
    pub fn point(&self, pose: &Pose) -> SVector<f64, D> {
        tangent(pose.position, self.chart(pose, DVec3::ZERO).rotation)
    }

    /// The orientation in the chart of the goal's; zero for D < 6.
    fn chart(&self, pose: &Pose, angular: DVec3) -> Chart {
        if D == 6 {
            return orientation_chart(self.goal.orientation, pose.orientation, angular);
        }
        let zero = DVec3::ZERO;
        Chart { rotation: zero, velocity: zero, jacobian: DMat3::ZERO, bias: zero }
    }
}

/// \[position; rotation vector\], cut to the first D rows.
pub(super) fn tangent<const D: usize>(position: DVec3, rotation: DVec3) -> SVector<f64, D> {
    const { assert!(D == 2 || D == 3 || D == 6, "R², R³ or R³ × S³") };
    SVector::from_fn(|i, _| if i < 3 { position[i] } else { rotation[i - 3] })
}

impl<const D: usize> ThesisPolicy<D> {
    /// A policy of these components, the last of which is the goal's.
    ///
    /// * `metric_scale`  γ > 0 \[s²\]
    /// * `huber_threshold`  δ > 0
    ///
    /// # Errors
    /// When the number of components or frames does not fit, or a precision is not positive
    /// definite.
    pub fn new(
        components: Box<[ThesisComponent<D>]>,
        metric_scale: f64,
        huber_threshold: f64,
    ) -> Result<Self, ThesisPolicyError> {
        let count = components.len();
        let Some(goal) = components.last().filter(|_| count <= COMPONENT_CAPACITY) else {
            return Err(ThesisPolicyError::ComponentCount(count));
        };
        let frame_count = components[0].gaussians.len();
        for (component, ThesisComponent { gaussians, .. }) in components.iter().enumerate() {
            let frames = gaussians.len();
            if frames == 0 || frames > FRAME_CAPACITY || frames != frame_count {
                return Err(ThesisPolicyError::FrameCount { component, frames });
            }
            if let Some(frame) = gaussians.iter().position(|g| strongest(&[*g]).is_none()) {
                return Err(ThesisPolicyError::Precision { component, frame });
            }
        }
        // The trace of a sum of rotated blocks is the sum of the blocks' traces.
        let linear = D.min(3);
        let trace: f64 =
            goal.gaussians.iter().flat_map(|g| (0..linear).map(|i| g.precision[(i, i)])).sum();
        Ok(Self {
            frame_count,
            metric_scale,
            huber_threshold,
            goal_inertia: metric_scale * trace / linear as f64,
            groups: boxed(components.chunks(LANES).map(ComponentGroup::new)),
            components,
        })
    }

    /// Its components, the last of which is the goal's.
    #[must_use]
    pub fn components(&self) -> &[ThesisComponent<D>] {
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

    /// The mean of the component at a fraction of their order, for these frames, in the world; `None` where there
    /// is no field. No allocation.
    #[must_use]
    pub fn on_path(
        &self,
        frames: &[MovingPose],
        fraction: f64,
        state: &mut ThesisState<D>,
    ) -> Option<Pose> {
        self.update(frames, state);
        let last = self.components.len() - 1;
        let index = (fraction * last as f64).round() as usize;
        let (mean, _) = state.field()?.components().nth(index.min(last))?;
        let goal = state.goal();
        let vector = |first: usize| {
            DVec3::from_array(from_fn(|i| mean.get(first + i).copied().unwrap_or(0.0)))
        };
        let height = if D > 2 { vector(0).z } else { goal.position.z };
        let orientation = match D {
            6 => goal.orientation * glam::DQuat::from_scaled_axis(vector(3)),
            _ => goal.orientation,
        };
        Some(Pose { position: vector(0).with_z(height), orientation })
    }

    /// How many frames it is seen from.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.frame_count
    }

    /// Brings the state up to the frames: nothing to do when they are where they were, bit for bit.
    ///
    /// * `frames`  in the order of the policy's frames; of those beyond them nothing is read
    ///
    /// Hot path: no allocation; when a frame has moved, O(K P D³) and the iterations of the product
    /// for each component.
    pub fn update(&self, frames: &[MovingPose], state: &mut ThesisState<D>) {
        let Some(frames) = frames.get(..self.frame_count) else {
            state.frames = [Pose::UNDEFINED; FRAME_CAPACITY];
            state.goal = Pose::UNDEFINED;
            return;
        };
        if frames.iter().zip(&state.frames).all(|(now, then)| now.pose == *then) {
            return;
        }
        for (then, now) in state.frames.iter_mut().zip(frames) {
            *then = now.pose;
        }
        state.goal = lanes::run(Update { policy: self, state }).unwrap_or(Pose::UNDEFINED);
    }

    /// Evaluates the policy for a moving pose  [thesis algorithm 4.1].
    ///
    /// * `inertia`  force and metric are scaled so that the mean linear eigenvalue of the goal
    ///   component's γ Λ̂ is `linear_kg`; the ratio of angular to linear inertia is learned, and
    ///   `angular_kg_m2` does not enter
    /// * `frames`  in the order of the policy's frames; their velocities do not enter
    /// * `velocity`  of the pose, in the world
    /// * `state`  of the last call, brought up to these frames
    ///
    /// For D = 2 there is no force and no inertia in height and rotation, for D = 3 none in
    /// rotation.
    ///
    /// Hot path: no allocation. Input that is not finite, or fewer frames than the policy has, gives
    /// output that is not finite.
    #[must_use]
    pub fn evaluate(
        &self,
        inertia: &SkillInertia,
        frames: &[MovingPose],
        pose: &Pose,
        velocity: &Twist,
        state: &mut ThesisState<D>,
    ) -> SkillValue {
        self.update(frames, state);
        let Some(field) = state.field() else { return SkillValue::undefined() };
        let scale = inertia.linear_kg / self.goal_inertia;
        let chart = state.chart(pose, velocity.angular);
        let velocity = tangent(velocity.linear, chart.velocity);
        let value = field.evaluate(&tangent(pose.position, chart.rotation), &velocity);
        let (force, metric) = (value.force(&velocity) * scale, value.metric * scale);
        let leaf = Natural {
            force: Vector6::from_fn(|i, _| force.get(i).copied().unwrap_or(0.0)),
            metric: Matrix6::from_fn(|i, j| metric.get((i, j)).copied().unwrap_or(0.0)),
        };
        SkillValue {
            natural: pull_back(&leaf, &chart),
            energy: value.energy(&velocity) * scale,
            ..SkillValue::zero()
        }
    }
}

/// The leaf of the chart on \[linear; angular\] of the pose: as [`Natural::add_pullback`] with
/// J = diag(I, J_r) of the chart, without the zeros  [thesis eq. 3.2].
fn pull_back(leaf: &Natural<6>, chart: &Chart) -> Natural<6> {
    let jacobian = Matrix3::from(chart.jacobian);
    let back = jacobian.transpose();
    let drift = jacobian * Vector3::from(chart.bias);
    let block = |row: usize, column: usize| leaf.metric.fixed_view::<3, 3>(row, column);
    let (mixed, angular) = (block(0, 3), block(3, 3));
    let cross = mixed * jacobian;
    let mut natural = *leaf;
    let mut force = natural.force.fixed_rows_mut::<3>(0);
    force += mixed * drift;
    let torque = back * (leaf.force.fixed_rows::<3>(3) + angular * drift);
    natural.force.fixed_rows_mut::<3>(3).copy_from(&torque);
    natural.metric.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
    natural.metric.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
    natural.metric.fixed_view_mut::<3, 3>(3, 3).copy_from(&(back * angular * jacobian));
    natural
}

/// All of them, on the heap.
#[expect(clippy::disallowed_methods, reason = "at start-up, where a policy is built")]
fn boxed<T>(items: impl Iterator<Item = T>) -> Box<[T]> {
    items.collect()
}

impl<const D: usize> ComponentGroup<D> {
    /// Of one to four components, seen from as many frames.
    fn new(components: &[ThesisComponent<D>]) -> Self {
        let lanes: [_; LANES] = from_fn(|lane| &components[lane.min(components.len() - 1)]);
        let factor = |p| PoseGroup::new(lanes.map(|component| &component.gaussians[p]));
        Self {
            factors: boxed((0..lanes[0].gaussians.len()).map(factor)),
            strongest: lanes.map(|component| strongest(&component.gaussians).unwrap_or(0)),
            presence: from_fn(|lane| f64::from(u8::from(lane < components.len()))),
            potential: lanes.map(|component| component.potential),
            damping: lanes.map(|component| component.damping),
        }
    }
}

/// The field of the frames of a state, and the mean of its goal; `None` when they are not finite.
pub(super) struct Update<'a, const D: usize> {
    pub(super) policy: &'a ThesisPolicy<D>,
    pub(super) state: &'a mut ThesisState<D>,
}

impl<const D: usize> Kernel for Update<'_, D> {
    type Output = Option<Pose>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<Pose> {
        let Self { policy, state } = self;
        let frames = state.frames;
        let field = &mut state.field;
        field.count = policy.components.len();
        field.metric_scale = policy.metric_scale;
        field.huber_threshold = policy.huber_threshold;
        let factors = state.factors.get_mut(..policy.frame_count)?;
        // The last group is the first to be evaluated: the goal is the centre of the chart.
        let mut goal = None;
        for (group, result) in policy.groups.iter().zip(&mut field.groups).rev() {
            for ((factor, frame), moved) in group.factors.iter().zip(&frames).zip(&mut *factors) {
                *moved = factor.transformed::<L>(frame);
            }
            let mut product = Product::<L, D>::new(factors, &group.strongest)?;
            product.determinant = product.determinant * L::load(&group.presence);
            let last = (field.count - 1) % LANES;
            let center = goal.get_or_insert_with(|| product.mean(last)).orientation;
            chart(&product, center, result);
            result.potential = group.potential;
            result.damping = group.damping;
        }
        goal
    }
}

/// Products in the chart y = \[x; r\] with q = c exp(r): mean, precision Tᵀ Λ T with T = diag(I, J_r(r)),
/// and normaliser.
///
/// * `center`  c, unit
#[inline(always)]
fn chart<L: Lanes, const D: usize>(product: &Product<L, D>, center: DQuat, result: &mut Group<D>) {
    let mut normaliser = product.determinant.sqrt();
    let mut precision = product.precision;
    let mut mean = [L::zero(); D];
    mean[..D.min(3)].copy_from_slice(&product.position[..D.min(3)]);
    if D == 6 {
        let away = Rotation::between(&splat_all(&center.to_array()), &product.orientation);
        mean[3..].copy_from_slice(&away.vector);
        let (jacobian, determinant) = away.left_jacobian();
        precision = congruence(&precision, &jacobian, 3);
        normaliser = normaliser * determinant;
    }
    result.mean = store_all(&mean);
    result.precision = store_rows(&precision);
    result.normaliser = normaliser.store();
}
