"""The times between neighbouring records of variables: the longest, and those that are holes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rtamt_gym.recorded.recording import Floats
from rtamt_gym.results.extent import Gap
from rtamt_gym.tables import counted, number, time_text

__all__ = ["Records", "hole_note", "longest_gap"]


@dataclass(frozen=True, slots=True)
class Records:
    """When a variable was recorded.

    Attributes:
        times: The times, which increase; the last may be the end of the trace.
        steps: The distances of neighbours.
        usual: The median of them; None: it is found when it is needed.
    """

    times: Floats
    steps: Floats
    usual: float | None = None

    @staticmethod
    def of(times: Floats) -> Records:
        """The records at some times."""
        with np.errstate(over="ignore"):  # rtamt refuses times so far apart
            return Records(times, np.diff(times))

    def measured(self) -> Records:
        """The same records, with the median of their distances if there are two."""
        usual = float(np.median(self.steps)) if len(self.steps) else None
        return replace(self, usual=usual)


def longest_gap(records: Mapping[str, Records], start: float = 0.0) -> Gap | None:
    """The longest time between two records of one variable; None if none has two.

    Among several that are as long it names the one that is the most usual steps long.

    Args:
        records: The records of each variable; those with one object are found once.
        start: What to add to the times.
    """
    found: dict[int, tuple[float, float, Records, list[str]]] = {}
    for name, each in records.items():
        if not len(each.steps):
            continue
        if id(each) not in found:
            at = int(each.steps.argmax())
            found[id(each)] = float(each.steps[at]), float(each.times[at]) + start, each, []
        found[id(each)][3].append(name)
    if not found:
        return None
    most = max(seconds for seconds, *_ in found.values())
    alike = [each for each in found.values() if each[0] == most]
    usuals = [_usual(each) for _, _, each, _ in alike]
    best = int(np.argmin(usuals))
    seconds, begin, _, _ = alike[best]
    names = [name for _, other, _, names in alike if other == begin for name in names]
    of = "" if len(names) == len(records) else ", ".join(names)
    return Gap(seconds, begin, usuals[best], of)


def _usual(records: Records) -> float:
    return float(np.median(records.steps)) if records.usual is None else records.usual


def hole_note(records: Mapping[str, Records], most: float, start: float = 0.0) -> str:
    """Says where variables are unknown, as nothing was recorded for longer; empty if nowhere.

    Args:
        records: The records of each variable.
        most: The longest time in seconds for which a value may hold.
        start: What to add to the times.
    """
    said: dict[str, list[str]] = {}
    for name, each in records.items():
        (holes,) = np.nonzero(each.steps > most)
        if not len(holes):
            continue
        longest = int(holes[each.steps[holes].argmax()])
        length = f"{number(float(each.steps[longest]))} s"
        after = f"after {time_text(float(each.times[longest]) + start, most)}"
        words = f"a hole of {length} {after}"
        if len(holes) > 1:
            words = f"{counted(len(holes), 'hole')}, the longest of {length} {after}"
        said.setdefault(words, []).append(name)
    if not said:
        return ""
    each_said = [
        words if _all(names, records) else f"{', '.join(names)}: {words}"
        for words, names in said.items()
    ]
    return (
        f"values are unknown where nothing was recorded for more than {number(most)} s "
        f"({'; '.join(each_said)})"
    )


def _all(names: Sequence[str], records: Mapping[str, Records]) -> bool:
    return len(names) == len(records)
