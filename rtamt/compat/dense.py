"""The drop-in classes for dense time, over `rtamt.dense.Monitor` and `rtamt.dense.evaluate`.

Signals are pairs of a name and its events: ``["x", [[0.0, 1.0], [0.7, 3.0]]]``. ``update`` returns
the robustness at t - horizon together with t, the time when it becomes known.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rtamt.compat.specification import (
    AbstractSpecification,
    OfflineSpecification,
    OnlineSpecification,
    drop_in_advice,
    warn_of_unknown,
)
from rtamt.errors import InputError, InputTypeError
from rtamt.inputs.clock import Clock
from rtamt.language.specification import Specification
from rtamt.monitors.dense_monitor import DenseMonitor
from rtamt.monitors.evaluation import evaluate_dense
from rtamt.program.dense_lowering import compile_dense

NamedEvents = Sequence[Any]
"""A name and its events."""
Pairs = list[list[float]]
"""Breakpoints: times and the values that hold from there on."""
EventLists = dict[str, list[tuple[float, Any]]]
"""The events of each variable or message."""


class _Dense(AbstractSpecification):
    """A specification of signals that are events at any times."""

    sampling_tolerance = None
    sampling_violation_counter = None

    def set_sampling_period(
        self, sampling_period: object = 1, unit: str = "s", tolerance: float = 0.1
    ) -> None:
        """Do nothing: dense time has no period."""

    def get_sampling_frequency(self) -> None:
        """Return None: dense time has no period."""

    def _initial(self) -> object:
        return []

    def _read_signals(self, signals: Iterable[NamedEvents]) -> tuple[EventLists, EventLists]:
        """Return the joined events of all names, and of the variables of the specification."""
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
    """Return the events without earlier ones on the same tick."""
    return {
        name: [
            events[i]
            for i in range(len(events))
            if i + 1 == len(events) or not clock.on_one_tick(events[i][0], events[i + 1][0])
        ]
        for name, events in needed.items()
    }


def _held_to_the_end(signals: EventLists, clock: Clock) -> EventLists:
    """Return the events, with the last value of each variable held to the last time of all."""
    try:
        ends = {name: clock.nearest(events[-1][0]) for name, events in signals.items()}
    except (TypeError, ValueError, OverflowError):  # the monitors refuse these times
        return signals
    last = max(ends.values(), default=0)
    time = next((signals[name][-1][0] for name in ends if ends[name] == last), 0.0)
    return {
        name: events if ends[name] == last else [*events, (time, events[-1][1])]
        for name, events in signals.items()
    }


def _without_signs(breakpoints: Iterable[tuple[float, float]]) -> Pairs:
    """Return breakpoints with 0.0 for -0.0, which programs do not expect, without a step there."""
    pairs: Pairs = []
    for time, value in breakpoints:
        if not (pairs and value == pairs[-1][1] == 0.0):
            pairs.append([time, value + 0.0])
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
        >>> spec.update(["x", [[2.5, 1.0]]]), spec.update(["x", [[9.0, 1.0]]])
        ([[2.5, 2.0]], [[3.5, -2.0], [9.0, -2.0]])
    """

    _ahead: DenseMonitor
    """A monitor with all events. `_monitor` lacks the last event of each variable, because a later
    event at the same time would replace it."""
    _last: dict[str, tuple[float, Any]]
    """The last event of every variable or message."""
    _first_ticks: dict[str, int]
    """The tick of the first event of every variable or message."""
    _last_value: float
    """The last value of the monitor; nan before there is one."""
    _reported: tuple[float, float] | None
    """The last reported time and value."""
    _clock: Clock
    _horizon_ticks: int
    """The horizon in ticks."""

    @drop_in_advice()
    def update(self, *signals: NamedEvents) -> Pairs:
        """Add events, and return the robustness up to the settled time.

        The settled time is the minimum of the variables' last times. The result has a pair for each
        time at which the robustness changes, and one for the settled time; it is empty if a call
        settles nothing. The time of a value is the time when it becomes known: its own time plus
        the horizon. Until then, a call returns one pair with the robustness of the trace if it
        ended now.

        If a variable has several events at one time, the last one counts, also across calls. A call
        that raises an error leaves the specification unchanged.

        Args:
            signals: Pairs of a name and its events. Unknown names are ignored, with a warning in
                the log if the name resembles a variable without events.

        Raises:
            StateError: Before `parse`.
            SpecificationError: At the first events: if the text has an unbounded future or an
                operator on neighbouring samples.
            InputError: If times decrease, or a value or a term is nan.
            InputTypeError: If a value is not a real number.
        """
        monitor, clock = self._running(), self._clock
        named, needed = self._read_signals(signals)
        needed, before, steps = self._look_ahead(needed)
        last, first_ticks = self._last.copy(), self._first_ticks.copy()
        for name, events in needed.items():
            last[name] = events[-1]
            if name not in first_ticks:
                first_ticks[name] = clock.nearest(events[0][0])
        steps, settled = self._settled(steps, last, first_ticks)
        confirmed = {n: before[n] + needed[n][:-1] for n in needed}
        news = self._news(steps, settled)
        for _, value in monitor.update(confirmed):
            self._last_value = value
        unread = [name for name in self._sources() if name not in last]
        warn_of_unknown(named.keys() - self.var_object_dict.keys(), unread)
        self._last, self._first_ticks = last, first_ticks
        self.var_object_dict |= named
        return self._stamped(news)

    @drop_in_advice()
    def final_update(self, *signals: NamedEvents) -> Pairs:
        """Add the last events, and return the remaining robustness.

        Every variable holds its last value to the last event of all. Raises the errors of `update`,
        and StateError if a variable has no events.
        """
        monitor = self._running()
        named, needed = self._read_signals(signals)
        needed, _, steps = self._look_ahead(needed)
        known = {name: [event] for name, event in self._last.items()} | needed
        held = _held_to_the_end(known, self._clock)
        steps += self._ahead.update({name: held[name][len(known[name]) :] for name in held})
        steps += self._ahead.finish()
        monitor.__setstate__(self._ahead.__reduce__()[2])
        self.var_object_dict |= named
        return self._stamped(self._news(steps, None))

    def _look_ahead(
        self, needed: EventLists
    ) -> tuple[EventLists, EventLists, list[tuple[float, float]]]:
        """Return the new events, the event before them, and the steps that they settle.

        The event before them is the last known event, unless the first new event has its time.
        """
        clock, ahead = self._clock, self._ahead
        new = {n: events for n, events in _last_of_each_tick(needed, clock).items() if events}
        last = {name: [event] for name, event in self._last.items()}
        for name in new.keys() & last.keys():
            if clock.on_one_tick(last[name][0][0], new[name][0][0]):
                last[name] = []
        before = {name: last.get(name, []) for name in new}
        state = self._running().__reduce__()[2]
        ahead.__setstate__(state)
        try:
            return new, before, ahead.update(last | {n: before[n] + new[n] for n in new})
        except InputError:  # its message would count earlier events too
            ahead.__setstate__(state)
            steps = ahead.update(last)
            return new, before, steps + ahead.update(new)

    def _settled(
        self,
        steps: list[tuple[float, float]],
        last: Mapping[str, tuple[float, Any]],
        first_ticks: Mapping[str, int],
    ) -> tuple[list[tuple[float, float]], tuple[float, float] | None]:
        """Return all settled steps, and the last settled time with its value, or None."""
        if len(last) < len(self._sources()):
            return steps, None
        clock, ahead = self._clock, self._ahead
        ticks = {name: clock.nearest(time) for name, (time, _) in last.items()}
        end, begin = min(ticks.values()), max(first_ticks.values())
        time = clock.time(end - self._horizon_ticks)
        if end - self._horizon_ticks >= begin:
            # The monitor returns a value after it has lasted for a tick.
            after = (end + 1) * clock.tick
            held = {name: [(after, last[name][1])] for name in ticks if ticks[name] == end}
            try:
                steps = steps + ahead.update(held)
            except InputError:  # the last tick of the clock
                return steps, None
            return steps, (time, steps[-1][1] if steps else self._last_value)
        if end < begin:
            return steps, None
        state = ahead.__reduce__()[2]
        so_far = ahead.finish()[0][1]
        ahead.__setstate__(state)
        return steps, (time, so_far)

    def _news(
        self, steps: Sequence[tuple[float, float]], settled: tuple[float, float] | None
    ) -> list[tuple[float, float]]:
        """Return the unreported steps, and the settled time if it is unreported."""
        time, value = self._reported or (-math.inf, math.nan)
        now = self._last_value
        news = []
        for step in steps:
            if step[0] <= time:
                now = step[1]
        if not math.isnan(now) and now != value:  # events at that time were replaced
            news.append((time, now))
        for step in steps:
            if step[0] > time and step[1] != (news[-1][1] if news else now):
                news.append(step)
        if settled is not None and settled[0] > (news[-1][0] if news else time):
            news.append(settled)
        if news:
            self._reported = news[-1]
        return news

    def _stamped(self, steps: Sequence[tuple[float, float]]) -> Pairs:
        if steps:
            self._robustness = steps[-1][1]
        times = [time for time, _ in steps]
        if self._horizon_ticks:
            ticks = self._clock.ticks(np.array(times, np.float64), "")
            times = self._clock.times(ticks + self._horizon_ticks).tolist()
        return [[time, value + 0.0] for time, (_, value) in zip(times, steps, strict=True)]

    def _value(self, formula: str) -> float:
        return self._ahead.values[formula]

    def _start(self) -> DenseMonitor:
        spec, options = self._specification(), self._options()
        monitor, self._ahead = DenseMonitor(spec, **options), DenseMonitor(spec, **options)
        program = monitor.program.program
        self._clock = Clock(monitor.program)
        self._horizon_ticks = program.latencies[program.result] or 0
        self._last, self._first_ticks, self._reported = {}, {}, None
        self._last_value = self._robustness = math.nan
        return self._run(monitor)


class StlDenseTimeOfflineSpecification(OfflineSpecification[EventLists], _Dense):
    """Robustness of complete signals.

    Example:
        >>> spec = StlDenseTimeOfflineSpecification()
        >>> spec.declare_var("x", "float")
        >>> spec.spec = "eventually[0:1](x >= 3)"
        >>> spec.parse()
        >>> spec.evaluate(["x", [[0.0, 0.0], [2.0, 5.0], [4.0, 1.0], [9.0, 1.0]]])
        [[0.0, -3.0], [1.0, 2.0], [4.0, -2.0]]
    """

    @drop_in_advice()
    def evaluate(self, *signals: NamedEvents) -> Pairs:
        """Return the breakpoints of the robustness of complete signals.

        Args:
            signals: Pairs of a name and its events. Unknown names are ignored.

        Raises:
            StateError: Before `parse`.
            SpecificationError: If the text has an operator on neighbouring samples.
            InputError: If times do not increase, a value or a term is nan, or a variable has no
                events.
            InputTypeError: If a value is not a real number.
        """
        spec = self._specification()
        named, needed = self._read_signals(signals)
        clock = Clock(compile_dense(spec))
        trace = _last_of_each_tick(needed, clock)
        if all(trace.values()):
            trace = _held_to_the_end(trace, clock)
        pairs = self._robustness_of(spec, trace)
        self.var_object_dict |= named
        self._evaluated(trace)
        return pairs

    def _robustness_of(self, spec: Specification, trace: EventLists) -> Pairs:
        if len(trace) == len(self._sources()) and not all(trace.values()):
            return []
        return _without_signs(evaluate_dense(spec, trace, **self._options()))


class StlDenseTimeSpecification(StlDenseTimeOfflineSpecification, StlDenseTimeOnlineSpecification):
    """Robustness as events arrive, and of complete signals."""
