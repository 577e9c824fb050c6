"""What the joints of a simulated arm have beside the masses of its description."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from sim_bridge.errors import BridgeError

INTERFACES = ("torque", "position", "velocity")
"""What the arm makes of a command: torques, or set points of a servo of its own."""


@dataclass(frozen=True)
class Joints:
    """Joints of the arm, the same for all where it does not say otherwise.

    The friction of joint i is F + f·(its effort), a constant torque against its motion; while it
    rests, any torque up to that. Mass error and payload are unknown to whoever commands the arm.
    """

    interface: str = "torque"
    friction: float = 0.0
    """F [N m]."""
    friction_fraction: float = 0.0
    """f, of each joint's effort."""
    viscous: float = 0.0
    """Torque against the motion, in proportion to the speed [N m s/rad]."""
    armature: float = 0.0
    """Inertia of the rotor at the joint [kg m²]."""
    payload_kg: float = 0.0
    """A ball within the tool [kg]."""
    mass_error: float = 0.0
    """Every mass and inertia is the description's times one plus this."""
    servo_lag_s: float = 0.0
    """Time constant T of a servo: T q̇ = q_command − q, or T q̈ = q̇_command − q̇ [s]."""

    def check(self) -> None:
        """Raises `BridgeError` where a value is outside its range."""
        if self.interface not in INTERFACES:
            raise BridgeError(
                f"--interface: expected {', '.join(INTERFACES)}, found `{self.interface}`"
            )
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "interface":
                continue
            low = -0.9 if item.name == "mass_error" else 0.0
            if not math.isfinite(value) or not low <= value <= 1000.0:
                option = "--" + item.name.replace("_", "-")
                raise BridgeError(f"{option}: expected {low:g} to 1000, found {value:g}")
        if self.interface == "torque" and self.servo_lag_s > 0.0:
            raise BridgeError(
                "--servo-lag-s: expected 0 with --interface torque, found "
                f"{self.servo_lag_s:g}: torques act at once; choose position or velocity"
            )
