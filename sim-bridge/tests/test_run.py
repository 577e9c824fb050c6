"""The live loop against a controller of a few lines, and the judgement of its log."""

import math
import threading

import numpy as np
import pytest

from sim_bridge import log as log_files
from sim_bridge.cli import main
from sim_bridge.demonstrations import demonstrated_grasp
from sim_bridge.errors import BridgeError
from sim_bridge.evaluate import distant_pairs, evaluate
from sim_bridge.guard import Cause
from sim_bridge.log import LogWriter
from sim_bridge.messages import (
    CommandMode,
    ControllerStatus,
    GripperCommand,
    JointCommand,
    LifeCycle,
    RobotState,
    reason_name,
)
from sim_bridge.run import Options, Outcome, Run, check_start, run
from sim_bridge.scene import draw_episode
from sim_bridge.services import Instance, StatePublisherPorts, StopSignal
from sim_bridge.world import World

ANSWERS = 50


class Answering(threading.Thread):
    """A controller that holds the arm against gravity for `ANSWERS` states, then falls silent."""

    def __init__(self, instance, chain_world, life_ns, spoil):
        super().__init__(daemon=True)
        self.instance, self.world, self.life_ns = instance, chain_world, life_ns
        self.spoil = spoil
        self.stop = threading.Event()

    def run(self):
        node = self.instance.node()
        commands = self.instance.publisher(node, "joint_command", JointCommand)
        statuses = self.instance.publisher(node, "controller_status", ControllerStatus)
        states = self.instance.subscriber(node, "robot_state", RobotState)
        answered = 0
        while answered < ANSWERS and not self.stop.wait(5e-4):
            sample = states.receive()
            if sample is None:
                continue
            state = RobotState.from_buffer_copy(sample.payload().contents)
            sample.delete()
            answered += 1
            command = JointCommand(
                sequence=answered,
                state_sequence=state.sequence,
                time_ns=state.time_ns,
                expiry_ns=state.time_ns + self.life_ns,
                mode=CommandMode.TRACK,
                joint_count=6,
            )
            command.gravity_torque[:6] = self.world.gravity_torque(state.position[:6])
            status = ControllerStatus(sequence=answered, life_cycle=LifeCycle.RUNNING)
            self.spoil(command, status)
            statuses.send_copy(status)
            commands.send_copy(command)
        self.stop.wait()
        del commands, statuses, states, node
        self.instance.files.remove_leftovers()


class StopAfter(StopSignal):
    """Asks for a stop once the world has made so many steps."""

    def __init__(self, world, steps):
        self.world, self.steps = world, steps

    @property
    def requested(self):
        return self.world.steps >= self.steps


def play(scene, name, tmp_path, lockstep, steps, life_ns=10**9, spoil=lambda *_: None):
    """Runs `steps` steps; gives the outcome, the run and its log."""
    world, theirs = World(scene, draw_episode(scene, 0)), World(scene, draw_episode(scene, 0))
    options = Options(0, tmp_path, name, lockstep, 10.0, 0, None)
    this = Run(scene, options, world)
    instance = Instance(name)
    controller = Answering(instance, theirs, life_ns, spoil)
    with StatePublisherPorts(instance) as ports:
        controller.start()
        loop = this.lockstep if lockstep else this.real_time
        outcome = loop(ports, StopAfter(world, steps))
        controller.stop.set()
        controller.join(10.0)
    log = this.log.finish(world.chain)
    theirs.close()
    return outcome, this, log


def test_lockstep_obeys_every_command_and_repeats_exactly(scene, instance_name, tmp_path):
    outcome, first, log = play(scene, instance_name, tmp_path, True, ANSWERS)
    _, second, again = play(scene, instance_name, tmp_path, True, ANSWERS)
    assert outcome == Outcome.STOPPED
    assert len(first.recorded) == ANSWERS * 368
    assert first.recorded == second.recorded
    assert np.array_equal(log["position_rad"], again["position_rad"])
    assert np.all(log["command_mode"] == CommandMode.TRACK)
    assert log["time_s"] == pytest.approx(np.arange(ANSWERS) * 0.002)


def test_real_time_brakes_when_commands_expire(scene, instance_name, tmp_path):
    steps = ANSWERS + 200
    _, this, log = play(scene, instance_name, tmp_path, False, steps, life_ns=50_000_000)
    obeyed = log["command_mode"] == CommandMode.TRACK
    assert obeyed[0]
    assert not np.any(obeyed[-50:])
    assert this.timing.braked_steps == np.sum(~obeyed)
    assert np.all(np.isnan(log["torque_n_m"][~obeyed]))
    assert np.max(np.abs(log["velocity_rad_s"][-1])) < 5e-3
    assert this.timing.wall_s >= 0.9 * steps * 0.002, "faster than real time"


def test_no_field_of_a_message_ends_the_run_or_its_log(scene, instance_name, tmp_path):
    largest = 2**32 - 1

    def spoil(command, status):
        command.gripper_command = GripperCommand.GRIP
        if command.sequence == 10:
            command.reason = largest
        if command.sequence == 20:
            status.life_cycle = largest
        if command.sequence == 30:
            command.gripper_command = 77
        if command.sequence == 40:
            command.torque[:] = command.gravity_torque[:] = [1.7e308] * 8
        if command.sequence == 45:
            command.position[3] = math.nan
        if command.sequence == 48:
            command.expiry_ns = 2**64 - 1

    _, this, log = play(scene, instance_name, tmp_path, True, ANSWERS, spoil=spoil)
    log_files.save(tmp_path, log, {}, force=False)
    log, _ = log_files.load(tmp_path)
    assert log["command_reason"][9] == largest
    assert log["command_mode"][9] == CommandMode.TRACK
    assert largest in log["life_cycle"]
    assert this.guard.gripper == GripperCommand.GRIP, "an unknown command lets nothing go"
    assert np.array_equal(log["torque_n_m"][39], this.world.effort_max)
    assert np.array_equal(log["gravity_torque_n_m"][39], this.world.effort_max)
    assert list(log["command_mode"]).index(-1) == 44
    counts = {cause.value: count for cause, count in this.guard.counts.items()}
    assert counts == {"reason": 1, "gripper": 1, "not_finite": 1}
    assert reason_name(largest) == "reason 4294967295"


def test_a_command_without_an_end_is_obeyed_for_a_tenth_of_a_second(scene, instance_name, tmp_path):
    def spoil(command, _):
        command.expiry_ns = 2**64 - 1

    _, this, log = play(scene, instance_name, tmp_path, False, ANSWERS + 200, spoil=spoil)
    assert log["command_mode"][0] == CommandMode.TRACK
    assert np.all(log["command_mode"][-50:] == -1)
    assert this.guard.counts[Cause.EXPIRED] >= 1
    assert "no newer one has come" in str(this.guard.last_fault)


def synthetic_log(world, scene, sealed_at, rise_m):
    """A log in which the arm rests at home and the box is lifted by hand."""
    writer = LogWriter(1001, 6)
    for row in range(1000):
        held = row >= sealed_at
        writer.write(
            time_s=0.002 * row,
            position_rad=world.home,
            velocity_rad_s=np.zeros(6),
            torque_n_m=world.gravity_torque(world.home),
            object_position_m=(0.5, -0.25, 0.03 + (rise_m if row > sealed_at + 10 else 0.0)),
            object_quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
            sphere_position_m=(0.5, -0.2, 0.25),
            gripper_state=2 if held else 1,
            lateness_s=0.0,
        )
        writer.next_row()
    return writer.finish(world.chain)


def test_the_judgement_wants_grip_height_and_time(scene, world):
    grasp = demonstrated_grasp(scene.task.demonstrations, "object")
    good = evaluate(scene, world, synthetic_log(world, scene, 400, 0.12), grasp)
    assert good["success"]
    assert good["gripped_at_s"] == pytest.approx(0.8)
    assert good["lifted_m"] == pytest.approx(0.12)
    assert good["clearance_self_m"] > 0.01
    assert not evaluate(scene, world, synthetic_log(world, scene, 400, 0.09), grasp)["success"]
    late = evaluate(scene, world, synthetic_log(world, scene, 800, 0.12), grasp)
    assert not late["success"], f"held for {late['held_s']} s only"
    never = evaluate(scene, world, synthetic_log(world, scene, 2000, 0.12), grasp)
    assert not never["gripped"]
    assert never["position_error_mm"] is None


def test_a_touched_sphere_is_no_success(scene, world):
    grasp = demonstrated_grasp(scene.task.demonstrations, "object")
    log = synthetic_log(world, scene, 400, 0.12)
    log["sphere_position_m"][500:520] = log["tool_position_m"][500]
    result = evaluate(scene, world, log, grasp)
    assert result["sphere_touched"]
    assert not result["success"]
    assert result["clearance_sphere_m"] < 0.0


def test_neighbours_are_no_pair(world):
    names = world.link_names
    pairs = [(names[a], names[b]) for a, b in distant_pairs(world, world.collision_links())]
    assert ("wrist_1_link", "wrist_3_link") in pairs
    assert ("wrist_2_link", "wrist_3_link") not in pairs
    assert ("wrist_3_link", "suction_tool") not in pairs


def test_every_seed_starts_clear_of_the_sphere(scene, world):
    for seed in range(30):
        world.episode = draw_episode(scene, seed)
        check_start(world)


def test_a_log_survives_the_disk(world, scene, tmp_path):
    log = synthetic_log(world, scene, 400, 0.12)
    log_files.save(tmp_path, log, {"seed": 3}, force=False)
    loaded, bridge = log_files.load(tmp_path)
    assert bridge == {"schema": log_files.SCHEMA, "seed": 3}
    assert set(loaded) == set(log)
    assert np.array_equal(loaded["tool_position_m"], log["tool_position_m"])
    with pytest.raises(BridgeError, match=r"expected log\.npz and bridge\.json"):
        log_files.load(tmp_path / "elsewhere")


def test_an_error_leaves_the_log_of_what_was_seen(monkeypatch, scene, instance_name, tmp_path):
    def breaks_off(self, _ports, _stop):
        self.world.moving = True
        for _ in range(7):
            self.publication.fill(1, self.torque_measured)
            self.judge_command(1, False)
            self.step(0.0)
        raise MemoryError("shared memory is full")

    monkeypatch.setattr(Run, "lockstep", breaks_off)
    with pytest.raises(MemoryError):
        run(scene, Options(0, tmp_path, instance_name, True, 10.0, 0, None))
    log, bridge = log_files.load(tmp_path)
    assert bridge["outcome"] == "failed"
    assert len(log["time_s"]) == 7


def test_errors_of_the_command_line_are_sentences(tmp_path, capsys):
    scene = str(tmp_path / "no.json")
    assert main(["record", "--scene", scene]) == 2
    assert capsys.readouterr().err.startswith(f"sim-bridge: {scene}: cannot be read")


def test_another_python_is_refused(monkeypatch, capsys):
    monkeypatch.setattr("sys.version_info", (3, 13, 0, "final", 0))
    assert main([]) == 2
    assert "expected Python 3.9, 3.10 or 3.11" in capsys.readouterr().err
