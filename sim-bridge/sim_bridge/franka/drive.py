"""The loop of a Franka arm: each of its states is published, and answered within its millisecond.

One tick: a state arrives, is published with the frames, and the newest command that has come is
the answer; the command to this very state comes in time for the next one. What the robot may not
be asked for is held back in `limits.py`; when nothing is obeyed the arm brakes by itself and holds.

A reflex ends the motion for good: states go on, as those of a protective stop, until the operator
has looked and starts the publisher again.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from sim_bridge.cell import CellFrames
from sim_bridge.errors import BridgeError
from sim_bridge.files import check, write
from sim_bridge.franka.arm import Arm, bindings
from sim_bridge.franka.hand import Grasp, Hand
from sim_bridge.franka.limits import (
    ACCELERATION_MAX_RAD_S2,
    BRAKE_RAD_S2,
    JOINTS,
    REST_RAD_S,
    SLOW_FRACTION,
    STEP_S,
    PositionReference,
    SlowMode,
    TorqueBrake,
    TorqueLimit,
)
from sim_bridge.guard import Action, Bounds, CommandGuard, JointBounds, counted
from sim_bridge.messages import (
    CommandMode,
    GripperState,
    JointCommand,
    Reason,
    RobotMode,
    RobotState,
    joint_names_hash,
)
from sim_bridge.priority import no_collection, real_time
from sim_bridge.services import Instance, StatePublisherPorts, StopSignal

INTERFACES = ("torque", "position")
ANSWER_S = 300e-6
"""libfranka's bound on the time from a state to the answer."""
RESUME_S = 0.5
"""How far ahead of the arm positions may begin: what a lag of 0.1 s and the controller's reference
behind it ask for."""
STEPS_MAX = 100
"""More milliseconds are not made up for: an arm has ended the motion after twenty."""
STOP_TICKS_MAX = 1000
"""A stop is a ramp to rest, of at most a second."""
IDLE_TICKS = 100
"""How often the start frame follows an arm that nobody moves."""


@dataclass(frozen=True)
class Options:
    """What the command line asked for."""

    address: str
    scene: Path
    instance: str
    interface: str
    gripper: str
    real_time: str
    full_speed: bool
    recover: bool
    priority: int
    summary: Path | None
    force: bool = False


@dataclass
class Counts:
    """What came of it."""

    states: int = 0
    states_lost: int = 0
    """Milliseconds of the robot of which no state arrived here."""
    states_lost_in_a_row_max: int = 0
    late_answers: int = 0
    """States that were answered later than within 300 µs."""
    answer_max_s: float = 0.0
    obeyed: int = 0
    braked: int = 0
    success_rate_min: float = 1.0
    """Least of libfranka's `control_command_success_rate`: of the last 100 commands, how many
    arrived in time."""
    success_rate_sum: float = 0.0
    reflexes: int = 0
    reflex: str | None = None


class Driver:
    """The loop's state, and one method a phase."""

    def __init__(self, arm: Arm, cell: CellFrames, hand: Hand | None, options: Options) -> None:
        self.arm, self.cell, self.hand, self.options = arm, cell, hand, options
        chain = cell.chain
        speeds = chain.velocity_max_rad_s.tolist()
        self.torques = options.interface == "torque"
        # Of torques no step is checked: they are limited on the way.
        bounds = Bounds() if self.torques else _position_bounds(speeds)
        self.guard = CommandGuard(JOINTS, bounds)
        self.slow = SlowMode(speeds, options.full_speed)
        self.limit = TorqueLimit(chain.effort_max_n_m.tolist())
        self.brake = TorqueBrake()
        self.command = JointCommand()
        self.message = RobotState(
            joint_count=JOINTS, joint_names_hash=joint_names_hash(chain.joint_names)
        )
        self.counts = Counts()

    # One tick.

    def publish(self, ports: StatePublisherPorts, state: object, stopped: bool) -> None:
        """Publishes a state of the arm; `stopped` after a reflex, whatever the arm says then."""
        message, frames = self.message, self.cell.message
        message.sequence += 1
        message.time_ns = time.monotonic_ns()
        mode = self.arm.mode(state)
        if stopped and mode == RobotMode.RUNNING:
            mode = RobotMode.PROTECTIVE_STOP
        message.robot_mode = mode
        message.safety_stop = int(mode in (RobotMode.PROTECTIVE_STOP, RobotMode.EMERGENCY_STOP))
        message.gripper_state = GripperState.NONE if self.hand is None else self.hand.state
        message.position[:JOINTS] = state.q
        message.velocity[:JOINTS] = state.dq
        message.torque[:JOINTS] = self.arm.torque(state)
        if self._idle() and message.sequence % IDLE_TICKS == 1:
            self.cell.start_at(state.q)
        frames.sequence, frames.time_ns = message.sequence, message.time_ns
        ports.publish(frames, message)

    def _idle(self) -> bool:
        """Whether nobody moves the arm: no controller yet, or one that has left on purpose."""
        command = self.guard.command
        left = command.mode == CommandMode.STOP and command.reason == Reason.STOP_REQUESTED
        return command.sequence == 0 or left

    def judge(self, ports: StatePublisherPorts) -> Action:
        """Whether the arm obeys, and where it is to be."""
        new = self.command if ports.receive_command(self.command) else None
        action = self.guard.judge(time.monotonic_ns(), new, self.message)
        commanded = self.guard.command.velocity[:JOINTS] if action.obey else None
        if not self.slow.permits(commanded, self.message.velocity[:JOINTS]):
            action = Action(False, action.position, action.velocity)
        self.counts.obeyed += action.obey
        self.counts.braked += not action.obey
        if self.hand is not None and self.guard.command.sequence > 0:
            self.hand.command(self.guard.gripper)
        return action

    def answer(self, state: object, action: Action | None, steps: int) -> list[float]:
        """Torques without gravity [N m], or positions [rad], that the arm accepts.

        It brakes where the action says so, or there is none.
        """
        obeys = action is not None and action.obey
        if not self.torques:
            reference = self.reference
            if obeys:
                reference.follow(action.position, action.velocity, steps)
            else:
                reference.brake(state.q, state.dq, steps)
            return reference.position
        if obeys:
            self.brake.release()
            wanted = self.guard.command.torque[:JOINTS]
        else:
            wanted = self.brake.torque(state.q, state.dq, steps)
        return self.limit.limited(wanted, state.tau_J_d)

    def count(self, state: object, period_s: float) -> int:
        """Counts what was lost; gives the robot's milliseconds since the last state."""
        counts = self.counts
        steps = max(round(period_s / STEP_S), 1)
        counts.states += 1
        counts.states_lost += steps - 1
        counts.states_lost_in_a_row_max = max(counts.states_lost_in_a_row_max, steps - 1)
        steps = min(steps, STEPS_MAX)
        if counts.states > 100:
            rate = state.control_command_success_rate
            counts.success_rate_min = min(counts.success_rate_min, rate)
            counts.success_rate_sum += rate
        return steps

    def tick(self, ports: StatePublisherPorts) -> None:
        """One state and its answer."""
        state, period_s = self.arm.read()
        begun_s = time.monotonic()
        steps = self.count(state, period_s)
        self.publish(ports, state, False)
        self.arm.write(self.answer(state, self.judge(ports), steps))
        taken_s = time.monotonic() - begun_s
        self.counts.late_answers += taken_s > ANSWER_S
        self.counts.answer_max_s = max(self.counts.answer_max_s, taken_s)

    # The phases.

    def begin(self) -> None:
        """Begins to control the arm, from where it is."""
        start = self.arm.start(self.options.interface, recover=self.options.recover)
        self.reference = PositionReference(
            self.cell.chain, start.q_d, 1.0 if self.options.full_speed else SLOW_FRACTION
        )

    def drive(self, ports: StatePublisherPorts, stop: StopSignal, how: str) -> int:
        """Moves the arm until a signal; gives the exit code. `how` the loop is scheduled."""
        try:
            self.begin()
            _say_begin(self.options, how)
            while not stop.requested:
                self.tick(ports)
            self.ramp_down(ports)
        except self.arm.bindings.ControlException as error:
            self.counts.reflexes += 1
            self.counts.reflex = str(error)
            self.watch(ports, stop)
            return 1
        return 0

    def ramp_down(self, ports: StatePublisherPorts) -> None:
        """Brakes to rest, and then gives the arm back to itself."""
        for left in reversed(range(STOP_TICKS_MAX)):
            state, period_s = self.arm.read()
            steps = self.count(state, period_s)
            self.publish(ports, state, False)
            answer = self.answer(state, None, steps)
            slow = all(abs(speed) < REST_RAD_S for speed in state.dq)
            rests = slow if self.torques else self.reference.rests
            self.arm.write(answer, finished=rests or left == 0)
            if rests:
                return

    def watch(self, ports: StatePublisherPorts, stop: StopSignal) -> None:
        """Publishes the states of an arm that a reflex has stopped, until a signal."""
        print(
            f"sim-bridge: a reflex has ended the motion: {self.counts.reflex}\n"
            "sim-bridge: look at the arm, then end this publisher and start it with --recover",
            file=sys.stderr,
            flush=True,
        )
        while not stop.requested:
            self.publish(ports, self.arm.look(), True)
            ports.receive_command(self.command)


def _position_bounds(speeds: list[float]) -> Bounds:
    """What positions are held against; the slow mode is looked at beside."""
    accelerations = [ACCELERATION_MAX_RAD_S2] * JOINTS
    joints = JointBounds(speeds, accelerations, [BRAKE_RAD_S2] * JOINTS)
    return Bounds(resume_s=RESUME_S, joints=joints)


def run(options: Options) -> int:
    """Drives the arm and prints what came of it; gives the exit code."""
    if options.summary is not None:
        check(options.summary, force=options.force)
    bindings()
    cell = CellFrames(options.scene)
    if cell.chain.joint_count != JOINTS:
        raise BridgeError(
            f"{options.scene}: `urdf`: expected an arm of {JOINTS} joints, found "
            f"{cell.chain.joint_count}"
        )
    arm = Arm(options.address, enforce_real_time=options.real_time == "enforce")
    hand = Hand(options.address, Grasp()) if options.gripper == "hand" else None
    driver = Driver(arm, cell, hand, options)
    try:
        with (
            StopSignal() as stop,
            StatePublisherPorts(Instance(options.instance)) as ports,
            real_time(options.priority, insist=False) as how,
            no_collection(),
        ):
            return driver.drive(ports, stop, how)
    except RuntimeError as error:
        raise BridgeError(
            f"the connection to the arm at {options.address} is lost ({error}): it brakes by "
            "itself; look at the arm, its network and Desk, then start again"
        ) from error
    finally:
        if hand is not None:
            hand.close()
        _finish(driver, options)


def _say_begin(options: Options, how: str) -> None:
    gripper = "no gripper, so tasks that grip do not begin"
    print(
        f"instance {options.instance}: the arm at {options.address} by {options.interface}, "
        f"{'at full speed' if options.full_speed else f'slow ({SLOW_FRACTION:g} of its speed)'}, "
        f"{'the Franka Hand' if options.gripper == 'hand' else gripper}, {how}; waiting for a "
        "controller",
        flush=True,
    )


def _finish(driver: Driver, options: Options) -> None:
    counts, guard, slow = driver.counts, driver.guard, driver.slow
    if counts.states == 0:
        return
    mean = counts.success_rate_sum / max(counts.states - 100, 1)
    faults = {cause.value: count for cause, count in guard.counts.items()}
    print(
        f"states: {counts.states}, lost on the way here: {counts.states_lost} (at most "
        f"{counts.states_lost_in_a_row_max} in a row); answered late: {counts.late_answers}; "
        f"commands that arrived in time: {100.0 * mean:.2f} %, least "
        f"{100.0 * counts.success_rate_min:.0f} %; reflexes: {counts.reflexes}\n"
        f"refused commands: {counted(faults)}; too fast in the slow mode: {slow.refused}"
    )
    for what in (guard.last_fault, slow.last):
        if what is not None:
            print(f"last: {what}")
    if options.summary is not None:
        numbers = asdict(counts)
        del numbers["success_rate_sum"]
        numbers |= {"success_rate_mean": mean, "slow_refusals": slow.refused}
        text = json.dumps({**numbers, "command_faults": faults}, indent=2)
        write(options.summary, text + "\n", force=options.force)
