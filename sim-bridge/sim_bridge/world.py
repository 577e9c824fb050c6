"""The simulated world: arm, table, box, sphere and suction in pybullet, one step at a time.

The world frame of pybullet is the robot's base frame B. The box and the sphere are moved
kinematically: their poses and velocities are set before every step, so that what is published is
exact. The box becomes free when the suction cup has sealed on it.

pybullet clears torques at every step, does not clamp them to the efforts of the description, and
ends the process when `calculateInverseDynamics` is handed numpy arrays: lists only.
"""

from __future__ import annotations

import ctypes
import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from sim_bridge.errors import BridgeError
from sim_bridge.kinematics import Chain, forward, load_chain
from sim_bridge.messages import GripperState, JointCommand
from sim_bridge.poses import Array, quaternion_from_rotation, rotation_from_quaternion, rotation_z
from sim_bridge.scene import Episode, Motion, Scene


@contextmanager
def quiet(descriptor: int) -> Iterator[None]:
    """Keeps what pybullet's C code prints while it loads off the terminal."""
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)
    saved, sink = os.dup(descriptor), os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, descriptor)
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)
        os.dup2(saved, descriptor)
        os.close(saved)
        os.close(sink)


# It prints the time it was built on standard error when it is imported.
with quiet(2):
    import pybullet
    from pybullet_utils.bullet_client import BulletClient

FACE_TOLERANCE_M = 0.003
"""How far below the top face, or above the rim of the cup, a contact point may lie."""


class World:
    """One episode in pybullet.

    `moving` is `False` while the scenario's clock stands still: then box and sphere rest at where
    they are at time 0, and their velocities are zero.
    """

    def __init__(self, scene: Scene, episode: Episode, *, with_sphere: bool = True) -> None:
        self.scene, self.episode = scene, episode
        self.dt_s = 1.0 / scene.physics.rate_hz
        self.steps = 0
        self.moving = False
        self.chain: Chain = load_chain(scene.robot.urdf, scene.robot.tip_link)
        self.home = np.array(scene.robot.home_position_rad)
        if len(self.home) != self.chain.joint_count:
            raise BridgeError(
                f"{scene.file}: `robot.home_position_rad`: expected {self.chain.joint_count} "
                f"numbers, found {len(self.home)}"
            )
        self.effort_max = self.chain.effort_max_n_m
        self.gripper = GripperState.OPEN
        self.sealed_at_step: int | None = None
        self._contact_steps = 0
        self._constraint: int | None = None
        self._free = False
        self._braked: bool | None = None
        with quiet(1):
            self.client = BulletClient(connection_mode=pybullet.DIRECT)
            self._load_arm()
            self._load_bodies(with_sphere)
        self.place_arm(self.home)
        self._place_bodies()

    @contextmanager
    def geometry(self) -> Iterator[World]:
        """The world in which distances are measured: this one."""
        yield self

    def close(self) -> None:
        """Disconnects from the physics engine."""
        self.client.disconnect()

    # Loading.

    def _load_arm(self) -> None:
        p, scene = self.client, self.scene
        p.setPhysicsEngineParameter(
            fixedTimeStep=self.dt_s, numSubSteps=0, deterministicOverlappingPairs=1
        )
        p.setGravity(0.0, 0.0, -scene.physics.gravity_m_s2)
        # Implicit cylinders: the default makes them hulls that are a margin of 1 mm too large.
        flags = (
            p.URDF_USE_INERTIA_FROM_FILE
            | p.URDF_USE_IMPLICIT_CYLINDER
            | p.URDF_USE_SELF_COLLISION
            | p.URDF_USE_SELF_COLLISION_EXCLUDE_PARENT
        )
        try:
            self.arm = p.loadURDF(str(scene.robot.urdf), useFixedBase=True, flags=flags)
        except pybullet.error as error:
            raise BridgeError(f"{scene.robot.urdf}: pybullet cannot load it: {error}") from error
        infos = [p.getJointInfo(self.arm, i) for i in range(p.getNumJoints(self.arm))]
        by_joint = {info[1].decode(): info[0] for info in infos}
        self.link_names = {info[0]: info[12].decode() for info in infos}
        self.link_parents = {info[0]: info[16] for info in infos}
        by_link = {name: index for index, name in self.link_names.items()}
        if scene.robot.tool_link not in by_link:
            raise BridgeError(
                f"{scene.file}: `robot.tool_link`: expected a link of {scene.robot.urdf}, found "
                f'"{scene.robot.tool_link}"'
            )
        self.tool_link = by_link[scene.robot.tool_link]
        self.joints = [by_joint[name] for name in self.chain.joint_names]
        for link in range(-1, len(infos)):
            p.changeDynamics(self.arm, link, linearDamping=0.0, angularDamping=0.0)
            if link >= 0:
                p.changeDynamics(self.arm, link, jointDamping=0.0)
        p.changeDynamics(
            self.arm,
            self.tool_link,
            contactStiffness=scene.suction.contact_stiffness_n_m,
            contactDamping=scene.suction.contact_damping_n_s_m,
        )

    def _load_bodies(self, with_sphere: bool) -> None:
        p, scene = self.client, self.scene
        half = [0.5 * size for size in scene.table.size_m]
        self.table = p.createMultiBody(
            0.0,
            p.createCollisionShape(p.GEOM_BOX, halfExtents=half),
            basePosition=[*scene.table.centre_xy_m, -half[2]],
        )
        p.changeDynamics(self.table, -1, lateralFriction=scene.table.friction)
        half = [0.5 * size for size in scene.object.size_m]
        self.box = p.createMultiBody(
            scene.object.mass_kg, p.createCollisionShape(p.GEOM_BOX, halfExtents=half)
        )
        p.changeDynamics(
            self.box,
            -1,
            lateralFriction=scene.object.friction,
            linearDamping=0.0,
            angularDamping=0.0,
        )
        self.sphere: int | None = None
        if with_sphere:
            shape = p.createCollisionShape(p.GEOM_SPHERE, radius=scene.sphere.radius_m)
            self.sphere = p.createMultiBody(0.0, shape)

    # State.

    @property
    def time_s(self) -> float:
        """The scenario's clock."""
        return self.steps * self.dt_s

    def joint_state(self) -> tuple[list[float], list[float]]:
        """Joint positions [rad] and velocities [rad/s]."""
        states = self.client.getJointStates(self.arm, self.joints)
        return [state[0] for state in states], [state[1] for state in states]

    def gravity_torque(self, q: Sequence[float]) -> list[float]:
        """Torques that hold the arm, without an object, against gravity [N m]."""
        zero = [0.0] * len(self.joints)
        return self.inverse_dynamics(q, zero, zero)

    def inverse_dynamics(
        self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float]
    ) -> list[float]:
        """Torques for the accelerations `qdd` [rad/s²], gravity included [N m]."""
        torque = self.client.calculateInverseDynamics(self.arm, list(q), list(qd), list(qdd))
        return list(torque)

    def object_motion(self) -> tuple[Array, Array, Array, Array]:
        """Position [m], quaternion w x y z, velocity [m/s], angular velocity [rad/s] of the box."""
        if self._free:
            position, (x, y, z, w) = self.client.getBasePositionAndOrientation(self.box)
            linear, angular = self.client.getBaseVelocity(self.box)
            return tuple(map(np.array, (position, [w, x, y, z], linear, angular)))
        motion = self._still(self.episode.object_motion(self.time_s))
        return (
            np.array(motion.position_m),
            quaternion_from_rotation(rotation_z(motion.yaw_rad)),
            np.array(motion.velocity_m_s),
            np.zeros(3),
        )

    def sphere_motion(self) -> Motion:
        """Where the sphere is."""
        return self._still(self.episode.sphere_motion(self.time_s))

    def _still(self, motion: Motion) -> Motion:
        if self.moving:
            return motion
        return Motion(motion.position_m, motion.yaw_rad, (0.0, 0.0, 0.0))

    def tool_pose(self) -> Array:
        """`X_BE` of the tip, in double precision."""
        return forward(self.chain, np.array(self.joint_state()[0]))

    # Acting.

    def place_arm(self, q: Sequence[float]) -> None:
        """Puts the arm at rest at `q` [rad]."""
        for joint, position in zip(self.joints, q):
            self.client.resetJointState(self.arm, joint, float(position), 0.0)

    def brake(self) -> None:
        """Velocity motors to zero, within the joints' efforts."""
        if self._braked is not True:
            zero = [0.0] * len(self.joints)
            self._drive(pybullet.VELOCITY_CONTROL, list(self.effort_max), targetVelocities=zero)
            self._braked = True

    def obey(self, command: JointCommand) -> tuple[list[float], list[float]]:
        """Obeys for the next step; gives the torques that were asked for and that act [N m]."""
        n = len(self.joints)
        asked = [t + g for t, g in zip(command.torque[:n], command.gravity_torque[:n])]
        return asked, self.apply_torque(asked)

    def apply_torque(self, torque: Sequence[float]) -> list[float]:
        """Torques [N m] for the next step; gives what is left of them within the efforts."""
        clamped = np.clip(torque, -self.effort_max, self.effort_max).tolist()
        if self._braked is not False:
            self._drive(pybullet.VELOCITY_CONTROL, [0.0] * len(self.joints))
            self._braked = False
        self._drive(pybullet.TORQUE_CONTROL, clamped)
        return clamped

    def _drive(self, mode: int, forces: list[float], **targets: list[float]) -> None:
        self.client.setJointMotorControlArray(self.arm, self.joints, mode, forces=forces, **targets)

    def step(self, vacuum: bool) -> None:
        """One step of the physics, then what the vacuum does, then the new time's poses."""
        self._place_bodies()
        self.client.stepSimulation()
        self._suction(vacuum)
        if self.moving:
            self.steps += 1
        self._place_bodies()

    def _place_bodies(self) -> None:
        if not self._free:
            self._place(self.box, self._still(self.episode.object_motion(self.time_s)))
        if self.sphere is not None:
            self._place(self.sphere, self.sphere_motion())

    def _place(self, body: int, motion: Motion) -> None:
        half = 0.5 * motion.yaw_rad
        self.client.resetBasePositionAndOrientation(
            body, motion.position_m, (0.0, 0.0, math.sin(half), math.cos(half))
        )
        self.client.resetBaseVelocity(body, motion.velocity_m_s, (0.0, 0.0, 0.0))

    # Suction.

    def _suction(self, vacuum: bool) -> None:
        if self._constraint is not None:
            if not vacuum:
                self._release()
            return
        sealing = vacuum and self.cup_touches()
        self._contact_steps = self._contact_steps + 1 if sealing else 0
        if sealing and self._contact_steps * self.dt_s >= self.scene.suction.seal_time_s - 1e-9:
            self._grip()

    def cup_touches(self) -> bool:
        """Whether the rim truly touches the box's top face, with the whole cup over the face."""
        contacts = self.client.getContactPoints(self.arm, self.box, self.tool_link, -1)
        touching = [contact for contact in contacts if contact[8] <= 0.0]
        if not touching:
            return False
        position, quaternion, _, _ = self.object_motion()
        r_wo = rotation_from_quaternion(quaternion)
        x_we = self.tool_pose()
        size = self.scene.object.size_m
        cup = self.scene.suction.cup_radius_m
        tip = r_wo.T @ (x_we[:3, 3] - position)
        over_face = all(abs(tip[i]) <= 0.5 * size[i] - cup for i in (0, 1))
        cosine = float(-x_we[:3, 2] @ r_wo[:, 2])
        if not over_face or cosine < math.cos(self.scene.suction.tilt_max_rad):
            return False
        for contact in touching:
            on_box = r_wo.T @ (np.array(contact[6]) - position)
            on_tool = x_we[:3, :3].T @ (np.array(contact[5]) - x_we[:3, 3])
            if on_box[2] >= 0.5 * size[2] - FACE_TOLERANCE_M and on_tool[2] >= -FACE_TOLERANCE_M:
                return True
        return False

    def _grip(self) -> None:
        p = self.client
        link = p.getLinkState(self.arm, self.tool_link, computeForwardKinematics=True)
        to_link = p.invertTransform(link[0], link[1])
        box = p.getBasePositionAndOrientation(self.box)
        position, orientation = p.multiplyTransforms(*to_link, *box)
        # The pair must not collide any more, or contact and constraint fight.
        p.setCollisionFilterPair(self.arm, self.box, self.tool_link, -1, 0)
        self._constraint = p.createConstraint(
            self.arm,
            self.tool_link,
            self.box,
            -1,
            p.JOINT_FIXED,
            [0.0, 0.0, 0.0],
            position,
            [0.0, 0.0, 0.0],
            parentFrameOrientation=orientation,
        )
        self._free = True
        self.gripper = GripperState.HOLDING
        if self.sealed_at_step is None:
            self.sealed_at_step = self.steps

    def _release(self) -> None:
        self.client.removeConstraint(self._constraint)
        self.client.setCollisionFilterPair(self.arm, self.box, self.tool_link, -1, 1)
        self._constraint = None
        self._contact_steps = 0
        self.gripper = GripperState.OPEN

    # Distances.

    def touches_sphere(self) -> bool:
        """Whether the arm or its tool touched the sphere in the last step."""
        contacts = self.client.getContactPoints(self.arm, self.sphere)
        return any(contact[8] <= 0.0 for contact in contacts)

    def place_sphere(self, motion: Motion) -> None:
        """Puts the sphere somewhere else, until the next step."""
        self._place(self.sphere, motion)

    def moves(self, link: int) -> bool:
        """Whether a link can come nearer to the table: the first one only rotates above it."""
        return self.link_parents[link] >= 0

    def self_clearance(self, link_a: int, link_b: int, distance_max_m: float) -> float:
        """Least distance of two links of the arm [m], `distance_max_m` when they are farther."""
        return self._distance(self.arm, distance_max_m, linkIndexA=link_a, linkIndexB=link_b)

    def clearance(self, body: int, links: Sequence[int], distance_max_m: float) -> float:
        """Least distance of `links` to `body` [m], `distance_max_m` when none is nearer."""
        distances = (self._distance(body, distance_max_m, linkIndexA=link) for link in links)
        return min(distances, default=distance_max_m)

    def _distance(self, body: int, distance_max_m: float, **links: int) -> float:
        points = self.client.getClosestPoints(self.arm, body, distance_max_m, **links)
        return min([distance_max_m, *(point[8] for point in points)])

    def collision_links(self) -> list[int]:
        """Links of the arm that have a shape."""
        return [
            link for link in self.link_names if self.client.getCollisionShapeData(self.arm, link)
        ]
