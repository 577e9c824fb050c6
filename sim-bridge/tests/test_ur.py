"""`sim-bridge ur` through ur_rtde against the server that stands in for a UR, as processes."""

import math
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from conftest import ROOT

from sim_bridge.cell import CellFrames
from sim_bridge.cli import main
from sim_bridge.demonstrations import demonstrated_grasp
from sim_bridge.kinematics import forward
from sim_bridge.messages import (
    CommandMode,
    ControllerStatus,
    JointCommand,
    ObstacleKind,
    Reason,
    RobotMode,
    RobotState,
    TaskFrames,
    joint_names_hash,
    read_name,
)
from sim_bridge.poses import pose, rotation_from_quaternion, vector_from_rotation
from sim_bridge.priority import real_time
from sim_bridge.services import Instance
from sim_bridge.ur.arm import Arm, Mode, Safety
from sim_bridge.ur.robot import Sample
from sim_bridge.ur.server import Server
from sim_bridge.ur.stand_in import seal_rule

FRAMES_FILE = ROOT / "config" / "scenes" / "cell_ur5.json"
CONTROLLER = ROOT / "target" / "release" / "controller"
CONFIG = ROOT / "config" / "controllers" / "ur5_rtde.ron"
HOME = (-2.7416, -1.5708, 1.5708, -1.5708, -1.5708, 0.4)
PATIENCE_S = 60.0
SPEED = 0.2
BOX_HALF_HEIGHT_M = 0.02835


class Served:
    """A server in a thread; what the test does to its arm happens between two steps."""

    def __init__(self, host, rate_hz):
        self.arm = Arm(rate_hz, HOME)
        self.trace = []
        self._ends = threading.Event()
        self._server = Server(host, self.arm)
        self._rule, self.arm.rule = None, self._record
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        with real_time(None):
            self._server.run(self._ends.is_set)

    def seal(self, rule):
        self._rule = rule

    def _record(self, arm):
        self.trace.append((list(arm.actual_q), list(arm.actual_qd), arm.inputs))
        return self._rule(arm) if self._rule else 0

    def rests(self):
        """Waits until the arm has been at rest for fifty states from now on."""
        since = len(self.trace)

        def at_rest():
            late = self.trace[max(since, len(self.trace) - 50) :]
            return len(late) == 50 and all(abs(v) < 1e-4 for _, qd, _ in late for v in qd)

        wait_for(at_rest, "the arm at rest")
        return list(self.arm.actual_q)

    def close(self):
        if not self._ends.is_set():
            self._ends.set()
            self._thread.join()
            self._server.close()


def wait_for(condition, what):
    begun_s = time.monotonic()
    while not condition():
        assert time.monotonic() - begun_s < PATIENCE_S, f"did not come: {what}"
        time.sleep(0.002)


@pytest.fixture(params=[125.0, 500.0], ids=["cb3", "e"])
def served(request, ur_host):
    """A robot of either series."""
    served = Served(ur_host, request.param)
    served.host = ur_host
    yield served
    served.close()


@pytest.fixture
def robot(ur_host):
    """A robot of the e-Series."""
    served = Served(ur_host, 500.0)
    served.host = ur_host
    yield served
    served.close()


def start(host, instance, *options):
    """`sim-bridge ur`, as a process."""
    bridge = [sys.executable, "-m", "sim_bridge", "ur", "--scene", str(FRAMES_FILE)]
    return subprocess.Popen(
        [*bridge, "--host", host, "--instance", instance, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
    )


def finish(process, number=None):
    """What a process said, and its exit code."""
    if number is not None and process.poll() is None:
        process.send_signal(number)
    try:
        said = process.communicate(timeout=PATIENCE_S)[0]
    finally:
        process.kill()
    return said, process.returncode


class Commands:
    """A controller of a few lines."""

    def __init__(self, instance):
        self.instance = Instance(instance)
        self.node = self.instance.node()
        self.commands = self.instance.publisher(self.node, "joint_command", JointCommand)
        self.states = self.instance.subscriber(self.node, "robot_state", RobotState)
        self.frames = self.instance.subscriber(self.node, "task_frames", TaskFrames)
        self.command = JointCommand(joint_count=6)

    def close(self):
        del self.commands, self.states, self.frames, self.node
        self.instance.files.remove_leftovers()

    @staticmethod
    def newest(subscriber, kind):
        """Waits for the next message."""
        found = []

        def receive():
            sample = subscriber.receive()
            if sample is not None:
                found.append(kind.from_buffer_copy(sample.payload().contents))
                sample.delete()
            return found

        wait_for(receive, kind.__name__)
        return found[0]

    def state(self):
        return self.newest(self.states, RobotState)

    def until(self, condition, what):
        """The first state of which `condition` holds."""
        begun_s = time.monotonic()
        while not condition(state := self.state()):
            assert time.monotonic() - begun_s < PATIENCE_S, f"did not come: {what}"
        return state

    def send(self, state, position, velocity, mode=CommandMode.TRACK):
        command = self.command
        command.sequence += 1
        command.state_sequence, command.mode = state.sequence, mode
        command.time_ns = time.monotonic_ns()
        command.expiry_ns = command.time_ns + 50_000_000
        command.position[:6], command.velocity[:6] = position, velocity
        self.commands.send_copy(command)

    def ramp(self, joint, speed, duration_s):
        """Commands a joint to move, from rest, from where it is; gives the states meanwhile."""
        state = self.state()
        at, now = list(state.position[:6]), 0.0
        states, last_s = [state], time.monotonic()
        begun_s = last_s
        while last_s - begun_s < duration_s:
            state = self.state()
            states.append(state)
            now_s = time.monotonic()
            dt_s, last_s = now_s - last_s, now_s
            now += math.copysign(min(abs(speed - now), 2.0 * dt_s), speed - now)
            at[joint] += now * dt_s
            velocity = [0.0] * 6
            velocity[joint] = now
            self.send(state, at, velocity)
        return states


@contextmanager
def running(served, instance, *options):
    """The publisher of a robot, and a controller of the test's own."""
    process = start(served.host, instance, *options)
    try:
        wait_for(lambda: served.arm.playing or process.poll() is not None, "the program")
        commands = Commands(instance)
        try:
            yield process, commands
        finally:
            commands.close()
    finally:
        ended = process.poll() is not None
        said, code = finish(process, signal.SIGINT)
        assert ended or code == 0, said
        print(said)


@pytest.mark.parametrize("interface", ["position", "velocity"])
def test_states_are_published_and_commands_move_the_joints(served, instance_name, interface):
    with running(served, instance_name, "--interface", interface) as (_, commands):
        frames = commands.newest(commands.frames, TaskFrames)
        cell = CellFrames(FRAMES_FILE)
        assert [read_name(frame) for frame in frames.frames[:2]] == ["ee_start", "object"]
        tip = forward(cell.chain, np.array(HOME))
        assert frames.frames[0].position[:] == pytest.approx(tip[:3, 3].tolist(), abs=1e-12)
        assert frames.obstacles[0].kind == ObstacleKind.HALF_SPACE
        first = commands.state()
        assert first.joint_names_hash == joint_names_hash(cell.chain.joint_names)
        assert first.position[:6] == pytest.approx(HOME, abs=1e-9)
        assert (first.robot_mode, first.safety_stop, first.gripper_state) == (0, 0, 0)
        states = commands.ramp(2, SPEED, 1.0)
        moved = states[-1].position[2] - states[0].position[2]
        assert moved > 0.5 * SPEED, "most of a second's way, the rest is lag and acceleration"
        integral = 0.0
        for before, after in zip(states, states[1:]):
            assert after.sequence > before.sequence
            assert after.time_ns > before.time_ns
            dt_s = 1e-9 * (after.time_ns - before.time_ns)
            integral += 0.5 * (before.velocity[2] + after.velocity[2]) * dt_s
        assert integral == pytest.approx(moved, rel=0.05)
        others = [states[-1].position[i] - states[0].position[i] for i in (0, 1, 3, 4, 5)]
        assert others == pytest.approx([0.0] * 5, abs=1e-3)
        # Silence: the last command expires, and the arm is braked within its way of braking.
        at = served.arm.q[2]
        served.rests()
        assert served.arm.q[2] - at < SPEED * 0.15 + SPEED**2 / 20.0
        assert served.arm.playing


def test_stop_brakes(robot, instance_name):
    with running(robot, instance_name) as (_, commands):
        state = commands.ramp(1, SPEED, 0.8)[-1]
        at = list(state.position[:6])
        going = [0.0, SPEED, 0.0, 0.0, 0.0, 0.0]
        commands.send(commands.state(), at, going, CommandMode.STOP)
        robot.rests()
        assert robot.arm.actual_q[1] - at[1] < SPEED * 0.1


def test_what_is_faster_than_the_slow_mode_is_refused_and_brakes(robot, instance_name):
    most = 0.2 * math.pi
    with running(robot, instance_name) as (process, commands):
        state = commands.ramp(0, SPEED, 0.5)[-1]
        for _ in range(100):
            state = commands.state()
            commands.send(state, state.position[:6], [1.01 * most, 0.0, 0.0, 0.0, 0.0, 0.0])
        robot.rests()
        said, code = finish(process, signal.SIGINT)
    assert code == 0
    assert f"at most {most:.4f} may be" in said
    assert "refused, the arm brakes: command" in said
    assert max(abs(qd[0]) for _, qd, _ in robot.trace) < 1.05 * most


def test_a_stop_for_safety_is_published_and_after_it_the_arm_obeys_again(served, instance_name):
    with running(served, instance_name) as (_, commands):
        commands.ramp(0, SPEED, 0.5)
        served.arm.stop_for_safety(Safety.PROTECTIVE_STOP)
        state = commands.until(lambda state: state.safety_stop, "a stop")
        assert state.robot_mode == RobotMode.PROTECTIVE_STOP
        at = served.rests()
        for _ in range(50):
            state = commands.state()
            commands.send(state, [q + 0.1 for q in state.position[:6]], [0.0] * 6)
        assert served.rests() == pytest.approx(at, abs=1e-6), "nothing is obeyed meanwhile"
        served.arm.release()
        state = commands.until(lambda state: not state.safety_stop, "its release")
        assert state.robot_mode == RobotMode.RUNNING
        wait_for(lambda: served.arm.playing, "the program, again")
        for _ in range(50):
            commands.state()
        states = commands.ramp(0, SPEED, 1.0)
        assert states[-1].position[0] - states[0].position[0] > 0.5 * SPEED


def test_a_program_that_somebody_stopped_is_not_begun_again(robot, instance_name):
    with running(robot, instance_name) as (process, commands):
        commands.ramp(0, SPEED, 0.5)
        robot.arm.stop_program("a test did")
        said, code = finish(process)
    assert code == 2
    assert "the program on the robot has ended" in said
    assert not robot.arm.playing


def test_a_robot_that_is_gone_ends_the_publisher(served, instance_name):
    with running(served, instance_name) as (process, commands):
        commands.ramp(0, SPEED, 0.3)
        served.close()
        said, code = finish(process)
    assert code == 2
    assert "the robot has sent no state for 0.5 s" in said


def test_a_killed_publisher_leaves_an_arm_that_the_watchdog_stops(robot, instance_name):
    with running(robot, instance_name, "--interface", "velocity") as (process, commands):
        commands.ramp(0, SPEED, 0.8)
        process.kill()
        process.wait()
        robot.rests()
    assert "was not written for 0.1 s" in robot.arm.messages[-1]
    assert not robot.arm.playing


def test_robots_that_are_not_ready_or_not_there_are_named(robot, instance_name):
    robot.arm.mode = Mode.IDLE
    said, code = finish(start(robot.host, instance_name))
    assert code == 2
    assert "power it on, release its brakes" in said
    assert not robot.arm.playing
    robot.close()
    said, code = finish(start(robot.host, instance_name))
    assert code == 2
    assert "no robot answers at port 30004 (RTDE)" in said


@pytest.mark.parametrize(
    ("mode", "safety", "status", "expected"),
    [
        (7, 1, 3, (RobotMode.RUNNING, False)),
        (7, 2, 3, (RobotMode.RUNNING, False)),
        (7, 3, 1, (RobotMode.PROTECTIVE_STOP, True)),
        (7, 5, 3, (RobotMode.RUNNING, True)),
        (7, 12, 3, (RobotMode.RUNNING, True)),
        (3, 6, 0, (RobotMode.EMERGENCY_STOP, True)),
        (3, 7, 0, (RobotMode.EMERGENCY_STOP, True)),
        (7, 4, 1, (RobotMode.FAULT, True)),
        (7, 8, 1, (RobotMode.FAULT, True)),
        (3, 9, 0, (RobotMode.FAULT, True)),
        (5, 1, 1, (RobotMode.FAULT, False)),
        (6, 1, 1, (RobotMode.HAND_GUIDING, False)),
        (7, 1, 7, (RobotMode.HAND_GUIDING, False)),
    ],
)
def test_modes_of_a_ur_become_modes_of_a_state(mode, safety, status, expected):
    sample = Sample(1, 0.0, [0.0] * 6, [0.0] * 6, mode, safety, status, 0, 0)
    assert sample.judged() == expected
    assert sample.usable == (expected == (RobotMode.RUNNING, False))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--speed-fraction", "0"], "--speed-fraction: expected above 0, at most 1, found 0"),
        (["--speed-fraction", "nan"], "--speed-fraction: expected above 0"),
        (["--interface", "torque"], "--interface: expected position, velocity, found `torque`"),
        (["--gain", "50"], "--gain: expected 100 to 2000, found 50"),
        (["--lookahead-s", "0.5"], "--lookahead-s: expected 0.03 to 0.2, found 0.5"),
        (["--gripper-output", "10"], "--gripper-output: expected 0 to 9, found 10"),
        (["--gripper-input", "1"], "--gripper-input needs --gripper-output"),
    ],
)
def test_options_outside_their_range_are_refused(options, said, capsys):
    arguments = ["ur", "--host", "127.0.0.1", "--scene", str(FRAMES_FILE), *options]
    assert main(arguments) == 2
    assert said in capsys.readouterr().err


def test_the_help_says_first_that_no_hardware_was_seen(capsys):
    with pytest.raises(SystemExit):
        main(["ur", "--help"])
    assert capsys.readouterr().out.startswith("Not run on hardware yet.\n")


def test_a_missing_client_is_named_with_what_installs_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rtde_receive", None)
    assert main(["ur", "--host", "127.0.0.1", "--scene", str(FRAMES_FILE)]) == 2
    assert "`make venv` installs it" in capsys.readouterr().err


def gripper(served):
    """The gripper of the robot holds where its tip is on the box."""
    served.seal(seal_rule(CellFrames(FRAMES_FILE), "object", BOX_HALF_HEIGHT_M))
    return ["--gripper-output", "0", "--gripper-input", "0"]


@pytest.mark.parametrize("served", [500.0], ids=["e"], indirect=True)
def test_the_conformance_kit_passes(served, instance_name):
    process = start(served.host, instance_name, *gripper(served))
    try:
        wait_for(lambda: served.arm.playing, "the program")
        kit = [CONTROLLER, "conformance", CONFIG, "--instance", instance_name, "--seconds", "1"]
        result = subprocess.run([*kit, "--move", "--yes"], capture_output=True, text=True, cwd=ROOT)
    finally:
        said, code = finish(process, signal.SIGINT)
    assert result.returncode == 0, f"{result.stdout}{result.stderr}{said}"
    for check in ("order and sign", "velocity in motion", "expired command", "killed controller"):
        assert f"passed  {check}" in result.stdout
    assert code == 0, said


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """The shipped pick, learned."""
    file = tmp_path_factory.mktemp("model") / "pick.model.ron"
    learner = [CONTROLLER.with_name("learner"), "train", ROOT / "config/skills/pick.ron"]
    subprocess.run([*learner, "--out", file], check=True, capture_output=True)
    return file


def pick(served, instance, model, meanwhile):
    """Lets the shipped controller pick; what was said, after both have ended well."""
    publisher = start(served.host, instance, *gripper(served))
    options = ["--model", model, "--until-done", "--instance", instance]
    controller = None
    try:
        wait_for(lambda: served.arm.playing, "the program")
        controller = subprocess.Popen(
            [CONTROLLER, "run", CONFIG, *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=ROOT,
        )
        meanwhile()
        said, code = finish(controller)
    finally:
        if controller is not None:
            controller.kill()
        published, publisher_code = finish(publisher, signal.SIGINT)
    assert (code, publisher_code) == (0, 0), said + published
    return said + published


def error_at_the_grip(served):
    """Of the tip when the cup sealed, against the demonstrated grasp [m], [rad]; the lift [m]."""
    cell = CellFrames(FRAMES_FILE)
    box = cell.fixed[0]
    x_box = pose(rotation_from_quaternion(np.array(box.quaternion_wxyz)), np.array(box.position_m))
    x_goal = x_box @ demonstrated_grasp(ROOT / "config/demonstrations/pick", "object")
    gripped = next(q for q, _, inputs in served.trace if inputs & 1)
    x_tip, x_end = (forward(cell.chain, np.array(q)) for q in (gripped, served.arm.actual_q))
    error_rad = np.linalg.norm(vector_from_rotation(x_tip[:3, :3] @ x_goal[:3, :3].T))
    error_m = np.linalg.norm(x_tip[:3, 3] - x_goal[:3, 3])
    print(f"at the grip: {1e3 * error_m:.2f} mm, {math.degrees(error_rad):.2f} degrees")
    return error_m, error_rad, x_end[2, 3] - x_tip[2, 3]


@pytest.mark.parametrize("served", [125.0], ids=["cb3"], indirect=True)
def test_the_pick_grips_where_it_was_demonstrated_and_lifts(served, instance_name, model):
    pick(served, instance_name, model, lambda: None)
    error_m, error_rad, lift_m = error_at_the_grip(served)
    assert error_m < 0.003
    assert math.degrees(error_rad) < 1.0
    assert lift_m > 0.1
    assert served.arm.outputs & 1, "what is held is not dropped at the end"
    fastest = max(max(map(abs, qd)) for _, qd, _ in served.trace)
    assert fastest < 1.01 * 0.2 * math.pi, "the slow mode"


def wait_for_reason(instance_name, reason):
    """Waits until the controller says that it is held for this reason."""
    instance = Instance(instance_name)
    node = instance.node()
    statuses = instance.subscriber(node, "controller_status", ControllerStatus)
    begun_s = time.monotonic()
    while Commands.newest(statuses, ControllerStatus).reason != reason:
        assert time.monotonic() - begun_s < PATIENCE_S, f"did not come: {reason.name}"
    del statuses, node
    instance.files.remove_leftovers()


@pytest.mark.parametrize("served", [500.0], ids=["e"], indirect=True)
def test_a_pick_goes_on_after_a_protective_stop(served, instance_name, model):
    def stop_and_release():
        wait_for(lambda: abs(served.arm.actual_q[0] - HOME[0]) > 0.1, "a motion")
        served.arm.stop_for_safety(Safety.PROTECTIVE_STOP)
        at = served.rests()
        wait_for_reason(instance_name, Reason.PROTECTIVE_STOP)
        assert at == pytest.approx(served.rests(), abs=1e-9)
        served.arm.release()

    pick(served, instance_name, model, stop_and_release)
    error_m, error_rad, lift_m = error_at_the_grip(served)
    assert error_m < 0.003
    assert math.degrees(error_rad) < 1.0
    assert lift_m > 0.1
    speeds = np.array([qd for _, qd, _ in served.trace])
    accelerations = np.abs(np.diff(speeds, axis=0)) / served.arm.period_s
    assert accelerations.max() < 20.5, "going on is gentler than the stop, which is of 20 rad/s²"
