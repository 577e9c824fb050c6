"""Picks on joints as real arms have them, in MuJoCo: which cases there are, and how one is run.

The controller is told of rotors, friction and lag, as whoever sets up an arm measures them; where a
case says so the friction it is told of is wrong. Payload and mass error it is never told of.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from sim_bridge.demonstrations import demonstrated_grasp
from sim_bridge.errors import BridgeError
from sim_bridge.evaluate import grip
from sim_bridge.joints import Joints
from sim_bridge.kinematics import Chain, load_chain
from sim_bridge.log import Log
from sim_bridge.messages import reason_name
from sim_bridge.mujoco_world import MujocoWorld
from sim_bridge.run import Options, Outcome, Run
from sim_bridge.scene import draw_episode, load_scene
from sim_bridge.services import Instance, StatePublisherPorts, StopSignal
from sim_bridge.settings import read_json, read_text

POSITION_ERROR_MAX_M = 0.003
ORIENTATION_ERROR_MAX_DEG = 1.0
TIME_LIMIT_S = 12.0
TRACE_EVERY = 20
SERVO_REFERENCE_S = 0.5
PUSH_FROM_S, PUSH_UNTIL_S = 1.0, 1.2

FRICTIONS = ((0.0, 0.0), (0.01, 0.0), (0.1, 0.0), (1.0, 0.0), (0.0, 0.05), (0.0, 0.1), (0.0, 0.2))
"""Torque [N m] and fraction of the effort."""
ROTORS = ((0.0, 0.0), (0.05, 0.1), (0.1, 1.0), (0.3, 1.0))
"""Inertia [kg m²] and viscous friction [N m s/rad]."""
PAYLOADS_KG = (0.0, 1.0, 2.0)
MASS_ERRORS = (-0.2, 0.0, 0.2)
LAGS_S = (0.0, 0.01, 0.03, 0.06, 0.1, 0.15, 0.2)
SHORT = 12
"""How many cases a short look has."""
WAYS = ("position", "velocity")
PUSHES_N = ((20.0, 0.0, 0.0), (0.0, 0.0, 40.0), (0.0, -40.0, 0.0))


@dataclass(frozen=True)
class Case:
    """One pick."""

    kind: str
    joints: Joints
    friction_told: float = 1.0
    """What the controller is told of the friction, as a fraction of what it is."""
    push_n: tuple[float, float, float] | None = None
    """A force on the tool for 0.2 s."""


def cases() -> list[Case]:
    """All of them; the first ones are a short look at each kind."""
    grid = [
        Case("torque", Joints("torque", friction, fraction, viscous, armature, payload, error))
        for friction, fraction in FRICTIONS
        for armature, viscous in ROTORS
        for payload in PAYLOADS_KG
        for error in MASS_ERRORS
    ]
    servos = [
        Case("servo", Joints(interface, 1.0, armature=0.1, servo_lag_s=lag))
        for interface in WAYS
        for lag in LAGS_S
    ]
    told = [
        Case("friction told wrong", Joints("torque", *friction, armature=0.1), factor)
        for friction in FRICTIONS[1:]
        for factor in (0.5, 0.8, 1.2)
    ]
    pushed = [
        Case("pushed", Joints("torque", friction, armature=armature), push_n=force)
        for friction, armature in ((0.0, 0.0), (1.0, 0.1))
        for force in PUSHES_N
    ]
    worst = Joints("torque", 0.0, 0.2, 1.0, 0.3, 2.0, 0.2)
    short = [
        Case("torque", Joints("torque")),
        Case("torque", Joints("torque", 0.01)),
        Case("torque", Joints("torque", 1.0)),
        Case("torque", Joints("torque", 0.0, 0.2)),
        Case("torque", Joints("torque", armature=0.3)),
        Case("torque", Joints("torque", payload_kg=2.0)),
        Case("torque", Joints("torque", 1.0, viscous=1.0, armature=0.1, mass_error=-0.2)),
        Case("torque", worst),
        *(Case("servo", Joints(way, 1.0, armature=0.1, servo_lag_s=0.1)) for way in WAYS),
        told[7],
        pushed[3],
    ]
    rest = [case for case in grid + servos + told + pushed if case not in short]
    return short + rest


def controller_config(source: Path, folder: Path, name: str, case: Case, chain: Chain) -> Path:
    """A configuration like `source`, with what the controller is told of the joints."""
    text, joints = read_text(source), case.joints
    base = re.search(r'base: "([^"]+)"', text)
    if base is None:
        raise BridgeError(f"{source}: expected a key `base`, found none")
    friction = joints.friction + joints.friction_fraction * chain.effort_max_n_m
    drives = {
        "rotor_inertia": [joints.armature] * chain.joint_count,
        "coulomb_friction": (case.friction_told * friction).tolist(),
        "viscous_friction": [joints.viscous] * chain.joint_count,
    }
    if joints.interface == "torque":
        kind, keys = "Torque", ", ".join(f"{key}: {values}" for key, values in drives.items())
    else:
        kind = {"position": "PositionServo", "velocity": "VelocityServo"}[joints.interface]
        keys = f"lag_s: {joints.servo_lag_s}, reference_time_constant_s: {SERVO_REFERENCE_S}"
    text, count = re.subn(r"\brobot: \(", rf"\g<0>actuators: {kind}(({keys})),", text)
    if count != 1:
        raise BridgeError(f"{source}: expected `robot: (` once, found {count} times")
    for path in (base[1], *re.findall(r'urdf: "([^"]+)"', text)):
        text = text.replace(f'"{path}"', f'"{(source.parent / path).resolve()}"')
    file = folder / f"{name}.ron"
    file.write_text(text, encoding="utf-8")
    return file


class PushedRun(Run):
    """A run in MuJoCo whose tool is pushed once, where the case says so."""

    push_n: Sequence[float] | None = None

    def step(self, lateness_s: float) -> None:
        """One step."""
        if self.push_n is not None and PUSH_FROM_S <= self.world.time_s < PUSH_UNTIL_S:
            self.world.push(self.scene.robot.tool_link, self.push_n)
        super().step(lateness_s)


@dataclass(frozen=True)
class Programs:
    """The controller and what it runs."""

    controller: Path
    config: Path
    model: Path
    running: Path
    """Folder for what a pick needs while it runs."""


def run_case(programs: Programs, scene_file: Path, case: Case, seed: int) -> dict[str, object]:
    """Runs one pick; gives its row, and its `trace` for the pictures."""
    scene = load_scene(scene_file)
    scene = replace(scene, task=replace(scene.task, time_limit_s=TIME_LIMIT_S))
    chain = load_chain(scene.robot.urdf, scene.robot.tip_link)
    grasp = demonstrated_grasp(scene.task.demonstrations, scene.task.goal_frame)
    name = f"joints-{os.getpid()}-{abs(hash((case, seed))) % 10**6}"
    folder = programs.running
    config = controller_config(programs.config, folder, name, case, chain)
    summary, log_file = folder / f"{name}.json", folder / f"{name}.log"
    world = MujocoWorld(scene, draw_episode(scene, seed), case.joints)
    options = Options(seed, folder, name, True, 20.0, 0, None, joints=case.joints)
    run = PushedRun(scene, options, world)
    run.push_n = case.push_n
    with (
        log_file.open("w", encoding="utf-8") as log,
        StopSignal() as stop,
        StatePublisherPorts(Instance(name)) as ports,
    ):
        controller = subprocess.Popen(
            [
                *(programs.controller, "run", config, "--model", programs.model),
                *("--instance", name, "--summary", summary, "--lockstep"),
            ],
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        try:
            outcome = run.lockstep(ports, stop)
        except BridgeError as error:
            output = log_file.read_text(encoding="utf-8", errors="replace")
            raise BridgeError(f"{label(case)}: {error}\n{output}") from error
        finally:
            controller.send_signal(signal.SIGINT)
            controller.wait(timeout=10.0)
    row = _row(run, case, outcome, run.log.finish(chain), grasp)
    row["seed"] = seed
    row["allocations"] = read_json(summary)["allocations"]
    for file in (summary, log_file, config):
        file.unlink(missing_ok=True)
    return row


def label(case: Case) -> str:
    """What is special about a case."""
    joints = case.joints
    words = [case.kind, joints.interface]
    for text, value in (
        ("{:g} N m", joints.friction),
        ("{:.0%} of effort", joints.friction_fraction),
        ("{:g} N m s/rad", joints.viscous),
        ("rotor {:g} kg m²", joints.armature),
        ("payload {:g} kg", joints.payload_kg),
        ("masses {:+.0%}", joints.mass_error),
        ("lag {:g} s", joints.servo_lag_s),
    ):
        if value != 0.0:
            words.append(text.format(value))
    if case.friction_told != 1.0:
        words.append(f"told {case.friction_told:.0%} of the friction")
    if case.push_n is not None:
        words.append("pushed by {:g}, {:g}, {:g} N".format(*case.push_n))
    return ", ".join(words)


def _row(run: Run, case: Case, outcome: Outcome, log: Log, grasp: np.ndarray) -> dict[str, object]:
    gripped, chain = grip(run.scene, log, grasp), run.world.chain
    position, orientation = gripped["position_error_mm"], gripped["orientation_error_deg"]
    picked = outcome == Outcome.LIFTED
    speed = np.abs(log["velocity_rad_s"])
    reasons = [int(reason) for reason in log["command_reason"] if reason >= 0]
    row = {
        "experiment": "joints",
        "kind": case.kind,
        "label": label(case),
        "robot": "ur5",
        "settings": {
            "joints": asdict(case.joints),
            "friction_told": case.friction_told,
            "push_n": case.push_n,
            "ball": {"radius_m": run.scene.sphere.radius_m},
            "false_goal": None,
            "pushes": [],
        },
        "outcome": outcome.value,
        "picked": picked,
        "gripped_at_s": gripped["gripped_at_s"],
        "duration_s": round(run.world.time_s, 3),
        "position_error_m": None if position is None else 1e-3 * position,
        "orientation_error_deg": orientation,
        "contacts": run.world.contacts,
        "clearance_min_m": {"obstacle": None, "table": None, "self": None},
        "limit_fractions": {
            "position": float(np.max(chain.position_fraction(log["position_rad"]))),
            "velocity": float(np.max(speed / chain.velocity_max_rad_s)),
            "torque": float(np.nanmax(np.abs(log["torque_n_m"]) / chain.effort_max_n_m)),
        },
        "joint_speed_max_rad_s": float(np.max(speed)),
        "reason": reason_name(reasons[-1]),
        "reasons": {reason_name(reason): 0.0 for reason in dict.fromkeys(reasons)},
        "trace": _trace(log),
    }
    row["exact"] = bool(
        picked
        and row["position_error_m"] <= POSITION_ERROR_MAX_M
        and orientation <= ORIENTATION_ERROR_MAX_DEG
    )
    return row


def _trace(log: Log) -> list[tuple[float, ...]]:
    """Columns as in the other experiments' traces; the distance from the ball is not measured."""
    rows = range(0, len(log["time_s"]), TRACE_EVERY)
    return [
        (
            *(
                round(float(value), 4)
                for value in (
                    log["time_s"][k],
                    *log["tool_position_m"][k],
                    *log["object_position_m"][k],
                    *log["sphere_position_m"][k],
                    *log["object_position_m"][k],
                )
            ),
            0.3,
            float(log["command_reason"][k]),
        )
        for k in rows
    ]
