"""The long form of the tests of the Franka arm: for minutes it goes to its goal and away again.

The skill moves it, and in turn commands from outside. Prints what came of it and writes it to
FOLDER/soak.json. Exit code 0: it moved to the end, without a reflex, and no command was beyond what
an arm accepts; 1: otherwise.
"""

import argparse
import json
import random
import shutil
import sys
import time
from pathlib import Path

import numpy as np
from franka_rig import CONTROLLER, LEARNER, PYTHON, ROOT, Rig, config_of

from sim_bridge.franka.limits import (
    ACCELERATION_MAX_RAD_S2,
    JERK_MAX_RAD_S3,
    STEP_S,
    TORQUE_RATE_MAX_N_M_S,
)

AT_GOAL_S = 8.0
AWAY_S = 2.5
SPEED_M_S = 0.2
MOVED_MIN_RAD = 0.1


def drive(rig: Rig, model: Path, options: argparse.Namespace) -> dict:
    """Runs the programs for the time, and gives what was counted."""
    rig.serve()
    publisher = rig.publish(options.interface)
    run = (CONTROLLER, "run", config_of(options.interface, rig.folder), "--model", model)
    summary = rig.folder / "controller.json"
    controller = rig.start("controller", *run, "--instance", rig.instance, "--summary", summary)
    draw = random.Random(options.seed)
    until = time.monotonic() + 60.0 * options.minutes
    rounds = 0
    while time.monotonic() < until and publisher.poll() is None and controller.poll() is None:
        time.sleep(AT_GOAL_S)
        x, y, z = (draw.uniform(low, SPEED_M_S) for low in (-SPEED_M_S, -SPEED_M_S, 0.05))
        away = ("--linear", x, y, z, "--for-s", AWAY_S, "--instance", rig.instance)
        command = rig.start("away", PYTHON, "-m", "sim_bridge", "command", *away)
        command.wait()
        command.stdin.close()
        rounds += 1
    ended = {"controller": rig.end(controller), "publisher": None}
    seen = rig.seen()
    ended["publisher"] = rig.end(publisher)
    counts = json.loads((rig.folder / "publisher.json").read_text())
    largest = {key: float(seen[key]) for key in ("torque_step", "acceleration", "jerk")}
    reasons = json.loads(summary.read_text())["ticks_by_reason"]
    arrived = seen["arrived"][seen["moves"] > 0]
    late = float((arrived == 0).mean())
    moved = float(np.ptp(seen["q"], axis=0).max())
    return {
        "minutes": options.minutes,
        "interface": options.interface,
        "rounds": rounds,
        "exit_codes": ended,
        "publisher": counts,
        "largest": largest,
        "reasons": reasons,
        "commands_not_there_in_their_millisecond": late,
        "moved_at_the_end_rad": moved,
    }


def holds(result: dict) -> bool:
    """Whether there was no reflex, and no cause of one."""
    largest = result["largest"]
    return (
        result["exit_codes"] == {"controller": 0, "publisher": 0}
        and result["publisher"]["reflexes"] == 0
        # Of the last minute and a half: a controller that has latched a fault moves nothing.
        and result["moved_at_the_end_rad"] > MOVED_MIN_RAD
        and largest["torque_step"] <= TORQUE_RATE_MAX_N_M_S * STEP_S
        and largest["acceleration"] <= ACCELERATION_MAX_RAD_S2
        and largest["jerk"] <= JERK_MAX_RAD_S3
    )


def main() -> int:
    """Runs the soak; gives the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--interface", choices=("torque", "position"), default="torque")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "franka-soak")
    options = parser.parse_args()
    folder = options.out.resolve() / options.interface
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    rig = Rig(folder)
    try:
        model = folder / "pick.model.ron"
        skill = ROOT / "config" / "skills" / "pick.ron"
        rig.start("learner", LEARNER, "train", skill, "--out", model).wait()
        result = drive(rig, model, options)
    finally:
        rig.end_all()
    result["holds"] = holds(result)
    (folder / "soak.json").write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))
    return 0 if result["holds"] else 1


if __name__ == "__main__":
    sys.exit(main())
