"""The messages are those of the Rust side."""

import ctypes
import json
import subprocess

import pytest
from conftest import ROOT

from sim_bridge import messages

CONTROLLER = ROOT / "target" / "release" / "controller"


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("RobotState", 232),
        ("Frame", 136),
        ("Obstacle", 136),
        ("TaskFrames", 5488),
        ("JointCommand", 368),
        ("ToolCommand", 64),
        ("ControllerStatus", 144),
    ],
)
def test_sizes_are_the_agreed_ones(name, size):
    assert ctypes.sizeof(messages.MESSAGES[name][0]) == size


def test_every_field_lies_where_the_controller_says():
    assert CONTROLLER.exists(), (
        f"{CONTROLLER} is missing: build it with `cargo build --release -p tprmp-controller`"
    )
    result = subprocess.run(
        [CONTROLLER, "layout"], capture_output=True, text=True, timeout=30, check=False
    )
    assert result.returncode == 0, f"`controller layout` failed: {result.stderr}"
    theirs = {
        (f["message"], f["field"]): (f["offset"], f["size"]) for f in json.loads(result.stdout)
    }
    ours = {(f["message"], f["field"]): (f["offset"], f["size"]) for f in messages.layout()}
    assert ours == theirs


def test_a_name_survives_the_wire():
    frame = messages.Frame()
    messages.write_name(frame, "ee_start")
    assert messages.read_name(frame) == "ee_start"
    assert bytes(frame.name) == b"ee_start" + bytes(16)


def test_the_hash_of_joint_names_is_that_of_the_controller():
    assert messages.joint_names_hash(["x_joint", "y_joint"]) == 0x74602FE1934CFFD4
    assert messages.joint_names_hash(["y_joint", "x_joint"]) != 0x74602FE1934CFFD4
