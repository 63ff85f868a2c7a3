"""ROS 1 or ROS 2, as asked or as installed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Literal

from rtamt import InputError
from rtamt_ros.middleware import Middleware

__all__ = ["Generation", "chosen", "open_node"]

Generation = Literal[1, 2]

_LIBRARIES: dict[Generation, str] = {1: "rospy", 2: "rclpy"}
_INSTALL = {
    1: "apt-get install python3-rospy python3-diagnostic-msgs (Debian), or source the setup.bash "
    "of ROS 1",
    2: "source the setup.bash of ROS 2",
}


def chosen(asked: int | None) -> Generation:
    """The generation of ROS that is asked for, else the one that is installed.

    Where both are installed, ``ROS_VERSION`` decides, which the setup files of both set.

    Raises:
        InputError: If it is not installed, or nothing decides.
    """
    found = [each for each, library in _LIBRARIES.items() if find_spec(library)]
    for each, library in _LIBRARIES.items():
        if asked == each and each not in found:
            raise InputError(
                f"ROS {each} needs {library}, which is not installed: {_INSTALL[each]}"
            )
    if asked is None and len(found) == len(_LIBRARIES):
        asked = {"1": 1, "2": 2}.get(os.environ.get("ROS_VERSION", ""))
        if asked is None:
            raise InputError("ROS 1 and ROS 2 are both installed: write --ros 1 or --ros 2")
    if asked is None and not found:
        raise InputError(
            "expected rospy of ROS 1 or rclpy of ROS 2, found neither. "
            f"ROS 1: {_INSTALL[1]}. ROS 2: {_INSTALL[2]}"
        )
    return next(each for each in found if asked in (None, each))


def open_node(asked: int | None, name: str, arguments: Sequence[str]) -> Middleware:
    """Makes a node on the generation that `chosen` says.

    Args:
        asked: 1, 2, or None for the one that is installed.
        name: The name of the node.
        arguments: Those of ROS, such as remappings.

    Raises:
        InputError: As `chosen` does.
    """
    if chosen(asked) == 1:
        from rtamt_ros.ros1 import Ros1

        return Ros1(name, arguments)
    from rtamt_ros.ros2 import Ros2

    return Ros2(name, arguments)
