"""A state publisher for Universal Robots: publishes what RTDE says, obeys by servoJ or speedJ.

It begins slowly: a command with a joint faster than `speed_fraction` of the description's speeds
is refused, and the arm brakes. The speed slider is left alone: servoJ may leave its path behind it.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from sim_bridge.cell import CellFrames
from sim_bridge.errors import BridgeError
from sim_bridge.guard import Bounds, Cause, CommandFault, CommandGuard, JointBounds, counted
from sim_bridge.kinematics import Chain
from sim_bridge.messages import (
    GripperCommand,
    GripperState,
    JointCommand,
    RobotState,
    TaskFrames,
    joint_names_hash,
)
from sim_bridge.priority import real_time
from sim_bridge.services import Instance, StatePublisherPorts, StopSignal
from sim_bridge.ur.arm import JOINTS
from sim_bridge.ur.robot import Commander, Outputs, Robot, Sample, Servo

ACCELERATION_RAD_S2 = 20.0
"""Commands that change a joint's speed by more are taken for a jump."""
SPEED_TOLERANCE = 1e-6
TOOL_INPUT = 16
"""Bit of the tool's first digital input."""


@dataclass(frozen=True)
class Options:
    """What the command line asked for."""

    host: str
    scene: Path
    instance: str
    speed_fraction: float
    interface: str
    lookahead_s: float
    gain: float
    acceleration_rad_s2: float
    gripper_output: int | None
    gripper_input: int | None
    priority: int | None
    """Of the loop: see `priority.real_time`."""

    def servo(self) -> Servo:
        """How setpoints are sent; raises `BridgeError` where an option is outside its range."""
        if not 0.0 < self.speed_fraction <= 1.0:
            raise BridgeError(
                f"--speed-fraction: expected above 0, at most 1, found {self.speed_fraction:g}"
            )
        for option, number in (
            ("--gripper-output", self.gripper_output),
            ("--gripper-input", self.gripper_input),
        ):
            if number is not None and not 0 <= number <= 9:
                raise BridgeError(f"{option}: expected 0 to 9, found {number}")
        if self.gripper_input is not None and self.gripper_output is None:
            raise BridgeError("--gripper-input needs --gripper-output: what is gripped by?")
        servo = Servo(self.interface, self.lookahead_s, self.gain, self.acceleration_rad_s2)
        servo.check()
        return servo


class SlowGuard(CommandGuard):
    """A guard that lets no joint be commanded faster than its bound, not even twice as fast."""

    def _check_step(self, command: JointCommand, state: RobotState) -> CommandFault | None:
        for joint, most in enumerate(self._bounds.joints.speed_max):
            speed = abs(command.velocity[joint])
            if speed > most * (1.0 + SPEED_TOLERANCE):
                return CommandFault(Cause.STEP, command.sequence, joint, speed, most)
        return super()._check_step(command, state)


class Publisher:
    """What is published of a robot, and what becomes of the commands."""

    def __init__(self, options: Options, chain: Chain, first: Sample, frames: TaskFrames) -> None:
        self.options = options
        self.frames = frames
        names = chain.joint_names
        self.state = RobotState(joint_count=JOINTS, joint_names_hash=joint_names_hash(names))
        self.command = JointCommand()
        speeds = [options.speed_fraction * speed for speed in chain.velocity_max_rad_s]
        deceleration = [options.acceleration_rad_s2] * JOINTS
        bounds = JointBounds(speeds, [ACCELERATION_RAD_S2] * JOINTS, deceleration)
        self.guard = SlowGuard(JOINTS, Bounds(joints=bounds))
        self.program_ran = False
        self.was_stopped = False
        self.asked_s = -math.inf
        self.fill(first)

    def fill(self, sample: Sample) -> None:
        """Takes a state of the robot over into the messages."""
        state = self.state
        state.sequence += 1
        state.time_ns = sample.received_ns
        state.robot_mode, stopped = sample.judged()
        state.safety_stop = int(stopped)
        state.position[:JOINTS] = sample.q
        state.velocity[:JOINTS] = sample.qd
        state.gripper_state = self.gripper(sample)
        self.frames.sequence, self.frames.time_ns = state.sequence, state.time_ns

    def gripper(self, sample: Sample) -> GripperState:
        """What is known of the gripper: without an input, that it does what it is told."""
        if self.options.gripper_output is None:
            return GripperState.NONE
        number = self.options.gripper_input
        if number is None:
            grips = self.guard.gripper == GripperCommand.GRIP
        else:
            bit = number if number < 8 else TOOL_INPUT + number - 8
            grips = bool(sample.inputs >> bit & 1)
        return GripperState.HOLDING if grips else GripperState.OPEN

    def obey(self, now_ns: int, new: JointCommand | None, sample: Sample) -> list[float] | None:
        """The setpoint until the next state; `None`: stop."""
        # A robot that obeys nothing has to be met where it is, afterwards.
        possible = sample.usable and sample.program_runs
        action = self.guard.judge(now_ns, new if possible else None, self.state)
        if not possible or not action.obey:
            return None
        return action.position if self.options.interface == "position" else action.velocity


def publish(options: Options) -> int:
    """Publishes a robot's states and obeys commands until a signal comes; gives the exit code."""
    servo = options.servo()
    # Threads of the connections are started by this one, and have its priority.
    with real_time(options.priority) as how:
        return _publish(options, servo, how)


def _publish(options: Options, servo: Servo, how: str) -> int:
    cell = CellFrames(options.scene)
    chain = cell.chain
    if chain.joint_count != JOINTS:
        raise BridgeError(f"{cell.cell.urdf}: expected {JOINTS} joints, found {chain.joint_count}")
    robot = Robot(options.host)
    first = robot.wait()
    if not first.usable:
        mode, stopped = first.judged()
        raise BridgeError(
            f"{options.host}: the robot is not ready (robot mode {first.mode}, safety mode "
            f"{first.safety}: {mode.name}{', stopped' if stopped else ''}): power it on, release "
            "its brakes and clear its stops on the pendant"
        )
    cell.start_at(first.q)
    publisher = Publisher(options, chain, first, cell.message)
    outputs = None if options.gripper_output is None else Outputs(options.host)
    with StopSignal() as stop, StatePublisherPorts(Instance(options.instance)) as ports:
        commander = Commander(robot, servo)
        try:
            _announce(options, robot, how)
            _loop(publisher, robot, commander, outputs, ports, stop)
        finally:
            commander.close()
            robot.close()
    counts = {cause.value: count for cause, count in publisher.guard.counts.items()}
    print(f"commands with a fault: {counted(counts)}")
    return 0


def _loop(
    publisher: Publisher,
    robot: Robot,
    commander: Commander,
    outputs: Outputs | None,
    ports: StatePublisherPorts,
    stop: StopSignal,
) -> None:
    """One round a state of the robot."""
    guard, grips, told = publisher.guard, False, 0
    while not stop.requested:
        sample = robot.wait()
        publisher.fill(sample)
        ports.publish(publisher.frames, publisher.state)
        ports.update_connections()
        new = publisher.command if ports.receive_command(publisher.command) else None
        wanted = publisher.obey(time.monotonic_ns(), new, sample)
        commander.set(wanted, sample.usable and sample.program_runs)
        _look_after(publisher, sample, commander)
        if outputs is not None and grips != (guard.gripper == GripperCommand.GRIP):
            grips = not grips
            outputs.set(publisher.options.gripper_output, grips)
        refused = guard.counts.get(Cause.STEP, 0) + guard.counts.get(Cause.ELSEWHERE, 0)
        if refused > told and (told == 0 or refused >= 10 * told):
            told = refused
            print(f"refused, the arm brakes: {guard.last_fault}", file=sys.stderr, flush=True)


def _look_after(publisher: Publisher, sample: Sample, commander: Commander) -> None:
    """Runs the program again after a stop for safety; raises `BridgeError` after any other."""
    if not sample.usable:
        publisher.was_stopped = True
        return
    if sample.program_runs:
        publisher.program_ran, publisher.was_stopped = True, False
        return
    if publisher.program_ran and not publisher.was_stopped:
        raise BridgeError(
            f"{publisher.options.host}: the program on the robot has ended: somebody stopped it, "
            "or its watchdog has; look at the pendant, then start this again"
        )
    if publisher.program_ran and sample.robot_time_s - publisher.asked_s > 1.0:
        publisher.asked_s = sample.robot_time_s
        commander.restart()


def _announce(options: Options, robot: Robot, how: str) -> None:
    print(
        f"instance {options.instance}: {options.host} at {1.0 / robot.period_s:.0f} Hz, {how}, "
        f"{options.interface} interface; joints up to {100.0 * options.speed_fraction:g} % of "
        "their speeds (--speed-fraction); waiting for a controller",
        flush=True,
    )
    if robot.speed_slider < 1.0:
        print(
            f"the speed slider stands at {100.0 * robot.speed_slider:.0f} %: servoJ may leave its "
            "path then; this program and the controller bound the speed, set it to 100 %",
            file=sys.stderr,
            flush=True,
        )
