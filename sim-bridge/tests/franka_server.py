"""PyPI's franky-sim as the tests need it: on an address of their own, on time, and watched.

A program for the Python of target/venv-franka. The server keeps the wall's clock as the arm does:
its own loop is some per cent late. Each millisecond it writes down what libfranka's protocol
brought; `franky-sim` itself objects to no command, so the tests do, from what is written here.

Reads lines from its standard input: `reflex` ends the motion as the arm does, `save FILE` writes
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
from franky_sim.franka_robot_protocol import MoveStatus, RobotCommand, RobotMode, UDPCommand
from franky_sim.franka_server import BaseCommand
from franky_sim.mujoco_simulator import MujocoSimulator

STEP_S = 0.001
LATE_MAX_S = 0.02
"""What is later than this is not caught up with."""
ERROR_JOINT_REFLEX = 6
"""Index of `joint_reflex` in libfranka's list of errors."""


class Watched:
    """The server of one arm, and what was seen of it."""

    def __init__(self, server: SimulationServer) -> None:
        self.server, self.arm = server, server.robot_servers[0]
        self.rows: list[list[float]] = []
        self.latest = None
        self.reflex = False
        handle = self.arm._handle_udp_command

        def received(data: bytes) -> None:
            command = UDPCommand.from_bytes(data)
            self.commands.append([command.message_id, *command.q_c, *command.tau_J_d])
            handle(data)

        self.commands: list[list[float]] = []
        self.arm._handle_udp_command = received
        state = type(self.arm).robot_state
        watched = self

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

        self.arm.__class__ = Server

    def step(self) -> None:
        """One millisecond."""
        arrived = len(self.commands)
        moves = self.arm.current_motion_id > 0
        self.latest = None
        self.server.run_once(realtime=False)
        if self.latest is None:
            return
        state = self.latest
        self.rows.append(
            [len(self.commands) - arrived, moves, *state.tau_J_d, *state.q_d, *state.q, *state.dq]
        )

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
        print("reflex", flush=True)

    def save(self, file: str) -> None:
        """Writes down what was seen: the file is there whole or not at all."""
        np.savez(f"{file}.tmp.npz", rows=np.array(self.rows), commands=np.array(self.commands))
        os.rename(f"{file}.tmp.npz", file)


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
            at = " ".join(map(str, options.box))
            box = ElementTree.SubElement(simulator.worldbody, "body", name="box", pos=at)
            ElementTree.SubElement(box, "freejoint")
            ElementTree.SubElement(
                box, "geom", type="box", size="0.02835 0.045 0.02835", mass="0.1", friction="1"
            )
        simulator.add_robot(initial_q=options.initial_q)
        with SimulationServer(simulator, hostname_candidates=[options.hostname]) as server:
            watched = Watched(server)
            print("ready", flush=True)
            threading.Thread(target=read, daemon=True).start()
            serve(watched, requests)


def serve(watched: Watched, requests: list[str]) -> None:
    """A step each millisecond of the clock."""
    due_s = time.monotonic()
    taken = 0
    while True:
        while taken < len(requests):
            verb, *rest = requests[taken].split()
            taken += 1
            if verb == "end":
                return
            if verb == "reflex":
                watched.end_motion()
            elif verb == "save":
                watched.save(rest[0])
                print("saved", flush=True)
        watched.step()
        due_s = max(due_s + STEP_S, time.monotonic() - LATE_MAX_S)
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main()
