"""What must hold, and whether it does."""

from __future__ import annotations

from dataclasses import dataclass

from sim_bridge.experiments.episode import harms
from sim_bridge.experiments.scenarios import GOALS

PICKED_MIN = {"pick": 0.98, "panda": 0.95, "iiwa": 0.95}
REPORTED = ("blocked", "unreachable")
# A goal that jumps is always on its way; the robot may reach behind its base.
NEED_A_REASON = tuple(kind for kind in GOALS if kind not in ("jumping by 1 m", "behind the base"))


@dataclass(frozen=True)
class Verdict:
    """One demand on one experiment."""

    experiment: str
    must: str
    measured: str
    holds: bool


def verdicts(rows: list[dict]) -> list[Verdict]:
    """The demands on every experiment that has rows."""
    found = []
    for experiment in dict.fromkeys(row["experiment"] for row in rows):
        own = [row for row in rows if row["experiment"] == experiment]
        count = len(own)

        def fraction(good: int, of: int) -> str:
            return f"{good} of {of} ({100.0 * good / of:.1f} %)"

        if experiment in PICKED_MIN:
            least = PICKED_MIN[experiment]
            good = sum(row["exact"] for row in own)
            must = f"at least {100.0 * least:g} % picked, within 5 mm and 2°"
            found.append(Verdict(experiment, must, fraction(good, count), good >= least * count))
        touched = sum(any("contact" in harm for harm in harms(row)) for row in own)
        must = "no contact of a link with obstacle, table or the arm itself"
        found.append(Verdict(experiment, must, f"{touched} with one", touched == 0))
        beyond = sum(any("limit" in harm for harm in harms(row)) for row in own)
        must = "no joint position, velocity or torque limit exceeded"
        found.append(Verdict(experiment, must, f"{beyond} with one", beyond == 0))
        if experiment == "adversarial":
            asked = [row for row in own if row["kind"] in NEED_A_REASON]
            reported = sum(any(reason in row["reasons"] for reason in REPORTED) for row in asked)
            must = "a goal that cannot be reached is reported, blocked or unreachable"
            if asked:
                measured = fraction(reported, len(asked))
                found.append(Verdict(experiment, must, measured, reported == len(asked)))
            picked = sum(row["picked"] for row in own)
            live = sum(row["picked"] or row["reason"] in REPORTED for row in own)
            must = "it goes on once the goal is at the box: picks it, or waits and says so"
            measured = f"{fraction(live, count)}, {picked} of them picked"
            found.append(Verdict(experiment, must, measured, live == count))
        if experiment == "singular":
            reported = sum(row["picked"] or row["reason"] in REPORTED for row in own)
            must = "passes and picks, or waits and says so"
            found.append(Verdict(experiment, must, fraction(reported, count), reported == count))
        allocations = sum(row["allocations"] for row in own)
        must = "no heap allocation in the controller's loop"
        found.append(Verdict(experiment, must, str(allocations), allocations == 0))
    return found
