"""The shared-memory messages: ctypes mirrors of the Rust package `tprmp-messages`.

iceoryx2 compares only type name, size and alignment when a service is opened, so sizes are
asserted here at import, and every offset in the tests against the table that
`controller layout` prints.

Conventions: SI units, quaternions `w, x, y, z`, poses and velocities in the robot's base frame B.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from enum import IntEnum

JOINT_CAPACITY = 8
FRAME_CAPACITY = 8
OBSTACLE_CAPACITY = 32
NAME_CAPACITY = 24
TEXT_CAPACITY = 1000

_U32, _U64 = ctypes.c_uint32, ctypes.c_uint64
_Joints = ctypes.c_double * JOINT_CAPACITY
_Vector3 = ctypes.c_double * 3
_Quaternion = ctypes.c_double * 4


def _all(kind: type, names: str) -> list[tuple[str, type]]:
    return [(name, kind) for name in names.split()]


class GripperState(IntEnum):
    """What the gripper senses."""

    NONE = 0
    OPEN = 1
    HOLDING = 2


class RobotMode(IntEnum):
    """What the robot itself is doing."""

    RUNNING = 0
    PROTECTIVE_STOP = 1
    EMERGENCY_STOP = 2
    HAND_GUIDING = 3
    FAULT = 4


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
    READY = 6
    FAULT = 7


class Reason(IntEnum):
    """Why the controller does not follow its policy, or makes no progress with it."""

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
    STATE_UNCONFIRMED = 19
    SEQUENCE_STUCK = 20
    STATE_TIME_STUCK = 21
    STATE_CLOCK = 22
    VELOCITY_UNBELIEVABLE = 23
    STATES_LOST = 24
    COMMAND_EXPIRED = 25
    TWO_SOURCES = 26
    PROTECTIVE_STOP = 27
    EMERGENCY_STOP = 28
    HAND_GUIDING = 29
    ROBOT_FAULT = 30
    SAFETY_STOP = 31
    START_NOT_REQUESTED = 32
    HOLD_REQUESTED = 33
    ENDED_UNEXPECTEDLY = 34
    ARM_ELSEWHERE = 35
    GRIPPER_HOLDS = 36
    JOINT_ORDER = 37
    POSITIONS_FROZEN = 38
    PUBLISHER_NOT_IN_LOCKSTEP = 39
    FRAME_COUNT = 40
    FRAME_FAR = 41
    QUATERNION_ORDER = 42
    OBSTACLE_COUNT = 43
    OBSTACLE_SIZE = 44
    OBSTACLE_QUATERNION = 45
    GRIPPER_NONE = 46
    GRIPPER_AWAITED = 47
    FRAME_TWICE = 48


class ObstacleKind(IntEnum):
    """Shape of an obstacle."""

    SPHERE = 0
    HALF_SPACE = 1
    CAPSULE = 2
    BOX = 3


class _Message(ctypes.Structure):
    WIRE_NAME: str

    @classmethod
    def type_name(cls) -> str:
        """Name on the wire."""
        return cls.WIRE_NAME


class RobotState(_Message):
    """The state of the robot, from the bridge to the controller."""

    WIRE_NAME = "RobotStateV3"
    _fields_ = [
        *_all(_U64, "sequence time_ns"),
        *_all(_U32, "joint_count gripper_state robot_mode safety_stop"),
        ("joint_names_hash", _U64),
        *_all(_Joints, "position velocity torque"),
    ]


class Frame(_Message):
    """A named task frame in B."""

    WIRE_NAME = "FrameV1"
    _fields_ = [
        ("name", ctypes.c_uint8 * NAME_CAPACITY),
        *_all(_U32, "valid padding"),
        ("position", _Vector3),
        ("quaternion", _Quaternion),
        *_all(_Vector3, "linear_velocity angular_velocity"),
    ]


class Obstacle(_Message):
    """A moving obstacle in B."""

    WIRE_NAME = "ObstacleV2"
    _fields_ = [
        *_all(_U32, "kind valid"),
        ("position", _Vector3),
        ("quaternion", _Quaternion),
        *_all(_Vector3, "linear_velocity angular_velocity size"),
    ]


class TaskFrames(_Message):
    """The task parameters: frames and obstacles, from the bridge to the controller."""

    WIRE_NAME = "TaskFramesV3"
    _fields_ = [
        *_all(_U64, "sequence time_ns"),
        ("source", ctypes.c_uint8 * NAME_CAPACITY),
        *_all(_U32, "frame_count obstacle_count"),
        ("frames", Frame * FRAME_CAPACITY),
        ("obstacles", Obstacle * OBSTACLE_CAPACITY),
    ]


class JointCommand(_Message):
    """What the controller wants the robot to do."""

    WIRE_NAME = "JointCommandV1"
    _fields_ = [
        *_all(_U64, "sequence state_sequence time_ns expiry_ns"),
        *_all(_U32, "mode gripper_command joint_count reason"),
        *_all(_Joints, "position velocity acceleration torque gravity_torque"),
    ]


class ToolCommand(_Message):
    """The velocity of the tool in B that is commanded from outside, beside the skill."""

    WIRE_NAME = "ToolCommandV1"
    _fields_ = [
        *_all(_U64, "sequence time_ns"),
        *_all(_Vector3, "linear_velocity angular_velocity"),
    ]


class ControlRequest(_Message):
    """What somebody asks of a controller."""

    WIRE_NAME = "ControlRequestV1"
    _fields_ = [
        *_all(_U32, "verb padding"),
        ("value", ctypes.c_double),
        ("text", ctypes.c_uint8 * TEXT_CAPACITY),
    ]


class ControlAnswer(_Message):
    """What the controller answers."""

    WIRE_NAME = "ControlAnswerV1"
    _fields_ = [
        *_all(_U32, "accepted life_cycle reason padding"),
        ("text", ctypes.c_uint8 * TEXT_CAPACITY),
    ]


class ControllerStatus(_Message):
    """How the controller is doing, once a tick."""

    WIRE_NAME = "ControllerStatusV3"
    _fields_ = [
        *_all(_U64, "sequence time_ns"),
        *_all(_U32, "life_cycle reason"),
        *_all(_U64, "ticks deadline_misses skipped_periods states_lost"),
        *_all(_U64, "allocations connections period_ns"),
        *_all(_U64, "wake_up_ns state_age_ns receiving_ns evaluation_ns publishing_ns"),
        *_all(ctypes.c_double, "goal_distance_m goal_angle_rad energy_j"),
    ]


MESSAGES = {
    "RobotState": (RobotState, 232),
    "TaskFrames": (TaskFrames, 5488),
    "Frame": (Frame, 136),
    "Obstacle": (Obstacle, 136),
    "JointCommand": (JointCommand, 368),
    "ControlRequest": (ControlRequest, 1016),
    "ControlAnswer": (ControlAnswer, 1016),
    "ToolCommand": (ToolCommand, 64),
    "ControllerStatus": (ControllerStatus, 144),
}
"""Every message with its size on the wire [bytes]."""

for _name, (_type, _size) in MESSAGES.items():
    assert ctypes.sizeof(_type) == _size, f"{_name}: {ctypes.sizeof(_type)} bytes, not {_size}"
    assert ctypes.alignment(_type) <= 8, _name


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


def name_bytes(name: str) -> bytes:
    """A name as it is on the wire, padded with zeros: of a frame, or of a source of frames."""
    data = name.encode()
    assert 0 < len(data) <= NAME_CAPACITY, f"name `{name}`: expected 1 to {NAME_CAPACITY} bytes"
    return data.ljust(NAME_CAPACITY, b"\0")


def read_name(frame: Frame) -> str:
    """Reads a frame's name."""
    return bytes(frame.name).split(b"\0", 1)[0].decode()
