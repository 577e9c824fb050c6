"""The scene file is checked, and a seed always draws the same."""

import json
import os
from pathlib import Path

import pytest

from sim_bridge.errors import BridgeError
from sim_bridge.scene import draw_episode, load_scene


def load(tmp_path, values):
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(values), encoding="utf-8")
    return load_scene(file)


@pytest.mark.parametrize(
    ("section", "key", "value", "expected"),
    [
        ("physics", "rate_hz", "fast", "a number from 100 to 2000"),
        ("physics", "rate_hz", 10**400, "a number from 100 to 2000"),
        ("physics", "rate_hz", True, "a number from 100 to 2000"),
        ("object", "size_m", [0.1, 0.1], "three numbers above 0"),
        ("object", "size_m", [0.1, 0.1, 0.0], "three numbers above 0"),
        ("object", "mass_kg", 0, "a number above 0"),
        ("object", "yaw_rad", [1.0, -1.0], "low <= high"),
        ("sphere", "height_m", [0.1, 0.2], "a low end of at least 0.2177"),
        ("record", "count", 1.5, "a whole number of 1 or more"),
        ("task", "skill", "", "a name of 1 to 100 bytes"),
        ("task", "goal_frame", "x" * 25, "a name of 1 to 24 bytes"),
    ],
)
def test_a_bad_value_is_refused_by_file_key_and_expectation(
    tmp_path, scene_values, section, key, value, expected
):
    scene_values[section][key] = value
    with pytest.raises(BridgeError) as error:
        load(tmp_path, scene_values)
    assert f"scene.json: `{section}.{key}`: expected" in str(error.value)
    assert expected in str(error.value)


def test_a_missing_key_is_refused(tmp_path, scene_values):
    del scene_values["suction"]["seal_time_s"]
    with pytest.raises(BridgeError, match=r"scene\.json: `suction\.seal_time_s` is missing"):
        load(tmp_path, scene_values)


def test_an_unknown_key_is_refused(tmp_path, scene_values):
    scene_values["sphere"]["radius_mm"] = 60
    with pytest.raises(BridgeError, match=r"`sphere\.radius_mm`: expected no such key, found 60"):
        load(tmp_path, scene_values)


def test_a_file_that_is_no_json_is_refused(tmp_path):
    file = tmp_path / "scene.json"
    file.write_text("{", encoding="utf-8")
    with pytest.raises(BridgeError, match="is not JSON"):
        load_scene(file)
    with pytest.raises(BridgeError, match="cannot be read"):
        load_scene(tmp_path / "nothing.json")


def test_a_seed_draws_the_same_and_another_one_something_else(scene):
    assert draw_episode(scene, 7) == draw_episode(scene, 7)
    assert draw_episode(scene, 7) != draw_episode(scene, 8)


def test_draws_stay_in_their_ranges_and_the_sphere_above_the_object(scene):
    directions = set()
    for seed in range(200):
        episode = draw_episode(scene, seed)
        directions.add(episode.circle_speed_rad_s > 0.0)
        assert scene.object.yaw_rad.low <= episode.object_yaw_rad <= scene.object.yaw_rad.high
        object_top = episode.circle_centre_m[2] + 0.5 * scene.object.size_m[2]
        sphere_bottom = episode.sphere_centre_m[2] - scene.sphere.radius_m
        assert sphere_bottom - object_top >= 0.1 - 1e-12
    assert directions == {True, False}


@pytest.mark.parametrize("motion", ["object_motion", "sphere_motion"])
def test_velocities_are_the_derivatives_of_positions(scene, motion):
    h = 1e-6
    for seed in range(5):
        move = getattr(draw_episode(scene, seed), motion)
        for time in (0.0, 0.7, 12.3):
            before, now, after = move(time - h), move(time), move(time + h)
            for axis in range(3):
                difference = (after.position_m[axis] - before.position_m[axis]) / (2 * h)
                assert now.velocity_m_s[axis] == pytest.approx(difference, abs=1e-8)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"[" * 100_000, "nested deeper"),
        (b" " * (5 << 20), "at most 4194304 bytes"),
        (b'{"schema": "\xff"}', "UTF-8, found something else from byte 12 on"),
        (b"[" + b"9" * 10_000 + b"]", "is not JSON"),
    ],
)
def test_a_file_made_to_hurt_is_refused(tmp_path, content, expected):
    file = tmp_path / "scene.json"
    file.write_bytes(content)
    with pytest.raises(BridgeError, match=r"scene\.json") as error:
        load_scene(file)
    assert expected in str(error.value)


def test_devices_pipes_and_folders_are_no_scenes(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, expected in [
        (Path("/dev/zero"), "expected a file"),
        (tmp_path / "pipe", "expected a file"),
        (tmp_path, "directory"),
    ]:
        with pytest.raises(BridgeError) as error:
            load_scene(path)
        assert str(path) in str(error.value)
        assert expected in str(error.value)
