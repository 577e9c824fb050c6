"""The report of a run: its files, what it calls a failure, and what it says about bad files."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sim_bridge import cli
from sim_bridge.demonstrations import demonstrated_grasp
from sim_bridge.errors import BridgeError
from sim_bridge.kinematics import forward, inverse_kinematics, load_chain
from sim_bridge.log import LogWriter, load, save
from sim_bridge.poses import inverse, pose, quaternion_from_rotation, rotation_z
from sim_bridge.report import report
from sim_bridge.report.figures import failures, load_run, result, table
from sim_bridge.report.report import Detail, moments

APPROACH_ROWS, LIFT_ROWS, HOLD_ROWS = 120, 60, 260
OFFSET_M, ROTATION_RAD = 0.002, 0.01
SMALL = Detail(width=80, height=60, frames=4, stills=6, picture_stills=4)
KEYS = {
    "success",
    "seed",
    "position_error_mm",
    "orientation_error_deg",
    "clearance_min_mm",
    "clearance_mm",
    "limit_fraction_max",
    "limit_fractions",
    "tick_us",
    "state_age_us",
    "ticks",
    "deadline_misses",
    "allocations",
    "real_time_factor",
    "command_faults",
}


def _log(scene):
    """A straight path to the box and up again: grasped 2 mm and 0.01 rad beside the grasp."""
    chain = load_chain(scene.robot.urdf, scene.robot.tip_link)
    grasp = demonstrated_grasp(scene.task.demonstrations, scene.task.goal_frame)
    x_bo = pose(rotation_z(0.4), np.array([0.5, -0.25, 0.03]))
    off = pose(rotation_z(ROTATION_RAD), np.array([OFFSET_M, 0.0, 0.0]))
    x_grip = x_bo @ grasp @ off
    q = np.array(scene.robot.home_position_rad)
    x_start = forward(chain, q)
    path = [
        *(
            (x_start[:3, 3] + s * (x_grip - x_start)[:3, 3])
            for s in np.linspace(0, 1, APPROACH_ROWS)
        ),
        *(x_grip[:3, 3] + [0.0, 0.0, 0.12 * s] for s in np.linspace(0, 1, LIFT_ROWS)),
        *[x_grip[:3, 3] + [0.0, 0.0, 0.12]] * HOLD_ROWS,
    ]
    log = LogWriter(len(path) + 1, chain.joint_count)
    for row, position in enumerate(path):
        x_be = pose(x_grip[:3, :3], position)
        q = inverse_kinematics(chain, x_be, q)
        holding = row >= APPROACH_ROWS
        x_box = x_be @ inverse(x_grip) @ x_bo if holding else x_bo
        log.write(
            time_s=row / scene.physics.rate_hz,
            position_rad=q,
            velocity_rad_s=np.full(chain.joint_count, 0.1),
            object_position_m=x_box[:3, 3],
            object_quaternion_wxyz=quaternion_from_rotation(x_box[:3, :3]),
            sphere_position_m=(0.5, 0.5, 0.25),
            gripper_state=2 if holding else 1,
            lateness_s=0.0,
        )
        if row:  # Braked in the first row.
            log.write(torque_n_m=0.5 * chain.effort_max_n_m, gravity_torque_n_m=np.zeros(6))
        log.next_row()
    return log.finish(chain)


def _controller():
    times = {"p50": 20.0, "p99": 40.0, "p999": 50.0, "max": 60.0}
    buckets = [[2.0 ** (4.0 + k / 8.0), 1 + k] for k in range(9)]
    names = ("tick_us", "wake_up_us", "state_age_us")
    return {
        "life_cycle": "Done",
        "ticks": 1000,
        "deadline_misses": 3,
        "allocations": 0,
        **dict.fromkeys(names, times),
        "ticks_by_reason": {"None": 1000},
        "histograms": dict.fromkeys(names, buckets),
    }


def _bridge(scene):
    return {
        "scene": str(scene.file),
        "seed": 5,
        "mode": "real time",
        "outcome": "lifted",
        "timing": {"real_time_factor": 0.998, "slips": 1, "braked_steps": 1, "clamped_steps": 0},
    }


@pytest.fixture(scope="module")
def recorded(scene, tmp_path_factory) -> Path:
    """A folder as `run` and the controller leave it; not to be changed."""
    folder = tmp_path_factory.mktemp("recorded")
    save(folder, _log(scene), _bridge(scene), force=False)
    (folder / "controller.json").write_text(json.dumps(_controller()))
    return folder


@pytest.fixture
def folder(recorded, tmp_path) -> Path:
    """A copy of it."""
    copy = tmp_path / "run"
    shutil.copytree(recorded, copy)
    return copy


def _spoil(folder, name, value):
    """Changes an array (of the log) or a value (of either summary) by its name."""
    log, bridge = load(folder)
    controller = json.loads((folder / "controller.json").read_text())
    if name in log:
        log[name] = value(log[name].copy())
    elif name in controller:
        controller[name] = value
    elif name in bridge["timing"]:
        bridge["timing"][name] = value
    else:
        bridge[name] = value
    bridge.pop("schema")
    save(folder, log, bridge, force=True)
    (folder / "controller.json").write_text(json.dumps(controller))


def test_all_files_are_written(folder, capsys):
    assert report.report(folder, SMALL) == 0
    values = json.loads((folder / "result.json").read_text())
    assert set(values) == KEYS
    assert values["success"] is True
    assert values["seed"] == 5
    assert values["ticks"] == 1000
    assert values["deadline_misses"] == 3
    assert values["tick_us"] == {"p50": 20.0, "p99": 40.0, "max": 60.0}
    assert values["state_age_us"]["max"] == 60.0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 7
    assert page.count("data:image/gif;base64,") == 1
    # Self-contained: nothing is fetched from elsewhere.
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "http" not in re.sub(r"base64,[^\"]*", "", page)
    assert len(page) < 6_000_000
    assert (folder / "demo.png").stat().st_size <= 300_000
    with Image.open(folder / "demo.png") as picture:
        assert picture.width == 3 * SMALL.width + 2 * 6
    captured = capsys.readouterr()
    assert "Position error at the grip" in captured.out
    assert "3 of 1000" in captured.out
    assert "rendering" in captured.err


def test_commands_with_a_fault_are_counted_by_cause(folder):
    assert "Commands with a fault" not in [row[0] for row in table_of(folder)]
    bridge = json.loads((folder / "bridge.json").read_text())
    bridge["command_faults"] = {"expired": 2, "not_finite": 1}
    (folder / "bridge.json").write_text(json.dumps(bridge))
    row = ("Commands with a fault", "3", "2 expired, 1 not_finite")
    assert table_of(folder)[-1] == row


def table_of(folder):
    run = load_run(folder)
    return table(run, result(run))


def test_figures_are_those_of_the_log(recorded):
    run = load_run(recorded)
    values = result(run)
    assert values["position_error_mm"] == pytest.approx(1e3 * OFFSET_M, abs=1e-3)
    assert values["orientation_error_deg"] == pytest.approx(np.degrees(ROTATION_RAD), abs=1e-4)
    assert values["limit_fractions"]["torque"] == pytest.approx(0.5)
    assert values["limit_fraction_max"] == max(values["limit_fractions"].values())
    assert values["clearance_min_mm"] == min(values["clearance_mm"].values()) > 0.0
    # Over all rows here, at the grip in `evaluate`.
    before = run.gripped_row - 1
    assert 1e3 * run.position_error_m[before] == pytest.approx(
        values["position_error_mm"], abs=1e-6
    )
    angle_deg = np.degrees(run.orientation_error_rad[before])
    assert angle_deg == pytest.approx(values["orientation_error_deg"], abs=1e-6)


def test_moments_hold_start_grip_and_end(recorded):
    run = load_run(recorded)
    last = len(run.log["time_s"]) - 1
    eight, six = moments(run, 8), moments(run, 6)
    assert len(eight) == 8
    assert set(six) <= set(eight)
    assert list(eight) == sorted(eight)
    assert {eight[0], eight[run.gripped_row], eight[last]} == {"start", "gripped", "end"}


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("gripper_state", lambda column: 0 * column + 1, "The box was not gripped."),
        ("object_position_m", lambda column: 0 * column + 0.03, "The box was lifted by 0 mm"),
        ("sphere_position_m", lambda column: 0 * column + [0.5, -0.25, 0.2], "touched the sphere"),
        ("contact_sphere", lambda column: column + 1, "touched the sphere"),
        ("velocity_rad_s", lambda column: 40 * column, "A joint velocity went to 127 %"),
        ("torque_n_m", lambda column: 3 * column, "A joint torque went to 150 %"),
        ("clamped_steps", 4, "asked for more than the torque limit in 4 steps"),
        ("outcome", "timeout", 'ended with the outcome "timeout"'),
        ("allocations", 2, "allocated memory on the heap 2 times"),
    ],
)
def test_a_failure_has_a_sentence(folder, name, value, sentence):
    _spoil(folder, name, value)
    run = load_run(folder)
    assert any(sentence in found for found in failures(run)), failures(run)
    assert result(run)["success"] is False
    assert result(run)["failures"] == failures(run)


def test_a_missing_summary_is_a_failure_with_exit_code_1(folder, capsys, monkeypatch):
    (folder / "controller.json").unlink()
    monkeypatch.setattr(report, "Detail", lambda: SMALL)
    assert cli.main(["report", str(folder)]) == 1
    values = json.loads((folder / "result.json").read_text())
    assert values["success"] is False
    assert values["ticks"] is None
    assert "controller.json is missing" in values["failures"][0]
    assert "failed: The controller left no summary" in capsys.readouterr().out
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "What failed" in page
    assert page.count("data:image/png;base64,") == 6


def test_a_run_without_a_grip_is_drawn(folder):
    _spoil(folder, "gripper_state", lambda column: 0 * column + 1)
    _spoil(folder, "torque_n_m", lambda column: np.nan * column)
    _spoil(folder, "histograms", {"tick_us": [], "wake_up_us": [], "state_age_us": []})
    assert report.report(folder, SMALL) == 1
    assert json.loads((folder / "result.json").read_text())["position_error_mm"] is None
    assert (folder / "report.html").exists()


def test_no_log_is_an_error(tmp_path, capsys):
    assert cli.main(["report", str(tmp_path)]) == 2
    assert "expected log.npz and bridge.json" in capsys.readouterr().err


@pytest.mark.parametrize("kept", [0.0, 0.01, 0.5, 0.99])
def test_a_truncated_log_is_an_error(folder, kept):
    file = folder / "log.npz"
    content = file.read_bytes()
    file.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(BridgeError, match=r"log\.npz"):
        load_run(folder)


def test_a_corrupted_log_is_an_error(folder):
    file = folder / "log.npz"
    content = bytearray(file.read_bytes())
    for position in range(300, len(content) - 2000, 97):
        content[position] ^= 0xFF
    file.write_bytes(content)
    with pytest.raises(BridgeError, match=r"log\.npz"):
        load_run(folder)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("tool_position_m", lambda column: column[:-3], "`tool_position_m`: expected the shape"),
        ("position_rad", lambda column: column * np.nan, "`position_rad`: expected finite numbers"),
        ("scene", "nowhere.json", "start the report in the folder"),
        ("seed", "five", "`seed`: expected int"),
        ("ticks", "many", "`ticks`: expected a whole number"),
        ("histograms", {"tick_us": [[1.0]]}, r"`histograms\.tick_us`: expected a list"),
        ("histograms", 3, r"`histograms\.tick_us`: expected a list"),
        ("real_time_factor", None, r"`timing\.real_time_factor`: expected a number"),
        ("tick_us", {"p50": 1.0}, r"`tick_us\.p99`: expected a number"),
    ],
)
def test_wrong_contents_are_named(folder, name, value, message):
    _spoil(folder, name, value)
    with pytest.raises(BridgeError, match=message):
        load_run(folder)


def test_an_empty_log_is_an_error(folder):
    log, bridge = load(folder)
    bridge.pop("schema")
    save(folder, {key: column[:0] for key, column in log.items()}, bridge, force=True)
    with pytest.raises(BridgeError, match="expected at least 2 rows, found 0"):
        load_run(folder)
