"""PyPI's franky-sim as the tests need it: on an address of their own, on time, and watched.

A program for the Python of target/venv-franka. It keeps the wall's clock, as an arm does: the loop
of `franky-sim` itself is some per cent late. franky-sim objects to no command; here those that
libfranka's protocol brings are held against what an arm accepts, and the largest are written down.

Reads lines from its standard input: `reflex` ends the motion as an arm does, `save FILE` writes
down what was seen so far.
"""

import argparse
import os
import sys
import threading
import time
import xml.etree.ElementTree as ElementTree

import numpy as np
from franky_sim import SimulationServer
from franky_sim.franka_robot_protocol import (
    AutomaticErrorRecoveryCommand,
    MoveStatus,
    RobotCommand,
    RobotMode,
    UDPCommand,
)
from franky_sim.franka_server import BaseCommand
from franky_sim.mujoco_simulator import MujocoSimulator

STEP_S = 0.001
LATE_MAX_S = 0.02
"""What is later than this is not caught up with."""
ERROR_JOINT_REFLEX = 6
"""Index of `joint_reflex` in libfranka's list of errors."""
ROWS = 90_000
"""Newest milliseconds that are kept."""
COLUMNS = 2 + 4 * 7 + 3


class Commands:
    """The largest changes from one command to the next, by the states that they answer."""

    def __init__(self) -> None:
        self.numbers: list[int] = []
        self.positions: list[np.ndarray] = []
        self.speed = self.acceleration = self.jerk = 0.0
        self.start = 0.0
        """How far the first position was from where the arm was to be [rad]."""
        self.received = 0

    def add(self, command: UDPCommand, q_d: tuple[float, ...], moves: bool) -> None:
        """Counts a command, and measures positions."""
        if not moves or command.message_id == 0:
            return
        self.received += 1
        q = np.array(command.q_c)
        if not q.any():
            # Torques: there are no positions.
            return
        if not self.positions:
            self.start = float(np.max(np.abs(q - np.array(q_d))))
        self.numbers = [*self.numbers[-3:], command.message_id]
        self.positions = [*self.positions[-3:], q]
        self._measure()

    def _measure(self) -> None:
        times = STEP_S * np.array(self.numbers, dtype=float)
        values, largest = np.array(self.positions), []
        for order in range(1, len(times)):
            # Newton's divided differences: where a state was lost, a mean of the steps between.
            spans = (times[order:] - times[:-order]) / order
            values = np.diff(values, axis=0) / spans[:, None]
            largest.append(float(np.max(np.abs(values[-1]))))
        speed, acceleration, jerk = [*largest, 0.0, 0.0, 0.0][:3]
        self.speed = max(self.speed, speed)
        self.acceleration = max(self.acceleration, acceleration)
        self.jerk = max(self.jerk, jerk)


class Watched:
    """The server of one arm, and what was seen of it."""

    def __init__(self, server: SimulationServer, box: object) -> None:
        self.server, self.arm, self.box = server, server.robot_servers[0], box
        self.rows = np.zeros((ROWS, COLUMNS))
        self.count = self.arrived = 0
        self.torque_step = 0.0
        self.before: np.ndarray | None = None
        self.latest = None
        self.reflex = False
        self.commands = Commands()
        self._observe()

    def _observe(self) -> None:
        watched, handle = self, self.arm._handle_udp_command
        state = type(self.arm).robot_state

        def received(data: bytes) -> None:
            watched.arrived += 1
            moves = watched.arm.current_motion_id > 0
            q_d = watched.arm.robot.state.q_d if not watched.commands.positions else ()
            watched.commands.add(UDPCommand.from_bytes(data), q_d, moves)
            handle(data)

        class Server(type(self.arm)):
            """Keeps the state that is sent, and reports a reflex in it."""

            @property
            def robot_state(self) -> object:
                watched.latest = state.__get__(self)
                if not watched.reflex:
                    return watched.latest
                errors = tuple(k == ERROR_JOINT_REFLEX for k in range(41))
                return watched.latest.replace(
                    robot_mode=RobotMode.kReflex, errors=errors, reflex_reason=errors
                )

        self.arm._handle_udp_command = received
        self.arm.__class__ = Server
        recover = AutomaticErrorRecoveryCommand.handle

        def recovered(command: AutomaticErrorRecoveryCommand, server: object) -> None:
            watched.reflex = False
            recover(command, server)

        AutomaticErrorRecoveryCommand.handle = recovered

    def step(self) -> None:
        """One millisecond."""
        self.arrived = 0
        self.latest = None
        moves = self.arm.current_motion_id > 0
        self.server.run_once(realtime=False)
        if self.latest is None:
            # Nobody is connected.
            return
        state = self.latest
        box = (np.nan,) * 3 if self.box is None else self.box.xpos
        row = self.rows[self.count % ROWS]
        row[:] = (self.arrived, moves, *state.tau_J_d, *state.q_d, *state.q, *state.dq, *box)
        self.count += 1
        torque = row[2:9].copy()
        if moves and self.before is not None and state.q_d == state.q:
            self.torque_step = max(self.torque_step, float(np.max(np.abs(torque - self.before))))
        self.before = torque if moves else None

    def end_motion(self) -> None:
        """Ends the motion as the arm does after a reflex."""
        motion = self.arm.current_motion_id
        self.arm.stop_motion(send_preemption_signal=False)
        self.arm.reset_current_motion_id()
        self.reflex = True
        if motion:
            BaseCommand.send_response(
                self.arm._tcp_socket, RobotCommand.kMove, motion, MoveStatus.kReflexAborted
            )

    def save(self, file: str) -> None:
        """Writes down what was seen: the file is there whole or not at all."""
        rows = self.rows[: self.count] if self.count < ROWS else self.rows
        rows = np.roll(rows, -(self.count % ROWS), axis=0) if self.count >= ROWS else rows
        commands = self.commands
        np.savez(
            f"{file}.tmp.npz",
            rows=rows,
            tool=np.array(self.latest.O_T_EE).reshape((4, 4), order="F"),
            torque_step=self.torque_step,
            start=commands.start,
            speed=commands.speed,
            acceleration=commands.acceleration,
            jerk=commands.jerk,
            received=commands.received,
        )
        os.rename(f"{file}.tmp.npz", file)


def add_box(simulator: MujocoSimulator, centre_m: list[float]) -> None:
    """A box that can be gripped, of the size of the scenes' [m]."""
    at = " ".join(map(str, centre_m))
    box = ElementTree.SubElement(simulator.worldbody, "body", name="box", pos=at)
    ElementTree.SubElement(box, "freejoint")
    ElementTree.SubElement(
        box, "geom", type="box", size="0.02835 0.045 0.02835", mass="0.1", friction="1 0.05 0.001"
    )


def main() -> None:
    """Serves until its standard input ends."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--hostname", required=True)
    parser.add_argument("--initial-q", type=float, nargs=7, required=True)
    parser.add_argument("--box", type=float, nargs=3, help="centre of a box to be gripped [m]")
    options = parser.parse_args()
    requests: list[str] = []

    def read() -> None:
        for line in sys.stdin:
            requests.append(line)
        requests.append("end")

    with MujocoSimulator() as simulator:
        if options.box:
            add_box(simulator, options.box)
        simulator.add_robot(initial_q=options.initial_q)
        with SimulationServer(simulator, hostname_candidates=[options.hostname]) as server:
            watched = Watched(server, simulator.data.body("box") if options.box else None)
            print("ready", flush=True)
            threading.Thread(target=read, daemon=True).start()
            serve(watched, requests)


def serve(watched: Watched, requests: list[str]) -> None:
    """A step each millisecond of the clock."""
    due_s = time.monotonic()
    while True:
        if requests:
            verb, *rest = requests.pop(0).split()
            if verb == "end":
                return
            if verb == "reflex":
                watched.end_motion()
            else:
                watched.save(rest[0])
            print(verb, flush=True)
        watched.step()
        due_s = max(due_s + STEP_S, time.monotonic() - LATE_MAX_S)
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main()
