"""Demonstration files: one demonstration a file, poses of the tool in B, frames beside them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge import files
from sim_bridge.errors import BridgeError
from sim_bridge.poses import (
    Array,
    inverse,
    pose_from_wire,
    quaternion_from_rotation,
    rotation_from_vector,
    vector_from_rotation,
)
from sim_bridge.settings import read_json, refused

SCHEMA = "tprmp-demonstration/1"
GRIPS = ("open", "closed")
COLUMNS = ["x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"]


@dataclass(frozen=True)
class Demonstration:
    """Tool poses at a constant rate, and the frames they belong to."""

    skill: str
    sampling_time_s: float
    frames: dict[str, Array]
    """`X_BF` of every frame, 4x4."""
    samples: Array
    """One row a sample: position [m], quaternion w x y z with a continuous sign."""
    gripper: list[str] | None = None
    """`open` or `closed`, one a sample, where it is known."""

    def grasp(self, goal_frame: str) -> Array:
        """`X_OE`: the last tool pose in the goal frame."""
        last = pose_from_wire(self.samples[-1, :3], self.samples[-1, 3:])
        return inverse(self.frames[goal_frame]) @ last


def continuous_quaternions(quaternions: Array) -> Array:
    """The same rotations with the signs that make neighbours near; the first one stays."""
    signs = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0, -1.0, 1.0)
    return quaternions * np.concatenate([[1.0], np.cumprod(signs)])[:, None]


def write_demonstration(file: Path, demonstration: Demonstration, *, force: bool = False) -> None:
    """Writes a demonstration with six decimals, one sample a line."""
    frames = {
        name: {
            "position_m": [_rounded(v) for v in x[:3, 3]],
            "quaternion_wxyz": [_rounded(v) for v in quaternion_from_rotation(x[:3, :3])],
        }
        for name, x in demonstration.frames.items()
    }
    head = {
        "schema": SCHEMA,
        "skill": demonstration.skill,
        "manifold": "R3xS3",
        "sampling_time_s": demonstration.sampling_time_s,
        "frames": frames,
        "columns": COLUMNS,
    }
    if demonstration.gripper is not None:
        head["gripper"] = demonstration.gripper
    lines = [f' "{key}": {json.dumps(value)},' for key, value in head.items()]
    rows = [json.dumps([_rounded(v) for v in row]) for row in demonstration.samples]
    body = "{\n" + "\n".join(lines) + '\n "samples": [\n  ' + ",\n  ".join(rows) + "\n ]\n}\n"
    files.write(file, body, force=force)


def _rounded(value: float) -> float:
    # Adding zero turns -0.0 into 0.0.
    return round(float(value), 6) + 0.0


def read_demonstration(file: Path) -> Demonstration:
    """Reads a demonstration of a pose; raises `BridgeError` naming file and key."""
    try:
        values = read_json(file)
        if values["schema"] != SCHEMA or values["columns"] != COLUMNS:
            raise BridgeError(
                f'{file}: expected schema "{SCHEMA}" and columns {COLUMNS}, found '
                f'"{values["schema"]}" and {values["columns"]}'
            )
        for key, names in (("skill", [values["skill"]]), ("frames", values["frames"])):
            for name in names:
                if not files.is_name(name):
                    raise refused(file, key, files.NAME, name)
        frames = {
            name: pose_from_wire(frame["position_m"], frame["quaternion_wxyz"])
            for name, frame in values["frames"].items()
        }
        samples = np.array(values["samples"], dtype=float).reshape(-1, len(COLUMNS))
        gripper = values.get("gripper")
        if gripper is not None and (
            len(gripper) != len(samples) or any(word not in GRIPS for word in gripper)
        ):
            raise refused(file, "gripper", f"{len(samples)} of {GRIPS}, one a sample", gripper)
        sampling_time_s = float(values["sampling_time_s"])
        return Demonstration(values["skill"], sampling_time_s, frames, samples, gripper)
    except KeyError as error:
        raise BridgeError(f"{file}: key {error} is missing") from error
    except (ValueError, TypeError) as error:
        raise BridgeError(f"{file}: is not a demonstration: {error}") from error


def demonstrated_grasp(folder: Path, goal_frame: str) -> Array:
    """`X_OE`: mean of the last tool poses in the goal frame, over every file of `folder`.

    The mean rotation is the Karcher mean: three steps from the first one, which suffice for
    rotations as near to each other as grasps of one kind are.
    """
    recorded = sorted(folder.glob("*.json"))
    if not recorded:
        raise BridgeError(f"{folder}: expected demonstrations (*.json): run `sim-bridge record`")
    grasps = []
    for file in recorded:
        demonstration = read_demonstration(file)
        if goal_frame not in demonstration.frames:
            raise BridgeError(f"{file}: `frames.{goal_frame}` is missing")
        grasps.append(demonstration.grasp(goal_frame))
    mean = grasps[0].copy()
    mean[:3, 3] = np.mean([grasp[:3, 3] for grasp in grasps], axis=0)
    for _ in range(3):
        away = [vector_from_rotation(mean[:3, :3].T @ grasp[:3, :3]) for grasp in grasps]
        mean[:3, :3] = mean[:3, :3] @ rotation_from_vector(np.mean(away, axis=0))
    return mean
