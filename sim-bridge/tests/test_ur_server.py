"""The stand-in for a UR: the protocol byte by byte, the scripts it runs, its dynamics."""

import math
import socket
import struct

import pytest

from sim_bridge.errors import BridgeError
from sim_bridge.ur import urscript
from sim_bridge.ur.arm import Arm, Mode, Safety
from sim_bridge.ur.protocol import OUTPUTS, Kind, ProtocolError, Reader, Recipe
from sim_bridge.ur.server import DASHBOARD_PORT, RTDE_PORT, Server

HOME = (0.1, -1.2, 1.3, -1.4, -1.5, 0.2)


@pytest.fixture
def server(ur_host):
    """A server on an address of this test's own; steps only when told."""
    with Server(ur_host, Arm(500.0, HOME)) as server:
        yield server


class Connection:
    """A client of one port, in the same thread as its server."""

    def __init__(self, server, port=RTDE_PORT):
        self.server = server
        self.socket = socket.create_connection((server.host, port))
        self.socket.settimeout(0.05)
        self.server.serve(0.1)

    def send(self, data):
        self.socket.sendall(data)
        self.server.serve(0.1)

    def read(self):
        """What has come so far; `None`: the connection was closed after it."""
        found = b""
        while True:
            try:
                part = self.socket.recv(1 << 16)
            except socket.timeout:
                return found
            except ConnectionResetError:
                part = b""
            if not part:
                return found or None
            found += part

    def ask(self, kind, content=b""):
        """The package that answers one."""
        self.send(struct.pack(">HB", 3 + len(content), kind) + content)
        data = self.read()
        size, found = struct.unpack(">HB", data[:3])
        assert (size, found) == (len(data), kind)
        return data[3:]


def connected(server):
    connection = Connection(server)
    assert connection.ask(ord("V"), struct.pack(">H", 2)) == b"\x01"
    return connection


def test_only_protocol_version_2_is_spoken(server):
    connection = Connection(server)
    for version in (0, 1, 3, 65535):
        assert connection.ask(ord("V"), struct.pack(">H", version)) == b"\x00"
    assert connection.ask(ord("V"), struct.pack(">H", 2)) == b"\x01"
    assert struct.unpack(">4I", connection.ask(ord("v")))[0] == 5


def test_states_are_sent_as_their_recipe_says_and_at_its_rate(server):
    connection = connected(server)
    names = b"timestamp,actual_q,robot_mode,safety_mode,output_int_register_47"
    answer = connection.ask(ord("O"), struct.pack(">d", 125.0) + names)
    assert answer == b"\x01DOUBLE,VECTOR6D,INT32,INT32,INT32"
    server.step()
    assert connection.read() == b"", "not before it was started"
    assert connection.ask(ord("S")) == b"\x01"
    for _ in range(8):
        server.step()
    data = connection.read()
    layout = struct.Struct(">HBBd6d3i")
    assert len(data) == 2 * layout.size, "125 of 500"
    size, kind, recipe, time_s, *rest = layout.unpack(data[: layout.size])
    assert (size, kind, recipe) == (layout.size, ord("U"), 1)
    assert time_s == pytest.approx(0.002 * 4)
    assert rest == [*HOME, 7, 1, 0]
    assert connection.ask(ord("P")) == b"\x01"
    server.step()
    assert connection.read() == b""


def test_unknown_names_are_not_found_and_start_nothing(server):
    connection = connected(server)
    content = struct.pack(">d", 125.0) + b"timestamp,actual_quark,actual_qd"
    assert connection.ask(ord("O"), content) == b"\x00DOUBLE,NOT_FOUND,VECTOR6D"
    assert connection.ask(ord("S")) == b"\x00"
    answer = connection.ask(ord("I"), b"input_int_register_0,input_int_register_48")
    assert answer == b"\x00INT32,NOT_FOUND"
    for frequency in (0.0, 501.0, math.nan):
        content = struct.pack(">d", frequency) + b"timestamp"
        assert connection.ask(ord("O"), content) == b"\x00DOUBLE", frequency


def test_an_input_has_one_writer(server):
    first, second = connected(server), connected(server)
    assert (
        first.ask(ord("I"), b"input_int_register_0,input_double_register_3") == b"\x01INT32,DOUBLE"
    )
    assert (
        second.ask(ord("I"), b"input_double_register_3,speed_slider_mask") == b"\x00IN_USE,UINT32"
    )
    assert first.ask(ord("I"), b"input_int_register_0") == b"\x02INT32", "its own again"
    first.send(struct.pack(">HBBid", 16, ord("U"), 1, -5, 2.5))
    assert server.arm.output("input_int_register_0") == -5
    assert server.arm.output("input_double_register_3") == 2.5
    first.socket.close()
    server.serve(0.1)
    assert second.ask(ord("I"), b"input_double_register_3") == b"\x01DOUBLE"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"\x00\x02V", "size: expected 3 or more, found 2"),
        (b"\x00\x03z", "expected one of VvMUOISP, found 122"),
        (b"\x00\x04V\x02", "a version: expected 2 bytes, found 1"),
        (b"\x00\x05O\x40\x5f", "an output recipe: expected 8 bytes or more, found 2"),
        (b"\x00\x03U", "expected the number of an input recipe"),
        (b"\x00\x04U\x07", "expected the number of an input recipe"),
        (b"\x00\x06U\x01\x00\x00", "recipe 1: expected 5 bytes, found 3"),
    ],
)
def test_malformed_packages_are_named_and_end_the_connection_only(server, data, said):
    connection = connected(server)
    connection.ask(ord("I"), b"input_int_register_0")
    connection.send(data)
    server.serve(0.0)
    answer = connection.read()
    assert answer[2:3] == b"M"
    assert said in answer.decode("latin-1")
    assert connection.read() is None
    assert connected(server).ask(ord("v")), "others go on"


def test_packages_come_in_any_pieces():
    whole = struct.pack(">HBH", 5, ord("V"), 2) + struct.pack(">HB", 3, ord("S"))
    reader = Reader()
    found = [item for i in range(len(whole)) for item in reader.feed(whole[i : i + 1])]
    assert found == [(Kind.VERSION, b"\x00\x02"), (Kind.START, b"")]
    assert Reader().feed(whole) == found


def test_a_recipe_unpacks_what_it_packs():
    recipe = Recipe(3, ["robot_mode", "actual_q", "timestamp"], OUTPUTS)
    content = recipe.pack([-1, [1, 2, 3, 4, 5, 6], 7.5])
    assert recipe.unpack(content) == {
        "robot_mode": -1,
        "actual_q": [1, 2, 3, 4, 5, 6],
        "timestamp": 7.5,
    }
    with pytest.raises(ProtocolError, match="expected 61 bytes, found 60"):
        recipe.unpack(content[:-1])


def test_ports_in_use_are_named(server):
    with pytest.raises(BridgeError, match=r":30004 cannot be listened at .*choose another --host"):
        Server(server.host, Arm(500.0, HOME))


def test_the_dashboard_answers(server):
    connection = Connection(server, DASHBOARD_PORT)
    assert connection.read() == b"Connected: Universal Robots Dashboard Server\n"
    server.arm.stop_for_safety(Safety.PROTECTIVE_STOP)
    for line, answer in (
        ("robotmode", "Robotmode: RUNNING"),
        ("safetymode", "Safetymode: PROTECTIVE_STOP"),
        ("running", "Program running: false"),
        ("unlock protective stop", "Protective stop releasing"),
        ("safetymode", "Safetymode: NORMAL"),
        ("dance", "could not understand: 'dance'"),
    ):
        connection.send(f"{line}\n".encode())
        assert connection.read().decode() == f"{answer}\n"


def steps(arm, time_s):
    for _ in range(round(time_s / arm.period_s)):
        arm.step()


@pytest.mark.parametrize("rate_hz", [125.0, 500.0])
def test_servoj_follows_a_ramp_by_its_lookahead_late(rate_hz):
    arm = Arm(rate_hz, HOME)
    arm.play(
        "def ramp():\n"
        "  q = get_actual_joint_positions()\n"
        "  while True:\n"
        "    q[0] = q[0] + 0.25 * get_steptime()\n"
        "    servoj(q, t=get_steptime(), lookahead_time=0.1, gain=300)\n"
        "  end\nend\n"
    )
    steps(arm, 2.0)
    assert arm.qd[0] == pytest.approx(0.25, rel=5e-3)
    lag_s = (HOME[0] + 0.25 * 2.0 - arm.q[0]) / 0.25
    assert lag_s == pytest.approx(0.1, abs=arm.period_s)
    assert (arm.q[0] - arm.actual_q[0]) / 0.25 == pytest.approx(0.006, abs=0.001)
    assert arm.q[1:] == list(HOME[1:])


def test_speedj_accelerates_as_told_and_a_stop_brakes_as_told():
    arm = Arm(500.0, HOME)
    arm.play("def go():\n  speedj([0.5, 0, 0, 0, 0, 0], 2.0, 0.6)\n  stopj(5.0)\nend\n")
    steps(arm, 0.1)
    assert arm.qd[0] == pytest.approx(0.2)
    steps(arm, 0.4)
    assert arm.qd[0] == pytest.approx(0.5)
    steps(arm, 0.15)
    assert arm.qd[0] == pytest.approx(0.5 - 5.0 * 0.05, abs=0.02)
    steps(arm, 0.3)
    assert arm.qd[0] == pytest.approx(0.0, abs=1e-12)
    assert not arm.playing


def test_the_measured_velocity_is_the_derivative_of_the_position():
    arm = Arm(500.0, HOME)
    arm.play("def go():\n  speedj([0.5, -0.3, 0, 0, 0, 0.1], 2.0, 1.0)\nend\n")
    before = arm.actual_q
    for _ in range(400):
        before = list(arm.actual_q)
        arm.step()
        derivative = [(b - a) / 0.002 for a, b in zip(before, arm.actual_q)]
        assert arm.actual_qd == pytest.approx(derivative, abs=1e-9)
    assert arm.actual_qd[0] == pytest.approx(0.5, abs=1e-6)


def test_an_arm_without_a_program_brakes_and_bounds_hold():
    arm = Arm(500.0, HOME)
    servoj = "servoj([6, 0, 0, 0, 0, 0], t=0.002, lookahead_time=0.03, gain=2000)"
    arm.play(f"def jump():\n while True:\n {servoj}\n end\nend\n")
    speeds = []
    for _ in range(100):
        before = list(arm.qd)
        arm.step()
        speeds.append(max(map(abs, arm.qd)))
        assert max(abs(b - a) for a, b in zip(before, arm.qd)) <= 80.0 * 0.002 + 1e-9
    assert max(speeds) == pytest.approx(math.pi)
    arm.stop_program("a test")
    steps(arm, math.pi / 20.0 + 0.01)
    assert arm.qd == pytest.approx([0.0] * 6, abs=1e-12)


@pytest.mark.parametrize(
    ("safety", "bits"), [(1, 1), (3, 4 | 1 << 10), (7, 1 << 6 | 1 << 7 | 1 << 10)]
)
def test_safety_modes_end_the_program_and_set_their_bits(safety, bits):
    arm = Arm(500.0, HOME)
    arm.play("def wait():\n while True:\n  sync()\n end\nend\n")
    arm.step()
    assert arm.output("robot_status_bits") == 0b11
    if safety != Safety.NORMAL:
        arm.stop_for_safety(Safety(safety))
        assert not arm.playing
        with pytest.raises(urscript.ScriptError, match="stopped or not powered"):
            arm.play("def again():\n sync()\nend\n")
    assert arm.output("safety_mode") == safety
    assert arm.output("safety_status_bits") == bits
    arm.mode = Mode.IDLE
    assert arm.output("robot_mode") == 5


def test_the_watchdog_ends_a_program_that_nobody_writes_to():
    arm = Arm(500.0, HOME)
    arm.play(
        'def watched():\n rtde_set_watchdog("input_int_register_0", 10, "stop")\n'
        " while True:\n  sync()\n end\nend\n"
    )
    for _ in range(10):
        steps(arm, 0.05)
        arm.write({"input_int_register_0": 1})
    assert arm.playing
    steps(arm, 0.09)
    assert arm.playing
    steps(arm, 0.03)
    assert not arm.playing
    assert "input_int_register_0 was not written for 0.1 s" in arm.messages[-1]


def test_scripts_have_threads_globals_and_poses():
    arm = Arm(500.0, HOME)
    arm.play(
        "def main():\n"
        "  # a comment with end\n"
        "  global count = # the value stands below\n"
        "0  global pose = p[1, 2, 3, 0, 0, 0]\n"
        '  textmsg("# no comment: ", pose)\n'
        "  thread counter():\n"
        "    while True:\n"
        "      count = count + 1\n"
        "      sync()\n"
        "    end\n"
        "  end\n"
        "  def add(p, by):\n"
        "    p[0] = p[0] + by\n"
        "    return p[0]\n"
        "  end\n"
        "  global counting = run counter()\n"
        "  sleep(0.1)\n"
        "  kill counting\n"
        '  if count > 1000:\n    textmsg(1)\n  elif count > 40:\n    textmsg("counted")\n  end\n'
        "  sleep(0.1)\n"
        "  write_output_integer_register(5, count)\n"
        "  write_output_float_register(5, add(pose, 0.5))\n"
        "end\n"
    )
    steps(arm, 0.3)
    assert arm.messages[0] == "# no comment: [1, 2, 3, 0, 0, 0]"
    assert arm.messages[1:] == ["counted", "program `main` ended: it is done"]
    assert 45 <= arm.output("output_int_register_5") <= 51
    assert arm.output("output_double_register_5") == 1.5


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("x = (1).__class__", "not known here"),
        ("import os", "no URScript"),
        ("x = lambda: 1", "no URScript"),
        ("x = [i for i in y]", "no URScript"),
        ("__import__('os')", "not known here"),
        ("movel(p[0, 0, 0, 0, 0, 0])", "movel"),
        ("while True:\nx = 1\nend", "a loop without a time slice"),
        ("servoj([1, 2], t=0.1)", "expected 6 finite numbers"),
        ("servoj([0, 0, 0, 0, 0, 0], t=0.1, gain=5)", "a gain of 100 to 2000, found 0.1 and 5"),
        ("x = 9 ** 9", "not known here"),
    ],
)
def test_a_program_that_cannot_be_run_says_why_and_moves_nothing(body, said):
    arm = Arm(500.0, HOME)
    try:
        arm.play(f"def main():\n{body}\nend\n")
        steps(arm, 0.1)
        found = arm.messages[-1]
    except urscript.ScriptError as error:
        found = str(error)
    assert said in found
    assert not arm.playing
    assert arm.actual_q == list(HOME)


def test_programs_are_split_where_they_end(server):
    text = "def a():\n  if True:\n    sync()\n  end\nend\n"
    text += "set_standard_digital_out(3, True)\ndef b():\n"
    programs, rest = urscript.complete(text)
    assert [program.split("\n", 1)[0] for program in programs] == [
        "def a():",
        "set_standard_digital_out(3, True)",
    ]
    assert rest == "def b():\n"
    connection = Connection(server, 30002)
    connection.send(b"set_standard_digital_out(3, True)\n")
    server.step()
    assert server.arm.output("actual_digital_output_bits") == 8
