"""The clocks and margins of what temporal operators owe, sample by sample, in many environments.

An operand may look ahead by some samples, its latency L; then its newest known value is L samples
old. An operator with the window [a, b] asks of such values what one with the window
[a + L, b + L] asks of values that are known at once: these are its a and b below. Let t be the
newest sample, and s an instant at which the operator is asked.

* ``"oldest"`` of ``eventually[a:b] q``: an instant s is met once q has held in s + a to s + b, and
  pending until then. The clock counts the instants from the oldest pending one to t, both included,
  as a fraction of b + 1. It is 0 if none is pending, and 1 at the sample at which the oldest is
  overdue; it stays there until q holds.
* ``"oldest"`` of ``always[a:b] p``: the same with p failing instead of q holding. The clock is 1
  once p has held throughout the window of an instant.
* ``"oldest"`` of ``p until[a:b] q``: if p fails while an instant is pending, that is overdue at
  once: the clock is 1 at this sample, and counts later instants from there on. For ``p unless[a:b]
  q``: if p fails, nothing is pending any more, and q at its time makes the clock 1.
* ``"newest"``: how much of its window the newest instant still has, ``(b - (t - s)) / b``. For
  ``until`` it falls to 0 where p fails, for ``unless`` where q holds.
* ``"last"``: the samples since the operand of ``once[a:b]``, ``prev`` or ``rise`` last held, or the
  operand of ``historically[a:b]`` or ``fall`` last failed, as a fraction of b + 1; 1 if that is
  longer ago or has not happened. For ``since`` it is 1 too if p has failed after q.

A window without an end has no such fraction. Its clock is 0 if nothing is pending, 1/2 (``until``,
``eventually``, ``unless`` and ``always`` that are counted from the oldest) or 1 while something is,
if a = 0; with an a > 0 it grows to there over the first samples. For ``once`` and its kin it is 0
once the operand has held, else 1. An operator that is asked at the first instant alone keeps a
clock of 1.

The margin of an operand is its newest known robustness, 0 while none is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt_gym.judging.costs import options_of_parts
from rtamt_gym.judging.obligations import ClockKind, Instants, Obligation, bare, obligations_of
from rtamt_gym.judging.part_values import Aligned, PartValues, Which
from rtamt_gym.judging.reading import Reading
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["Obligations", "Owed", "parts_owed"]

_Bools = NDArray[np.bool_]
_Ints = NDArray[np.int64]

_NEVER = 2**40
"""More samples than an episode has."""


class Owed(NamedTuple):
    """The state of an operator: in every environment, or as floats in one.

    Attributes:
        clock: From 0 to 1.
        margins: The robustness of its operands.
    """

    clock: Any
    margins: tuple[Any, ...]


class Obligations:
    """What the temporal operators of several specifications owe.

    The twin for one environment is `rtamt_gym.judging.single_clocks.SingleObligations`.

    Attributes:
        found: The operators of each specification.
        samples: Samples fed since the reset, of every environment.

    Args:
        judged: The specification of each judge, by name.
        num: The number of environments.
        reading: How samples are judged.
        columns: The names of the columns of the tables that are fed.
    """

    def __init__(
        self,
        judged: Mapping[str, rtamt.Specification],
        num: int,
        reading: Reading,
        columns: Sequence[str],
    ) -> None:
        self.found, parts = parts_owed(judged, reading)
        self._courses = {
            key: PartValues(rtamt.VectorMonitor(spec, num, **option), columns)
            for key, (spec, option) in parts.items()
        }
        self._clocks = [
            [
                _CLOCKS[each.kind](
                    each, num, {part: self._courses[place, part] for part in each.parts}
                )
                for each in found
            ]
            for place, found in enumerate(self.found)
        ]
        self.samples = np.zeros(num, np.int64)

    def reset(self, lanes: Lanes | None = None) -> None:
        """Forgets the episodes of the environments of the mask; None: of all."""
        which = slice(None) if lanes is None else lanes
        self.samples[which] = 0
        for course in self._courses.values():
            course.reset(lanes)
        for clock in chain(*self._clocks):
            clock.reset(which)

    def feed(self, table: Floats, lanes: Lanes | None = None) -> None:
        """Feeds a row of the table to every environment of the mask; None: to all."""
        which = slice(None) if lanes is None else lanes
        for course in self._courses.values():
            course.feed(table, lanes)
        for clock in chain(*self._clocks):
            clock.feed(which, self.samples[which])
        self.samples[which] += 1

    def owed(self) -> list[list[Owed]]:
        """The state of every operator of each specification, in fresh arrays."""
        return [
            [Owed(clock.fraction(), tuple(clock.margins)) for clock in clocks]
            for clocks in self._clocks
        ]


def parts_owed(
    judged: Mapping[str, rtamt.Specification], reading: Reading
) -> tuple[list[list[Obligation]], dict[tuple[int, rtamt.Formula], tuple[Any, Any]]]:
    """The operators of each specification, and the formulas whose values their clocks need.

    These are specifications with the options of their monitors, by the place of the specification
    that they are a part of, and by formula.
    """
    found = [obligations_of(spec, reading) for spec in judged.values()]
    parts = {
        (place, part): bare(spec, part)
        for place, (spec, operators) in enumerate(zip(judged.values(), found, strict=True))
        for each in operators
        for part in each.parts
    }
    options = options_of_parts(judged, list(parts.values()), reading)
    return found, {
        key: (spec, option) for (key, spec), option in zip(parts.items(), options, strict=True)
    }


class _Clock:
    """The clock of an operator; its numbers have an element for every environment."""

    def __init__(
        self, obligation: Obligation, num: int, courses: Mapping[rtamt.Formula, PartValues]
    ) -> None:
        self._name = obligation.name
        operands = [courses[operand] for operand in obligation.operands]
        late = self._late = max(course.late for course in operands)
        self._operands = [Aligned(course, late - course.late, num) for course in operands]
        self._begin = obligation.begin + late
        self._end = None if obligation.end is None else obligation.end + late
        asked = obligation.asked
        self._first, self._every = asked is Instants.FIRST, asked is Instants.EVERY
        self._where = None if isinstance(asked, Instants) else courses[asked]
        self._start = 0
        self._lanes = np.arange(num)
        self._count = np.zeros(num, np.int64)

    @property
    def margins(self) -> list[Floats]:
        """The newest known robustness of each operand, 0 while none is; never written to."""
        values = [operand.value for operand in self._operands]
        return [np.where(np.isnan(v), 0.0, v) for v in values] if self._late else values

    def reset(self, which: Which) -> None:
        self._count[which] = self._start
        for operand in self._operands:
            operand.reset(which)

    def feed(self, which: Which, samples: _Ints) -> None:
        """Takes in the newest values of the courses; ``samples`` were fed before."""
        for operand in self._operands:
            operand.feed(which, samples)
        self._step(which, samples)

    def fraction(self) -> Floats:
        """The clock, from 0 to 1."""
        raise NotImplementedError

    def _step(self, which: Which, samples: _Ints) -> None:
        raise NotImplementedError

    def _asked(self, which: Which, samples: _Ints) -> _Bools:
        """Whether the operator is asked at the newest instant."""
        if self._where is not None:
            return ~np.signbit(self._where.value[which])
        return samples == 0 if self._first else samples >= 0

    def _holds(self, operand: int, which: Which) -> _Bools:
        """Whether an operand is known to hold."""
        value = self._operands[operand].value[which]
        held = ~np.signbit(value)
        return held & ~np.isnan(value) if self._late else held

    def _fails(self, operand: int, which: Which) -> _Bools:
        """Whether an operand is known to fail."""
        value = self._operands[operand].value[which]
        failed = np.signbit(value)
        return failed & ~np.isnan(value) if self._late else failed


class _Oldest(_Clock):
    """Counts the instants from the oldest pending one to now, both included; 0 if none is."""

    def __init__(
        self, obligation: Obligation, num: int, courses: Mapping[rtamt.Formula, PartValues]
    ) -> None:
        super().__init__(obligation, num, courses)
        self._full = self._begin + 2 if self._end is None else self._end + 1
        self._most = self._begin + 1 if self._end is None else self._full
        self._shown = np.zeros(num, np.int64)
        depth = 0 if self._where is None else max(self._begin, self._late)
        self._recent = np.zeros((depth, num), np.bool_)  # whether it was asked, of each instant

    def reset(self, which: Which) -> None:
        super().reset(which)
        self._shown[which] = 0
        self._recent[:, which] = False

    def fraction(self) -> Floats:
        return self._shown / self._full

    def _step(self, which: Which, samples: _Ints) -> None:
        before = self._count[which]
        if self._every:
            count = np.minimum(before + 1, self._most)
        else:
            asked = self._asked(which, samples)
            count = np.where(before > 0, np.minimum(before + 1, self._most), asked)
            if len(self._recent):
                self._recent[samples % len(self._recent), self._lanes[which]] = asked
        if len(self._operands) == 1:
            event = self._fails if self._name in {"always", "next"} else self._holds
            count = shown = self._ended(event(0, which), self._begin, which, samples, count)
        else:
            count, shown = self._of_two(which, samples, count)
        if self._first:
            over = before >= self._full
            count, shown = (np.where(over, self._full, each) for each in (count, shown))
        self._count[which] = count
        self._shown[which] = shown

    def _of_two(self, which: Which, samples: _Ints, count: _Ints) -> tuple[_Ints, _Ints]:
        """What ``until`` and ``unless`` count on from here, and what they show."""
        reached = self._holds(1, which)
        if self._name == "until":
            count = self._ended(reached, self._begin, which, samples, count)
        failed = self._fails(0, which)
        left = self._ended(failed, self._late, which, samples, count)
        if self._name == "until":
            done = failed & (count > self._late)
            shown = np.where(done, self._full, count)
        else:
            done = reached & (count > self._begin)
            shown = np.where(done, self._full, left)
        return np.where(done & self._first, self._full, left), shown

    def _ended(self, event: _Bools, last: int, which: Which, samples: _Ints, count: _Ints) -> _Ints:
        """The count once an event has ended all that is older than the ``last`` instants."""
        if last == 0:
            return np.where(event, 0, count)
        over = event & (count > last)
        if self._first or self._where is None:
            return np.where(over, 0 if self._first else last, count)
        at = over.nonzero()[0]  # few environments: the instants of the others are not looked at
        if len(at):
            count = count.copy()
            count[at] = self._since(last, self._lanes[which][at], samples[at])
        return count

    def _since(self, last: int, lanes: _Ints, samples: _Ints) -> _Ints:
        """The count from the oldest of the last instants that these environments were asked at."""
        back = np.arange(last - 1, -1, -1)[:, None]
        asked = self._recent[(samples - back) % len(self._recent), lanes]
        found: _Ints = np.where(asked.any(axis=0), last - asked.argmax(axis=0), 0)
        return found


class _Newest(_Clock):
    """Counts the instants after the newest that was asked."""

    def __init__(
        self, obligation: Obligation, num: int, courses: Mapping[rtamt.Formula, PartValues]
    ) -> None:
        super().__init__(obligation, num, courses)
        self._start = _NEVER
        self._count[:] = _NEVER

    def fraction(self) -> Floats:
        if self._end is None:
            return (self._count < _NEVER).astype(np.float64)
        left: Floats = np.maximum(self._end - self._count, 0).astype(np.float64)
        left /= max(self._end, 1)
        return left

    def _step(self, which: Which, samples: _Ints) -> None:
        age = np.minimum(self._count[which] + 1, _NEVER)
        age[self._asked(which, samples)] = 0
        if self._name == "until":
            age[self._fails(0, which) & (age >= self._late)] = _NEVER
        elif self._name == "unless":
            age[self._holds(1, which) & (age >= self._begin)] = _NEVER
        self._count[which] = age


class _Last(_Clock):
    """Counts the samples since the operand of the past last held."""

    def __init__(
        self, obligation: Obligation, num: int, courses: Mapping[rtamt.Formula, PartValues]
    ) -> None:
        super().__init__(obligation, num, courses)
        self._start = 1 if obligation.end is None else obligation.end + 1
        self._grows = obligation.end is not None
        self._count[:] = self._start

    def fraction(self) -> Floats:
        return self._count / self._start

    def _step(self, which: Which, samples: _Ints) -> None:
        count = np.minimum(self._count[which] + self._grows, self._start)
        count = np.where(samples < self._late, self._start, count)
        if self._name == "since":
            count[self._fails(0, which)] = self._start
        event = self._fails if self._name in {"historically", "fall"} else self._holds
        count[event(len(self._operands) - 1, which)] = 0
        self._count[which] = count


_CLOCKS: dict[ClockKind, type[_Clock]] = {"oldest": _Oldest, "newest": _Newest, "last": _Last}
