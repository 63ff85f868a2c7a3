"""The command line of the simulated robots, ``python -m rtamt_ros.simulator``."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence

from rtamt_envs.mobile_robot import SCENARIO as ONE
from rtamt_envs.two_service_robots import SCENARIO as TWO

from rtamt import InputError
from rtamt_ros.generation import chosen, open_node, split
from rtamt_ros.middleware import Middleware
from rtamt_ros.simulator.robots import (
    Robot,
    RobotController,
    ServiceController,
    ServiceRobots,
    Stuck,
    Surge,
    checked_row,
)

_ROBOT, _TWO = "mobile-robot", "two-service-robots"


def _stuck(text: str) -> Stuck:
    """Parse ``BEGIN:DURATION``."""
    return Stuck(*_numbers(text, ("BEGIN", "DURATION"), "5:1"))


def _surge(text: str) -> Surge:
    """Parse ``BEGIN:DURATION:SPEED``."""
    return Surge(*_numbers(text, ("BEGIN", "DURATION", "SPEED"), "5:1:-0.5"))


def _numbers(text: str, names: Sequence[str], example: str) -> list[float]:
    """Parse numbers between colons: a start, a duration, and others."""
    try:
        begin, duration, *_ = numbers = list(map(float, text.split(":")))
        good = begin >= 0 and duration > 0 and all(map(math.isfinite, numbers))
    except ValueError:
        good = False
    if not good or len(numbers) != len(names):
        raise argparse.ArgumentTypeError(
            f"expected {':'.join(names)} in seconds, such as {example}, got {text!r}"
        )
    return numbers


def _parser(model: str = _ROBOT) -> argparse.ArgumentParser:
    """Return the parser of a model."""
    is_robot = model == _ROBOT
    scenario = ONE if is_robot else TWO
    subject = (
        "A robot that drives through two rooms, and its controller,"
        if is_robot
        else "Two robots that carry things through one room, and their controller,"
    )
    parser = argparse.ArgumentParser(
        prog="python -m rtamt_ros.simulator",
        description=f"{subject} as a node of ROS. It runs until Ctrl-C.",
        epilog="Remappings go to ROS: robot0/odom:=odom on ROS 1, --ros-args -r robot0/odom:=odom "
        "on ROS 2.",
        allow_abbrev=False,
    )
    parser.add_argument("--only", choices=("robot", "controller"), help="one of both")
    parser.add_argument(
        "--ros", type=int, choices=(1, 2), help="its generation (default: what is installed)"
    )
    parser.add_argument(
        "--model",
        choices=(_ROBOT, _TWO),
        default=_ROBOT,
        help=f"what is simulated (default: {_ROBOT}); each has options of its own: "
        "--model NAME --help",
    )
    name = "robot0" if is_robot else "robot"
    meaning = "namespace of the topics" if is_robot else "the topics are in NAME0 and NAME1"
    parser.add_argument("--name", default=name, help=f"{meaning} (default: {name})")
    for parameter in scenario.parameters:
        unit = f" in {parameter.unit}" if parameter.unit else ""
        parser.add_argument(
            f"--{parameter.name.replace('_', '-')}",
            type=float,
            default=parameter.default,
            metavar="X",
            help=f"{parameter.about}{unit} (default: {parameter.default:g})",
        )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the noise")
    if not is_robot:
        return parser
    parser.add_argument(
        "--stuck",
        type=_stuck,
        metavar="BEGIN:DURATION",
        help="seconds from the first command after which the wheels are blocked, and for how many",
    )
    parser.add_argument(
        "--surge",
        type=_surge,
        metavar="BEGIN:DURATION:SPEED",
        help="seconds from the first odometry after which this speed in m/s is commanded, and for "
        "how many",
    )
    return parser


def _fill(
    node: Middleware, model: str, options: argparse.Namespace, parameters: Mapping[str, float]
) -> None:
    """Add the robots and the controller of a model to a node, or one of them."""
    moves, drives = options.only != "controller", options.only != "robot"
    if model == _TWO:
        if moves:
            ServiceRobots(node, options.name, parameters=parameters, seed=options.seed)
        if drives:
            ServiceController(node, options.name, parameters=parameters)
        return
    if moves:
        Robot(node, options.name, parameters=parameters, seed=options.seed, stuck=options.stuck)
    if drives:
        RobotController(node, options.name, surge=options.surge)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the robots, the controller or both until the node ends; return the exit code.

    Args:
        arguments: The words of a command line; None for those of the program.
    """
    words = sys.argv[1:] if arguments is None else arguments
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    first.add_argument("--model", default=_ROBOT)
    model = first.parse_known_args(words)[0].model
    parser = _parser(model)
    options, of_ros = split(parser, words)
    scenario = ONE if model == _ROBOT else TWO
    parameters = {
        parameter.name: getattr(options, parameter.name) for parameter in scenario.parameters
    }
    try:
        checked_row(scenario, parameters, options.seed)  # before a node waits for a master
        generation = chosen(options.ros)
        node = open_node(generation, options.only or "simulator", of_ros.of(generation))
        _fill(node, model, options, parameters)
    except InputError as error:
        parser.error(str(error))
    code = node.spin()
    node.close()
    return code
