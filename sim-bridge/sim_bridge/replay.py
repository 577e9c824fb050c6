"""Publishes a recorded run again, at its own pace: a state publisher that obeys nothing.

What a controller would command is seen beside it, and moves nothing. Stamps and numbers are new.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_bridge.errors import BridgeError
from sim_bridge.guard import Bounds
from sim_bridge.kinematics import load_chain
from sim_bridge.log import Log, load
from sim_bridge.messages import ObstacleKind, TaskFrames, place, place_obstacle
from sim_bridge.poses import angular_velocity
from sim_bridge.publisher import StatePublisher
from sim_bridge.scene import Scene, load_scene
from sim_bridge.services import Instance, StopSignal


@dataclass(frozen=True)
class Options:
    """Which run, for whom, and how often."""

    run: Path
    instance: str
    loop: bool
    """Whether it begins anew at its end."""


class Recording:
    """A run's states and frames, one a row."""

    def __init__(self, log: Log, scene: Scene) -> None:
        if len(log["time_s"]) < 2:
            raise BridgeError("expected a run of two states or more: repeat `sim-bridge run`")
        self.log, self.scene = log, scene
        self.chain = load_chain(scene.robot.urdf, scene.robot.tip_link)
        time_s = log["time_s"]
        self.torque = np.nan_to_num(log["torque_n_m"] - log["gravity_torque_n_m"])
        self.box_velocity = np.gradient(log["object_position_m"], time_s, axis=0)
        self.ball_velocity = np.gradient(log["sphere_position_m"], time_s, axis=0)
        self.box_rotation = angular_velocity(log["object_quaternion_wxyz"], time_s)
        self.frames = TaskFrames(frame_count=2, obstacle_count=2)
        place(
            self.frames.frames[0],
            scene.task.start_frame,
            log["tool_position_m"][0].tolist(),
            log["tool_quaternion_wxyz"][0].tolist(),
        )
        obstacles = self.frames.obstacles
        place_obstacle(obstacles[0], ObstacleKind.SPHERE, [scene.sphere.radius_m])
        place_obstacle(obstacles[1], ObstacleKind.HALF_SPACE)

    def fill(self, robot: StatePublisher, row: int) -> None:
        """Writes a row into the messages."""
        log, n, state = self.log, self.chain.joint_count, robot.state
        state.position[:n] = log["position_rad"][row].tolist()
        state.velocity[:n] = log["velocity_rad_s"][row].tolist()
        state.torque[:n] = self.torque[row].tolist()
        state.gripper_state = int(log["gripper_state"][row])
        box, ball = self.frames.frames[1], self.frames.obstacles[0]
        position, quaternion = log["object_position_m"][row], log["object_quaternion_wxyz"][row]
        place(box, self.scene.task.goal_frame, position.tolist(), quaternion.tolist())
        box.linear_velocity[:] = self.box_velocity[row].tolist()
        box.angular_velocity[:] = self.box_rotation[row].tolist()
        ball.position[:] = log["sphere_position_m"][row].tolist()
        ball.linear_velocity[:] = self.ball_velocity[row].tolist()


def replay(options: Options) -> int:
    """Publishes until the run's end or a signal; gives the exit code."""
    log, bridge = load(options.run)
    recording = Recording(log, load_scene(Path(str(bridge.get("scene")))))
    names = recording.chain.joint_names
    time_ns = (1e9 * (log["time_s"] - log["time_s"][0])).astype(np.int64).tolist()
    rounds = 0
    instance = Instance(options.instance)
    with StopSignal() as stop, StatePublisher(instance, names, Bounds()) as robot:
        print(
            f"instance {options.instance}: {len(time_ns)} states of {options.run} in "
            f"{1e-9 * time_ns[-1]:.1f} s{', again and again' if options.loop else ''}; commands "
            "are not obeyed",
            flush=True,
        )
        begun_ns = time.monotonic_ns()
        while not stop.requested and (rounds == 0 or options.loop):
            for row, after_ns in enumerate(time_ns):
                recording.fill(robot, row)
                time.sleep(max(0, begun_ns + after_ns - time.monotonic_ns()) * 1e-9)
                now_ns = time.monotonic_ns()
                robot.command(now_ns)
                robot.publish(now_ns, recording.frames)
                if stop.requested:
                    break
            rounds += 1
            begun_ns += time_ns[-1] + time_ns[1]
    return 0
