"""The connection to a robot by `ur_rtde`: states out of it, setpoints into it.

Joint positions are in rad, velocities in rad/s. ur_rtde receives in a thread of its own and sends
in calls that wait for the robot: setpoints go through `Commander`, so that the loop never waits.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

from sim_bridge.errors import BridgeError
from sim_bridge.messages import RobotMode
from sim_bridge.ur.arm import JOINTS, Mode, Safety

VARIABLES = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "robot_mode",
    "safety_mode",
    "robot_status_bits",
    "safety_status_bits",
    "actual_digital_input_bits",
    "target_speed_fraction",
]
PROGRAM_RUNS = 1 << 1
TEACH_BUTTON = 1 << 2
STOPPED_FOR_SAFETY = 1 << 10
"""Bit of `safety_status_bits`."""
SILENT_S = 0.5
"""A robot that sends nothing for so long is gone."""
POLL_S = 0.0002
WATCHDOG_HZ = 10.0
"""The robot ends its program, and brakes, where it is sent nothing for a tenth of a second."""
IDLE_S = 0.02
"""How often a robot that is commanded nothing is sent a sign of life."""

INSTALL = (
    "the package ur_rtde is missing: `make venv` installs it, or `pip install --require-hashes -r "
    "sim-bridge/requirements-ur.txt`"
)


@dataclass(frozen=True)
class Servo:
    """How setpoints are sent."""

    interface: str = "position"
    """`position`: servoJ; `velocity`: speedJ."""
    lookahead_s: float = 0.1
    """servoJ smooths, and lags by, so much [s]."""
    gain: float = 300.0
    """servoJ's gain, 100 to 2000."""
    acceleration_rad_s2: float = 10.0
    """Of speedJ, and of stops [rad/s²]."""

    def check(self) -> None:
        """Raises `BridgeError` where a value is outside what a robot accepts."""
        if self.interface not in ("position", "velocity"):
            raise BridgeError(f"--interface: expected position, velocity, found `{self.interface}`")
        for option, value, low, high in (
            ("--lookahead-s", self.lookahead_s, 0.03, 0.2),
            ("--gain", self.gain, 100.0, 2000.0),
            ("--acceleration-rad-s2", self.acceleration_rad_s2, 0.1, 40.0),
        ):
            if not low <= value <= high:
                raise BridgeError(f"{option}: expected {low:g} to {high:g}, found {value:g}")


@dataclass(frozen=True)
class Sample:
    """One package of the robot's states."""

    received_ns: int
    """On `CLOCK_MONOTONIC`, when it was found to have arrived [ns]."""
    robot_time_s: float
    q: list[float]
    qd: list[float]
    mode: int
    safety: int
    status_bits: int
    safety_bits: int
    inputs: int

    @property
    def program_runs(self) -> bool:
        """Whether the robot runs a program."""
        return bool(self.status_bits & PROGRAM_RUNS)

    def judged(self) -> tuple[RobotMode, bool]:
        """What the robot is doing, and whether a safety function stops it."""
        if self.safety in (Safety.SYSTEM_EMERGENCY_STOP, Safety.ROBOT_EMERGENCY_STOP):
            return RobotMode.EMERGENCY_STOP, True
        if self.safety == Safety.PROTECTIVE_STOP:
            return RobotMode.PROTECTIVE_STOP, True
        if self.safety in (Safety.RECOVERY, Safety.VIOLATION, Safety.FAULT):
            return RobotMode.FAULT, True
        stopped = self.safety not in (Safety.NORMAL, Safety.REDUCED)
        stopped |= bool(self.safety_bits & STOPPED_FOR_SAFETY)
        if self.mode == Mode.BACKDRIVE or self.status_bits & TEACH_BUTTON:
            return RobotMode.HAND_GUIDING, stopped
        return (RobotMode.RUNNING if self.mode == Mode.RUNNING else RobotMode.FAULT), stopped

    @property
    def usable(self) -> bool:
        """Whether the robot would follow setpoints."""
        return self.judged() == (RobotMode.RUNNING, False)


class Robot:
    """States of a robot at `host`; raises `BridgeError` where it cannot be reached."""

    def __init__(self, host: str) -> None:
        try:
            import rtde_receive
        except ImportError as error:
            raise BridgeError(INSTALL) from error
        self.host = host
        try:
            self._receive = rtde_receive.RTDEReceiveInterface(host, -1.0, VARIABLES)
        except Exception as error:
            raise BridgeError(
                f"{host}: no robot answers at port 30004 (RTDE): {error}: check the address, the "
                "network, and that RTDE is enabled on the robot (Settings, Security, Services)"
            ) from error
        self._robot_time_s = -1.0
        first = self.wait()
        ticks = [first.robot_time_s] + [self.wait().robot_time_s for _ in range(5)]
        self.period_s = 0.008 if min(b - a for a, b in zip(ticks, ticks[1:])) > 0.005 else 0.002
        """Between two states: 125 a second of a CB3, 500 of an e-Series [s]."""

    @property
    def speed_slider(self) -> float:
        """Where the speed slider stands, 0 to 1."""
        return self._receive.getTargetSpeedFraction()

    def wait(self) -> Sample:
        """The next state; raises `BridgeError` where none comes for half a second."""
        begun_s = time.monotonic()
        while True:
            if self._receive.getTimestamp() != self._robot_time_s:
                sample = self._sample()
                if sample is not None:
                    self._robot_time_s = sample.robot_time_s
                    return sample
            elif time.monotonic() - begun_s > SILENT_S:
                raise BridgeError(
                    f"{self.host}: the robot has sent no state for {SILENT_S:g} s: it was switched "
                    "off, or the network is interrupted; the robot brakes by its watchdog"
                )
            time.sleep(POLL_S)

    def _sample(self) -> Sample | None:
        """All of one package; `None` where the next one arrived meanwhile."""
        receive, now_ns = self._receive, time.monotonic_ns()
        time_s = receive.getTimestamp()
        sample = Sample(
            now_ns,
            time_s,
            receive.getActualQ(),
            receive.getActualQd(),
            receive.getRobotMode(),
            receive.getSafetyMode(),
            receive.getRobotStatus(),
            receive.getSafetyStatusBits(),
            receive.getActualDigitalInputBits(),
        )
        whole = receive.getTimestamp() == time_s and len(sample.q) == len(sample.qd) == JOINTS
        return sample if whole else None

    def close(self) -> None:
        """Ends the connection."""
        self._receive.disconnect()


class Commander:
    """Sends the newest setpoint in a thread of its own, which waits where the robot makes it wait.

    Where nothing is to be obeyed the arm is stopped, once, and the robot's watchdog kept quiet.
    """

    def __init__(self, robot: Robot, servo: Servo) -> None:
        import rtde_control

        self._robot, self._servo = robot, servo
        try:
            self._control = rtde_control.RTDEControlInterface(robot.host)
            self._control.setWatchdog(WATCHDOG_HZ)
        except Exception as error:
            raise BridgeError(
                f"{robot.host}: the robot obeys no scripts: {error}: an e-Series needs remote "
                "control (top right on the pendant), and no other client may write its registers"
            ) from error
        self._news = threading.Condition()
        self._wanted: list[float] | None = None
        self._possible = True
        self._restart = False
        self._fresh = False
        self._moving = False
        self._kicked_s = 0.0
        self._ends = False
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def set(self, wanted: list[float] | None, possible: bool) -> None:
        """What the joints shall do until the next call: a setpoint, or (`None`) stop.

        Not `possible`: the robot obeys nothing, and is sent nothing.
        """
        if self._failure is not None:
            raise BridgeError(f"{self._robot.host}: {self._failure}") from self._failure
        with self._news:
            self._wanted, self._possible = wanted if possible else None, possible
            self._fresh = True
            self._news.notify()

    def restart(self) -> None:
        """Runs the program on the robot again, which a safety stop has ended."""
        with self._news:
            self._restart = self._fresh = True
            self._news.notify()

    def _run(self) -> None:
        try:
            while not self._ends:
                with self._news:
                    self._news.wait_for(lambda: self._fresh, IDLE_S)
                    wanted, possible, restart = self._wanted, self._possible, self._restart
                    self._restart = self._fresh = False
                if restart:
                    self._control.reuploadScript()
                    self._control.setWatchdog(WATCHDOG_HZ)
                elif possible:
                    self._send(wanted)
                else:
                    self._moving = False
            self._send(None)
        except Exception as error:
            self._failure = error

    def _send(self, wanted: list[float] | None) -> None:
        control, servo = self._control, self._servo
        by_position = servo.interface == "position"
        if wanted is None:
            if self._moving:
                stop = control.servoStop if by_position else control.speedStop
                stop(servo.acceleration_rad_s2)
                self._moving = False
            elif time.monotonic() - self._kicked_s > IDLE_S:
                self._kicked_s = time.monotonic()
                control.kickWatchdog()
            return
        self._moving = True
        if by_position:
            period_s = self._robot.period_s
            control.servoJ(wanted, 0.0, 0.0, period_s, servo.lookahead_s, servo.gain)
        else:
            control.speedJ(wanted, servo.acceleration_rad_s2, 0.0)

    def close(self) -> None:
        """Stops the arm and ends the program on the robot."""
        self._ends = True
        self._thread.join(2.0)
        if self._control.isConnected():
            self._control.stopScript()
        self._control.disconnect()


class Outputs:
    """Digital outputs of the robot."""

    def __init__(self, host: str) -> None:
        import rtde_io

        try:
            self._io = rtde_io.RTDEIOInterface(host)
        except Exception as error:
            raise BridgeError(f"{host}: its outputs cannot be written: {error}") from error

    def set(self, number: int, on: bool) -> None:
        """Sets output `number`: 0 to 7 standard, 8 and 9 of the tool."""
        if number < 8:
            self._io.setStandardDigitalOut(number, on)
        else:
            self._io.setToolDigitalOut(number - 8, on)
