"""A state publisher, whole: an ideal robot in the plane that moves as it is commanded.

It publishes the two frames of the planar skill, too. `controller run config/controllers/planar.ron`
connects to it. The same in Rust: `controller/messages/examples/state_publisher.rs`.
"""

import sys
import time

from sim_bridge.messages import JointCommand, RobotState, TaskFrames, write_name
from sim_bridge.services import Instance, StatePublisherPorts, StopSignal

instance = sys.argv[1] if len(sys.argv) > 1 else "default"
state, frames = RobotState(joint_count=2), TaskFrames(frame_count=2)
for frame, name, position in zip(frames.frames, ("start", "end"), ((0, 0, 0), (2, 1, 0))):
    write_name(frame, name)
    frame.valid, frame.position[:], frame.quaternion[:] = 1, position, (1, 0, 0, 0)
command = JointCommand()
with StopSignal() as stop, StatePublisherPorts(Instance(instance)) as ports:
    while not stop.requested:
        now_ns = time.monotonic_ns()
        ports.receive_command(command)
        state.position[:] = command.position
        state.velocity[:] = command.velocity if now_ns < command.expiry_ns else [0.0] * 8
        state.sequence = frames.sequence = state.sequence + 1
        state.time_ns = frames.time_ns = now_ns
        ports.publish(frames, state)
        time.sleep(0.001)
