"""The values of monitors after a sample: of one environment, or of many."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Generic, NamedTuple

from rtamt_gym.judging.clocks import Owed
from rtamt_gym.judging.infos import Lanewise
from rtamt_gym.shaping import Numeric

__all__ = ["MonitorValues", "read_values"]


class MonitorValues(NamedTuple, Generic[Numeric]):
    """The values of the monitors after a sample: for each specification a float or an array.

    Attributes:
        robustness: The robustness of the sources.
        judged: The robustness of the judges, which judge the whole episode.
        lower: The lower bounds of ``judged``.
        upper: The upper bounds of ``judged``.
        verdicts: The verdicts on the whole episode: 1 satisfied, -1 violated, 0 undecided.
        samples: Samples since the reset, of every environment: an int or an array.
        owed: For each specification what its temporal operators owe; None if that is not followed.
    """

    robustness: list[Numeric]
    judged: list[Numeric]
    lower: list[Numeric]
    upper: list[Numeric]
    verdicts: list[Numeric]
    samples: Lanewise
    owed: list[list[Owed]] | None = None


def read_values(
    monitors: Iterable[tuple[Any, Any]],
    upper: list[Numeric],
    verdicts: list[Numeric],
    samples: Lanewise,
    owed: list[list[Owed]] | None,
) -> MonitorValues[Numeric]:
    """Reads the values of monitors, which are pairs ``(robustness source, judge)``.

    The upper bounds and the verdicts are given: what the end of an episode alone violates is not
    known to a monitor.
    """
    pairs = list(monitors)
    return MonitorValues(
        [source.robustness for source, _ in pairs],
        [judge.robustness for _, judge in pairs],
        [judge.lower for _, judge in pairs],
        upper,
        verdicts,
        samples,
        owed,
    )
