"""The scripted expert."""

import numpy as np
import pytest

from sim_bridge.demonstrations import (
    continuous_quaternions,
    demonstrated_grasp,
    read_demonstration,
    write_demonstration,
)
from sim_bridge.errors import BridgeError
from sim_bridge.poses import pose
from sim_bridge.record import R_OE, record_one, tool_path


@pytest.fixture(scope="module")
def recording(scene):
    return record_one(scene, 0, 8, 1)


def test_the_same_seed_gives_the_same_file(scene, recording, tmp_path):
    again = record_one(scene, 0, 8, 1)
    write_demonstration(tmp_path / "a.json", recording.demonstration)
    write_demonstration(tmp_path / "b.json", again.demonstration)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert (tmp_path / "a.json").read_bytes() == (
        scene.task.demonstrations / "01.json"
    ).read_bytes(), "config/demonstrations is not what `sim-bridge record` writes"


def test_the_gripper_is_written_where_it_is_asked_for(scene, recording, tmp_path):
    assert recording.demonstration.gripper is None
    demonstration = record_one(scene, 0, 8, 1, gripper=True).demonstration
    count = len(demonstration.samples)
    assert demonstration.gripper == ["open"] * (count - 1) + ["closed"]
    before = len(recording.demonstration.samples)
    assert np.array_equal(demonstration.samples[:before], recording.demonstration.samples)
    file = tmp_path / "a.json"
    write_demonstration(file, demonstration)
    assert read_demonstration(file).gripper == demonstration.gripper
    text = file.read_text(encoding="utf-8")
    for wrong in (text.replace('"closed"', '"ajar"'), text.replace(', "closed"', "")):
        file.write_text(wrong, encoding="utf-8")
        with pytest.raises(BridgeError, match="gripper"):
            read_demonstration(file)


def test_a_demonstration_starts_and_ends_at_rest_pressed_on_the_box(scene, recording):
    demonstration = recording.demonstration
    speed = np.linalg.norm(np.diff(demonstration.samples[:, :3], axis=0), axis=1) / 0.02
    assert speed[0] < 0.005
    assert speed[-1] < 0.005
    assert np.min(speed[20:-60]) > 0.02, "no stop on the path"
    assert 3.0 <= recording.duration_s <= 4.0
    assert recording.compression_m == pytest.approx(scene.record.compression_m, abs=3e-4)
    assert recording.lifted_m >= scene.task.lift_height_m
    x_start = demonstration.frames["ee_start"]
    assert demonstration.samples[0, :3] == pytest.approx(x_start[:3, 3], abs=1e-12)


def test_the_end_of_the_path_is_vertical(recording):
    samples = recording.demonstration.samples
    end = samples[samples[:, 2] < samples[-1, 2] + 0.08]
    assert np.max(np.abs(end[:, :2] - samples[-1, :2])) < 5e-4


def test_all_demonstrations_show_one_grasp(scene):
    mean = demonstrated_grasp(scene.task.demonstrations, "object")
    assert mean[:3, :3] == pytest.approx(R_OE, abs=2e-3)
    files = sorted(scene.task.demonstrations.glob("*.json"))
    assert len(files) >= 6
    for file in files:
        demonstration = read_demonstration(file)
        assert demonstration.grasp("object") == pytest.approx(mean, abs=2e-3)
        assert len(demonstration.samples) <= 300
        assert np.linalg.norm(demonstration.samples[:, 3:], axis=1) == pytest.approx(1.0, abs=1e-5)


def test_the_path_joins_start_and_goal(scene):
    x_start = pose(R_OE, np.array([0.4, 0.3, 0.3]))
    x_goal = pose(R_OE, np.array([0.5, -0.3, 0.06]))
    assert tool_path(scene, x_start, x_goal, 0.8, 0.0) == pytest.approx(x_start)
    assert tool_path(scene, x_start, x_goal, 0.8, 1.0) == pytest.approx(x_goal)


def test_bad_demonstrations_are_refused(tmp_path):
    with pytest.raises(BridgeError, match="run `sim-bridge record`"):
        demonstrated_grasp(tmp_path, "object")
    file = tmp_path / "01.json"
    file.write_text('{"schema": "tprmp-demonstration/1"}', encoding="utf-8")
    with pytest.raises(BridgeError, match=r"01\.json: key 'columns' is missing"):
        read_demonstration(file)


def test_signs_of_quaternions_become_continuous():
    q = np.array([[1.0, 0, 0, 0], [-0.9, -0.1, 0, 0], [0.8, 0.2, 0, 0], [-0.7, -0.3, 0, 0]])
    fixed = continuous_quaternions(q)
    assert fixed == pytest.approx(np.abs(q))
