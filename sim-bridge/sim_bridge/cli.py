"""Command line of the bridge.

What a command needs is imported when it runs: help and errors of the command line need neither
pybullet nor iceoryx2.
"""

from __future__ import annotations

import argparse
import signal
import sys
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from sim_bridge.errors import BridgeError
from sim_bridge.files import StandardStreams, printable

if TYPE_CHECKING:
    from sim_bridge.joints import Joints

UNTRIED = "Not run on hardware yet."
PYTHON_MIN = (3, 9)
PYTHON_END = (3, 12)

_DESCRIPTION = """\
Simulates a UR5 with a suction cup, a moving box and a moving sphere, publishes its
state to a controller over shared memory, and applies the controller's commands.

  1. sim-bridge record   demonstrates the skill: a scripted expert picks the box, recorded as files
  2. learner train       learns the skill from these files (another program)
  3. sim-bridge run      simulates the arm; beside it, `controller run` moves it
  4. sim-bridge report   draws pictures of the run
"""

_Options = TypeVar("_Options")


def main(arguments: list[str] | None = None) -> int:
    """Runs a command and gives the exit code."""
    if not PYTHON_MIN <= sys.version_info[:2] < PYTHON_END:
        print(
            "sim-bridge: expected Python 3.9, 3.10 or 3.11, for which pybullet has packages; "
            f"this is Python {sys.version_info[0]}.{sys.version_info[1]}",
            file=sys.stderr,
        )
        return 2
    if arguments is not None:
        return _execute(arguments)
    # As a program of its own: whoever reads it may go away, and every end is an orderly one.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    with StandardStreams() as streams:
        code = _execute(arguments)
        return 2 if code == 0 and streams.lost else code


def _execute(arguments: list[str] | None) -> int:
    parsed = _parser().parse_args(arguments)
    try:
        return parsed.action(parsed)
    except BridgeError as error:
        print(f"sim-bridge: {printable(str(error))}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sim-bridge",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for add in (
        _add_run,
        _add_record,
        _add_replay,
        _add_command,
        _add_report,
        _add_fit,
        _add_experiments,
        _add_franka,
        _add_ur,
        _add_ur_server,
    ):
        add(commands)
    return parser


def _add_run(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "run",
        help="simulate one episode for a controller",
        description="Simulates one episode for a controller that runs beside it, and judges it. "
        "Exit code 0: the box was gripped, lifted and held without touching the sphere, or a "
        "signal ended the run; 1: it was not; 2: bad input or no controller.",
    )
    parser.set_defaults(action=_run)
    _add_scene(parser)
    parser.add_argument(
        "--seed", type=int, required=True, help="draws where box and sphere are and how they move"
    )
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for log.npz and bridge.json"
    )
    parser.add_argument(
        "--instance",
        default="default",
        help="name that this bridge and its controller use (default: %(default)s)",
    )
    parser.add_argument(
        "--lockstep",
        action="store_true",
        help="simulated clock: each state waits for its command (start the controller with "
        "--lockstep too); without it, real time",
    )
    parser.add_argument(
        "--wait-s",
        type=float,
        default=60.0,
        help="how long to wait for the controller's first command [s] (default: %(default)s)",
    )
    _add_priority(parser)
    parser.add_argument(
        "--record-commands",
        type=Path,
        metavar="FILE",
        help="with --lockstep: writes the raw bytes of all commands, one after the other",
    )
    _add_joints(parser)
    _add_force(parser, "another run's files")


def _add_priority(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--priority",
        type=int,
        metavar="N",
        help="SCHED_FIFO priority of the real-time loop, 1 to 99, or 0 for normal scheduling "
        "(default: 40 if this user may, normal scheduling otherwise)",
    )


def _add_joints(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("joints as real arms have them, with --simulator mujoco")
    group.add_argument(
        "--simulator",
        choices=("pybullet", "mujoco"),
        default="pybullet",
        help="the physics; joints of pybullet's arm have no friction and no rotors "
        "(default: %(default)s)",
    )
    group.add_argument(
        "--interface",
        default="torque",
        metavar="torque|position|velocity",
        help="which part of a command the arm obeys (default: %(default)s)",
    )
    for option, what in (
        ("--friction", "friction of each joint [N m]"),
        ("--friction-fraction", "the same, as a fraction of the joint's effort; both are added"),
        ("--viscous", "friction in proportion to the speed [N m s/rad]"),
        ("--armature", "inertia of each rotor at its joint [kg m²]"),
        ("--payload-kg", "mass in the tool that the controller does not know of [kg]"),
        ("--mass-error", "masses are the description's times one plus this"),
        ("--servo-lag-s", "time constant of a position or velocity servo [s]"),
    ):
        group.add_argument(option, type=float, metavar="X", help=f"{what} (default: none)")


def _joints(parsed: argparse.Namespace) -> Joints | None:
    """Of the arm in MuJoCo; refuses them beside another simulator."""
    from sim_bridge.joints import Joints

    names = [item.name for item in fields(Joints) if item.name != "interface"]
    given = {name: getattr(parsed, name) for name in names if getattr(parsed, name) is not None}
    if parsed.simulator == "mujoco":
        joints = Joints(parsed.interface, **given)
        joints.check()
        return joints
    if given or parsed.interface != "torque":
        option = "--" + next(iter(given), "interface").replace("_", "-")
        raise BridgeError(f"{option} needs --simulator mujoco: pybullet's joints have none of it")
    return None


def _run(parsed: argparse.Namespace) -> int:
    from sim_bridge.run import Options, run
    from sim_bridge.scene import load_scene

    scene = load_scene(parsed.scene)
    if parsed.record_commands is not None and not parsed.lockstep:
        raise BridgeError("--record-commands needs --lockstep: only then is every command seen")
    parsed.joints = _joints(parsed)
    return run(scene, _options(Options, parsed))


def _add_record(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "record",
        help="let the scripted expert demonstrate the skill",
        description="Lets a scripted expert pick the box a few times and writes what the tool "
        "did, one demonstration a file. Each one is checked: gripped on contact, then lifted.",
    )
    parser.set_defaults(action=_record)
    _add_scene(parser)
    parser.add_argument(
        "--out", type=Path, help="folder for 01.json, 02.json, … (default: the scene's)"
    )
    parser.add_argument("--count", type=int, help="how many (default: the scene's)")
    parser.add_argument("--seed", type=int, help="draws the box poses (default: the scene's)")
    parser.add_argument(
        "--gripper",
        action="store_true",
        help="write what the gripper does, up to a sample in which it holds the box",
    )
    _add_force(parser, "demonstrations of the same names in the folder")


def _record(parsed: argparse.Namespace) -> int:
    from sim_bridge.record import record
    from sim_bridge.scene import load_scene

    scene = load_scene(parsed.scene)
    count = scene.record.count if parsed.count is None else parsed.count
    _check_whole("--count", count, 1)
    seed = scene.record.seed if parsed.seed is None else parsed.seed
    out = parsed.out or scene.task.demonstrations
    record(scene, out, count, seed, force=parsed.force, gripper=parsed.gripper)
    return 0


def _add_replay(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "replay",
        help="publish a recorded run again; commands move nothing",
        description="Publishes states and frames of a run again, at their own pace: a controller "
        "beside it says what it would command, and moves nothing. Exit code 0: all was published, "
        "or a signal ended it; 2: bad input.",
    )
    parser.set_defaults(action=_replay)
    parser.add_argument("run", type=Path, help="what `sim-bridge run --out` wrote")
    parser.add_argument(
        "--instance", default="default", help="name of the running system (default: %(default)s)"
    )
    parser.add_argument("--loop", action="store_true", help="again and again, until a signal")


def _replay(parsed: argparse.Namespace) -> int:
    from sim_bridge.replay import Options, replay

    return replay(_options(Options, parsed))


def _add_command(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "command",
        help="command a velocity of the tool beside the skill",
        description="Commands a velocity of the tool to a running controller, which gives it "
        "weight beside its skill, as far as obstacles and limits permit; afterwards the skill goes "
        "on from there. Exit code 0: it was sent for the given time, or a signal ended it; 2: bad "
        "input, or nobody listens.",
    )
    parser.set_defaults(action=_command)
    parser.add_argument(
        "--instance", default="default", help="name of the running system (default: %(default)s)"
    )
    for option, unit in (("linear", "m/s"), ("angular", "rad/s")):
        parser.add_argument(
            f"--{option}",
            type=float,
            nargs=3,
            dest=f"{option}_{unit.replace('/', '_')}",
            default=(0.0, 0.0, 0.0),
            metavar=("X", "Y", "Z"),
            help=f"in the robot's base frame [{unit}] (default: 0 0 0, which asks to stand still)",
        )
    parser.add_argument("--for-s", type=float, required=True, help="how long [s]")
    parser.add_argument(
        "--rate-hz", type=float, default=100.0, help="how often it is sent (default: %(default)s)"
    )
    parser.add_argument(
        "--wait-s",
        type=float,
        default=10.0,
        help="how long to wait for a robot and its controller [s] (default: %(default)s)",
    )


def _command(parsed: argparse.Namespace) -> int:
    from sim_bridge.command import Options, command

    return command(_options(Options, parsed))


def _add_franka(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "franka",
        help="publish the state of a Franka arm and move it (not run on hardware yet)",
        description="Connects to a Franka FR3 by libfranka, publishes its state and the frames of "
        "a cell file, and moves it as a controller commands: by torques or by joint positions. "
        "Begins slow: the arm brakes where a joint is faster than a fifth of its greatest speed. "
        "After a reflex it does not move again before it was started with --recover. Exit code 0: "
        "a signal ended it; 1: after a reflex; 2: bad input, or no arm.",
    )
    _say_untried(parser)
    parser.set_defaults(action=_franka)
    parser.add_argument("--address", required=True, help="IP address of the arm's controller")
    parser.add_argument(
        "--scene", type=Path, required=True, help="cell file, e.g. config/scenes/cell_fr3.json"
    )
    parser.add_argument(
        "--instance", default="default", help="name that it and its controller use (%(default)s)"
    )
    parser.add_argument(
        "--interface",
        choices=("torque", "position"),
        default="torque",
        help="what the arm is commanded by (default: %(default)s)",
    )
    parser.add_argument(
        "--gripper",
        choices=("hand", "none"),
        default="hand",
        help="the Franka Hand, or nothing that grips (default: %(default)s)",
    )
    parser.add_argument(
        "--real-time",
        choices=("enforce", "ignore"),
        default="enforce",
        help="whether libfranka asks for a real-time kernel (default: %(default)s)",
    )
    parser.add_argument("--full-speed", action="store_true", help="leave the slow mode")
    parser.add_argument(
        "--recover", action="store_true", help="you have looked at the arm: confirm its reflex"
    )
    parser.add_argument(
        "--priority", type=int, default=40, help="SCHED_FIFO priority, 0: none (%(default)s)"
    )
    parser.add_argument("--summary", type=Path, help="JSON file for what was counted")
    _add_force(parser, "the summary of another run")


def _franka(parsed: argparse.Namespace) -> int:
    from sim_bridge.franka.drive import Options, run

    _check_whole("--priority", parsed.priority, 0)
    return run(_options(Options, parsed))


def _add_report(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "report",
        help="judge a run and draw pictures of it",
        description="Judges the run in the folder that `run` wrote, from its log, the controller's "
        "summary (controller.json) and the demonstrations. Prints a table and writes result.json, "
        "report.html and demo.png into the folder. Exit code 0: the pick succeeded; 1: it failed; "
        "2: bad input.",
    )
    parser.set_defaults(action=_report)
    parser.add_argument("folder", type=Path, metavar="DIR", help="the folder given to run as --out")


def _report(parsed: argparse.Namespace) -> int:
    from sim_bridge.report.report import report

    return report(parsed.folder)


def _add_fit(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "fit",
        help="fit a tool to an arm of pybullet's data package",
        description="Writes the description of an arm that pybullet's data package brings, with a "
        "tool of another description on its flange.",
    )
    parser.set_defaults(action=_fit)
    parser.add_argument("file", type=Path, help="e.g. config/robots/panda_suction.json")
    parser.add_argument("--out", type=Path, required=True, help="URDF to be written")


def _fit(parsed: argparse.Namespace) -> int:
    from sim_bridge.fit import fit

    fit(parsed.file, parsed.out)
    return 0


def _add_experiments(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "experiments",
        help="run the experiments of the whole arm",
        description="Runs seeded episodes in lockstep, each with a controller of its own, on all "
        "cores: picks with a moving ball and pushes, the same on other arms, goals where none "
        "should be, starts near singularities. Writes arm.json and arm.html. Exit code 0: all "
        "that must hold does; 1: it does not; 2: bad input.",
    )
    parser.set_defaults(action=_experiments)
    parser.add_argument("--model", type=Path, required=True, help="what the learner wrote")
    for option, default, what in (
        ("--controller", "target/release/controller", "the program"),
        ("--config", "config", "folder"),
        ("--out", "target/experiments", "folder for the results"),
    ):
        parser.add_argument(
            option, type=Path, default=Path(default), help=f"{what} (default: %(default)s)"
        )
    _add_force(parser, "another run's files in the folder")
    parser.add_argument("--quick", action="store_true", help="a short look")
    parser.add_argument(
        "--seed", type=int, default=0, help="first seed of each experiment (default: %(default)s)"
    )
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="only this one; may be repeated"
    )
    parser.add_argument("--workers", type=int, help="episodes at once (default: one a core)")


def _experiments(parsed: argparse.Namespace) -> int:
    from sim_bridge.experiments.episode import Settings
    from sim_bridge.experiments.runner import EXPERIMENTS, experiments, workers_of_this_machine

    names = [experiment.name for experiment in EXPERIMENTS]
    for name in parsed.only:
        if name not in names:
            raise BridgeError(f"--only: expected one of {', '.join(names)}, found `{name}`")
    if parsed.workers is None:
        parsed.workers = workers_of_this_machine()
    _check_whole("--seed", parsed.seed, 0)
    _check_whole("--workers", parsed.workers, 1)
    parsed.controller = parsed.controller.resolve()
    return experiments(_options(Settings, parsed))


def _add_ur(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "ur",
        help="publish the state of a Universal Robots arm (not run on hardware yet)",
        description="Publishes the state of a Universal Robots arm (CB3 at 125 Hz, e-Series at "
        "500 Hz) and fixed task frames, and obeys commands by servoJ or speedJ. Commands that are "
        "faster than --speed-fraction are refused. Exit code 0: a signal ended it; 2: bad input, "
        "or the robot is gone.",
    )
    _say_untried(parser)
    parser.set_defaults(action=_ur)
    parser.add_argument("--host", required=True, help="address of the robot, e.g. 192.168.0.10")
    _add_frames(parser, required=True)
    parser.add_argument(
        "--instance", default="default", help="name of the running system (default: %(default)s)"
    )
    _add_priority(parser)
    parser.add_argument(
        "--speed-fraction",
        type=float,
        default=0.2,
        help="greatest joint speeds, of the description's (default: %(default)s); begin with this, "
        "and raise `velocity_fraction` of the controller's configuration only with it",
    )
    parser.add_argument(
        "--interface",
        default="position",
        metavar="position|velocity",
        help="servoJ or speedJ (default: %(default)s)",
    )
    for option, default, what in (
        ("--lookahead-s", 0.1, "lookahead_time of servoJ, 0.03 to 0.2 [s]"),
        ("--gain", 300.0, "gain of servoJ, 100 to 2000"),
        ("--acceleration-rad-s2", 10.0, "of speedJ and of stops [rad/s²]"),
    ):
        parser.add_argument(
            option, type=float, default=default, help=f"{what} (default: %(default)s)"
        )
    for option, what in (
        ("--gripper-output", "digital output that grips; without it there is no gripper"),
        ("--gripper-input", "digital input that says that something is held; without it, what "
         "grips is taken to hold"),
    ):  # fmt: skip
        parser.add_argument(
            option, type=int, metavar="N", help=f"{what} (0 to 7 standard, 8 and 9 of the tool)"
        )


def _ur(parsed: argparse.Namespace) -> int:
    from sim_bridge.ur.publisher import Options, publish

    print(UNTRIED, file=sys.stderr, flush=True)
    return publish(_options(Options, parsed))


def _add_ur_server(commands: argparse._SubParsersAction) -> None:
    parser = commands.add_parser(
        "ur-server",
        help="stand in for a Universal Robots arm, to try `ur` without one",
        description="Answers at the ports of a Universal Robots arm (RTDE 30004, scripts 30001 to "
        "30003, dashboard 29999), with joints that move like servos and no masses.",
    )
    parser.set_defaults(action=_ur_server)
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen at (default: %(default)s)"
    )
    parser.add_argument(
        "--series",
        choices=("cb3", "e"),
        default="e",
        help="125 or 500 states a second (default: %(default)s)",
    )
    parser.add_argument(
        "--home-rad",
        type=float,
        nargs=6,
        default=[-2.7416, -1.5708, 1.5708, -1.5708, -1.5708, 0.4],
        metavar="Q",
        help="where the joints are at the start [rad] (default: as in config/scenes/pick.json)",
    )
    _add_frames(parser, required=False)
    parser.add_argument(
        "--seals",
        nargs=2,
        metavar=("FRAME", "HEIGHT_M"),
        help="a vacuum at output 0 seals where the tip comes down to HEIGHT_M above FRAME, as "
        "input 0 says",
    )


def _ur_server(parsed: argparse.Namespace) -> int:
    from sim_bridge.ur.stand_in import Options, stand_in

    return stand_in(_options(Options, parsed))


def _say_untried(parser: argparse.ArgumentParser) -> None:
    """Lets the help begin with what was never tried."""
    usage = parser.format_help
    parser.format_help = lambda: f"{UNTRIED}\n\n{usage()}"


def _add_frames(parser: argparse.ArgumentParser, *, required: bool) -> None:
    parser.add_argument(
        "--scene",
        type=Path,
        required=required,
        help="file of fixed task frames, e.g. config/scenes/cell_ur5.json",
    )


def _add_scene(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scene", type=Path, required=True, help="scene file, e.g. config/scenes/pick.json"
    )


def _add_force(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--force", action="store_true", help=f"replace {what}")


def _check_whole(option: str, value: int, least: int) -> None:
    if value < least:
        raise BridgeError(f"{option}: expected a whole number of {least} or more, found {value}")


def _options(kind: type[_Options], parsed: argparse.Namespace) -> _Options:
    """What the command line says, for the fields of `kind`."""
    given = vars(parsed)
    return kind(**{item.name: given[item.name] for item in fields(kind) if item.name in given})
