"""The live bridge: steps the physics, publishes states, applies commands.

Real time: one step every period of `CLOCK_MONOTONIC`. A step that begins more than half a period
late moves the schedule instead of being caught up with, and is counted as a slip.

Lockstep: a simulated clock. Every state waits for the command that answers it, so that the same
seed and the same controller give the same commands byte for byte.

Row order of one step: the state at time t is published; at the step's deadline the newest command
is obeyed for the step from t to t + dt. Until a first command the arm stands still, and so does
the scenario's clock.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from sim_bridge.demonstrations import demonstrated_grasp
from sim_bridge.errors import BridgeError
from sim_bridge.evaluate import evaluate
from sim_bridge.files import check, write
from sim_bridge.guard import CommandGuard, counted
from sim_bridge.joints import Joints
from sim_bridge.log import LogWriter, check_folder, save
from sim_bridge.messages import (
    CommandMode,
    ControllerStatus,
    GripperCommand,
    GripperState,
    JointCommand,
    ObstacleKind,
    Reason,
    RobotState,
    TaskFrames,
    joint_names_hash,
    place,
    place_obstacle,
)
from sim_bridge.poses import Array, quaternion_from_rotation
from sim_bridge.priority import no_collection, real_time
from sim_bridge.scene import Episode, Scene, draw_episode
from sim_bridge.services import Instance, StatePublisherPorts, StopSignal
from sim_bridge.world import World

LOCKSTEP_EPOCH_NS = 1_000_000_000
LOCKSTEP_WAIT_S = 10.0
POLL_SPIN_S = 200e-6
POLL_SLEEP_S = 50e-6
DONE_WAIT_S = 2.0
"""How long a held, lifted box waits for the controller to call itself done, in real time."""
LOST_AFTER_S = 5.0
"""A controller without a valid command for so long is gone; one that is started again before takes
over."""
SETTLE_S = 0.5
"""A box on a braked arm swings for less than this."""


class Outcome(str, Enum):
    """How a run ended."""

    LIFTED = "lifted"
    TIMEOUT = "timeout"
    STOPPED = "stopped"
    CONTROLLER_STOPPED = "controller stopped"
    CONTROLLER_LOST = "controller lost"
    FAILED = "failed"
    """An error ended it: what was seen until then is in the log."""


@dataclass
class Timing:
    """How well real time was kept."""

    wall_s: float = 0.0
    simulated_s: float = 0.0
    real_time_factor: float = 0.0
    slips: int = 0
    slip_total_s: float = 0.0
    slip_max_s: float = 0.0
    braked_steps: int = 0
    clamped_steps: int = 0


@dataclass(frozen=True)
class Options:
    """What the command line asked for."""

    seed: int
    out: Path
    instance: str
    lockstep: bool
    wait_s: float
    priority: int | None
    """`None`: real-time scheduling if this user may, without it otherwise; 0: without."""
    record_commands: Path | None
    force: bool = False
    """Whether another run's files are replaced."""
    joints: Joints | None = None
    """Of the arm in MuJoCo; `None`: the arm in pybullet, which has none of it."""


class Publication:
    """The messages, allocated once and filled at every step."""

    def __init__(self, world: World, start_frame: str, goal_frame: str) -> None:
        self.world = world
        self.frames = TaskFrames(frame_count=2, obstacle_count=2)
        names = world.chain.joint_names
        self.state = RobotState(joint_count=len(names), joint_names_hash=joint_names_hash(names))
        x_start = world.tool_pose()
        quaternion = quaternion_from_rotation(x_start[:3, :3]).tolist()
        place(self.frames.frames[0], start_frame, x_start[:3, 3].tolist(), quaternion)
        place(self.frames.frames[1], goal_frame, (0.0, 0.0, 0.0))
        obstacles = self.frames.obstacles
        place_obstacle(obstacles[0], ObstacleKind.SPHERE, [world.scene.sphere.radius_m])
        place_obstacle(obstacles[1], ObstacleKind.HALF_SPACE)
        self.position: list[float] = []
        self.velocity: list[float] = []
        self.object_position: Array = np.zeros(3)
        self.object_quaternion: Array = np.zeros(4)
        self.object_velocity: Array = np.zeros(3)
        self.sphere_position: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def fill(self, time_ns: int, torque: list[float]) -> None:
        """Reads the world into the messages; `torque` without gravity [N m]."""
        world, n = self.world, len(self.world.joints)
        self.position, self.velocity = world.joint_state()
        state = self.state
        state.sequence += 1
        state.time_ns = time_ns
        state.gripper_state = world.gripper
        state.position[:n] = self.position
        state.velocity[:n] = self.velocity
        state.torque[:n] = torque
        frames = self.frames
        frames.sequence, frames.time_ns = state.sequence, time_ns
        goal, sphere = frames.frames[1], frames.obstacles[0]
        position, quaternion, velocity, angular_velocity = world.object_motion()
        self.object_position, self.object_quaternion = position, quaternion
        self.object_velocity = velocity
        goal.position[:] = position.tolist()
        goal.quaternion[:] = quaternion.tolist()
        goal.linear_velocity[:] = velocity.tolist()
        goal.angular_velocity[:] = angular_velocity.tolist()
        motion = world.sphere_motion()
        self.sphere_position = motion.position_m
        sphere.position[:] = motion.position_m
        sphere.linear_velocity[:] = motion.velocity_m_s


class Run:
    """One run: the loop's state, and one method a phase."""

    def __init__(self, scene: Scene, options: Options, world: World) -> None:
        self.scene, self.options, self.world = scene, options, world
        self.dt_ns = round(1e9 / scene.physics.rate_hz)
        self.publication = self.publish_from(world)
        self.command = JointCommand()
        self.guard = CommandGuard(len(world.joints))
        self.obeys = False
        self.status = ControllerStatus()
        self.life_cycle = -1
        self.timing = Timing()
        steps_max = math.ceil(scene.task.time_limit_s / world.dt_s)
        self.steps_max = steps_max
        self.log = LogWriter(steps_max + 2, len(world.joints))
        self.recorded = bytearray()
        self.torque_measured = [0.0] * len(world.joints)
        self.seal_height_m = math.nan
        self.held_s = 0.0
        self.braked_s = 0.0

    def publish_from(self, world: World) -> Publication:
        """What is published of this world."""
        return Publication(world, self.scene.task.start_frame, self.scene.task.goal_frame)

    # The step.

    def judge_command(self, now_ns: int, new: bool) -> bool:
        """Whether the arm obeys for the next step; `new` when a command has come."""
        command = self.command if new else None
        self.obeys = self.guard.judge(now_ns, command, self.publication.state).obey
        return self.obeys

    def step(self, lateness_s: float) -> None:
        """Obeys the command that holds, or brakes, for one step of the physics."""
        world, publication, command = self.world, self.publication, self.guard.command
        n = len(world.joints)
        gravity = world.gravity_torque(publication.position)
        self.log.write(
            time_s=world.time_s,
            position_rad=publication.position,
            velocity_rad_s=publication.velocity,
            object_position_m=publication.object_position,
            object_quaternion_wxyz=publication.object_quaternion,
            sphere_position_m=publication.sphere_position,
            gripper_state=int(world.gripper),
            life_cycle=self.life_cycle,
            lateness_s=lateness_s,
        )
        # The vacuum stays as it was last asked for: braking must not drop the object.
        vacuum = self.guard.gripper == GripperCommand.GRIP
        if self.obeys:
            gravity_cmd = command.gravity_torque[:n]
            commanded, applied = world.obey(command)
            self.braked_s = 0.0
            self.timing.clamped_steps += applied != commanded
            self.torque_measured = [a - g for a, g in zip(applied, gravity)]
            self.log.write(
                position_cmd_rad=command.position[:n],
                velocity_cmd_rad_s=command.velocity[:n],
                acceleration_cmd_rad_s2=command.acceleration[:n],
                torque_n_m=applied,
                gravity_torque_n_m=np.clip(gravity_cmd, -world.effort_max, world.effort_max),
                command_mode=command.mode,
                command_reason=command.reason,
            )
        else:
            world.brake()
            # Braking after the controller has left on purpose is no fault.
            self.timing.braked_steps += not self.left_on_purpose()
            self.braked_s += world.dt_s
            self.torque_measured = [0.0] * n
        world.step(vacuum)
        if world.sphere is not None:
            self.log.write(contact_sphere=int(world.touches_sphere()))
        self.log.next_row()

    def judge(self) -> Outcome | None:
        """Whether the run is over, after the newest state was read."""
        if self.world.steps >= self.steps_max:
            return Outcome.TIMEOUT
        if not self.options.lockstep and self.braked_s > LOST_AFTER_S:
            return Outcome.CONTROLLER_LOST
        lifted = self.lifted()
        if lifted is None and not self.options.lockstep and self.stopped():
            return Outcome.CONTROLLER_STOPPED
        return lifted

    def left_on_purpose(self) -> bool:
        """Whether the last command is the one with which a controller ends."""
        command = self.command
        return command.mode == CommandMode.STOP and command.reason == Reason.STOP_REQUESTED

    def stopped(self) -> bool:
        """Whether the controller has left on purpose, and the box will not count as held any more.

        A box that is in the air is still to be seen held still, by the braked arm.
        """
        if not self.left_on_purpose():
            return False
        in_the_air = self.world.gripper == GripperState.HOLDING
        return not in_the_air or self.braked_s > self.scene.task.hold_time_s + SETTLE_S

    def lifted(self) -> Outcome | None:
        """Whether the box was lifted and held for long enough."""
        world, task = self.world, self.scene.task
        if world.gripper != GripperState.HOLDING:
            self.seal_height_m, self.held_s = math.nan, 0.0
            return None
        publication = self.publication
        height = float(publication.object_position[2])
        if math.isnan(self.seal_height_m):
            self.seal_height_m = height
        speed = float(np.linalg.norm(publication.object_velocity))
        lifted = height - self.seal_height_m >= task.lift_height_m
        if not lifted or speed > task.hold_speed_max_m_s:
            self.held_s = 0.0
            return None
        self.held_s += world.dt_s
        # A controller that leaves once it is done still needs states for its ramp to rest; in
        # lockstep only what is in step with the states may decide.
        done = self.options.lockstep or self.command.mode == CommandMode.STOP
        if self.held_s >= task.hold_time_s + (0.0 if done else DONE_WAIT_S):
            return Outcome.LIFTED
        return None

    def read_status(self, ports: StatePublisherPorts) -> None:
        """Reads the newest status."""
        if ports.receive_status(self.status):
            self.life_cycle = int(self.status.life_cycle)

    # Real time.

    def real_time(self, ports: StatePublisherPorts, stop: StopSignal) -> Outcome:
        """Steps against `CLOCK_MONOTONIC` until the run is over."""
        publication, timing = self.publication, self.timing
        waited_until = time.monotonic() + self.options.wait_s
        deadline = time.monotonic_ns()
        started_ns = deadline
        while not stop.requested:
            publication.fill(deadline, self.torque_measured)
            ports.publish(publication.frames, publication.state)
            self.read_status(ports)
            outcome = self.judge() if self.world.moving else None
            if outcome is not None:
                break
            deadline += self.dt_ns
            late_ns = sleep_until(deadline)
            if late_ns > self.dt_ns // 2:
                deadline += late_ns
                if self.world.moving:
                    timing.slips += 1
                    timing.slip_total_s += 1e-9 * late_ns
                    timing.slip_max_s = max(timing.slip_max_s, 1e-9 * late_ns)
            new = ports.receive_command(self.command)
            obeys = self.judge_command(time.monotonic_ns(), new)
            if not self.world.moving:
                if obeys:
                    self.world.moving = True
                    started_ns = deadline
                else:
                    ports.update_connections()
                    if time.monotonic() > waited_until:
                        raise self.no_controller(self.options.wait_s)
                    continue
            self.step(1e-9 * late_ns)
        else:
            outcome = Outcome.STOPPED
        if self.world.moving:
            timing.wall_s = 1e-9 * (time.monotonic_ns() - started_ns)
        return outcome

    def no_controller(self, wait_s: float) -> BridgeError:
        """No first command came."""
        lockstep = " --lockstep" if self.options.lockstep else ""
        return BridgeError(
            f"no command from a controller within {wait_s:g} s: start "
            f"`controller run{lockstep} --instance {self.options.instance} ...` beside this "
            "bridge, as the same user"
        )

    # Lockstep.

    def not_in_lockstep(self) -> BridgeError:
        """The controller runs against the machine's clock."""
        return BridgeError(
            f"the controller of instance `{self.options.instance}` answers on the machine's "
            "clock, this bridge runs in lockstep: start both with --lockstep, or both without"
        )

    def lockstep(self, ports: StatePublisherPorts, stop: StopSignal) -> Outcome:
        """Steps a simulated clock, one command a state, until the run is over."""
        publication = self.publication
        self.world.moving = True
        started = time.monotonic()
        first = True
        while True:
            time_ns = LOCKSTEP_EPOCH_NS + self.world.steps * self.dt_ns
            publication.fill(time_ns, self.torque_measured)
            outcome = self.judge()
            if outcome is not None:
                break
            ports.publish(publication.frames, publication.state)
            answered = self.wait_for_answer(ports, stop, first)
            if stop.requested:
                outcome = Outcome.STOPPED
                break
            if not answered:
                if first:
                    raise self.no_controller(self.options.wait_s)
                outcome = Outcome.CONTROLLER_LOST
                break
            if first:
                started = time.monotonic()
            first = False
            # In lockstep the controller's clock is that of the states.
            if self.command.time_ns != time_ns and not self.left_on_purpose():
                raise self.not_in_lockstep()
            self.read_status(ports)
            self.recorded += bytes(self.command)
            self.judge_command(time_ns, True)
            self.step(0.0)
        self.timing.wall_s = time.monotonic() - started
        return outcome

    def wait_for_answer(self, ports: StatePublisherPorts, stop: StopSignal, first: bool) -> bool:
        """Polls until the command to the newest state is there; `False` when it does not come."""
        begun = time.monotonic()
        limit_s = self.options.wait_s if first else LOCKSTEP_WAIT_S
        sequence = self.publication.state.sequence
        while not stop.requested:
            if ports.receive_command(self.command) and self.command.state_sequence == sequence:
                return True
            waited_s = time.monotonic() - begun
            if waited_s > limit_s:
                return False
            if first:
                ports.update_connections()
            if waited_s > POLL_SPIN_S:
                time.sleep(POLL_SLEEP_S)
        return False


def sleep_until(deadline_ns: int) -> int:
    """Sleeps until the deadline on `CLOCK_MONOTONIC` and gives how late it became [ns]."""
    left_ns = deadline_ns - time.monotonic_ns()
    if left_ns > 0:
        time.sleep(1e-9 * left_ns)
    return max(0, time.monotonic_ns() - deadline_ns)


def open_world(scene: Scene, episode: Episode, joints: Joints | None) -> World:
    """The world in pybullet, or in MuJoCo where joints are given."""
    if joints is None:
        return World(scene, episode)
    from sim_bridge.mujoco_world import MujocoWorld

    return MujocoWorld(scene, episode, joints)


def check_start(world: World) -> None:
    """Refuses an episode whose sphere would swing through the arm at its start."""
    least = world.scene.sphere.start_clearance_min_m
    links = world.collision_links()
    samples = 48
    period_s = 2.0 * math.pi / max(world.episode.sphere_speed_rad_s, 1e-9)
    for sample in range(samples):
        world.place_sphere(world.episode.sphere_motion(period_s * sample / samples))
        if world.clearance(world.sphere, links, least) < least:
            raise BridgeError(
                f"{world.scene.file}: `sphere`: seed {world.episode.seed} brings the sphere "
                f"nearer than start_clearance_min_m ({least:g} m) to the arm's home position"
            )
    world.place_sphere(world.sphere_motion())


def run(scene: Scene, options: Options) -> int:
    """Runs one episode, writes its log and prints what came of it; gives the exit code.

    The log is written on every end that can be handled, an error's too.
    """
    # Before anything moves: a run that cannot be written down would be lost.
    check_folder(options.out, force=options.force)
    if options.record_commands is not None:
        check(options.record_commands, force=options.force)
    # What the judgement needs is read first: a missing folder must not cost a whole run.
    grasp = demonstrated_grasp(scene.task.demonstrations, scene.task.goal_frame)
    episode = draw_episode(scene, options.seed)
    world = open_world(scene, episode, options.joints)
    try:
        with world.geometry() as geometry:
            check_start(geometry)
        this = Run(scene, options, world)
        with (
            StopSignal() as stop,
            StatePublisherPorts(Instance(options.instance)) as ports,
            _priority(options) as how,
        ):
            print(
                f"instance {options.instance}: publishing at {scene.physics.rate_hz:g} Hz, {how}, "
                "waiting for a controller",
                flush=True,
            )
            try:
                with no_collection():
                    outcome = (this.lockstep if options.lockstep else this.real_time)(ports, stop)
            except BaseException:
                if this.log.rows > 0:
                    _finish(this, Outcome.FAILED, grasp)
                raise
        if this.log.rows == 0:
            print(f"outcome: {outcome.value} before a first command: no log is written")
            return 0
        return _finish(this, outcome, grasp)
    finally:
        world.close()


@contextmanager
def _priority(options: Options) -> Iterator[str]:
    """Real-time scheduling for the loop in real time, and how to call what came of it.

    Lockstep polls: at a real-time priority it would starve whom it waits for.
    """
    if options.lockstep:
        yield "in lockstep"
        return
    with real_time(options.priority) as how:
        yield how


def _finish(this: Run, outcome: Outcome, grasp: Array) -> int:
    scene, options, world, timing = this.scene, this.options, this.world, this.timing
    timing.simulated_s = world.time_s
    timing.real_time_factor = world.time_s / timing.wall_s if timing.wall_s > 0.0 else 0.0
    log = this.log.finish(world.chain)
    with world.geometry() as geometry:
        result = evaluate(scene, geometry, log, grasp)
    lateness_ms = 1e3 * log["lateness_s"]
    late = {
        f"lateness_{name}_ms": float(np.percentile(lateness_ms, rank)) if len(lateness_ms) else 0.0
        for name, rank in (("p50", 50), ("p99", 99), ("max", 100))
    }
    bridge = {
        "scene": str(scene.file),
        "seed": options.seed,
        "instance": options.instance,
        "mode": "lockstep" if options.lockstep else "real time",
        "physics_rate_hz": scene.physics.rate_hz,
        "outcome": outcome.value,
        "joints": None if options.joints is None else asdict(options.joints),
        "episode": asdict(world.episode),
        "timing": {**asdict(timing), **late},
        "command_faults": {cause.value: count for cause, count in this.guard.counts.items()},
        "result": result,
    }
    save(options.out, log, bridge, force=options.force)
    if options.record_commands is not None:
        write(options.record_commands, bytes(this.recorded), force=options.force)
    print_summary(bridge)
    if this.guard.last_fault is not None:
        print(f"last fault of a command: {this.guard.last_fault}")
    print(f"log: {options.out}")
    succeeded = outcome == Outcome.LIFTED and result["success"]
    return 0 if succeeded or outcome == Outcome.STOPPED else 1


def print_summary(bridge: dict) -> None:
    """Prints what came of a run."""
    timing, result = bridge["timing"], bridge["result"]
    print(f"outcome: {bridge['outcome']} after {timing['simulated_s']:.2f} s")
    if bridge["mode"] == "real time":
        print(
            f"real-time factor {timing['real_time_factor']:.4f}, {timing['slips']} slips "
            f"(together {1e3 * timing['slip_total_s']:.1f} ms, largest "
            f"{1e3 * timing['slip_max_s']:.1f} ms), lateness p99 {timing['lateness_p99_ms']:.2f} ms"
        )
    print(
        f"braked steps {timing['braked_steps']}, steps with a clamped torque "
        f"{timing['clamped_steps']}"
    )
    print(f"commands with a fault: {counted(bridge['command_faults'])}")
    print(f"success: {'yes' if result['success'] else 'no'}")
    for key, value in result.items():
        if key != "success":
            print(f"  {key}: {value:.4g}" if isinstance(value, float) else f"  {key}: {value}")
