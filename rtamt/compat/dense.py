"""The released classes for dense time: `DenseMonitor` and `evaluate_dense` behind their calls.

Signals are pairs of a name and its events: ``["x", [[0.0, 1.0], [0.7, 3.0]]]``. At the time t,
``update`` gives the robustness at t - horizon: it is stamped with the time at which it is known.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable, Sequence
from typing import Any

from rtamt.compat.advice import own_advice
from rtamt.compat.declarations import (
    AbstractSpecification,
    OfflineSpecification,
    OnlineSpecification,
)
from rtamt.errors import InputError, InputTypeError
from rtamt.inputs.clock import Clock
from rtamt.language.specification import Specification
from rtamt.monitors.dense import DenseMonitor, evaluate_dense
from rtamt.program.dense_lowering import compile_dense

__all__ = [
    "Pairs",
    "Signal",
    "StlDenseTimeOfflineSpecification",
    "StlDenseTimeOnlineSpecification",
    "StlDenseTimeSpecification",
]

Signal = Sequence[Any]
"""A name and its events."""
Pairs = list[list[float]]
"""Breakpoints: the times from which on a value holds, and the values."""
EventLists = dict[str, list[tuple[float, Any]]]
"""The events of each variable or message."""


class _Dense(AbstractSpecification):
    """A specification of signals whose events each have their own time."""

    sampling_tolerance = None
    sampling_violation_counter = None

    def set_sampling_period(
        self, sampling_period: object = 1, unit: str = "s", tolerance: float = 0.1
    ) -> None:
        """Change nothing: dense time has no period."""

    def get_sampling_frequency(self) -> None:
        """Give None: dense time has no period."""

    def _initial(self) -> object:
        return []

    def _read_signals(self, signals: Iterable[Signal]) -> tuple[EventLists, EventLists]:
        """The events of all names, those of one name joined, and of the names that are needed."""
        named: EventLists = {}
        for signal in signals:
            try:
                name, events = signal
                named.setdefault(name, []).extend((time, value) for time, value in events)
            except (TypeError, ValueError):
                raise InputTypeError(
                    "expected a name and its events, as ['x', [[0.0, 1.5], [2.0, 1.0]]], "
                    f"got {reprlib.repr(signal)}"
                ) from None
        return named, {name: named[name] for name in self._sources() if name in named}


def _last_of_each_tick(needed: EventLists, clock: Clock) -> EventLists:
    """The events without those that another one follows on the same tick."""
    return {
        name: [
            events[i]
            for i in range(len(events))
            if i + 1 == len(events) or not clock.on_one_tick(events[i][0], events[i + 1][0])
        ]
        for name, events in needed.items()
    }


def _without_signs(breakpoints: Sequence[tuple[float, float]], before: float = math.nan) -> Pairs:
    """The breakpoints with 0.0 for -0.0, which programs do not know: no step between these two."""
    pairs = []
    for time, value in breakpoints:
        crosses = math.copysign(1.0, value) != math.copysign(1.0, before)
        if not (value == before == 0.0 and crosses):
            pairs.append([time, value + 0.0])
        before = value
    return pairs


class StlDenseTimeOnlineSpecification(OnlineSpecification[DenseMonitor], _Dense):
    """Robustness as events arrive.

    Example:
        >>> spec = StlDenseTimeOnlineSpecification()
        >>> spec.declare_var("x", "float")
        >>> spec.spec = "once[0:1](x >= 3)"
        >>> spec.parse()
        >>> spec.update(["x", [[0.0, 0.0], [2.0, 5.0]]])
        [[0.0, -3.0], [2.0, 2.0]]
        >>> spec.update(["x", [[4.0, 1.0]]]), spec.update(["x", [[9.0, 1.0]]])
        ([], [[5.0, -2.0]])
    """

    _twin: DenseMonitor
    _clock: Clock
    _last: dict[str, tuple[float, Any]]
    """Last event of every variable or message."""
    _told: tuple[float, float] | None
    """The last breakpoint that was given before the monitor gave it."""

    def update(self, *signals: Signal) -> Pairs:
        """Take in events and give the breakpoints of the robustness that are decided by them.

        A call that raises an error leaves the specification as it was.

        Args:
            signals: Pairs of a name and its events. Unknown names are ignored.

        Raises:
            StateError: Before `parse`.
            SpecificationError: At the first events: on a future without an end, or an operator on
                neighbouring samples.
            InputError: On times that do not increase, a nan, or a term that is not a number.
            InputTypeError: On values that are not real numbers.
        """
        breakpoints = self._take(signals)
        ahead = self._ahead()
        if ahead is not None and ahead != self._told:
            breakpoints.append(ahead)
            self._told = ahead
        return self._late(breakpoints)

    def final_update(self, *signals: Signal) -> Pairs:
        """Take in the last events and give the rest of the robustness.

        It raises the errors of `update`.
        """
        breakpoints = self._take(signals)
        return self._late(breakpoints + self._untold(self._running().finish()))

    @own_advice()
    def _take(self, signals: Iterable[Signal]) -> list[tuple[float, float]]:
        monitor = self._running()
        named, needed = self._read_signals(signals)
        needed = _last_of_each_tick(needed, self._clock)
        for name, events in needed.items():
            if events and events[0] == self._last.get(name):  # a chunk may begin with it once more
                del events[0]
        breakpoints = monitor.update(needed)
        self._last |= {name: events[-1] for name, events in needed.items() if events}
        self.var_object_dict |= named
        return self._untold(breakpoints)

    def _untold(self, breakpoints: list[tuple[float, float]]) -> list[tuple[float, float]]:
        return breakpoints[1:] if breakpoints and breakpoints[0] == self._told else breakpoints

    def _ahead(self) -> tuple[float, float] | None:
        """The breakpoint at the time before which all is settled, if there is one.

        The last steps decide it if they last for a while: a twin of the monitor is given events
        that say so.
        """
        monitor = self._running()
        if len(self._last) < len(self._sources()):
            return None
        ticks = {name: self._clock.nearest(time) for name, (time, _) in self._last.items()}
        end = min(ticks.values())
        after = (end + 1) * self._clock.tick
        held = {name: [(after, v)] for name, (_, v) in self._last.items() if ticks[name] == end}
        self._twin.__setstate__(monitor.__reduce__()[2])
        try:
            breakpoints = self._twin.update(held)
        except InputError:  # another variable has events in that while
            return None
        return breakpoints[0] if breakpoints and breakpoints[0][0] == monitor.settled else None

    def _late(self, breakpoints: Sequence[tuple[float, float]]) -> Pairs:
        program = self._running().program
        late = program.program.latencies[program.program.result] or 0
        pairs = _without_signs(breakpoints, self._robustness)
        if breakpoints:
            self._robustness = breakpoints[-1][1]
        clock = self._clock
        return [[clock.time(clock.nearest(time) + late), value] for time, value in pairs]

    def _start(self) -> DenseMonitor:
        spec, options = self._specification(), self._options()
        monitor, self._twin = DenseMonitor(spec, **options), DenseMonitor(spec, **options)
        self._clock = Clock(monitor.program)
        self._last, self._told, self._robustness = {}, None, math.nan
        return self._run(monitor)


class StlDenseTimeOfflineSpecification(OfflineSpecification[EventLists], _Dense):
    """Robustness of whole signals.

    Example:
        >>> spec = StlDenseTimeOfflineSpecification()
        >>> spec.declare_var("x", "float")
        >>> spec.spec = "eventually[0:1](x >= 3)"
        >>> spec.parse()
        >>> spec.evaluate(["x", [[0.0, 0.0], [2.0, 5.0], [4.0, 1.0], [9.0, 1.0]]])
        [[0.0, -3.0], [1.0, 2.0], [4.0, -2.0]]
    """

    @own_advice()
    def evaluate(self, *signals: Signal) -> Pairs:
        """The breakpoints of the robustness of whole signals.

        Args:
            signals: Pairs of a name and its events. Unknown names are ignored.

        Raises:
            StateError: Before `parse`.
            SpecificationError: On an operator on neighbouring samples.
            InputError: On times that do not increase, a nan, a term that is not a number, or a
                variable without events.
            InputTypeError: On values that are not real numbers.
        """
        spec = self._specification()
        named, needed = self._read_signals(signals)
        clock = Clock(compile_dense(spec))
        pairs = self._robustness_of(spec, _last_of_each_tick(needed, clock))
        self.var_object_dict |= named
        self._evaluated(needed)
        return pairs

    def _robustness_of(self, spec: Specification, trace: EventLists) -> Pairs:
        return _without_signs(evaluate_dense(spec, trace, **self._options()))


class StlDenseTimeSpecification(StlDenseTimeOfflineSpecification, StlDenseTimeOnlineSpecification):
    """Robustness as events arrive, and of whole signals."""
