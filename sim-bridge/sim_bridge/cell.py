"""The file of a robot's cell: which arm, and the frames that stand still around it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge import settings
from sim_bridge.errors import BridgeError
from sim_bridge.kinematics import Chain, forward, load_chain
from sim_bridge.messages import (
    FRAME_CAPACITY,
    Frame,
    ObstacleKind,
    TaskFrames,
    place,
    place_obstacle,
)
from sim_bridge.poses import quaternion_from_rotation

SCHEMA = "tprmp-cell/1"
NORM_TOLERANCE = 1e-3
"""By how much a quaternion's norm may differ from 1: it is made one exactly."""


def _is_quaternion(value: object) -> bool:
    if not settings.are_numbers(value, 4):
        return False
    return abs(float(np.linalg.norm(value)) - 1.0) < NORM_TOLERANCE


@dataclass(frozen=True)
class FixedFrame:
    """A frame that stands still, in the robot's base frame B."""

    name: str = settings.name()
    position_m: tuple[float, ...] = settings.key(
        "three numbers", lambda value: settings.are_numbers(value, 3), settings.floats
    )
    quaternion_wxyz: tuple[float, ...] = settings.key(
        "a quaternion w x y z of unit length", _is_quaternion, settings.floats
    )


@dataclass(frozen=True)
class Cell:
    """A cell file, checked."""

    schema: str = settings.key(f'"{SCHEMA}"', lambda value: value == SCHEMA, str)
    urdf: Path = settings.path()
    tip_link: str = settings.text()
    start_frame: str = settings.name()
    """Where the tool was before the arm moved: published beside the frames of the file."""
    table_height_m: float = settings.number(-10.0, 10.0)
    """Height of the table's top in B: what is below is an obstacle."""
    frames: list = settings.key(
        f"a list of at most {FRAME_CAPACITY - 1} frames",
        lambda value: isinstance(value, list) and len(value) < FRAME_CAPACITY,
        list,
    )


class CellFrames:
    """The frames of a cell as they are published, and the arm's kinematics."""

    def __init__(self, file: Path) -> None:
        self.cell = settings.section(Cell, file, "", settings.read_json(file))
        self.fixed = [
            settings.section(FixedFrame, file, f"frames[{i}]", values)
            for i, values in enumerate(self.cell.frames)
        ]
        names = [self.cell.start_frame, *(frame.name for frame in self.fixed)]
        if len(set(names)) < len(names):
            raise BridgeError(f"{file}: `frames`: expected a name once, found {', '.join(names)}")
        self.chain: Chain = load_chain(self.cell.urdf, self.cell.tip_link)
        self.message = TaskFrames(frame_count=len(names), obstacle_count=1)
        place(self.message.frames[0], self.cell.start_frame, (0.0, 0.0, 0.0))
        for frame, at in zip(self.message.frames[1:], self.fixed):
            place(frame, at.name, at.position_m, _unit(at.quaternion_wxyz))
        table = self.message.obstacles[0]
        place_obstacle(table, ObstacleKind.HALF_SPACE)
        table.position[2] = self.cell.table_height_m

    def start_at(self, position_rad: list[float]) -> None:
        """Puts the start frame where the tool is with the joints at `position_rad` [rad]."""
        x_tool = forward(self.chain, np.array(position_rad))
        quaternion = quaternion_from_rotation(x_tool[:3, :3])
        start: Frame = self.message.frames[0]
        place(start, self.cell.start_frame, x_tool[:3, 3].tolist(), _unit(quaternion))


def _unit(quaternion: Iterable[float]) -> list[float]:
    values = np.array(tuple(quaternion))
    return (values / np.linalg.norm(values)).tolist()
