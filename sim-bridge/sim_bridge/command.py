"""Commands the tool beside the skill: the same velocity, again and again, for a while."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from sim_bridge.errors import BridgeError
from sim_bridge.messages import RobotState, ToolCommand
from sim_bridge.services import Instance, StopSignal, ToolCommandPorts


@dataclass(frozen=True)
class Options:
    """What is commanded, to whom, and for how long."""

    instance: str
    linear_m_s: tuple[float, float, float]
    """Velocity of the tool's origin in B [m/s]."""
    angular_rad_s: tuple[float, float, float]
    """Angular velocity of the tool in B [rad/s]."""
    for_s: float
    """How long [s]."""
    rate_hz: float
    """How often it is sent [1/s]."""
    wait_s: float
    """How long to wait for a state and for a controller that listens [s]."""

    def check(self) -> None:
        """Raises `BridgeError` when a number is outside its range."""
        for option, values in (("--linear", self.linear_m_s), ("--angular", self.angular_rad_s)):
            if not all(map(math.isfinite, values)):
                raise BridgeError(f"{option}: expected three finite numbers, found {values}")
        for option, value in (("--for-s", self.for_s), ("--wait-s", self.wait_s)):
            if not 0.0 < value < math.inf:
                raise BridgeError(f"{option}: expected a number above 0, found {value}")
        if not 1.0 <= self.rate_hz <= 1000.0:
            raise BridgeError(f"--rate-hz: expected 1 to 1000, found {self.rate_hz}")


def command(options: Options) -> int:
    """Sends the command until its time is over or a signal comes; gives the exit code.

    The commands are stamped with the time of the robot's newest state: so they are fresh on the
    clock that the controller goes by, the machine's or a simulated one.
    """
    options.check()
    instance = Instance(options.instance)
    with StopSignal() as stop, ToolCommandPorts(instance) as ports:
        message, state = ToolCommand(), RobotState()
        message.linear_velocity[:] = options.linear_m_s
        message.angular_velocity[:] = options.angular_rad_s
        begin_s = None
        opened_s = time.monotonic()
        seen = False
        while not stop.requested:
            now_s = time.monotonic()
            if begin_s is not None and now_s - begin_s >= options.for_s:
                break
            seen |= ports.receive_state(state)
            if seen:
                message.sequence += 1
                message.time_ns = state.time_ns
                if ports.publish(message) > 0 and begin_s is None:
                    begin_s = now_s
                    _announce(options)
            if begin_s is None and now_s - opened_s > options.wait_s:
                raise BridgeError(_missing(options.instance, seen))
            time.sleep(1.0 / options.rate_hz)
    print(f"let go after {message.sequence} messages: the controller goes on by itself", flush=True)
    return 0


def _announce(options: Options) -> None:
    linear, angular = (
        " ".join(f"{value:g}" for value in values)
        for values in (options.linear_m_s, options.angular_rad_s)
    )
    print(
        f"commanding {linear} m/s and {angular} rad/s on instance `{options.instance}` for "
        f"{options.for_s:g} s; Ctrl-C lets go",
        flush=True,
    )


def _missing(instance: str, seen: bool) -> str:
    if not seen:
        return (
            f"no robot publishes its state on instance `{instance}`: start one, or name its "
            "--instance"
        )
    return (
        f"no controller of instance `{instance}` listens: start one whose configuration has "
        "`external: (…)` and not `external: None`"
    )
