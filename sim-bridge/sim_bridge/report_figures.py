"""The figures of a report: judged again from the log, and read from the controller's summary."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge.demonstrations import Demonstration, demonstrated_grasp, read_demonstration
from sim_bridge.errors import BridgeError
from sim_bridge.evaluate import clearances, evaluate
from sim_bridge.log import BRIDGE_FILE, LOG_FILE, Log, load
from sim_bridge.messages import GripperState
from sim_bridge.poses import (
    Array,
    inverse,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from sim_bridge.scene import Scene, draw_episode, load_scene
from sim_bridge.world import World

CONTROLLER_FILE = "controller.json"
TIMES = ("tick_us", "wake_up_us", "state_age_us")
BODIES = ("sphere", "table", "self")
LIMITS = ("position", "velocity", "torque")


@dataclass(frozen=True)
class Run:
    """A recorded run, and everything the report says about it."""

    scene: Scene
    log: Log
    bridge: dict
    controller: dict | None
    controller_file: Path
    demonstrations: list[Demonstration]
    grasp: Array
    """`X_OE` as demonstrated, mean."""
    judged: dict
    """See `sim_bridge.evaluate.evaluate`."""
    clearance_time_s: Array
    clearance_m: dict[str, Array]
    """Least distance to `sphere`, `table` and `self` at `clearance_time_s`."""
    position_error_m: Array
    """Of the tool against `grasp`, in the object frame, every row of the log."""
    orientation_error_rad: Array
    path_in_object_m: Array
    """The tool's tip in the object frame, every row of the log."""
    joint_names: tuple[str, ...]
    velocity_max_rad_s: Array
    effort_max_n_m: Array

    @property
    def gripped_row(self) -> int | None:
        """First row with the vacuum sealed."""
        holding = self.log["gripper_state"] == GripperState.HOLDING
        return int(np.argmax(holding)) if np.any(holding) else None


def load_run(folder: Path) -> Run:
    """Reads a run's folder and judges it; raises `BridgeError` saying what is wrong with it."""
    log, bridge = _load_log(folder)
    scene = load_scene(_scene_file(folder, bridge))
    demonstrations = [
        read_demonstration(f) for f in sorted(scene.task.demonstrations.glob("*.json"))
    ]
    grasp = demonstrated_grasp(scene.task.demonstrations, scene.task.goal_frame)
    world = World(scene, draw_episode(scene, bridge["seed"]))
    try:
        chain = world.chain
        _check_shapes(folder / LOG_FILE, log, chain.joint_count)
        judged = evaluate(scene, world, log, grasp)
        replay = list(clearances(world, log))
    finally:
        world.close()
    rows = [row for row, _ in replay]
    position_error, orientation_error, path = grasp_errors(log, grasp)
    return Run(
        scene=scene,
        log=log,
        bridge=bridge,
        controller=_load_controller(folder / CONTROLLER_FILE),
        controller_file=folder / CONTROLLER_FILE,
        demonstrations=demonstrations,
        grasp=grasp,
        judged=judged,
        clearance_time_s=log["time_s"][rows],
        clearance_m={body: np.array([now[body][0] for _, now in replay]) for body in BODIES},
        position_error_m=position_error,
        orientation_error_rad=orientation_error,
        path_in_object_m=path,
        joint_names=chain.joint_names,
        velocity_max_rad_s=chain.velocity_max_rad_s,
        effort_max_n_m=chain.effort_max_n_m,
    )


def _load_log(folder: Path) -> tuple[Log, dict]:
    log, bridge = load(folder)
    for key, kind in (("scene", str), ("seed", int), ("mode", str), ("outcome", str)):
        if not isinstance(bridge.get(key), kind):
            raise BridgeError(
                f"{folder / BRIDGE_FILE}: `{key}`: expected {kind.__name__}, found "
                f"{bridge.get(key)!r}"
            )
    timing = bridge.get("timing")
    factor = timing.get("real_time_factor") if isinstance(timing, dict) else None
    if not isinstance(factor, (int, float)):
        raise BridgeError(
            f"{folder / BRIDGE_FILE}: `timing.real_time_factor`: expected a number, found {factor}"
        )
    return log, bridge


def _scene_file(folder: Path, bridge: dict) -> Path:
    file = Path(bridge["scene"])
    if not file.exists():
        raise BridgeError(
            f"{folder / BRIDGE_FILE}: `scene`: {file} is not there: start the report in the "
            "folder in which the run was started"
        )
    return file


def _check_shapes(file: Path, log: Log, joint_count: int) -> None:
    rows = len(np.atleast_1d(log["time_s"]))
    if rows < 2:
        raise BridgeError(f"{file}: expected at least 2 rows, found {rows}: the arm never moved")
    widths = {
        **dict.fromkeys(("position_rad", "velocity_rad_s", "torque_n_m"), (joint_count,)),
        "gravity_torque_n_m": (joint_count,),
        **dict.fromkeys(("object_position_m", "sphere_position_m", "tool_position_m"), (3,)),
        **dict.fromkeys(("object_quaternion_wxyz", "tool_quaternion_wxyz"), (4,)),
        **dict.fromkeys(("time_s", "gripper_state", "contact_sphere", "lateness_s"), ()),
    }
    for key, width in widths.items():
        found = log[key].shape if key in log else None
        if found != (rows, *width):
            raise BridgeError(
                f"{file}: `{key}`: expected the shape {(rows, *width)}, found {found}"
            )
        # Torques are NaN while the arm is braked.
        if "torque" not in key and not np.all(np.isfinite(log[key])):
            raise BridgeError(f"{file}: `{key}`: expected finite numbers only")


def _load_controller(file: Path) -> dict | None:
    """The controller's summary; `None` when there is none."""
    try:
        summary = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise BridgeError(f"{file}: cannot be read as the controller's summary: {error}") from error
    if not isinstance(summary, dict):
        raise BridgeError(f"{file}: expected an object, found {type(summary).__name__}")
    for key in ("ticks", "deadline_misses", "allocations"):
        if not isinstance(summary.get(key), int):
            raise BridgeError(f"{file}: `{key}`: expected a whole number, found {summary.get(key)}")
    for key in TIMES:
        for name in ("p50", "p99", "max"):
            value = _item(_item(summary, key), name)
            if not isinstance(value, (int, float)):
                raise BridgeError(f"{file}: `{key}.{name}`: expected a number, found {value}")
        buckets = _item(_item(summary, "histograms"), key)
        if not _are_buckets(buckets):
            raise BridgeError(
                f"{file}: `histograms.{key}`: expected a list of [upper end in µs, count]"
            )
    return summary


def _item(value: object, key: str) -> object:
    return value.get(key) if isinstance(value, dict) else None


def _are_buckets(value: object) -> bool:
    return isinstance(value, list) and all(
        isinstance(bucket, list)
        and len(bucket) == 2
        and all(isinstance(number, (int, float)) and number > 0 for number in bucket)
        for bucket in value
    )


def grasp_errors(log: Log, grasp: Array) -> tuple[Array, Array, Array]:
    """Distance [m] and angle [rad] of the tool from `grasp`, and the tip in the object frame [m].

    All rows at once; the angle is that of the relative quaternion, 2 atan2(|v|, |w|).
    """
    r_ob = np.array([rotation_from_quaternion(q).T for q in log["object_quaternion_wxyz"]])
    offset = log["tool_position_m"] - log["object_position_m"]
    path = np.einsum("nij,nj->ni", r_ob, offset)
    goal = quaternion_from_rotation(grasp[:3, :3])
    # q_error = q_goal* ⊗ q_object* ⊗ q_tool
    error = _product(
        _conjugate(goal)[None],
        _product(_conjugate(log["object_quaternion_wxyz"]), log["tool_quaternion_wxyz"]),
    )
    angle = 2.0 * np.arctan2(np.linalg.norm(error[:, 1:], axis=1), np.abs(error[:, 0]))
    return np.linalg.norm(path - grasp[:3, 3], axis=1), angle, path


def _conjugate(quaternion: Array) -> Array:
    return quaternion * [1.0, -1.0, -1.0, -1.0]


def _product(a: Array, b: Array) -> Array:
    """Hamilton product, row by row."""
    w = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    v = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.hstack([w, v])


def demonstrated_path(demonstration: Demonstration, goal_frame: str) -> Array:
    """The demonstrated tip in the goal frame [m]."""
    x_ob = inverse(demonstration.frames[goal_frame])
    points = demonstration.samples[:, :3]
    return points @ x_ob[:3, :3].T + x_ob[:3, 3]


def plain(name: str) -> str:
    """The name of a link or joint for people."""
    return name.removesuffix("_joint").replace("_", " ")


def failures(run: Run) -> list[str]:
    """Why the pick counts as failed, a sentence each; empty when it succeeded."""
    judged, task, sentences = run.judged, run.scene.task, []
    if run.bridge["outcome"] != "lifted":
        sentences.append(f'The run ended with the outcome "{run.bridge["outcome"]}".')
    if not judged["gripped"]:
        sentences.append("The box was not gripped.")
    elif judged["lifted_m"] < task.lift_height_m:
        sentences.append(
            f"The box was lifted by {1e3 * judged['lifted_m']:.0f} mm, not by the wanted "
            f"{1e3 * task.lift_height_m:.0f} mm."
        )
    elif judged["held_s"] < task.hold_time_s - 1e-9:
        sentences.append(
            f"The box was held up for {judged['held_s']:.2f} s, not for the wanted "
            f"{task.hold_time_s:.2f} s."
        )
    touched = {
        "sphere": judged["sphere_touched"],
        "table": judged["clearance_table_m"] <= 0.0,
        "self": judged["clearance_self_m"] <= 0.0,
    }
    names = {"sphere": "the sphere", "table": "the table", "self": "itself"}
    for body, contact in touched.items():
        if contact:
            where = plain(judged[f"clearance_{body}_where"])
            least = 1e3 * judged[f"clearance_{body}_m"]
            sentences.append(
                f"The arm touched {names[body]} (least distance {least:.1f} mm: {where})."
            )
    for limit in LIMITS:
        used = judged[f"{limit}_limit_used"]
        if used is not None and used > 1.0:
            sentences.append(f"A joint {limit} went to {100 * used:.0f} % of its limit.")
    clamped = run.bridge["timing"].get("clamped_steps", 0)
    if clamped:
        sentences.append(f"The controller asked for more than the torque limit in {clamped} steps.")
    sentences += _controller_failures(run)
    if not sentences and not judged["success"]:
        sentences.append("The run was judged a failure.")
    return sentences


def _controller_failures(run: Run) -> list[str]:
    if run.controller is None:
        return [f"The controller left no summary: {run.controller_file} is missing."]
    allocations = run.controller["allocations"]
    if allocations:
        return [f"The controller's loop allocated memory on the heap {allocations} times."]
    return []


def result(run: Run) -> dict[str, object]:
    """What goes into `result.json`; a figure that does not exist is `None`."""
    judged, controller = run.judged, run.controller or {}
    distances = {body: judged[f"clearance_{body}_m"] for body in BODIES}
    fractions = {limit: judged[f"{limit}_limit_used"] for limit in LIMITS}
    known = [value for value in fractions.values() if value is not None]
    sentences = failures(run)

    def times(key: str) -> dict[str, float] | None:
        if key not in controller:
            return None
        return {name: controller[key][name] for name in ("p50", "p99", "max")}

    values: dict[str, object] = {
        "success": not sentences,
        "seed": run.bridge["seed"],
        "position_error_mm": judged["position_error_mm"],
        "orientation_error_deg": judged["orientation_error_deg"],
        "clearance_min_mm": 1e3 * min(distances.values()),
        "clearance_mm": {body: 1e3 * distance for body, distance in distances.items()},
        "limit_fraction_max": max(known) if known else None,
        "limit_fractions": fractions,
        "tick_us": times("tick_us"),
        "state_age_us": times("state_age_us"),
        "ticks": controller.get("ticks"),
        "deadline_misses": controller.get("deadline_misses"),
        "allocations": controller.get("allocations"),
        "real_time_factor": run.bridge["timing"].get("real_time_factor"),
    }
    if sentences:
        values["failures"] = sentences
    return {key: _rounded(value) for key, value in values.items()}


def _rounded(value: object) -> object:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value


def table(run: Run, values: dict) -> list[tuple[str, str, str]]:
    """Rows of the table: what, value with unit, remark."""
    judged, timing = run.judged, run.bridge["timing"]

    def number(value: float | None, form: str, unit: str) -> str:
        return "–" if value is None else f"{value:{form}} {unit}".rstrip()

    def times(key: str) -> str:
        found = values[key]
        if found is None:
            return "–"
        return " / ".join(f"{found[name]:.0f}" for name in ("p50", "p99", "max")) + " µs"

    def clearance(body: str) -> tuple[str, str]:
        where = plain(judged[f"clearance_{body}_where"])
        return number(values["clearance_mm"][body], ".1f", "mm"), where

    def percent(limit: str) -> str:
        used = values["limit_fractions"][limit]
        return "–" if used is None else f"{100 * used:.0f} %"

    height = f"lifted by {1e3 * judged['lifted_m']:.0f} mm, held up for {judged['held_s']:.2f} s"
    gripped = judged["gripped_at_s"]
    misses = "–"
    if values["ticks"] is not None:
        misses = f"{values['deadline_misses']} of {values['ticks']}"
    real_time = run.bridge["mode"] == "real time"
    slips = f"steps that were late: {timing.get('slips', 0)}, "
    slips += f"braked: {timing.get('braked_steps', 0)}"
    return [
        (
            "Success",
            "yes" if values["success"] else "NO",
            height if gripped is not None else "not gripped",
        ),
        ("Gripped", "–" if gripped is None else f"at {gripped:.2f} s", "time since the start"),
        (
            "Position error at the grip",
            number(values["position_error_mm"], ".2f", "mm"),
            "tool against the demonstrated grasp, in the object frame",
        ),
        (
            "Orientation error at the grip",
            number(values["orientation_error_deg"], ".2f", "°"),
            "angle between the same two",
        ),
        ("Least clearance to the sphere", *clearance("sphere")),
        ("Least clearance to the table", *clearance("table")),
        ("Least clearance to itself", *clearance("self")),
        ("Joint position limits used", percent("position"), "largest fraction of any joint"),
        ("Joint velocity limits used", percent("velocity"), "largest fraction of any joint"),
        ("Joint torque limits used", percent("torque"), "largest fraction of any joint"),
        ("Computing time of a tick", times("tick_us"), "p50 / p99 / max"),
        ("Age of the state at its use", times("state_age_us"), "p50 / p99 / max"),
        ("Missed deadlines", misses, "ticks of the controller"),
        ("Heap allocations in the loop", number(values["allocations"], "d", ""), "must be 0"),
        (
            "Real-time factor",
            number(values["real_time_factor"], ".4f", ""),
            slips if real_time else f"{run.bridge['mode']}: not in real time",
        ),
    ]
