"""A state publisher, whole: an ideal robot in the plane that moves as it is commanded.

It publishes the two frames of the planar skill, too. `controller run config/controllers/planar.ron`
connects to it. The same in Rust: `controller/messages/examples/state_publisher.rs`.
"""

import sys
import time

from sim_bridge.guard import Bounds, CommandGuard, JointBounds
from sim_bridge.messages import JointCommand, RobotState, TaskFrames, joint_names_hash, write_name
from sim_bridge.services import Instance, StatePublisherPorts, StopSignal

instance = sys.argv[1] if len(sys.argv) > 1 else "default"
state, frames = RobotState(joint_count=2), TaskFrames(frame_count=2)
state.joint_names_hash = joint_names_hash(("x_joint", "y_joint"))
for frame, name, position in zip(frames.frames, ("start", "end"), ((0, 0, 0), (2, 1, 0))):
    write_name(frame, name)
    frame.valid, frame.position[:], frame.quaternion[:] = 1, position, (1, 0, 0, 0)
# 20 m/s and 60 m/s² are what this robot can do; it brakes with 30 m/s².
guard = CommandGuard(2, Bounds(joints=JointBounds([20.0] * 2, [60.0] * 2, [30.0] * 2)))
command = JointCommand()
with StopSignal() as stop, StatePublisherPorts(Instance(instance)) as ports:
    while not stop.requested:
        new = command if ports.receive_command(command) else None
        now_ns = time.monotonic_ns()
        # Where it obeys and where it brakes, this robot is where it shall be.
        action = guard.judge(now_ns, new, state)
        state.position[:2], state.velocity[:2] = action.position, action.velocity
        state.sequence = frames.sequence = state.sequence + 1
        state.time_ns = frames.time_ns = now_ns
        ports.publish(frames, state)
        time.sleep(0.001)
if guard.last_fault is not None:
    print(f"the last fault of a command: {guard.last_fault}", file=sys.stderr)
