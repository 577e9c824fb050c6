"""How a loop in real time runs: its scheduling, where this user may, and no garbage collection."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager

from sim_bridge.errors import BridgeError

PRIORITY_DEFAULT = 40
"""SCHED_FIFO priority of a publisher's loop in real time: below a controller's."""


@contextmanager
def real_time(priority: int | None, *, insist: bool = True) -> Iterator[str]:
    """SCHED_FIFO for this thread and those that it starts; gives how to call what came of it.

    `priority` is 1 to 99; 0 goes without; `None` is 40 if this user may, and without otherwise. Who
    does not `insist` goes without one that was asked for, too.
    """
    wanted = PRIORITY_DEFAULT if priority is None else priority
    if wanted == 0:
        yield "normal scheduling"
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(wanted))
    except (OSError, ValueError) as error:
        if priority is None or not insist:
            yield "normal scheduling (no right to SCHED_FIFO: expect slips on a busy machine)"
            return
        raise BridgeError(
            f"--priority {wanted}: not allowed ({error}): expected 1 to 99 and the right to "
            "real-time scheduling (root, CAP_SYS_NICE or an rtprio limit); 0 goes on without"
        ) from error
    try:
        yield f"SCHED_FIFO {wanted}"
    finally:
        os.sched_setscheduler(0, *before)


@contextmanager
def no_collection() -> Iterator[None]:
    """Python's garbage collector rests meanwhile."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
