"""The Franka Hand, in a process of its own: libfranka's calls hold Python up until they return."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from dataclasses import dataclass

from sim_bridge.errors import BridgeError
from sim_bridge.messages import GripperCommand, GripperState

OPENING_M_S = 0.05
CLOSED_M = 0.002
"""Fingers nearer to each other than this hold nothing."""
CONNECT_S = 20.0
POLL_S = 0.02


@dataclass(frozen=True)
class Grasp:
    """How the hand grips."""

    speed_m_s: float = 0.05
    force_n: float = 40.0
    """What the hand holds for long by its data sheet is 70 N."""


class Hand:
    """Tells the hand's process what to do, and says what it senses."""

    def __init__(self, address: str, grasp: Grasp) -> None:
        context = multiprocessing.get_context("spawn")
        self._wanted = context.RawValue("i", -1)
        self._state = context.RawValue("i", -1)
        self._process = context.Process(
            target=_serve, args=(address, grasp, self._wanted, self._state), daemon=True
        )
        self._process.start()
        until = time.monotonic() + CONNECT_S
        while self._state.value < 0 and self._process.is_alive() and time.monotonic() < until:
            time.sleep(POLL_S)
        if self._state.value < 0:
            self.close()
            raise BridgeError(
                f"the Franka Hand at {address} does not answer: initialise it in Desk, or start "
                "with --gripper none"
            )

    @property
    def state(self) -> GripperState:
        """What the hand senses; none, once its process has ended."""
        return GripperState(self._state.value) if self._process.is_alive() else GripperState.NONE

    def command(self, command: GripperCommand) -> None:
        """What the hand shall do; returns at once."""
        self._wanted.value = command

    def close(self) -> None:
        """Ends the process; what the hand holds it goes on holding."""
        self._process.terminate()
        self._process.join()


def _serve(address: str, grasp: Grasp, wanted: object, state: object) -> None:
    """The process: does what is wanted and reports, until its parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    import pylibfranka

    try:
        hand = pylibfranka.Gripper(address)
        # libfranka has asked for the highest priority, which the arm's loop is to have.
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        _loop(hand, grasp, wanted, state)
    except pylibfranka.NetworkException as error:
        print(f"sim-bridge: the connection to the Franka Hand is lost: {error}", flush=True)


def _loop(hand: object, grasp: Grasp, wanted: object, state: object) -> None:
    done = -1
    while multiprocessing.parent_process().is_alive():
        sensed = hand.read_once()
        holds = sensed.is_grasped and sensed.width > CLOSED_M
        state.value = GripperState.HOLDING if holds else GripperState.OPEN
        if wanted.value != done:
            done = wanted.value
            _do(hand, done, sensed.max_width, grasp)
        time.sleep(POLL_S)


def _do(hand: object, command: int, width_max_m: float, grasp: Grasp) -> None:
    import pylibfranka

    try:
        if command == GripperCommand.GRIP:
            # Whatever is between the fingers, of any width.
            hand.grasp(0.0, grasp.speed_m_s, grasp.force_n, 0.0, width_max_m)
        else:
            hand.move(width_max_m, OPENING_M_S)
    except pylibfranka.CommandException as error:
        print(f"sim-bridge: the Franka Hand: {error}", flush=True)
