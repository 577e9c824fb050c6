//! Forward kinematics, Jacobians and velocity-product accelerations.

use glam::{DMat3, DVec3};
use nalgebra::{SMatrix, SVector, Vector6};
use tprmp_spatial::{PointMotion, Pose, SpatialAcceleration, Twist};

use crate::chain::Chain;
use crate::description::{JointKind, JointModel};
use crate::placement::Placement;
use crate::trigonometry::sin_cos;

/// Workspace and result of the forward kinematics. Everything is expressed in `B`.
///
/// A new one is filled with NaN, so that use before the first evaluation is noticed.
#[derive(Debug, Clone)]
pub struct Kinematics<const N: usize> {
    /// X_BJ of each joint frame.
    joints: [Placement; N],
    /// X_BE.
    tool: Placement,
    /// J, 6×N, rows [linear; angular] [m/rad or 1; 1 or 0].
    pub tool_jacobian: SMatrix<f64, 6, N>,
    /// V_BE = J q̇.
    pub tool_velocity: Twist,
    /// J̇q̇: A_BE for q̈ = 0.
    pub tool_drift: SpatialAcceleration,
    joint_motions: [Motion; N],
}

/// Motion of a joint frame with q̈ = 0.
#[derive(Debug, Clone, Copy)]
struct Motion {
    velocity: Twist,
    drift: SpatialAcceleration,
}

impl Motion {
    const REST: Self = Self { velocity: Twist::ZERO, drift: SpatialAcceleration::ZERO };

    /// Motion of a frame that is fixed to this one, its origin `r` [m] from this one's.
    #[inline]
    fn shifted(&self, r: DVec3) -> Self {
        Self {
            velocity: self.velocity.shifted(r),
            drift: self.drift.shifted(self.velocity.angular, r),
        }
    }
}

impl<const N: usize> Kinematics<N> {
    /// A workspace filled with NaN.
    #[inline]
    pub fn new() -> Self {
        let undefined =
            Motion { velocity: Twist::UNDEFINED, drift: SpatialAcceleration::UNDEFINED };
        Self {
            joints: [Placement::UNDEFINED; N],
            tool: Placement::UNDEFINED,
            tool_jacobian: SMatrix::from_element(f64::NAN),
            tool_velocity: Twist::UNDEFINED,
            tool_drift: SpatialAcceleration::UNDEFINED,
            joint_motions: [undefined; N],
        }
    }

    /// X_BE; which of the quaternions ±q it has, is not defined.
    #[inline]
    pub fn tool_pose(&self) -> Pose {
        self.tool.pose()
    }

    /// p_BE, the origin of the tool [m].
    #[inline]
    pub fn tool_position(&self) -> DVec3 {
        self.tool.position
    }

    /// V_BJ of all joint frames, from the base on.
    #[inline]
    pub fn joint_velocities(&self) -> impl Iterator<Item = Twist> + '_ {
        self.joint_motions.iter().map(|motion| motion.velocity)
    }

    /// A_BE = J q̈ + J̇q̇.
    ///
    /// * `q_dd`  joint accelerations q̈, N [rad/s² or m/s²]
    #[inline]
    pub fn tool_acceleration(&self, q_dd: &SVector<f64, N>) -> SpatialAcceleration {
        SpatialAcceleration::from(self.tool_jacobian * q_dd) + self.tool_drift
    }
}

impl<const N: usize> Default for Kinematics<N> {
    #[inline]
    fn default() -> Self {
        Self::new()
    }
}

/// The joint frame at `q` [rad or m] in the one before it.
///
/// * `sin`, `cos`  of q; not read for a prismatic joint
#[inline(always)]
pub(crate) fn joint_placement(joint: &JointModel, q: f64, sin: f64, cos: f64) -> Placement {
    let Placement { rotation, position } = joint.placement;
    match joint.kind {
        JointKind::Revolute => {
            let (x, y) = (rotation.x_axis, rotation.y_axis);
            let rotation = DMat3::from_cols(cos * x + sin * y, cos * y - sin * x, rotation.z_axis);
            Placement { rotation, position }
        }
        JointKind::Prismatic => Placement { rotation, position: position + q * rotation.z_axis },
    }
}

/// X_BJ of all joint frames at `q`.
#[inline(always)]
pub(crate) fn joint_placements<const N: usize>(
    chain: &Chain<N>,
    q: &SVector<f64, N>,
) -> [Placement; N] {
    let (sines, cosines) = sin_cos(&q.data.0[0]);
    let mut placements = [Placement::IDENTITY; N];
    let mut before = Placement::IDENTITY;
    for i in 0..N {
        before = before.compose(&joint_placement(&chain.joints[i], q[i], sines[i], cosines[i]));
        placements[i] = before;
    }
    placements
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
    kinematics.tool_velocity = Twist::ZERO;
    kinematics.tool_drift = SpatialAcceleration::ZERO;
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
        let Placement { rotation, position } = kinematics.joints[i];
        let mut motion = before.shifted(position - position_before);
        let joint_velocity = rotation.z_axis * q_d[i];
        let coriolis = before.velocity.angular.cross(joint_velocity);
        match chain.joints[i].kind {
            JointKind::Revolute => {
                motion.velocity.angular += joint_velocity;
                motion.drift.angular += coriolis;
            }
            JointKind::Prismatic => {
                motion.velocity.linear += joint_velocity;
                motion.drift.linear += 2.0 * coriolis;
            }
        }
        kinematics.joint_motions[i] = motion;
        before = motion;
        position_before = position;
    }
    let tool = before.shifted(kinematics.tool.position - position_before);
    kinematics.tool_velocity = tool.velocity;
    kinematics.tool_drift = tool.drift;
}

/// The part of the forward kinematics that needs no velocity.
#[inline]
fn place<const N: usize>(chain: &Chain<N>, q: &SVector<f64, N>, kinematics: &mut Kinematics<N>) {
    kinematics.joints = joint_placements(chain, q);
    let joints = &kinematics.joints;
    kinematics.tool = joints.last().unwrap_or(&Placement::IDENTITY).compose(&chain.tool);
    let tool = kinematics.tool.position;
    for (i, Placement { rotation, position }) in joints.iter().enumerate() {
        let column = column(chain.joints[i].kind, rotation.z_axis, tool - *position);
        kinematics.tool_jacobian.set_column(i, &Vector6::from(column));
    }
}

/// Column of a Jacobian for the point at `r` [m] from the joint frame, z the joint's axis:
/// `[z × r; z]` for a revolute joint, `[z; 0]` for a prismatic one.
#[inline]
fn column(kind: JointKind, z: DVec3, r: DVec3) -> Twist {
    match kind {
        JointKind::Revolute => Twist { linear: z.cross(r), angular: z },
        JointKind::Prismatic => Twist { linear: z, angular: DVec3::ZERO },
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
    kinematics.joints.get(joint).map_or(DVec3::NAN, |placement| placement.transform_point(point))
}

/// X_BL of a moving link, an index into [`Chain::moving_links`]; `kinematics` must be an evaluation of `chain`.
/// `None` when there is no such link. No allocation, no panic, O(1).
pub fn link_pose<const N: usize>(
    chain: &Chain<N>,
    kinematics: &Kinematics<N>,
    link: usize,
) -> Option<Pose> {
    let (_, joint) = chain.moving_links.get(link)?;
    Some(kinematics.joints.get(*joint)?.compose(chain.link_placements.get(link)?).pose())
}

/// Motion in `B` of the point at `point` [m] in the frame of `joint`; columns of joints beyond it are
/// zero.
///
/// `kinematics` must be an evaluation of `chain`; the velocities are those of that evaluation. NaN
/// when there is no such joint. Hot path: no allocation, no panic, O(N).
#[inline]
pub fn point_motion<const N: usize>(
    chain: &Chain<N>,
    kinematics: &Kinematics<N>,
    joint: usize,
    point: DVec3,
) -> PointMotion<N> {
    let (Some(frame), Some(motion)) =
        (kinematics.joints.get(joint), kinematics.joint_motions.get(joint))
    else {
        return PointMotion::UNDEFINED;
    };
    let r = frame.rotation * point;
    let position = frame.position + r;
    let mut jacobian = SMatrix::<f64, 3, N>::zeros();
    for i in 0..=joint {
        let Placement { rotation, position: origin } = kinematics.joints[i];
        let column = column(chain.joints[i].kind, rotation.z_axis, position - origin);
        jacobian.set_column(i, &column.linear.into());
    }
    let motion = motion.shifted(r);
    PointMotion {
        position,
        velocity: motion.velocity.linear,
        jacobian,
        drift: motion.drift.linear.into(),
    }
}
