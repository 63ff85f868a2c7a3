"""A monitor as a node: what it subscribes to, publishes and says, on any middleware."""

from __future__ import annotations

from collections.abc import Sequence

from rtamt import Specification
from rtamt_ros.core.report import Report
from rtamt_ros.core.settings import Settings
from rtamt_ros.middleware import Middleware

__all__ = ["MonitorNode", "Report", "Settings"]


class MonitorNode:
    """Monitors the topics that specifications name, and publishes what it finds.

    Every requirement of every specification (`Specification.requirements`) has a monitor of its
    own. A topic that several read is subscribed to once. Each requirement is published on a topic
    of its own, latched: the one of its output variable (``@ topic(out, monitor/out)``), else
    ``rtamt/NAME``; so is every named formula that it uses. The bounds are on ``TOPIC/lower`` and
    ``TOPIC/upper``, the verdict (-1, 0 or 1) on ``TOPIC/verdict``; ``/diagnostics`` has the level
    and the numbers of every `Report`.

    Nothing happens before `start`. Making a node parses, compiles and finds the classes of all
    messages, so that every error of a specification comes here.

    Args:
        middleware: The node of ROS. `stop` does not close it.
        specifications: Texts, or specifications from `rtamt.load` and `rtamt.parse`.
        settings: How to sample. None: `Settings()`.

    Raises:
        SpecificationError: On a text that is no specification, or that a monitor cannot run; on
            messages of an unknown class; if two requirements have one name or one topic.
        InputError: On a class of messages that is not installed.

    Attributes:
        settings: How it samples.
        specifications: What it monitors, parsed.
    """

    def __init__(
        self,
        middleware: Middleware,
        specifications: Sequence[str | Specification],
        settings: Settings | None = None,
    ) -> None:
        raise NotImplementedError

    settings: Settings
    specifications: tuple[Specification, ...]

    @property
    def running(self) -> bool:
        """Whether it was started and not stopped."""
        raise NotImplementedError

    @property
    def reports(self) -> tuple[Report, ...]:
        """What it said last of every requirement; empty before the first look."""
        raise NotImplementedError

    def start(self) -> None:
        """Subscribe, publish and sample; the monitors begin anew. Twice is once."""
        raise NotImplementedError

    def stop(self) -> None:
        """Close every subscription, publisher and timer; the record is complete. Twice is once."""
        raise NotImplementedError

    def replace(
        self, specifications: Sequence[str | Specification], settings: Settings | None = None
    ) -> None:
        """Monitor other specifications, begun anew; a running node goes on running.

        Args:
            specifications: As for the class.
            settings: Other settings; None keeps them.

        Raises:
            SpecificationError: As for the class. The node then goes on with what it had.
            InputError: As for the class. The node then goes on with what it had.
        """
        raise NotImplementedError
