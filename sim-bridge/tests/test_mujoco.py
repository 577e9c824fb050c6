"""The world in MuJoCo: its arm against pybullet's, its joints, its servos and its suction."""

import numpy as np
import pytest

from sim_bridge.cli import main
from sim_bridge.errors import BridgeError
from sim_bridge.joints import Joints
from sim_bridge.kinematics import inverse_kinematics
from sim_bridge.messages import GripperState, JointCommand
from sim_bridge.mujoco_world import MujocoWorld
from sim_bridge.poses import pose, rotation_z
from sim_bridge.record import R_OE
from sim_bridge.scene import draw_episode


def mujoco_world(scene, **joints):
    world = MujocoWorld(scene, draw_episode(scene, 0), Joints(**joints))
    world.moving = True
    return world


def hold(world, extra=(0.0,) * 6, vacuum=False):
    """One step, held against gravity, with a torque beside it."""
    world.apply_torque(np.add(world.gravity_torque(world.joint_state()[0]), extra))
    world.step(vacuum)


def test_the_arm_weighs_and_moves_as_in_pybullet(scene, world):
    other = mujoco_world(scene)
    q = (world.home + 0.1).tolist()
    np.testing.assert_allclose(other.gravity_torque(q), world.gravity_torque(q), atol=1e-9)
    torque = np.add(world.gravity_torque(world.home), [3.0, -2.0, 1.0, 0.2, 0.1, 0.001])
    for _ in range(50):
        for one in (world, other):
            one.apply_torque(torque)
            one.step(vacuum=False)
    for mine, theirs in zip(other.joint_state(), world.joint_state()):
        np.testing.assert_allclose(mine, theirs, atol=5e-3)


def test_mass_error_and_payload_weigh(scene):
    q = mujoco_world(scene).home.tolist()
    bare = np.array(mujoco_world(scene).gravity_torque(q))
    heavy = mujoco_world(scene, mass_error=0.2).gravity_torque(q)
    np.testing.assert_allclose(heavy, 1.2 * bare, atol=1e-9)
    loaded = mujoco_world(scene, payload_kg=2.0).gravity_torque(q)
    assert loaded[1] - bare[1] < -5.0


def test_friction_holds_what_pushes_less(scene):
    world = mujoco_world(scene, friction=1.0)
    extra = (0.0, 0.0, 0.0, 0.0, 0.0, 0.5)
    for _ in range(100):
        hold(world, extra)
    q, qd = (np.array(values) for values in world.joint_state())
    assert np.max(np.abs(q - world.home)) < 1e-3
    assert np.max(np.abs(qd)) < 1e-3


def test_rotors_and_viscous_friction_slow_down(scene):
    torque = 0.1
    world = mujoco_world(scene, armature=0.1, viscous=1.0)
    for _ in range(500):
        hold(world, (0.0, 0.0, 0.0, 0.0, 0.0, torque))
    # J q̈ + b q̇ = τ
    expected = torque * (1.0 - np.exp(-1.0 / 0.1))
    assert world.joint_state()[1][5] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("interface", ["position", "velocity"])
def test_a_servo_lags_by_its_time(scene, interface):
    world = mujoco_world(scene, interface=interface, servo_lag_s=0.1, friction=1.0, armature=0.1)
    command, speed = JointCommand(joint_count=6), 0.2
    for step in range(400):
        command.position[:6] = (world.home + speed * world.dt_s * step).tolist()
        command.velocity[:6] = [speed] * 6
        world.obey(command)
        world.step(vacuum=False)
    behind = np.array(command.position[:6]) - world.joint_state()[0]
    # Friction takes a velocity servo some of its speed.
    np.testing.assert_allclose(behind, 0.1 * speed, atol=4e-3)


def test_the_brake_stops_and_lets_go(scene):
    world = mujoco_world(scene)
    world.data.qvel[:6] = 0.3
    for _ in range(50):
        world.brake()
        world.step(vacuum=False)
    assert np.max(np.abs(world.joint_state()[1])) < 1e-3
    hold(world, (5.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert world.joint_state()[1][0] > 5e-3


def test_the_cup_seals_on_contact_and_carries(scene):
    world = mujoco_world(scene)
    world.moving = False
    position, _, _, _ = world.object_motion()
    x_bo = pose(rotation_z(world.episode.object_yaw_rad), position)
    x_be = x_bo @ pose(R_OE, np.array([0.0, 0.0, 0.5 * scene.object.size_m[2] - 0.001]))
    q = inverse_kinematics(world.chain, x_be, world.home)
    world.place_arm(q)
    for _ in range(30):
        world.brake()
        world.step(vacuum=True)
    assert world.gripper == GripperState.HOLDING
    before = world.object_motion()[0]
    for _ in range(100):
        hold(world, (0.0, -5.0, 0.0, 0.0, 0.0, 0.0), vacuum=True)
    tip = np.linalg.inv(world.tool_pose()) @ np.append(world.object_motion()[0], 1.0)
    assert world.object_motion()[0][2] > before[2] + 0.002
    np.testing.assert_allclose(
        tip[:3], (np.linalg.inv(x_be) @ np.append(before, 1.0))[:3], atol=2e-3
    )
    world.brake()
    world.step(vacuum=False)
    assert world.gripper == GripperState.OPEN


def test_values_outside_their_ranges_are_refused():
    for values, option in (
        ({"friction": -1.0}, "--friction"),
        ({"mass_error": -1.0}, "--mass-error"),
        ({"interface": "force"}, "--interface"),
        ({"servo_lag_s": 0.1}, "--servo-lag-s"),
        ({"payload_kg": float("nan")}, "--payload-kg"),
    ):
        with pytest.raises(BridgeError, match=option):
            Joints(**values).check()


def test_joints_need_mujoco(scene, tmp_path, capsys):
    arguments = ["run", "--scene", str(scene.file), "--seed", "1", "--out", str(tmp_path)]
    assert main([*arguments, "--friction", "1"]) == 2
    assert "--friction needs --simulator mujoco" in capsys.readouterr().err
