"""A recorded run that is published again."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sim_bridge.cli import main
from sim_bridge.errors import BridgeError
from sim_bridge.kinematics import load_chain
from sim_bridge.log import LogWriter, load, save
from sim_bridge.poses import angular_velocity
from sim_bridge.replay import Recording
from sim_bridge.scene import load_scene

ROOT = Path(__file__).parents[2]
SCENE = ROOT / "config" / "scenes" / "pick.json"
SECONDS, RATE_HZ = 2.0, 500.0


@pytest.fixture
def run(tmp_path):
    """A run of two seconds: the first joint swings, the box is turned, the ball passes."""
    scene = load_scene(SCENE)
    chain = load_chain(scene.robot.urdf, scene.robot.tip_link)
    writer = LogWriter(int(SECONDS * RATE_HZ) + 1, chain.joint_count)
    home = np.array(scene.robot.home_position_rad)
    for row in range(int(SECONDS * RATE_HZ)):
        t = row / RATE_HZ
        swing = np.zeros(chain.joint_count)
        swing[0] = 1.0
        writer.write(
            time_s=t,
            position_rad=home + 0.2 * np.sin(t) * swing,
            velocity_rad_s=0.2 * np.cos(t) * swing,
            torque_n_m=1.0,
            gravity_torque_n_m=0.5,
            object_position_m=(0.5, 0.1 * t, 0.05),
            object_quaternion_wxyz=(np.cos(0.25 * t), 0.0, 0.0, np.sin(0.25 * t)),
            sphere_position_m=(0.6, 0.0, 0.5 - 0.1 * t),
            gripper_state=1,
        )
        writer.next_row()
    save(tmp_path / "run", writer.finish(chain), {"scene": str(SCENE)}, force=False)
    return tmp_path / "run"


def test_frames_have_the_velocities_of_what_moved(run):
    log, _ = load(run)
    recording = Recording(log, load_scene(SCENE))
    assert recording.box_velocity[100] == pytest.approx([0.0, 0.1, 0.0], abs=1e-9)
    assert recording.ball_velocity[100] == pytest.approx([0.0, 0.0, -0.1], abs=1e-9)
    assert recording.box_rotation[100] == pytest.approx([0.0, 0.0, 0.5], abs=1e-4)
    assert recording.torque[100] == pytest.approx([0.5] * 6)


def test_an_angular_velocity_is_that_of_a_known_rotation():
    time_s = np.linspace(0.0, 1.0, 1001)
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    half = 0.5 * 0.8 * time_s[:, None]
    quaternions = np.hstack([np.cos(half), np.sin(half) * axis])
    assert angular_velocity(quaternions, time_s)[500] == pytest.approx(0.8 * axis, abs=1e-6)


def test_the_kit_passes_what_can_be_seen_without_a_motion(run, instance_name):
    bridge = [sys.executable, "-m", "sim_bridge", "replay", str(run), "--loop"]
    publisher = subprocess.Popen(
        [*bridge, "--instance", instance_name],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        said = publisher.stdout.readline()
        kit = [ROOT / "target/release/controller", "conformance"]
        kit += [ROOT / "config/controllers/ur5_pick.ron", "--instance", instance_name]
        result = subprocess.run([*kit, "--seconds", "1"], capture_output=True, text=True, cwd=ROOT)
    finally:
        publisher.send_signal(signal.SIGINT)
        publisher.communicate(timeout=60)
    assert "commands are not obeyed" in said
    assert result.returncode == 0, result.stdout + result.stderr
    assert publisher.returncode == 0


def test_what_is_no_run_is_refused(run, tmp_path, capsys):
    assert main(["replay", str(tmp_path / "none")]) == 2
    assert "log.npz" in capsys.readouterr().err
    bridge = json.loads((run / "bridge.json").read_text())
    (run / "bridge.json").write_text(json.dumps({**bridge, "scene": "gone.json"}))
    assert main(["replay", str(run)]) == 2
    assert "gone.json" in capsys.readouterr().err
    log, _ = load(run)
    with pytest.raises(BridgeError, match="two states"):
        Recording({key: column[:1] for key, column in log.items()}, load_scene(SCENE))
