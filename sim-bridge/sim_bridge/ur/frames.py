"""The file of fixed task frames that a robot's publisher publishes.

Poses are in B, the root link of the robot description. Where that is ROS' `base_link`, the `Base`
of a UR's own pendant is turned against it by π about z.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge import settings
from sim_bridge.kinematics import Chain, forward, load_chain
from sim_bridge.messages import FRAME_CAPACITY, ObstacleKind, TaskFrames, write_name
from sim_bridge.poses import quaternion_from_rotation

SCHEMA = "tprmp-frames/1"
UNIT_TOLERANCE = 1e-3


def _is_unit(value: object) -> bool:
    return settings.are_numbers(value, 4) and abs(np.linalg.norm(value) - 1.0) <= UNIT_TOLERANCE


@dataclass(frozen=True)
class FixedFrame:
    """A frame that stays where it is."""

    name: str = settings.name()
    position_m: tuple[float, float, float] = settings.key(
        "three numbers", lambda value: settings.are_numbers(value, 3), settings.floats
    )
    quaternion_wxyz: tuple[float, float, float, float] = settings.key(
        "four numbers of norm 1", _is_unit, settings.floats
    )


@dataclass(frozen=True)
class FixedFrames:
    """What stands in the file."""

    schema: str = settings.key(f'"{SCHEMA}"', lambda value: value == SCHEMA, str)
    urdf: Path = settings.path()
    tip_link: str = settings.text()
    start_frame: str = settings.name()
    """Where the tip is at the start."""
    table_height_m: float = settings.number(-10.0, 10.0)
    """Below it is no room for the arm: a half-space, published as an obstacle."""
    frames: list = settings.key(
        f"a list of at most {FRAME_CAPACITY - 1} objects",
        lambda value: isinstance(value, list) and len(value) < FRAME_CAPACITY,
        list,
    )

    def chain(self) -> Chain:
        """The arm of the description."""
        return load_chain(self.urdf, self.tip_link)

    def message(self, q: list[float], chain: Chain) -> TaskFrames:
        """The frames as they are published, of an arm that starts at `q` [rad]."""
        x_start = forward(chain, np.array(q))
        start = FixedFrame(
            self.start_frame,
            tuple(x_start[:3, 3].tolist()),
            tuple(quaternion_from_rotation(x_start[:3, :3]).tolist()),
        )
        message = TaskFrames(frame_count=1 + len(self.frames), obstacle_count=1)
        for frame, fixed in zip(message.frames, [start, *self.frames]):
            write_name(frame, fixed.name)
            norm = float(np.linalg.norm(fixed.quaternion_wxyz))
            frame.valid = 1
            frame.position[:] = fixed.position_m
            frame.quaternion[:] = [part / norm for part in fixed.quaternion_wxyz]
        table = message.obstacles[0]
        table.kind, table.valid = ObstacleKind.HALF_SPACE, 1
        table.position[2] = self.table_height_m
        table.quaternion[0] = 1.0
        return message


def load_frames(file: Path) -> FixedFrames:
    """Reads and checks the file; raises `BridgeError` naming file, key and expectation."""
    fixed = settings.section(FixedFrames, file, "", settings.read_json(file))
    names = [fixed.start_frame]
    for i, values in enumerate(fixed.frames):
        frame = settings.section(FixedFrame, file, f"frames[{i}]", values)
        if frame.name in names:
            raise settings.refused(file, f"frames[{i}].name", "another name", frame.name)
        names.append(frame.name)
        fixed.frames[i] = frame
    return fixed
