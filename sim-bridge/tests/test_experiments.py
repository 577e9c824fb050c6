"""Scenarios, what the watch sees, verdicts, and the other arms."""

import json
import math
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pybullet_data
import pytest

from sim_bridge.errors import BridgeError
from sim_bridge.experiments.episode import WatchedRun, cause, watched_pairs
from sim_bridge.experiments.page import page
from sim_bridge.experiments.scenarios import GOALS, Ball, arm_bones, draw, may_be
from sim_bridge.experiments.verdict import verdicts
from sim_bridge.fit import fit
from sim_bridge.kinematics import forward, load_chain
from sim_bridge.run import Options
from sim_bridge.scene import load_scene
from sim_bridge.world import World

ROOT = Path(__file__).resolve().parents[2]
ARMS = {
    "panda": tuple(f"panda_joint{k}" for k in range(1, 8)),
    "iiwa": tuple(f"lbr_iiwa_joint_{k}" for k in range(1, 8)),
}


@pytest.fixture(scope="module")
def chain():
    return load_chain(ROOT / "config" / "robots" / "ur5.urdf", "suction_tip")


def test_a_seed_draws_the_same_and_keeps_to_what_is_promised(scene, chain):
    drawn = [draw(scene, chain, "ur5", "pick", seed) for seed in range(60)]
    assert drawn == [draw(scene, chain, "ur5", "pick", seed) for seed in range(60)]
    bones = arm_bones(chain, scene.robot.home_position_rad)
    pushes = 0
    for scenario in drawn:
        ball = scenario.ball
        assert 0.04 <= ball.radius_m <= 0.10
        assert may_be(ball, bones)
        assert abs(scenario.object_yaw_rad) <= math.pi / 3
        assert scenario.circle_radius_m <= 0.15
        assert abs(scenario.circle_speed_rad_s) <= 0.3 * math.pi
        for push in scenario.pushes:
            pushes += 1
            assert np.linalg.norm(push.force_n) <= 40.0 + 1e-9
            assert push.duration_s == 0.2
        h = 1e-6
        for t in (0.3, 2.0, 7.0):
            before, after = (np.array(ball.at(t + s).position_m) for s in (-h, h))
            rate = (after - before) / (2 * h)
            assert rate == pytest.approx(ball.at(t).velocity_m_s, abs=1e-6)
    assert pushes >= len(drawn)
    assert {s.ball.motion for s in drawn} == {"crosses", "swings"}


def test_a_ball_on_the_arm_or_through_its_base_is_drawn_anew(chain, scene):
    bones = arm_bones(chain, scene.robot.home_position_rad)
    tool = tuple(bones[-1])
    assert not may_be(Ball("rests", 0.05, tool), bones)
    assert not may_be(Ball("crosses", 0.05, (1.0, 0.0, 0.2), (-0.2, 0.0, 0.0)), bones)
    assert may_be(Ball("crosses", 0.05, (0.8, 0.0, 0.2), (0.0, 0.2, 0.0)), bones)


def test_false_goals_come_and_go(scene, chain):
    kinds = {draw(scene, chain, "ur5", "adversarial", seed).kind for seed in range(12)}
    assert kinds == set(GOALS)
    jumping = draw(scene, chain, "ur5", "adversarial", GOALS.index("jumping by 1 m")).false_goal
    first, second = (np.array(place) for place in jumping.places_m)
    assert np.linalg.norm(second - first) == pytest.approx(1.0)
    assert jumping.at(jumping.from_s - 1e-3) is None
    assert jumping.at(jumping.from_s).position_m == jumping.places_m[0]
    assert jumping.at(jumping.from_s + 1.5 * jumping.change_s).position_m == jumping.places_m[1]
    assert jumping.at(jumping.until_s) is None


def watched(scene, chain, tmp_path, ball):
    scenario = replace(draw(scene, chain, "ur5", "pick", 0), ball=ball)
    scene = replace(scene, sphere=replace(scene.sphere, radius_m=ball.radius_m))
    world = World(scene, scenario)
    return WatchedRun(scene, Options(0, tmp_path, "watched", True, 1.0, 0, None), world)


def test_the_watch_sees_a_ball_that_touches_and_one_that_does_not(scene, chain, tmp_path):
    x, y, z = (float(v) for v in arm_bones(chain, scene.robot.home_position_rad)[-1])
    for away, touches in ((0.045, True), (0.08, False)):
        run = watched(scene, chain, tmp_path, Ball("rests", 0.05, (x, y, z - away)))
        run.publication.fill(1, [0.0] * 6)
        run.world.step(False)
        run.watch(0.5)
        assert ("suction_tool and obstacle" in run.contacts) == touches
        assert (run.clearance["obstacle"] < 0.0) == touches
        run.world.close()


def test_the_watch_sees_the_arm_fold_into_itself_and_into_the_table(scene, chain, tmp_path):
    run = watched(scene, chain, tmp_path, Ball("rests", 0.05, (0.0, 0.0, -5.0)))
    run.world.place_arm([0.0, -1.57, 3.1, 0.0, 0.0, 0.0])
    run.world.step(False)
    run.watch(0.5)
    assert any(" and table" not in what for what in run.contacts), run.contacts
    assert run.clearance["self"] < 0.0
    run.contacts.clear()
    run.world.place_arm([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    run.world.step(False)
    run.watch(0.5)
    assert any(what.endswith(" and table") for what in run.contacts), run.contacts
    run.world.close()


def row(**changes):
    values = {
        "experiment": "pick",
        "kind": "static",
        "robot": "ur5",
        "seed": 1,
        "settings": {"ball": {"radius_m": 0.05}, "pushes": [], "false_goal": None},
        "outcome": "lifted",
        "picked": True,
        "exact": True,
        "gripped_at_s": 3.0,
        "position_error_m": 0.001,
        "orientation_error_deg": 0.1,
        "contacts": {},
        "clearance_min_m": {"obstacle": 0.05, "table": 0.03, "self": 0.03},
        "limit_fractions": {"position": 0.6, "velocity": 0.5, "torque": 0.4},
        "reason": "none",
        "reasons": {"none": 0.0},
        "allocations": 0,
        "cause": None,
    }
    return {**values, **changes}


def test_a_failure_has_its_cause_and_spoils_its_verdict():
    assert cause(row()) is None
    assert all(verdict.holds for verdict in verdicts([row()]))
    spoilt = {
        "picked": [{"picked": False, "exact": False, "gripped_at_s": None, "reason": "blocked"}],
        "no contact": [{"contacts": {"forearm_link and obstacle": 1.5}}],
        "limit": [{"limit_fractions": {"position": 0.6, "velocity": 1.01, "torque": 0.4}}],
        "no heap": [{"allocations": 1}],
    }
    for must, (changes,) in spoilt.items():
        bad = row(**changes)
        failing = [verdict.must for verdict in verdicts([bad]) if not verdict.holds]
        assert len(failing) == 1
        assert must in failing[0]
        assert must == "no heap" or cause(bad) is not None
    silent = row(experiment="adversarial", kind="out of reach")
    assert not all(verdict.holds for verdict in verdicts([silent]))
    reported = row(experiment="adversarial", kind="out of reach", reasons={"unreachable": 2.0})
    assert all(verdict.holds for verdict in verdicts([reported]))


def test_the_page_holds_failures_and_pictures():
    bad = row(seed=77, cause="contact of forearm_link and obstacle at 1.5 s")
    trace = [
        (0.04 * k, 0.4, 0.3, 0.3, 0.5, -0.2, 0.03, 0, 0, -5, 0.5, -0.2, 0.03, 0.3, 0)
        for k in range(9)
    ]
    html = page([row(), bad], [trace, trace], verdicts([row(), bad]), quick=True)
    assert "77" in html
    assert "forearm_link and obstacle" in html
    assert html.count("<svg") >= 7
    assert "http" not in html.replace("http://www.w3.org", "")


@pytest.fixture(scope="module", params=ARMS)
def arm(request, tmp_path_factory):
    """Another arm than the UR5: its name and its description, fitted with the tool."""
    out = tmp_path_factory.mktemp("robots") / "arm.urdf"
    fit(fitting(request.param), out)
    return request.param, out


def fitting(name):
    return ROOT / "config" / "robots" / f"{name}_suction.json"


def test_an_arm_carries_the_tool_and_nothing_else(arm):
    name, urdf = arm
    assert load_chain(urdf, "suction_tip").joint_names == ARMS[name]
    links = [link.get("name") for link in ElementTree.parse(urdf).getroot().findall("link")]
    assert links[-2:] == ["suction_tool", "suction_tip"]
    taken_off = json.loads(fitting(name).read_text(encoding="utf-8"))["without_links"]
    assert not set(links) & set(taken_off)


def test_limits_of_the_fitting_take_the_place_of_the_descriptions(tmp_path):
    out = tmp_path / "arm.urdf"
    fit(fitting("iiwa"), out)
    chain = load_chain(out, "suction_tip")
    limits = json.loads(fitting("iiwa").read_text(encoding="utf-8"))["joint_limits"]
    for k, name in enumerate(chain.joint_names):
        assert chain.velocity_max_rad_s[k] == limits[name]["velocity_rad_s"]
        assert chain.effort_max_n_m[k] == limits[name]["effort_n_m"]
    package = Path(pybullet_data.getDataPath()) / "kuka_iiwa" / "model.urdf"
    own = load_chain(package, "lbr_iiwa_link_7")
    assert np.all(chain.velocity_max_rad_s < own.velocity_max_rad_s)
    assert np.array_equal(chain.position_max_rad, own.position_max_rad)


@pytest.mark.parametrize(
    ("arm_name", "found", "spoilt_by", "error"),
    [
        ("panda", '"panda_link8"', '"panda_link9"', r"flange_link.*panda_link9"),
        ("iiwa", '"lbr_iiwa_joint_7"', '"joint_7"', r"joint_limits.*joint_7"),
        ("iiwa", '"effort_n_m": 40.0', '"effort_n_m": -40.0', r"joint_limits.*positive"),
        ("iiwa", '"effort_n_m": 40.0', '"effort": 40.0', r"joint_limits.*effort_n_m"),
    ],
)
def test_a_spoilt_fitting_is_refused_by_name(tmp_path, arm_name, found, spoilt_by, error):
    spoilt = tmp_path / "fitting.json"
    text = fitting(arm_name).read_text(encoding="utf-8")
    urdf = (fitting(arm_name).parent / "ur5.urdf").resolve()
    text = text.replace('"ur5.urdf"', f'"{urdf}"').replace(found, spoilt_by)
    spoilt.write_text(text, encoding="utf-8")
    with pytest.raises(BridgeError, match=error):
        fit(spoilt, tmp_path / "out.urdf")


def corners(mesh):
    """Vertices of a mesh, Nx3."""
    if mesh.suffix == ".obj":
        lines = mesh.read_text(encoding="utf-8").splitlines()
        return np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    triangles = np.frombuffer(mesh.read_bytes(), triangle, offset=84)
    return triangles["corners"].reshape(-1, 3).astype(float)


def test_the_balls_of_an_arm_cover_the_hulls_of_its_meshes(arm):
    name, urdf = arm
    config = ROOT / "config" / "controllers" / "base" / f"{name}_suction.ron"
    pattern = r'link: "(\w+)", position_m: \(([^)]*)\), radius_m: ([\d.]+)'
    balls = {}
    for link, place, radius in re.findall(pattern, config.read_text(encoding="utf-8")):
        centre = np.array([float(part) for part in place.split(",")])
        balls.setdefault(link, []).append((centre, float(radius)))
    generator = np.random.default_rng(5)
    _, *links = ElementTree.parse(urdf).getroot().findall("link")
    meshes = {link.get("name"): link.find("collision/geometry/mesh") for link in links}
    meshes = {link: mesh.get("filename") for link, mesh in meshes.items() if mesh is not None}
    assert len(meshes) == 7
    for link, mesh in meshes.items():
        shape = corners(Path(mesh))
        chosen = shape[generator.integers(0, len(shape), (20000, 4))]
        inside = np.einsum("ij,ijk->ik", generator.dirichlet([0.4] * 4, 20000), chosen)
        points = np.vstack([shape, inside])
        depth = np.max([r - np.linalg.norm(points - c, axis=1) for c, r in balls[link]], axis=0)
        assert np.min(depth) > 0.0, f"{link}: {1e3 * np.min(depth):.1f} mm"


def test_the_scene_of_an_arm_has_the_tool_where_the_ur5_has_it(arm, scene):
    name, urdf = arm
    values = load_scene(ROOT / "config" / "scenes" / f"pick_{name}.json").robot
    own = forward(load_chain(urdf, "suction_tip"), np.array(values.home_position_rad))
    ur5 = load_chain(scene.robot.urdf, scene.robot.tip_link)
    other = forward(ur5, np.array(scene.robot.home_position_rad))
    assert own == pytest.approx(other, abs=1e-3)


def test_links_that_follow_each_other_are_not_watched(world):
    names = {**world.link_names, -1: "base"}
    pairs = {(names[a], names[b]) for a, b in watched_pairs(world)}
    assert ("forearm_link", "suction_tool") in pairs
    assert ("wrist_3_link", "suction_tool") not in pairs
    assert ("wrist_2_link", "wrist_3_link") not in pairs
