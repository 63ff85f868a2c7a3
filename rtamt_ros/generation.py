"""The choice between ROS 1 and ROS 2, and their arguments."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Literal, NamedTuple

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_ros.middleware import Middleware

Generation = Literal[1, 2]

_LIBRARIES: dict[Generation, str] = {1: "rospy", 2: "rclpy"}
_INSTALL = {
    1: "apt-get install python3-rospy python3-diagnostic-msgs (Debian), or source the setup.bash "
    "of ROS 1",
    2: "source the setup.bash of ROS 2",
}
_UNSEEN = "; a virtual environment needs --system-site-packages to import it"


def choose_generation(requested: int | None) -> Generation:
    """Return the requested generation of ROS, or the installed one for None.

    If both are installed, the variable ``ROS_VERSION`` decides, which both setup files set.

    Raises:
        InputError: If the generation is not installed, or both are and ``ROS_VERSION`` is not set.
    """
    present = [generation for generation, library in _LIBRARIES.items() if find_spec(library)]
    for generation, library in _LIBRARIES.items():
        if requested == generation and generation not in present:
            how = f"{_INSTALL[generation]}{_UNSEEN}"
            raise InputError(f"ROS {generation} needs {library}, which is not installed: {how}")
    if requested is None and len(present) == len(_LIBRARIES):
        requested = {"1": 1, "2": 2}.get(os.environ.get("ROS_VERSION", ""))
        if requested is None:
            raise InputError("ROS 1 and ROS 2 are both installed: write --ros 1 or --ros 2")
    if requested is None and not present:
        raise InputError(
            "expected rospy of ROS 1 or rclpy of ROS 2, found neither. "
            f"ROS 1: {_INSTALL[1]}. ROS 2: {_INSTALL[2]}{_UNSEEN}"
        )
    return next(generation for generation in present if requested in (None, generation))


def open_node(generation: Generation, name: str, arguments: Sequence[str]) -> Middleware:
    """Create a node of ROS 1 or ROS 2."""
    if generation == 1:
        from rtamt_ros.ros1 import Ros1

        return Ros1(name, arguments)
    from rtamt_ros.ros2 import Ros2

    return Ros2(name, arguments)


class RosArguments(NamedTuple):
    """The arguments of a command line for ROS.

    Attributes:
        remappings: For ROS 1: ``odom:=robot1/odom``.
        arguments: For ROS 2: ``--ros-args`` and the words after it, up to ``--``.
    """

    remappings: list[str]
    arguments: list[str]

    @property
    def has_parameters(self) -> bool:
        """Whether the arguments of ROS 2 can set parameters."""
        return not {"-p", "--param", "--params-file"}.isdisjoint(self.arguments)

    def for_generation(self, generation: Generation) -> list[str]:
        """Return the arguments of a generation; raise InputError for arguments of the other."""
        if generation == 1 and self.arguments:
            instead = "remappings as they are, odom:=robot1/odom"
            if self.has_parameters:
                instead = f"parameters as options, which --help lists, and {instead}"
            raise InputError(f"ROS 1 does not accept {' '.join(self.arguments)}: write {instead}")
        if generation == 2 and self.remappings:
            raise InputError(
                f"ROS 2 does not accept {' '.join(self.remappings)}: write --ros-args -r "
                f"{self.remappings[0]}"
            )
        return self.remappings if generation == 1 else self.arguments


def split_arguments(
    parser: argparse.ArgumentParser, argv: Sequence[str]
) -> tuple[argparse.Namespace, RosArguments]:
    """Return the options of a program, and the arguments for ROS."""
    words, arguments = list(argv), []
    if "--ros-args" in words:
        begin = words.index("--ros-args")
        end = words.index("--", begin) + 1 if "--" in words[begin:] else len(words)
        arguments = words[begin:end]
        del words[begin:end]
    options, remappings = parser.parse_known_args(words)
    if unknown := [word for word in remappings if ":=" not in word]:
        known_options = [name for action in parser._actions for name in action.option_strings]  # noqa: SLF001
        hint = nearest(unknown[0], known_options)
        if unknown[0].endswith(".stl") and "--stl" in known_options:
            hint = f"; write --stl {unknown[0]}"
        parser.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
    return options, RosArguments(remappings, arguments)
