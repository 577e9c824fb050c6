"""The messages are those of the Rust side."""

import ctypes
import subprocess

import pytest
from conftest import ROOT

from sim_bridge import messages, wire

CONTROLLER = ROOT / "target" / "release" / "controller"


@pytest.mark.parametrize(
    ("message", "size"),
    [
        (wire.RobotState, 232),
        (wire.Frame, 136),
        (wire.Obstacle, 136),
        (wire.TaskFrames, 5488),
        (wire.JointCommand, 368),
        (wire.ToolCommand, 64),
        (wire.ControllerStatus, 144),
    ],
)
def test_sizes_are_the_agreed_ones(message, size):
    assert ctypes.sizeof(message) == size
    assert ctypes.alignment(message) <= 8


def test_the_module_is_the_one_that_the_controller_prints():
    assert CONTROLLER.exists(), (
        f"{CONTROLLER} is missing: build it with `cargo build --release -p tprmp-controller`"
    )
    result = subprocess.run(
        [CONTROLLER, "layout", "--format", "python"],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert result.returncode == 0, f"`controller layout` failed: {result.stderr}"
    written = (ROOT / "sim-bridge" / "sim_bridge" / "wire.py").read_text()
    assert result.stdout == written, (
        "`controller layout --format python > sim-bridge/sim_bridge/wire.py` writes it anew"
    )


def test_a_name_survives_the_wire():
    frame = messages.Frame()
    messages.place(frame, "ee_start", (0.1, 0.2, 0.3))
    assert messages.read_name(frame) == "ee_start"
    assert bytes(frame.name) == b"ee_start" + bytes(16)
    assert (frame.valid, list(frame.position)) == (1, [0.1, 0.2, 0.3])
    assert list(frame.quaternion) == [1.0, 0.0, 0.0, 0.0]
    with pytest.raises(AssertionError, match="expected 1 to 24 bytes"):
        messages.write_name(frame, "a" * 25)


def test_the_hash_of_joint_names_is_that_of_the_controller():
    assert messages.joint_names_hash(["x_joint", "y_joint"]) == 0x74602FE1934CFFD4
    assert messages.joint_names_hash(["y_joint", "x_joint"]) != 0x74602FE1934CFFD4
