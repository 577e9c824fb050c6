//! Forward kinematics, Jacobians and velocity-product accelerations.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{SMatrix, SVector, Vector3, Vector6};

use crate::chain::{Chain, JointKind, JointModel};
use crate::trigonometry::sin_cos;

/// Workspace and result of the forward kinematics. Everything is expressed in `B`.
///
/// A new one is filled with NaN, so that use before the first evaluation shows.
#[derive(Debug, Clone)]
pub struct Kinematics<const N: usize> {
    /// R_BJ of each joint frame.
    pub joint_rotations: [DMat3; N],
    /// p_BJ, the origin of each joint frame [m].
    pub joint_positions: [DVec3; N],
    /// R_BE, the orientation of the tool.
    pub tool_rotation: DMat3,
    /// p_BE, the origin of the tool [m].
    pub tool_position: DVec3,
    /// J, 6×N, rows [linear; angular] [m/rad or 1; 1 or 0].
    pub tool_jacobian: SMatrix<f64, 6, N>,
    /// V = J q̇, [linear; angular] [m/s; rad/s].
    pub tool_twist: Vector6<f64>,
    /// J̇q̇, [linear; angular]: classical acceleration of the tool with q̈ = 0 [m/s²; rad/s²].
    pub tool_jd_qd: Vector6<f64>,
    joint_motions: [Motion; N],
}

/// Motion of a joint frame with q̈ = 0.
#[derive(Debug, Clone, Copy)]
struct Motion {
    /// Angular velocity ω [rad/s].
    angular: DVec3,
    /// Velocity of the origin [m/s].
    linear: DVec3,
    /// Angular acceleration [rad/s²].
    angular_bias: DVec3,
    /// Acceleration of the origin [m/s²].
    linear_bias: DVec3,
}

impl Motion {
    const REST: Self = Self {
        angular: DVec3::ZERO,
        linear: DVec3::ZERO,
        angular_bias: DVec3::ZERO,
        linear_bias: DVec3::ZERO,
    };

    const NAN: Self = Self {
        angular: DVec3::NAN,
        linear: DVec3::NAN,
        angular_bias: DVec3::NAN,
        linear_bias: DVec3::NAN,
    };

    /// Velocity of the point at `r` [m] from the origin, fixed to this frame.
    fn velocity_at(&self, r: DVec3) -> DVec3 {
        self.linear + self.angular.cross(r)
    }

    /// Acceleration of that point: `a + ω̇ × r + ω × (ω × r)`.
    fn bias_at(&self, r: DVec3) -> DVec3 {
        self.linear_bias + self.angular_bias.cross(r) + self.angular.cross(self.angular.cross(r))
    }
}

/// Motion of a point fixed to a moving link. Everything is expressed in `B`.
#[derive(Debug, Clone, Copy)]
pub struct PointKinematics<const N: usize> {
    /// Position [m].
    pub position: DVec3,
    /// Velocity [m/s].
    pub velocity: Vector3<f64>,
    /// Jacobian, 3×N; columns of joints beyond the link are zero [m/rad or 1].
    pub jacobian: SMatrix<f64, 3, N>,
    /// J̇q̇: acceleration with q̈ = 0 [m/s²].
    pub jd_qd: Vector3<f64>,
}

impl<const N: usize> Kinematics<N> {
    /// A workspace filled with NaN.
    pub fn new() -> Self {
        Self {
            joint_rotations: [DMat3::NAN; N],
            joint_positions: [DVec3::NAN; N],
            tool_rotation: DMat3::NAN,
            tool_position: DVec3::NAN,
            tool_jacobian: SMatrix::from_element(f64::NAN),
            tool_twist: Vector6::from_element(f64::NAN),
            tool_jd_qd: Vector6::from_element(f64::NAN),
            joint_motions: [Motion::NAN; N],
        }
    }

    /// Orientation of the tool R_BE as a unit quaternion; which of ±q it is, is not defined.
    pub fn tool_orientation(&self) -> DQuat {
        DQuat::from_mat3(&self.tool_rotation)
    }
}

impl<const N: usize> Default for Kinematics<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The joint's rotation at `q` [rad or m] in the frame before it, and its origin there [m].
///
/// * `sin`, `cos`  of q; not read for a prismatic joint
#[inline(always)]
pub(crate) fn joint_pose(joint: &JointModel, q: f64, sin: f64, cos: f64) -> (DMat3, DVec3) {
    let JointModel { kind, rotation, position, .. } = joint;
    match kind {
        JointKind::Revolute => {
            let (x, y) = (rotation.x_axis, rotation.y_axis);
            let turned = DMat3::from_cols(cos * x + sin * y, cos * y - sin * x, rotation.z_axis);
            (turned, *position)
        }
        JointKind::Prismatic => (*rotation, *position + q * rotation.z_axis),
    }
}

/// R_BJ and p_BJ of all joint frames at `q`.
#[inline(always)]
pub(crate) fn joint_poses<const N: usize>(
    chain: &Chain<N>,
    q: &SVector<f64, N>,
    rotations: &mut [DMat3; N],
    positions: &mut [DVec3; N],
) {
    let (sines, cosines) = sin_cos(&q.data.0[0]);
    let (mut rotation_before, mut position_before) = (DMat3::IDENTITY, DVec3::ZERO);
    for i in 0..N {
        let (rotation, position) = joint_pose(&chain.joints[i], q[i], sines[i], cosines[i]);
        position_before += rotation_before * position;
        rotation_before *= rotation;
        (rotations[i], positions[i]) = (rotation_before, position_before);
    }
}

/// Poses and tool Jacobian at `q`, of an arm at rest: twist, J̇q̇ and all velocities become zero.
///
/// * `q` joint positions, N [rad or m]
///
/// Hot path: no allocation, no panic, O(N).
pub fn forward_kinematics<const N: usize>(
    chain: &Chain<N>,
    q: &SVector<f64, N>,
    kinematics: &mut Kinematics<N>,
) {
    place(chain, q, kinematics);
    kinematics.joint_motions = [Motion::REST; N];
    kinematics.tool_twist = Vector6::zeros();
    kinematics.tool_jd_qd = Vector6::zeros();
}

/// Poses, tool Jacobian, tool twist and J̇q̇ at `q`, `q̇`.
///
/// With `r` from the origin of joint frame i−1 to that of i and z the axis of joint i:
///
/// ```text
/// revolute:   ω_i = ω + z q̇     ω̇_i = ω̇ + ω × z q̇     v_i = v + ω × r
/// prismatic:  ω_i = ω           ω̇_i = ω̇               v_i = v + ω × r + z q̇
/// both:       a_i = a + ω̇ × r + ω × (ω × r)            (prismatic: + 2 ω × z q̇)
/// ```
///
/// * `q`   joint positions, N [rad or m]
/// * `q_d` joint velocities q̇, N [rad/s or m/s]
///
/// Hot path: no allocation, no panic, O(N).
pub fn forward_kinematics_with_velocity<const N: usize>(
    chain: &Chain<N>,
    q: &SVector<f64, N>,
    q_d: &SVector<f64, N>,
    kinematics: &mut Kinematics<N>,
) {
    place(chain, q, kinematics);
    let mut before = Motion::REST;
    let mut position_before = DVec3::ZERO;
    for i in 0..N {
        let r = kinematics.joint_positions[i] - position_before;
        let joint_velocity = kinematics.joint_rotations[i].z_axis * q_d[i];
        let coriolis = before.angular.cross(joint_velocity);
        let mut motion = Motion {
            angular: before.angular,
            linear: before.velocity_at(r),
            angular_bias: before.angular_bias,
            linear_bias: before.bias_at(r),
        };
        match chain.joints[i].kind {
            JointKind::Revolute => {
                motion.angular += joint_velocity;
                motion.angular_bias += coriolis;
            }
            JointKind::Prismatic => {
                motion.linear += joint_velocity;
                motion.linear_bias += 2.0 * coriolis;
            }
        }
        kinematics.joint_motions[i] = motion;
        before = motion;
        position_before = kinematics.joint_positions[i];
    }
    let r = kinematics.tool_position - position_before;
    kinematics.tool_twist = stack(before.velocity_at(r), before.angular);
    kinematics.tool_jd_qd = stack(before.bias_at(r), before.angular_bias);
}

/// The part of the forward kinematics that needs no velocity.
#[inline]
fn place<const N: usize>(chain: &Chain<N>, q: &SVector<f64, N>, kinematics: &mut Kinematics<N>) {
    let Kinematics { joint_rotations: rotations, joint_positions: positions, .. } = kinematics;
    joint_poses(chain, q, rotations, positions);
    let (rotation, position) = match (rotations.last(), positions.last()) {
        (Some(rotation), Some(position)) => (*rotation, *position),
        _ => (DMat3::IDENTITY, DVec3::ZERO),
    };
    let tool = position + rotation * chain.tool_position;
    for i in 0..N {
        let (linear, angular) =
            column(chain.joints[i].kind, rotations[i].z_axis, tool - positions[i]);
        kinematics.tool_jacobian.set_column(i, &stack(linear, angular));
    }
    kinematics.tool_position = tool;
    kinematics.tool_rotation = rotation * chain.tool_rotation;
}

/// Column of a Jacobian for the point at `r` [m] from the joint frame, z the joint's axis:
/// `[z × r; z]` for a revolute joint, `[z; 0]` for a prismatic one.
#[inline]
fn column(kind: JointKind, z: DVec3, r: DVec3) -> (DVec3, DVec3) {
    match kind {
        JointKind::Revolute => (z.cross(r), z),
        JointKind::Prismatic => (z, DVec3::ZERO),
    }
}

/// Position in `B` [m] of the point at `point` [m] in the frame of `joint`.
///
/// NaN when there is no such joint. Hot path: no allocation, no panic, O(1).
#[inline]
pub fn point_position<const N: usize>(
    kinematics: &Kinematics<N>,
    joint: usize,
    point: DVec3,
) -> DVec3 {
    match (kinematics.joint_rotations.get(joint), kinematics.joint_positions.get(joint)) {
        (Some(rotation), Some(position)) => *position + *rotation * point,
        _ => DVec3::NAN,
    }
}

/// Position, velocity, Jacobian and J̇q̇ of the point at `point` [m] in the frame of `joint`.
///
/// `kinematics` must be an evaluation of `chain`; the velocities are those of that evaluation. NaN
/// when there is no such joint. Hot path: no allocation, no panic, O(N).
#[inline]
pub fn point_kinematics<const N: usize>(
    chain: &Chain<N>,
    kinematics: &Kinematics<N>,
    joint: usize,
    point: DVec3,
) -> PointKinematics<N> {
    let (Some(rotation), Some(origin), Some(motion)) = (
        kinematics.joint_rotations.get(joint),
        kinematics.joint_positions.get(joint),
        kinematics.joint_motions.get(joint),
    ) else {
        return PointKinematics {
            position: DVec3::NAN,
            velocity: Vector3::from_element(f64::NAN),
            jacobian: SMatrix::from_element(f64::NAN),
            jd_qd: Vector3::from_element(f64::NAN),
        };
    };
    let r = *rotation * point;
    let position = *origin + r;
    let mut jacobian = SMatrix::<f64, 3, N>::zeros();
    for i in 0..=joint {
        let z = kinematics.joint_rotations[i].z_axis;
        let (linear, _) = column(chain.joints[i].kind, z, position - kinematics.joint_positions[i]);
        jacobian.set_column(i, &vector(linear));
    }
    PointKinematics {
        position,
        velocity: vector(motion.velocity_at(r)),
        jacobian,
        jd_qd: vector(motion.bias_at(r)),
    }
}

#[inline]
fn vector(v: DVec3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

#[inline]
fn stack(linear: DVec3, angular: DVec3) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}
