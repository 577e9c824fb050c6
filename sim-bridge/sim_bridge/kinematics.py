"""Kinematics of the chain from a robot description's root to one link, in double precision.

pybullet gives link poses in single precision: what is published, recorded or judged comes from
here. pybullet is the independent reference of the tests.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge.errors import BridgeError
from sim_bridge.poses import Array, pose, rotation_from_rpy, skew, vector_from_rotation

IK_ITERATIONS_MAX = 200
IK_TOLERANCE = 1e-10
IK_DAMPING = 1e-4


@dataclass(frozen=True)
class Segment:
    """One joint and the link behind it."""

    x_parent_joint: Array
    """Pose of the joint in its parent link."""
    axis: Array | None
    """Unit axis of a revolute joint; `None` when the joint is fixed."""


@dataclass(frozen=True)
class Chain:
    """Immutable model of a serial chain of revolute joints."""

    joint_names: tuple[str, ...]
    position_min_rad: Array
    position_max_rad: Array
    velocity_max_rad_s: Array
    effort_max_n_m: Array
    segments: tuple[Segment, ...]

    @property
    def joint_count(self) -> int:
        """Number of moving joints."""
        return len(self.joint_names)

    def position_fraction(self, q: Array) -> Array:
        """How far from the middle of their ranges joints at `q` [rad] are; 1 at a limit."""
        middle = 0.5 * (self.position_max_rad + self.position_min_rad)
        half = 0.5 * (self.position_max_rad - self.position_min_rad)
        return np.abs(q - middle) / half


def load_chain(urdf: Path, tip_link: str) -> Chain:
    """Reads the chain from the root link of `urdf` to `tip_link`.

    Raises `BridgeError` when the file cannot be read, the link is not there or a joint of the
    chain is neither revolute nor fixed or lacks its limits.
    """
    try:
        robot = ElementTree.parse(urdf).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise BridgeError(f"{urdf}: cannot be read as a robot description: {error}") from error
    by_child = {}
    for joint in robot.iter("joint"):
        child = joint.find("child")
        if child is not None:
            by_child[child.get("link")] = joint
    links = {link.get("name") for link in robot.iter("link")}
    if tip_link not in links:
        raise BridgeError(f"{urdf}: expected a link `{tip_link}`, found {sorted(map(str, links))}")
    joints = []
    link = tip_link
    while link in by_child and len(joints) <= len(links):
        joints.append(by_child[link])
        link = by_child[link].find("parent").get("link")
    joints.reverse()

    moving = []
    segments = []
    for joint in joints:
        origin = joint.find("origin")
        x_parent_joint = pose(rotation_from_rpy(*_numbers(origin, "rpy")), _numbers(origin, "xyz"))
        axis = None
        if joint.get("type") != "fixed":
            moving.append(joint)
            axis = joint.find("axis")
            axis = _numbers(axis, "xyz") if axis is not None else np.array([1.0, 0, 0])
            axis = axis / np.linalg.norm(axis)
        segments.append(Segment(x_parent_joint, axis))
    if not moving:
        raise BridgeError(f"{urdf}: no revolute joint between the root and `{tip_link}`")
    lower, upper, velocity, effort = np.array([_limits(joint, urdf) for joint in moving]).T
    names = tuple(joint.get("name") for joint in moving)
    return Chain(names, lower, upper, velocity, effort, tuple(segments))


def _limits(joint: ElementTree.Element, urdf: Path) -> list[float]:
    """Lower, upper, velocity and effort of a revolute joint."""
    name, kind, limit = joint.get("name"), joint.get("type"), joint.find("limit")
    if kind != "revolute" or limit is None:
        raise BridgeError(
            f"{urdf}: joint `{name}`: expected a fixed joint, or a revolute one with <limit>, "
            f"found type `{kind}`"
        )
    try:
        return [float(limit.get(key)) for key in ("lower", "upper", "velocity", "effort")]
    except (TypeError, ValueError) as error:
        raise BridgeError(
            f"{urdf}: joint `{name}`: <limit> expects lower, upper, velocity, effort"
        ) from error


def _numbers(element: ElementTree.Element | None, attribute: str) -> Array:
    text = None if element is None else element.get(attribute)
    return np.zeros(3) if text is None else np.array([float(part) for part in text.split()])


def forward(chain: Chain, q: Array) -> Array:
    """`X_BE`: pose of the tip in the root link's frame.

    `q` [rad] may have leading dimensions: then so has the result.
    """
    return segment_poses(chain, np.asarray(q, dtype=float))[-1]


def segment_poses(chain: Chain, q: Array) -> list[Array]:
    """Poses in the root link's frame of every link of the chain behind the root, for `q` [rad]."""
    x = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
    poses = []
    index = 0
    for segment in chain.segments:
        x = x @ segment.x_parent_joint
        if segment.axis is not None:
            # Rodrigues' formula, for every configuration at once.
            k = skew(segment.axis)
            angle = q[..., index, None, None]
            rotation = np.zeros((*q.shape[:-1], 4, 4))
            rotation[..., :3, :3] = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)
            rotation[..., 3, 3] = 1.0
            x = x @ rotation
            index += 1
        poses.append(x)
    return poses


def jacobian(chain: Chain, q: Array) -> Array:
    """6xN: velocity of the tip's origin [m/s] over angular velocity [rad/s], both in B."""
    poses = segment_poses(chain, np.asarray(q, dtype=float))
    p_tip = poses[-1][:3, 3]
    columns = []
    for segment, x in zip(chain.segments, poses):
        if segment.axis is not None:
            axis = x[:3, :3] @ segment.axis
            columns.append(np.concatenate([np.cross(axis, p_tip - x[:3, 3]), axis]))
    return np.array(columns).T


def inverse_kinematics(chain: Chain, x_be: Array, q_start: Array) -> Array:
    """Joint positions near `q_start` that put the tip at `x_be`, by damped least squares.

    Raises `BridgeError` when no such positions are found within the joint limits.
    """
    q = np.array(q_start, dtype=float)
    for _ in range(IK_ITERATIONS_MAX):
        x = forward(chain, q)
        error = np.concatenate(
            [x_be[:3, 3] - x[:3, 3], vector_from_rotation(x_be[:3, :3] @ x[:3, :3].T)]
        )
        if np.max(np.abs(error)) < IK_TOLERANCE:
            if np.any(q < chain.position_min_rad) or np.any(q > chain.position_max_rad):
                break
            return q
        j = jacobian(chain, q)
        # The damping fades with the error, so that the last steps are Newton's.
        damping = IK_DAMPING * min(1.0, float(np.linalg.norm(error)))
        step = j.T @ np.linalg.solve(j @ j.T + damping * np.eye(6), error)
        q += step * min(1.0, 0.5 / max(1e-12, float(np.max(np.abs(step)))))
    position = ", ".join(f"{value:.3f}" for value in x_be[:3, 3])
    raise BridgeError(f"the arm cannot reach the pose at ({position}) m within its joint limits")
