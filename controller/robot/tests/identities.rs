//! Identities between the algorithms, and derivatives against finite differences.

use crate::common::{GRAVITY, point2d, skew, states, ur5};
use glam::{DMat3, DVec3};
use nalgebra::SVector;
use tprmp_robot::{
    Chain, DynamicsError, Kinematics, forward_dynamics, forward_kinematics,
    forward_kinematics_with_velocity, gravity_torques, inverse_dynamics, mass_matrix, point_motion,
    point_position,
};
use tprmp_spatial::{SpatialAcceleration, Twist};

/// Step of the central differences [s]: their error is about step² times a third derivative.
const STEP_S: f64 = 1e-5;
/// Largest accepted deviation of a central difference, relative to 1 + the largest entry.
const DIFFERENCE_MAX: f64 = 1e-6;
/// Largest accepted deviation of an identity, relative to 1 + the largest entry.
const DEVIATION_MAX: f64 = 1e-10;
/// A point that is not on the axis [m], in the joint frame.
const POINT: DVec3 = DVec3::new(0.07, -0.04, 0.11);

/// Runs `check` for each robot of the tests.
macro_rules! for_each_robot {
    ($check:ident) => {
        $check(&ur5(), 11);
        $check(&point2d(), 12);
        $check(&skew(), 13);
    };
}

fn close<const R: usize>(what: &str, a: SVector<f64, R>, b: SVector<f64, R>, deviation_max: f64) {
    let deviation = (a - b).amax() / (1.0 + b.amax());
    assert!(deviation < deviation_max, "{what}: deviation {deviation}\n{a}{b}");
}

#[test]
fn mass_matrix_is_symmetric_positive_definite() {
    fn check<const N: usize>(chain: &Chain<N>, seed: u64) {
        for [q, q_d, _] in states::<N>(seed) {
            let m = mass_matrix(chain, &q);
            assert_eq!(m, m.transpose());
            assert!(m.cholesky().is_some());
            assert!((q_d.transpose() * m * q_d)[0] > 0.0);
        }
    }
    for_each_robot!(check);
}

#[test]
fn inverse_dynamics_is_mass_times_acceleration_plus_bias() {
    fn check<const N: usize>(chain: &Chain<N>, seed: u64) {
        for [q, q_d, q_dd] in states::<N>(seed) {
            let torques = inverse_dynamics(chain, &q, &q_d, &q_dd, GRAVITY);
            let bias = inverse_dynamics(chain, &q, &q_d, &SVector::zeros(), GRAVITY);
            let sum = mass_matrix(chain, &q) * q_dd + bias;
            close("M q̈ + h", torques, sum, DEVIATION_MAX);
        }
    }
    for_each_robot!(check);
}

#[test]
fn gravity_torques_are_those_at_rest() {
    fn check<const N: usize>(chain: &Chain<N>, seed: u64) {
        // A base that is mounted askew: gravity along no axis.
        let gravity = DVec3::new(3.0, -4.0, -8.0);
        let zero = SVector::zeros();
        for [q, _, _] in states::<N>(seed) {
            let at_rest = inverse_dynamics(chain, &q, &zero, &zero, gravity);
            close("gravity", gravity_torques(chain, &q, gravity), at_rest, DEVIATION_MAX);
        }
    }
    for_each_robot!(check);
}

#[test]
fn forward_dynamics_inverts_inverse_dynamics() {
    fn check<const N: usize>(chain: &Chain<N>, seed: u64) {
        for [q, q_d, q_dd] in states::<N>(seed) {
            let torques = inverse_dynamics(chain, &q, &q_d, &q_dd, GRAVITY);
            let back = forward_dynamics(chain, &q, &q_d, &torques, GRAVITY).unwrap();
            close("q̈", back, q_dd, DEVIATION_MAX);
        }
    }
    for_each_robot!(check);
}

#[test]
fn power_of_the_torques_is_the_change_of_energy() {
    fn check<const N: usize>(chain: &Chain<N>, seed: u64) {
        let kinetic = |q: &SVector<f64, N>, q_d: &SVector<f64, N>| {
            (q_d.transpose() * mass_matrix(chain, q) * q_d)[0] / 2.0
        };
        for [q, q_d, q_dd] in states::<N>(seed) {
            // Without gravity all power becomes kinetic energy: ties q̇ terms to dM/dt.
            let torques = inverse_dynamics(chain, &q, &q_d, &q_dd, DVec3::ZERO);
            let after = kinetic(&along(&q, &q_d, &q_dd, STEP_S), &(q_d + q_dd * STEP_S));
            let before = kinetic(&along(&q, &q_d, &q_dd, -STEP_S), &(q_d - q_dd * STEP_S));
            let rate = SVector::<f64, 1>::new((after - before) / (2.0 * STEP_S));
            close("power", SVector::<f64, 1>::new(q_d.dot(&torques)), rate, DIFFERENCE_MAX);
        }
    }
    for_each_robot!(check);
}

/// Position after `t` seconds of constant acceleration.
fn along<const N: usize>(
    q: &SVector<f64, N>,
    q_d: &SVector<f64, N>,
    q_dd: &SVector<f64, N>,
    t: f64,
) -> SVector<f64, N> {
    q + q_d * t + q_dd * (t * t / 2.0)
}

/// R_BE.
fn rotation<const N: usize>(kinematics: &Kinematics<N>) -> DMat3 {
    DMat3::from_quat(kinematics.tool_pose().orientation)
}

#[test]
fn twist_and_its_derivative() {
    fn check<const N: usize>(chain: &Chain<N>, seed: u64) {
        let mut here = Kinematics::new();
        let mut after = Kinematics::new();
        let mut before = Kinematics::new();
        for [q, q_d, _] in states::<N>(seed) {
            forward_kinematics_with_velocity(chain, &q, &q_d, &mut here);
            forward_kinematics_with_velocity(chain, &(q + q_d * STEP_S), &q_d, &mut after);
            forward_kinematics_with_velocity(chain, &(q - q_d * STEP_S), &q_d, &mut before);
            close("J q̇", here.tool_jacobian * q_d, here.tool_velocity.into(), DEVIATION_MAX);
            // With constant q̇ the twist changes by J̇q̇ alone.
            let change = (after.tool_velocity - before.tool_velocity) * (0.5 / STEP_S);
            close("J̇q̇", here.tool_drift.into(), change.into(), DIFFERENCE_MAX);
            let jacobian_change = (after.tool_jacobian - before.tool_jacobian) / (2.0 * STEP_S);
            close("dJ/dt q̇", here.tool_drift.into(), jacobian_change * q_d, DIFFERENCE_MAX);

            let linear = (after.tool_position() - before.tool_position()) / (2.0 * STEP_S);
            // Ṙ Rᵀ = [ω]×
            let rate = (rotation(&after) - rotation(&before))
                * (0.5 / STEP_S)
                * rotation(&here).transpose();
            let angular = DVec3::new(rate.y_axis.z, rate.z_axis.x, rate.x_axis.y);
            let moved = Twist { linear, angular };
            close("twist", here.tool_velocity.into(), moved.into(), DIFFERENCE_MAX);
        }
    }
    for_each_robot!(check);
}

#[test]
fn points_of_each_link() {
    fn check<const N: usize>(chain: &Chain<N>, seed: u64) {
        let mut here = Kinematics::new();
        let mut after = Kinematics::new();
        let mut before = Kinematics::new();
        for [q, q_d, _] in states::<N>(seed) {
            forward_kinematics_with_velocity(chain, &q, &q_d, &mut here);
            forward_kinematics_with_velocity(chain, &(q + q_d * STEP_S), &q_d, &mut after);
            forward_kinematics_with_velocity(chain, &(q - q_d * STEP_S), &q_d, &mut before);
            for joint in 0..N {
                let point = point_motion(chain, &here, joint, POINT);
                let next = point_motion(chain, &after, joint, POINT);
                let last = point_motion(chain, &before, joint, POINT);
                assert_eq!(point.position, point_position(&here, joint, POINT));
                close("J q̇", point.jacobian * q_d, point.velocity.into(), DEVIATION_MAX);
                let moved = (next.position - last.position) / (2.0 * STEP_S);
                close("velocity", point.velocity.into(), moved.into(), DIFFERENCE_MAX);
                let change = (next.velocity - last.velocity) / (2.0 * STEP_S);
                close("J̇q̇", point.drift, change.into(), DIFFERENCE_MAX);
                for beyond in joint + 1..N {
                    assert_eq!(point.jacobian.column(beyond).amax(), 0.0);
                }
            }
        }
    }
    for_each_robot!(check);
}

#[test]
fn the_tool_is_a_point_of_the_last_link() {
    let chain = ur5();
    let mut kinematics = Kinematics::new();
    for [q, q_d, _] in states::<6>(21) {
        forward_kinematics_with_velocity(&chain, &q, &q_d, &mut kinematics);
        // The tip stands 0.0823 + 0.12 m along z of the last joint frame.
        let tip = point_motion(&chain, &kinematics, 5, DVec3::Z * 0.2023);
        assert!((tip.position - kinematics.tool_position()).length() < 1e-15);
        assert!((tip.velocity - kinematics.tool_velocity.linear).abs().max_element() < 1e-14);
        close("J̇q̇", tip.drift, kinematics.tool_drift.linear.into(), 1e-14);
    }
}

#[test]
fn without_velocity_the_arm_is_at_rest() {
    fn check<const N: usize>(chain: &Chain<N>, seed: u64) {
        let mut still = Kinematics::new();
        let mut moving = Kinematics::new();
        for [q, q_d, _] in states::<N>(seed) {
            forward_kinematics(chain, &q, &mut still);
            forward_kinematics_with_velocity(chain, &q, &q_d, &mut moving);
            assert_eq!(still.tool_pose(), moving.tool_pose());
            assert_eq!(still.tool_jacobian, moving.tool_jacobian);
            assert_eq!(still.tool_velocity, Twist::ZERO);
            assert_eq!(still.tool_drift, SpatialAcceleration::ZERO);
            let point = point_motion(chain, &still, N - 1, POINT);
            assert_eq!((point.velocity.length(), point.drift.amax()), (0.0, 0.0));
        }
    }
    for_each_robot!(check);
}

#[test]
fn the_tool_s_orientation_is_fixed_to_the_last_link() {
    let chain = ur5();
    let mut kinematics = Kinematics::new();
    let mut fixed: Option<DMat3> = None;
    for [q, _, _] in states::<6>(22) {
        forward_kinematics(&chain, &q, &mut kinematics);
        let orientation = kinematics.tool_pose().orientation;
        assert!((orientation.length() - 1.0).abs() < 1e-14);
        let origin = point_position(&kinematics, 5, DVec3::ZERO);
        let [x, y, z] = DVec3::AXES.map(|axis| point_position(&kinematics, 5, axis) - origin);
        // R_EJ
        let found = rotation(&kinematics).transpose() * DMat3::from_cols(x, y, z);
        assert!(fixed.get_or_insert(found).abs_diff_eq(found, 1e-13));
    }
}

#[test]
fn ur5_stands_where_the_published_figures_put_it() {
    let chain = ur5();
    let mut kinematics = Kinematics::new();
    // All joints at zero: the arm lies along −x of its base, the tool points along −y.
    forward_kinematics(&chain, &SVector::zeros(), &mut kinematics);
    let expected = DVec3::new(-0.425 - 0.39225, -0.10915 - 0.0823 - 0.12, 0.089159 - 0.09465);
    assert!((kinematics.tool_position() - expected).length() < 1e-12);
    assert!((rotation(&kinematics).z_axis + DVec3::Y).length() < 1e-12);
    assert_eq!(chain.root_link(), "base");
    assert_eq!(chain.tool_link(), "suction_tip");
    assert_eq!(chain.joint_names()[0], "shoulder_pan_joint");
    assert_eq!(chain.joint_names()[5], "wrist_3_joint");
    assert_eq!(chain.effort_max().as_slice(), [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]);
}

#[test]
fn the_plane_robot_is_a_unit_mass() {
    let chain = point2d();
    assert_eq!(mass_matrix(&chain, &SVector::from([1.0, -2.0])), nalgebra::Matrix2::identity());
    assert_eq!(chain.position_upper().as_slice(), [10.0, 10.0]);
    assert_eq!(chain.position_lower().as_slice(), [-10.0, -10.0]);
    assert_eq!(chain.velocity_max().as_slice(), [20.0, 20.0]);
    assert_eq!(chain.effort_max().as_slice(), [400.0, 400.0]);
    let mut kinematics = Kinematics::new();
    forward_kinematics(&chain, &SVector::from([1.0, -2.0]), &mut kinematics);
    assert_eq!(kinematics.tool_position(), DVec3::new(1.0, -2.0, 0.0));
    assert!(rotation(&kinematics).abs_diff_eq(DMat3::IDENTITY, 1e-15));
}

#[test]
fn what_is_not_finite_stays_so_and_never_panics() {
    let chain = ur5();
    let zero = SVector::zeros();
    for bad in [f64::NAN, f64::INFINITY] {
        let mut q = zero;
        q[2] = bad;
        let mut kinematics = Kinematics::new();
        forward_kinematics_with_velocity(&chain, &q, &zero, &mut kinematics);
        assert!(kinematics.tool_position().is_nan());
        assert!(inverse_dynamics(&chain, &q, &zero, &zero, GRAVITY).iter().any(|t| t.is_nan()));
        assert_eq!(
            forward_dynamics(&chain, &q, &zero, &zero, GRAVITY),
            Err(DynamicsError::MassMatrixNotPositiveDefinite)
        );
    }
    let mut kinematics = Kinematics::new();
    assert!(kinematics.tool_position().is_nan());
    forward_kinematics(&chain, &zero, &mut kinematics);
    assert!(point_position(&kinematics, 6, POINT).is_nan());
    assert!(point_motion(&chain, &kinematics, 6, POINT).jacobian.iter().all(|j| j.is_nan()));
}
