"""The command ``ros_stl_monitor.py``: a monitor as a node of ROS 1 or ROS 2."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from typing import NoReturn, get_args

from rtamt import InputError
from rtamt.typing import SemanticsName
from rtamt_gym.commands.errors import options_in, refusal
from rtamt_ros.core.settings import Publishers, StaleAs
from rtamt_ros.generation import choose_generation, open_node, split_arguments
from rtamt_ros.node import MonitorNode
from rtamt_ros.parameters import PARAMETERS, UNITS, Qos, read
from rtamt_ros.process import shorten_pauses

_PROGRAM = "ros_stl_monitor.py"
_NODE = "stl_monitor"
_PARAMETERS_OF = {"stl": "spec_file"}  # the name in the paper


def main(argv: Sequence[str] | None = None) -> int:
    """Run a monitor until the node ends; return the exit code.

    Args:
        argv: The arguments; None for those of the program.

    Returns:
        0 after SIGINT or SIGTERM; 2 if an argument or a specification is wrong, with one message
        on standard error; otherwise, the code of `Middleware.spin`.
    """
    try:
        return _run(sys.argv[1:] if argv is None else argv)
    except Exception as error:
        message = refusal(error, options_in(_parser()))
        if message is None:
            raise
        print(f"{_PROGRAM}: error: {_with_options(message)}", file=sys.stderr)  # noqa: T201
        return 2


def _run(argv: Sequence[str]) -> int:
    parsed, ros_arguments = split_arguments(_parser(), argv)
    options = vars(parsed)
    requested = options.pop("ros", None)
    parameters = {_PARAMETERS_OF.get(name, name): value for name, value in options.items()}
    # Errors that do not need ROS are raised before a node waits for a master.
    defaults = {name: default for name, (default, _) in PARAMETERS.items()}
    specifications, settings = read({**defaults, **parameters})
    if not specifications and not ros_arguments.has_parameters:
        raise InputError("nothing to monitor: write --stl FILE or --spec TEXT")
    generation = choose_generation(requested)
    arguments = ros_arguments.for_generation(generation)
    if generation == 2:
        from rtamt_ros.ros2_lifecycle import run

        return run(_NODE, arguments, parameters)
    ros = open_node(generation, _NODE, arguments)
    try:
        node = MonitorNode(ros, specifications, settings)
        shorten_pauses()
        node.start()
        code = ros.spin()
        node.stop()
    finally:
        ros.close()
    return code


def _with_options(message: str) -> str:
    """Return a message with the names of options for those of parameters."""
    for option, parameter in _PARAMETERS_OF.items():
        message = re.sub(rf"^{parameter}: ", f"{option}: ", message)
    return re.sub(rf"^({'|'.join([*_PARAMETERS_OF, *PARAMETERS])}): ", r"--\1: ", message)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        end = "" if message.endswith("?") else ";"
        raise InputError(f"{message}{end} see {self.prog} --help")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog=_PROGRAM,
        usage="%(prog)s --stl FILE [--period N --unit UNIT] [option ...]",
        description="Monitors a robot: subscribes to the topics that specifications name, and "
        "publishes robustness, its bounds and verdicts until Ctrl-C.",
        epilog="Remappings go to ROS: odom:=robot1/odom on ROS 1, --ros-args -r odom:=robot1/odom "
        "on ROS 2.",
        argument_default=argparse.SUPPRESS,  # parameters have the defaults
        allow_abbrev=False,
    )
    monitoring = parser.add_argument_group("what to monitor")
    monitoring.add_argument(
        "--stl",
        action="append",
        metavar="FILE",
        help="a file with a specification; may be repeated",
    )
    monitoring.add_argument(
        "--spec",
        action="append",
        metavar="TEXT",
        help="the text of a specification; may be repeated",
    )
    monitoring.add_argument(
        "--semantics",
        choices=get_args(SemanticsName),
        metavar="NAME",
        help=f"the robustness of predicates: {', '.join(get_args(SemanticsName))}; those of inputs "
        f"and outputs need declarations in the specification (default: {_default('semantics')})",
    )
    sampling = parser.add_argument_group("when to sample")
    sampling.add_argument(
        "--period",
        type=_number,
        metavar="N",
        help=f"the time between samples (default: {_default('period')})",
    )
    sampling.add_argument(
        "--unit",
        choices=tuple(UNITS),
        help=f"the unit of the period (default: {_default('unit')})",
    )
    sampling.add_argument(
        "--align",
        choices=("outward", "inward", "nearest"),
        help="the rounding of bounds that are not multiples of the period (default: an error)",
    )
    sampling.add_argument(
        "--dense",
        action="store_true",
        help="do not sample: each message is an event at its time",
    )
    sampling.add_argument(
        "--stamps",
        action="store_true",
        help="take the time of a message from its header; otherwise, it is the time of arrival",
    )
    sampling.add_argument(
        "--stale",
        action="append",
        metavar="SECONDS",
        help="the time without a message after which an input is stale, and its requirements have "
        "no robustness; TOPIC=SECONDS sets it for one topic; may be repeated (default: five "
        "periods, at least 0.5)",
    )
    sampling.add_argument(
        "--stale-as",
        choices=get_args(StaleAs),
        help="the effect of a stale input: restart ends the run, and a new run starts with its "
        "next message; unknown continues the run with an unknown value, so bounds and verdict hold "
        f"for every possible value (default: {_default('stale_as')})",
    )
    sampling.add_argument(
        "--record",
        metavar="FILE.csv",
        help="a file for times, variables and robustness of every sample",
    )
    ros = parser.add_argument_group("ROS")
    ros.add_argument(
        "--ros",
        type=int,
        choices=(1, 2),
        help="ROS 1 or ROS 2 (default: the installed one)",
    )
    ros.add_argument(
        "--combined",
        metavar="TOPIC",
        help="a topic for one diagnostic_msgs/DiagnosticArray per sample with all requirements",
    )
    ros.add_argument(
        "--publishers",
        choices=get_args(Publishers),
        help="the reaction to several publishers of a topic: any warns and mixes their messages, "
        f"one evaluates nothing until one publisher is left (default: {_default('publishers')})",
    )
    ros.add_argument(
        "--depth",
        type=_count,
        metavar="N",
        help="the number of messages of a topic that wait on ROS 2 before the oldest is dropped "
        f"(default: {_default('depth')})",
    )
    ros.add_argument(
        "--qos",
        choices=get_args(Qos),
        help="subscriptions of ROS 2: best_effort receives from every publisher; reliable receives "
        "from reliable publishers only, and repairs losses of the network; a full queue still "
        "drops messages: see --depth "
        f"(default: {_default('qos')})",
    )
    return parser


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected a number, got {text!r}; 100 ms is --period 100 --unit ms"
        ) from None


def _count(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text!r}") from None


def _default(parameter: str) -> object:
    return PARAMETERS[parameter][0]
