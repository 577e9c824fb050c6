"""The Franka arm's publisher against PyPI's franky-sim, which speaks libfranka's protocol."""

import json
import subprocess

import numpy as np
import pytest
from conftest import ROOT
from franka_rig import CONTROLLER, LEARNER, PYTHON, Commander, Rig, config_of, wait_for

from sim_bridge.cell import CellFrames
from sim_bridge.franka.limits import (
    ACCELERATION_MAX_RAD_S2,
    JERK_MAX_RAD_S3,
    SLOW_FRACTION,
    STEP_S,
    TORQUE_RATE_MAX_N_M_S,
)
from sim_bridge.kinematics import forward
from sim_bridge.messages import RobotMode
from sim_bridge.poses import rotation_from_quaternion

BOTH = pytest.mark.parametrize("interface", ["torque", "position"])
BOX_M = (0.5, -0.2, 0.0284)
GRASP_M = 0.02735
"""How far above the object's frame the skill ends: where the suction cup touched the box."""


@pytest.fixture
def rig(tmp_path):
    """Programs that end with the test."""
    for program, remedy in ((PYTHON, "make venv-franka"), (CONTROLLER, "make build")):
        assert program.exists(), f"{program.relative_to(ROOT)} is missing: `{remedy}` makes it"
    rig = Rig(tmp_path)
    yield rig
    rig.close()


@pytest.fixture(scope="session")
def model(tmp_path_factory):
    """The shipped skill, learned."""
    file = tmp_path_factory.mktemp("franka") / "pick.model.ron"
    skill = ROOT / "config" / "skills" / "pick.ron"
    subprocess.run([LEARNER, "train", skill, "--out", file], check=True, stdout=subprocess.DEVNULL)
    return file


def check_accepted(seen):
    """An arm would have accepted every command: there was no cause of a reflex."""
    assert seen["torque_step"] <= TORQUE_RATE_MAX_N_M_S * STEP_S
    assert seen["acceleration"] <= ACCELERATION_MAX_RAD_S2
    assert seen["jerk"] <= JERK_MAX_RAD_S3
    assert seen["start"] < 1e-4
    assert seen["received"] > 300


def check_slow(seen, chain):
    """The arm was never faster than in the slow mode."""
    assert np.all(np.abs(seen["dq"]) <= SLOW_FRACTION * chain.velocity_max_rad_s)


def check_rests(rig):
    """The arm comes to rest and is still controlled: no reflex has ended that."""

    def rests():
        seen = rig.seen()
        spread = np.ptp(seen["q"][-300:], axis=0)
        return bool(seen["moves"][-1]) and len(seen["q"]) > 300 and spread.max() < 1e-3

    wait_for("rest", rests)


@pytest.fixture(scope="session")
def chain():
    return CellFrames(ROOT / "config" / "scenes" / "cell_fr3.json").chain


@BOTH
def test_the_conformance_kit_passes(rig, interface, chain, tmp_path):
    """States agree with their positions, each joint follows; expired and stopped it brakes."""
    rig.serve()
    publisher = rig.publish(interface)
    arguments = ("--instance", rig.instance, "--move", "--yes")
    kit = rig.start("kit", CONTROLLER, "conformance", config_of(interface, tmp_path), *arguments)
    assert kit.wait(180) == 0, rig.said("kit")
    for check in ("velocity in motion", "order and sign", "expired command", "killed controller"):
        assert f"passed  {check}" in rig.said("kit"), rig.said("kit")
    seen = rig.seen()
    check_accepted(seen)
    assert seen["moves"][-1], "the arm is controlled to the end"
    if interface == "torque":
        # The simulator's kinematics are Pinocchio's, of the manufacturer's description; with
        # positions it reports the tool where it is to be.
        assert np.abs(forward(chain, seen["q"][-1]) - seen["tool"]).max() < 1e-5
    assert rig.end(publisher) == 0, rig.said("publisher")
    summary = json.loads((tmp_path / "publisher.json").read_text())
    assert summary["reflexes"] == 0
    assert summary["command_faults"]["expired"] >= 1


@BOTH
def test_the_pick_reaches_its_goal_grips_and_lifts(rig, interface, model, chain, tmp_path):
    """Slow as shipped; the goal is where the cell's file says, and the box is held by friction."""
    rig.serve("--box", *BOX_M)
    publisher = rig.publish(interface)
    controller = rig.start(
        "controller",
        *(CONTROLLER, "run", config_of(interface, tmp_path), "--model", model),
        *("--instance", rig.instance, "--until-done"),
    )
    assert controller.wait(120) == 0, rig.said("controller")
    seen = rig.seen()
    assert rig.end(publisher) == 0, rig.said("publisher")
    check_accepted(seen)
    check_slow(seen, chain)
    # The arm was at its goal while the fingers closed.
    lifted = int(np.argmax(seen["box"][:, 2] > BOX_M[2] + 0.002))
    assert lifted > 1000, "the box was lifted"
    frame = json.loads((ROOT / "config" / "scenes" / "cell_fr3.json").read_text())["frames"][0]
    distances, angles = errors(chain, frame, seen["q"][lifted - 1000 : lifted : 10])
    at_goal = (distances < 0.003) & (angles < np.radians(1.0))
    assert np.count_nonzero(at_goal) >= 5, (distances, angles)
    assert seen["box"][-1, 2] > BOX_M[2] + 0.1, "the box is held in the air"


def errors(chain, frame, q):
    """Distances [m] and angles [rad] of the tool from the goal of the skill."""
    goal = np.add(frame["position_m"], (0.0, 0.0, GRASP_M))
    # The tool points down, its fingers open along the object's x axis.
    demonstrated = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    rotation = rotation_from_quaternion(np.array(frame["quaternion_wxyz"])) @ demonstrated
    poses = [forward(chain, row) for row in q]
    cosines = [0.5 * (np.trace(rotation.T @ x[:3, :3]) - 1.0) for x in poses]
    distances = [np.linalg.norm(x[:3, 3] - goal) for x in poses]
    return np.array(distances), np.arccos(np.clip(cosines, -1.0, 1.0))


@BOTH
def test_a_command_that_is_too_fast_or_not_finite_brakes_without_a_reflex(rig, interface, chain):
    rig.serve()
    publisher = rig.publish(interface, "--gripper", "none")

    def spoil(command):
        command.torque[2] = float("nan")

    with Commander(rig) as commander:
        commander.move(0, 0.3, 0.5)
        commander.move(0, 0.3, 0.2, spoil)
        check_rests(rig)
        moved = rig.seen()["q"]
        assert moved[-1, 0] > moved[0, 0] + 0.03, "what is slow is obeyed"
        commander.move(0, 1.0, 0.8)
        check_rests(rig)
    seen = rig.seen()
    check_accepted(seen)
    assert np.abs(seen["dq"]).max() < 1.3 * SLOW_FRACTION * chain.velocity_max_rad_s[0]
    assert rig.end(publisher) == 0
    summary = json.loads((rig.folder / "publisher.json").read_text())
    assert summary["command_faults"]["not_finite"] > 0
    assert summary["slow_refusals"] >= 1
    assert "slow mode: lower" in rig.said("publisher")
    assert summary["reflexes"] == 0


@BOTH
def test_a_killed_controller_leaves_the_arm_at_rest(rig, interface, model, tmp_path):
    rig.serve()
    publisher = rig.publish(interface, "--gripper", "hand")
    config = config_of(interface, tmp_path)
    run = (CONTROLLER, "run", config, "--model", model, "--instance", rig.instance)
    controller = rig.start("controller", *run)
    wait_for("motion", lambda: np.abs(rig.seen()["dq"][-1]).max() > 0.1)
    controller.kill()
    check_rests(rig)
    check_accepted(rig.seen())
    assert rig.end(publisher) == 0, rig.said("publisher")


@BOTH
def test_franky_sim_as_it_is_installed_is_moved(rig, interface):
    rig.serve_as_installed()
    publisher = rig.publish(interface)
    with Commander(rig) as commander:
        before = commander.state().position[0]
        commander.move(0, 0.2, 1.0)
        assert commander.state().position[0] > before + 0.05
    assert rig.end(publisher) == 0, rig.said("publisher")
    assert json.loads((rig.folder / "publisher.json").read_text())["reflexes"] == 0


def test_a_simulator_that_is_gone_is_an_error(rig):
    rig.serve()
    publisher = rig.publish("torque")
    rig.server.kill()
    assert publisher.wait(60) == 2
    assert f"the connection to the arm at {rig.address} is lost" in rig.said("publisher")
    without = rig.begin("torque", name="again")
    assert without.wait(60) == 2
    assert "cannot be reached" in rig.said("again")


def test_a_reflex_is_published_and_ends_the_motion_until_it_is_confirmed(rig):
    rig.serve()
    publisher = rig.publish("torque")
    with Commander(rig) as commander:
        assert commander.state().safety_stop == 0
        rig.ask("reflex")
        wait_for("the stop", lambda: commander.state().safety_stop == 1)
        assert commander.state().robot_mode == RobotMode.PROTECTIVE_STOP
        before = commander.state().sequence
        commander.move(0, 0.3, 0.3)
        assert commander.state().sequence > before
        assert not rig.seen()["moves"][-1], "nothing moves the arm any more"
    rig.wait_said("publisher", "a reflex has ended the motion")
    assert rig.end(publisher) == 1
    refused = rig.begin("torque", name="refused")
    assert refused.wait(60) == 2
    assert "--recover confirms a reflex" in rig.said("refused")
    confirmed = rig.publish("torque", "--recover", name="confirmed")
    with Commander(rig) as commander:
        wait_for("no stop", lambda: commander.state().safety_stop == 0)
        commander.move(0, 0.2, 0.3)
    assert rig.seen()["moves"][-1]
    assert rig.end(confirmed) == 0
