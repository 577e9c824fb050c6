//! Product and policy: against the thesis as printed, against the dense formula, and what they keep.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use proptest::prelude::*;

use super::field::{Evaluation, Terms};
use super::policy::{Update, tangent};
use super::{
    GaussianField, PoseGaussian, ThesisComponent, ThesisPolicy, ThesisPolicyError, ThesisState,
};
use crate::lanes;
use crate::natural::Natural;
use crate::policy::canonical::field::{COMPONENT_CAPACITY, FieldValue};
use crate::policy::value::{FRAME_CAPACITY, SkillInertia, SkillValue};
use tprmp_spatial::rotation::rotation_vector;
use tprmp_spatial::strategies::vector;
use tprmp_spatial::{MovingPose, Pose, Twist};

const INERTIA: SkillInertia = SkillInertia { linear_kg: 2.0, angular_kg_m2: 0.0 };
/// One more than there are lanes.
pub(in crate::policy::thesis) const COMPONENTS: usize = 5;
const SCALE: f64 = 0.01;
pub(in crate::policy::thesis) const THRESHOLD: f64 = 1.5;

fn rotation(vector: [f64; 3]) -> DQuat {
    DQuat::from_scaled_axis(vector.into())
}

/// A path of Gaussians from the first frame's origin to the second one's, precise at the start in
/// the first frame and at the end in the second.
pub(in crate::policy::thesis) fn components<const D: usize>(
    count: usize,
) -> Vec<ThesisComponent<D>> {
    let gaussian = |fraction: f64, origin: DVec3, weight: f64| {
        let position = DVec3::new(0.4, -0.3, 0.2) * fraction + origin;
        let orientation = rotation([0.1, 0.2 - 0.6 * fraction, 0.5 * fraction]);
        let root = SMatrix::<f64, D, D>::from_fn(|i, j| {
            ((i * 7 + j * 3) as f64 + 5.0 * fraction).sin() + if i == j { 2.0 } else { 0.0 }
        });
        let precision = root * root.transpose() * (20.0 * weight);
        PoseGaussian { mean: Pose { position, orientation }, precision }
    };
    let component = |k: usize| {
        let fraction = k as f64 / (count - 1) as f64;
        ThesisComponent {
            gaussians: Box::new([
                gaussian(fraction, DVec3::ZERO, 1.2 - fraction),
                gaussian(fraction, DVec3::new(-0.4, 0.3, -0.2), 0.2 + fraction),
            ]),
            potential: 12.0 * (1.0 - fraction),
            damping: 15.0 + 10.0 * fraction,
        }
    };
    (0..count).map(component).collect()
}

pub(in crate::policy::thesis) fn policy_of<const D: usize>(
    components: Vec<ThesisComponent<D>>,
) -> ThesisPolicy<D> {
    ThesisPolicy::new(components.into(), SCALE, THRESHOLD).unwrap()
}

fn policy<const D: usize>() -> ThesisPolicy<D> {
    policy_of(components(COMPONENTS))
}

pub(in crate::policy::thesis) fn frames() -> [MovingPose; 2] {
    [([0.1, 0.2, 0.3], 0.4), ([0.55, -0.15, 0.45], -0.3)].map(|(position, yaw)| {
        let orientation = DQuat::from_rotation_z(yaw);
        MovingPose::at_rest(Pose { position: position.into(), orientation })
    })
}

pub(in crate::policy::thesis) fn state<const D: usize>(
    policy: &ThesisPolicy<D>,
    frames: &[MovingPose],
) -> ThesisState<D> {
    let mut state = ThesisState::default();
    policy.update(frames, &mut state);
    state
}

pub(in crate::policy::thesis) fn field() -> GaussianField<3> {
    state(&policy(), &frames()).field().unwrap().clone()
}

fn evaluate<const D: usize>(
    policy: &ThesisPolicy<D>,
    frames: &[MovingPose],
    (pose, velocity): &Motion,
) -> SkillValue {
    policy.evaluate(&INERTIA, frames, pose, velocity, &mut ThesisState::default())
}

/// The acceleration, zero where the policy has no inertia.
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

type Motion = (Pose, Twist);

fn pose(size: f64, angle: f64) -> impl Strategy<Value = Pose> {
    (vector(size), vector(angle))
        .prop_map(|(position, r)| Pose { position, orientation: DQuat::from_scaled_axis(r) })
}

fn motion() -> impl Strategy<Value = Motion> {
    (pose(0.4, 0.7), vector(0.5), vector(0.8)).prop_map(|(pose, linear, angular)| {
        let position = pose.position + DVec3::new(0.3, 0.0, 0.35);
        (Pose { position, ..pose }, Twist { linear, angular })
    })
}

/// A point of the field and a velocity.
pub(in crate::policy::thesis) fn point() -> impl Strategy<Value = (Vector3<f64>, Vector3<f64>)> {
    (vector(1.0), vector(1.0)).prop_map(|(y, v)| ((y + DVec3::splat(0.3)).into(), v.into()))
}

/// Orientations within about 0.9 rad of a common one.
fn gaussian<const D: usize>() -> impl Strategy<Value = PoseGaussian<D>> {
    let entries = prop::collection::vec(-1.0..1.0, D * D);
    (pose(1.0, 0.5), entries).prop_map(|(Pose { position, orientation }, entries)| {
        let orientation = DQuat::from_rotation_x(2.0) * orientation;
        let root = SMatrix::<f64, D, D>::from_row_slice(&entries);
        let precision = (root * root.transpose() + SMatrix::identity() * 0.3) * 40.0;
        PoseGaussian { mean: Pose { position, orientation }, precision }
    })
}

fn gaussians<const D: usize>() -> impl Strategy<Value = Vec<PoseGaussian<D>>> {
    prop::collection::vec(gaussian(), 1..5)
}

/// The product of Gaussians that are seen from these frames.
fn product_from<const D: usize>(factors: &[PoseGaussian<D>], frame: &Pose) -> PoseGaussian<D> {
    let component = ThesisComponent { gaussians: factors.into(), potential: 0.0, damping: 0.0 };
    let policy = ThesisPolicy::new(Box::new([component]), 1.0, 1.0).unwrap();
    let state = state(&policy, &vec![MovingPose::at_rest(*frame); factors.len()]);
    let (_, precision) = state.field().unwrap().components().next().unwrap();
    PoseGaussian { mean: state.goal(), precision }
}

fn product<const D: usize>(factors: &[PoseGaussian<D>]) -> PoseGaussian<D> {
    product_from(factors, &Pose::IDENTITY)
}

/// Distance of the means in the tangent space plus relative distance of the precisions.
fn distance<const D: usize>(a: &PoseGaussian<D>, b: &PoseGaussian<D>) -> f64 {
    let away = rotation_vector(a.mean.orientation.conjugate() * b.mean.orientation);
    tangent::<D>(b.mean.position - a.mean.position, away).norm()
        + (a.precision - b.precision).norm() / a.precision.norm()
}

/// Eq. 3.6 by covariances, Σ̂ = (Σ Σ_p⁻¹)⁻¹ and μ̂ = Σ̂ Σ Σ_p⁻¹ μ_p, where all orientations are one.
fn is_dense<const D: usize>(factors: &[PoseGaussian<D>]) -> bool {
    let (mut sum, mut weighted) = (SMatrix::<f64, D, D>::zeros(), SVector::<f64, D>::zeros());
    for factor in factors {
        let inverse = factor.precision.try_inverse().unwrap().try_inverse().unwrap();
        sum += inverse;
        weighted += inverse * tangent::<D>(factor.mean.position, DVec3::ZERO);
    }
    let covariance = sum.try_inverse().unwrap();
    let found = product(factors);
    let away = factors[0].mean.orientation.conjugate() * found.mean.orientation;
    let away = if D == 6 { rotation_vector(away) } else { DVec3::ZERO };
    (tangent::<D>(found.mean.position, away) - covariance * weighted).norm() < 1e-11
        && (found.precision.try_inverse().unwrap() - covariance).norm() < 1e-11
}

fn moves_with_a_frame<const D: usize>(factors: &[PoseGaussian<D>], frame: &Pose) -> bool {
    let moved = product_from(&[product(factors)], frame);
    distance(&product_from(factors, frame), &moved) < 1e-10
}

fn is_symmetric<const D: usize>(factors: &[PoseGaussian<D>]) -> bool {
    let mut other = factors.to_vec();
    other.rotate_left(1);
    distance(&product(factors), &product(&other)) < 1e-10
}

fn precisions_add<const D: usize>(factors: &[PoseGaussian<D>]) -> bool {
    let mean = factors[0].mean;
    let factors: Vec<_> = factors.iter().map(|f| PoseGaussian { mean, ..*f }).collect();
    let precision = factors.iter().map(|f| f.precision).sum();
    distance(&product(&factors), &PoseGaussian { mean, precision }) < 1e-12
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn products_are_the_dense_formula_on_vector_spaces_and_at_a_common_orientation(
        plane in gaussians::<2>(), space in gaussians::<3>(), poses in gaussians::<6>(),
    ) {
        // Cross blocks rotate the mean away from the common orientation unless positions coincide.
        let mut uncoupled = poses;
        let orientation = uncoupled[0].mean.orientation;
        for factor in &mut uncoupled {
            factor.mean.orientation = orientation;
            factor.precision.fixed_view_mut::<3, 3>(0, 3).fill(0.0);
            factor.precision.fixed_view_mut::<3, 3>(3, 0).fill(0.0);
        }
        prop_assert!(is_dense(&plane) && is_dense(&space) && is_dense(&uncoupled));
    }

    #[test]
    fn precisions_of_products_add_where_poses_coincide_and_order_does_not_matter(
        plane in gaussians::<2>(), space in gaussians::<3>(), poses in gaussians::<6>(),
    ) {
        prop_assert!(precisions_add(&plane) && precisions_add(&space) && precisions_add(&poses));
        prop_assert!(precisions_add(&[poses[0]; 2]));
        prop_assert!(is_symmetric(&space) && is_symmetric(&poses));
    }

    #[test]
    fn products_move_with_their_frame_and_frames_compose(
        (plane, space, poses) in (gaussians::<2>(), gaussians::<3>(), gaussians::<6>()),
        frame in pose(2.0, 1.8), other in pose(2.0, 1.8), yaw in -3.0..3.0, down in any::<bool>(),
    ) {
        let tip = rotation([if down { std::f64::consts::PI } else { 0.0 }, 0.0, 0.0]);
        let upright = Pose { orientation: DQuat::from_rotation_z(yaw) * tip, ..frame };
        prop_assert!(moves_with_a_frame(&plane, &upright));
        prop_assert!(moves_with_a_frame(&space, &frame) && moves_with_a_frame(&poses, &frame));
        let twice = product_from(&[product_from(&poses[..1], &other)], &frame);
        prop_assert!(distance(&twice, &product_from(&poses[..1], &frame.compose(&other))) < 1e-12);
    }

    /// The transported pulls cancel at the product's mean, whatever the path there.
    #[test]
    fn the_mean_of_a_product_is_where_the_transported_pulls_cancel(factors in gaussians::<6>()) {
        let found = product(&factors);
        let mut pull = SVector::<f64, 6>::zeros();
        for f in &factors {
            let away = rotation_vector(f.mean.orientation.conjugate() * found.mean.orientation);
            let mut transport = SMatrix::<f64, 6, 6>::identity();
            let half = DMat3::from_quat(DQuat::from_scaled_axis(away * -0.5));
            transport.fixed_view_mut::<3, 3>(3, 3).copy_from(&half.into());
            let at_factor = tangent::<6>(f.mean.position - found.mean.position, -away);
            pull += transport * f.precision * transport.transpose() * at_factor;
        }
        prop_assert!(pull.norm() < 1e-10 * found.precision.norm());
    }
}

/// Eq. 3.6 and 4.4 to 4.17 as they are printed, with δ in 4.13: force, metric and energy of the
/// policy that is not scaled.
fn as_printed(
    frames: &[MovingPose],
    x: Vector3<f64>,
    v: Vector3<f64>,
) -> (Vector3<f64>, Matrix3<f64>, f64) {
    let mut mixture = Vec::new();
    for component in components::<3>(COMPONENTS) {
        let (mut inverse, mut weighted) = (Matrix3::zeros(), Vector3::zeros());
        for (gaussian, frame) in component.gaussians.iter().zip(frames) {
            let a = Matrix3::from(DMat3::from_quat(frame.pose.orientation));
            let mean =
                a * Vector3::from(gaussian.mean.position) + Vector3::from(frame.pose.position);
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

/// Mean linear eigenvalue of γ Λ̂ at the goal.
fn goal_inertia<const D: usize>() -> f64 {
    let state = state(&policy::<D>(), &frames());
    let (_, goal) = state.field().unwrap().components().last().unwrap();
    goal.fixed_view::<3, 3>(0, 0).trace() / 3.0 * SCALE
}

/// Moving frames and tool turns the acceleration and moves the goal.
fn is_equivariant<const D: usize>(motion: &Motion, transform: &Pose) -> bool {
    let policy = policy::<D>();
    let turn = transform.orientation;
    let (pose, velocity) = *motion;
    let flat = |v: DVec3| if D < 3 { DVec3::new(v.x, v.y, 0.0) } else { v };
    let velocity = Twist { linear: flat(velocity.linear), ..velocity };
    let moved = frames().map(|f| MovingPose::at_rest(transform.compose(&f.pose)));
    let here = evaluate(&policy, &frames(), &(pose, velocity));
    let there = (
        transform.compose(&pose),
        Twist { linear: turn * velocity.linear, angular: turn * velocity.angular },
    );
    let there = evaluate(&policy, &moved, &there);
    let (a, b) = (acceleration::<D>(&here.natural), acceleration::<D>(&there.natural));
    let goal = transform.compose(&state(&policy, &frames()).goal());
    let image = state(&policy, &moved).goal();
    let error = (turn * a[0] - b[0]).length() + (turn * a[1] - b[1]).length();
    error < 1e-8 * (1.0 + a[0].length() + a[1].length())
        && (here.energy - there.energy).abs() < 1e-9 * (1.0 + here.energy)
        && (goal.position - image.position).length() < 1e-10
        && goal.rotation_from(&image).length() < 1e-10
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn in_space_it_is_the_thesis_as_printed_with_the_inertia_that_is_wanted(motion in motion()) {
        let (x, v) = (motion.0.position.into(), motion.1.linear.into());
        let (force, metric, energy) = as_printed(&frames(), x, v);
        let scale = INERTIA.linear_kg / goal_inertia::<3>();
        let found = evaluate(&policy::<3>(), &frames(), &motion);
        let force_found = found.natural.force.fixed_rows::<3>(0).into_owned();
        let metric_found = found.natural.metric.fixed_view::<3, 3>(0, 0).into_owned();
        let norm = 1.0 + (force * scale).norm();
        prop_assert!((force_found - force * scale).norm() < 1e-9 * norm);
        prop_assert!((metric_found - metric * scale).norm() < 1e-9 * norm);
        prop_assert!((found.energy - energy * scale).abs() < 1e-9 * norm);
    }

    #[test]
    fn it_moves_with_the_frames(
        motion in motion(), transform in pose(2.0, 1.8), yaw in -3.0..3.0,
    ) {
        let Pose { position, .. } = transform;
        let plane = Pose {
            position: DVec3::new(position.x, position.y, 0.0),
            orientation: DQuat::from_rotation_z(yaw),
        };
        prop_assert!(is_equivariant::<2>(&motion, &plane));
        prop_assert!(is_equivariant::<3>(&motion, &transform));
        prop_assert!(is_equivariant::<6>(&motion, &transform));
    }

    #[test]
    fn both_quaternions_of_an_orientation_are_the_same(
        motion in motion(), flips in any::<[bool; 3]>(), flips_of_means in any::<[bool; 2 * COMPONENTS]>(),
    ) {
        let flip = |pose: &mut Pose, flip: bool| if flip { pose.orientation = -pose.orientation };
        let (mut frames, mut other, mut components) = (frames(), motion, components::<6>(COMPONENTS));
        frames.iter_mut().zip(flips).for_each(|(frame, sign)| flip(&mut frame.pose, sign));
        flip(&mut other.0, flips[2]);
        let means = components.iter_mut().flat_map(|c| &mut c.gaussians).map(|g| &mut g.mean);
        means.zip(flips_of_means).for_each(|(mean, sign)| flip(mean, sign));
        let flipped = policy_of(components);
        let a = evaluate(&policy::<6>(), &self::frames(), &motion).natural;
        let b = evaluate(&flipped, &frames, &other).natural;
        prop_assert!((a.force - b.force).norm() < 1e-10 * (1.0 + a.force.norm()));
        prop_assert!((a.metric - b.metric).norm() < 1e-10 * a.metric.norm());
    }

    /// The state of other frames, then of these, gives what a fresh one gives: bit for bit.
    #[test]
    fn a_state_that_was_used_gives_what_a_fresh_one_gives(motion in motion()) {
        let policy = policy::<6>();
        let mut moved = frames();
        moved[1].pose.position.x += 0.1;
        let (pose, velocity) = motion;
        let mut state = ThesisState::default();
        for frames in [frames(), frames(), moved, moved, frames()] {
            let used = policy.evaluate(&INERTIA, &frames, &pose, &velocity, &mut state);
            let fresh = evaluate(&policy, &frames, &motion);
            prop_assert!(used.natural == fresh.natural && used.energy == fresh.energy);
        }
    }

    #[test]
    fn every_machine_gives_the_same_bits((pose, Twist { linear, angular }) in motion()) {
        let policy = policy::<6>();
        let (y, velocity) = (tangent(pose.position, linear), tangent(linear, angular));
        let [here, anywhere] = [false, true].map(|portable| {
            let mut state = state(&policy, &frames());
            let update = Update { policy: &policy, state: &mut state };
            let goal = if portable { lanes::run_portable(update) } else { lanes::run(update) };
            let field = state.field().unwrap();
            let evaluation = Evaluation { field, y: &y, velocity: &velocity };
            let terms = Terms { field, y: &y };
            let (value, terms) = if portable {
                (lanes::run_portable(evaluation), lanes::run_portable(terms))
            } else {
                (lanes::run(evaluation), lanes::run(terms))
            };
            let FieldValue { potential, gradient, metric, curvature, damping } = value;
            let values = (potential, gradient, metric, curvature, damping);
            (goal, field.components().collect::<Vec<_>>(), values, terms)
        });
        prop_assert!(here.0.is_some() && here == anywhere);
    }
}

/// Integrates the resolved acceleration of the pose with the midpoint rule, the error of which is far
/// below what the damping takes in a step: V never rises.
fn energy_never_rises<const D: usize>() {
    // With so many the only place of rest is the goal's.
    let policy = policy_of::<D>(components(4));
    let (mut state, dt) = (ThesisState::default(), 2e-4);
    let position = DVec3::new(0.05, 0.35, 0.2);
    let mut pose = Pose { position, orientation: rotation([0.8, -0.4, 0.9]) };
    let mut linear = DVec3::new(0.2, 0.1, -0.1);
    let mut angular = if D < 6 { DVec3::ZERO } else { DVec3::new(0.3, -0.4, 0.5) };
    let moved = |pose: &Pose, linear: DVec3, angular: DVec3, h: f64| Pose {
        position: pose.position + linear * h,
        orientation: (DQuat::from_scaled_axis(angular * h) * pose.orientation).normalize(),
    };
    let (mut first, mut last) = (None, f64::INFINITY);
    for _ in 0..40_000 {
        let mut at = |pose: &Pose, linear, angular| {
            policy.evaluate(&INERTIA, &frames(), pose, &Twist { linear, angular }, &mut state)
        };
        let value = at(&pose, linear, angular);
        assert!(value.energy - last <= 1e-9 * value.energy.abs(), "{} after {last}", value.energy);
        last = value.energy;
        first.get_or_insert(last);
        let [a, alpha] = acceleration::<D>(&value.natural);
        let (v, w) = (linear + a * (dt / 2.0), angular + alpha * (dt / 2.0));
        let middle = moved(&pose, (linear + v) * 0.5, (angular + w) * 0.5, dt / 2.0);
        let [a, alpha] = acceleration::<D>(&at(&middle, v, w).natural);
        pose = moved(&pose, linear + a * (dt / 2.0), angular + alpha * (dt / 2.0), dt);
        linear += a * dt;
        angular += alpha * dt;
    }
    let (fell, away) = (last / first.unwrap(), pose.position - state.goal().position);
    assert!(fell < 0.5 && away.truncate().length() < 0.1, "{fell} of it left, {away} m away");
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

#[test]
fn frames_that_are_missing_or_not_finite_give_what_no_one_resolves() {
    let (policy, mut state) = (policy::<3>(), ThesisState::default());
    let mut resolves = |frames: &[MovingPose]| {
        let pose = Pose::IDENTITY;
        let mut natural =
            policy.evaluate(&INERTIA, frames, &pose, &Twist::ZERO, &mut state).natural;
        for i in 3..6 {
            natural.metric[(i, i)] += 1.0;
        }
        let defined = state.goal().position.is_finite();
        assert!(natural.resolve().is_ok() == defined && state.field().is_some() == defined);
        defined
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
fn what_makes_no_policy_is_refused() {
    let good = components::<3>(COMPONENTS)[0].clone();
    let error = |components: &[ThesisComponent<3>]| {
        ThesisPolicy::new(components.into(), SCALE, THRESHOLD).unwrap_err()
    };
    assert_eq!(error(&[]), ThesisPolicyError::ComponentCount(0));
    let count = COMPONENT_CAPACITY + 1;
    assert_eq!(error(&vec![good.clone(); count]), ThesisPolicyError::ComponentCount(count));
    let with = |frames: usize| ThesisComponent {
        gaussians: vec![good.gaussians[0]; frames].into(),
        ..good.clone()
    };
    let count = FRAME_CAPACITY + 1;
    let expected = |component, frames| ThesisPolicyError::FrameCount { component, frames };
    assert_eq!(error(&[with(0)]), expected(0, 0));
    assert_eq!(error(&[with(count)]), expected(0, count));
    assert_eq!(error(&[with(2), with(3)]), expected(1, 3));
    for (scale, position) in
        [(-1.0, 0.0), (0.0, 0.0), (f64::NAN, 0.0), (f64::INFINITY, 0.0), (1.0, f64::NAN)]
    {
        let mut bad = with(2);
        bad.gaussians[1].precision *= scale;
        bad.gaussians[1].mean.position.y = position;
        let expected = ThesisPolicyError::Precision { component: 1, frame: 1 };
        assert_eq!(error(&[with(2), bad]), expected);
    }
    assert!(PoseGaussian::<3>::from_covariance(Pose::IDENTITY, &SMatrix::zeros()).is_none());
}
