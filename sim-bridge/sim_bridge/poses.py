"""Rotations and poses: quaternions `w, x, y, z`, homogeneous 4x4 matrices, lengths in m.

Monogram notation: `X_AB` is the pose of frame B in frame A, so that `X_AC = X_AB @ X_BC`.
"""

from __future__ import annotations

import math

import numpy as np

Array = np.ndarray


def rotation_z(angle_rad: float) -> Array:
    """Rotation matrix about z."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Rotation matrix of URDF's fixed-axis angles: `Rz(yaw) Ry(pitch) Rx(roll)`."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    r_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    r_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return rotation_z(yaw_rad) @ r_y @ r_x


def rotation_from_vector(vector_rad: Array) -> Array:
    """Exponential map: rotation matrix of a rotation vector (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector_rad))
    if angle < 1e-12:
        return np.eye(3) + skew(vector_rad)
    k = skew(np.asarray(vector_rad) / angle)
    return np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k)


def vector_from_rotation(rotation: Array) -> Array:
    """Logarithm: rotation vector of a rotation matrix, its angle in [0, π] rad."""
    w, x, y, z = quaternion_from_rotation(rotation)
    axis = np.array([x, y, z])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return 2.0 * axis
    return axis * (2.0 * math.atan2(sine, w) / sine)


def skew(vector: Array) -> Array:
    """Matrix of the cross product `vector × ·`."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def quaternion_from_rotation(rotation: Array) -> Array:
    """Unit quaternion `w, x, y, z` with `w >= 0` (Shepperd's method: divides by the largest)."""
    r = rotation
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    squares = np.array([trace, r[0, 0], r[1, 1], r[2, 2]])
    largest = int(np.argmax(squares))
    if largest == 0:
        q = np.array([1.0 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0] = r[k, j] - r[j, k]
        q[1 + i] = 1.0 + 2.0 * r[i, i] - trace
        q[1 + j] = r[j, i] + r[i, j]
        q[1 + k] = r[k, i] + r[i, k]
    q /= np.linalg.norm(q)
    return q if q[0] >= 0.0 else -q


def rotation_from_quaternion(quaternion_wxyz: Array) -> Array:
    """Rotation matrix of a unit quaternion `w, x, y, z`."""
    w, x, y, z = quaternion_wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def angular_velocity(quaternions_wxyz: Array, time_s: Array) -> Array:
    """Angular velocities [rad/s], N × 3, of N continuous quaternions at N times [s].

    ω = 2 vec(q̇ q*), in the frame that the quaternions rotate into; by central differences.
    """
    q = quaternions_wxyz
    rate = np.gradient(q, time_s, axis=0)
    vector = q[:, :1] * rate[:, 1:] - rate[:, :1] * q[:, 1:] - np.cross(rate[:, 1:], q[:, 1:])
    return 2.0 * vector


def pose(rotation: Array, position: Array) -> Array:
    """Homogeneous matrix of a rotation and a position."""
    x = np.eye(4)
    x[:3, :3] = rotation
    x[:3, 3] = position
    return x


def pose_from_wire(position: Array, quaternion_wxyz: Array) -> Array:
    """Homogeneous matrix of a position and a unit quaternion."""
    return pose(rotation_from_quaternion(quaternion_wxyz), position)


def inverse(x_ab: Array) -> Array:
    """`X_BA` of `X_AB`."""
    r = x_ab[:3, :3].T
    return pose(r, -r @ x_ab[:3, 3])


def minimum_jerk(phase: float) -> float:
    """Progress 0 … 1 with zero velocity and acceleration at both ends (Flash and Hogan, 1985)."""
    t = min(max(phase, 0.0), 1.0)
    return t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
