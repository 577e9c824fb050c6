"""Programs and messages for tests of the Franka arm: its simulator, its publisher, a controller."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sim_bridge.messages import CommandMode, JointCommand, RobotState
from sim_bridge.services import Instance, _Ports, _receive

ROOT = Path(__file__).resolve().parents[2]
CONTROLLER = ROOT / "target" / "release" / "controller"
LEARNER = ROOT / "target" / "release" / "learner"
PYTHON = ROOT / "target" / "venv-franka" / "bin" / "python"
CONFIG = ROOT / "config" / "controllers" / "fr3_pick.ron"
CELL = ROOT / "config" / "scenes" / "cell_fr3.json"
SERVER = Path(__file__).parent / "franka_server.py"
HOME_RAD = (0.533, -0.127, 0.085, -2.259, 0.013, 2.132, 2.55)
"""Where the arm begins: the tool to the left of the object, 0.31 m above the table."""
PATIENCE_S = 60.0
PRIORITY = 20
"""SCHED_FIFO priority of the simulated arm, below those of its publisher and controller."""
_COUNT = 0


def wait_for(what: str, holds: Callable[[], object], patience_s: float = PATIENCE_S) -> object:
    """Waits until it holds, and gives what it gave."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        found = holds()
        if found:
            return found
        time.sleep(0.01)
    raise AssertionError(f"{what}: not within {patience_s} s")


class Rig:
    """The programs of one test; all of them have ended at its end."""

    def __init__(self, folder: Path) -> None:
        global _COUNT
        _COUNT += 1
        self.folder = folder
        self.instance = f"franka-{os.getpid()}-{_COUNT}"
        # The ports of libfranka's protocol are fixed, addresses of the own machine are many.
        self.address = f"127.{101 + os.getpid() % 100}.{os.getpid() // 100 % 250}.{_COUNT}"
        self.processes: list[subprocess.Popen] = []
        self.server: subprocess.Popen | None = None
        self._saved = 0

    def start(self, name: str, *command: object) -> subprocess.Popen:
        """Starts a program; what it says goes into a file of its name."""
        with (self.folder / f"{name}.log").open("w") as log:
            process = subprocess.Popen(
                [str(part) for part in command],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                text=True,
                cwd=ROOT,
            )
        self.processes.append(process)
        return process

    def said(self, name: str) -> str:
        """What a program has said so far."""
        return (self.folder / f"{name}.log").read_text()

    def wait_said(self, name: str, text: str, patience_s: float = PATIENCE_S) -> None:
        """Waits until a program says it."""
        wait_for(f"{name} says `{text}`", lambda: text in self.said(name), patience_s)

    def serve(self, *options: object) -> None:
        """Starts the simulated arm."""
        home = ("--initial-q", *HOME_RAD)
        server = ("server", PYTHON, SERVER, "--hostname", self.address, *home, *options)
        self.server = self.start(*server)
        self.wait_said("server", "ready")
        self._hurry()

    def _hurry(self) -> None:
        """An arm does not wait for other programs; whoever may not ask for that does."""
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(self.server.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))

    def serve_as_installed(self) -> None:
        """Starts franky-sim as its own command does."""
        server = (PYTHON, "-u", "-m", "franky_sim.run_server", "-s", "mujoco")
        self.server = self.start("server", *server, "--hostname", self.address)
        self.wait_said("server", "Press Ctrl+C")
        self._hurry()

    def publish(self, interface: str, *options: object, name: str = "publisher") -> object:
        """Starts the state publisher, and waits until it moves the arm."""
        publisher = self.begin(interface, *options, name=name)
        self.wait_said(name, "waiting for a controller")
        return publisher

    def begin(
        self, interface: str, *options: object, name: str = "publisher", cell: Path = CELL
    ) -> subprocess.Popen:
        """Starts the state publisher."""
        arguments = ("--address", self.address, "--scene", cell, "--instance", self.instance)
        return self.start(
            name,
            *(PYTHON, "-m", "sim_bridge", "franka", *arguments),
            *("--interface", interface, "--real-time", "ignore"),
            *("--summary", self.folder / f"{name}.json", "--force", *options),
        )

    def ask(self, verb: str, *rest: str) -> None:
        """Asks something of the simulated arm, and waits until it is done."""
        before = self.said("server").count(verb)
        print(verb, *rest, file=self.server.stdin, flush=True)
        wait_for(verb, lambda: self.said("server").count(verb) > before)

    def seen(self) -> dict[str, np.ndarray]:
        """What the simulated arm has seen."""
        self._saved += 1
        file = self.folder / f"seen-{self._saved}.npz"
        self.ask("save", str(file))
        with np.load(file) as saved:
            numbers = {key: saved[key] for key in saved.files}
        rows = numbers.pop("rows")
        columns = np.split(rows, [1, 2, 9, 16, 23, 30], axis=1)
        names = ("arrived", "moves", "torque", "q_d", "q", "dq", "box")
        return {**numbers, **dict(zip(names, columns))}

    def end(self, process: subprocess.Popen, number: int = signal.SIGINT) -> int:
        """Ends a program by a signal and gives its exit code."""
        process.send_signal(number)
        return process.wait(PATIENCE_S)

    def close(self) -> None:
        """Ends what still runs; what all have said is printed, for tests that fail."""
        for log in sorted(self.folder.glob("*.log")):
            print(f"{log.name}:\n{log.read_text()}")
        self.end_all()

    def end_all(self) -> None:
        """Ends what still runs."""
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()
            process.stdin.close()


def config_of(interface: str, folder: Path) -> Path:
    """The shipped configuration; for positions with a servo's lag in place of the torques."""
    if interface == "torque":
        return CONFIG
    text = CONFIG.read_text(encoding="utf-8")
    servo = "actuators: PositionServo((lag_s: 0.1, reference_time_constant_s: 0.5)),"
    text, count = re.subn(r"actuators: Torque\(\(.*?\)\),", servo, text, flags=re.DOTALL)
    assert count == 1
    for place in ("base/arm_pick.ron", "../robots/fr3.urdf"):
        text = text.replace(place, str(CONFIG.parent / place))
    file = folder / "fr3_position.ron"
    file.write_text(text, encoding="utf-8")
    return file


class Commander(_Ports):
    """A controller of a few lines: commands velocities of one joint."""

    def __init__(self, rig: Rig) -> None:
        self._state, self._command = RobotState(), JointCommand(joint_count=7)
        super().__init__(Instance(rig.instance))

    def _open(self, instance: Instance, node: object) -> None:
        self.states = instance.subscriber(node, "robot_state", RobotState)
        self.commands = instance.publisher(node, "joint_command", JointCommand)

    def state(self) -> RobotState:
        """The next state."""
        wait_for("a state", lambda: _receive(self.states, self._state))
        return self._state

    def move(self, joint: int, speed_rad_s: float, duration_s: float, spoil: object = None) -> None:
        """Commands a ramp up to a speed for a time on the states' clock; the torque follows it."""
        begun = self.state()
        position, started_ns = list(begun.position[:7]), begun.time_ns
        last_ns, speed = started_ns, 0.0
        while last_ns < started_ns + duration_s * 1e9:
            state, command = self.state(), self._command
            since_s = 1e-9 * (state.time_ns - last_ns)
            last_ns = state.time_ns
            speed = min(speed + 2.0 * since_s, speed_rad_s)
            position[joint] += speed * since_s
            velocity = [speed if k == joint else 0.0 for k in range(7)]
            command.sequence += 1
            command.state_sequence, command.time_ns = state.sequence, state.time_ns
            command.expiry_ns, command.mode = state.time_ns + 50_000_000, CommandMode.TRACK
            command.position[:7], command.velocity[:7] = position, velocity
            errors = zip(position, state.position, velocity, state.velocity)
            command.torque[:7] = [400.0 * (p - q) + 40.0 * (v - w) for p, q, v, w in errors]
            if spoil is not None:
                spoil(command)
            self.commands.send_copy(command)
