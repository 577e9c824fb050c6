"""What a Franka arm is asked for stays within what it accepts, whatever a controller commands."""

import json
import math
import random
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT

from sim_bridge.cell import CellFrames
from sim_bridge.errors import BridgeError
from sim_bridge.franka.limits import (
    ACCELERATION_MAX_RAD_S2,
    JERK_MAX_RAD_S3,
    JOINTS,
    REST_RAD_S,
    SLOW_FRACTION,
    STEP_S,
    TORQUE_RATE_MAX_N_M_S,
    PositionReference,
    SlowMode,
    TorqueBrake,
    TorqueLimit,
    speed_bounds,
)
from sim_bridge.kinematics import forward
from sim_bridge.messages import read_name

CELL = ROOT / "config" / "scenes" / "cell_fr3.json"
START = [0.5, -0.1, 0.1, -2.2, 0.0, 2.1, 2.5]


@pytest.fixture(scope="module")
def chain():
    return CellFrames(CELL).chain


def differences(positions):
    """Velocities, accelerations and jerks of positions a millisecond apart."""
    velocity = np.diff(positions, axis=0) / STEP_S
    acceleration = np.diff(velocity, axis=0) / STEP_S
    return velocity, acceleration, np.diff(acceleration, axis=0) / STEP_S


def test_torques_keep_effort_and_rate_and_arrive_where_they_may():
    draw = random.Random(1)
    limit = TorqueLimit([87.0] * 4 + [12.0] * 3)
    before = [0.0] * JOINTS
    for _ in range(500):
        wanted = [draw.uniform(-200.0, 200.0) for _ in range(JOINTS)]
        after = limit.limited(wanted, before)
        steps = np.abs(np.subtract(after, before))
        assert steps.max() < TORQUE_RATE_MAX_N_M_S * STEP_S
        assert np.all(np.abs(after) <= limit.effort_max_n_m)
        before = after
    near = [torque + 0.5 for torque in [0.0] * JOINTS]
    assert limit.limited(near, [0.0] * JOINTS) == near


@pytest.mark.parametrize("fraction", [1.0, SLOW_FRACTION])
def test_references_keep_the_limits_of_libfranka_for_any_setpoints(chain, fraction):
    draw = random.Random(2)
    reference = PositionReference(chain, START, fraction)
    positions = [list(START)]
    for _ in range(60):
        goal = [q + draw.uniform(-1.5, 1.5) for q in START]
        speed = [draw.uniform(-6.0, 6.0) for _ in range(JOINTS)]
        brakes = draw.random() < 0.3
        for _ in range(draw.randrange(1, 400)):
            if brakes:
                reference.brake(goal, speed, 1)
            else:
                reference.follow(goal, speed, 1)
            positions.append(list(reference.position))
    velocity, acceleration, jerk = differences(np.array(positions))
    assert np.all(np.abs(velocity) <= fraction * chain.velocity_max_rad_s + 0.05)
    # Far enough from rest that the bounds above were asked for.
    assert np.abs(velocity).max() > 0.5 * fraction * chain.velocity_max_rad_s.max()
    assert np.abs(acceleration).max() <= ACCELERATION_MAX_RAD_S2
    assert np.abs(jerk).max() <= JERK_MAX_RAD_S3


def test_a_reference_follows_a_steady_motion_without_a_lag(chain):
    reference = PositionReference(chain, START, 1.0)
    speed = [0.3, -0.2, 0.1, 0.2, -0.3, 0.1, -0.2]
    for k in range(1, 1500):
        goal = [q + v * STEP_S * k for q, v in zip(START, speed)]
        reference.follow(goal, speed, 1)
    # A millisecond of the motion is 0.3 mrad, a lag by the rate of following 6 mrad.
    assert np.abs(np.subtract(reference.position, goal)).max() < 5e-4


def test_states_that_are_lost_do_not_change_where_a_reference_goes(chain):
    one, several = (PositionReference(chain, START, 1.0) for _ in range(2))
    goal, rest = [q + 0.2 for q in START], [0.0] * JOINTS
    for _ in range(60):
        several.follow(goal, rest, 5)
        for _ in range(5):
            one.follow(goal, rest, 1)
    assert one.position == several.position


def test_a_reference_ahead_of_the_arm_returns_to_where_that_can_rest(chain):
    reference = PositionReference(chain, START, 1.0)
    moving = [0.4] * JOINTS
    for k in range(1, 500):
        reference.follow([q + 0.4 * STEP_S * k for q in START], moving, 1)
    behind = [q - 0.04 for q in reference.position]
    for _ in range(1000):
        reference.brake(behind, moving, 1)
    assert reference.rests
    rest = [q + 0.4**2 / 10.0 for q in behind]
    assert np.abs(np.subtract(reference.position, rest)).max() < 1e-3
    # At rest a load that presses on the arm does not drag it along.
    stays = list(reference.position)
    reference.follow(stays, [0.0] * JOINTS, 1)
    for _ in range(1000):
        reference.brake([q - 0.05 for q in stays], [0.0] * JOINTS, 1)
    assert np.abs(np.subtract(reference.position, stays)).max() < 1e-3


def test_speeds_fall_towards_the_position_limits(chain):
    for joint in range(JOINTS):
        upper = float(chain.position_max_rad[joint])
        slowest, fastest = speed_bounds(chain, joint, upper)
        assert fastest == 0.0
        assert slowest < 0.0
        middle = 0.5 * (upper + float(chain.position_min_rad[joint]))
        assert speed_bounds(chain, joint, middle)[1] > 1.5


def test_the_brake_pulls_against_the_motion_and_comes_to_rest():
    brake = TorqueBrake()
    q, dq = [0.0] * JOINTS, [0.5, -0.4, 0.3, 0.0, 0.2, -0.2, 0.1]
    inertia = [1.0, 1.0, 0.8, 0.6, 0.2, 0.2, 0.1]
    for _ in range(2000):
        torque = brake.torque(list(q), list(dq), 1)
        for joint in range(JOINTS):
            dq[joint] += STEP_S * torque[joint] / inertia[joint]
            q[joint] += STEP_S * dq[joint]
    assert max(map(abs, dq)) < REST_RAD_S
    for joint, speed in enumerate((0.5, -0.4, 0.3, 0.0, 0.2, -0.2, 0.1)):
        assert math.isclose(q[joint], speed * abs(speed) / 10.0, abs_tol=0.01)


def test_the_slow_mode_waits_for_rest_and_full_speed_leaves_it():
    slow = SlowMode([2.0] * JOINTS)
    still, fast = [0.0] * JOINTS, [0.0, 0.5] + [0.0] * 5
    assert slow.permits([0.39] * JOINTS, still)
    assert not slow.permits(fast, still)
    assert "joint 2 is commanded to move at 0.50 rad/s, at most 0.40" in slow.last
    assert not slow.permits(still, [0.1] * JOINTS), "it still moves"
    assert not slow.permits(None, [0.02] * JOINTS)
    assert slow.permits(None, still)
    assert not slow.permits(still, [0.0, 0.0, -0.5] + [0.0] * 4)
    assert "joint 3 moves at -0.50" in slow.last
    assert slow.refused == 2
    assert not SlowMode([2.0] * JOINTS).permits([math.nan] * JOINTS, still)
    assert SlowMode([2.0] * JOINTS, full_speed=True).permits(fast, fast)


def test_a_cell_has_its_frames_and_the_start_is_where_the_tool_is(chain):
    cell = CellFrames(CELL)
    cell.start_at(START)
    message = cell.message
    assert [read_name(frame) for frame in message.frames[:2]] == ["ee_start", "object"]
    x_tool = forward(chain, np.array(START))
    assert list(message.frames[0].position) == x_tool[:3, 3].tolist()
    assert (message.frame_count, message.obstacle_count) == (2, 1)


@pytest.mark.parametrize(
    ("edit", "text"),
    [
        ({"tip_link": 3}, "`tip_link`: expected a text"),
        ({"frames": [{"name": "a"}]}, "`frames[0].position_m` is missing"),
        (
            {"frames": [{"name": "a", "position_m": [0, 0, 0], "quaternion_wxyz": [2, 0, 0, 0]}]},
            "expected a quaternion w x y z of unit length",
        ),
        ({"start_frame": "object"}, "expected a name once, found object, object"),
    ],
)
def test_what_is_wrong_in_a_cell_is_named(tmp_path, edit, text):
    values = json.loads(CELL.read_text())
    values["urdf"] = str(CELL.parent / values["urdf"])
    file = tmp_path / "cell.json"
    file.write_text(json.dumps({**values, **edit}))
    with pytest.raises(BridgeError) as error:
        CellFrames(file)
    assert text in str(error.value)
    assert "cell.json" in str(error.value)


def test_help_says_first_that_it_has_not_run_on_hardware():
    command = [sys.executable, "-m", "sim_bridge", "franka"]
    said = subprocess.run([*command, "--help"], capture_output=True, text=True, check=True)
    assert said.stdout.splitlines()[0] == "Not run on hardware yet."
    # The packages of the simulators beside libfranka's own need another Python environment.
    arguments = ["--address", "127.0.0.1", "--scene", str(CELL)]
    without = "import sys; sys.modules['pylibfranka'] = None; from sim_bridge.cli import main; "
    code = f"{without}sys.exit(main({['franka', *arguments]!r}))"
    refused = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert refused.returncode == 2
    assert "pip install pylibfranka==0.21.3" in refused.stderr
