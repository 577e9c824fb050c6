"""Picks on joints as real arms have them, by the built controller, and the report about them."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from sim_bridge.experiments.episode import cause
from sim_bridge.experiments.joints import (
    SHORT,
    Case,
    Programs,
    cases,
    controller_config,
    label,
    run_case,
)
from sim_bridge.experiments.page_joints import joints_part
from sim_bridge.experiments.verdict import verdicts
from sim_bridge.joints import Joints
from sim_bridge.kinematics import load_chain

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ROOT / "target" / "release"
CONFIG = ROOT / "config" / "controllers" / "ur5_pick.ron"

PICKED = {
    "frictionless": Case("torque", Joints()),
    "friction of 0.01 N m": Case("torque", Joints(friction=0.01)),
    "friction of a fifth, no rotors": Case("torque", Joints(friction_fraction=0.2)),
    "rotors": Case("torque", Joints(armature=0.3)),
    "unknown payload": Case("torque", Joints(payload_kg=2.0)),
    "all": Case("torque", Joints("torque", 1.0, 0.0, 1.0, 0.1, 2.0, 0.2)),
    "half of the friction is known": Case("wrong", Joints(friction=1.0, armature=0.1), 0.5),
    "pushed": Case("pushed", Joints(friction=1.0, armature=0.1), push_n=(0.0, -40.0, 0.0)),
    "position servo": Case("servo", Joints("position", 1.0, armature=0.1, servo_lag_s=0.1)),
    "velocity servo": Case("servo", Joints("velocity", 1.0, armature=0.1, servo_lag_s=0.1)),
}


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    for name in ("controller", "learner"):
        if not (PROGRAMS / name).exists():
            pytest.skip(f"{PROGRAMS / name} is not built: `make build` builds it")
    folder = tmp_path_factory.mktemp("joints")
    model, skill = folder / "pick.model.ron", ROOT / "config" / "skills" / "pick.ron"
    learner = [PROGRAMS / "learner", "train", skill, "--out", model]
    subprocess.run(learner, check=True, capture_output=True)
    return Programs(PROGRAMS / "controller", CONFIG, model, folder)


@pytest.fixture(scope="module")
def rows(programs):
    """A row of each case that ran."""
    return {}


@pytest.mark.parametrize("name", PICKED)
def test_the_box_is_picked_exactly_and_within_the_limits(programs, rows, scene, name):
    row = run_case(programs, scene.file, PICKED[name], 1)
    row["cause"] = cause(row)
    rows[name] = row
    assert row["cause"] is None
    assert row["exact"]
    assert row["allocations"] == 0
    assert row["gripped_at_s"] < 4.5


def test_a_lag_of_a_tenth_of_a_second_delays_the_grip_by_less_than_half_a_second(rows):
    if "velocity servo" not in rows:
        pytest.skip("the picks did not run")
    plain = rows["frictionless"]["gripped_at_s"]
    for name in ("position servo", "velocity servo"):
        assert rows[name]["gripped_at_s"] - plain < 0.5
    found = verdicts(list(rows.values()))
    assert all(verdict.holds for verdict in found)
    assert any("delays the grip" in verdict.must for verdict in found)
    part = joints_part(list(rows.values()))
    assert part.count("<tr>") == len(rows) + 1
    assert "position servo" in part
    assert "<polyline" in part


def test_every_case_is_another_and_the_first_ones_are_of_every_kind():
    every = cases()
    assert len({label(case) for case in every}) == len(every) > 250
    assert {case.kind for case in every[:SHORT]} == {case.kind for case in every}


def test_the_controller_is_told_of_the_joints_and_not_of_the_load(tmp_path):
    chain = load_chain(ROOT / "config" / "robots" / "ur5.urdf", "suction_tip")
    case = Case("torque", Joints("torque", 1.0, 0.1, 0.5, 0.2, 2.0, 0.2), 0.5)
    text = controller_config(CONFIG, tmp_path, "told", case, chain).read_text(encoding="utf-8")
    assert "rotor_inertia: [0.2, 0.2" in text
    assert "coulomb_friction: [8.0, 8.0, 8.0, 1.9" in text
    assert "viscous_friction: [0.5, " in text
    servo = replace(case, joints=Joints("velocity", servo_lag_s=0.1))
    text = controller_config(CONFIG, tmp_path, "servo", servo, chain).read_text(encoding="utf-8")
    assert "actuators: VelocityServo((lag_s: 0.1," in text
    assert "rotor_inertia" not in text
