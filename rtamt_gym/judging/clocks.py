"""What temporal operators owe, sample by sample: in one environment, and in many.

`rtamt.OperatorClocks` says what each clock counts. The margin of an operand is its newest known
robustness, 0 while none is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

import rtamt
from rtamt import ClockEvent, Monitor, OperatorClock, OperatorClocks, VectorMonitor
from rtamt_gym.judging.costs import options_of_parts
from rtamt_gym.judging.obligations import Instants, Obligation, bare, obligations_of
from rtamt_gym.judging.picking import pick, picked
from rtamt_gym.options.evaluation import Reading
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["Obligations", "Owed", "SingleObligations"]

_M = TypeVar("_M", Monitor, VectorMonitor)


class Owed(NamedTuple):
    """The state of an operator: in every environment, or as floats in one.

    Attributes:
        clock: From 0 to 1.
        margins: The robustness of its operands.
    """

    clock: Any
    margins: tuple[Any, ...]


class _Obligations(Generic[_M]):
    """What the temporal operators of several specifications owe.

    Attributes:
        found: The operators of each specification.

    Args:
        judged: The specification of each judge, by name.
        reading: How samples are judged.
        make: Makes the monitor of a formula whose values clocks need.
        num: The number of environments.
    """

    def __init__(
        self,
        judged: Mapping[str, rtamt.Specification],
        reading: Reading,
        make: Callable[..., _M],
        num: int,
    ) -> None:
        self.found = [obligations_of(spec, reading) for spec in judged.values()]
        parts = {
            (place, part): bare(spec, part)
            for place, (spec, found) in enumerate(zip(judged.values(), self.found, strict=True))
            for each in found
            for part in each.parts
        }
        options = options_of_parts(judged, list(parts.values()), reading)
        self._monitors: list[_M] = [
            make(spec, **option) for spec, option in zip(parts.values(), options, strict=True)
        ]
        places = {key: place for place, key in enumerate(parts)}
        late = [monitor.latency for monitor in self._monitors]
        clocks = [
            _clock_of(each, [places[place, part] for part in each.parts], late)
            for place, found in enumerate(self.found)
            for each in found
        ]
        self._clocks = OperatorClocks(clocks, len(parts), num)

    def _owed(self, clocks: Iterable[Any], margins: Iterable[Any]) -> list[list[Owed]]:
        """What each operator of each specification owes, from rows of all clocks and operands."""
        rows, values = iter(clocks), iter(margins)
        return [
            [Owed(next(rows), tuple([next(values) for _ in each.operands])) for each in found]
            for found in self.found
        ]


class Obligations(_Obligations[VectorMonitor]):
    """What the temporal operators of several specifications owe in many environments.

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
        def make(spec: rtamt.Specification, **option: Any) -> VectorMonitor:  # noqa: ANN401
            return VectorMonitor(spec, num, **option)

        super().__init__(judged, reading, make, num)
        self._picks = [
            pick([columns.index(name) for name in monitor.variables]) for monitor in self._monitors
        ]
        self._values: Floats = np.empty((len(self._monitors), num))

    def reset(self, lanes: Lanes | None = None) -> None:
        """Forgets the episodes of the environments of the mask; None: of all."""
        for monitor in self._monitors:
            monitor.reset(lanes)
        self._clocks.reset(lanes)

    def feed(self, table: Floats, lanes: Lanes | None = None) -> None:
        """Feeds a row of the table to every environment of the mask; None: to all."""
        for place, monitor in enumerate(self._monitors):
            self._values[place] = monitor.update(table[:, self._picks[place]], lanes)
        self._clocks.feed(self._values, lanes)

    def owed(self) -> list[list[Owed]]:
        """The state of every operator of each specification, in fresh arrays."""
        return self._owed(self._clocks.fractions, self._clocks.margins)


class SingleObligations(_Obligations[Monitor]):
    """What the temporal operators of several specifications owe in one environment.

    Its vector twin is `Obligations`.

    Args:
        judged: The specification of each judge, by name.
        reading: How samples are judged.
    """

    def __init__(self, judged: Mapping[str, rtamt.Specification], reading: Reading) -> None:
        super().__init__(judged, reading, Monitor, 1)

    def reset(self) -> None:
        """Forgets the episode."""
        for monitor in self._monitors:
            monitor.reset()
        self._clocks.reset()

    def feeder(self, names: Sequence[str]) -> Callable[[Sequence[float]], None]:
        """Makes the function that feeds a sample.

        Args:
            names: The names of the signals, in the order of the values that the function takes.
        """
        parts = [
            (monitor.update, *picked([names.index(v) for v in monitor.variables]))
            for monitor in self._monitors
        ]
        take = self._clocks.feed
        if not parts:
            return lambda _: None

        def feed(values: Sequence[float]) -> None:
            take(
                [
                    [update(values[alone]) if pick is None else update(*pick(values))]
                    for update, alone, pick in parts
                ]
            )

        return feed

    def owed(self) -> list[list[Owed]]:
        """The state of every operator of each specification."""
        clocks = self._clocks
        return self._owed(clocks.fractions[:, 0].tolist(), clocks.margins[:, 0].tolist())


_FAIL = {"always", "next", "historically", "fall"}
"""The operators whose clocks look at where their operand fails."""


def _event_of(obligation: Obligation) -> ClockEvent:
    match obligation.name:
        case "until" | "unless" | "since" as two:
            return two
        case name:
            return "fails" if name in _FAIL else "holds"


def _clock_of(
    obligation: Obligation, parts: Sequence[int], latencies: Sequence[int]
) -> OperatorClock:
    """The clock of an operator whose formulas have these parts, the operands first."""
    operands = parts[: len(obligation.operands)]
    late = max(latencies[part] for part in operands)
    asked = obligation.asked
    return OperatorClock(
        obligation.kind,
        _event_of(obligation),
        obligation.begin + late,
        None if obligation.end is None else obligation.end + late,
        late,
        tuple((part, late - latencies[part]) for part in operands),
        None if isinstance(asked, Instants) else parts[-1],
        asked is Instants.FIRST,
    )
