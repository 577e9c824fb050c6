"""The shared-memory messages, and what is done with them beyond their layout.

`wire.py` is what `controller layout --format python` prints: a test compares the two.

Conventions: SI units, quaternions `w x y z`, poses and velocities in the robot's base frame B.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from sim_bridge.wire import (
    FRAME_CAPACITY as FRAME_CAPACITY,
    JOINT_CAPACITY as JOINT_CAPACITY,
    NAME_CAPACITY as NAME_CAPACITY,
    CommandMode as CommandMode,
    ControlAnswer as ControlAnswer,
    ControllerStatus as ControllerStatus,
    ControlRequest as ControlRequest,
    Frame as Frame,
    GripperCommand as GripperCommand,
    GripperState as GripperState,
    JointCommand as JointCommand,
    LifeCycle as LifeCycle,
    Obstacle as Obstacle,
    ObstacleKind as ObstacleKind,
    Reason as Reason,
    RobotMode as RobotMode,
    RobotState as RobotState,
    TaskFrames as TaskFrames,
    ToolCommand as ToolCommand,
)


def reason_name(reason: int) -> str:
    """The name of a `Reason` in reports; of one that is unknown, its number."""
    return Reason(reason).name.lower() if reason in frozenset(Reason) else f"reason {reason}"


def joint_names_hash(names: Iterable[str]) -> int:
    """What `RobotState.joint_names_hash` is for joints of these names in this order; never 0.

    FNV-1a of 64 bits over each name's UTF-8 and a zero: the same as in `controller/messages`.
    """
    value = 0xCBF29CE484222325
    for byte in b"".join(name.encode() + b"\0" for name in names):
        value = ((value ^ byte) * 0x100000001B3) % 2**64
    return max(value, 1)


def write_name(frame: Frame, name: str) -> None:
    """Writes a frame's name, padded with zeros."""
    frame.name[:] = name_bytes(name)


def place(
    frame: Frame,
    name: str,
    position: Sequence[float],
    quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
) -> None:
    """Makes it a valid frame of this name at rest, at a position [m] and a quaternion w x y z."""
    write_name(frame, name)
    frame.valid, frame.position[:], frame.quaternion[:] = 1, position, quaternion
    frame.linear_velocity[:] = frame.angular_velocity[:] = (0.0, 0.0, 0.0)


def place_obstacle(obstacle: Obstacle, kind: ObstacleKind, size: Sequence[float] = ()) -> None:
    """Makes it a valid obstacle of this kind and sizes [m], upright where the base is."""
    obstacle.kind, obstacle.valid = kind, 1
    obstacle.quaternion[:] = (1.0, 0.0, 0.0, 0.0)
    obstacle.size[: len(size)] = size


def name_bytes(name: str) -> bytes:
    """A name as it is on the wire, padded with zeros: of a frame, or of a source of frames."""
    data = name.encode()
    assert 0 < len(data) <= NAME_CAPACITY, f"name `{name}`: expected 1 to {NAME_CAPACITY} bytes"
    return data.ljust(NAME_CAPACITY, b"\0")


def read_name(frame: Frame) -> str:
    """Reads a frame's name."""
    return bytes(frame.name).split(b"\0", 1)[0].decode()
