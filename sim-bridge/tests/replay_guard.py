"""Replays a stream of commands that the Rust side has judged, and compares every verdict."""

import json
import math
import struct
import sys
from pathlib import Path

from sim_bridge.guard import Bounds, CommandGuard, JointBounds
from sim_bridge.messages import GripperCommand, JointCommand, RobotState


def numbers(bits):
    return list(struct.unpack(f"={len(bits)}d", struct.pack(f"={len(bits)}Q", *bits)))


def same(ours, bits):
    """Bit for bit, but for what is not a number."""
    return all(
        struct.pack("=d", a) == struct.pack("=Q", b)
        or (math.isnan(a) and math.isnan(numbers([b])[0]))
        for a, b in zip(ours, bits)
    ) and len(ours) == len(bits)


def check(case):
    limits = None if case["bounds"] is None else JointBounds(*case["bounds"])
    guard = CommandGuard(case["joints"], Bounds(joints=limits))
    for i, tick in enumerate(case["ticks"]):
        sequence, position, velocity = tick["state"]
        state = RobotState(sequence=sequence)
        state.position[:], state.velocity[:] = numbers(position), numbers(velocity)
        new = None
        if tick["command"] is not None:
            new = JointCommand.from_buffer_copy(struct.pack("=4Q4I40Q", *tick["command"]))
        action = guard.judge(tick["now_ns"], new, state)
        assert action.obey == tick["obey"], f"tick {i}: {guard.last_fault}, {tick['fault']}"
        assert same(action.position, tick["position"]), f"tick {i}: {action}"
        assert same(action.velocity, tick["velocity"]), f"tick {i}: {action}"
        assert (guard.gripper == GripperCommand.GRIP) == tick["grips"], f"tick {i}"
        ours, theirs = guard.last_fault, tick["fault"]
        assert (ours is None) == (theirs is None), f"tick {i}: {ours}, {theirs}"
        if ours is not None:
            assert [ours.cause.value, ours.sequence, ours.joint] == theirs[:3], f"tick {i}: {ours}"
            assert same([ours.found, ours.expected], theirs[3:]), f"tick {i}: {ours}"
            assert str(ours).startswith(f"command {ours.sequence} ")
    assert {cause.value: count for cause, count in guard.counts.items()} == case["counts"]
    return len(case["ticks"])


if __name__ == "__main__":
    cases = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    print(f"{sum(map(check, cases))} ticks")
