"""``python -m rtamt_ros.screen``: the requirements of a monitor in the terminal, on ROS 1 or 2."""

from __future__ import annotations

import argparse
import math
import sys
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from rtamt import InputError, Verdict
from rtamt_gym.checks.extras import naming_extra
from rtamt_ros.generation import choose_generation, open_node, split_arguments
from rtamt_ros.middleware import Level, Middleware
from rtamt_ros.process import run_module

if TYPE_CHECKING:
    from rtamt_gym.watching.screen import Screen

_BEAT: Final = 0.2
"""Seconds after which the view is drawn again if no message comes."""


class CombinedView:
    """A view of the topic that a monitor publishes with ``--combined``.

    Times count from the first message. A line below the requirements has the text of each state
    that is stale or has no verdict.

    Args:
        middleware: The node.
        topic: The topic.
        screen: The view.
    """

    def __init__(self, middleware: Middleware, topic: str, screen: Screen) -> None:
        from rtamt_gym.watching.lines import Line

        self._line = Line
        self._middleware, self._screen = middleware, screen
        self._title = middleware.resolve(topic)
        self._drawing = threading.Lock()
        self._restart(None)
        message = middleware.message_class("diagnostic_msgs", "DiagnosticArray")
        self._subscription = middleware.subscribe(topic, message, self.show)

    def _restart(self, stamp: int | None) -> None:
        self._first = self._last = stamp
        self._count = 0
        self._decided: dict[str, float] = {}
        self._screen.restart(self._title)

    def show(self, message: Any) -> None:  # noqa: ANN401 - the classes of ROS have no types
        """Show a message; an earlier stamp, as after a restarted simulation, restarts the view."""
        with self._drawing:
            stamp = self._middleware.stamp(message) or 0
            if self._first is None or self._last is None or stamp < self._last:
                self._restart(stamp)
            self._last = stamp
            time = (stamp - (self._first or 0)) / 1e9
            self._count += 1
            self._screen.notes = [
                f"{status.name}: {status.message}" for status in message.status if _is_odd(status)
            ]
            lines = [self._line_of(status, time) for status in message.status]
            self._screen.update(lines, self._count)

    def beat(self) -> None:
        """Draw the view again, with the age of the last message."""
        with self._drawing:
            self._screen.update((), self._count)

    def close(self) -> None:
        """End the subscription."""
        self._subscription.close()

    def _line_of(self, status: Any, time: float) -> Any:  # noqa: ANN401
        values = _values(status)
        verdict = Verdict[values.get("verdict") or "UNDECIDED"]
        if verdict is Verdict.UNDECIDED:
            self._decided.pop(status.name, None)
        else:
            self._decided.setdefault(status.name, time)
        robustness, lower, upper = (
            float(values.get(name) or math.nan) for name in ("robustness", "lower", "upper")
        )
        return self._line(
            *(status.name, None, time, self._count - 1),
            *(verdict, robustness, lower, upper),
            decided_at=self._decided.get(status.name),
        )


def _values(status: Any) -> dict[str, str]:  # noqa: ANN401
    return {pair.key: pair.value for pair in status.values}


def _is_odd(status: Any) -> bool:  # noqa: ANN401
    """Return whether a state is stale or has no verdict. A level is bytes on ROS 2."""
    level = status.level[0] if isinstance(status.level, bytes) else status.level
    return level == Level.STALE or not _values(status).get("verdict")


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the requirements until Ctrl-C; return the exit code.

    Args:
        arguments: The words of a command line; None for those of the program.
    """
    parser = argparse.ArgumentParser(
        prog="python -m rtamt_ros.screen",
        description="Draws the requirements that a monitor publishes with --combined on the "
        "terminal: verdict, robustness, bounds and robustness history, until Ctrl-C.",
        epilog="Remappings go to ROS: rtamt/all:=robot1/all on ROS 1, --ros-args -r "
        "rtamt/all:=robot1/all on ROS 2.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--topic",
        metavar="TOPIC",
        default="rtamt/all",
        help="the topic of --combined (default: rtamt/all)",
    )
    parser.add_argument(
        "--ros", type=int, choices=(1, 2), help="ROS 1 or ROS 2 (default: the installed one)"
    )
    words = sys.argv[1:] if arguments is None else arguments
    options, ros_arguments = split_arguments(parser, words)
    try:
        try:
            from rtamt_gym.watching.screen import open_screen
        except ModuleNotFoundError as error:
            raise naming_extra(error, "rtamt_ros.screen", "watch") from error
        screen = open_screen(options.topic, "message", "rtamt_ros.screen")
        generation = choose_generation(options.ros)
        node = open_node(
            generation, "requirements_screen", ros_arguments.for_generation(generation)
        )
    except (InputError, ModuleNotFoundError) as error:
        parser.error(str(error))
    try:
        return _draw(node, options.topic, screen)
    finally:
        node.close()


def _draw(node: Middleware, topic: str, screen: Screen) -> int:
    over = threading.Event()
    with screen:
        view = CombinedView(node, topic, screen)

        def beat() -> None:
            while not over.wait(_BEAT):
                view.beat()

        beats = threading.Thread(target=beat, daemon=True)
        beats.start()
        try:
            return node.spin()
        finally:
            over.set()
            beats.join()
            view.close()


if __name__ == "__main__":
    sys.exit(run_module("rtamt_ros.screen"))
