"""Runs one scenario in lockstep with a controller of its own, and watches every step."""

from __future__ import annotations

import math
import os
import signal
import subprocess
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from sim_bridge.demonstrations import demonstrated_grasp
from sim_bridge.errors import BridgeError
from sim_bridge.evaluate import grip
from sim_bridge.experiments.joints import Programs, cases, run_case
from sim_bridge.experiments.scenarios import Scenario, draw
from sim_bridge.kinematics import load_chain
from sim_bridge.log import Log
from sim_bridge.messages import Reason, reason_name
from sim_bridge.poses import Array, quaternion_from_rotation, rotation_z
from sim_bridge.run import Options, Outcome, Publication, Run
from sim_bridge.scene import Scene, load_scene
from sim_bridge.services import Instance, StatePublisherPorts, StopSignal
from sim_bridge.settings import read_json
from sim_bridge.world import World

CLEARANCE_SEEN_M = 0.3
"""Distances beyond this one are not measured."""
SLOW_EVERY = 5
"""Clearances from table and self are measured in one of so many steps; contacts in each."""
TRACE_EVERY = 20
JOINTS_SEED = 1
"""All picks of the joints have the scene of this seed, after the first: they are compared."""
POSITION_ERROR_MAX_M = 0.005
ORIENTATION_ERROR_MAX_DEG = 2.0


@dataclass(frozen=True)
class Experiment:
    """Episodes of one kind."""

    name: str
    robot: str
    scene: str
    config: str
    count: int
    quick_count: int


@dataclass(frozen=True)
class Settings:
    """What the command line asked for."""

    config: Path
    controller: Path
    model: Path
    out: Path
    seed: int
    """First seed of each experiment."""
    quick: bool
    only: list[str]
    workers: int
    force: bool = False
    """Whether another run's files are replaced."""
    running: Path = Path()
    """Folder for what an episode needs while it runs."""


class FalsePublication(Publication):
    """Announces the goal where the scenario wants it."""

    def fill(self, time_ns: int, torque: list[float]) -> None:
        """As the world is, but for the goal."""
        super().fill(time_ns, torque)
        false_goal = self.world.episode.false_goal
        motion = None if false_goal is None else false_goal.at(self.world.time_s)
        if motion is not None:
            goal = self.frames.frames[1]
            goal.position[:] = motion.position_m
            goal.quaternion[:] = quaternion_from_rotation(rotation_z(motion.yaw_rad)).tolist()
            goal.linear_velocity[:] = goal.angular_velocity[:] = (0.0, 0.0, 0.0)


class WatchedRun(Run):
    """A run whose arm is pushed; its contacts, clearances and limits are seen at every step."""

    def __init__(self, scene: Scene, options: Options, world: World) -> None:
        super().__init__(scene, options, world)
        self.scenario: Scenario = world.episode
        self.links = [link for link in world.collision_links() if world.moves(link)]
        self.pairs = watched_pairs(world)
        self.contacts: dict[str, float] = {}
        self.clearance = {"obstacle": math.inf, "table": math.inf, "self": math.inf}
        self.limit_fractions = {"position": 0.0, "velocity": 0.0, "torque": 0.0}
        self.speed_max_rad_s = 0.0
        self.reasons: dict[str, float] = {}
        self.reason = int(Reason.NONE)
        self.trace: list[tuple[float, ...]] = []

    def publish_from(self, world: World) -> Publication:
        """As the scenario wants it."""
        task = self.scene.task
        return FalsePublication(world, task.start_frame, task.goal_frame)

    def step(self, lateness_s: float) -> None:
        """One step, pushed and watched."""
        world = self.world
        time_s = world.time_s
        for push in self.scenario.pushes:
            if push.acts(time_s):
                link = self.links[push.link % len(self.links)]
                at = world.client.getLinkState(world.arm, link)[0]
                world.client.applyExternalForce(
                    world.arm, link, push.force_n, at, world.client.WORLD_FRAME
                )
        n, command = len(world.joints), self.guard.command
        if self.obeys:
            asked = np.add(command.torque[:n], command.gravity_torque[:n])
            self._use("torque", np.abs(asked) / world.effort_max)
        self.reason = self.command.reason
        self.reasons.setdefault(reason_name(self.reason), time_s)
        super().step(lateness_s)
        self.watch(time_s)

    def _use(self, limit: str, fractions: Array) -> None:
        self.limit_fractions[limit] = max(self.limit_fractions[limit], float(np.max(fractions)))

    def watch(self, time_s: float) -> None:
        """Looks at the world after a step."""
        world = self.world
        position, velocity = (np.array(values) for values in world.joint_state())
        speed = np.abs(velocity)
        self.speed_max_rad_s = max(self.speed_max_rad_s, float(np.max(speed)))
        self._use("velocity", speed / world.chain.velocity_max_rad_s)
        self._use("position", world.chain.position_fraction(position))
        for contact in world.client.getContactPoints(world.arm):
            if contact[8] <= 0.0:
                self._touched(*contact[1:5], time_s)
        near = world.clearance(world.sphere, [-2], CLEARANCE_SEEN_M)
        self.clearance["obstacle"] = min(self.clearance["obstacle"], near)
        if world.steps % SLOW_EVERY == 0:
            table = world.clearance(world.table, self.links, CLEARANCE_SEEN_M)
            own = min(
                (world.self_clearance(a, b, CLEARANCE_SEEN_M) for a, b in self.pairs),
                default=CLEARANCE_SEEN_M,
            )
            self.clearance["table"] = min(self.clearance["table"], table)
            self.clearance["self"] = min(self.clearance["self"], own)
        if world.steps % TRACE_EVERY == 0:
            tool = world.tool_pose()[:3, 3]
            box, ball = self.publication.object_position, self.publication.sphere_position
            goal = self.publication.frames.frames[1].position
            row = (time_s, *tool, *box, *ball, *goal, near, float(self.reason))
            self.trace.append(tuple(round(float(value), 4) for value in row))

    def _touched(self, body_a: int, body_b: int, link_a: int, link_b: int, time_s: float) -> None:
        world = self.world
        if body_a != world.arm:
            body_a, body_b, link_a, link_b = body_b, body_a, link_b, link_a
        name = world.link_names.get(link_a, "base")
        if body_b == world.arm:
            if (min(link_a, link_b), max(link_a, link_b)) not in self.pairs:
                return
            what = f"{name} and {world.link_names.get(link_b, 'base')}"
        elif body_b == world.sphere:
            what = f"{name} and obstacle"
        elif body_b == world.table and link_a in self.links:
            what = f"{name} and table"
        elif body_b == world.box and link_a != world.tool_link:
            what = f"{name} and box"
        else:
            return
        self.contacts.setdefault(what, round(time_s, 3))


def watched_pairs(world: World) -> set[tuple[int, int]]:
    """Pairs of links with shapes that at least two moving joints lie between."""
    joints = set(world.joints)
    depth = {-1: 0}
    for link in sorted(world.link_names):
        depth[link] = depth[world.link_parents[link]] + (link in joints)
    links = sorted([-1, *world.collision_links()])
    return {(a, b) for a in links for b in links if a < b and depth[b] - depth[a] >= 2}


def run_joints(settings: Settings, experiment: Experiment, seed: int) -> dict[str, object]:
    """Runs a case of the joints: the one of this number, counted from the first seed."""
    config = settings.config / "controllers" / experiment.config
    programs = Programs(settings.controller, config, settings.model, settings.running)
    scene = settings.config / "scenes" / experiment.scene
    number = seed - settings.seed
    row = run_case(programs, scene, cases()[number], settings.seed + JOINTS_SEED)
    row["seed"] = seed
    row["cause"] = cause(row)
    return row


def run_episode(settings: Settings, experiment: Experiment, seed: int) -> dict[str, object]:
    """Runs one episode; gives its row, and its `trace` for the pictures."""
    if experiment.name == "joints":
        return run_joints(settings, experiment, seed)
    scene = load_scene(settings.config / "scenes" / experiment.scene)
    config = settings.config / "controllers" / experiment.config
    chain = load_chain(scene.robot.urdf, scene.robot.tip_link)
    scenario = draw(scene, chain, experiment.robot, experiment.name, seed)
    scene = replace(
        scene,
        robot=replace(scene.robot, home_position_rad=scenario.home_rad),
        sphere=replace(scene.sphere, radius_m=scenario.ball.radius_m),
    )
    grasp = demonstrated_grasp(scene.task.demonstrations, scene.task.goal_frame)
    name = f"exp-{os.getpid()}-{experiment.name[:5]}-{seed}"
    folder = settings.running
    summary, log_file = folder / f"{name}.json", folder / f"{name}.log"
    options = Options(seed, folder, name, True, 20.0, 0, None)
    world = World(scene, scenario)
    try:
        run = WatchedRun(scene, options, world)
        with (
            log_file.open("w", encoding="utf-8") as log,
            StopSignal() as stop,
            StatePublisherPorts(Instance(name)) as ports,
        ):
            controller = subprocess.Popen(
                [
                    *(settings.controller, "run", config, "--model", settings.model),
                    *("--instance", name, "--summary", summary, "--lockstep"),
                ],
                stdout=log,
                stderr=subprocess.STDOUT,
            )
            try:
                outcome = run.lockstep(ports, stop)
            finally:
                controller.send_signal(signal.SIGINT)
                controller.wait(timeout=10.0)
        output = log_file.read_text(encoding="utf-8")
        row = _row(run, scenario, outcome, run.log.finish(world.chain), grasp)
    except BridgeError as error:
        output = log_file.read_text(encoding="utf-8") if log_file.exists() else ""
        raise BridgeError(f"{experiment.name}, seed {seed}: {error}\n{output}") from error
    finally:
        world.close()
    try:
        row["allocations"] = read_json(summary)["allocations"]
    except BridgeError as error:
        raise BridgeError(f"the controller left no summary: {error}\n{output}") from error
    for file in (summary, log_file):
        file.unlink(missing_ok=True)
    return row


def _row(
    run: WatchedRun, scenario: Scenario, outcome: Outcome, log: Log, grasp: Array
) -> dict[str, object]:
    gripped = grip(run.scene, log, grasp)
    position, orientation = gripped["position_error_mm"], gripped["orientation_error_deg"]
    row = {
        "experiment": scenario.experiment,
        "kind": scenario.kind,
        "robot": scenario.robot,
        "seed": scenario.seed,
        "settings": asdict(scenario),
        "outcome": outcome.value,
        "picked": outcome == Outcome.LIFTED,
        "gripped_at_s": gripped["gripped_at_s"],
        "duration_s": round(run.world.time_s, 3),
        "position_error_m": None if position is None else 1e-3 * position,
        "orientation_error_deg": orientation,
        "contacts": run.contacts,
        "clearance_min_m": {key: _seen(value) for key, value in run.clearance.items()},
        "limit_fractions": run.limit_fractions,
        "joint_speed_max_rad_s": run.speed_max_rad_s,
        "reason": reason_name(run.reason),
        "reasons": {key: round(time_s, 3) for key, time_s in run.reasons.items()},
        "trace": run.trace,
    }
    row["exact"] = bool(
        row["picked"]
        and row["position_error_m"] <= POSITION_ERROR_MAX_M
        and row["orientation_error_deg"] <= ORIENTATION_ERROR_MAX_DEG
    )
    row["cause"] = cause(row)
    return row


def _seen(distance: float) -> float | None:
    return distance if distance < CLEARANCE_SEEN_M else None


def harms(row: dict) -> list[str]:
    """Contacts with obstacle, table or the arm itself, and limits exceeded."""
    found = [
        f"contact of {what} at {time_s:g} s"
        for what, time_s in row["contacts"].items()
        if not what.endswith(" box")
    ]
    for limit, fraction in row["limit_fractions"].items():
        if fraction > 1.0:
            found.append(f"joint {limit} limit exceeded: {100.0 * fraction:.1f} %")
    return found


def cause(row: dict) -> str | None:
    """Why an episode does not count as a pick, `None` where it does."""
    found = harms(row)
    if not row["picked"]:
        how = "not gripped" if row["gripped_at_s"] is None else "gripped, not lifted"
        found.append(f"{how}: {row['outcome']}, the controller says `{row['reason']}`")
    elif not row["exact"]:
        position, orientation = 1e3 * row["position_error_m"], row["orientation_error_deg"]
        found.append(f"gripped {position:.1f} mm and {orientation:.1f}° off")
    return "; ".join(found) or None
