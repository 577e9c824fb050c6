"""Runs the server that stands in for a robot, with a gripper that seals on an object."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge.cell import CellFrames
from sim_bridge.errors import BridgeError
from sim_bridge.kinematics import forward
from sim_bridge.poses import rotation_from_quaternion
from sim_bridge.priority import real_time
from sim_bridge.services import StopSignal
from sim_bridge.ur.arm import JOINTS, Arm
from sim_bridge.ur.server import Server

RATES_HZ = {"cb3": 125.0, "e": 500.0}
BESIDE_MAX_M = 0.015
TILT_MAX_RAD = math.radians(10.0)


@dataclass(frozen=True)
class Options:
    """What the command line asked for."""

    host: str
    series: str
    home_rad: list[float]
    scene: Path | None
    seals: list[str] | None


def seal_rule(cell: CellFrames, name: str, height_m: float) -> Callable[[Arm], int]:
    """Digital input 0 of an arm whose output 0 switches a vacuum.

    The cup seals once it touches: while the vacuum is on, with the tip no higher than `height_m`
    above the frame's origin along its z, no farther than 15 mm beside that axis, and tilted by less
    than 10°. It holds until the vacuum is switched off.
    """
    chain = cell.chain
    found = [frame for frame in cell.fixed if frame.name == name]
    if not found:
        known = ", ".join(frame.name for frame in cell.fixed) or "none"
        raise BridgeError(f"--seals: expected a frame of the scene ({known}), found `{name}`")
    origin = np.array(found[0].position_m)
    r_bo = rotation_from_quaternion(np.array(found[0].quaternion_wxyz))

    def rule(arm: Arm) -> int:
        if not arm.outputs & 1:
            return 0
        if arm.inputs & 1:
            return 1
        x_be = forward(chain, np.array(arm.actual_q))
        x, y, z = r_bo.T @ (x_be[:3, 3] - origin)
        upright = -float(x_be[:3, 2] @ r_bo[:, 2]) > math.cos(TILT_MAX_RAD)
        return int(z <= height_m and math.hypot(x, y) <= BESIDE_MAX_M and upright)

    return rule


def stand_in(options: Options) -> int:
    """Serves until a signal comes; gives the exit code."""
    if len(options.home_rad) != JOINTS or not all(map(math.isfinite, options.home_rad)):
        raise BridgeError(f"--home-rad: expected {JOINTS} numbers, found {options.home_rad}")
    arm = Arm(RATES_HZ[options.series], options.home_rad)
    if options.seals is None and options.scene is not None:
        raise BridgeError("--scene is read for --seals alone: give both, or none")
    if options.seals is not None:
        if options.scene is None:
            raise BridgeError("--seals needs --scene: where the frame is stands in it")
        name, height = options.seals
        try:
            height_m = float(height)
        except ValueError as error:
            raise BridgeError(f"--seals: expected a height [m], found `{height}`") from error
        arm.rule = seal_rule(CellFrames(options.scene), name, height_m)
    with StopSignal() as stop, Server(options.host, arm) as server, real_time(None) as how:
        print(
            f"{options.host}: stands in for a UR at {server.rate_hz} Hz, {how}; Ctrl-C ends it",
            flush=True,
        )
        server.run(lambda: stop.requested)
    for message in arm.messages:
        print(message)
    return 0
