"""The chain's kinematics against pybullet and against finite differences."""

import random

import numpy as np
import pytest

from sim_bridge.errors import BridgeError
from sim_bridge.kinematics import forward, inverse_kinematics, jacobian, load_chain
from sim_bridge.poses import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    vector_from_rotation,
)


def configurations(chain, count):
    generator = random.Random(0)
    for _ in range(count):
        yield np.array([generator.uniform(-3.0, 3.0) for _ in range(chain.joint_count)])


def test_forward_agrees_with_pybullet(world):
    links = {name: index for index, name in world.link_names.items()}
    for q in configurations(world.chain, 20):
        world.place_arm(q)
        state = world.client.getLinkState(
            world.arm, links["suction_tip"], computeForwardKinematics=True
        )
        x, y, z, w = state[5]
        x_be = forward(world.chain, q)
        # pybullet computes link poses in single precision.
        assert x_be[:3, 3] == pytest.approx(np.array(state[4]), abs=2e-6)
        assert x_be[:3, :3] == pytest.approx(rotation_from_quaternion([w, x, y, z]), abs=2e-6)


def test_many_configurations_at_once_give_the_same(world):
    q = np.array(list(configurations(world.chain, 5)))
    assert forward(world.chain, q) == pytest.approx(
        np.array([forward(world.chain, row) for row in q]), abs=1e-14
    )


def test_jacobian_is_the_derivative_of_forward(world):
    h = 1e-6
    for q in configurations(world.chain, 5):
        j = jacobian(world.chain, q)
        for i in range(world.chain.joint_count):
            step = np.eye(world.chain.joint_count)[i] * h
            after, before = forward(world.chain, q + step), forward(world.chain, q - step)
            linear = (after[:3, 3] - before[:3, 3]) / (2 * h)
            angular = vector_from_rotation(after[:3, :3] @ before[:3, :3].T) / (2 * h)
            assert j[:, i] == pytest.approx(np.concatenate([linear, angular]), abs=1e-8)


def test_inverse_kinematics_comes_back(world):
    q = world.home + 0.1
    x_be = forward(world.chain, q)
    found = inverse_kinematics(world.chain, x_be, world.home)
    assert forward(world.chain, found) == pytest.approx(x_be, abs=1e-9)


def test_a_pose_out_of_reach_is_refused(world):
    x_be = forward(world.chain, world.home)
    x_be[:3, 3] = [2.0, 0.0, 0.5]
    with pytest.raises(BridgeError, match=r"cannot reach the pose at \(2\.000, 0\.000, 0\.500\)"):
        inverse_kinematics(world.chain, x_be, world.home)


def test_home_points_straight_down(world):
    assert forward(world.chain, world.home)[:3, 2] == pytest.approx([0.0, 0.0, -1.0], abs=1e-4)


def test_a_link_that_is_not_there_is_refused(scene):
    with pytest.raises(BridgeError, match="expected a link `hand`"):
        load_chain(scene.robot.urdf, "hand")


def test_logarithm_and_quaternion_invert_the_exponential():
    generator = random.Random(1)
    for angle in (0.0, 1e-9, 0.3, 2.0, 3.14159):
        axis = np.array([generator.gauss(0.0, 1.0) for _ in range(3)])
        vector = angle * axis / np.linalg.norm(axis)
        rotation = rotation_from_vector(vector)
        assert vector_from_rotation(rotation) == pytest.approx(vector, abs=1e-8)
        quaternion = quaternion_from_rotation(rotation)
        assert rotation_from_quaternion(quaternion) == pytest.approx(rotation, abs=1e-12)
