"""The clocks and margins of what temporal operators owe, in one environment.

They are those of `rtamt_gym.judging.clocks`, which says what each is, in numbers of Python: an
array with one element would take ten times as long.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from math import copysign
from typing import Any

import rtamt
from rtamt_gym.judging.clocks import Owed, parts_owed
from rtamt_gym.judging.obligations import ClockKind, Instants, Obligation
from rtamt_gym.judging.picking import picked
from rtamt_gym.judging.reading import Reading

__all__ = ["SingleObligations"]


class SingleObligations:
    """What the temporal operators of several specifications owe in one environment.

    Its vector twin is `rtamt_gym.judging.clocks.Obligations`.

    Attributes:
        found: The operators of each specification.
        samples: Samples fed since the reset.

    Args:
        judged: The specification of each judge, by name.
        reading: How samples are judged.
    """

    def __init__(self, judged: Mapping[str, rtamt.Specification], reading: Reading) -> None:
        self.found, parts = parts_owed(judged, reading)
        self._courses = {
            key: _Course(rtamt.Monitor(spec, **option)) for key, (spec, option) in parts.items()
        }
        self._clocks = [
            [
                _CLOCKS[each.kind](each, {p: self._courses[place, p] for p in each.parts})
                for each in found
            ]
            for place, found in enumerate(self.found)
        ]
        self.samples = 0

    def reset(self) -> None:
        """Forgets the episode."""
        self.samples = 0
        for course in self._courses.values():
            course.reset()
        for clocks in self._clocks:
            for clock in clocks:
                clock.reset()

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None]:
        """Makes the function that feeds a sample.

        Args:
            names: The names of the signals, in the order of the values that the function takes.
        """
        parts = [
            (course, *picked([names.index(v) for v in course.monitor.variables]))
            for course in self._courses.values()
        ]
        clocks = [clock for found in self._clocks for clock in found]

        def feed(values: Sequence[float]) -> None:
            for course, alone, pick in parts:
                update = course.monitor.update
                course.value = update(values[alone]) if pick is None else update(*pick(values))
            samples = self.samples
            for clock in clocks:
                clock.feed(samples)
            self.samples = samples + 1

        return feed

    def owed(self) -> list[list[Owed]]:
        """The state of every operator of each specification."""
        return [
            [Owed(clock.fraction(), clock.margins) for clock in clocks] for clocks in self._clocks
        ]


class _Course:
    """The values of a part of a specification, late by ``late`` samples; nan before the first."""

    def __init__(self, monitor: rtamt.Monitor) -> None:
        self.monitor = monitor
        self.late = monitor.latency
        self.value = math.nan

    def reset(self) -> None:
        self.monitor.reset()
        self.value = math.nan


class _Clock:
    """The clock of an operator."""

    def __init__(self, obligation: Obligation, courses: Mapping[rtamt.Formula, _Course]) -> None:
        self._name = obligation.name
        self._operands = [courses[operand] for operand in obligation.operands]
        late = self._late = max(course.late for course in self._operands)
        # The values of operands that are known earlier wait here until the others are.
        self._waiting = [[math.nan] * (late - course.late) for course in self._operands]
        self._begin = obligation.begin + late
        self._end = None if obligation.end is None else obligation.end + late
        asked = obligation.asked
        self._first, self._every = asked is Instants.FIRST, asked is Instants.EVERY
        self._where = None if isinstance(asked, Instants) else courses[asked]
        self._start = self._count = 0
        self._values = [math.nan] * len(self._operands)

    @property
    def margins(self) -> tuple[float, ...]:
        """The newest known robustness of each operand, 0 while none is."""
        return tuple([value if value == value else 0.0 for value in self._values])  # noqa: PLR0124 - nan

    def reset(self) -> None:
        self._count = self._start
        for place, waiting in enumerate(self._waiting):
            waiting[:] = [math.nan] * len(waiting)
            self._values[place] = math.nan

    def feed(self, samples: int) -> None:
        """Takes in the newest values of the courses; ``samples`` were fed before."""
        for place, course in enumerate(self._operands):
            waiting, value = self._waiting[place], course.value
            if waiting:
                at = samples % len(waiting)
                value, waiting[at] = waiting[at], value
            self._values[place] = value
        self._step(samples)

    def fraction(self) -> float:
        """The clock, from 0 to 1."""
        raise NotImplementedError

    def _step(self, samples: int) -> None:
        raise NotImplementedError

    def _asked(self, samples: int) -> bool:
        """Whether the operator is asked at the newest instant."""
        if self._where is not None:
            return copysign(1.0, self._where.value) > 0.0
        return not self._first or samples == 0

    def _holds(self, operand: int) -> bool:
        """Whether an operand is known to hold."""
        value = self._values[operand]
        return value >= 0.0 and copysign(1.0, value) > 0.0

    def _fails(self, operand: int) -> bool:
        """Whether an operand is known to fail."""
        value = self._values[operand]
        return value <= 0.0 and copysign(1.0, value) < 0.0


class _Oldest(_Clock):
    """Counts the instants from the oldest pending one to now, both included; 0 if none is."""

    def __init__(self, obligation: Obligation, courses: Mapping[rtamt.Formula, _Course]) -> None:
        super().__init__(obligation, courses)
        self._full = self._begin + 2 if self._end is None else self._end + 1
        self._most = self._begin + 1 if self._end is None else self._full
        self._shown = 0
        depth = 0 if self._where is None else max(self._begin, self._late)
        self._recent = [False] * depth  # whether it was asked, of each instant

    def reset(self) -> None:
        super().reset()
        self._shown = 0
        self._recent[:] = [False] * len(self._recent)

    def fraction(self) -> float:
        return self._shown / self._full

    def _step(self, samples: int) -> None:
        before = self._count
        if self._every:
            count = min(before + 1, self._most)
        else:
            asked = self._asked(samples)
            count = min(before + 1, self._most) if before > 0 else int(asked)
            if self._recent:
                self._recent[samples % len(self._recent)] = asked
        if len(self._operands) == 1:
            event = self._fails if self._name in {"always", "next"} else self._holds
            count = shown = self._ended(event(0), self._begin, samples, count)
        else:
            count, shown = self._of_two(samples, count)
        if self._first and before >= self._full:
            count = shown = self._full
        self._count, self._shown = count, shown

    def _of_two(self, samples: int, count: int) -> tuple[int, int]:
        """What ``until`` and ``unless`` count on from here, and what they show."""
        reached, failed = self._holds(1), self._fails(0)
        if self._name == "until":
            count = self._ended(reached, self._begin, samples, count)
            done = failed and count > self._late
            left = self._ended(failed, self._late, samples, count)
            shown = self._full if done else count
        else:
            done = reached and count > self._begin
            left = self._ended(failed, self._late, samples, count)
            shown = self._full if done else left
        return self._full if done and self._first else left, shown

    def _ended(self, event: bool, last: int, samples: int, count: int) -> int:  # noqa: FBT001
        """The count once an event has ended all that is older than the ``last`` instants."""
        if not event or count <= last:
            return count
        if last == 0 or self._first:
            return 0
        if self._where is None:
            return last
        asked = (self._recent[(samples - back) % len(self._recent)] for back in _back_from(last))
        return next((last - at for at, is_asked in enumerate(asked) if is_asked), 0)


def _back_from(last: int) -> range:
    """How far back the last instants are, the oldest first."""
    return range(last - 1, -1, -1)


class _Newest(_Clock):
    """Counts the instants after the newest that was asked; infinity while none is pending."""

    def __init__(self, obligation: Obligation, courses: Mapping[rtamt.Formula, _Course]) -> None:
        super().__init__(obligation, courses)
        self._age = math.inf

    def reset(self) -> None:
        super().reset()
        self._age = math.inf

    def fraction(self) -> float:
        if self._end is None:
            return float(self._age < math.inf)
        return max(self._end - self._age, 0.0) / max(self._end, 1)

    def _step(self, samples: int) -> None:
        age = 0.0 if self._asked(samples) else self._age + 1.0
        if (self._name == "until" and self._fails(0) and age >= self._late) or (
            self._name == "unless" and self._holds(1) and age >= self._begin
        ):
            age = math.inf
        self._age = age


class _Last(_Clock):
    """Counts the samples since the operand of the past last held."""

    def __init__(self, obligation: Obligation, courses: Mapping[rtamt.Formula, _Course]) -> None:
        super().__init__(obligation, courses)
        self._start = 1 if obligation.end is None else obligation.end + 1
        self._grows = int(obligation.end is not None)
        self._count = self._start

    def fraction(self) -> float:
        return self._count / self._start

    def _step(self, samples: int) -> None:
        last = len(self._operands) - 1
        event = self._fails if self._name in {"historically", "fall"} else self._holds
        if event(last):
            self._count = 0
        elif samples < self._late or (self._name == "since" and self._fails(0)):
            self._count = self._start
        else:
            self._count = min(self._count + self._grows, self._start)


_CLOCKS: dict[ClockKind, Any] = {"oldest": _Oldest, "newest": _Newest, "last": _Last}
