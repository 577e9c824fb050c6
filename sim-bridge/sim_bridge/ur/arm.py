"""A stand-in for a Universal Robot's arm and controller: servos, registers, inputs and outputs.

The joints have the dynamics of servos: `servoj` moves a reference by q̈ = g (q_set - q) - g T q̇,
with gain g and lookahead time T, which follows a ramp T late; `speedj` and the stops move it with
an acceleration. The joints follow the reference behind a lag of first order. There are no masses
and no contacts. The figures are chosen, not measured on a robot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from enum import IntEnum

from sim_bridge.ur.protocol import REGISTERS
from sim_bridge.ur.urscript import Program, ScriptError

JOINTS = 6
SUBSTEP_S = 0.002
DRIVE_LAG_S = 0.006
SPEED_MAX_RAD_S = math.pi
ACCELERATION_MAX_RAD_S2 = 80.0
POSITION_MAX_RAD = 2.0 * math.pi
STOP_RAD_S2 = 20.0
"""How hard an arm brakes whose program moves it no more."""
REST_RAD_S = 1e-3


class Safety(IntEnum):
    """Safety modes, as `safety_mode` counts them."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9


class Mode(IntEnum):
    """Robot modes, as `robot_mode` counts them."""

    POWER_OFF = 3
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7


class Arm:
    """The arm, stepped by `step`; `rate_hz` is 125 of a CB3 and 500 of an e-Series."""

    def __init__(self, rate_hz: float, home_rad: Sequence[float]) -> None:
        self.period_s = 1.0 / rate_hz
        self.time_s = 0.0
        self.q, self.qd = list(home_rad), [0.0] * JOINTS
        """The reference [rad], [rad/s]."""
        self.actual_q, self.actual_qd = list(home_rad), [0.0] * JOINTS
        self.mode, self.safety = Mode.RUNNING, Safety.NORMAL
        self.slider = 1.0
        self.inputs = 0
        self.outputs = 0
        """Digital ones: standard at 0, configurable at 8, of the tool at 16."""
        self.program: Program | None = None
        self.messages: list[str] = []
        """What programs said, and why they ended; the newest hundred."""
        self.rule: Callable[[Arm], int] | None = None
        """Gives the digital inputs anew at each step."""
        self._registers = {
            f"{way}_{kind}_register_{i}": zero
            for way in ("input", "output")
            for kind, zero in (("int", 0), ("double", 0.0))
            for i in range(REGISTERS)
        }
        self._bits = dict.fromkeys(
            (f"{w}_bit_registers{r}" for w in ("input", "output") for r in ("0_to_31", "32_to_63")),
            0,
        )
        self._watchdog: tuple[str, float] | None = None
        self._written_s: dict[str, float] = {}
        self._goal: Callable[[float], list[float]] | None = None

    # What RTDE reads and writes.

    def output(self, name: str) -> object:
        """The value of an output variable."""
        if name in self._registers:
            return self._registers[name]
        if name in self._bits:
            return self._bits[name]
        return getattr(self, f"_{name}")()

    def write(self, values: dict[str, object]) -> None:
        """Input variables that a client has sent together."""
        for name, value in values.items():
            self._written_s[name] = self.time_s
            if name in self._registers:
                self._registers[name] = value
            elif name in self._bits:
                self._bits[name] = value
        for prefix, shift in (("standard", 0), ("configurable", 8), ("tool", 16)):
            name = f"{prefix}_digital_output"
            mask = int(values.get(f"{name}_mask", 0)) << shift
            bits = int(values.get(name, 0)) << shift
            self.outputs = (self.outputs & ~mask) | (bits & mask)
        fraction = float(values.get("speed_slider_fraction", math.nan))
        if values.get("speed_slider_mask") and 0.0 <= fraction <= 1.0:
            self.slider = fraction

    def _timestamp(self) -> float:
        return self.time_s

    def _target_q(self) -> list[float]:
        return self.q

    def _target_qd(self) -> list[float]:
        return self.qd

    def _actual_q(self) -> list[float]:
        return self.actual_q

    def _actual_qd(self) -> list[float]:
        return self.actual_qd

    def _robot_mode(self) -> int:
        return self.mode

    def _safety_mode(self) -> int:
        return self.safety

    def _robot_status_bits(self) -> int:
        powered, teaches = self.mode != Mode.POWER_OFF, self.mode == Mode.BACKDRIVE
        return powered | self.playing << 1 | teaches << 2

    def _safety_status_bits(self) -> int:
        emergency = self.safety in (Safety.SYSTEM_EMERGENCY_STOP, Safety.ROBOT_EMERGENCY_STOP)
        stopped = self.safety not in (Safety.NORMAL, Safety.REDUCED)
        low = 1 << self.safety - 1 if self.safety <= Safety.ROBOT_EMERGENCY_STOP else 0
        high = 1 << self.safety if self.safety >= Safety.VIOLATION else 0
        return low | emergency << 7 | high | stopped << 10

    def _runtime_state(self) -> int:
        return 2 if self.playing else 1

    def _speed_scaling(self) -> float:
        return self.slider

    def _target_speed_fraction(self) -> float:
        return self.slider

    def _actual_digital_input_bits(self) -> int:
        return self.inputs

    def _actual_digital_output_bits(self) -> int:
        return self.outputs

    # Programs.

    @property
    def playing(self) -> bool:
        """Whether a program runs."""
        return self.program is not None

    def play(self, text: str) -> None:
        """Runs a program in place of the one that runs; raises `ScriptError` where it is none."""
        if self.safety not in (Safety.NORMAL, Safety.REDUCED) or self.mode != Mode.RUNNING:
            raise ScriptError("is not run: the robot is stopped or not powered")
        self._watchdog = None
        self.program = Program(text, self._functions(), self._waiting())

    def stop_program(self, why: str) -> None:
        """Ends the program that runs; the arm brakes."""
        if self.program is not None:
            self._say(f"program `{self.program.name}` ended: {why}")
        self.program, self._watchdog = None, None

    def stop_for_safety(self, safety: Safety) -> None:
        """What a safety function does: the arm brakes, and no program runs any more."""
        self.safety = safety
        self.stop_program(f"safety mode {safety.name}")

    def release(self) -> None:
        """Unlocks a protective stop."""
        if self.safety == Safety.PROTECTIVE_STOP:
            self.safety = Safety.NORMAL

    def _say(self, message: str) -> None:
        self.messages = [*self.messages[-99:], message]

    def _functions(self) -> dict[str, Callable]:
        registers = self._registers
        nothing = ("set_payload", "set_tcp", "set_gravity", "zero_ftsensor")
        nothing += ("force_mode_set_gain_scaling", "force_mode_set_damping")
        return {
            **dict.fromkeys(nothing, lambda *_: None),
            "textmsg": lambda *parts: self._say("".join(map(str, parts))),
            "read_input_integer_register": lambda i: registers[f"input_int_register_{i:d}"],
            "read_input_float_register": lambda i: registers[f"input_double_register_{i:d}"],
            "write_output_integer_register": lambda i, value: registers.__setitem__(
                f"output_int_register_{i:d}", int(value)
            ),
            "write_output_float_register": lambda i, value: registers.__setitem__(
                f"output_double_register_{i:d}", float(value)
            ),
            "rtde_set_watchdog": self._set_watchdog,
            "protective_stop": lambda: self.stop_for_safety(Safety.PROTECTIVE_STOP),
            "get_actual_joint_positions": lambda: list(self.actual_q),
            "get_steptime": lambda: self.period_s,
            "set_standard_digital_out": self._set_output,
        }

    def _waiting(self) -> dict[str, Callable]:
        return {
            "sync": self._sync,
            "sleep": self._sleep,
            "servoj": self._servoj,
            "speedj": self._speedj,
            "stopj": self._stopj,
            "stopl": self._stopj,
        }

    def _set_output(self, number: int, on: bool) -> None:
        bit = 1 << number
        self.outputs = self.outputs | bit if on else self.outputs & ~bit

    def _set_watchdog(self, name: str, frequency_hz: float, action: str = "pause") -> None:
        known = name in self._registers or name in self._bits
        if not known or action not in ("pause", "stop", "ignore"):
            raise ScriptError(f"rtde_set_watchdog({name}, …, {action}): no such variable or action")
        off = action == "ignore" or frequency_hz <= 0.0
        self._written_s[name] = self.time_s
        self._watchdog = None if off else (name, 1.0 / frequency_hz)

    # Motions: each time slice says by which acceleration the reference moves in it.

    def _sync(self) -> Generator:
        yield

    def _slices(self, time_s: float) -> range:
        return range(max(1, round(time_s / self.period_s)))

    def _sleep(self, time_s: float) -> Generator:
        for _ in self._slices(time_s):
            yield

    def _servoj(
        self,
        q: Sequence[float],
        a: float = 0.0,
        v: float = 0.0,
        t: float = 0.002,
        lookahead_time: float = 0.1,
        gain: float = 300.0,
    ) -> Generator:
        """Servoes towards `q` for `t`; a and v are not used by a robot either."""
        if not (0.03 <= lookahead_time <= 0.2 and 100.0 <= gain <= 2000.0):
            raise ScriptError(
                "servoj: expected a lookahead_time of 0.03 to 0.2 s and a gain of 100 to 2000, "
                f"found {lookahead_time:g} and {gain:g}"
            )
        target, damping = self._joints(q), gain * lookahead_time
        for _ in self._slices(t):
            self._goal = lambda _dt: [
                gain * (wanted - at) - damping * speed
                for wanted, at, speed in zip(target, self.q, self.qd)
            ]
            yield

    def _speedj(self, qd: Sequence[float], a: float = 1.4, t: float = 0.0) -> Generator:
        """Goes to joint speeds `qd`; returns after `t`, or once they are reached."""
        target = self._joints(qd)
        for i in range(10**6):
            self._goal = lambda dt: self._towards(target, a, dt)
            yield
            reached = all(abs(w - v) < REST_RAD_S for w, v in zip(target, self.qd))
            if (t > 0.0 and i + 1 >= len(self._slices(t))) or (t <= 0.0 and reached):
                return

    def _stopj(self, a: float) -> Generator:
        yield from self._speedj([0.0] * JOINTS, a)

    @staticmethod
    def _joints(values: Sequence[float]) -> list[float]:
        numbers = list(map(float, values))
        if len(numbers) != JOINTS or not all(map(math.isfinite, numbers)):
            raise ScriptError(f"expected {JOINTS} finite numbers, found {numbers}")
        return numbers

    def _towards(self, target: Sequence[float], a: float, dt_s: float) -> list[float]:
        return [max(-a, min(a, (w - v) / dt_s)) for w, v in zip(target, self.qd)]

    # Time.

    def step(self) -> None:
        """One period: the program's time slice, then the joints."""
        self._goal = None
        self._watch()
        if self.program is not None:
            try:
                self.program.slice()
            except ScriptError as error:
                self.stop_program(str(error))
        if self.program is not None and not self.program.running:
            self.stop_program("it is done")
        if self.program is None:
            self._goal = None
        count = max(1, round(self.period_s / SUBSTEP_S))
        for _ in range(count):
            self._move(self.period_s / count)
        self.time_s += self.period_s
        if any(abs(q) > POSITION_MAX_RAD for q in self.actual_q):
            self.stop_for_safety(Safety.PROTECTIVE_STOP)
        if self.rule is not None:
            self.inputs = self.rule(self)

    def _watch(self) -> None:
        if self._watchdog is not None:
            name, most_s = self._watchdog
            if self.time_s - self._written_s[name] > most_s:
                self.stop_program(f"{name} was not written for {most_s:g} s")

    def _move(self, dt_s: float) -> None:
        goal = self._goal or (lambda dt: self._towards([0.0] * JOINTS, STOP_RAD_S2, dt))
        most_a, most_v = ACCELERATION_MAX_RAD_S2, SPEED_MAX_RAD_S
        pull = -math.expm1(-dt_s / DRIVE_LAG_S)
        for i, acceleration in enumerate(goal(dt_s)):
            speed = self.qd[i] + max(-most_a, min(most_a, acceleration)) * dt_s
            self.qd[i] = max(-most_v, min(most_v, speed))
            self.q[i] += self.qd[i] * self.slider * dt_s
            moved = pull * (self.q[i] - self.actual_q[i])
            self.actual_q[i] += moved
            self.actual_qd[i] = moved / dt_s
