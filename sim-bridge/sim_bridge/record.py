"""The scripted expert: demonstrates the pick and records it.

The tool's path is one smooth curve without a stop: the horizontal motion and the rotation of the
tool follow one minimum-jerk profile, the descent a later one, so that the end is vertical. Inverse
kinematics turns it into joint positions, which computed torque tracks in the physics; what is
recorded is the measured tool pose. The vacuum comes on when the cup is pressed on the box.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge.demonstrations import Demonstration, continuous_quaternions, write_demonstration
from sim_bridge.errors import BridgeError
from sim_bridge.files import check, make_folder
from sim_bridge.kinematics import forward, inverse_kinematics
from sim_bridge.messages import GripperState
from sim_bridge.poses import (
    Array,
    inverse,
    minimum_jerk,
    pose,
    quaternion_from_rotation,
    rotation_from_vector,
    rotation_z,
    vector_from_rotation,
)
from sim_bridge.scene import Episode, Scene
from sim_bridge.world import World

REST_SPEED_RAD_S = 2e-3
REST_TIME_MAX_S = 1.0
LIFT_TIME_S = 1.5
LIFT_MARGIN_M = 0.02

# The grasp: tool z down on the box's top, tool x against the box's y.
R_OE = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True)
class Recording:
    """A demonstration, and how it went."""

    demonstration: Demonstration
    duration_s: float
    path_length_m: float
    speed_max_m_s: float
    compression_m: float
    lifted_m: float


def horizontal_end(scene: Scene, descent_m: float) -> float:
    """Fraction of the duration after which `vertical_end_m` of a descent are left."""
    record = scene.record
    left = min(max(record.vertical_end_m / max(descent_m, 1e-9), 0.0), 1.0)
    return record.vertical_delay + (1.0 - record.vertical_delay) * _minimum_jerk_phase(1.0 - left)


def tool_path(scene: Scene, x_start: Array, x_goal: Array, end: float, phase: float) -> Array:
    """`X_BE` wanted at a fraction of the duration.

    With `h` and `v` the progress of the horizontal and of the vertical motion, both minimum-jerk:
    `v` starts after the fraction `vertical_delay` of the duration and lasts to its end; `h` ends
    at the fraction `end`.
    """
    delay = scene.record.vertical_delay
    h = minimum_jerk(phase / end)
    v = minimum_jerk((phase - delay) / (1.0 - delay))
    position = x_start[:3, 3] + (x_goal[:3, 3] - x_start[:3, 3]) * np.array([h, h, v])
    rotation = vector_from_rotation(x_start[:3, :3].T @ x_goal[:3, :3])
    return pose(x_start[:3, :3] @ rotation_from_vector(h * rotation), position)


def _minimum_jerk_phase(progress: float) -> float:
    """Where the minimum-jerk profile reaches `progress`, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if minimum_jerk(middle) < progress:
            low = middle
        else:
            high = middle
    return high


class _Expert:
    """Tracks joint trajectories in a world by computed torque."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.q_goal = np.array(world.joint_state()[0])

    def step(self, q: Array, qd: Array, qdd: Array, vacuum: bool) -> None:
        """One step towards the wanted joint state."""
        record = self.world.scene.record
        position, velocity = self.world.joint_state()
        acceleration = (
            qdd
            + record.tracking_stiffness_1_s2 * (q - position)
            + record.tracking_damping_1_s * (qd - velocity)
        )
        torque = self.world.inverse_dynamics(position, velocity, acceleration.tolist())
        self.world.apply_torque(torque)
        self.world.step(vacuum)

    def hold(self, vacuum: bool) -> None:
        """One step at rest at the last goal."""
        zero = np.zeros_like(self.q_goal)
        self.step(self.q_goal, zero, zero, vacuum)

    def plan(self, poses: list[Array]) -> tuple[Array, Array, Array]:
        """Joint positions, velocities and accelerations through `poses`, one a step.

        The trajectory begins at rest at the last goal and ends at rest at the last pose. Row `k` is
        what is wanted when step `k` begins.
        """
        positions = [self.q_goal, self.q_goal]
        for x_be in poses:
            guess = 2.0 * positions[-1] - positions[-2]
            positions.append(inverse_kinematics(self.world.chain, x_be, guess))
        q = np.array(positions)
        dt = self.world.dt_s
        velocity = (q[2:] - q[:-2]) / (2.0 * dt)
        acceleration = (q[2:] - 2.0 * q[1:-1] + q[:-2]) / dt**2
        self.q_goal = positions[-1]
        return q[1:-1], velocity, acceleration


def record_one(
    scene: Scene, number: int, count: int, seed: int, *, gripper: bool = False
) -> Recording:
    """Picks the box once; raises `BridgeError` when it is not gripped or not lifted.

    With `gripper` the demonstration says what the gripper does, and ends with a sample in which it
    holds the box.
    """
    generator = random.Random(f"{seed}/{number}")
    world = World(scene, _static_episode(scene, number, count, seed), with_sphere=False)
    try:
        variation = scene.record.start_variation_rad
        start = [q + variation * (2.0 * generator.random() - 1.0) for q in world.home]
        world.place_arm(start)
        world.moving = True
        return _demonstrate(world, scene.record.duration_s.draw(generator), number, gripper)
    finally:
        world.close()


def _static_episode(scene: Scene, number: int, count: int, seed: int) -> Episode:
    """A resting box: angle and yaw are spread evenly over the demonstrations, then shaken."""
    generator = random.Random(f"{seed}/box/{number}")
    yaw_order = list(range(count))
    random.Random(f"{seed}/yaw").shuffle(yaw_order)
    box = scene.object
    centre_x = 0.5 * (box.circle_centre_x_m.low + box.circle_centre_x_m.high)
    centre_y = 0.5 * (box.circle_centre_y_m.low + box.circle_centre_y_m.high)
    angle = 2.0 * math.pi * (number + generator.random()) / count
    radius = box.circle_radius_m * math.sqrt(0.1 + 0.9 * generator.random())
    fraction = (yaw_order[number] + generator.random()) / count
    yaw = box.yaw_rad.low + (box.yaw_rad.high - box.yaw_rad.low) * fraction
    position = (
        centre_x + radius * math.cos(angle),
        centre_y + radius * math.sin(angle),
        box.table_gap_m + 0.5 * box.size_m[2],
    )
    return Episode(number, position, 0.0, 0.0, 0.0, yaw, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


def _demonstrate(world: World, duration_s: float, number: int, gripper: bool) -> Recording:
    scene, record, dt = world.scene, world.scene.record, world.dt_s
    label = f"demonstration {number + 1}"
    x_start = world.tool_pose()
    position, _, _, _ = world.object_motion()
    x_bo = pose(rotation_z(world.episode.object_yaw_rad), position)
    top = 0.5 * scene.object.size_m[2]
    x_goal = x_bo @ pose(R_OE, np.array([0.0, 0.0, top - record.compression_m]))
    steps = math.ceil(duration_s / dt)
    # The same timing from every start: that of a descent from where the arm is at home.
    end = horizontal_end(scene, forward(world.chain, list(world.home))[2, 3] - x_goal[2, 3])
    phases = [(step + 1) / steps for step in range(steps)]
    expert = _Expert(world)
    plan = expert.plan([tool_path(scene, x_start, x_goal, end, phase) for phase in phases])
    measured, grips = _follow(expert, plan, to_grip=gripper)
    if world.gripper != GripperState.HOLDING:
        raise BridgeError(f"{label}: the vacuum did not seal: see `record` in {scene.file}")
    lifted_m = _lift(expert, scene.task.lift_height_m + LIFT_MARGIN_M)
    if lifted_m < scene.task.lift_height_m:
        raise BridgeError(f"{label}: the box was lifted by {lifted_m:.3f} m only")

    samples = _samples(measured)
    steps_m = np.linalg.norm(np.diff(samples[:, :3], axis=0), axis=1)
    frames = {scene.task.start_frame: x_start, scene.task.goal_frame: x_bo}
    return Recording(
        Demonstration(scene.task.skill, record.sampling_time_s, frames, samples, grips),
        duration_s=(len(measured) - 1) * record.sampling_time_s,
        path_length_m=float(np.sum(steps_m)),
        speed_max_m_s=float(np.max(steps_m)) / record.sampling_time_s,
        compression_m=float(top - (inverse(x_bo) @ measured[-1])[2, 3]),
        lifted_m=lifted_m,
    )


def _follow(
    expert: _Expert, plan: tuple[Array, Array, Array], *, to_grip: bool
) -> tuple[list[Array], list[str] | None]:
    """Follows the plan, rests and seals, if it can.

    Gives the measured tool poses and, with `to_grip`, what the gripper is at each, up to the first
    at which it holds.
    """
    world = expert.world
    every = round(world.scene.record.sampling_time_s / world.dt_s)
    measured, grips = [world.tool_pose()], [_grip(world)]

    def sample() -> bool:
        if world.steps % every == 0:
            measured.append(world.tool_pose())
            grips.append(_grip(world))
            return True
        return False

    for q, qd, qdd in zip(*plan):
        expert.step(q, qd, qdd, vacuum=False)
        sample()
    at_rest = False
    for _ in range(math.ceil(REST_TIME_MAX_S / world.dt_s)):
        at_rest = at_rest or max(abs(v) for v in world.joint_state()[1]) < REST_SPEED_RAD_S
        expert.hold(vacuum=at_rest)
        if world.gripper == GripperState.HOLDING and not to_grip:
            break
        if sample() and world.gripper == GripperState.HOLDING:
            break
    return measured, grips if to_grip else None


def _grip(world: World) -> str:
    return "closed" if world.gripper == GripperState.HOLDING else "open"


def _samples(poses: list[Array]) -> Array:
    """Rows of a demonstration: position [m], quaternion w x y z with a continuous sign."""
    positions = np.array([x[:3, 3] for x in poses])
    quaternions = np.array([quaternion_from_rotation(x[:3, :3]) for x in poses])
    quaternions = continuous_quaternions(quaternions)
    # The sign of the first one is free: the same hemisphere for all demonstrations of a grasp.
    if quaternions[0] @ quaternion_from_rotation(R_OE) < 0.0:
        quaternions = -quaternions
    return np.hstack([positions, quaternions])


def _lift(expert: _Expert, height_m: float) -> float:
    """Lifts the tool and gives how far the box came along [m]."""
    world = expert.world
    before = world.object_motion()[0][2]
    x_from = forward(world.chain, expert.q_goal)
    steps = math.ceil(LIFT_TIME_S / world.dt_s)
    poses = []
    for step in range(steps):
        x = x_from.copy()
        x[2, 3] += height_m * minimum_jerk((step + 1) / steps)
        poses.append(x)
    for q, qd, qdd in zip(*expert.plan(poses)):
        expert.step(q, qd, qdd, vacuum=True)
    for _ in range(math.ceil(world.scene.task.hold_time_s / world.dt_s)):
        expert.hold(vacuum=True)
    return float(world.object_motion()[0][2] - before)


def record(
    scene: Scene, out: Path, count: int, seed: int, *, force: bool, gripper: bool = False
) -> None:
    """Writes `count` demonstrations to `out` and prints a table of them.

    Raises `BridgeError` before the first one when one of them may not be written.
    """
    make_folder(out)
    for number in range(count):
        check(out / f"{number + 1:02}.json", force=force)
    print("file     box x, y [m]     yaw [deg]  samples  time [s]  path [m]  top speed [m/s]"
          "  cup pressed [mm]  lifted [m]")  # fmt: skip
    for number in range(count):
        recording = record_one(scene, number, count, seed, gripper=gripper)
        demonstration = recording.demonstration
        file = out / f"{number + 1:02}.json"
        write_demonstration(file, demonstration, force=force)
        x_bo = demonstration.frames[scene.task.goal_frame]
        yaw = math.degrees(math.atan2(x_bo[1, 0], x_bo[0, 0]))
        print(
            f"{file.name}  {x_bo[0, 3]:6.3f}, {x_bo[1, 3]:6.3f}  {yaw:9.1f}"
            f"  {len(demonstration.samples):7}  {recording.duration_s:8.2f}"
            f"  {recording.path_length_m:8.3f}  {recording.speed_max_m_s:15.3f}"
            f"  {1e3 * recording.compression_m:16.2f}  {recording.lifted_m:10.3f}",
            flush=True,
        )
