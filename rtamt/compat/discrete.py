"""The drop-in classes for samples, over `Monitor`, `EpisodeMonitor` and `evaluate`.

At sample t, ``update`` returns the robustness at t - latency. Before that sample exists, it returns
the robustness of the trace if it ended now.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from typing import Any, cast

import numpy as np

from rtamt.compat.specification import (
    AbstractSpecification,
    Language,
    OfflineSpecification,
    OnlineSpecification,
    Semantics,
    drop_in_advice,
    sample_error,
    warn_of_unknown,
)
from rtamt.errors import InputError, InputTypeError, SpecificationError, StateError
from rtamt.inputs.messages import Messages, write_fields
from rtamt.language.interval import UNITS
from rtamt.language.specification import Specification
from rtamt.monitors.evaluation import evaluate
from rtamt.monitors.explainer import explain
from rtamt.monitors.explanation import Explanation
from rtamt.monitors.monitor import EpisodeMonitor, Monitor
from rtamt.program.timing import Period, as_period


class _Sampled(AbstractSpecification):
    """A specification on samples with a fixed period.

    Attributes:
        sampling_period: The period, in `sampling_period_unit`.
        sampling_period_unit: s, ms, us, ns, ps, min or h.
        sampling_tolerance: How early or late a sample may be, as a share of the period.
        sampling_violation_counter: The number of samples outside of this tolerance.
    """

    def __init__(
        self,
        semantics: Semantics | str = Semantics.STANDARD,
        language: Language = Language.PYTHON,
    ) -> None:
        super().__init__(semantics, language)
        self.sampling_period: Period = 1
        self.sampling_period_unit = "s"
        self.sampling_tolerance = 0.1
        self.sampling_violation_counter = 0

    def set_sampling_period(
        self, sampling_period: Period = 1, unit: str = "s", tolerance: float = 0.1
    ) -> None:
        """Set the period, before the first sample.

        Args:
            sampling_period: The period; 0 for a specification without bounds.
            unit: s, ms, us, ns, ps, min or h.
            tolerance: How early or late a sample may be, as a share of the period.

        Raises:
            SpecificationError: If the period is negative or infinite, the unit is unknown, or the
                tolerance is outside [0, 1].
        """
        if sampling_period != 0:
            as_period(sampling_period)
        if unit not in UNITS:
            raise SpecificationError(f"expected a unit ({', '.join(UNITS)}), got {unit!r}")
        if not 0 <= tolerance <= 1:
            raise SpecificationError(f"expected a tolerance between 0 and 1, got {tolerance!r}")
        self.sampling_period = sampling_period
        self.sampling_period_unit = unit
        self.sampling_tolerance = tolerance

    def get_sampling_frequency(self) -> float:
        """Return the samples per second.

        Raises:
            SpecificationError: If the period is 0.
        """
        return float(1 / self._seconds())

    def _seconds(self) -> Fraction:
        period = as_period(self.sampling_period)
        assert period is not None  # noqa: S101 - for the type checker
        return period * UNITS[self.sampling_period_unit]

    def _period(self) -> Fraction | None:
        # Only bounds need the period; clients that round to two digits pass 0 for 0.001.
        return self._seconds() if self._specification().timed else None

    def _durations(self) -> tuple[float, float]:
        """Return the minimum and maximum time between samples within the tolerance, in `unit`."""
        if self.sampling_period == 0:
            return 0.0, 0.0
        period = self._seconds() / UNITS[self.unit]
        tolerance = Fraction(str(self.sampling_tolerance))
        return float(period * (1 - tolerance)), float(period * (1 + tolerance))


class StlDiscreteTimeOnlineSpecification(OnlineSpecification[Monitor], _Sampled):
    """Robustness sample by sample.

    Example:
        >>> spec = StlDiscreteTimeOnlineSpecification()
        >>> spec.declare_var("x", "float")
        >>> spec.spec = "eventually[0:1](x >= 3)"
        >>> spec.parse()
        >>> [spec.update(t, [("x", x)]) for t, x in enumerate([0.0, 5.0, 1.0, 2.0])]
        [-3.0, 2.0, 2.0, -1.0]
    """

    _start_monitors: dict[str, EpisodeMonitor]
    """Monitors of the result and of named formulas with a latency, until all have a value."""
    _time: float | None
    """The time of the last sample."""
    _shortest_step: float
    _longest_step: float
    _names: tuple[str, ...]
    """The names in `var_object_dict` that the monitor needs."""
    _arguments: Callable[[Mapping[str, Any]], Iterable[Any]]
    """Returns the values of these names as arguments of a monitor."""

    def update(self, timestamp: float, dataset: Iterable[tuple[str, Any]]) -> float:
        """Add a sample, and return the robustness at the time of the sample minus the latency.

        A call that raises an error leaves the specification unchanged.

        Args:
            timestamp: Time of the sample in `unit`, only for `sampling_violation_counter`.
            dataset: Names and values. Absent variables keep their values, which are 0 at first;
                unknown names are ignored, with a warning in the log if the name resembles an
                absent variable.

        Raises:
            StateError: Before `parse`.
            SpecificationError: At the first sample: if a bound is not a whole number of periods, or
                the text has an unbounded future.
            InputError: If a value or a term is nan.
            InputTypeError: If a value is not a real number.
        """
        monitor = self._monitor or self._start()
        values = self.var_object_dict.copy()
        try:
            values.update(dataset)
        except (TypeError, ValueError):
            raise InputTypeError(
                f"expected pairs of a name and a value, as [('x', 1.5)], got {dataset!r}"
            ) from None
        sample = self._arguments(values)
        last = self._time
        try:
            passed = timestamp - (timestamp if last is None else last)
        except TypeError:
            raise InputTypeError(
                f"expected a number as the time of the sample, got {timestamp!r}"
            ) from None
        violated = last is not None and not self._shortest_step <= passed <= self._longest_step
        try:
            robustness = monitor.update(*sample)
        except InputError as error:
            raise sample_error(error) from None
        if self._start_monitors:
            robustness = self._early_robustness(monitor, sample, robustness)
        robustness += 0.0  # programs print it, and do not expect -0.0
        if len(values) > len(self.var_object_dict):
            unknown = values.keys() - self.var_object_dict.keys()
            known = self.var_object_dict
            unread = [name for name in self._names if values[name] is known.get(name)]
            warn_of_unknown(unknown, unread)
        self.var_object_dict = values
        self._time = timestamp
        self._robustness = robustness
        if violated:
            self.sampling_violation_counter += 1
        if self._published:
            message = {self.out_var: values[self.out_var]}
            write_fields(monitor.specification, {self._result: robustness}, message, {})
        return robustness

    @drop_in_advice()
    def _start(self) -> Monitor:
        spec, period, options = self._specification(), self._period(), self._options()
        monitor = Monitor(spec, period, **options)
        late = {name: self._named(name) for name, n in monitor.latencies.items() if n}
        late |= {self._result: spec} if monitor.latency else {}
        self._start_monitors = {
            n: EpisodeMonitor(formula, period, **options) for n, formula in late.items()
        }
        self._time = None
        self._shortest_step, self._longest_step = self._durations()
        self.sampling_violation_counter = 0
        self._names = self._sources()
        self._arguments = self._by_name
        if len(self._names) > 1 and self._names == monitor.variables:
            # By position, in a sixth of the time; for one name itemgetter returns no tuple.
            self._arguments = operator.itemgetter(*self._names)
        self._published = self._source(self._result) != self._result
        if self._published:  # refuse a message without the field before the first sample
            for field in Messages(spec, (self._result,)).under(self.out_var):
                field.holder(self.var_object_dict[self.out_var])
        return self._run(monitor)

    def _early_robustness(
        self, monitor: Monitor, sample: Iterable[Any], robustness: float
    ) -> float:
        """Return the robustness of the samples so far until there is a sample at t - latency."""
        for episode in self._start_monitors.values():
            episode.update(*sample)
        if monitor.samples <= monitor.latency:
            robustness = self._start_monitors[self._result].robustness
        if monitor.samples > max([monitor.latency, *monitor.latencies.values()]):
            self._start_monitors = {}
        return robustness

    def _value(self, formula: str) -> float:
        monitor = self._running()
        if formula in self._start_monitors and monitor.samples <= monitor.latencies[formula]:
            return self._start_monitors[formula].robustness
        return monitor.values[formula]

    def _by_name(self, values: Mapping[str, Any]) -> tuple[dict[str, Any]]:
        return ({name: values[name] for name in self._names},)


_Trace = tuple[dict[str, Any], list[float]]
"""The columns of a trace by name, and the times of its samples."""


class StlDiscreteTimeOfflineSpecification(OfflineSpecification[_Trace], _Sampled):
    """Robustness of complete traces.

    Example:
        >>> spec = StlDiscreteTimeOfflineSpecification()
        >>> spec.declare_var("x", "float")
        >>> spec.spec = "eventually[0:1](x >= 3)"
        >>> spec.parse()
        >>> spec.evaluate({"time": [0, 1, 2, 3], "x": [0.0, 5.0, 1.0, 2.0]})
        [[0, 2.0], [1, 2.0], [2, -1.0], [3, -1.0]]
    """

    def evaluate(self, dataset: Mapping[str, Any]) -> list[list[float]]:
        """Return the robustness at every sample of a trace, as pairs of time and robustness.

        Args:
            dataset: The values of every variable, and under ``"time"`` their times in `unit`.
                Other names are ignored.

        Raises:
            StateError: Before `parse`.
            SpecificationError: If a bound is not a whole number of periods.
            InputError: If variables or times are missing, the trace is empty, columns differ in
                length, or a value is nan.
            InputTypeError: If a value is not a real number.
        """
        spec = self._specification()
        if "time" not in dataset:
            raise InputError("expected the times of the samples as 'time', got none")
        try:
            time = list(dataset["time"])
            steps = np.diff(np.asarray(time, dtype=np.float64))
        except (TypeError, ValueError):
            raise InputTypeError(
                f"expected numbers as the times of the samples, got {dataset['time']!r}"
            ) from None
        columns = {name: dataset[name] for name in self._sources() if name in dataset}
        robustness = self._robustness_of(spec, (columns, time))
        least, most = self._durations()
        off = int(np.count_nonzero((steps < least) | (steps > most)))
        self.sampling_violation_counter += off
        self.var_object_dict = self.var_object_dict | {
            k: dataset[k] for k in dataset if k != "time"
        }
        self._evaluated((columns, time))
        return [[t, value] for t, value in zip(time, robustness, strict=True)]

    @drop_in_advice()
    def explain(self) -> Explanation:
        """Return the sub-formulas and samples that decided the robustness at the first sample.

        Raises:
            StateError: Before `evaluate`.
        """
        if self._trace is None:
            raise StateError("expected a trace to explain; call evaluate() first")
        columns, time = self._trace
        seconds = float(time[0]) * float(UNITS[self.unit])
        spec, period, options = self._specification(), self._period(), self._options()
        return explain(spec, columns, period, start=seconds, n=len(time), **options)

    @drop_in_advice()
    def _robustness_of(self, spec: Specification, trace: _Trace) -> list[Any]:
        columns, time = trace
        values = evaluate(spec, columns, self._period(), n=len(time), **self._options())
        return cast("list[Any]", (values + 0.0).tolist())


class StlDiscreteTimeSpecification(
    StlDiscreteTimeOfflineSpecification, StlDiscreteTimeOnlineSpecification
):
    """Robustness sample by sample, and of complete traces."""
