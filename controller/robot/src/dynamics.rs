//! Rigid-body dynamics of the chain. Joint friction and rotor inertia are not modelled.

use glam::{DMat3, DVec3};
use nalgebra::{Cholesky, SMatrix, SVector};
use tprmp_spatial::{Twist, Wrench};

use crate::chain::Chain;
use crate::description::JointKind;
use crate::inertia::SpatialInertia;
use crate::kinematics::{joint_placement, joint_placements};
use crate::payload::Payload;
use crate::placement::Placement;
use crate::trigonometry::sin_cos;

/// Why the dynamics have no answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DynamicsError {
    /// The mass matrix is not positive definite: a moving link without mass or inertia at the end
    /// of the chain, or input that is not finite. Safe action: command no motion.
    #[error("expected a positive definite mass matrix, found one that is not")]
    MassMatrixNotPositiveDefinite,
}

/// Joint torques for an acceleration: τ = M(q) q̈ + h(q, q̇).
///
/// Recursive Newton–Euler algorithm in joint frames [Featherstone, Rigid Body Dynamics
/// Algorithms, table 5.1]. Gravity enters as an acceleration −g of the base.
///
/// * `q`, `q_d`, `q_dd` position, velocity, acceleration, N [rad, rad/s, rad/s² or m, m/s, m/s²]
/// * `gravity` gravitational acceleration in `B` [m/s²], (0, 0, −9.81) for an arm on the floor
///
/// Returns the joint torques or forces, N [N m or N].
/// Hot path: no allocation, no panic, O(N).
pub fn inverse_dynamics<const N: usize>(
    chain: &Chain<N>,
    q: &SVector<f64, N>,
    q_d: &SVector<f64, N>,
    q_dd: &SVector<f64, N>,
    gravity: DVec3,
) -> SVector<f64, N> {
    inverse_dynamics_with(chain, &Payload::NONE, q, q_d, q_dd, gravity)
}

/// As [`inverse_dynamics`], with a payload.
pub fn inverse_dynamics_with<const N: usize>(
    chain: &Chain<N>,
    payload: &Payload,
    q: &SVector<f64, N>,
    q_d: &SVector<f64, N>,
    q_dd: &SVector<f64, N>,
    gravity: DVec3,
) -> SVector<f64, N> {
    let last = payload.with_last(chain.joints[N - 1].inertia);
    let (sines, cosines) = sin_cos(&q.data.0[0]);
    let mut placements = [Placement::IDENTITY; N];
    // Of each body, about its joint frame's origin.
    let mut wrenches = [Wrench::ZERO; N];

    let (mut omega, mut alpha, mut acceleration) = (DVec3::ZERO, DVec3::ZERO, -gravity);
    for i in 0..N {
        let joint = &chain.joints[i];
        placements[i] = joint_placement(joint, q[i], sines[i], cosines[i]);
        let Placement { rotation, position: p } = placements[i];
        acceleration += alpha.cross(p) + omega.cross(omega.cross(p));
        omega = rotate_back(&rotation, omega);
        alpha = rotate_back(&rotation, alpha);
        acceleration = rotate_back(&rotation, acceleration);
        // ω × z q̇ in the joint frame.
        let coriolis = DVec3::new(omega.y, -omega.x, 0.0) * q_d[i];
        match joint.kind {
            JointKind::Revolute => {
                alpha += coriolis;
                alpha.z += q_dd[i];
                omega.z += q_d[i];
            }
            JointKind::Prismatic => {
                acceleration += 2.0 * coriolis;
                acceleration.z += q_dd[i];
            }
        }
        let body = if i + 1 < N { &joint.inertia } else { &last };
        let h = body.first_moment;
        wrenches[i] = Wrench {
            force: body.mass * acceleration + alpha.cross(h) + omega.cross(omega.cross(h)),
            torque: body.inertia * alpha
                + omega.cross(body.inertia * omega)
                + h.cross(acceleration),
        };
    }

    let mut torques = SVector::zeros();
    let mut total = Wrench::ZERO;
    for i in (0..N).rev() {
        // Here it is that of all the joint moves, in this joint frame.
        total = total + wrenches[i];
        torques[i] = match chain.joints[i].kind {
            JointKind::Revolute => total.torque.z,
            JointKind::Prismatic => total.force.z,
        };
        let Placement { rotation, position } = placements[i];
        let force = rotation * total.force;
        total = Wrench { force, torque: rotation * total.torque + position.cross(force) };
    }
    torques
}

/// Joint torques that hold the arm against gravity: h(q, 0).
///
/// With m_i, h_i the mass and the first moment in `B` of all that joint i moves:
/// `τ_i = −g · (z_i × (h_i − m_i p_i))` for a revolute joint, `−m_i g · z_i` for a prismatic one.
///
/// * `q` joint positions, N [rad or m]
/// * `gravity` gravitational acceleration in `B` [m/s²]
///
/// Returns torques or forces, N [N m or N]. Hot path: no allocation, no panic, O(N).
pub fn gravity_torques<const N: usize>(
    chain: &Chain<N>,
    q: &SVector<f64, N>,
    gravity: DVec3,
) -> SVector<f64, N> {
    gravity_torques_with(chain, &Payload::NONE, q, gravity)
}

/// As [`gravity_torques`], with a payload.
pub fn gravity_torques_with<const N: usize>(
    chain: &Chain<N>,
    payload: &Payload,
    q: &SVector<f64, N>,
    gravity: DVec3,
) -> SVector<f64, N> {
    let last = payload.with_last(chain.joints[N - 1].inertia);
    let placements = joint_placements(chain, q);
    let mut torques = SVector::zeros();
    let (mut mass, mut first_moment) = (0.0, DVec3::ZERO);
    for i in (0..N).rev() {
        let body = if i + 1 < N { &chain.joints[i].inertia } else { &last };
        mass += body.mass;
        let Placement { rotation, position } = placements[i];
        first_moment += rotation * body.first_moment + body.mass * position;
        let z = rotation.z_axis;
        torques[i] = match chain.joints[i].kind {
            JointKind::Revolute => -gravity.dot(z.cross(first_moment - mass * position)),
            JointKind::Prismatic => -mass * gravity.dot(z),
        };
    }
    torques
}

/// The mass matrix M(q), N×N, symmetric, positive definite [kg m², kg m or kg].
///
/// Composite rigid bodies [Featherstone, table 6.2], with all inertias about the origin of `B` and
/// expressed there: then composites are sums, and `M_ij = S_jᵀ I_i S_i` for j ≤ i.
///
/// * `q` joint positions, N [rad or m]
///
/// Hot path: no allocation, no panic, O(N²).
pub fn mass_matrix<const N: usize>(chain: &Chain<N>, q: &SVector<f64, N>) -> SMatrix<f64, N, N> {
    let placements = joint_placements(chain, q);
    let mut mass_matrix = SMatrix::zeros();
    let mut composite = SpatialInertia::ZERO;
    for i in (0..N).rev() {
        let body = chain.joints[i].inertia.moved(&placements[i]);
        composite = composite.plus(&body);
        let Twist { linear, angular } = axis(chain.joints[i].kind, &placements[i]);
        let h = composite.first_moment;
        let momentum = Wrench {
            force: composite.mass * linear + angular.cross(h),
            torque: composite.inertia * angular + h.cross(linear),
        };
        for j in 0..=i {
            let entry = axis(chain.joints[j].kind, &placements[j]).power(&momentum);
            mass_matrix[(i, j)] = entry;
            mass_matrix[(j, i)] = entry;
        }
    }
    mass_matrix
}

/// Joint accelerations for torques: solves M(q) q̈ = τ − h(q, q̇) by Cholesky's method.
///
/// * `q`, `q_d` position and velocity, N [rad, rad/s or m, m/s]
/// * `torques` τ, N [N m or N]
/// * `gravity` gravitational acceleration in `B` [m/s²]
///
/// Returns q̈, N [rad/s² or m/s²]. Hot path: no allocation, no panic, O(N³).
///
/// # Errors
///
/// [`DynamicsError::MassMatrixNotPositiveDefinite`].
pub fn forward_dynamics<const N: usize>(
    chain: &Chain<N>,
    q: &SVector<f64, N>,
    q_d: &SVector<f64, N>,
    torques: &SVector<f64, N>,
    gravity: DVec3,
) -> Result<SVector<f64, N>, DynamicsError> {
    let bias = inverse_dynamics(chain, q, q_d, &SVector::zeros(), gravity);
    let mut q_dd = torques - bias;
    let factor =
        Cholesky::new(mass_matrix(chain, q)).ok_or(DynamicsError::MassMatrixNotPositiveDefinite)?;
    factor.solve_mut(&mut q_dd);
    Ok(q_dd)
}

/// Unit velocity of a joint at the origin of `B`.
#[inline]
fn axis(kind: JointKind, placement: &Placement) -> Twist {
    let z = placement.rotation.z_axis;
    match kind {
        JointKind::Revolute => Twist { linear: placement.position.cross(z), angular: z },
        JointKind::Prismatic => Twist { linear: z, angular: DVec3::ZERO },
    }
}

/// Rᵀ v
#[inline]
fn rotate_back(rotation: &DMat3, v: DVec3) -> DVec3 {
    DVec3::new(rotation.x_axis.dot(v), rotation.y_axis.dot(v), rotation.z_axis.dot(v))
}
