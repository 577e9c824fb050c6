"""What the physics does: torques, brake, kinematic bodies, suction."""

import math

import numpy as np
import pytest

from sim_bridge.kinematics import inverse_kinematics
from sim_bridge.messages import GripperState
from sim_bridge.poses import pose, rotation_z
from sim_bridge.record import R_OE
from sim_bridge.scene import Episode, draw_episode
from sim_bridge.world import World


@pytest.fixture
def resting(scene):
    """A world whose box rests in reach, without a sphere."""
    height = scene.object.table_gap_m + 0.5 * scene.object.size_m[2]
    episode = Episode(0, (0.5, -0.25, height), 0.0, 0.0, 0.0, 0.3, (0, 0, 0), 0.0, 0.0, 0.0)
    world = World(scene, episode, with_sphere=False)
    world.moving = True
    yield world
    world.close()


def put_cup(world, gap_m, beside_m=0.0, tilt_rad=0.0):
    """Puts the tip at rest `gap_m` above the middle of the box's top face."""
    position, _, _, _ = world.object_motion()
    x_bo = pose(rotation_z(world.episode.object_yaw_rad), position)
    c, s = math.cos(tilt_rad), math.sin(tilt_rad)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    top = 0.5 * world.scene.object.size_m[2]
    x_be = x_bo @ pose(tilt @ R_OE, np.array([0.0, beside_m, top + gap_m]))
    world.place_arm(inverse_kinematics(world.chain, x_be, world.home))


def hold(world, seconds, vacuum):
    """Holds the arm where it is by computed torque."""
    goal = np.array(world.joint_state()[0])
    for _ in range(round(seconds / world.dt_s)):
        q, qd = map(np.array, world.joint_state())
        qdd = 3600.0 * (goal - q) - 120.0 * qd
        world.apply_torque(world.inverse_dynamics(q.tolist(), qd.tolist(), qdd.tolist()))
        world.step(vacuum)


def test_contact_with_vacuum_seals_after_the_seal_time(resting):
    put_cup(resting, -0.001)
    hold(resting, 0.016, vacuum=True)
    assert resting.gripper == GripperState.OPEN
    hold(resting, 0.010, vacuum=True)
    assert resting.gripper == GripperState.HOLDING


def test_contact_without_vacuum_does_not_seal(resting):
    put_cup(resting, -0.001)
    hold(resting, 0.1, vacuum=False)
    assert resting.cup_touches()
    assert resting.gripper == GripperState.OPEN


@pytest.mark.parametrize("gap_m", [0.0003, 0.002])
def test_vacuum_without_contact_does_not_seal(resting, gap_m):
    put_cup(resting, gap_m)
    hold(resting, 0.2, vacuum=True)
    assert not resting.cup_touches()
    assert resting.gripper == GripperState.OPEN


def test_a_cup_over_the_edge_or_tilted_does_not_seal(resting):
    put_cup(resting, -0.001, beside_m=0.04)
    hold(resting, 0.1, vacuum=True)
    assert resting.gripper == GripperState.OPEN
    put_cup(resting, 0.0, tilt_rad=0.3)
    hold(resting, 0.1, vacuum=True)
    assert resting.gripper == GripperState.OPEN


def test_a_gripped_box_hangs_on_and_falls_when_the_vacuum_goes_off(resting):
    put_cup(resting, -0.001)
    hold(resting, 0.05, vacuum=True)
    q = np.array(resting.joint_state()[0])
    x_be = resting.tool_pose()
    before = resting.object_motion()[0]
    for _ in range(300):
        x_be[2, 3] += 0.1 / 300
        q = inverse_kinematics(resting.chain, x_be, q)
        position, velocity = map(np.array, resting.joint_state())
        qdd = (3600.0 * (q - position) - 120.0 * velocity).tolist()
        torque = resting.inverse_dynamics(position.tolist(), velocity.tolist(), qdd)
        resting.apply_torque(torque)
        resting.step(True)
    assert resting.object_motion()[0][2] - before[2] == pytest.approx(0.1, abs=0.01)
    hold(resting, 0.5, vacuum=False)
    assert resting.gripper == GripperState.OPEN
    assert resting.object_motion()[0][2] == pytest.approx(before[2], abs=0.01)


def test_torques_are_clamped_to_the_efforts(world):
    effort = world.chain.effort_max_n_m
    assert world.apply_torque((10.0 * effort).tolist()) == effort.tolist()
    assert world.apply_torque((-10.0 * effort).tolist()) == (-effort).tolist()
    assert world.apply_torque([1.0] * 6) == [1.0] * 6


def test_gravity_torque_holds_the_arm(world):
    for _ in range(500):
        world.apply_torque(world.gravity_torque(world.joint_state()[0]))
        world.step(False)
    assert max(map(abs, world.joint_state()[1])) < 5e-3


def test_the_brake_stops_a_moving_arm(world):
    for joint, position in zip(world.joints, world.home):
        world.client.resetJointState(world.arm, joint, position, 0.5)
    for _ in range(100):
        world.brake()
        world.step(False)
    assert max(map(abs, world.joint_state()[1])) < 5e-3


def test_torque_works_again_after_a_brake(world):
    world.brake()
    world.step(False)
    q, qd = world.joint_state()
    world.apply_torque(world.inverse_dynamics(q, qd, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    world.step(False)
    assert world.joint_state()[1][0] - qd[0] == pytest.approx(world.dt_s, rel=0.01)


def test_published_velocity_is_the_difference_of_published_positions(world):
    published = []
    for _ in range(200):
        world.brake()
        position, _, velocity, _ = world.object_motion()
        sphere = world.sphere_motion()
        published.append((position, velocity, np.array(sphere.position_m), sphere.velocity_m_s))
        world.step(False)
    for before, now, after in zip(published, published[1:], published[2:]):
        for position, velocity in ((0, 1), (2, 3)):
            difference = (after[position] - before[position]) / (2.0 * world.dt_s)
            assert np.array(now[velocity]) == pytest.approx(difference, abs=1e-5)


def test_bodies_stand_still_with_the_clock(scene):
    world = World(scene, draw_episode(scene, 0))
    before = world.object_motion()
    world.brake()
    world.step(False)
    assert world.time_s == 0.0
    assert world.object_motion()[0] == pytest.approx(before[0])
    assert world.object_motion()[2] == pytest.approx(np.zeros(3))
    assert world.sphere_motion().velocity_m_s == (0.0, 0.0, 0.0)
    world.close()
