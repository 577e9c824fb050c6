//! Poses, twists and wrenches against nalgebra's isometries and matrices; motions against finite
//! differences.

use glam::{DQuat, DVec3};
use nalgebra::{Isometry3, Matrix6, Point3, Vector3, Vector6};
use proptest::prelude::*;
#[path = "../src/strategies.rs"]
#[expect(unreachable_pub, reason = "public in the crate, with its feature")]
mod strategies;

use strategies::vector;
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist, Wrench};

fn pose() -> impl Strategy<Value = Pose> {
    (vector(2.0), vector(1.7)).prop_map(|(position, rotation)| Pose {
        position,
        orientation: DQuat::from_scaled_axis(rotation),
    })
}

fn twist() -> impl Strategy<Value = Twist> {
    (vector(1.0), vector(1.0)).prop_map(|(linear, angular)| Twist { linear, angular })
}

fn wrench() -> impl Strategy<Value = Wrench> {
    (vector(1.0), vector(1.0)).prop_map(|(force, torque)| Wrench { force, torque })
}

fn is_close(ours: &Pose, theirs: &Isometry3<f64>, tolerance: f64) -> bool {
    let theirs = Pose::from(*theirs);
    (ours.position - theirs.position).length() < tolerance
        && ours.rotation_from(&theirs).length() < tolerance
}

/// Ad(X) on \[linear; angular\]: \[R, \[p\]ₓ R; 0, R\].
fn adjoint(x: &Pose) -> Matrix6<f64> {
    let isometry = Isometry3::from(*x);
    let rotation = isometry.rotation.to_rotation_matrix().into_inner();
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    let cross = isometry.translation.vector.cross_matrix() * rotation;
    matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
    matrix
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn compositions_inverses_and_points_are_those_of_isometries(
        a in pose(), b in pose(), point in vector(3.0),
    ) {
        let (ia, ib) = (Isometry3::from(a), Isometry3::from(b));
        prop_assert!(is_close(&a.compose(&b), &(ia * ib), 1e-13));
        prop_assert!(is_close(&a.inverse(), &ia.inverse(), 1e-13));
        prop_assert!(is_close(&a.inverse().compose(&a), &Isometry3::identity(), 1e-13));
        let theirs: DVec3 = (ia * Point3::from(Vector3::from(point))).coords.into();
        prop_assert!((a.transform_point(point) - theirs).length() < 1e-13);
        prop_assert_eq!(Pose::from(ia), a);
    }

    #[test]
    fn interpolation_is_that_of_isometries(a in pose(), b in pose(), fraction in 0.0..1.0) {
        let (ia, ib) = (Isometry3::from(a), Isometry3::from(b));
        // At an angle of π there are two shortest paths.
        prop_assume!(b.rotation_from(&a).length() < 3.1);
        prop_assert!(is_close(&a.interpolate(&b, fraction), &ia.lerp_slerp(&ib, fraction), 1e-11));
        prop_assert!(is_close(&a.interpolate(&b, 0.0), &ia, 1e-13));
        prop_assert!(is_close(&a.interpolate(&b, 1.0), &ib, 1e-12));
    }

    #[test]
    fn adjoints_are_those_of_matrices_and_compose_like_their_poses(
        a in pose(), b in pose(), v in twist(),
    ) {
        let ours = Vector6::from(v.adjoint(&a));
        prop_assert!((ours - adjoint(&a) * Vector6::from(v)).norm() < 1e-13);
        let twice = v.adjoint(&b).adjoint(&a) - v.adjoint(&a.compose(&b));
        prop_assert!(Vector6::from(twice).norm() < 1e-13);
        let back = v.adjoint(&a).adjoint(&a.inverse()) - v;
        prop_assert!(Vector6::from(back).norm() < 1e-13);
        prop_assert_eq!(Twist::from(Vector6::from(v)), v);
    }

    #[test]
    fn a_shift_is_the_adjoint_of_a_translation_and_power_does_not_depend_on_it(
        v in twist(), f in wrench(), r in vector(2.0),
    ) {
        let translation = Pose { position: -r, ..Pose::IDENTITY };
        let shifted = Vector6::from(v.shifted(r) - v.adjoint(&translation));
        prop_assert!(shifted.norm() < 1e-15);
        prop_assert!((v.shifted(r).power(&f.shifted(r)) - v.power(&f)).abs() < 1e-13);
        prop_assert!((v.power(&f) - Vector6::from(v).dot(&Vector6::from(f))).abs() < 1e-14);
    }

    /// A frame with constant acceleration of its origin and constant angular velocity, and one that is
    /// fixed to it.
    #[test]
    fn a_frame_fixed_to_a_moving_one_moves_as_finite_differences_say(
        start in pose(), velocity in twist(), acceleration in vector(1.0), fixed in pose(),
    ) {
        let acceleration = SpatialAcceleration { linear: acceleration, angular: DVec3::ZERO };
        let at = |t: f64| {
            let linear = velocity.linear + acceleration.linear * (0.5 * t);
            start.advanced(&Twist { linear, ..velocity }, t).compose(&fixed)
        };
        let h = 1e-4;
        let (before, now, after) = (at(-h), at(0.0), at(h));
        let moving = MovingPose { pose: start, velocity, acceleration }.compose(&fixed);
        prop_assert!(is_close(&moving.pose, &now.into(), 1e-13));
        let linear = (after.position - before.position) / (2.0 * h);
        prop_assert!((moving.velocity.linear - linear).length() < 1e-6);
        let angular = after.rotation_from(&before) / (2.0 * h);
        prop_assert!((moving.velocity.angular - angular).length() < 1e-6);
        let second = (after.position - 2.0 * now.position + before.position) / (h * h);
        prop_assert!((moving.acceleration.linear - second).length() < 1e-5);
        // The same by the shift of an acceleration.
        let r = now.position - start.position;
        let shifted = acceleration.shifted(velocity.angular, r).linear;
        prop_assert!((shifted - moving.acceleration.linear).length() < 1e-13);
    }

    #[test]
    fn velocities_advance_by_their_acceleration(v in twist(), a in twist(), dt in 0.0..0.1) {
        let acceleration = SpatialAcceleration::from(Vector6::from(a));
        prop_assert_eq!(v.advanced(&acceleration, dt), v + a * dt);
    }
}
