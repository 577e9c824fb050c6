//! Kinematics and dynamics against an independent implementation, the crate `dynibo`.

mod common;

use std::path::Path;

use common::{data_file, point2d, robot_file, skew, states, ur5};
use dynibo::Robot;
use glam::DVec3;
use nalgebra::{DMatrix, SMatrix, SVector};
use tprmp_robot::{
    Chain, Kinematics, forward_dynamics, forward_kinematics_with_velocity, gravity_torques,
    inverse_dynamics, mass_matrix,
};

/// The gravity that dynibo has built in [m/s²].
const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.80665);
/// Largest accepted deviation [SI units].
const DEVIATION_MAX: f64 = 1e-9;

/// dynibo stacks [angular; linear].
fn linear_first<const N: usize>(columns: &[f64]) -> SMatrix<f64, 6, N> {
    let angular_first = DMatrix::from_column_slice(6, N, columns);
    SMatrix::from_fn(|row, column| angular_first[((row + 3) % 6, column)])
}

fn close<const R: usize, const C: usize>(
    what: &str,
    ours: SMatrix<f64, R, C>,
    theirs: SMatrix<f64, R, C>,
) {
    let deviation = (ours - theirs).amax();
    assert!(deviation < DEVIATION_MAX, "{what}: deviation {deviation}\n{ours}{theirs}");
}

fn compare<const N: usize>(chain: &Chain<N>, file: &Path, seed: u64) {
    let mut oracle = Robot::from_urdf(file).unwrap();
    assert_eq!(oracle.joint_count(), N);
    let tool = oracle.link_id(chain.tool_link()).unwrap();
    let mut kinematics = Kinematics::new();
    let mut columns = vec![0.0; 6 * N];
    let mut matrix = vec![0.0; N * N];
    let mut torques = vec![0.0; N];

    for [q, q_d, q_dd] in states::<N>(seed) {
        let (s, s_d, s_dd) = (q.as_slice(), q_d.as_slice(), q_dd.as_slice());
        forward_kinematics_with_velocity(chain, &q, &q_d, &mut kinematics);

        let pose = oracle.forward_kinematics(s, tool).unwrap();
        let position = SVector::from(kinematics.tool_position.to_array());
        close("position", position, pose.translation.vector);
        let rotation = kinematics.tool_rotation.to_cols_array_2d();
        let theirs = pose.rotation.to_rotation_matrix();
        close("orientation", SMatrix::from(rotation), *theirs.matrix());

        oracle.jacobian(s, tool, &mut columns).unwrap();
        close("Jacobian", kinematics.tool_jacobian, linear_first(&columns));
        oracle.jacobian_derivative(s, s_d, tool, &mut columns).unwrap();
        close("J̇q̇", kinematics.tool_jd_qd, linear_first::<N>(&columns) * q_d);

        oracle.mass_matrix(s, &mut matrix).unwrap();
        close("mass matrix", mass_matrix(chain, &q), SMatrix::from_column_slice(&matrix));
        oracle.inverse_dynamics(s, s_d, s_dd, &[], &mut torques).unwrap();
        let ours = inverse_dynamics(chain, &q, &q_d, &q_dd, GRAVITY);
        close("inverse dynamics", ours, SVector::from_column_slice(&torques));
        oracle.gravity(s, &[], &mut torques).unwrap();
        close("gravity", gravity_torques(chain, &q, GRAVITY), SVector::from_column_slice(&torques));

        // Accelerations reach 10⁴ rad/s² here, so the deviation is taken relative to them.
        oracle.forward_dynamics(s, s_d, s_dd, &[], &mut torques).unwrap();
        let theirs: SVector<f64, N> = SVector::from_column_slice(&torques);
        let scale = 1.0 + theirs.amax();
        let ours = forward_dynamics(chain, &q, &q_d, &q_dd, GRAVITY).unwrap();
        close("forward dynamics", ours / scale, theirs / scale);
    }
}

#[test]
fn ur5_with_tool() {
    compare(&ur5(), &robot_file("ur5.urdf"), 1);
}

#[test]
fn point_in_the_plane() {
    compare(&point2d(), &robot_file("point2d.urdf"), 2);
}

#[test]
fn skew_axes_all_joint_types_and_side_branches() {
    compare(&skew(), &data_file("skew.urdf"), 3);
}
