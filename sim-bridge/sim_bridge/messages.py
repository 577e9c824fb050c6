"""The shared-memory messages: ctypes mirrors of the Rust package `tprmp-messages`.

iceoryx2 compares only type name, size and alignment when a service is opened, so sizes are
asserted here at import, and every offset in the tests against the table that
`controller layout` prints.

Conventions: SI units, quaternions `w, x, y, z`, poses and velocities in the robot's base frame B.
"""

from __future__ import annotations

import ctypes
from enum import IntEnum

JOINT_CAPACITY = 8
FRAME_CAPACITY = 8
OBSTACLE_CAPACITY = 32
NAME_CAPACITY = 24

_Joints = ctypes.c_double * JOINT_CAPACITY
_Vector3 = ctypes.c_double * 3
_Quaternion = ctypes.c_double * 4


class GripperState(IntEnum):
    """What the gripper senses."""

    NONE = 0
    OPEN = 1
    HOLDING = 2


class GripperCommand(IntEnum):
    """What the gripper should do."""

    RELEASE = 0
    GRIP = 1


class CommandMode(IntEnum):
    """What kind of command this is."""

    STOP = 0
    TRACK = 1
    HOLD = 2


class LifeCycle(IntEnum):
    """The controller's life cycle."""

    WAITING = 0
    RUNNING = 1
    LIFTING = 2
    DONE = 3
    HOLDING = 4
    STOPPING = 5


class Reason(IntEnum):
    """Why the controller is not following its policy, or why that leads nowhere."""

    NONE = 0
    STATE_STALE = 1
    SEQUENCE_WENT_BACK = 2
    STATE_NOT_FINITE = 3
    JOINT_COUNT = 4
    FRAME_MISSING = 5
    FRAME_NOT_FINITE = 6
    QUATERNION_NOT_UNIT = 7
    OBSTACLE_UNKNOWN = 8
    FRAMES_STALE = 9
    RESOLVE_FAILED = 10
    COMMAND_NOT_FINITE = 11
    STOP_REQUESTED = 12
    JOINT_LIMIT = 13
    OVERRUN = 14
    STATE_UNBELIEVABLE = 15
    GRIPPER_UNKNOWN = 16
    BLOCKED = 17
    UNREACHABLE = 18


class ObstacleKind(IntEnum):
    """Shape of an obstacle."""

    SPHERE = 0
    HALF_SPACE = 1
    CAPSULE = 2
    BOX = 3


class RobotState(ctypes.Structure):
    """The state of the robot, from the bridge to the controller."""

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("joint_count", ctypes.c_uint32),
        ("gripper_state", ctypes.c_uint32),
        ("position", _Joints),
        ("velocity", _Joints),
        ("torque", _Joints),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "RobotStateV1"


class Frame(ctypes.Structure):
    """A named task frame in B."""

    _fields_ = [
        ("name", ctypes.c_uint8 * NAME_CAPACITY),
        ("valid", ctypes.c_uint32),
        ("padding", ctypes.c_uint32),
        ("position", _Vector3),
        ("quaternion", _Quaternion),
        ("linear_velocity", _Vector3),
        ("angular_velocity", _Vector3),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "FrameV1"


class Obstacle(ctypes.Structure):
    """A moving obstacle in B."""

    _fields_ = [
        ("kind", ctypes.c_uint32),
        ("valid", ctypes.c_uint32),
        ("position", _Vector3),
        ("quaternion", _Quaternion),
        ("linear_velocity", _Vector3),
        ("angular_velocity", _Vector3),
        ("size", _Vector3),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "ObstacleV2"


class TaskFrames(ctypes.Structure):
    """The task parameters: frames and obstacles, from the bridge to the controller."""

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("frame_count", ctypes.c_uint32),
        ("obstacle_count", ctypes.c_uint32),
        ("frames", Frame * FRAME_CAPACITY),
        ("obstacles", Obstacle * OBSTACLE_CAPACITY),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "TaskFramesV2"


class JointCommand(ctypes.Structure):
    """What the controller wants the robot to do."""

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("state_sequence", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("expiry_ns", ctypes.c_uint64),
        ("mode", ctypes.c_uint32),
        ("gripper_command", ctypes.c_uint32),
        ("joint_count", ctypes.c_uint32),
        ("reason", ctypes.c_uint32),
        ("position", _Joints),
        ("velocity", _Joints),
        ("acceleration", _Joints),
        ("torque", _Joints),
        ("gravity_torque", _Joints),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "JointCommandV1"


class ToolCommand(ctypes.Structure):
    """A velocity of the tool in B that somebody outside wishes for, beside the skill."""

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("linear_velocity", _Vector3),
        ("angular_velocity", _Vector3),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "ToolCommandV1"


class ControllerStatus(ctypes.Structure):
    """How the controller is doing, once a tick."""

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("life_cycle", ctypes.c_uint32),
        ("reason", ctypes.c_uint32),
        ("ticks", ctypes.c_uint64),
        ("deadline_misses", ctypes.c_uint64),
        ("skipped_periods", ctypes.c_uint64),
        ("allocations", ctypes.c_uint64),
        ("connections", ctypes.c_uint64),
        ("period_ns", ctypes.c_uint64),
        ("wake_up_ns", ctypes.c_uint64),
        ("state_age_ns", ctypes.c_uint64),
        ("receiving_ns", ctypes.c_uint64),
        ("evaluation_ns", ctypes.c_uint64),
        ("publishing_ns", ctypes.c_uint64),
        ("goal_distance_m", ctypes.c_double),
        ("goal_angle_rad", ctypes.c_double),
        ("energy_j", ctypes.c_double),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "ControllerStatusV2"


MESSAGES = {
    "RobotState": (RobotState, 216),
    "TaskFrames": (TaskFrames, 5464),
    "Frame": (Frame, 136),
    "Obstacle": (Obstacle, 136),
    "JointCommand": (JointCommand, 368),
    "ToolCommand": (ToolCommand, 64),
    "ControllerStatus": (ControllerStatus, 136),
}
"""Every message with the size [bytes] the other side was told."""

for _name, (_type, _size) in MESSAGES.items():
    assert ctypes.sizeof(_type) == _size, f"{_name}: {ctypes.sizeof(_type)} bytes, not {_size}"
    assert ctypes.alignment(_type) == 8, _name


def layout() -> list[dict[str, object]]:
    """Message, field, offset [bytes] and size [bytes] of every field, in order."""
    return [
        {
            "message": name,
            "field": field[0],
            "offset": getattr(message, field[0]).offset,
            "size": getattr(message, field[0]).size,
        }
        for name, (message, _) in MESSAGES.items()
        for field in message._fields_
    ]


def write_name(frame: Frame, name: str) -> None:
    """Writes a frame's name, padded with zeros."""
    data = name.encode()
    assert 0 < len(data) <= NAME_CAPACITY, f"frame name `{name}`"
    frame.name[:] = data.ljust(NAME_CAPACITY, b"\0")


def read_name(frame: Frame) -> str:
    """Reads a frame's name."""
    return bytes(frame.name).split(b"\0", 1)[0].decode()
