"""Judges a run from its log: was the task done, how exactly, how near to collisions and limits."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from sim_bridge.log import Log
from sim_bridge.messages import GripperState
from sim_bridge.poses import Array, inverse, pose_from_wire, vector_from_rotation
from sim_bridge.scene import Motion, Scene
from sim_bridge.world import World

REPLAY_PERIOD_S = 0.01
DISTANCE_MAX_M = 0.5


def evaluate(scene: Scene, world: World, log: Log, grasp: Array) -> dict[str, object]:
    """Facts of a run; a figure that does not exist is `None`.

    * `success`                the box was gripped, lifted, and held; the sphere was never touched
    * `gripped`, `gripped_at_s`  the vacuum sealed on contact, and when
    * `lifted_m`               largest rise of the box's centre since it was gripped
    * `held_s`                 longest time it was held at the wanted height
    * `position_error_mm`, `orientation_error_deg`  tool against the demonstrated `grasp` (`X_OE`),
      at the last state before the vacuum sealed
    * `clearance_sphere_m`, `clearance_table_m`, `clearance_self_m`  least distance of any link,
      every 10 ms, at most 0.5 m; the box is left out, and so are neighbouring links
    * `sphere_touched`         a contact in the physics, or a least distance of 0 or less
    * `position_limit_used`, `velocity_limit_used`, `torque_limit_used`  largest fraction of a
      joint's limit
    """
    result: dict[str, object] = {"success": False, **grip(scene, log, grasp)}
    result.update(_clearances(world, log))
    touched = bool(np.any(log["contact_sphere"])) or (result["clearance_sphere_m"] or 1.0) <= 0.0
    result["sphere_touched"] = touched
    result.update(_limits(world, log))
    result["success"] = bool(
        result["gripped"]
        and result["lifted_m"] >= scene.task.lift_height_m
        and result["held_s"] >= scene.task.hold_time_s - 1e-9
        and not touched
    )
    return result


def grip(scene: Scene, log: Log, grasp: Array) -> dict[str, object]:
    """What came of the grip and the lift; keys as in `evaluate`."""
    holding = log["gripper_state"] == GripperState.HOLDING
    if not np.any(holding):
        return {
            "gripped": False,
            "gripped_at_s": None,
            "lifted_m": 0.0,
            "held_s": 0.0,
            "position_error_mm": None,
            "orientation_error_deg": None,
        }
    first = int(np.argmax(holding))
    height = log["object_position_m"][:, 2]
    rise = np.where(holding, height - height[first], 0.0)
    longest = current = 0
    for held in rise >= scene.task.lift_height_m:
        current = current + 1 if held else 0
        longest = max(longest, current)
    error = grasp_error(log, max(0, first - 1), grasp)
    return {
        "gripped": True,
        "gripped_at_s": float(log["time_s"][first]),
        "lifted_m": float(np.max(rise)),
        "held_s": longest / scene.physics.rate_hz,
        "position_error_mm": 1e3 * float(np.linalg.norm(error[:3, 3])),
        "orientation_error_deg": math.degrees(
            float(np.linalg.norm(vector_from_rotation(error[:3, :3])))
        ),
    }


def grasp_error(log: Log, row: int, grasp: Array) -> Array:
    """Pose of the tool at a row of the log, in the demonstrated `grasp` (`X_OE`)."""
    x_bo = pose_from_wire(log["object_position_m"][row], log["object_quaternion_wxyz"][row])
    x_be = pose_from_wire(log["tool_position_m"][row], log["tool_quaternion_wxyz"][row])
    return inverse(grasp) @ inverse(x_bo) @ x_be


def clearances(world: World, log: Log) -> Iterator[tuple[int, dict[str, tuple[float, str]]]]:
    """Replays the log: row, and for sphere, table and self the least distance [m] and where."""
    links = world.collision_links()
    pairs = distant_pairs(world, links)
    moving = [link for link in links if world.moves(link)]
    every = max(1, round(REPLAY_PERIOD_S / world.dt_s))
    names = world.link_names

    def nearest(body: int, links: list[int]) -> tuple[float, str]:
        return min((world.clearance(body, [link], DISTANCE_MAX_M), names[link]) for link in links)

    for row in range(0, len(log["time_s"]), every):
        world.place_arm(log["position_rad"][row])
        x, y, z = log["sphere_position_m"][row]
        world.place_sphere(Motion((x, y, z), 0.0, (0.0, 0.0, 0.0)))
        yield (
            row,
            {
                "sphere": nearest(world.sphere, links),
                "table": nearest(world.table, moving),
                "self": min(
                    (world.self_clearance(a, b, DISTANCE_MAX_M), f"{names[a]} and {names[b]}")
                    for a, b in pairs
                ),
            },
        )


def _clearances(world: World, log: Log) -> dict[str, object]:
    replay = [now for _, now in clearances(world, log)]
    result: dict[str, object] = {}
    for key in ("sphere", "table", "self"):
        distance, where = min((now[key] for now in replay), default=(None, None))
        result[f"clearance_{key}_m"] = distance
        result[f"clearance_{key}_where"] = where
    return result


def distant_pairs(world: World, links: list[int]) -> list[tuple[int, int]]:
    """Pairs of links with at least one link with a shape between them.

    Two links that follow each other in the chain touch by design.
    """
    ordered = sorted(links)
    return [(a, b) for i, a in enumerate(ordered) for b in ordered[i + 2 :]]


def _limits(world: World, log: Log) -> dict[str, object]:
    chain = world.chain
    if not len(log["time_s"]):
        return dict.fromkeys(("position_limit_used", "velocity_limit_used", "torque_limit_used"))
    torque = np.abs(log["torque_n_m"]) / chain.effort_max_n_m
    return {
        "position_limit_used": float(np.max(chain.position_fraction(log["position_rad"]))),
        "velocity_limit_used": float(
            np.max(np.abs(log["velocity_rad_s"]) / chain.velocity_max_rad_s)
        ),
        "torque_limit_used": None if np.all(np.isnan(torque)) else float(np.nanmax(torque)),
    }
