"""Commands for the tool: what is sent, to whom, and what is said when nobody listens."""

import subprocess
import sys
import time

import pytest

from sim_bridge.cli import main
from sim_bridge.errors import BridgeError
from sim_bridge.messages import RobotState, TaskFrames, ToolCommand
from sim_bridge.services import Instance, StatePublisherPorts, ToolCommandPorts


def start(instance_name, *arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "sim_bridge", "command", "--instance", instance_name, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def publish(robot, sequence):
    robot.publish(TaskFrames(), RobotState(sequence=sequence, time_ns=7_000 + sequence))
    robot.update_connections()
    time.sleep(0.001)


def test_commands_are_stamped_by_the_newest_state_and_end(instance_name):
    instance = Instance(instance_name)
    with StatePublisherPorts(instance) as robot:
        node = instance.node()
        listener = instance.subscriber(node, "tool_command", ToolCommand)
        process = start(
            instance_name, "--linear", "0.1", "-0.2", "0", "--angular", "0", "0", "0.5",
            "--for-s", "0.2",
        )  # fmt: skip
        heard, sequence = [], 0
        while process.poll() is None:
            sequence += 1
            publish(robot, sequence)
            sample = listener.receive()
            if sample is not None:
                command = ToolCommand.from_buffer_copy(sample.payload().contents)
                heard.append((command, sequence))
                sample.delete()
        out, err = process.communicate(timeout=30)
        del listener, node
    assert process.returncode == 0, err
    assert "commanding 0.1 -0.2 0 m/s and 0 0 0.5 rad/s" in out
    assert "let go" in out
    assert len(heard) > 1
    sequences = [command.sequence for command, _ in heard]
    assert sequences == sorted(set(sequences))
    for command, newest in heard:
        assert list(command.linear_velocity) == [0.1, -0.2, 0.0]
        assert list(command.angular_velocity) == [0.0, 0.0, 0.5]
        assert 7_000 < command.time_ns <= 7_000 + newest
    assert heard[-1][0].time_ns > heard[0][0].time_ns
    assert instance.files.shared() == []


def test_a_robot_or_a_listening_controller_that_is_missing_is_named(instance_name, capsys):
    arguments = ["command", "--instance", instance_name, "--for-s", "1", "--wait-s", "1"]
    assert main(arguments) == 2
    assert "no robot publishes its state" in capsys.readouterr().err
    with StatePublisherPorts(Instance(instance_name)) as robot:
        process = start(instance_name, *arguments[3:])
        while process.poll() is None:
            publish(robot, 1)
        _, said = process.communicate(timeout=30)
        assert process.returncode == 2
        assert f"no controller of instance `{instance_name}` listens" in said
        assert "external" in said


def test_only_one_may_command(instance_name, capsys):
    with ToolCommandPorts(Instance(instance_name)) as ports:
        with pytest.raises(BridgeError, match="already has a publisher"):
            ToolCommandPorts(Instance(instance_name))
        assert main(["command", "--instance", instance_name, "--for-s", "1"]) == 2
        assert "already has a publisher" in capsys.readouterr().err
        assert ports.publish(ToolCommand(sequence=1)) == 0, "nobody listens"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--for-s", "0"], "--for-s: expected a number above 0"),
        (["--for-s", "inf"], "--for-s"),
        (["--for-s", "1", "--wait-s", "nan"], "--wait-s"),
        (["--for-s", "1", "--rate-hz", "0"], "--rate-hz: expected 1 to 1000"),
        (["--for-s", "1", "--linear", "nan", "0", "0"], "--linear: expected three finite numbers"),
        (["--for-s", "1", "--angular", "0", "0", "inf"], "--angular"),
    ],
)
def test_numbers_outside_their_range_are_refused(instance_name, capsys, arguments, said):
    assert main(["command", "--instance", instance_name, *arguments]) == 2
    assert said in capsys.readouterr().err
