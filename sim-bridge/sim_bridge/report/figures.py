"""The figures of a report: judged again from the log, and read from the controller's summary."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge.demonstrations import Demonstration, demonstrated_grasp, read_demonstration
from sim_bridge.errors import BridgeError
from sim_bridge.evaluate import clearances, evaluate, grasp_error
from sim_bridge.guard import counted
from sim_bridge.kinematics import Chain
from sim_bridge.log import BRIDGE_FILE, LOG_FILE, Log, LogWriter, load
from sim_bridge.messages import GripperState
from sim_bridge.poses import Array, inverse, vector_from_rotation
from sim_bridge.scene import Scene, draw_episode, load_scene
from sim_bridge.settings import read_json
from sim_bridge.world import World

CONTROLLER_FILE = "controller.json"
TIMES = ("tick_us", "wake_up_us", "state_age_us")
BODIES = {"sphere": "the sphere", "table": "the table", "self": "itself"}
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
    chain: Chain

    @property
    def gripped_row(self) -> int | None:
        """First row with the vacuum sealed."""
        holding = self.log["gripper_state"] == GripperState.HOLDING
        return int(np.argmax(holding)) if np.any(holding) else None


def load_run(folder: Path) -> Run:
    """Reads a run's folder and judges it; raises `BridgeError` saying what is wrong with it."""
    log, bridge = _load_log(folder)
    file = Path(bridge["scene"])
    if not file.exists():
        raise BridgeError(
            f"{folder / BRIDGE_FILE}: `scene`: {file} is not there: start the report in the "
            "folder in which the run was started"
        )
    scene = load_scene(file)
    demonstrations = [
        read_demonstration(f) for f in sorted(scene.task.demonstrations.glob("*.json"))
    ]
    grasp = demonstrated_grasp(scene.task.demonstrations, scene.task.goal_frame)
    world = World(scene, draw_episode(scene, bridge["seed"]))
    try:
        _check_shapes(folder / LOG_FILE, log, world.chain.joint_count)
        judged = evaluate(scene, world, log, grasp)
        replay = list(clearances(world, log))
    finally:
        world.close()
    rows = [row for row, _ in replay]
    error = np.array([grasp_error(log, row, grasp) for row in range(len(log["time_s"]))])
    angles = [np.linalg.norm(vector_from_rotation(x[:3, :3])) for x in error]
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
        position_error_m=np.linalg.norm(error[:, :3, 3], axis=1),
        orientation_error_rad=np.array(angles),
        path_in_object_m=(grasp @ error)[:, :3, 3],
        chain=world.chain,
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
    faults = bridge.setdefault("command_faults", {})
    if not isinstance(faults, dict) or not all(isinstance(n, int) for n in faults.values()):
        raise BridgeError(
            f"{folder / BRIDGE_FILE}: `command_faults`: expected counts by name, found {faults}"
        )
    return log, bridge


def _check_shapes(file: Path, log: Log, joint_count: int) -> None:
    rows = len(np.atleast_1d(log["time_s"]))
    if rows < 2:
        raise BridgeError(f"{file}: expected at least 2 rows, found {rows}: the arm never moved")
    ends = {key: column.shape[1:] for key, column in LogWriter(1, joint_count).columns.items()}
    ends.update(tool_position_m=(3,), tool_quaternion_wxyz=(4,))
    for key, end in ends.items():
        found = log[key].shape if key in log else None
        if found != (rows, *end):
            raise BridgeError(f"{file}: `{key}`: expected the shape {(rows, *end)}, found {found}")
        # What is commanded is NaN while the arm is braked.
        if "torque" not in key and "cmd" not in key and not np.all(np.isfinite(log[key])):
            raise BridgeError(f"{file}: `{key}`: expected finite numbers only")


def _load_controller(file: Path) -> dict | None:
    """The controller's summary; `None` when there is none."""
    if not file.exists():
        return None
    summary = read_json(file)
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
    sentences += _contacts(judged)
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


def _contacts(judged: dict) -> list[str]:
    sentences = []
    for body in BODIES:
        least = 1e3 * judged[f"clearance_{body}_m"]
        if judged["sphere_touched"] if body == "sphere" else least <= 0.0:
            where = plain(judged[f"clearance_{body}_where"])
            sentences.append(
                f"The arm touched {BODIES[body]} (least distance {least:.1f} mm: {where})."
            )
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
        "command_faults": run.bridge["command_faults"],
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
    judged, timing, faults = run.judged, run.bridge["timing"], values["command_faults"]
    gripped = judged["gripped_at_s"]
    lifted = f"lifted by {1e3 * judged['lifted_m']:.0f} mm, held up for {judged['held_s']:.2f} s"
    misses = (
        None if values["ticks"] is None else f"{values['deadline_misses']} of {values['ticks']}"
    )
    remark = f"{run.bridge['mode']}: not in real time"
    if run.bridge["mode"] == "real time":
        remark = f"steps that were late: {timing.get('slips', 0)}, "
        remark += f"braked: {timing.get('braked_steps', 0)}"
    rows = [
        ("Success", "yes" if values["success"] else "NO", lifted if gripped else "not gripped"),
        ("Gripped", _number(gripped, "at {:.2f} s"), "time since the start"),
        (
            "Position error at the grip",
            _number(values["position_error_mm"], "{:.2f} mm"),
            "tool against the demonstrated grasp, in the object frame",
        ),
        (
            "Orientation error at the grip",
            _number(values["orientation_error_deg"], "{:.2f} °"),
            "angle between the same two",
        ),
    ]
    for body in BODIES:
        clearance = _number(values["clearance_mm"][body], "{:.1f} mm")
        where = plain(judged[f"clearance_{body}_where"])
        rows.append((f"Least clearance to {BODIES[body]}", clearance, where))
    for limit in LIMITS:
        used = _number(values["limit_fractions"][limit], "{:.0%}").replace("%", " %")
        rows.append((f"Joint {limit} limits used", used, "largest fraction of any joint"))
    rows += [
        ("Computing time of a tick", _times(values["tick_us"]), "p50 / p99 / max"),
        ("Age of the state at its use", _times(values["state_age_us"]), "p50 / p99 / max"),
        ("Missed deadlines", misses or "–", "ticks of the controller"),
        ("Heap allocations in the loop", _number(values["allocations"], "{:d}"), "must be 0"),
        ("Real-time factor", _number(values["real_time_factor"], "{:.4f}"), remark),
    ]
    if faults:
        rows.append(("Commands with a fault", f"{sum(faults.values())}", counted(faults)))
    return rows


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else form.format(value)


def _times(times: dict | None) -> str:
    if times is None:
        return "–"
    return " / ".join(f"{times[name]:.0f}" for name in ("p50", "p99", "max")) + " µs"
