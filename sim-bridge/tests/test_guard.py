"""What the guard of commands says; `tests/processes` compares it with the Rust side."""

import pytest

from sim_bridge.guard import Bounds, Cause, CommandGuard, JointBounds
from sim_bridge.messages import CommandMode, GripperCommand, JointCommand, RobotState

MS = 1_000_000
BOUNDS = Bounds(joints=JointBounds([2.0] * 2, [20.0] * 2, [10.0] * 2))


def command(**changes):
    values = {
        "sequence": 1,
        "state_sequence": 5,
        "time_ns": 1000 * MS,
        "expiry_ns": 1050 * MS,
        "mode": CommandMode.TRACK,
        "joint_count": 2,
        **changes,
    }
    return JointCommand(**values)


def judge(guard, new, now_ns=1000 * MS):
    return guard.judge(now_ns, new, RobotState(sequence=5, joint_count=2))


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"joint_count": 6}, Cause.JOINT_COUNT),
        ({"mode": 17}, Cause.MODE),
        ({"time_ns": 1002 * MS}, Cause.AHEAD),
        ({"expiry_ns": 1000 * MS}, Cause.EXPIRED),
        ({"time_ns": 900 * MS, "expiry_ns": 2**64 - 1}, Cause.EXPIRED),
        ({"state_sequence": 6}, Cause.STATE_AHEAD),
        ({"state_sequence": 0}, Cause.STATE_OLD),
    ],
)
def test_only_a_fresh_command_for_this_robot_is_obeyed(changes, cause):
    guard = CommandGuard(2, BOUNDS)
    assert not judge(guard, command(**changes)).obey
    assert guard.counts == {cause: 1}
    assert judge(guard, command()).obey


def test_a_stop_brakes_and_is_no_fault_and_the_gripper_holds():
    guard = CommandGuard(2)
    assert judge(guard, command(gripper_command=GripperCommand.GRIP)).obey
    stop = command(sequence=2, mode=CommandMode.STOP, gripper_command=GripperCommand.GRIP)
    assert not judge(guard, stop).obey
    assert not judge(guard, JointCommand()).obey, "zeros are no command"
    assert guard.gripper == GripperCommand.GRIP
    assert guard.counts == {Cause.JOINT_COUNT: 1}


def test_wrong_bounds_are_a_mistake_of_the_programmer():
    with pytest.raises(AssertionError, match="1 to 8 joints"):
        CommandGuard(9)
    with pytest.raises(AssertionError, match="a bound for each of 3 joints"):
        CommandGuard(3, BOUNDS)
