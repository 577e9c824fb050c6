"""What libfranka accepts from one millisecond to the next, and how the arm comes to rest.

A command beyond these limits is a reflex: the arm locks its brakes until somebody has looked. The
clock here is the robot's: one step is one of its milliseconds, however late a packet comes.

Limits: `rate_limiting.h` of libfranka, and the `position_based_velocity_limits` of the FR3 in
franka_description. Gains of the hold: libfranka's example `joint_impedance_control`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from sim_bridge.kinematics import Chain

JOINTS = 7
STEP_S = 1e-3
TORQUE_RATE_MAX_N_M_S = 1000.0
ACCELERATION_MAX_RAD_S2 = 10.0
JERK_MAX_RAD_S3 = 5000.0
RESERVE = 0.95
"""Which fraction of libfranka's limits is used."""
SPEED_OFFSET_RAD_S = (0.652, 0.25, 0.2005, 0.3542, 0.5738, 0.4885, 0.4592)
SPEED_DECELERATION_RAD_S2 = (6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0)
"""Near its position limit a joint may be as fast as it can brake: -o + sqrt(2 d (limit - q))."""
BRAKE_RAD_S2 = 5.0
"""How hard the arm brakes when it does not obey."""
HOLD_STIFFNESS_N_M_RAD = (600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0)
HOLD_DAMPING_N_M_S_RAD = (50.0, 50.0, 50.0, 50.0, 30.0, 25.0, 15.0)
SLOW_FRACTION = 0.2
"""Of each joint's greatest speed, in the slow mode."""
REST_RAD_S = 0.01
"""Below this the arm counts as at rest."""
FOLLOW_1_S = 50.0
"""Rate at which the position reference follows the setpoints: it hides the jitter of their
arrival, and does not lag behind a constant velocity."""


@dataclass
class TorqueLimit:
    """Torques within effort and rate of change."""

    effort_max_n_m: Sequence[float]

    def limited(self, wanted: Sequence[float], before: Sequence[float]) -> list[float]:
        """The torques nearest to `wanted` that may follow on `before` [N m].

        `before` is what the robot says that it commands, so that a packet that was lost on the
        way makes no step.
        """
        most = RESERVE * TORQUE_RATE_MAX_N_M_S * STEP_S
        limited = []
        for torque, last, effort in zip(wanted, before, self.effort_max_n_m):
            torque = min(max(torque, -effort), effort)
            limited.append(min(max(torque, last - most), last + most))
        return limited


class TorqueBrake:
    """Torques that brake the arm along its velocity and hold it where it came to rest."""

    def __init__(self) -> None:
        self._reference: tuple[list[float], list[float]] | None = None

    def release(self) -> None:
        """The arm obeys: the next brake begins anew where it is measured then."""
        self._reference = None

    def torque(self, q: Sequence[float], dq: Sequence[float], steps: int) -> list[float]:
        """Torques without gravity [N m], for an arm at `q` [rad] and `dq` [rad/s]."""
        if self._reference is None:
            self._reference = list(q), list(dq)
        position, velocity = self._reference
        for joint in range(JOINTS):
            for _ in range(steps):
                position[joint] += STEP_S * velocity[joint]
            change = BRAKE_RAD_S2 * STEP_S * steps
            speed = max(abs(velocity[joint]) - change, 0.0)
            velocity[joint] = math.copysign(speed, velocity[joint])
        return [
            k * (p - a) + d * (v - b)
            for k, d, p, a, v, b in zip(
                HOLD_STIFFNESS_N_M_RAD, HOLD_DAMPING_N_M_S_RAD, position, q, velocity, dq
            )
        ]


def speed_bounds(chain: Chain, joint: int, q: float) -> tuple[float, float]:
    """Least and greatest velocity of a joint at `q` [rad] that the robot accepts [rad/s]."""
    most = float(chain.velocity_max_rad_s[joint])

    def towards(distance_rad: float) -> float:
        root = math.sqrt(max(2.0 * SPEED_DECELERATION_RAD_S2[joint] * distance_rad, 0.0))
        return min(max(root - SPEED_OFFSET_RAD_S[joint], 0.0), most)

    lower, upper = float(chain.position_min_rad[joint]), float(chain.position_max_rad[joint])
    return -towards(q - lower), towards(upper - q)


class PositionReference:
    """Joint positions that follow setpoints within speed, acceleration and jerk.

    q̈ = ω² (q_s - q) + 2 ω (q̇_s - q̇), critically damped.
    """

    def __init__(self, chain: Chain, position_rad: Sequence[float], speed_fraction: float) -> None:
        self._chain = chain
        self._speed_fraction = speed_fraction
        self.position = list(position_rad)
        self.velocity = [0.0] * JOINTS
        self._acceleration = [0.0] * JOINTS
        self._rest: list[float] | None = None

    def follow(self, position: Sequence[float], velocity: Sequence[float], steps: int) -> None:
        """Goes on for `steps` milliseconds towards setpoints [rad] and [rad/s]."""
        self._rest = None
        self._towards(position, velocity, steps)

    def brake(self, q: Sequence[float], dq: Sequence[float], steps: int) -> None:
        """Goes on for `steps` milliseconds towards rest, for an arm at `q` [rad] and `dq` [rad/s].

        A reference in motion is ahead of the arm by its servo's lag: it returns to where the arm
        can come to rest. One that stands still stays, so that a load does not drag it along.
        """
        if self._rest is None:
            self._rest = list(self.position)
            if not self.rests:
                self._rest = [p + v * abs(v) / (2.0 * BRAKE_RAD_S2) for p, v in zip(q, dq)]
        self._towards(self._rest, [0.0] * JOINTS, steps)

    def _towards(self, position: Sequence[float], velocity: Sequence[float], steps: int) -> None:
        for joint in range(JOINTS):
            for _ in range(steps):
                away = position[joint] - self.position[joint]
                # From far away no faster than it can brake again.
                most = math.sqrt(BRAKE_RAD_S2 * abs(away))
                closing = min(max(0.5 * FOLLOW_1_S * away, -most), most)
                self._step(joint, velocity[joint] + closing)

    def _step(self, joint: int, velocity: float) -> None:
        """One millisecond, in which the joint tends to a velocity [rad/s]."""
        q, v = self.position[joint], self.velocity[joint]
        slowest, fastest = speed_bounds(self._chain, joint, q)
        velocity = min(
            max(velocity, self._speed_fraction * slowest), self._speed_fraction * fastest
        )
        most = RESERVE * ACCELERATION_MAX_RAD_S2
        wanted = min(max(2.0 * FOLLOW_1_S * (velocity - v), -most), most)
        jerk = RESERVE * JERK_MAX_RAD_S3 * STEP_S
        before = self._acceleration[joint]
        self._acceleration[joint] = min(max(wanted, before - jerk), before + jerk)
        self.velocity[joint] = v + self._acceleration[joint] * STEP_S
        self.position[joint] = q + self.velocity[joint] * STEP_S

    @property
    def rests(self) -> bool:
        """Whether the reference stands still."""
        return all(abs(velocity) < REST_RAD_S for velocity in self.velocity)


@dataclass
class SlowMode:
    """Refuses what is faster than a fraction of the joints' greatest speeds.

    After that the arm has to come to rest before it obeys again.
    """

    speed_max_rad_s: Sequence[float]
    full_speed: bool = False
    refused: int = 0
    """Times that something was too fast."""
    last: str | None = None
    """What was too fast last, as a sentence."""
    _waits: bool = field(default=False, repr=False)

    def permits(self, commanded: Sequence[float] | None, measured: Sequence[float]) -> bool:
        """Whether the arm may obey at these velocities [rad/s]; `None`: it does not obey."""
        if self.full_speed:
            return True
        if self._waits:
            self._waits = any(abs(speed) > REST_RAD_S for speed in measured)
        elif commanded is not None:
            self._look("is commanded to move at", commanded)
            self._look("moves at", measured)
        return not self._waits

    def _look(self, what: str, velocity: Sequence[float]) -> None:
        for joint, (speed, top) in enumerate(zip(velocity, self.speed_max_rad_s)):
            if not abs(speed) <= SLOW_FRACTION * top and not self._waits:
                self._waits = True
                self.refused += 1
                self.last = (
                    f"joint {joint + 1} {what} {speed:.2f} rad/s, at most "
                    f"{SLOW_FRACTION * top:.2f} may be in the slow mode: lower the controller's "
                    "`robot.velocity_fraction`, or start with --full-speed"
                )
