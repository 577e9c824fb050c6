"""What must hold, and whether it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sim_bridge.experiments.episode import harms
from sim_bridge.experiments.scenarios import GOALS

PICKED_MIN = {"pick": 0.98, "panda": 0.95, "iiwa": 0.95}
PLAIN = "torque, torque"
"""The case of the joints without anything."""
DELAY_AT_S, DELAY_MAX_S = 0.1, 0.5
REPORTED = ("blocked", "unreachable")
# A goal that jumps is always on its way; the robot may reach behind its base.
NEED_A_REASON = tuple(kind for kind in GOALS if kind not in ("jumping by 1 m", "behind the base"))


@dataclass(frozen=True)
class Verdict:
    """One requirement of one experiment."""

    experiment: str
    must: str
    measured: str
    holds: bool


def verdicts(rows: list[dict]) -> list[Verdict]:
    """The requirements of every experiment that has rows."""
    found = []
    for experiment in dict.fromkeys(row["experiment"] for row in rows):
        own = [row for row in rows if row["experiment"] == experiment]
        found += [
            Verdict(experiment, *requirement) for requirement in _requirements(experiment, own)
        ]
    return found


def _requirements(experiment: str, rows: list[dict]) -> Iterator[tuple[str, str, bool]]:
    """What must hold, what was measured, and whether it holds."""
    count = len(rows)
    if experiment in PICKED_MIN:
        least = PICKED_MIN[experiment]
        good = sum(row["exact"] for row in rows)
        must = f"at least {100.0 * least:g} % picked, within 5 mm and 2°"
        yield must, _fraction(good, count), good >= least * count
    for word, must in (
        ("contact", "no contact of a link with obstacle, table or the arm itself"),
        ("limit", "no joint position, velocity or torque limit exceeded"),
    ):
        bad = sum(any(word in harm for harm in harms(row)) for row in rows)
        yield must, f"{bad} with one", bad == 0
    settled = sum(row["picked"] or row["reason"] in REPORTED for row in rows)
    if experiment == "adversarial":
        asked = [row for row in rows if row["kind"] in NEED_A_REASON]
        reported = sum(any(reason in row["reasons"] for reason in REPORTED) for row in asked)
        if asked:
            must = "a goal that cannot be reached is reported, blocked or unreachable"
            yield must, _fraction(reported, len(asked)), reported == len(asked)
        picked = sum(row["picked"] for row in rows)
        must = "it goes on once the goal is at the box: picks it, or waits and says so"
        yield must, f"{_fraction(settled, count)}, {picked} of them picked", settled == count
    if experiment == "singular":
        yield "passes and picks, or waits and says so", _fraction(settled, count), settled == count
    if experiment == "joints":
        yield from _joints(rows)
    allocations = sum(row["allocations"] for row in rows)
    yield "no heap allocation in the controller's loop", str(allocations), allocations == 0


def _joints(rows: list[dict]) -> Iterator[tuple[str, str, bool]]:
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        good = sum(row["exact"] for row in own)
        must = f"every case picked within 3 mm and 1° ({kind})"
        yield must, _fraction(good, len(own)), good == len(own)
    plain = next((row["gripped_at_s"] for row in rows if row["label"] == PLAIN), None)
    lags = [row for row in rows if row["settings"]["joints"]["servo_lag_s"] == DELAY_AT_S]
    if plain is not None and lags:
        times = [row["gripped_at_s"] for row in lags]
        late = max(np.inf if time_s is None else time_s - plain for time_s in times)
        must = f"a servo's lag of {DELAY_AT_S:g} s delays the grip by at most {DELAY_MAX_S:g} s"
        yield must, f"{late:.2f} s", late <= DELAY_MAX_S


def _fraction(good: int, count: int) -> str:
    return f"{good} of {count} ({100.0 * good / count:.1f} %)"
