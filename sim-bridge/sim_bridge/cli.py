"""Command line of the bridge."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

PYTHON_MIN = (3, 9)
PYTHON_END = (3, 12)

_DESCRIPTION = """\
Simulates a UR5 with a suction cup, a moving box and a moving sphere in pybullet, publishes its
state to a controller over shared memory, and applies the controller's commands.

  1. sim-bridge record   shows the skill: a scripted expert picks the box, recorded as files
  2. learner train       learns the skill from these files (another program)
  3. sim-bridge run      simulates the arm; beside it, `controller run` moves it
  4. sim-bridge report   draws pictures of the run
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sim-bridge",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    run = commands.add_parser(
        "run",
        help="simulate one episode for a controller",
        description="Simulates one episode for a controller that runs beside it, and judges it. "
        "Exit code 0: the box was gripped, lifted and held without touching the sphere, or a "
        "signal ended the run; 1: it was not; 2: bad input or no controller.",
    )
    _scene(run)
    run.add_argument(
        "--seed", type=int, required=True, help="draws where box and sphere are and how they move"
    )
    run.add_argument("--out", type=Path, required=True, help="folder for log.npz and bridge.json")
    run.add_argument(
        "--instance",
        default="default",
        help="name this bridge and its controller share (default: %(default)s)",
    )
    run.add_argument(
        "--lockstep",
        action="store_true",
        help="simulated clock: each state waits for its command (start the controller with "
        "--lockstep too); without it, real time",
    )
    run.add_argument(
        "--wait-s",
        type=float,
        default=60.0,
        help="how long to wait for the controller's first command [s] (default: %(default)s)",
    )
    run.add_argument(
        "--priority",
        type=int,
        metavar="N",
        help="SCHED_FIFO priority of the real-time loop, 1 to 99, or 0 for normal scheduling "
        "(default: 40 if this user may, normal scheduling otherwise)",
    )
    run.add_argument(
        "--record-commands",
        type=Path,
        metavar="FILE",
        help="with --lockstep: writes the raw bytes of all commands, one after the other",
    )

    record = commands.add_parser(
        "record",
        help="let the scripted expert show the skill",
        description="Lets a scripted expert pick the box a few times and writes what the tool "
        "did, one demonstration a file. Each one is checked: gripped on contact, then lifted.",
    )
    _scene(record)
    record.add_argument(
        "--out", type=Path, help="folder for 01.json, 02.json, … (default: the scene's)"
    )
    record.add_argument("--count", type=int, help="how many (default: the scene's)")
    record.add_argument("--seed", type=int, help="draws the box poses (default: the scene's)")

    command = commands.add_parser(
        "command",
        help="command a velocity of the tool beside the skill",
        description="Commands a velocity of the tool to a running controller, which gives it "
        "weight beside its skill, as far as obstacles and limits permit; afterwards the skill goes "
        "on from there. Exit code 0: it was sent for the given time, or a signal ended it; 2: bad "
        "input, or nobody listens.",
    )
    command.add_argument(
        "--instance", default="default", help="name of the running system (default: %(default)s)"
    )
    for option, unit in (("--linear", "m/s"), ("--angular", "rad/s")):
        command.add_argument(
            option,
            type=float,
            nargs=3,
            default=(0.0, 0.0, 0.0),
            metavar=("X", "Y", "Z"),
            help=f"in the robot's base frame [{unit}] (default: 0 0 0, which asks to stand still)",
        )
    command.add_argument("--for-s", type=float, required=True, help="how long [s]")
    command.add_argument(
        "--rate-hz", type=float, default=100.0, help="how often it is sent (default: %(default)s)"
    )
    command.add_argument(
        "--wait-s",
        type=float,
        default=10.0,
        help="how long to wait for a robot and its controller [s] (default: %(default)s)",
    )

    report = commands.add_parser(
        "report",
        help="judge a run and draw pictures of it",
        description="Judges the run in the folder that `run` wrote, from its log, the controller's "
        "summary (controller.json) and the demonstrations. Prints a table and writes result.json, "
        "report.html and demo.png into the folder. Exit code 0: the pick succeeded; 1: it failed; "
        "2: bad input.",
    )
    report.add_argument("folder", type=Path, metavar="DIR", help="the folder given to run as --out")

    fit = commands.add_parser(
        "fit",
        help="fit a tool to an arm of pybullet's data package",
        description="Writes the description of an arm that pybullet's data package brings, with a "
        "tool of another description on its flange.",
    )
    fit.add_argument("file", type=Path, help="e.g. config/robots/panda_suction.json")
    fit.add_argument("--out", type=Path, required=True, help="URDF to be written")

    experiments = commands.add_parser(
        "experiments",
        help="run the experiments of the whole arm",
        description="Runs seeded episodes in lockstep, each with a controller of its own, on all "
        "cores: picks with a moving ball and pushes, the same on other arms, goals where none "
        "should be, starts near singularities. Writes arm.json and arm.html. Exit code 0: all "
        "that must hold does; 1: it does not; 2: bad input.",
    )
    experiments.add_argument("--model", type=Path, required=True, help="what the learner wrote")
    experiments.add_argument(
        "--controller",
        type=Path,
        default=Path("target/release/controller"),
        help="the program (default: %(default)s)",
    )
    experiments.add_argument(
        "--config", type=Path, default=Path("config"), help="folder (default: %(default)s)"
    )
    experiments.add_argument(
        "--out",
        type=Path,
        default=Path("target/experiments"),
        help="folder for the results (default: %(default)s)",
    )
    experiments.add_argument("--quick", action="store_true", help="a short look")
    experiments.add_argument(
        "--seed", type=int, default=0, help="first seed of each experiment (default: %(default)s)"
    )
    experiments.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="only this one; may be repeated"
    )
    experiments.add_argument("--workers", type=int, help="episodes at once (default: one a core)")
    return parser


def _scene(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scene", type=Path, required=True, help="scene file, e.g. config/scenes/pick.json"
    )


def main(arguments: list[str] | None = None) -> int:
    """Runs a command and gives the exit code."""
    if not PYTHON_MIN <= sys.version_info[:2] < PYTHON_END:
        print(
            "sim-bridge: expected Python 3.9, 3.10 or 3.11, for which pybullet has packages; "
            f"this is Python {sys.version_info[0]}.{sys.version_info[1]}",
            file=sys.stderr,
        )
        return 2
    parsed = _parser().parse_args(arguments)

    from sim_bridge.errors import BridgeError

    try:
        return _dispatch(parsed)
    except BridgeError as error:
        print(f"sim-bridge: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _dispatch(parsed: argparse.Namespace) -> int:
    # Imported here: help and errors of the command line need neither pybullet nor iceoryx2.
    from sim_bridge.errors import BridgeError

    if parsed.command == "report":
        from sim_bridge.report import report

        return report(parsed.folder)

    if parsed.command == "command":
        from sim_bridge.command import Options as Command
        from sim_bridge.command import command

        return command(
            Command(
                instance=parsed.instance,
                linear_m_s=tuple(parsed.linear),
                angular_rad_s=tuple(parsed.angular),
                for_s=parsed.for_s,
                rate_hz=parsed.rate_hz,
                wait_s=parsed.wait_s,
            )
        )

    if parsed.command == "fit":
        from sim_bridge.fit import fit

        fit(parsed.file, parsed.out)
        return 0

    if parsed.command == "experiments":
        return _experiments(parsed)

    from sim_bridge.scene import load_scene

    scene = load_scene(parsed.scene)
    if parsed.command == "record":
        from sim_bridge.record import record

        count = scene.record.count if parsed.count is None else parsed.count
        if count < 1:
            raise BridgeError(f"--count: expected a whole number of 1 or more, found {count}")
        seed = scene.record.seed if parsed.seed is None else parsed.seed
        record(scene, parsed.out or scene.task.demonstrations, count, seed)
        return 0

    from sim_bridge.run import Options, run

    if parsed.record_commands is not None and not parsed.lockstep:
        raise BridgeError("--record-commands needs --lockstep: only then is every command seen")
    return run(
        scene,
        Options(
            seed=parsed.seed,
            out=parsed.out,
            instance=parsed.instance,
            lockstep=parsed.lockstep,
            wait_s=parsed.wait_s,
            priority=parsed.priority,
            record_commands=parsed.record_commands,
        ),
    )


def _experiments(parsed: argparse.Namespace) -> int:
    from sim_bridge.errors import BridgeError
    from sim_bridge.experiments.runner import (
        EXPERIMENTS,
        Settings,
        experiments,
        workers_of_this_machine,
    )

    names = [experiment.name for experiment in EXPERIMENTS]
    for name in parsed.only:
        if name not in names:
            raise BridgeError(f"--only: expected one of {', '.join(names)}, found `{name}`")
    workers = workers_of_this_machine() if parsed.workers is None else parsed.workers
    for option, value, least in (("--seed", parsed.seed, 0), ("--workers", workers, 1)):
        if value < least:
            raise BridgeError(
                f"{option}: expected a whole number of {least} or more, found {value}"
            )
    return experiments(
        Settings(
            config=parsed.config,
            controller=parsed.controller.resolve(),
            model=parsed.model,
            out=parsed.out,
            first_seed=parsed.seed,
            quick=parsed.quick,
            only=tuple(parsed.only),
            workers=workers,
        )
    )
