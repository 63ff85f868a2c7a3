"""The monitors of several specifications in one environment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property, partial
from operator import itemgetter
from typing import Any

import rtamt
from rtamt import EpisodeMonitor, InputError
from rtamt_gym.judges.infos import VERDICTS, outcome, present, spec_state
from rtamt_gym.judges.interface import STANDARD, Interface
from rtamt_gym.judges.monitors import InstantMonitor, machine_state, make_monitors
from rtamt_gym.judges.specs import Align, Nan, View
from rtamt_gym.signals.signals import Read

__all__ = ["Assessment", "Feed", "Monitors", "Panel"]

Assessment = tuple[float, float, float]
"""Robustness of the samples so far, and the lower and upper bound of what it can become."""

Feed = Callable[..., Assessment]
"""Feeds one sample to the monitors of a panel; takes the arguments of a `Read`."""

Monitors = dict[str, tuple[EpisodeMonitor | InstantMonitor, EpisodeMonitor]]
"""The monitors of each specification: ``(robustness source, judge)``."""


class Panel:
    """The monitors of several specifications, fed together, and the verdicts they have decided.

    Its vector twin is `rtamt_gym.judges.vector_panel.VectorPanel`.

    Attributes:
        monitors: The monitors of each specification: ``(robustness source, judge)``.
        variables: The names that each specification reads.
        settled: How many verdicts are decided.
        violated_by: The specification that was violated first; None while none is.

    Args:
        specs: Specifications by name.
        period: Time between samples.
        view: Whether formulas are evaluated at sample 0 or at every instant.
        nan: Whether a signal that is nan is refused, or keeps its last value.
        interface: How predicates count.
        align: How bounds that are no multiple of the period become samples; None refuses them.

    Raises:
        SpecificationError: As `rtamt_gym.judges.monitors.make_monitors` does.
        InputError: As `rtamt_gym.judges.monitors.make_monitors` does.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        period: float | str | None,
        view: View,
        nan: Nan = "raise",
        interface: Interface = STANDARD,
        align: Align | None = None,
    ) -> None:
        self.monitors: Monitors = make_monitors(
            specs,
            view,
            interface,
            of_episode=partial(EpisodeMonitor, period=period, nan=nan, align=align),
            of_instants=partial(InstantMonitor, period=period, nan=nan, align=align),
        )
        self.variables = {name: spec.variables for name, spec in specs.items()}
        self._specs = specs
        self._sources = [source for source, _ in self.monitors.values()]
        self._judges = [judge for _, judge in self.monitors.values()]
        self._decided: dict[str, int] = {}
        self.settled = 0
        self.violated_by: str | None = None

    @cached_property
    def _described(self) -> dict[str, str]:
        return {
            name: _described(spec, judge)
            for (name, spec), judge in zip(self._specs.items(), self._judges, strict=True)
        }

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; None where bounds count samples."""
        return self._judges[0].period

    @property
    def samples(self) -> int:
        """Samples fed since the reset."""
        return self._judges[0].samples

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation; None while there is none."""
        return None if self.violated_by is None else self._decided[self.violated_by]

    @property
    def all_decided(self) -> bool:
        """Whether every verdict is decided."""
        return self.settled == len(self.monitors)

    @property
    def robustness(self) -> float:
        """The least robustness over the specifications; nan before the first sample."""
        return min(source.robustness for source in self._sources)

    @property
    def lower(self) -> float:
        """The least that the robustness can still become."""
        return min(judge.lower for judge in self._judges)

    @property
    def upper(self) -> float:
        """The greatest that the robustness can still become."""
        return min(judge.upper for judge in self._judges)

    def read(self) -> Assessment:
        """Reads robustness, lower and upper bound of the samples so far."""
        return self.robustness, self.lower, self.upper

    def feeder(
        self,
        names: Sequence[str],
        reads: Sequence[Read] | None = None,
        *,
        decide: Callable[[], None] | None = None,
    ) -> Feed:
        """Makes the function that feeds one sample to all monitors.

        It takes the arguments of a `Read`, and returns the least robustness and the least lower and
        upper bound over the specifications.

        Args:
            names: Names of the signals, the variables of all specifications among them.
            reads: What reads each signal; None: the first argument is the sample itself, with a
                value for each signal.
            decide: Called after a sample that has decided a verdict, in place of `note`.
        """
        note = decide or self.note
        if len(self.monitors) == 1 and reads is not None and len(reads) == 1:
            return self._feeder_of_one(reads[0], note)
        parts = [
            (source.update, indices[0] if len(indices) == 1 else None, _pick(indices), judge.bounds)
            for name, (source, judge) in self.monitors.items()
            for indices in [tuple(names.index(variable) for variable in self.variables[name])]
        ]

        def feed(*step: Any) -> Assessment:  # noqa: ANN401
            values = step[0] if reads is None else [read(*step) for read in reads]
            robustness = lower = upper = math.inf
            decided = 0
            for update, alone, pick, bounds in parts:
                value = update(*pick(values)) if alone is None else update(values[alone])
                low, high = bounds()
                if high < 0.0 or low > 0.0:
                    decided += 1
                # Calls of min() would cost as much as all the rest.
                if value < robustness:  # noqa: PLR1730
                    robustness = value
                if low < lower:  # noqa: PLR1730
                    lower = low
                if high < upper:  # noqa: PLR1730
                    upper = high
            if decided > self.settled:
                note()
            return robustness, lower, upper

        return feed

    def _feeder_of_one(self, read: Read, note: Callable[[], None]) -> Feed:
        """The `feeder` of one signal for one monitor, the common case: without lists and loops."""
        ((source, judge),) = self.monitors.values()
        update, bounds = source.update, judge.bounds

        def feed(
            obs: Any = None,  # noqa: ANN401
            action: Any = None,  # noqa: ANN401
            reward: Any = None,  # noqa: ANN401
            info: Any = None,  # noqa: ANN401
        ) -> Assessment:
            robustness = update(read(obs, action, reward, info))
            lower, upper = bounds()
            if (upper < 0.0 or lower > 0.0) and not self.settled:
                note()
            return robustness, lower, upper

        return feed

    def reset(self) -> None:
        for source in self._sources:
            source.reset()
        self._decided = {}
        self.settled = 0
        self.violated_by = None

    def note(self) -> None:
        """Records the verdicts that the last sample, or the end of the trace, has decided."""
        for name, (_, judge) in self.monitors.items():
            if judge.verdict != 0 and name not in self._decided:
                self._decided[name] = judge.samples - 1
                if judge.verdict < 0 and self.violated_by is None:
                    self.violated_by = name
        self.settled = len(self._decided)

    def finish(self) -> tuple[float, float]:
        """Ends the trace, which settles the bounds; returns the least of each."""
        for judge in self._judges:
            judge.finish()
        self.note()
        return self.lower, self.upper

    def describe(self) -> dict[str, dict[str, Any]]:
        """The state of every specification: ``info["stl"]``."""
        return {
            name: spec_state(source.robustness, judge.lower, judge.upper, _NAMES[judge.verdict])
            for name, (source, judge) in self.monitors.items()
        }

    def outcomes(self) -> dict[str, dict[str, Any]]:
        """The outcome of every specification so far: ``info["stl_episode"]``."""
        decided = self._decided
        return {
            name: present(outcome(judge.robustness, judge.verdict, decided.get(name, -1)))
            for name, (_, judge) in self.monitors.items()
        }

    def state(self) -> tuple[Any, ...]:
        """The state of the monitors, small and fit for pickle."""
        sources = [
            source.state() if isinstance(source, InstantMonitor) else machine_state(source)
            for source in self._sources
        ]
        return self._described, sources, dict(self._decided), self.violated_by

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes back to a `state`; raises an `InputError` if it is one of other specifications."""
        described, sources, decided, violated_by = state
        if described != self._described:
            raise InputError(
                f"expected a state of the specifications {self._described}, got one of {described}"
            )
        for source, held in zip(self._sources, sources, strict=True):
            if isinstance(source, InstantMonitor):
                source.restore(held)
            else:
                source.__setstate__(held)
        self._decided = dict(decided)
        self.settled = len(self._decided)
        self.violated_by = violated_by


def _described(spec: rtamt.Specification, judge: EpisodeMonitor) -> str:
    """The formula, with its semantics unless that is the standard one."""
    interface = judge.interface
    if interface.semantics == "standard":
        return str(spec.formula)
    words = [str(interface.semantics)]
    words += [f"input {name}" for name in interface.inputs]
    words += [f"output {name}" for name in interface.outputs]
    return f"{spec.formula} under {', '.join(words)}"


_NAMES = tuple(VERDICTS)  # an enum's own name takes twice the time


def _pick(indices: tuple[int, ...]) -> Callable[[Sequence[float]], tuple[float, ...]]:
    """The function that takes the elements at some indices."""
    if len(indices) > 1:
        return itemgetter(*indices)
    return lambda values: tuple(values[index] for index in indices)
