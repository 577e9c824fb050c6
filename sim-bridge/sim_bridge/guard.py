"""The receiving side: which commands a robot obeys, and how it comes to rest when it does not.

The same as `controller/messages/src/guard.rs`, whose README has the rules and numbers; both are
tested to give the same verdicts, bit for bit. Times are on one clock, that of the states.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import Enum

from sim_bridge.messages import (
    JOINT_CAPACITY,
    CommandMode,
    GripperCommand,
    JointCommand,
    Reason,
    RobotState,
)

AHEAD_MAX_NS = 1_000_000
"""How far a command may be stamped in the future."""
STEP_MIN_NS = 1_000_000
"""Steps are measured against at least this time between two commands."""
STEP_FACTOR = 2.0
"""How many times a joint's speed and acceleration bounds setpoints may step by."""

_MODES = frozenset(CommandMode)
_REASONS = frozenset(Reason)
_GRIPPERS = frozenset(GripperCommand)


@dataclass(frozen=True)
class JointBounds:
    """What the joints can do, for a robot with a position or velocity interface; all positive."""

    speed_max: Sequence[float]
    """Greatest speeds [rad/s or m/s]."""
    acceleration_max: Sequence[float]
    """Greatest accelerations [rad/s² or m/s²]."""
    deceleration: Sequence[float]
    """How hard the robot brakes [rad/s² or m/s²]."""
    continuous: Collection[int] = ()
    """Joints, counted from 0, that rotate without an end: their steps are measured modulo a turn,
    as a robot that reports them within one is commanded."""


@dataclass(frozen=True)
class Bounds:
    """What a command is held against."""

    lifetime_max_ns: int = 100_000_000
    """How long a command counts at most, after its own time and after it was received."""
    state_lag_max: int = 100
    """How many states may have been published since the one that a command answers."""
    resume_s: float = 0.1
    """How far from the measured state obeying may begin: what a joint moves in this time at its
    greatest speed, and gains with its greatest acceleration. No less than the controller's
    `reference_time_constant_s`."""
    joints: JointBounds | None = None
    """`None` for a torque interface: no steps are checked, and it brakes by torques of its own."""


class Cause(str, Enum):
    """What is wrong with a command. All but the last two make the robot brake."""

    JOINT_COUNT = "joint_count"
    MODE = "mode"
    AHEAD = "ahead"
    EXPIRED = "expired"
    SEQUENCE = "sequence"
    STATE_AHEAD = "state_ahead"
    STATE_OLD = "state_old"
    NOT_FINITE = "not_finite"
    STEP = "step"
    ELSEWHERE = "elsewhere"
    REASON = "reason"
    GRIPPER = "gripper"


_TEXTS = {
    Cause.JOINT_COUNT: "is for {found:.0f} joints, this robot has {expected:.0f}: the controller's "
    "configuration is another robot's",
    Cause.MODE: "has the unknown mode {found:.0f}: both sides must be of one version",
    Cause.AHEAD: "is stamped {found_s:.3f} s in the future: both sides must read CLOCK_MONOTONIC "
    "in ns, or both run in lockstep",
    Cause.EXPIRED: "has expired {found_s:.3f} s ago, and no newer one has come: the controller has "
    "ended, is held up, or its clock is another one",
    Cause.SEQUENCE: "comes after command {expected:.0f}, which still counts: two controllers, or "
    "one that was started again and is obeyed in a moment",
    Cause.STATE_AHEAD: "answers state {found:.0f}, the newest is {expected:.0f}: it is meant for "
    "another publisher, or for this one before it was started again",
    Cause.STATE_OLD: "answers a state {found:.0f} states before the newest, at most {expected:.0f} "
    "may be: the controller receives no states",
    Cause.NOT_FINITE: "has a number of joint {joint} that is not finite",
    Cause.STEP: "steps by {found:.4f} at joint {joint} (position or velocity), at most "
    "{expected:.4f} may be: the bounds of this robot are tighter than the controller's, or the "
    "setpoint jumps",
    Cause.ELSEWHERE: "begins {found:.4f} from where joint {joint} is measured (position or "
    "velocity), at most {expected:.4f} may be: the controller must begin from the measured state",
    Cause.REASON: "has the unknown reason {found:.0f}, which changes nothing",
    Cause.GRIPPER: "has the unknown gripper command {found:.0f}: the gripper stays as it is",
}


@dataclass(frozen=True)
class CommandFault:
    """What is wrong with a command, with the numbers; as text, what leads to the cause."""

    cause: Cause
    sequence: int
    """Of the command."""
    joint: int
    """Counted from 0, where it is one of them."""
    found: float
    """The unit depends on the cause."""
    expected: float
    """What was expected, or the most that may be."""

    def __str__(self) -> str:
        """What leads to the cause."""
        return f"command {self.sequence} " + _TEXTS[self.cause].format(
            joint=self.joint,
            found=self.found,
            found_s=1e-9 * self.found,
            expected=self.expected,
        )


@dataclass(frozen=True)
class Action:
    """What the robot shall do until the next tick."""

    obey: bool
    """Obey `CommandGuard.command`; otherwise brake to rest and hold."""
    position: list[float]
    """Setpoints of a position interface [rad or m]; of a braked torque interface, as measured."""
    velocity: list[float]
    """Setpoints of a velocity interface [rad/s or m/s]."""


class CommandGuard:
    """Judges the commands for a robot of `joints` joints: see the module."""

    def __init__(self, joints: int, bounds: Bounds | None = None) -> None:
        assert 1 <= joints <= JOINT_CAPACITY, f"1 to {JOINT_CAPACITY} joints: {joints}"
        self._joints = joints
        self._bounds = bounds or Bounds()
        limits = self._bounds.joints
        if limits is not None:
            for numbers in (limits.speed_max, limits.acceleration_max, limits.deceleration):
                assert len(numbers) >= joints, f"a bound for each of {joints} joints: {numbers}"
                assert all(number > 0.0 for number in numbers[:joints]), numbers
        self.command = JointCommand()
        """The last command that held: what is obeyed, where `Action.obey` says so."""
        self.gripper = GripperCommand.RELEASE
        """What a command that held said last. Braking does not let go."""
        self.counts: dict[Cause, int] = {}
        """How often each cause was found."""
        self.last_fault: CommandFault | None = None
        """What was found last."""
        self._received_ns = 0
        self._valid_until_ns = 0
        self._obeys = False
        self._last: tuple[Action, int] | None = None
        self._brake: tuple[Action, int] | None = None

    def judge(self, now_ns: int, new: JointCommand | None, state: RobotState) -> Action:
        """What the robot shall do from `now_ns` until the next tick.

        `new` is the command that has come since the last tick, if one has: each once. `state` is
        the newest published one: its sequence number, positions and velocities count.
        """
        if new is not None:
            fault = self._check(now_ns, new, state)
            if fault is None:
                self._accept(now_ns, new)
            else:
                self._refuse(fault)
        if self._obeys and now_ns >= self._valid_until_ns:
            age_ns = now_ns - self._valid_until_ns
            self._refuse(_fault(Cause.EXPIRED, self.command, age_ns))
        action = self._go_on(now_ns) if self._obeys else self._come_to_rest(now_ns, state)
        self._last = (action, now_ns)
        return action

    def _note(self, fault: CommandFault) -> None:
        self.counts[fault.cause] = self.counts.get(fault.cause, 0) + 1
        self.last_fault = fault

    def _refuse(self, fault: CommandFault) -> None:
        self._obeys = False
        self._note(fault)

    def _accept(self, now_ns: int, command: JointCommand) -> None:
        ctypes.memmove(ctypes.byref(self.command), ctypes.byref(command), ctypes.sizeof(command))
        self._received_ns = now_ns
        self._valid_until_ns = self._expiry_ns(now_ns, command)
        self._obeys = command.mode != CommandMode.STOP
        if command.reason not in _REASONS:
            self._note(_fault(Cause.REASON, command, command.reason))
        if command.gripper_command in _GRIPPERS:
            self.gripper = GripperCommand(command.gripper_command)
        else:
            self._note(_fault(Cause.GRIPPER, command, command.gripper_command))

    def _expiry_ns(self, received_ns: int, command: JointCommand) -> int:
        most = min(command.time_ns, received_ns) + self._bounds.lifetime_max_ns
        return min(command.expiry_ns, most)

    def _check(self, now_ns: int, command: JointCommand, state: RobotState) -> CommandFault | None:
        if command.joint_count != self._joints:
            return _fault(Cause.JOINT_COUNT, command, command.joint_count, self._joints)
        if command.mode not in _MODES:
            return _fault(Cause.MODE, command, command.mode)
        fault = self._check_time(now_ns, command)
        if fault is not None or command.mode == CommandMode.STOP:
            # A stop asks for nothing that could be wrong.
            return fault
        lag = state.sequence - command.state_sequence
        if lag < 0:
            return _fault(Cause.STATE_AHEAD, command, command.state_sequence, state.sequence)
        if command.state_sequence == 0 or lag > self._bounds.state_lag_max:
            return _fault(Cause.STATE_OLD, command, lag, self._bounds.state_lag_max)
        return self._check_numbers(command) or self._check_step(command, state)

    def _check_time(self, now_ns: int, command: JointCommand) -> CommandFault | None:
        ahead_ns = command.time_ns - now_ns
        if ahead_ns > AHEAD_MAX_NS:
            return _fault(Cause.AHEAD, command, ahead_ns, AHEAD_MAX_NS)
        expiry_ns = self._expiry_ns(now_ns, command)
        if now_ns >= expiry_ns:
            return _fault(Cause.EXPIRED, command, now_ns - expiry_ns)
        if command.sequence <= self.command.sequence and now_ns < self._valid_until_ns:
            return _fault(Cause.SEQUENCE, command, command.sequence, self.command.sequence)
        return None

    def _check_numbers(self, command: JointCommand) -> CommandFault | None:
        for field in ("position", "velocity", "acceleration", "torque", "gravity_torque"):
            for joint, number in enumerate(getattr(command, field)[: self._joints]):
                if not math.isfinite(number):
                    return _fault(Cause.NOT_FINITE, command, number, 0.0, joint)
        return None

    def _check_step(self, command: JointCommand, state: RobotState) -> CommandFault | None:
        """Holds position and velocity against what is obeyed, or against what is measured."""
        limits = self._bounds.joints
        if limits is None:
            return None
        if self._obeys:
            since_ns = max(command.time_ns - self.command.time_ns, 0)
            since_ns = max(min(since_ns, self._bounds.lifetime_max_ns), STEP_MIN_NS)
            cause, before, reach_s = Cause.STEP, self.command, STEP_FACTOR * (since_ns * 1e-9)
        else:
            cause, before, reach_s = Cause.ELSEWHERE, state, self._bounds.resume_s
        for joint in range(self._joints):
            speed = limits.speed_max[joint]
            position, velocity = command.position[joint], command.velocity[joint]
            step = abs(position - before.position[joint])
            if joint in limits.continuous and step > math.pi:
                step = abs(step - math.tau)
            for why, found, most in (
                (cause, step, speed * reach_s),
                (
                    cause,
                    abs(velocity - before.velocity[joint]),
                    limits.acceleration_max[joint] * reach_s,
                ),
                (Cause.STEP, abs(velocity), STEP_FACTOR * speed),
            ):
                # So that what is measured as not a number is refused, too.
                within = found <= most
                if not within:
                    return _fault(why, command, found, most, joint)
        return None

    def _go_on(self, now_ns: int) -> Action:
        """The command, carried on with its velocity since it came."""
        self._brake = None
        position = self.command.position[: self._joints]
        velocity = self.command.velocity[: self._joints]
        if self._bounds.joints is not None:
            since_s = max(now_ns - self._received_ns, 0) * 1e-9
            position = [p + v * since_s for p, v in zip(position, velocity)]
        return Action(True, position, velocity)

    def _come_to_rest(self, now_ns: int, state: RobotState) -> Action:
        """All joints arrive at rest together, the hardest-braked one with its deceleration.

        From p₀ and v₀ for T = max |v₀ᵢ|/dᵢ: p(t) = p₀ + v₀ (t − t²/2T), v(t) = v₀ (1 − t/T).
        """
        n, limits = self._joints, self._bounds.joints
        if limits is None:
            return Action(False, state.position[:n], [0.0] * n)
        if self._brake is None:
            measured = Action(False, state.position[:n], state.velocity[:n])
            self._brake = self._last or (measured, now_ns)
        begin, since_ns = self._brake
        time_s = max(now_ns - since_ns, 0) * 1e-9
        duration_s = 0.0
        for velocity, deceleration in zip(begin.velocity, limits.deceleration):
            needed_s = abs(velocity) / deceleration
            if needed_s > duration_s:
                duration_s = needed_s
        if time_s < duration_s:
            path_s = time_s - time_s * time_s / (2.0 * duration_s)
            fraction = 1.0 - time_s / duration_s
        else:
            path_s, fraction = 0.5 * duration_s, 0.0
        return Action(
            False,
            [p + v * path_s for p, v in zip(begin.position, begin.velocity)],
            [v * fraction for v in begin.velocity],
        )


def _fault(
    cause: Cause, command: JointCommand, found: float, expected: float = 0.0, joint: int = 0
) -> CommandFault:
    return CommandFault(cause, command.sequence, joint, float(found), float(expected))


def counted(counts: dict[str, int]) -> str:
    """Counts by name, in words."""
    return ", ".join(f"{count} {name}" for name, count in counts.items()) or "none"
