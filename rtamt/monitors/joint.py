"""Several episode monitors that are fed together, in one call of C++."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from rtamt.inputs.arrays import Floats
from rtamt.machines.backend import BACKENDS
from rtamt.monitors.monitor import EpisodeMonitor

__all__ = ["JointFeed", "JointRead", "joint_feed"]

JointRead = int | str | tuple[int, ...] | tuple[Floats, int] | Callable[..., float]
"""What reads a number of a sample: a key of the first argument, an array's element, a function."""


class JointFeed(Protocol):
    """Several monitors that take in the same samples; made by `joint_feed`."""

    def feed(self, *args: object) -> tuple[float, float, float]:
        """Reads a sample from the arguments, and has all monitors take it in.

        Returns:
            The least robustness, and the least lower and upper bound, over the monitors.
        """

    def take(self, *args: object) -> None:
        """As `feed`, without the numbers, which take time to make: `look` gives them."""

    def look(self) -> tuple[float, float, float]:
        """The same of the samples so far."""


def joint_feed(
    monitors: Sequence[EpisodeMonitor],
    names: Sequence[str],
    reads: Sequence[JointRead],
    *,
    decided: Callable[[int], object] | None = None,
    seen: Callable[[list[float]], object] | None = None,
    number: type[float] = float,
) -> JointFeed | None:
    """Makes what feeds several monitors with one call, where all of them run in C++.

    A sample costs one call, whatever their number, and each monitor shows its values as after an
    ``update`` of its own. An error leaves the monitors before the one that raised it fed.

    Args:
        monitors: The monitors.
        names: The names of the numbers of a sample, the variables of all monitors among them.
        reads: What reads each of them: the key of an element of the first argument of ``feed``; an
            array of one dimension (float64 or float32) and an index, which is read where it is; or
            a function of the arguments of ``feed``.
        decided: Called after a sample with the number of verdicts that are decided, unless it is 0.
        seen: Called after that with the numbers of the sample, a new list.
        number: The class of the numbers that are returned: ``float`` or ``numpy.float64``.

    Returns:
        What feeds them; None where a monitor runs in Python or keeps a history: then feed one after
        the other.

    Example:
        >>> import rtamt
        >>> monitors = [EpisodeMonitor("always(x > 0)"), EpisodeMonitor("always(y < x)")]
        >>> joint = joint_feed(monitors, ["x", "y"], [0, 1])
        >>> if joint is not None:
        ...     fed = joint.feed([2.0, 1.5])
        ... else:
        ...     fed = monitors[0].update(2.0), monitors[1].update(1.5, 2.0)
        >>> [monitor.robustness for monitor in monitors]
        [2.0, 0.5]
    """
    make = BACKENDS[monitors[0].backend].episode_panel if monitors else None
    machines = [monitor.fed_machine for monitor in monitors]
    if make is None or None in machines:
        return None
    places = [[names.index(name) for name in monitor.variables] for monitor in monitors]
    made: JointFeed | None = make(machines, places, list(reads), decided, seen, number)
    return made
