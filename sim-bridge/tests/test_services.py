"""Ports, their errors, and what they leave behind."""

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack

import pytest
from conftest import SCENE_FILE

from sim_bridge.errors import BridgeError
from sim_bridge.messages import JointCommand, RobotState, TaskFrames, name_bytes
from sim_bridge.services import (
    FRAME_SOURCES_MAX,
    FrameSourcePorts,
    Instance,
    StatePublisherPorts,
)


def test_messages_travel_and_closed_ports_leave_no_files(instance_name):
    instance = Instance(instance_name)
    with StatePublisherPorts(instance) as ports:
        node = instance.node()
        commands = instance.publisher(node, "joint_command", JointCommand)
        states = instance.subscriber(node, "robot_state", RobotState)
        ports.publish(TaskFrames(sequence=3), RobotState(sequence=3))
        sample = states.receive()
        assert sample.payload().contents.sequence == 3
        sample.delete()
        commands.send_copy(JointCommand(sequence=7))
        command = JointCommand()
        assert ports.receive_command(command)
        assert command.sequence == 7
        assert not ports.receive_command(command)
        assert instance.files.shared()
        del sample, states, commands, node
    assert instance.files.shared() == []
    assert not instance.files.folder.exists()


def test_a_second_publisher_is_refused_and_the_first_one_lives_on(instance_name):
    instance = Instance(instance_name)
    with StatePublisherPorts(instance) as ports:
        with pytest.raises(BridgeError, match="already has a publisher"):
            StatePublisherPorts(instance)
        ports.publish(TaskFrames(), RobotState())


def test_frames_come_from_several_sources_but_not_from_any_number(instance_name):
    instance = Instance(instance_name)
    with StatePublisherPorts(instance) as robot, ExitStack() as stack:
        node = instance.node()
        reader = instance.subscriber(node, "task_frames", TaskFrames)
        sources = [
            stack.enter_context(FrameSourcePorts(instance)) for _ in range(FRAME_SOURCES_MAX - 1)
        ]
        with pytest.raises(BridgeError, match="already has 8 sources of frames: end one"):
            FrameSourcePorts(instance)
        robot.publish(TaskFrames(sequence=1), RobotState())
        message = TaskFrames(sequence=2)
        message.source[:] = name_bytes("camera")
        assert sources[0].publish(message) == 1
        received = {}
        while (sample := reader.receive()) is not None:
            frames = sample.payload().contents
            received[bytes(frames.source).rstrip(b"\0")] = frames.sequence
            sample.delete()
        assert received == {b"": 1, b"camera": 2}
        del reader, node


def test_another_message_is_refused(instance_name):
    instance = Instance(instance_name)
    with StatePublisherPorts(instance):
        node = instance.node()
        with pytest.raises(BridgeError, match="this program's JointCommandV1 of 368 bytes"):
            instance.service(node, "robot_state", JointCommand)
        del node


@pytest.mark.parametrize("name", ["", "a/b", "..", "a b", "x" * 33])
def test_names_that_could_leave_the_folder_are_refused(name):
    with pytest.raises(BridgeError, match="instance name"):
        Instance(name)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_bridge_cleanly(tmp_path, instance_name, number):
    instance = Instance(instance_name)
    arguments = ["run", "--scene", SCENE_FILE, "--seed", "0", "--out", tmp_path]
    process = subprocess.Popen(
        [sys.executable, "-m", "sim_bridge", *arguments, "--instance", instance_name],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert "waiting for a controller" in process.stdout.readline()
    time.sleep(0.2)
    os.kill(process.pid, number)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "outcome: stopped before a first command" in out
    assert instance.files.shared() == []
    assert not instance.files.folder.exists()


def test_a_missing_controller_is_named(tmp_path, instance_name):
    arguments = ["run", "--scene", SCENE_FILE, "--seed", "0", "--out", tmp_path]
    arguments += ["--lockstep", "--instance", instance_name]
    result = subprocess.run(
        [sys.executable, "-m", "sim_bridge", *arguments, "--wait-s", "0.3"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 2
    assert f"start `controller run --lockstep --instance {instance_name} ...`" in result.stderr
    assert Instance(instance_name).files.shared() == []
