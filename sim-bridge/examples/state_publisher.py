"""A state publisher, whole: an ideal robot in the plane that moves as it is commanded.

It publishes the two frames of the planar skill, too. `controller run config/controllers/planar.ron`
connects to it.
"""

import sys
import time

from sim_bridge.guard import Bounds, JointBounds
from sim_bridge.messages import TaskFrames, place
from sim_bridge.publisher import StatePublisher
from sim_bridge.services import Instance, StopSignal

instance = Instance(sys.argv[1] if len(sys.argv) > 1 else "default")
# 20 m/s and 60 m/s² are what this robot can do; it brakes with 30 m/s².
bounds = Bounds(joints=JointBounds([20.0] * 2, [60.0] * 2, [30.0] * 2))
frames = TaskFrames(frame_count=2)
place(frames.frames[0], "start", (0.0, 0.0, 0.0))
place(frames.frames[1], "end", (2.0, 1.0, 0.0))
with StopSignal() as stop, StatePublisher(instance, ("x_joint", "y_joint"), bounds) as robot:
    while not stop.requested:
        now_ns = time.monotonic_ns()
        # Where it obeys and where it brakes, this robot is where it shall be.
        action = robot.command(now_ns)
        robot.state.position[:2], robot.state.velocity[:2] = action.position, action.velocity
        robot.publish(now_ns, frames)
        time.sleep(0.001)
