"""The simulated world in MuJoCo: what `world.py` has, with joints as real arms have them.

Arm, table, box, sphere and suction are those of the scene. Joints have friction, damping and
rotors; the tool may carry a mass that nobody knows of; and the arm obeys torques, or positions or
velocities by a servo with a lag. One step of the scene is several of the physics, so that friction
holds a joint that rests.

The brake is friction of the joint's whole effort. Distances come from pybullet's shapes.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import mujoco
import numpy as np

from sim_bridge.errors import BridgeError
from sim_bridge.joints import Joints
from sim_bridge.kinematics import Chain, forward, load_chain
from sim_bridge.messages import GripperState, JointCommand
from sim_bridge.poses import Array, quaternion_from_rotation, rotation_from_quaternion, rotation_z
from sim_bridge.scene import Episode, Motion, Scene
from sim_bridge.world import FACE_TOLERANCE_M, World

SUBSTEPS = 4
FRICTION_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)
FRICTION_TIME_S = 0.001
"""Friction holds a joint that rests: a UR5's lightest creeps at 0.2 mrad/s under half of 1 N m."""
CONTACT_TIME_S = 0.02
PAYLOAD_HEIGHT_M = 0.055
PAYLOAD_RADIUS_M = 0.04
DRIVE_S_RAD = 10.0
"""A servo that is 0.1 rad/s behind uses its whole effort."""
DRIVE_RATE_1_S = 200.0
"""Rate at which a servo takes back an error of position."""


class MujocoWorld:
    """One episode in MuJoCo, with the methods of `World`."""

    def __init__(self, scene: Scene, episode: Episode, joints: Joints) -> None:
        joints.check()
        self.scene, self.episode, self.settings = scene, episode, joints
        self.dt_s = 1.0 / scene.physics.rate_hz
        self.steps = 0
        self.moving = False
        self.chain: Chain = load_chain(scene.robot.urdf, scene.robot.tip_link)
        self.home = np.array(scene.robot.home_position_rad)
        self.effort_max = self.chain.effort_max_n_m
        self.gripper = GripperState.OPEN
        self.sealed_at_step: int | None = None
        self.contacts: dict[str, float] = {}
        """Between which bodies the arm was touched, but for cup and box, and when first [s]."""
        self._contact_steps = 0
        self._free = False
        self._braked = False
        self.model = _spec(scene, self.chain, joints).compile()
        self.data = mujoco.MjData(self.model)
        self._other = mujoco.MjData(self.model)
        self._find()
        self._target: tuple[Array, Array] | None = None
        self._before: tuple[Array, Array] | None = None
        self._filtered = np.zeros(len(self.joints))
        self.place_arm(self.home)
        self._place_bodies()

    def _find(self) -> None:
        model, scene = self.model, self.scene
        names = self.chain.joint_names
        self.joints = [int(model.joint(name).qposadr[0]) for name in names]
        self._dofs = [int(model.joint(name).dofadr[0]) for name in names]
        self.tool_link = model.body(scene.robot.tool_link).id
        self.box = model.body("tprmp_box").id
        self.sphere = model.body("tprmp_sphere").id
        self._box_q = int(model.joint("tprmp_box").qposadr[0])
        self._box_v = int(model.joint("tprmp_box").dofadr[0])
        self._friction = model.dof_frictionloss[self._dofs].copy()

    def close(self) -> None:
        """Nothing is left open."""

    @contextmanager
    def geometry(self) -> Iterator[World]:
        """The same scene in pybullet, for distances."""
        world = World(self.scene, self.episode)
        try:
            yield world
        finally:
            world.close()

    # State.

    @property
    def time_s(self) -> float:
        """The scenario's clock."""
        return self.steps * self.dt_s

    def joint_state(self) -> tuple[list[float], list[float]]:
        """Joint positions [rad] and velocities [rad/s]."""
        return self.data.qpos[self.joints].tolist(), self.data.qvel[self._dofs].tolist()

    def gravity_torque(self, q: Sequence[float]) -> list[float]:
        """Torques that hold the arm with what it carries unknown to others [N m]."""
        other = self._other
        other.qpos[:] = self.data.qpos
        other.qpos[self.joints] = q
        other.qvel[:] = 0.0
        mujoco.mj_kinematics(self.model, other)
        mujoco.mj_comPos(self.model, other)
        mujoco.mj_comVel(self.model, other)
        mujoco.mj_rne(self.model, other, 0, other.qfrc_bias)
        return other.qfrc_bias[self._dofs].tolist()

    def object_motion(self) -> tuple[Array, Array, Array, Array]:
        """Position [m], quaternion w x y z, velocity [m/s], angular velocity [rad/s] of the box."""
        if self._free:
            q, v = self._box_q, self._box_v
            position, quaternion = self.data.qpos[q : q + 3], self.data.qpos[q + 3 : q + 7]
            # The angular velocity of a free joint is in the body's frame.
            angular = rotation_from_quaternion(quaternion) @ self.data.qvel[v + 3 : v + 6]
            return position.copy(), quaternion.copy(), self.data.qvel[v : v + 3].copy(), angular
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
        """`X_BE` of the tip."""
        return forward(self.chain, np.array(self.joint_state()[0]))

    # Acting.

    def place_arm(self, q: Sequence[float]) -> None:
        """Puts the arm at rest at `q` [rad]."""
        self.data.qpos[self.joints] = q
        self.data.qvel[self._dofs] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def brake(self) -> None:
        """Friction of the joints' whole efforts."""
        self._brake(True)
        self._target = None
        self.data.qfrc_applied[self._dofs] = 0.0
        self.data.ctrl[:] = 0.0

    def _brake(self, on: bool) -> None:
        if self._braked != on:
            self._braked = on
            friction = self._friction + (self.effort_max if on else 0.0)
            self.model.dof_frictionloss[self._dofs] = friction
            # A servo rests while the arm is braked.
            gain = 0.0 if on or self.settings.interface == "torque" else DRIVE_S_RAD
            self.model.actuator_gainprm[:, 0] = gain * self.effort_max
            self.model.actuator_biasprm[:, 2] = -gain * self.effort_max

    def obey(self, command: JointCommand) -> tuple[list[float], list[float]]:
        """Obeys for the next step; gives the torques that were asked for and that act [N m]."""
        n = len(self.joints)
        if self.settings.interface == "torque":
            asked = [t + g for t, g in zip(command.torque[:n], command.gravity_torque[:n])]
            return asked, self.apply_torque(asked)
        self._brake(False)
        position, velocity = np.array(command.position[:n]), np.array(command.velocity[:n])
        if self._target is None:
            measured, speed = map(np.array, self.joint_state())
            self._filtered = measured if self.settings.interface == "position" else speed
        self._before = self._target or (position, velocity)
        self._target = position, velocity
        torque = self.data.qfrc_actuator[self._dofs].tolist()
        return torque, torque

    def apply_torque(self, torque: Sequence[float]) -> list[float]:
        """Torques [N m] for the next step; gives what is left of them within the efforts."""
        self._brake(False)
        clamped = np.clip(torque, -self.effort_max, self.effort_max)
        self.data.qfrc_applied[self._dofs] = clamped
        return clamped.tolist()

    def push(self, link: str, force_n: Sequence[float]) -> None:
        """A force on the middle of a link for the next step, in the base frame."""
        self.data.xfrc_applied[self.model.body(link).id, :3] = force_n

    def step(self, vacuum: bool) -> None:
        """One step of the scene, then what the vacuum does, then the new time's poses."""
        self._place_bodies()
        for part in range(SUBSTEPS):
            if self._target is not None:
                self._servo((part + 1) / SUBSTEPS)
            mujoco.mj_step(self.model, self.data)
        self.data.xfrc_applied[:] = 0.0
        self._watch()
        self._suction(vacuum)
        if self.moving:
            self.steps += 1
        self._place_bodies()

    def _servo(self, fraction: float) -> None:
        """The drive follows the set point behind a lag of first order.

        Set points are interpolated: at the end of a step the newest one is wanted.
        """
        dt_s, lag_s = self.dt_s / SUBSTEPS, self.settings.servo_lag_s
        by_position = self.settings.interface == "position"
        old, new = (pair[0 if by_position else 1] for pair in (self._before, self._target))
        wanted = old + (new - old) * fraction
        before = self._filtered
        if lag_s > 0.0:
            self._filtered = before + (wanted - before) * -math.expm1(-dt_s / lag_s)
        else:
            self._filtered = wanted
        speed = self._filtered
        if by_position:
            error = before - self.data.qpos[self.joints]
            speed = (self._filtered - before) / dt_s + DRIVE_RATE_1_S * error
        bias = self.data.qfrc_bias[self._dofs] / (DRIVE_S_RAD * self.effort_max)
        self.data.ctrl[:] = speed + bias

    def place_sphere(self, motion: Motion) -> None:
        """Puts the sphere somewhere else, until the next step."""
        self.data.mocap_pos[0] = motion.position_m

    def _place_bodies(self) -> None:
        if not self._free:
            motion = self._still(self.episode.object_motion(self.time_s))
            q, v, half = self._box_q, self._box_v, 0.5 * motion.yaw_rad
            self.data.qpos[q : q + 3] = motion.position_m
            self.data.qpos[q + 3 : q + 7] = (math.cos(half), 0.0, 0.0, math.sin(half))
            self.data.qvel[v : v + 3] = motion.velocity_m_s
            self.data.qvel[v + 3 : v + 6] = 0.0
        self.place_sphere(self.sphere_motion())

    # Contacts and suction.

    def _touching(self) -> Iterator[tuple[int, int, Array]]:
        """Bodies that touch, and where."""
        for contact in self.data.contact[: self.data.ncon]:
            if contact.dist <= 0.0:
                bodies = self.model.geom_bodyid[[contact.geom1, contact.geom2]]
                yield int(bodies[0]), int(bodies[1]), contact.pos

    def _watch(self) -> None:
        self._sphere_touched = False
        for a, b, _ in self._touching():
            names = {self.model.body(a).name, self.model.body(b).name}
            arm = [name for name in names if not name.startswith("tprmp_")]
            self._sphere_touched |= self.sphere in (a, b)
            if arm and names != {self.scene.robot.tool_link, "tprmp_box"}:
                self.contacts.setdefault(" and ".join(sorted(names)), round(self.time_s, 3))

    def touches_sphere(self) -> bool:
        """Whether anything touched the sphere in the last step."""
        return self._sphere_touched

    def cup_touches(self) -> bool:
        """Whether the rim touches the box's top face, with the whole cup over the face."""
        touching = [at for a, b, at in self._touching() if {a, b} == {self.tool_link, self.box}]
        if not touching:
            return False
        position, quaternion, _, _ = self.object_motion()
        r_wo, x_we = rotation_from_quaternion(quaternion), self.tool_pose()
        size, cup = self.scene.object.size_m, self.scene.suction.cup_radius_m
        tip = r_wo.T @ (x_we[:3, 3] - position)
        over_face = all(abs(tip[i]) <= 0.5 * size[i] - cup for i in (0, 1))
        cosine = float(-x_we[:3, 2] @ r_wo[:, 2])
        if not over_face or cosine < math.cos(self.scene.suction.tilt_max_rad):
            return False
        for at in touching:
            on_box = r_wo.T @ (at - position)
            on_tool = x_we[:3, :3].T @ (at - x_we[:3, 3])
            if on_box[2] >= 0.5 * size[2] - FACE_TOLERANCE_M and on_tool[2] >= -FACE_TOLERANCE_M:
                return True
        return False

    def _suction(self, vacuum: bool) -> None:
        weld = self.model.equality("tprmp_suction").id
        if self.gripper == GripperState.HOLDING:
            if not vacuum:
                self.data.eq_active[weld] = 0
                self.gripper, self._contact_steps = GripperState.OPEN, 0
                self._collide(True)
            return
        self._contact_steps = self._contact_steps + 1 if vacuum and self.cup_touches() else 0
        if self._contact_steps and (
            self._contact_steps * self.dt_s >= self.scene.suction.seal_time_s - 1e-9
        ):
            self._grip(weld)

    def _grip(self, weld: int) -> None:
        """Welds the box to the tool where it is, and lets the pair not collide any more."""
        data, inverse, turned = self.data, np.zeros(4), np.zeros(4)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mju_negQuat(inverse, data.xquat[self.tool_link])
        mujoco.mju_mulQuat(turned, inverse, data.xquat[self.box])
        r = data.xmat[self.tool_link].reshape(3, 3)
        offset = r.T @ (data.xpos[self.box] - data.xpos[self.tool_link])
        # The anchor is the origin of the second body.
        self.model.eq_data[weld, :3] = 0.0
        self.model.eq_data[weld, 3:6] = offset
        self.model.eq_data[weld, 6:10] = turned
        data.eq_active[weld] = 1
        self._collide(False)
        self._free = True
        self.gripper = GripperState.HOLDING
        if self.sealed_at_step is None:
            self.sealed_at_step = self.steps

    def _collide(self, on: bool) -> None:
        """Whether cup and box collide: the tool is of a group of its own."""
        for geom in np.flatnonzero(self.model.geom_bodyid == self.box):
            self.model.geom_contype[geom] = self.model.geom_conaffinity[geom] = 3 if on else 1


def _spec(scene: Scene, chain: Chain, joints: Joints) -> mujoco.MjSpec:
    """The scene, to be compiled."""
    try:
        root = ElementTree.parse(scene.robot.urdf).getroot()
        extension = ElementTree.SubElement(root, "mujoco")
        ElementTree.SubElement(extension, "compiler", fusestatic="false", discardvisual="true")
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise BridgeError(f"{scene.robot.urdf}: MuJoCo cannot load it: {error}") from error
    spec.option.timestep = 1.0 / scene.physics.rate_hz / SUBSTEPS
    spec.option.gravity = (0.0, 0.0, -scene.physics.gravity_m_s2)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    for body in spec.bodies:
        if body.name != "world":
            body.mass *= 1.0 + joints.mass_error
            body.inertia = np.array(body.inertia) * (1.0 + joints.mass_error)
            if math.isfinite(body.fullinertia[0]):
                body.fullinertia = np.array(body.fullinertia) * (1.0 + joints.mass_error)
    for name, effort in zip(chain.joint_names, chain.effort_max_n_m):
        joint = spec.joint(name)
        joint.frictionloss = joints.friction + joints.friction_fraction * effort
        joint.damping = joints.viscous
        joint.armature = joints.armature
        joint.solimp_friction, joint.solref_friction = FRICTION_IMPEDANCE, (FRICTION_TIME_S, 1.0)
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        gain = 0.0 if joints.interface == "torque" else DRIVE_S_RAD * effort
        drive = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        drive.gainprm[0], drive.biasprm[2] = gain, -gain
        drive.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        drive.forcerange = (-effort, effort)
    _add_bodies(spec, scene, joints)
    return spec


def _add_bodies(spec: mujoco.MjSpec, scene: Scene, joints: Joints) -> None:
    """Table, box, sphere, payload and the suction's weld."""
    tool = spec.body(scene.robot.tool_link)
    for geom in tool.geoms:
        geom.contype, geom.conaffinity, geom.priority = 2, 2, 1
        geom.solref = (CONTACT_TIME_S, 1.0)
    if joints.payload_kg > 0.0:
        ball = tool.add_body(name="tprmp_payload", pos=(0.0, 0.0, PAYLOAD_HEIGHT_M))
        inertia = 0.4 * joints.payload_kg * PAYLOAD_RADIUS_M**2
        ball.mass, ball.inertia, ball.explicitinertial = joints.payload_kg, [inertia] * 3, True
    box, table = mujoco.mjtGeom.mjGEOM_BOX, scene.table
    half = [0.5 * size for size in table.size_m]
    body = spec.worldbody.add_body(name="tprmp_table", pos=(*table.centre_xy_m, -half[2]))
    body.add_geom(type=box, size=half, friction=(table.friction, 0.005, 1e-4))
    body.geoms[0].contype = body.geoms[0].conaffinity = 3
    body = spec.worldbody.add_body(name="tprmp_box")
    body.add_freejoint(name="tprmp_box")
    half = [0.5 * size for size in scene.object.size_m]
    friction = (scene.object.friction, 0.005, 1e-4)
    body.add_geom(type=box, size=half, mass=scene.object.mass_kg, friction=friction)
    body.geoms[0].contype = body.geoms[0].conaffinity = 3
    body = spec.worldbody.add_body(name="tprmp_sphere", mocap=True)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(scene.sphere.radius_m, 0.0, 0.0))
    body.geoms[0].contype = body.geoms[0].conaffinity = 3
    # The shoulder stands on the table.
    base = spec.worldbody.first_body()
    weld = spec.add_equality(name="tprmp_suction", type=mujoco.mjtEq.mjEQ_WELD)
    weld.objtype = mujoco.mjtObj.mjOBJ_BODY
    weld.name1, weld.name2, weld.active = scene.robot.tool_link, "tprmp_box", False
    weld.data[10] = 1.0
    for child in [base, *base.bodies]:
        spec.add_exclude(bodyname1=child.name, bodyname2="tprmp_table")
