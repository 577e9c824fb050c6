"""What every state publisher needs: ports, a guard, counted and stamped messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sim_bridge.guard import Action, Bounds, CommandGuard
from sim_bridge.messages import JointCommand, RobotState, TaskFrames, joint_names_hash
from sim_bridge.services import Instance, StatePublisherPorts

if TYPE_CHECKING:
    from typing_extensions import Self


class StatePublisher:
    """Whoever moves a robot asks it what to do, and tells it where the robot is.

    The same in Rust: `controller/messages/src/publisher.rs`. `state` is what is published next: set
    what was measured, the rest is set already.
    """

    def __init__(self, instance: Instance, joints: Sequence[str], bounds: Bounds) -> None:
        self.state = RobotState(joint_count=len(joints))
        self.state.joint_names_hash = joint_names_hash(joints)
        self.guard = CommandGuard(len(joints), bounds)
        self._ports = StatePublisherPorts(instance)
        self._command = JointCommand()

    def command(self, now_ns: int) -> Action:
        """What the robot shall do at the time `now_ns` [ns]: obey the newest command, or brake."""
        new = self._command if self._ports.receive_command(self._command) else None
        return self.guard.judge(now_ns, new, self.state)

    def publish(self, now_ns: int, frames: TaskFrames) -> None:
        """Publishes frames and state, counted and stamped with when they were measured [ns]."""
        self.state.sequence = frames.sequence = self.state.sequence + 1
        self.state.time_ns = frames.time_ns = now_ns
        self._ports.publish(frames, self.state)

    def close(self) -> None:
        """Closes the ports."""
        self._ports.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
