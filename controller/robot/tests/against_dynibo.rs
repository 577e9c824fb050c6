//! Kinematics and dynamics against an independent implementation, the crate `dynibo`.

use std::path::Path;

use crate::common::{data_file, point2d, pybullet_file, robot_file, skew, states, ur5};
use dynibo::Robot;
use glam::{DMat3, DVec3};
use nalgebra::{DMatrix, SMatrix, SVector};
use tprmp_robot::{
    Chain, Kinematics, PointMass, Selection, forward_dynamics, forward_kinematics_with_velocity,
    gravity_torques, gravity_torques_with, inverse_dynamics, inverse_dynamics_with, mass_matrix,
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

/// * `held`  joints of the file beyond the chain's, last in its order, which stay at zero
fn compare<const N: usize>(chain: &Chain<N>, file: &Path, held: usize, seed: u64) {
    let mut oracle = Robot::from_urdf(file).unwrap();
    let count = N + held;
    assert_eq!(oracle.joint_count(), count);
    let tool = oracle.link_id(chain.tool_link()).unwrap();
    let mut kinematics = Kinematics::new();
    let mut columns = vec![0.0; 6 * count];
    let mut matrix = vec![0.0; count * count];
    let mut torques = vec![0.0; count];

    for [q, q_d, q_dd] in states::<N>(seed) {
        let [s, s_d, s_dd] = [&q, &q_d, &q_dd].map(|v| {
            let mut all = v.as_slice().to_vec();
            all.resize(count, 0.0);
            all
        });
        let (s, s_d, s_dd) = (&s[..], &s_d[..], &s_dd[..]);
        forward_kinematics_with_velocity(chain, &q, &q_d, &mut kinematics);

        let pose = oracle.forward_kinematics(s, tool).unwrap();
        let found = kinematics.tool_pose();
        let theirs = SVector::from_column_slice(pose.translation.vector.as_slice());
        close("position", found.position.into(), theirs);
        let theirs = pose.rotation.to_rotation_matrix();
        let theirs = SMatrix::from_column_slice(theirs.matrix().as_slice());
        close("orientation", DMat3::from_quat(found.orientation).into(), theirs);

        oracle.jacobian(s, tool, &mut columns).unwrap();
        close("Jacobian", kinematics.tool_jacobian, linear_first(&columns[..6 * N]));
        oracle.jacobian_derivative(s, s_d, tool, &mut columns).unwrap();
        close("J̇q̇", kinematics.tool_drift.into(), linear_first::<N>(&columns[..6 * N]) * q_d);

        oracle.mass_matrix(s, &mut matrix).unwrap();
        let theirs = DMatrix::from_column_slice(count, count, &matrix);
        let theirs = SMatrix::from_fn(|i, j| theirs[(i, j)]);
        close("mass matrix", mass_matrix(chain, &q), theirs);
        oracle.inverse_dynamics(s, s_d, s_dd, &[], &mut torques).unwrap();
        let ours = inverse_dynamics(chain, &q, &q_d, &q_dd, GRAVITY);
        close("inverse dynamics", ours, SVector::from_column_slice(&torques[..N]));
        oracle.gravity(s, &[], &mut torques).unwrap();
        close(
            "gravity",
            gravity_torques(chain, &q, GRAVITY),
            SVector::from_column_slice(&torques[..N]),
        );

        // Accelerations reach 10⁴ rad/s² here, so the deviation is taken relative to them. Joints
        // that are held cannot be in the oracle, in which they would move.
        if held == 0 {
            oracle.forward_dynamics(s, s_d, s_dd, &[], &mut torques).unwrap();
            let theirs: SVector<f64, N> = SVector::from_column_slice(&torques[..N]);
            let scale = 1.0 + theirs.amax();
            let ours = forward_dynamics(chain, &q, &q_d, &q_dd, GRAVITY).unwrap();
            close("forward dynamics", ours / scale, theirs / scale);
        }
    }
}

#[test]
fn ur5_with_tool() {
    compare(&ur5(), &robot_file("ur5.urdf"), 0, 1);
}

#[test]
fn point_in_the_plane() {
    compare(&point2d(), &robot_file("point2d.urdf"), 0, 2);
}

#[test]
fn skew_axes_all_joint_types_and_side_branches() {
    compare(&skew(), &data_file("skew.urdf"), 0, 3);
}

#[test]
fn franka_panda_with_its_fingers_held() {
    let file = pybullet_file("franka_panda/panda.urdf");
    // The oracle knows no joint that mimics another; both fingers stay at zero.
    let text = std::fs::read_to_string(&file).unwrap();
    let mimic = r#"<mimic joint="panda_finger_joint1"/>"#;
    assert!(text.contains(mimic));
    let oracle = Path::new(env!("CARGO_TARGET_TMPDIR")).join("panda_without_mimic.urdf");
    std::fs::write(&oracle, text.replace(mimic, "")).unwrap();
    let selection = Selection {
        base_link: Some("panda_link0".into()),
        tool_link: "panda_hand".into(),
        // The second one follows it.
        held_joints: [("panda_finger_joint1".into(), 0.0)].into(),
        ..Selection::default()
    };
    compare(&Chain::<7>::from_urdf(&file, selection).unwrap(), &oracle, 2, 4);
}

#[test]
fn kuka_iiwa() {
    let file = pybullet_file("kuka_iiwa/model.urdf");
    compare(&Chain::<7>::from_urdf(&file, "lbr_iiwa_link_7").unwrap(), &file, 0, 5);
}

/// The oracle has the payload as a link of its own, at the end of the tool.
#[test]
fn ur5_with_a_payload_of_the_selection_and_with_one_that_is_given() {
    let body = PointMass { mass: 1.5, centre: DVec3::new(0.03, -0.05, 0.08) };
    let link = r#"<link name="payload"><inertial><origin xyz="0.03 -0.05 0.08"/><mass value="1.5"/>
        <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
        <joint name="payload_joint" type="fixed"><parent link="suction_tip"/><child link="payload"/></joint>
        </robot>"#;
    let text = std::fs::read_to_string(robot_file("ur5.urdf")).unwrap();
    assert!(text.contains("name=\"suction_tip\""));
    let oracle = Path::new(env!("CARGO_TARGET_TMPDIR")).join("ur5_with_payload.urdf");
    std::fs::write(&oracle, text.replace("</robot>", link)).unwrap();
    let selection = Selection { payload: Some(body), .."suction_tip".into() };
    let carrying = Chain::<6>::from_urdf(robot_file("ur5.urdf"), selection).unwrap();
    compare(&carrying, &oracle, 0, 6);
    let (bare, payload) = (ur5(), ur5().payload(&body));
    for [q, q_d, q_dd] in states::<6>(7) {
        let expected = inverse_dynamics(&carrying, &q, &q_d, &q_dd, GRAVITY);
        let found = inverse_dynamics_with(&bare, &payload, &q, &q_d, &q_dd, GRAVITY);
        close("inverse dynamics", found, expected);
        let [with, without] = [&carrying, &bare].map(|chain| gravity_torques(chain, &q, GRAVITY));
        close("gravity", gravity_torques_with(&bare, &payload, &q, GRAVITY), with);
        let half = gravity_torques_with(&bare, &payload.scaled(0.5), &q, GRAVITY);
        close("half of it", half, (with + without) * 0.5);
        let none = gravity_torques_with(&bare, &payload.scaled(0.0), &q, GRAVITY);
        assert_eq!(none, without, "to the last bit");
        assert!((with - without).amax() > 1.0);
    }
}
